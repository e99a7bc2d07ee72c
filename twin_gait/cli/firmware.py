"""``twin-gait firmware``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from twin_gait.cli import options, terminal
from twin_gait.cli.terminal import DONE

WALK = 3.0  # [s] of the vectors: every phase of both legs


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "firmware",
        help="print the controller as C for the device",
        description=(
            "Print gait table, drives and laws of an experiment as readable C99: the board of a joint, the "
            "gait controller, both as one unit, and the CAN frames, with a Makefile, and a short walk to "
            "compare them with."
        ),
    )
    options.add_experiment(parser, seconds=None)
    options.add_out(parser, "DIR", "folder to write", required=True)
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the project."""
    from dataclasses import replace

    from twin_gait.configuration.experiments import resolved_document
    from twin_gait.firmware.project import MANIFEST, print_project
    from twin_gait.firmware.vectors import record_vectors
    from twin_gait.runs.folders import FolderKind, staged_directory
    from twin_gait.runs.summary import versions

    loaded = options.experiment_of(arguments)
    experiment, kind = loaded.experiment, FolderKind("a firmware folder", MANIFEST)
    document = resolved_document(experiment, loaded.document, versions())
    with staged_directory(arguments.out, kind, force=arguments.force) as staging:
        terminal.note_step("C", "printing")
        project = print_project(experiment)
        walk = replace(experiment, duration=min(WALK, experiment.duration), faults=())
        with terminal.watched("vectors", "tick") as watch:
            vectors = record_vectors(walk, watch["progress"], watch["on_compile"])
        project.write(staging, vectors, document)
    terminal.clear_line()
    manifest = project.manifest(document)
    terminal.answer(
        arguments, report(manifest, arguments.out), lambda: {**manifest, "directory": arguments.out}
    )
    return DONE


def report(manifest: Mapping[str, Any], out: Path) -> Iterator[str]:
    """What was printed, in a few lines."""
    yield f"{manifest['experiment']}, gait table {manifest['table']}: source {manifest['source_sha256'][:16]}"
    sizes = (f"{name} {size}" for name, size in manifest["record_bytes"].items())
    yield f"  bytes of RAM on a Cortex-M: {', '.join(sizes)}"
    if not manifest["can_codec"]:
        yield "  without can_codec: pip install cantools, and print again"
    yield f"  {out}; make -C {out} test compares it with the simulation"
