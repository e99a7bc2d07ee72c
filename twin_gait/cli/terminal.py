"""Functions that the commands share: exit statuses, printed results, the terminal, progress bars, Ctrl-C."""

import argparse
import io
import json
import logging
import os
import shlex
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin_gait.exceptions import TwinGaitError
from twin_gait.files import to_json_value

DONE, FAILED, BAD_INPUT, DEFECT, INTERRUPTED = 0, 1, 2, 70, 130
_STDERR = 2  # the last of the standard descriptors


def answer(arguments: argparse.Namespace, lines: Iterable[str], document: Any) -> None:
    """Print the result: lines for a person or, with ``--json``, one document for a program.

    Numbers of the document that are not finite become null.
    """
    if arguments.json:
        lines = [json.dumps(to_json_value(document), indent=2, ensure_ascii=False, allow_nan=False)]
    print("\n".join(lines))


class OutputError(TwinGaitError):
    """Error: standard output cannot be written."""


class _CheckedOutput(io.TextIOWrapper):
    """Standard output that raises :class:`OutputError`, unlike other files."""

    replaced: io.TextIOWrapper  # original stream; referenced, because its deletion closes the shared buffer

    def write(self, text: str, /) -> int:
        """Write a text; raise :class:`OutputError` if that is not possible."""
        with _output_errors():
            return super().write(text)

    def flush(self) -> None:
        """Write the content of the buffer; raise :class:`OutputError` if that is not possible."""
        with _output_errors():
            super().flush()


@contextmanager
def _output_errors() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        reason = f"cannot be written ({error.strerror}); written files are complete"
        raise OutputError(f"standard output: {reason}") from error


def prepare_streams() -> None:
    """Prepare standard streams for any terminal: a question mark replaces a letter that it cannot show."""
    _open_closed_streams()
    out = sys.stdout
    if type(out) is io.TextIOWrapper:
        sys.stdout = _CheckedOutput(out.buffer, out.encoding, "replace", line_buffering=out.line_buffering)
        sys.stdout.replaced = out
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="replace")


def _open_closed_streams() -> None:
    """Connect closed standard streams to the null device.

    Otherwise the next file that is opened gets one of their descriptors, and printed text is written to it.
    """
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= _STDERR:
        os.set_inheritable(descriptor, True)
        descriptor = os.open(os.devnull, os.O_RDWR)
    os.close(descriptor)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))


def discard_output() -> None:
    """Discard the rest of standard output: redirect it to the null device."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def note_abandoned(out: Path | None) -> None:
    """Print how to remove incomplete folders of killed runs next to ``out``, or in ``runs`` if it is None."""
    from twin_gait.runs.folders import find_abandoned_folders

    parent = Path("runs") if out is None else out.expanduser().absolute().parent
    found = find_abandoned_folders(parent)
    if found:
        left = f"{len(found)} incomplete folder{'s' * (len(found) > 1)} of killed runs in {parent}"
        way_out = f"list and remove them with: twin-gait sessions clean {shlex.quote(str(parent))}"
        print(f"twin-gait: {left}; {way_out}", file=sys.stderr)


@contextmanager
def stop_on_interrupt(*others: int) -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C, or one of other signals, into a request to stop; the second ends the program.

    Yields a function that returns whether the stop was requested.
    """
    requested = False

    def handle(number: int, frame: object) -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, *others)}
    try:
        yield lambda: requested
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def progress_bar(title: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on a terminal, nothing in a pipe; yield the function that updates it."""
    from tqdm import tqdm

    with tqdm(desc=title, unit=unit, leave=False, disable=not sys.stderr.isatty()) as bar:

        def update(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield update


@contextmanager
def work_callbacks(title: str, unit: str) -> Iterator[dict[str, Any]]:
    """Yield ``progress`` and ``should_stop``, the keyword arguments of every function that takes long."""
    with stop_on_interrupt() as should_stop, progress_bar(title, unit) as progress:
        yield {"progress": progress, "should_stop": should_stop}


def report_stop(hint: str, why: str = "interrupted", status: int = INTERRUPTED) -> int:
    """Print why the work ended early and how to go on; return the exit status."""
    print(f"twin-gait: {why}; {hint}", file=sys.stderr)
    return status


def note_line(line: str) -> None:
    """Replace the last note by a line, if standard error is a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)


def clear_line() -> None:
    """Clear the last note."""
    note_line("")


def warn_on_one_line() -> None:
    """Print each Python warning on one line and only once, even if a model is built several times."""
    shown: set[str] = set()

    def line(message: Warning | str, *_: object, **__: object) -> str:
        text = f"twin-gait: warning: {' '.join(str(message).split())}\n"
        if text in shown:
            return ""
        shown.add(text)
        return text

    warnings.formatwarning = line


class _LogHandler(logging.Handler):
    """Handler that prints messages of the package, such as compilations, on lines of standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message in place of the last note."""
        clear_line()
        print(f"twin-gait: {record.getMessage()}", file=sys.stderr, flush=True)


def print_log() -> None:
    """Print messages of the logger ``twin_gait``; a second call changes nothing."""
    logger = logging.getLogger("twin_gait")
    if not any(isinstance(handler, _LogHandler) for handler in logger.handlers):
        logger.addHandler(_LogHandler())


def note_compilation() -> None:
    """Print that the process of a live walk compiles the engine."""
    clear_line()
    print(
        "twin-gait: compiling the engine for this experiment; later runs reuse it",
        file=sys.stderr,
        flush=True,
    )
