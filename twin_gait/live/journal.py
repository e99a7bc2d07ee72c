"""Journal of live walks, a stream of Arrow batches, and the run directories that are made from it.

The loop stores only the last rows of a walk. After every block it passes on a chunk that is complete in
itself (rows, switches, events, state of the walk), so that the chunks up to any time are the walk up to that
time. The chunks of half a second are one batch: the rows of the log as columns, the rest as its metadata. The
schema contains the set-up, so that the file is sufficient to make the run directories, by any process; a
batch that was truncated by a kill is ignored. The process that writes or completes a journal holds a lock on
it, which the system releases if the process dies.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pydantic import ConfigDict, TypeAdapter

from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.control.safety import Trip
from twin_gait.exceptions import RunDirectoryError
from twin_gait.experiment.experiment import Experiment
from twin_gait.files import require_regular, to_json_value
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.live.protocol import one_line
from twin_gait.live.session_records import SessionError, add_folders
from twin_gait.runs.folders import journal_path, staged_directory, try_lock
from twin_gait.runs.record import RUN_DIRECTORY, write_run
from twin_gait.simulation.log import LogArrays, log_layout
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.worlds.faults import parse_fault

BATCH_TICKS = 500  # ticks of a batch: a kill loses at most one batch and the data that wait to be written
# Drawing takes about a tenth of the duration of the walk, which would be minutes for an hour.
LONGEST_PICTURES = 120.0  # [s], longest walk that is drawn


@dataclass(frozen=True, kw_only=True)
class LogChunk:
    """Chunk of a walk since the previous chunk."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    rows: np.ndarray  # rows of the log, shape ``(n_ticks, n_columns)`` in the order of the layout
    switches: tuple[PhaseSwitch, ...] = ()  # switches of the phases
    events: tuple[Mapping[str, Any], ...] = ()  # events in the form of an experiment file
    status: RunStatus = RunStatus.COMPLETED  # status of the walk
    reason: str = ""  # reason why the walk has ended; empty before its end
    trip: Trip | None = None  # trip of the safety monitor, or None
    wall_s: float = 0.0  # time since the start of the walk in [s], including pauses
    is_last: bool = False  # whether this is the last chunk of the walk


_CHUNK_ADAPTER = TypeAdapter(LogChunk)
_SETUP, _CHUNK_KEY = b"twin_gait.setup", b"twin_gait.chunk"


def join_chunks(chunks: Sequence[LogChunk]) -> LogChunk:
    """Join several chunks into one."""
    return replace(
        chunks[-1],
        rows=np.concatenate([piece.rows for piece in chunks]),
        switches=tuple(item for piece in chunks for item in piece.switches),
        events=tuple(item for piece in chunks for item in piece.events),
    )


def split_walks(chunks: Iterable[LogChunk], max_ticks: int) -> Iterator[LogChunk]:
    """Join chunks, and yield one chunk for every walk with at least one tick.

    A walk that is shorter than ``max_ticks`` in ticks without having ended is marked as interrupted, with the
    reason.
    """
    parts: list[list[LogChunk]] = [[]]
    for piece in chunks:
        parts[-1].append(piece)
        if piece.is_last:
            parts.append([])
    for walk in (join_chunks(part) for part in parts if part):
        ticks = len(walk.rows)
        if ticks and walk.status is RunStatus.COMPLETED and ticks < max_ticks:
            cause = (
                "stopped at"
                if walk.is_last
                else "the process of the walk ended, or could not write; the walk is saved up to"
            )
            yield replace(walk, status=RunStatus.INTERRUPTED, reason=f"{cause} {ticks * TICK:.3f} s")
        elif ticks:
            yield walk


@contextlib.contextmanager
def lock_journal(journal: Path) -> Iterator[None]:
    """Lock a journal, so that no other process writes or completes it.

    Raises RunDirectoryError if it cannot be opened, or if it is locked.
    """
    try:
        held = try_lock(journal)
    except OSError as error:
        raise RunDirectoryError(f"{journal}: cannot be used ({error.strerror})") from error
    if held is None:
        raise RunDirectoryError(f"{journal}: its walk is still running, or is being written")
    try:
        yield
    finally:
        os.close(held)


class Journal:
    """Writer of the walks of a session, in its own thread, so that the loop never waits for the disk.

    Attributes:
        path: Path of the journal.
    """

    def __init__(
        self, columns: Sequence[str], setup: Mapping[str, Any], on_write_error: Callable[[str], None]
    ) -> None:
        """Create the file, readable by this user only, and its folder if it does not exist.

        ``setup``: data of the run directories in addition to the log, as values for JSON;
        ``on_write_error``: called once if nothing can be written any more, with the reason. Raises
        RunDirectoryError if the file cannot be created.
        """
        self.path = journal_path(Path(setup["folder"]))
        self._columns, self._on_write_error = list(columns), on_write_error
        self._resources = contextlib.ExitStack()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.touch(mode=0o600, exist_ok=False)
        except OSError as error:
            raise RunDirectoryError(f"{self.path}: cannot be created ({error.strerror})") from error
        schema = pa.schema([(name, pa.float64()) for name in columns], metadata={_SETUP: json.dumps(setup)})
        options = pa.ipc.IpcWriteOptions(compression="zstd", use_threads=False)
        self._resources.enter_context(lock_journal(self.path))
        file = self._resources.enter_context(pa.OSFile(str(self.path), "wb"))
        self._stream: Any = self._resources.enter_context(pa.ipc.new_stream(file, schema, options=options))
        self._waiting: list[LogChunk] = []
        self._thread = ThreadPoolExecutor(1, "journal")

    def store(self, chunk: LogChunk) -> None:
        """Store a chunk; the call returns immediately."""
        # An unexpected error in the writer is an internal error, which is printed.
        self._thread.submit(self._write, chunk).add_done_callback(Future.result)

    def close(self) -> None:
        """Wait until all chunks are written, and release the file."""
        self._thread.shutdown()
        with contextlib.suppress(OSError, pa.ArrowException):
            self._resources.close()

    def _write(self, chunk: LogChunk) -> None:
        """Write the waiting chunks if they are a batch, or if simulated time has stopped.

        If nothing can be written any more, ``lost`` is called once, and the session continues.
        """
        if self._stream is None:
            return
        self._waiting.append(chunk)
        if (
            len(chunk.rows)
            and not chunk.is_last
            and sum(len(item.rows) for item in self._waiting) < BATCH_TICKS
        ):
            return
        whole, self._waiting = join_chunks(self._waiting), []
        try:
            columns = [pa.array(column) for column in np.ascontiguousarray(whole.rows.T)]
            batch = pa.RecordBatch.from_arrays(columns, names=self._columns)
            metadata = _CHUNK_ADAPTER.dump_json(whole, exclude={"rows"})
            self._stream.write_batch(batch, custom_metadata={_CHUNK_KEY: metadata})
        except (OSError, pa.ArrowException) as error:
            self._stream = None
            self._on_write_error(f"{self.path}: can no longer be written ({one_line(error)})")


def read_journal(path: Path) -> tuple[dict[str, Any], tuple[str, ...], Iterator[LogChunk]]:
    """Read a journal, even if its writer was killed.

    Returns the set-up, the columns of the log, and the chunks up to the last complete one. Raises
    RunDirectoryError if the header of the file cannot be read.
    """
    try:
        require_regular(path)
        stream = pa.ipc.open_stream(pa.OSFile(str(path), "rb"))
        setup = json.loads(stream.schema.metadata[_SETUP])
    except (OSError, pa.ArrowException, ValueError, KeyError, TypeError) as error:
        raise RunDirectoryError(f"{path}: is not a journal of a walk ({one_line(error)})") from error
    return setup, tuple(stream.schema.names), _read_chunks(stream)


def _read_chunks(stream: Any) -> Iterator[LogChunk]:
    while True:
        try:
            batch, metadata = stream.read_next_batch_with_custom_metadata()
        except (StopIteration, OSError, pa.ArrowException):  # end of the file, or a kill of the writer
            return
        rows = np.column_stack([column.to_numpy() for column in batch.columns])
        yield _CHUNK_ADAPTER.validate_python({**json.loads(metadata[_CHUNK_KEY]), "rows": rows})


def complete(journal: Path, *, pictures: bool = False) -> dict[Path, dict[str, Any]]:
    """Make the run directories of walks from their journal, delete it, and list them in the record.

    ``journal``: the file, whose walk has ended or whose process is dead; ``pictures``: whether to draw
    figures and animation of the last walk, if it is short. Returns the summaries by run directory. Raises
    RunDirectoryError if the journal cannot be read or is still being written, or if a run directory cannot be
    made.
    """
    with lock_journal(journal):
        setup, walks = read_walks(journal)
        done = dict[Path, dict[str, Any]]()
        for (run, document), folder in zip(
            walks, _names(Path(setup["folder"]), setup["force"]), strict=False
        ):
            drawn = pictures and run is walks[-1][0] and run.duration <= LONGEST_PICTURES
            with staged_directory(folder, RUN_DIRECTORY, force=setup["force"]) as staging:
                done[folder] = to_json_value(write_run(run, staging, document=document, pictures=drawn))
        journal.unlink()
    if setup.get("records") is not None:
        with contextlib.suppress(SessionError):  # the run directories are more important than their list
            add_folders(Path(setup["records"]), Path(setup["folder"]), done)
    return done


def read_walks(journal: Path) -> tuple[dict[str, Any], list[tuple[Run, dict[str, Any]]]]:
    """Read the walks of a journal, also of one that is still being written, up to its last complete chunk.

    Returns the set-up, and each walk as a run with the experiment file that reproduces it. Raises
    RunDirectoryError if the journal cannot be read.
    """
    setup, columns, pieces = read_journal(journal)
    experiment = experiment_from_mapping(setup["document"], "experiment", Path())
    # The columns of the log do not depend on a user's controller, whose module may have been deleted.
    simulation_setup = replace(build_setup(replace(experiment, controller=None)), experiment=experiment)
    if columns != log_layout(simulation_setup).names:
        raise RunDirectoryError(
            f"{journal}: its log has other columns than this version; use the version that wrote it"
        )
    walks = []
    for walk in split_walks(pieces, experiment.n_ticks):
        document = walked_document(walk, setup["document"])
        walked = experiment_from_mapping(document, "experiment", Path())
        walks.append((walked_run(walk, simulation_setup, walked), document))
    return setup, walks


def _names(folder: Path, force: bool) -> Iterator[Path]:
    """Yield the free run directories of the walks of a session: ``folder``, then ``folder-2`` …."""
    if force or not folder.exists():  # otherwise it belongs to another run, and the walk gets another name
        yield folder
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in itertools.count(2))
    yield from (path for path in numbered if not path.exists())


def walked_document(walk: LogChunk, document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the experiment file that reproduces a live walk, with all changes of the walk as events.

    ``document``: experiment file of the session. Faults and events after the last tick are omitted.
    """
    duration = round(len(walk.rows) * TICK, 3)
    events = [item for item in walk.events if item["time_s"] < duration]
    faults = [text for text in document.get("faults") or () if parse_fault(text).time < duration]
    more = {"duration_s": duration, "faults": faults, "events": events}
    return {**document, **{key: value for key, value in more.items() if value or key in document}}


def walked_run(walk: LogChunk, simulation_setup: SimulationSetup, experiment: Experiment) -> Run:
    """Return a live walk as a run of an experiment that is as long as the walk."""
    names, weight = log_layout(simulation_setup).names, simulation_setup.world.body_weight
    table, own_table = simulation_setup.table, simulation_setup.own_table
    log = LogArrays(walk.rows.T, names, table.phase_names, simulation_setup.own_phase_names)
    ended = {name: getattr(walk, name) for name in ("switches", "status", "reason", "wall_s", "trip")}
    return Run(experiment=experiment, table=table, own_table=own_table, log=log, body_weight=weight, **ended)
