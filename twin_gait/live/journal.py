"""A live walk in pieces, and its journal: a stream of Arrow batches beside the run folder to come.

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
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from twin_gait.control import Trip, TripCause
from twin_gait.exceptions import RunDirectoryError
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.runs.folders import journal_of
from twin_gait.simulation.run import RunStatus
from twin_gait.vocabulary import JointName, Side


@dataclass(frozen=True)
class AppliedChange:
    """A change as the run folder lists it."""

    tick: int  # first tick with the change
    # who, what, value before and after, by column; a fault in its notation under ``fault``
    note: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Piece:
    """What a walk has added since the piece before."""

    rows: np.ndarray  # of the log, shape ``(n_ticks, n_columns)`` in the order of the layout
    switches: tuple[PhaseSwitch, ...] = ()  # of the phases
    changes: tuple[AppliedChange, ...] = ()  # that were applied
    # mapping of the gait table as it is now, or None if it has never been changed
    table: Mapping[str, Any] | None = None
    status: RunStatus = RunStatus.COMPLETED  # how the walk stands
    reason: str = ""  # why it has ended; empty before that
    trip: Trip | None = None  # what the safety monitor tripped on, or None
    wall_s: float = 0.0  # time since the start of the walk in [s], pauses included
    over: bool = False  # whether it is the last one

    def to_dict(self) -> dict[str, Any]:
        """Everything but the rows, as JSON takes it."""
        changes = [[item.tick, dict(item.note)] for item in self.changes]
        entries = {key: value for key, value in vars(self).items() if key != "rows"}
        return {**entries, "changes": changes, "status": str(self.status)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], rows: np.ndarray) -> Piece:
        """The piece of :meth:`to_dict` with its rows."""
        made: dict[str, Any] = {
            "switches": tuple(PhaseSwitch(item[0], Side(item[1]), *item[2:]) for item in data["switches"]),
            "changes": tuple(AppliedChange(tick, note) for tick, note in data["changes"]),
            "status": RunStatus(data["status"]),
        }
        if data["trip"] is not None:
            tick, cause, side, joint = data["trip"]
            place = side and Side(side), joint and JointName(joint)
            made["trip"] = Trip(tick, TripCause(cause), *place)
        return cls(rows=rows, **{**data, **made})


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


_SETUP, _NEWS = b"twin_gait.setup", b"twin_gait.news"


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


class Journal:
    """Writes one walk in a thread of its own: the loop never waits for the disk.

    Attributes:
        path: The file.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        setup: Mapping[str, Any],
        *,
        on_failure: Callable[[str], None],
    ) -> None:
        """Make the file, and its folder if there is none.

        ``setup``: what the run folder needs beside the log, as JSON takes it; ``on_failure``: called once,
        from the thread, if it cannot be written any more. Raises RunDirectoryError if it cannot be made.
        """
        self.path = path
        self._on_failure = on_failure
        self._pieces: queue.SimpleQueue[Piece] = queue.SimpleQueue()
        self._held = contextlib.ExitStack()
        self._held.enter_context(locked(path, make=True))
        metadata = {_SETUP: json.dumps(dict(setup)).encode()}
        self._schema = pa.schema([(name, pa.float64()) for name in columns], metadata=metadata)
        self._thread = threading.Thread(target=self._write, name="journal", daemon=True)
        self._thread.start()

    def keep(self, piece: Piece) -> None:
        """Take a piece, which may be the last; returns at once."""
        self._pieces.put(piece)

    def join(self) -> None:
        """Wait until the last piece is written and the file let go."""
        self._thread.join()

    def _write(self) -> None:
        options = pa.ipc.IpcWriteOptions(compression="zstd", use_threads=False)
        try:
            with (
                self._held,
                pa.OSFile(str(self.path), "wb") as file,
                pa.ipc.new_stream(file, self._schema, options=options) as stream,
            ):
                over = False
                while not over:
                    piece = self._pieces.get()
                    news = json.dumps(piece.to_dict()).encode()
                    stream.write_batch(self._batch(piece.rows), custom_metadata={_NEWS: news})
                    over = piece.over
        except (OSError, pa.ArrowException) as error:
            self._on_failure(f"{self.path}: cannot be written any more ({' '.join(str(error).split())})")

    def _batch(self, rows: np.ndarray) -> pa.RecordBatch:
        columns = [pa.array(column) for column in np.ascontiguousarray(rows.T)]
        return pa.RecordBatch.from_arrays(columns, schema=self._schema)


class Content(NamedTuple):
    """What a journal holds."""

    setup: dict[str, Any]  # from Journal
    columns: tuple[str, ...]  # of the log
    pieces: Iterator[Piece]  # one after the other, those up to the last complete one


def read_journal(path: Path) -> Content:
    """Read a journal, whatever has become of its writer.

    Raises RunDirectoryError if not even its beginning can be read.
    """
    try:
        stream = pa.ipc.open_stream(pa.OSFile(str(path), "rb"))
        setup = json.loads(stream.schema.metadata[_SETUP])
    except (OSError, pa.ArrowException, ValueError, KeyError, TypeError) as error:
        raise RunDirectoryError(
            f"{path}: is no journal of a walk ({' '.join(str(error).split())})"
        ) from error
    return Content(setup, tuple(stream.schema.names), _pieces(stream))


def _pieces(stream: Any) -> Iterator[Piece]:
    while True:
        try:
            batch, metadata = stream.read_next_batch_with_custom_metadata()
        except (StopIteration, OSError, pa.ArrowException):  # the end, or where the writer was killed
            return
        rows = np.column_stack([column.to_numpy() for column in batch.columns])
        yield Piece.from_dict(json.loads(metadata[_NEWS]), rows)
