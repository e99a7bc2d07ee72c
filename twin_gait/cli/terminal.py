"""What the commands share: exit statuses, the terminal, progress bars, Ctrl-C."""

from __future__ import annotations

import io
import shlex
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

DONE, FAILED, BAD_INPUT, DEFECT, INTERRUPTED = 0, 1, 2, 70, 130


def write_on_any_terminal() -> None:
    """Print on terminals that know no ° or σ too: what they cannot show becomes a question mark."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def note_abandoned(out: Path | None) -> None:
    """Offer to remove what killed runs have left where this one was written.

    Args:
        out: What was written; None stands for a folder in runs.
    """
    from twin_gait.runs.folders import abandoned

    parent = Path("runs") if out is None else out.expanduser().absolute().parent
    found = abandoned(parent)
    if found:
        print(
            f"twin-gait: {len(found)} incomplete {'folder' if len(found) == 1 else 'folders'} of killed runs "
            f"in {parent}; see them and remove them with: twin-gait clean {shlex.quote(str(parent))}",
            file=sys.stderr,
        )


@contextmanager
def stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a request to stop; a second one ends the program at once."""
    asked = False

    def handle(number: int, frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    previous = signal.signal(signal.SIGINT, handle)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, previous)


@contextmanager
def progress_bar(title: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Progress bar on a terminal, nothing in a pipe."""
    from tqdm import tqdm

    with tqdm(desc=title, unit=unit, leave=False, disable=not sys.stderr.isatty()) as bar:

        def update(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield update


def note_step(name: str, doing: str = "writing") -> None:
    """Say on a terminal what is being done, such as which file is being written."""
    if sys.stderr.isatty():
        print(f"\r\033[K{doing} {name}", end="", file=sys.stderr, flush=True)


def warn_on_one_line() -> None:
    """Print warnings of Python on one line, each once, however often a model is built."""
    shown: set[str] = set()

    def line(message: Warning | str, *_: object, **__: object) -> str:
        text = f"twin-gait: warning: {' '.join(str(message).split())}\n"
        if text in shown:
            return ""
        shown.add(text)
        return text

    warnings.formatwarning = line


def note_compilation() -> None:
    """Say why the first run on a machine takes its time."""
    print(
        "compiling the engine for this model, once on this machine (10 to 20 s) …",
        file=sys.stderr,
        flush=True,
    )


def clear_line() -> None:
    """Take the last note away again."""
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)
