"""Options that several commands share, each declared once, and functions that read them."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.docstrings import docstring_of
from twin_gait.exceptions import GaitTableError, ParameterError, RunDirectoryError
from twin_gait.files import check_replaceable

if TYPE_CHECKING:
    from twin_gait.configuration.experiments import LoadedExperiment
    from twin_gait.control.controller import Controller
    from twin_gait.experiment.experiment import Experiment

PROCESSORS = os.cpu_count() or 1
FIRST_PORT = 7000
_ENDINGS = set("csv parquet mot sto log asc mcap html png jpg jpeg svg pdf".split())
_FLAG: dict[str, Any] = {"action": "store_true"}
_PORT = f"first port to try ({FIRST_PORT}; 0: any)"
SEED = "seed of every random draw (0)"
SHARED: dict[str, dict[str, Any]] = {
    "--force": {**_FLAG, "help": "replace an existing file or folder"},
    "--json": {**_FLAG, "help": "print the result as one JSON document"},  # see terminal.answer
    "--no-pictures": {**_FLAG, "help": "leave out figures and animations"},
    "--unchecked": {**_FLAG, "help": "run a gait table even if 'twin-gait check' finds errors in it"},
    "--seed": {"type": int, "default": 0, "metavar": "N", "help": SEED},
    "--port": {"type": int, "default": FIRST_PORT, "metavar": "N", "help": _PORT},
    "--no-browser": {**_FLAG, "help": "print the address of the page and open no browser"},
    "--workers": {"type": int, "metavar": "N", "help": f"number of processes on this machine ({PROCESSORS})"},
    "--scheduler": {"metavar": "ADDRESS", "help": "Dask scheduler, such as tcp://127.0.0.1:8786"},
}
# Options for the values of an experiment that are changed most often: metavar, key and meaning of each.
_SHORTHANDS = {
    "--mass": ("KG", "patient.mass_kg", "mass of the wearer in kg"),
    "--height": ("M", "patient.height_m", "height of the wearer in m"),
    "--speed": ("KM_PER_H", "scenario.belt_speed_km_per_h", "belt speed in km/h"),
    "--support": ("SHARE", "scenario.support.share", "supported share of the body weight, 0 to 1"),
}


Command = Callable[[argparse.Namespace], int]


def add_command(commands: Any, name: str, run: Command) -> argparse.ArgumentParser:
    """Add a command whose help and description are the docstring of the function that runs it.

    The first line becomes the help, the rest the description.
    """
    summary, _, rest = docstring_of(run).partition("\n\n")
    text, about = summary[:1].lower() + summary[1:].rstrip("."), " ".join(rest.split()) or summary
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=about)
    parser.set_defaults(run=run)
    return parser


def add_out(parser: argparse.ArgumentParser, metavar: str, text: str, *, required: bool = False) -> None:
    """Add ``--out`` and ``--force``."""
    parser.add_argument("--out", type=Path, metavar=metavar, required=required, help=text)
    add(parser, "--force")


def add(parser: argparse.ArgumentParser, *flags: str) -> None:
    """Add options of :data:`SHARED` by their flags."""
    for flag in flags:
        parser.add_argument(flag, **SHARED[flag])


def check_port(port: int) -> None:
    """Raise :class:`ParameterError` if a number is not a port (0 to 65535)."""
    if not 0 <= port <= 65535:
        raise ParameterError(f"--port: expected 0 to 65535, got {port}")


def add_experiment(
    parser: argparse.ArgumentParser, *, seconds: str | None, default: str = "treadmill"
) -> None:
    """Add the experiment, the options that change it, and ``--unchecked``.

    :func:`load_experiment` reads them. ``seconds`` is the text that states the duration of a run without
    ``--duration``; None omits that option. ``default`` is the preset without an argument.
    """
    parser.add_argument("experiment", nargs="?", default=default, help=f"preset or YAML file ({default})")
    add_settings(parser)
    text = "world: the scenario of a preset or of a YAML file"
    add_shorthand(parser, "--world", "NAME", "scenario", text, json.dumps)
    text = "gait table: a packaged gait table (see twin-gait presets), or a YAML file"
    add_shorthand(parser, "--table", "NAME", "table", text, json.dumps)
    text = "controller: a control mode, or FILE.py:CLASS of your own"
    parser.add_argument("--controller", metavar="NAME", help=text)
    if seconds is not None:
        add_shorthand(parser, "--duration", "S", "duration_s", f"simulated time in s ({seconds})")
    add(parser, "--unchecked")


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add ``--set`` and shorter options for some of its keys; ``settings`` holds all in their order."""
    text = "set any value, such as patient.mass_kg=80 or table.blending.duration_ms=40; may be repeated"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help=text)
    text = "device: a packaged device (see twin-gait presets), or a YAML file"
    add_shorthand(parser, "--device", "NAME", "device", text, json.dumps)
    text = "wearer: a packaged person (see twin-gait presets), or a YAML file"
    add_shorthand(parser, "--patient", "NAME", "patient", text, json.dumps)
    for flag, (unit, key, text) in _SHORTHANDS.items():
        add_shorthand(parser, flag, unit, key, text)


def add_shorthand(
    parser: argparse.ArgumentParser, flag: str, unit: str, key: str, text: str,
    read: Callable[[str], Any] = float,
) -> None:  # fmt: skip
    """Add an option that sets one key; ``read`` converts its value, and raises ValueError if it cannot."""

    def setting(given: str) -> str:
        return f"{key}={read(given)}"

    parser.add_argument(flag, action="append", dest="settings", type=setting, metavar=unit, help=text)


def load_experiment(arguments: argparse.Namespace, *defaults: str) -> LoadedExperiment:
    """Load the experiment of the arguments, and check its gait table unless ``--unchecked`` is given.

    ``defaults`` are settings ``KEY=VALUE`` that those of the user override.
    """
    from twin_gait.configuration.experiments import load_experiment, with_controller

    of_controller, own = _read_controller(getattr(arguments, "controller", None))
    loaded = load_experiment(arguments.experiment, [*defaults, *of_controller, *arguments.settings])
    if own is not None:
        loaded = with_controller(loaded, own)
    loaded.experiment.build_world()
    if not arguments.unchecked:
        check_table(loaded.experiment, arguments.experiment, arguments.settings)
    return loaded


def _read_controller(given: str | None) -> tuple[list[str], Controller | None]:
    """Return the settings of a control mode, or a controller of the user's own."""
    from twin_gait.control.controllers import CONTROLLERS
    from twin_gait.control.user_controller import load_controller

    if given is None:
        return [], None
    path, _, class_name = given.partition(":")
    if given in CONTROLLERS:
        return [f"control.mode={given}", "controller=null"], None
    if not path.endswith(".py"):
        known = f"one of {', '.join(CONTROLLERS)}, or FILE.py:CLASS"
        raise ParameterError(f"--controller: expected {known}, got {given!r}")
    return [], load_controller(Path(path), class_name)


def check_table(experiment: Experiment, source: str | None = None, settings: Sequence[str] = ()) -> None:
    """Raise :class:`GaitTableError` if the gait table has errors; print the number of warnings in a line."""
    from twin_gait.checking.check import check_before_run, counts
    from twin_gait.cli.findings import counted, heading

    findings = check_before_run(experiment)
    if not findings:
        return
    numbers = {name: number for name, number in counts(findings).items() if number}
    table, see = f"gait table {experiment.table.name}: {counted(numbers)}", ""
    if source is not None:
        words = [word for text in settings for word in ("--set", text)]
        see = f"; see {shlex.join(['twin-gait', 'check', '--experiment', source, *words])}"
    if "errors" in numbers:
        worst = f"{heading(findings[0])}: {findings[0].reason}"
        raise GaitTableError(f"{table}; {worst}{see}; correct it, or run it with --unchecked")
    print(f"{table}{see}", file=sys.stderr)


def worker_count(arguments: argparse.Namespace) -> int:
    """Return the number of processes to use; raise :class:`ParameterError` for a bad ``--workers``."""
    if arguments.workers is None:
        return PROCESSORS
    if getattr(arguments, "scheduler", None) is not None:
        raise ParameterError("--workers: leave it out, because --scheduler has workers of its own")
    if arguments.workers < 1:
        raise ParameterError(f"--workers: expected 1 or more, got {arguments.workers}")
    return int(arguments.workers)


def check_file(flag: str, path: Path, *, force: bool, form: str = "") -> None:
    """Raise an error if a file cannot be written, before any work is done for it.

    ``form`` is the ending of the format that will be written; a name with the ending of another format is
    rejected.
    """
    ending = path.suffix[1:].lower()
    if form and ending in _ENDINGS and ending != form:
        raise ParameterError(f"{flag} {path}: expected a name that ends in .{form}, got .{ending}")
    check_replaceable(path)
    if path.is_dir():
        raise RunDirectoryError(f"{flag} {path}: is a directory; give the name of a file")
    if path.exists() and not force:
        raise RunDirectoryError(f"{path}: exists; choose another {flag}, or replace it with --force")
    if not path.absolute().parent.is_dir():
        parent = path.absolute().parent
        raise RunDirectoryError(f"{flag} {path}: there is no directory {parent}; create it first")


def pairs(flag: str, text: str, allowed: Sequence[str] | None = None) -> dict[str, str]:
    """Parse ``a=b,c=d``; raise :class:`ParameterError` for an empty, repeated or not allowed name."""
    found: dict[str, str] = {}
    of = "" if allowed is None else f" of {', '.join(allowed)}"
    for part in filter(None, (item.strip() for item in text.split(","))):
        key, _, value = (item.strip() for item in part.partition("="))
        if not key or not value or key in found or (allowed is not None and key not in allowed):
            raise ParameterError(f"{flag}: expected NAME=VALUE,…, each name{of} only once, got {part!r}")
        found[key] = value
    return found


def drop_none(**values: Any) -> dict[str, Any]:
    """Return the values that are not None, so that the others keep their defaults."""
    return {name: value for name, value in values.items() if value is not None}
