"""A live walk in pieces, its journal, a stream of Arrow batches, and the run folder that becomes of it.

The loop keeps nothing of a walk but its last rows. Every half second it hands over a piece that is complete
in itself (rows, switches, changes, how the walk stands), so that the pieces up to any moment are the walk up
to it. Each is appended as one batch: the rows of the log as columns, the rest as the batch's own metadata.
The walk's set-up stands in the schema, so that the file is all that is needed to make the run folder, whoever
is left to do so; a batch that a kill has cut short is left out. Whoever writes or completes a journal holds a
lock on it, which the system takes back from the dead.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from pydantic import ConfigDict, TypeAdapter

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.control import Trip
from twin_gait.exceptions import RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.live.protocol import one_line
from twin_gait.live.session_records import KILLED, close_killed, list_sessions
from twin_gait.runs.folders import journal_of, staged_directory
from twin_gait.runs.record import RUN_DIRECTORY, SUMMARY_FILE, write_run
from twin_gait.simulation.engine import EngineResult, log_layout
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulator import run_of
from twin_gait.worlds.faults import parse_fault

CHANGES_FILE = "live_changes.csv"
CHANGE_COLUMNS = ("tick", "time_s", "user", "subject", "before", "value", "text")
# Drawing takes about a tenth of the walk; nobody waits minutes for the pictures of an hour.
LONGEST_PICTURES = 120.0  # [s]


class AppliedChange(NamedTuple):
    """A change as the run folder lists it."""

    tick: int  # first tick with the change
    # who, what, value before and after, by column; a fault in its notation under ``fault``
    note: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Piece:
    """What a walk has added since the piece before."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    rows: np.ndarray  # of the log, shape ``(n_ticks, n_columns)`` in the order of the layout
    switches: tuple[PhaseSwitch, ...] = ()  # of the phases
    changes: tuple[AppliedChange, ...] = ()  # that were applied
    status: RunStatus = RunStatus.COMPLETED  # how the walk stands
    reason: str = ""  # why it has ended; empty before that
    trip: Trip | None = None  # what the safety monitor tripped on, or None
    wall_s: float = 0.0  # time since the start of the walk in [s], pauses included
    over: bool = False  # whether it is the last one


_PIECE = TypeAdapter(Piece)
_SETUP, _NEWS = b"twin_gait.setup", b"twin_gait.news"


def walk_of(pieces: Iterable[Piece], n_columns: int, longest: int) -> Piece:
    """Put the pieces of a walk together to one that is all of it.

    A walk that nothing has ended before its time is marked as interrupted, with the reason.
    """
    last = Piece(rows=np.zeros((0, n_columns)))
    rows, switches, changes = [last.rows], list[PhaseSwitch](), list[AppliedChange]()
    for piece in pieces:
        rows.append(piece.rows)
        switches += piece.switches
        changes += piece.changes
        last = piece
    log, status, reason = np.concatenate(rows), last.status, last.reason
    if status is RunStatus.COMPLETED and len(log) < longest:
        status = RunStatus.INTERRUPTED
        how = "stopped at" if last.over else "the process of the walk died; it is kept up to"
        reason = f"{how} {len(log) * TICK:.3f} s"
    whole: dict[str, Any] = {"rows": log, "switches": tuple(switches), "changes": tuple(changes)}
    return replace(last, **whole, status=status, reason=reason)


def next_free(folder: Path, number: int) -> Path:
    """Folder of a later walk: the first name ``folder-number`` … that no folder and no journal has yet."""
    names = (folder.with_name(f"{folder.name}-{count}") for count in itertools.count(number))
    return next(path for path in names if not path.exists() and not journal_of(path).exists())


@contextlib.contextmanager
def locked(journal: Path, *, make: bool = False) -> Iterator[None]:
    """Hold a journal, so that nobody else writes or completes it.

    ``make``: whether it is to be made; nobody but this user may read it. Raises RunDirectoryError if it
    cannot be opened, has gone, or is held.
    """
    flags = os.O_RDWR | (os.O_CREAT | os.O_EXCL if make else 0)
    try:
        if make:
            journal.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(journal, flags, 0o600)
    except OSError as error:
        raise RunDirectoryError(f"{journal}: cannot be used ({error.strerror})") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not journal.exists():  # completed by somebody between our opening and our holding it
            raise RunDirectoryError(f"{journal}: has just been completed")
        yield
    except BlockingIOError:
        raise RunDirectoryError(f"{journal}: its walk is still going on, or being written") from None
    finally:
        os.close(descriptor)


class Journals:
    """Keeps the walks of a session, a file each, in a thread of its own: the loop never waits for the disk.

    Attributes:
        paths: The files so far.
    """

    def __init__(
        self, columns: Sequence[str], setup: Mapping[str, Any], tell: Callable[[Mapping[str, Any]], None]
    ) -> None:
        """Make the file of the first walk, and its folder if there is none.

        ``setup``: what the run folder needs beside the log, as JSON takes it; ``tell``: takes a mapping for
        each walk that is begun (``kind`` ``journal`` with ``folder``), and once if nothing can be written any
        more (``unkept`` with ``text``). Raises RunDirectoryError if the file cannot be made.
        """
        self.paths: list[Path] = []
        self._columns, self._setup, self._tell = columns, setup, tell
        self._held, self._lost = contextlib.ExitStack(), False
        self._stream: Any = None  # of the present walk
        self._begin(Path(setup["folder"]))
        self._thread = ThreadPoolExecutor(1, "journal")

    def keep(self, piece: Piece) -> None:
        """Take a piece, which may be the last of its walk; returns at once."""
        # What the writer does not expect is an error of the program: it is printed, not lost.
        self._thread.submit(self._write, piece).add_done_callback(Future.result)

    def close(self) -> None:
        """Wait until all pieces are written."""
        self._thread.shutdown()

    def _begin(self, folder: Path) -> None:
        path, setup = journal_of(folder), {**self._setup, "folder": str(folder)}
        columns, metadata = [(name, pa.float64()) for name in self._columns], {_SETUP: json.dumps(setup)}
        options = pa.ipc.IpcWriteOptions(compression="zstd", use_threads=False)
        self.paths.append(path)
        self._held.enter_context(locked(path, make=True))
        file = self._held.enter_context(pa.OSFile(str(path), "wb"))
        stream = pa.ipc.new_stream(file, pa.schema(columns, metadata=metadata), options=options)
        self._stream = self._held.enter_context(stream)
        self._tell({"kind": "journal", "folder": str(folder)})

    def _write(self, piece: Piece) -> None:
        """Write a piece to the file of its walk, which its first piece begins.

        What cannot be written any more is told once; the session goes on without it.
        """
        if self._lost:
            return
        try:
            if self._stream is None:
                self._begin(next_free(Path(self._setup["folder"]), len(self.paths) + 1))
            columns = [pa.array(column) for column in np.ascontiguousarray(piece.rows.T)]
            batch = pa.RecordBatch.from_arrays(columns, names=list(self._columns))
            news = _PIECE.dump_json(piece, exclude={"rows"})
            self._stream.write_batch(batch, custom_metadata={_NEWS: news})
            if piece.over:
                self._stream = None
                self._held.close()
        except (OSError, pa.ArrowException, RunDirectoryError) as error:
            text = f"{self.paths[-1]}: cannot be written any more ({one_line(error)})"
            self._tell({"kind": "unkept", "text": text})
            self._lost = True
            with contextlib.suppress(OSError, pa.ArrowException):
                self._held.close()


def read_journal(path: Path) -> tuple[dict[str, Any], tuple[str, ...], Iterator[Piece]]:
    """Read a journal, whatever has become of its writer.

    Returns the set-up, the columns of the log, and the pieces up to the last complete one. Raises
    RunDirectoryError if not even its beginning can be read.
    """
    try:
        stream = pa.ipc.open_stream(pa.OSFile(str(path), "rb"))
        setup = json.loads(stream.schema.metadata[_SETUP])
    except (OSError, pa.ArrowException, ValueError, KeyError, TypeError) as error:
        raise RunDirectoryError(f"{path}: is no journal of a walk ({one_line(error)})") from error
    return setup, tuple(stream.schema.names), _pieces(stream)


def _pieces(stream: Any) -> Iterator[Piece]:
    while True:
        try:
            batch, metadata = stream.read_next_batch_with_custom_metadata()
        except (StopIteration, OSError, pa.ArrowException):  # the end, or where the writer was killed
            return
        rows = np.column_stack([column.to_numpy() for column in batch.columns])
        yield _PIECE.validate_python({**json.loads(metadata[_NEWS]), "rows": rows})


def complete(
    journal: Path, *, pictures: bool = False, on_step: Callable[[str], None] | None = None
) -> Path | None:
    """Make the run folder of a walk out of its journal, which then goes.

    ``journal``: the file; its walk has ended or its process is dead; ``pictures``: whether to draw figures
    and animation of a walk that is short; ``on_step``: called with the name of each file before it is
    written. Returns the folder, or None if not one tick had been walked. Raises RunDirectoryError if the
    journal cannot be read or is still being written, or the folder cannot be made.
    """
    with locked(journal):
        setup, columns, pieces = read_journal(journal)
        problem = build_problem(experiment_from_mapping(setup["document"], "experiment", Path()))
        if columns != log_layout(problem).names:
            raise RunDirectoryError(
                f"{journal}: its log has other columns than this version writes; use the version that made it"
            )
        walk = walk_of(pieces, len(columns), problem.experiment.n_ticks)
        folder = Path(setup["folder"])
        if folder.exists() and not setup["force"]:  # somebody else's; what was walked is not lost for it
            folder = next_free(folder, 2)
        if len(walk.rows):
            run = walked_run(walk, problem)
            drawn = pictures and run.duration <= LONGEST_PICTURES
            with staged_directory(folder, RUN_DIRECTORY, force=setup["force"]) as staging:
                write_atomically(staging / CHANGES_FILE, _changes_table(walk.changes))
                document = {**setup["document"], "duration_s": run.duration}
                write_run(run, staging, document=document, pictures=drawn, on_step=on_step)
        journal.unlink()
    return folder if len(walk.rows) else None


def _changes_table(changes: Iterable[AppliedChange]) -> str:
    rows = [{**item.note, "tick": item.tick, "time_s": f"{item.tick * TICK:.3f}"} for item in changes]
    table = pd.DataFrame(rows, columns=CHANGE_COLUMNS, dtype=object)
    return str(table.to_csv(index=False, lineterminator="\n"))


def walked_run(walk: Piece, problem: Problem) -> Run:
    """A live walk as a run like any other; faults injected from a page are faults of its experiment.

    Returns the run, as long as it was walked.
    """
    experiment, ticks = problem.experiment, len(walk.rows)
    injected = [
        replace(parse_fault(change.note["fault"]), time=change.tick * TICK)
        for change in walk.changes
        if "fault" in change.note and change.tick < ticks
    ]
    faults = (*(item for item in experiment.faults if item.time < ticks * TICK), *injected)
    walked = replace(problem, experiment=replace(experiment, duration=round(ticks * TICK, 3), faults=faults))
    result = EngineResult(walk.rows, walk.switches, walk.status, walk.reason, walk.trip)
    return run_of(walked, result, walk.wall_s)


def summary_of(folder: Path) -> dict[str, Any]:
    """Summary of a run folder."""
    return dict(json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8")))


def recover(records: Path) -> Iterator[str]:
    """Complete the run folders of all sessions that were killed, and close those sessions in the record.

    Yields one sentence for each session, as the record has it from then on. Raises SessionError if the record
    cannot be used.
    """
    for entry in list_sessions(records):
        if entry["status"] == KILLED and entry["ended"] is None:
            try:
                yield f"session {entry['id']}: {_recover(records, entry)}"
            except RunDirectoryError as error:  # it may be going on after all: its journal is held
                yield f"session {entry['id']} cannot be completed: {error}"


def _recover(records: Path, entry: Mapping[str, Any]) -> str:
    folders = []
    for folder in map(Path, entry["folders"]):
        done = complete(journal_of(folder)) if journal_of(folder).exists() else None
        folders.append(done or folder)
    there = [folder for folder in folders if (folder / SUMMARY_FILE).is_file()]
    summary = summary_of(there[-1]) if there else {}
    tick = round(summary.get("duration_s", entry["tick"] * TICK) / TICK)
    kept = f"the walk is kept up to {tick * TICK:.3f} s, in {there[-1]}" if there else "no run is left of it"
    text = f"its processes were killed; {kept}"
    close_killed(records, entry["id"], tick=tick, text=text, summary=summary, folders=there)
    return text
