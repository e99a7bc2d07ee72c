"""The engine that runs episodes of one pattern in lockstep, each as it would run alone.

Up to :data:`WIDTH` records stand side by side in a block, and the loop of the compiled engine, compiled over
the block, takes all of them through a tick. An episode that has ended leaves the block, and its lane goes on
as a copy of another one's, which changes nothing. With few left the rest run alone.
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

# A block with fewer episodes takes longer than they do alone: it breaks even at 8 to 11 of them with AVX-512,
# at 13 to 19 with AVX2.
MIN_BLOCK_SIZE = 16
_CHUNK_TICKS = 100  # whose rows stand side by side until they are sorted out; they fit into the cache


class LaneEngine:
    """Runs compiled engines together from start to end."""

    def __init__(self, engines: Sequence[CompiledEngine]) -> None:
        """Put the records side by side and get the compiled loop.

        ``engines``: at tick 0, all of one :func:`kind_of`, at most :data:`WIDTH`.
        """
        assert len({block_key(engine) for engine in engines}) == 1
        self.engines = engines
        self._loop = lane_loop(engines[0])
        self._block = interleave([engine.store for engine in engines])
        self._totals = np.array([engine.setup.experiment.n_ticks for engine in engines])
        self._ends = np.zeros_like(self._totals)

    def run(self, columns: Sequence[int] | None = None) -> list[Run]:
        """Run all episodes to their ends; each run is the one that :meth:`CompiledEngine.run` gives."""
        began = time.perf_counter()
        width, record = len(self.engines[0].layout.names), bool(self._numbers("recording.on")[0])
        kept = np.arange(width) if columns is None else np.asarray(columns, dtype=int)
        # Apart, so that each goes when its run does.
        logs = [np.empty((len(kept), total if record else 0)) for total in self._totals]
        rows = np.zeros((_CHUNK_TICKS if record else 1, width, WIDTH))
        self._numbers("recording.log")[:] = rows.ctypes.data
        running, done = np.arange(len(self.engines)), 0
        while len(running) >= MIN_BLOCK_SIZE:
            end = int(self._totals[running].min())
            begin, done = done, self._run_ticks(done, min(end, done + _CHUNK_TICKS) if record else end)
            if record:
                part = rows[: done - begin, kept]
                for lane in running.tolist():
                    logs[lane][:, begin:done] = part[:, :, lane].T
            running = self._take_out(running, done)
        for lane in running.tolist():
            self._finish(lane, done, logs[lane], kept)
        share = (time.perf_counter() - began) / len(self.engines)
        return [
            engine.build_run(end, log, columns, share)
            for engine, end, log in zip(self.engines, self._ends.tolist(), logs, strict=True)
        ]

    def _run_ticks(self, first: int, end: int) -> int:
        """Run some ticks, fewer if an episode ends on the way; their rows go to the begin of the chunk."""
        self._numbers("recording.first_row")[:] = first
        return self._loop(self._block.ctypes.data, first, end)

    def _take_out(self, running: np.ndarray, done: int) -> np.ndarray:
        """Give back the records of lanes that have ended, or of all if few are left; returns the others."""
        over = (self._numbers("episode.status")[running] != COMPLETED) | (self._totals[running] == done)
        if not over.any():
            return running
        self._ends[running[over]] = done
        left: np.ndarray = running[~over]
        for lane in (running if len(left) < MIN_BLOCK_SIZE else running[over]).tolist():
            self.engines[lane].store.view(np.int64)[:] = self._block[:, lane]
        if len(left) > 0:
            self._block[:, np.setdiff1d(np.arange(WIDTH), left)] = self._block[:, left[:1]]
        return left

    def _finish(self, lane: int, done: int, log: np.ndarray, kept: np.ndarray) -> None:
        engine, total = self.engines[lane], int(self._totals[lane])
        rows = np.zeros((max(total - done, 1), len(engine.layout.names)))
        end = engine.run_ticks(done, total, rows, done)
        if log.shape[1] > 0:
            log[:, done:end] = rows[: end - done, kept].T
        self._ends[lane] = end

    def _numbers(self, name: str) -> np.ndarray:
        """A whole number of the record in all lanes."""
        return np.asarray(self._block[number_index(self.engines[0].store.dtype, name)])


def block_key(engine: EpisodeEngine) -> Hashable | None:
    """What episodes have in common that may share a block; None for one that runs alone.

    Powers of any exponent, of some laws of friction, and a controller of the user's are no vector code.
    """
    if not isinstance(engine, CompiledEngine):
        return None
    if engine.user_functions or engine.build_flags["WITH_OTHER_FRICTION_LAWS"]:
        return None
    words = engine.store.view(np.int64)
    return engine.loop, words[shared_words(engine.store.dtype)].tobytes()


def lane_loop(engine: CompiledEngine, on_compile: OnCompile = None) -> Loop:
    """The loop for blocks of episodes like an engine's, compiled if need be."""

    def make() -> CompiledLoop:
        from twin_gait.simulation.compiling import compile_loop
        from twin_gait.simulation.lanes import LanePipeline, lane_names

        rows = len(engine.layout.names), engine.noise.shape[1]
        names = {**loop_names(engine), **LANE_DRIVERS, **lane_names(engine.store.dtype, *rows)}
        return compile_loop(run_ticks_at, names, pipeline=LanePipeline)

    return cached_loop(_key_of(engine), make, on_compile)


def is_lane_loop_cached(engine: EpisodeEngine) -> bool:
    """Whether the loop for blocks of episodes like this one needs no compiling."""
    return isinstance(engine, CompiledEngine) and is_cached(_key_of(engine))


def _key_of(engine: CompiledEngine) -> str:
    return source_key(f"in lanes {engine.specialization_key}")
