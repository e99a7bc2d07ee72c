"""Program ``twin-gait``: parser of the command line, start of a command, and errors on one line."""

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

# Modules of this package, by the group under which --help lists their commands.
GROUPS = {
    "run and look": ("simulate", "view", "sessions"),
    "gait tables": ("tables",),
    "test bench and identification": ("friction",),
    "the device": ("device", "firmware"),
    "many runs": ("studies",),
}
# Number of new objects after which Python searches them for cycles. Its default of 700 takes 5 % of the
# time of a command, most of it during imports, although no imported module is ever freed.
COLLECT_AFTER = 50_000
NO_HOME = "Could not determine home directory."  # message of pathlib, which raises a plain RuntimeError

_ABOUT = "Gait simulation of the TWIN leg exoskeleton. Not a medical device."


class OneLineParser(argparse.ArgumentParser):
    """Parser whose errors are one line that names the help of the command."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Add the options that every command has; the arguments are those of the base class."""
        super().__init__(*arguments, **options)
        # There is no default, because the parser of a sub-command would overwrite a --debug before its name.
        self.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS, help="print the traceback of an error"
        )

    def add_argument(self, *arguments: Any, **options: Any) -> argparse.Action:
        """Add an argument; shells complete the names of files and folders if it is a path."""
        action = super().add_argument(*arguments, **options)
        if action.type is Path or action.metavar in ("FILE", "LOG", "TABLE"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        return action

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with status 2."""
        self.exit(terminal.BAD_INPUT, f"twin-gait: {message}; see '{self.prog} --help'\n")


class ProgramParser(OneLineParser):
    """Parser of the program; its help lists the commands in groups.

    Attributes:
        groups: Help text of each command, by group and by name.
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
        """Add a command to the last group; the parameters are those of a sub-parsers action's method."""
        self.groups[next(reversed(self.groups))][name] = help
        return self._commands.add_parser(name, help=help, **options)

    def format_help(self) -> str:
        """Return the help: the commands in groups, then the options of the program itself."""
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
    """Build the parser of all commands.

    Commands import heavy modules only when they run, so that ``--help`` is fast.
    """
    return ProgramParser()


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command with arguments without the program name; None takes the arguments of the process.

    Returns the exit status: 0 done, 1 failed or diverged, 2 bad input, 70 internal error, 130 interrupted.
    """
    terminal.prepare_streams()
    terminal.warn_on_one_line()
    terminal.print_log()
    gc.set_threshold(COLLECT_AFTER)
    # This must be set before NumPy is loaded. With two threads a fit takes 1.5 times as long, and twice the
    # processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Figures are only written to files, and matplotlib cannot be imported if the user's setting names a
    # backend that it does not have.
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
        # The process that reads the output has ended (such as a pager that was closed); this is not an error.
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
        return _report_error(error, sys.argv[1:] if argv is None else argv)


def _report_error(error: Exception, arguments: Sequence[str]) -> int:
    """Print one line on an error, and return the exit status."""
    status, line = terminal.BAD_INPUT, str(error)
    if isinstance(error, OSError) and error.filename is not None:  # a path that the system refuses
        line = f"{error.filename}: {error.strerror}"
    elif isinstance(error, RuntimeError) and line == NO_HOME:
        line = "~: this user has no home directory; set HOME, or give the whole path"
    elif not isinstance(error, TwinGaitError):
        status, line = terminal.DEFECT, _describe_defect(error, arguments)
    print(f"twin-gait: {' '.join(line.split())}", file=sys.stderr)
    return status


def _describe_defect(error: Exception, arguments: Sequence[str]) -> str:
    """Write a report of an internal error, and return one line with the cause and the path of the report."""
    import platform
    import tempfile

    cause = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    try:
        # The file has mode 0600, because arguments may contain names of people.
        with tempfile.NamedTemporaryFile(
            "w", prefix="twin_gait_report_", suffix=".txt", delete=False, encoding="utf-8", errors="replace"
        ) as file:
            file.write(f"twin_gait {__version__}, Python {sys.version}, {platform.platform()}\n")
            file.write(f"arguments: {list(arguments)!r}\n\n")
            file.writelines(traceback.format_exception(error))
        kept = f"the report is in {file.name}"
    except OSError as problem:
        kept = f"no report could be written ({problem.strerror})"
    return f"internal error ({cause}); {kept}; --debug prints the traceback"
