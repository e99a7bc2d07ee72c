"""Parse the command line, run a command, turn errors into one line."""

import argparse
import contextlib
import gc
import os
import shutil
import sys
import textwrap
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import shtab

from twin_gait import __version__
from twin_gait.cli import options, terminal
from twin_gait.exceptions import TwinGaitError

# Modules of this package by the group in which --help shows their commands.
GROUPS = {
    "run and look": ("simulate", "view", "sessions"),
    "gait tables": ("tables",),
    "test bench and identification": ("friction",),
    "the device": ("firmware",),
    "many runs": ("studies",),
}
# New objects until Python looks for cycles among them; its own 700 cost a twentieth of
# a command, most of it while modules are imported, of which nothing is ever thrown away.
COLLECT_AFTER = 50_000
NO_HOME = "Could not determine home directory."  # pathlib's words, which raises nothing more special

_ABOUT = "Gait simulation of the TWIN leg exoskeleton. Not a medical device."


class OneLineParser(argparse.ArgumentParser):
    """Parser whose errors are one line with the way out."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Add what every command takes; arguments are those of the base class."""
        super().__init__(*arguments, **options)
        # Without a default, because the parser of a sub-command would overwrite what stands before its name.
        self.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="show the trace of errors"
        )

    def add_argument(self, *arguments: Any, **options: Any) -> argparse.Action:
        """Add an argument; where a path is expected, shells complete the names of files and folders."""
        action = super().add_argument(*arguments, **options)
        if action.type is Path or action.metavar in ("FILE", "LOG", "TABLE"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        return action

    def error(self, message: str) -> NoReturn:
        """Print one line and leave with status 2."""
        self.exit(terminal.BAD_INPUT, f"twin-gait: {message}; see '{self.prog} --help'\n")


class ProgramParser(OneLineParser):
    """Parser of the program, whose help shows the commands in groups.

    Attributes:
        groups: Help of each command by group and name.
    """

    def __init__(self) -> None:
        """Add the options of the program and the commands of :data:`GROUPS`."""
        self.groups: dict[str, dict[str, str]] = {}
        indent = " " * len("usage: twin-gait ")
        shells = ",".join(shtab.SUPPORTED_SHELLS)
        super().__init__(
            prog="twin-gait",
            usage=f"%(prog)s [-h] [--debug] [--version]\n{indent}[--print-completion {{{shells}}}]\n"
            f"{indent}COMMAND ...",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.add_argument("--version", action="version", version=f"twin-gait {__version__}")
        shtab.add_argument_to(self, help="print the completion script of a shell")
        self._commands = self.add_subparsers(
            dest="command", required=True, parser_class=OneLineParser, metavar="COMMAND", prog=self.prog
        )
        for title, modules in GROUPS.items():
            self.groups[title] = {}
            for name in modules:
                import_module(f"twin_gait.cli.{name}").add_parser(self)

    def add_parser(self, name: str, *, help: str, **options: Any) -> argparse.ArgumentParser:
        """Add a command to the last group; parameters of the method of a sub-parsers action."""
        self.groups[next(reversed(self.groups))][name] = help
        return self._commands.add_parser(name, help=help, **options)

    def format_help(self) -> str:
        """Return the help with the commands in groups, then the options of the program itself."""
        width, listed = shutil.get_terminal_size().columns - 2, self._commands.help
        shown: list[str] = []
        for title, commands in self.groups.items():
            lines = [f"{title}:"]
            for name, text in commands.items():
                lines += textwrap.wrap(
                    text, width, initial_indent=f"  {name:<22}", subsequent_indent=" " * 24
                )
            shown.append("\n".join(lines))
        self.description = "\n\n".join([textwrap.fill(_ABOUT, width), *shown])
        self._commands.help = argparse.SUPPRESS
        try:
            return super().format_help()
        finally:
            self._commands.help = listed


def build_parser() -> ProgramParser:
    """Parser of all commands; heavy imports wait until a command runs, so that ``--help`` answers at once."""
    return ProgramParser()


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command with arguments without the program name, those of the process if None.

    Returns exit status: 0 done, 1 failed or diverged, 2 bad input, 70 an error that nobody foresaw, 130
    interrupted.
    """
    terminal.prepare_streams()
    terminal.warn_on_one_line()
    terminal.print_log()
    gc.set_threshold(COLLECT_AFTER)
    # Before NumPy is loaded: with two threads a fit takes half as long again, and twice the processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # matplotlib refuses to be imported with a backend that it does not have, and pictures are only written.
    os.environ["MPLBACKEND"] = "agg"
    arguments = build_parser().parse_args(argv)
    command: options.Command = arguments.run
    try:
        status = command(arguments)
        if arguments.command in ("simulate", "live") or getattr(arguments, "out", None) is not None:
            terminal.note_abandoned(arguments.out)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        print("twin-gait: interrupted", file=sys.stderr)
        return terminal.INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone (a pager that was closed): not an error of ours.
        terminal.discard_output()
        return terminal.DONE
    except terminal.OutputError as error:
        terminal.discard_output()
        with contextlib.suppress(OSError):  # standard error may be full too
            print(f"twin-gait: {error}", file=sys.stderr)
        return terminal.FAILED
    except Exception as error:
        if "debug" in arguments:
            traceback.print_exception(error)
        return _tell(error, sys.argv[1:] if argv is None else argv)


def _tell(error: Exception, arguments: Sequence[str]) -> int:
    """One line on an error, and the exit status."""
    status, line = terminal.BAD_INPUT, str(error)
    if isinstance(error, OSError) and error.filename is not None:  # a path that the system refuses
        line = f"{error.filename}: {error.strerror}"
    elif isinstance(error, RuntimeError) and line == NO_HOME:
        line = "~: this user has no home directory; set HOME, or write the whole path"
    elif not isinstance(error, TwinGaitError):
        status, line = terminal.DEFECT, _describe_defect(error, arguments)
    print(f"twin-gait: {' '.join(line.split())}", file=sys.stderr)
    return status


def _describe_defect(error: Exception, arguments: Sequence[str]) -> str:
    """Keep a report of an unforeseen error, and say in one line what happened and where the report is."""
    import platform
    import tempfile

    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="twin_gait_report_", suffix=".txt", delete=False, encoding="utf-8", errors="replace"
        ) as file:  # 0600: arguments may name people
            file.write(f"twin_gait {__version__}, Python {sys.version}, {platform.platform()}\n")
            file.write(f"arguments: {list(arguments)!r}\n\n")
            file.writelines(traceback.format_exception(error))
        kept = f"the report is in {file.name}"
    except OSError as problem:
        kept = f"no report could be kept ({problem.strerror})"
    return f"this should not have happened ({cause}); {kept}; --debug shows all"
