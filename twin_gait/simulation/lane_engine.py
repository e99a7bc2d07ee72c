"""Engine that runs episodes of one pattern in lockstep, with the same results as separate runs.

A block has up to :data:`WIDTH` interleaved records, and the loop of the compiled engine, compiled for the
block, advances all of them by a tick. An episode that has ended leaves the block, and its lane repeats a
running one, which does not change any result. If few episodes are left, they run one by one.
"""

import time
from collections.abc import Hashable, Sequence

import numpy as np

from twin_gait.simulation.block import WIDTH, interleave, number_index, shared_words
from twin_gait.simulation.code_cache import CompiledLoop, Loop, OnCompile, cached_loop, is_cached, source_key
from twin_gait.simulation.compiled_engine import CompiledEngine, loop_names, run_ticks_at
from twin_gait.simulation.engine import EpisodeEngine
from twin_gait.simulation.episode import COMPLETED
from twin_gait.simulation.run import Run
from twin_gait.simulation.schedule import LANE_DRIVERS

# Fewest episodes of a block. Fewer episodes are slower in a block than alone: the break-even point is 8 to 11
# episodes with AVX-512 and 13 to 19 with AVX2.
MIN_BLOCK_SIZE = 16
_CHUNK_TICKS = 128  # Ticks whose interleaved rows are buffered before a copy.


class LaneEngine:
    """Engine that runs the episodes of several compiled engines together from start to end."""

    def __init__(self, engines: Sequence[CompiledEngine]) -> None:
        """Interleave the records and load or compile the loop.

        ``engines``: at most :data:`WIDTH` engines at tick 0 with the same :func:`block_key`.
        """
        assert len({block_key(engine) for engine in engines}) == 1
        self.engines = engines
        self._loop = lane_loop(engines[0])
        self._block = interleave([engine.store for engine in engines])
        # Views of the block, because the position of a number is slow to find.
        self._status, self._first_row = self._numbers("episode.status"), self._numbers("recording.first_row")
        self._totals = np.array([engine.setup.experiment.n_ticks for engine in engines])
        self._ends = np.zeros_like(self._totals)

    def run(self, columns: Sequence[int] | None = None) -> list[Run]:
        """Run all episodes to their ends; each run equals the result of :meth:`CompiledEngine.run`.

        ``columns``: positions of the columns of the log that are kept; all by default.
        """
        began = time.perf_counter()
        width, record = len(self.engines[0].layout.names), bool(self._numbers("recording.on")[0])
        kept = range(width) if columns is None else columns
        logs = np.empty((len(self.engines), len(kept), int(self._totals.max()) if record else 0))
        rows = np.zeros((_CHUNK_TICKS if record else 1, width, WIDTH))
        self._numbers("recording.log")[:] = rows.ctypes.data
        running, done = np.arange(len(self.engines)), 0
        while len(running) >= MIN_BLOCK_SIZE:
            end = int(self._totals[running].min())
            begin, done = done, self._run_ticks(done, min(end, done + _CHUNK_TICKS) if record else end)
            if record:
                # The lane of an ended episode is copied too; its log ends before these ticks. Columns are
                # copied one by one, because a column of all lanes fits into the first cache.
                part = rows[: done - begin, :, : len(logs)]
                for index, column in enumerate(kept):
                    logs[:, index, begin:done] = part[:, column].T
            running = self._take_out(running, done)
        for lane in running.tolist():
            self._finish(lane, done, logs[lane], kept)
        share = (time.perf_counter() - began) / len(self.engines)
        return [
            engine.build_run(end, log, columns, share)
            for engine, end, log in zip(self.engines, self._ends.tolist(), logs, strict=True)
        ]

    def _run_ticks(self, first: int, end: int) -> int:
        """Run ticks ``first`` to ``end`` - 1, fewer if an episode ends; their rows begin at row 0."""
        self._first_row[:] = first
        return self._loop(self._block.ctypes.data, first, end)

    def _take_out(self, running: np.ndarray, done: int) -> np.ndarray:
        """Copy the records of ended lanes to their engines, or all if few are left; return running lanes."""
        over = (self._status[running] != COMPLETED) | (self._totals[running] == done)
        if not over.any():
            return running
        self._ends[running[over]] = done
        left: np.ndarray = running[~over]
        for lane in (running if len(left) < MIN_BLOCK_SIZE else running[over]).tolist():
            self.engines[lane].store.view(np.int64)[:] = self._block[:, lane]
        if len(left) > 0:
            self._block[:, np.setdiff1d(np.arange(WIDTH), left)] = self._block[:, left[:1]]
        return left

    def _finish(self, lane: int, done: int, log: np.ndarray, kept: Sequence[int]) -> None:
        engine, total = self.engines[lane], int(self._totals[lane])
        rows = np.zeros((max(total - done, 1), len(engine.layout.names)))
        end = engine.run_ticks(done, total, rows, done)
        if log.shape[1] > 0:
            log[:, done:end] = rows[: end - done, kept].T
        self._ends[lane] = end

    def _numbers(self, name: str) -> np.ndarray:
        """Return an integer of the record in all lanes, shape ``(WIDTH,)``."""
        return np.asarray(self._block[number_index(self.engines[0].store.dtype, name)])


def block_key(engine: EpisodeEngine) -> Hashable | None:
    """Return a key that is equal for episodes which may share a block; None for one that runs alone.

    General powers, which some laws of friction need, and a controller of the user are not vectorized.
    """
    if not isinstance(engine, CompiledEngine):
        return None
    if engine.user_functions or engine.build_flags["WITH_OTHER_FRICTION_LAWS"]:
        return None
    words = engine.store.view(np.int64)
    return engine.loop, has_faults(engine), words[shared_words(engine.store.dtype)].tobytes()


def lane_loop(engine: CompiledEngine, on_compile: OnCompile = None) -> Loop:
    """Return the loop for blocks of episodes with the pattern of an engine, compiled if it is not cached."""

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop
        from twin_gait.simulation.lanes import LanePipeline, lane_names

        rows = len(engine.layout.names), engine.noise.shape[1]
        names = {**loop_names(engine), **LANE_DRIVERS, **lane_names(engine.store.dtype, *rows)}
        names["WITH_FAULTS"] = has_faults(engine)
        return compile_loop(run_ticks_at, names, pipeline=LanePipeline)

    return cached_loop(_key_of(engine), make, on_compile)


def is_lane_loop_cached(engine: EpisodeEngine) -> bool:
    """Return whether the loop for blocks of episodes with this pattern needs no compilation."""
    return isinstance(engine, CompiledEngine) and is_cached(_key_of(engine))


def _key_of(engine: CompiledEngine) -> str:
    return source_key(f"in lanes {engine.specialization_key} {{'WITH_FAULTS': {has_faults(engine)}}}")


def has_faults(engine: CompiledEngine) -> bool:
    """Return whether a block contains the code for faults, which prevents vector code."""
    return bool(engine.setup.experiment.faults)
