"""Parse the command line, run a command, turn errors into one line."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from twin_gait import __version__
from twin_gait.cli.defect import describe_defect
from twin_gait.cli.terminal import (
    BAD_INPUT,
    DEFECT,
    DONE,
    INTERRUPTED,
    note_abandoned,
    warn_on_one_line,
    write_on_any_terminal,
)
from twin_gait.exceptions import TwinGaitError

NO_HOME = "Could not determine home directory."  # pathlib's words, which raises nothing more special


class OneLineParser(argparse.ArgumentParser):
    """Parser whose errors are one line with the way out."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Add what every command takes; arguments are those of the base class."""
        super().__init__(*arguments, **options)
        # Without a default, because the parser of a sub-command would overwrite what stands before its name.
        self.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="show the whole trace of an error"
        )

    def error(self, message: str) -> NoReturn:
        """Print one line and leave with status 2."""
        self.exit(BAD_INPUT, f"twin-gait: {message}; see '{self.prog} --help'\n")


def build_parser() -> argparse.ArgumentParser:
    """Parser of all commands."""
    parser = OneLineParser(
        prog="twin-gait",
        description="Gait simulation of the TWIN leg exoskeleton. Not a medical device.",
    )
    parser.add_argument("--version", action="version", version=f"twin-gait {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, parser_class=OneLineParser, metavar="COMMAND"
    )
    # Heavy imports wait until a command runs, so that --help answers at once.
    from twin_gait.cli import (
        bench,
        benchmark,
        check,
        clean,
        compare,
        diagram,
        export,
        faults,
        identify,
        live,
        plot,
        presets,
        replay,
        reproduce,
        sessions,
        simulate,
        sweep,
        tune,
        validate,
        view,
        whatif,
    )

    runs = (simulate, live, sessions, view, plot, export, presets, clean)
    tables = (check, diagram, replay)
    studies = (compare, tune, reproduce, whatif, sweep, faults, validate, benchmark)
    for module in (*runs, *tables, bench, identify, *studies):
        module.add_parser(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        argv: Arguments without the program name; those of the process if None.

    Returns:
        Exit status: 0 done, 1 failed or diverged, 2 bad input, 70 an error that nobody foresaw,
        130 interrupted.
    """
    write_on_any_terminal()
    warn_on_one_line()
    arguments = build_parser().parse_args(argv)
    command: Callable[[argparse.Namespace], int] = arguments.run
    try:
        status = command(arguments)
        if arguments.command in ("simulate", "live") or getattr(arguments, "out", None) is not None:
            note_abandoned(arguments.out)
        return status
    except KeyboardInterrupt:
        print("twin-gait: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone (a pager that was closed): not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except Exception as error:
        if "debug" in arguments:
            traceback.print_exception(error)
        return _tell(error, sys.argv[1:] if argv is None else argv)


def _tell(error: Exception, arguments: Sequence[str]) -> int:
    """One line on an error, and the exit status."""
    if isinstance(error, TwinGaitError):
        status, line = BAD_INPUT, str(error)
    elif isinstance(error, OSError) and error.filename is not None:  # a path that the system refuses
        status, line = BAD_INPUT, f"{error.filename}: {error.strerror}"
    elif isinstance(error, RuntimeError) and str(error) == NO_HOME:
        status, line = BAD_INPUT, "~: this user has no home directory; set HOME, or write the whole path"
    else:
        status, line = DEFECT, describe_defect(error, arguments)
    print(f"twin-gait: {' '.join(line.split())}", file=sys.stderr)
    return status
