"""Parse the command line, run a command, turn errors into one line."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from twin_gait import __version__
from twin_gait.cli.terminal import BAD_INPUT, DONE, INTERRUPTED, warn_on_one_line
from twin_gait.exceptions import TwinGaitError


class OneLineParser(argparse.ArgumentParser):
    """Parser whose errors are one line with the way out."""

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
        compare,
        diagram,
        export,
        faults,
        identify,
        live,
        outcomes,
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

    runs = (simulate, live, sessions, view, export, presets)
    tables = (check, diagram, replay)
    studies = (compare, tune, reproduce, whatif, sweep, faults, outcomes, validate, benchmark)
    for module in (*runs, *tables, bench, identify, *studies):
        module.add_parser(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        argv: Arguments without the program name; those of the process if None.

    Returns:
        Exit status: 0 done, 1 failed or diverged, 2 bad input, 130 interrupted.
    """
    warn_on_one_line()
    arguments = build_parser().parse_args(argv)
    command: Callable[[argparse.Namespace], int] = arguments.run
    try:
        return command(arguments)
    except TwinGaitError as error:
        print(f"twin-gait: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("twin-gait: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone (a pager that was closed): not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
