"""Episodes for learning: an experiment with values drawn at random, and records that advance together."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterError
from twin_gait.learn.signals import RecordMap, word_of
from twin_gait.parameters.quantities import require
from twin_gait.simulation.block import WIDTH, interleave
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.episode import COMPLETED
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, block_key, lane_loop
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import apply_override

# Values drawn at random, by key of an experiment: a tuple of lowest and highest number, or a list of values.
Randomisation = Mapping[str, tuple[float, float] | list[Any]]
HIGHEST_SEED = 2**31


def draw_engine(
    base: LoadedExperiment, randomise: Randomisation, generator: np.random.Generator
) -> CompiledEngine:
    """Return the engine of an episode at tick 0, whose values and seed are drawn at random.

    A tuple has the bounds of a uniform distribution; a list has values with equal chances. Raises
    ParameterError or ParameterFileError for values that the experiment does not accept.
    """
    override: dict[str, Any] = {"seed": int(generator.integers(HIGHEST_SEED))}
    for key, values in sorted(randomise.items()):
        expected = "a tuple of two bounds, or a list of values"
        require(isinstance(values, (tuple, list)) and len(values) > 0, f"randomise.{key}", expected, values)
        if isinstance(values, tuple):
            require(len(values) == 2, f"randomise.{key}", expected, values)
            override[key] = float(generator.uniform(*values))
        else:
            override[key] = values[int(generator.integers(len(values)))]
    return CompiledEngine(build_setup(apply_override(base, override, "randomise")))


class Records:
    """Records of several episodes that advance by control steps.

    Attributes:
        words: 64-bit words of all records, shape ``(n_words, n)``; a value that is written acts in the next
            tick.
        ticks_done: Ticks since the start of each episode, shape ``(n,)``.
        engines: Engine of each episode; it owns the arrays to which the record has addresses.
    """

    words: np.ndarray

    def __init__(self, engines: Sequence[CompiledEngine], step: int, places: RecordMap | None = None) -> None:
        """Run the first control step of each episode.

        ``step``: its length in ticks. ``places``: map of earlier records, which is used if it fits.
        """
        self.engines, self.step = list(engines), step
        self.places = places if places is not None and places.fits(engines[0]) else RecordMap(engines[0])
        self._dtype = engines[0].store.dtype
        self._status = self.places.index("status")[0]
        self._recording = word_of(self.places.root.recording.on)
        self.ticks_done = np.array([self._begin(engine) for engine in engines])

    def _begin(self, engine: CompiledEngine) -> int:
        """Run the first control step of an episode alone, and return its ticks.

        Some steps of a tick differ in the first tick, in which a block of episodes is later.
        """
        if engine.store.dtype != self._dtype:
            problem = "expected values that do not change the number of joints, phases or contact points"
            raise ParameterError(f"randomise: {problem}")
        words = engine.store.view(np.int64)
        words[self._recording] = 0
        return engine.loop(engine.store.ctypes.data, 0, self.step)

    def replace(self, lane: int, engine: CompiledEngine) -> None:
        """Replace an episode by a new one, and run its first control step."""
        self.ticks_done[lane] = self._begin(engine)
        self.engines[lane] = engine
        self.words[:, lane] = engine.store.view(np.int64)

    def advance(self, lanes: np.ndarray) -> None:
        """Run a control step of the episodes in some lanes, or less for those that end in it."""
        raise NotImplementedError


class SingleRecords(Records):
    """Records that advance one after the other."""

    def __init__(
        self,
        engines: Sequence[CompiledEngine],
        step: int,
        places: RecordMap | None = None,
        *,
        record: bool = False,
    ) -> None:
        """Run the first control step; ``record``: whether the log is kept, for :meth:`run`."""
        self._rows: dict[int, np.ndarray] = {}
        self._record = record
        super().__init__(engines, step, places)
        self._memory = np.array([engine.store.view(np.int64) for engine in engines])
        self.words = self._memory.T

    def _begin(self, engine: CompiledEngine) -> int:
        if not self._record:
            return super()._begin(engine)
        rows = np.zeros((engine.setup.experiment.n_ticks + self.step, len(engine.layout.names)))
        self._rows[id(engine)] = rows
        return engine.run_ticks(0, self.step, rows)

    def replace(self, lane: int, engine: CompiledEngine) -> None:
        """Replace an episode by a new one, and run its first control step."""
        self._rows.pop(id(self.engines[lane]), None)
        super().replace(lane, engine)

    def advance(self, lanes: np.ndarray) -> None:
        """Run a control step of the episodes in some lanes, or less for those that end in it."""
        for lane in lanes.tolist():
            done = int(self.ticks_done[lane])
            address = self._memory[lane].ctypes.data
            self.ticks_done[lane] = self.engines[lane].loop(address, done, done + self.step)

    def run(self, lane: int) -> Run:
        """Return an episode so far as a run; raises ParameterError if its log was not kept."""
        engine = self.engines[lane]
        rows = self._rows.get(id(engine))
        if rows is None:
            raise ParameterError("run: the environment keeps no log; make it with record=True")
        engine.store.view(np.int64)[:] = self._memory[lane]
        done = int(self.ticks_done[lane])
        return engine.build_run(done, rows[:done].T.copy(), None, 0.0)


class BlockRecords(Records):
    """Records that advance in lockstep, as vector code; see :mod:`twin_gait.simulation.lane_engine`.

    An episode that begins later than the block has its own count of ticks: ``first_tick`` of its record.
    """

    def __init__(self, engines: Sequence[CompiledEngine], step: int, places: RecordMap | None = None) -> None:
        """Compile or load the loop, and interleave the records; at most ``WIDTH`` episodes."""
        self._kind = _kind_of(engines[0])
        decimation = engines[0].setup.experiment.sensors.decimation
        expected = f"a multiple of sensors.decimation, {decimation} ticks of 1 ms, in a vector environment"
        require(step % decimation == 0, "period_s", expected, step)
        for engine in engines[1:]:
            self._require_kind(engine)
        self._loop = lane_loop(engines[0])
        super().__init__(engines, step, places)
        self._first_tick = word_of(self.places.root.first_tick)
        self._block = interleave([engine.store for engine in engines])
        self.words = self._block[:, : len(engines)]
        self._tick = step

    def _require_kind(self, engine: CompiledEngine) -> None:
        if _kind_of(engine) != self._kind:
            problem = "expected values that all episodes of a vector environment can share a loop with"
            way_out = "use single environments (gymnasium.make), or leave the key out"
            raise ParameterError(f"randomise: {problem}; {way_out}")

    def replace(self, lane: int, engine: CompiledEngine) -> None:
        """Replace an episode by a new one, and run its first control step before the others step."""
        self._require_kind(engine)
        super().replace(lane, engine)
        self.words[self._first_tick, lane] = self._tick  # when the others have stepped, it has, too

    def advance(self, lanes: np.ndarray) -> None:
        """Run a control step of the episodes in some lanes, or less for those that end in it."""
        block, end, running = self._block, self._tick + self.step, lanes
        waiting = set(range(len(self.engines))).difference(lanes.tolist())
        kept = {lane: block[:, lane].copy() for lane in waiting}
        tick = self._tick
        while tick < end and len(running):
            if len(running) < WIDTH:  # other lanes repeat a running one
                block[:, np.setdiff1d(np.arange(WIDTH), running)] = block[:, running[:1]]
            tick = self._loop(block.ctypes.data, tick, end)
            over = block[self._status, running] != COMPLETED
            for lane in running[over].tolist():
                kept[lane] = block[:, lane].copy()
                self.ticks_done[lane] = tick - block[self._first_tick, lane]
            running = running[~over]
        self.ticks_done[running] = end - block[self._first_tick, running]
        for lane, words in kept.items():
            block[:, lane] = words
        self._tick = end


def make_records(
    engines: Sequence[CompiledEngine], step: int, places: RecordMap | None = None, *, record: bool = False
) -> Records:
    """Return the records of episodes: in a block if they are enough for one, otherwise one by one."""
    if record or len(engines) < MIN_BLOCK_SIZE:
        return SingleRecords(engines, step, places, record=record)
    return BlockRecords(engines, step, places)


def _kind_of(engine: CompiledEngine) -> Any:
    """Return the kind of an episode; raises ParameterError for one that cannot be part of a block."""
    kind = block_key(engine)
    if kind is None or engine.setup.world.imposed_motion is not None:
        problem = "expected an experiment without imposed motion and without general powers in its friction"
        raise ParameterError(f"experiment: {problem}, for a vector environment; use single environments")
    return kind
