"""``twin-gait firmware``: the controller as C."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE, FAILED
from twin_gait.exceptions import ParameterError

if TYPE_CHECKING:
    from twin_gait.configuration.experiments import LoadedExperiment

TARGETS = "board", "osl", "fmu"
WALK = 3.0  # [s], duration of the walk in the test vectors, which contains every phase of both legs


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = options.add_command(commands, "firmware", run)
    options.add_experiment(parser, seconds="duration of the experiment")
    options.add_out(parser, "DIR", "folder to write")
    text = (
        "board: the sources for boards; osl: also a library for the Open-Source Leg; "
        "fmu: functional mock-up units (FMI 2.0) of controller and plant instead (%(default)s)"
    )
    parser.add_argument("--target", choices=TARGETS, default=TARGETS[0], help=text)
    text = "compare the C with the simulation on the walk and on faults, on this machine and a Cortex-M4F"
    parser.add_argument("--verify", action="store_true", help=text)
    options.add(parser, "--json")


def run(arguments: argparse.Namespace) -> int:
    """Write the controller as C, and verify it.

    Write gait table, drives and laws of an experiment as readable C99: the board of a joint, the gait
    controller, both as one unit, and the CAN frames; with a Makefile and a short walk as test vectors. The
    target fmu is controller and plant for Simulink, OpenModelica and other tools instead. The exit status is
    1 if --verify finds a difference.
    """
    from twin_gait.files import write_json
    from twin_gait.firmware.project_folder import MANIFEST
    from twin_gait.firmware.verification import verify
    from twin_gait.report.pages import lines
    from twin_gait.runs.folders import FolderKind, staged_directory

    out = arguments.out
    if arguments.verify and arguments.target == "fmu":
        raise ParameterError("--verify: compares the C for boards; leave it out, or use --target board")
    if out is None and not (arguments.verify and arguments.target == "board"):
        raise ParameterError("--out: expected the folder to write; --verify without --target needs none")
    loaded = options.load_experiment(arguments)
    document: dict[str, Any] = {}
    kind = FolderKind("a firmware folder", MANIFEST)
    with nullcontext() if out is None else staged_directory(out, kind, force=arguments.force) as staging:
        if staging is not None:
            if arguments.target == "fmu":
                document |= _write_fmus(loaded, staging)
            else:
                document |= _write_project(loaded, staging, with_osl=arguments.target == "osl")
            document["directory"] = out
        if arguments.verify:
            with terminal.progress_bar("verifying", "tick") as progress:
                found = verify(loaded.experiment, progress)
            document |= found
            if staging is not None:
                write_json(staging / "verification.json", found)
    terminal.clear_line()
    terminal.answer(arguments, lines("firmware.txt", document), document)
    return FAILED if document.get("passed") is False else DONE


def _write_project(loaded: LoadedExperiment, folder: Path, *, with_osl: bool) -> dict[str, Any]:
    """Write the project to a folder, and return its manifest.

    ``with_osl``: whether to add the library for the Open-Source Leg; the manifest has its path, or None
    without gcc.
    """
    from twin_gait.firmware.exoskeleton_unit import record_vectors
    from twin_gait.firmware.osl import write_osl
    from twin_gait.firmware.project import print_project
    from twin_gait.firmware.project_folder import write_project

    experiment = loaded.experiment
    project, document = print_project(experiment), _resolve(loaded, folder)
    walk = replace(experiment, duration=min(WALK, experiment.duration), faults=())
    with terminal.progress_bar("vectors", "tick") as progress:
        vectors = record_vectors(walk, progress)
    found = write_project(project, folder, vectors, document)
    if with_osl:
        library = write_osl(project, folder)
        found["library"] = None if library is None else str(library.relative_to(folder))
    return found


def _write_fmus(loaded: LoadedExperiment, folder: Path) -> dict[str, Any]:
    """Write the FMUs to a folder, and return their manifest."""
    from twin_gait.firmware.fmu_folder import write_fmus

    return write_fmus(loaded.experiment, folder, _resolve(loaded, folder))


def _resolve(loaded: LoadedExperiment, folder: Path) -> dict[str, Any]:
    """Return the resolved document of an experiment, and store the files that it names in a folder."""
    from twin_gait.configuration.experiments import resolved_document
    from twin_gait.runs.summary import software_versions
    from twin_gait.runs.user_files import referenced_files, store_files

    files = store_files(referenced_files(loaded.experiment), folder)
    return resolved_document(loaded.experiment, loaded.document, software_versions(), files)
