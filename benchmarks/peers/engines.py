"""The engines of this package as sessions of the benchmark."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from peers.scenarios import Case
from peers.timing import Implementation

from twin_gait import Run, simulate
from twin_gait.experiment.problem import build_problem
from twin_gait.simulation.compiled_engine import CompiledEngine, bound_kernel, laid_out
from twin_gait.simulation.engine import EngineResult
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.reference_engine import ReferenceEngine

THREADS = 2
BATCH_EPISODES = 16


class EngineSession:
    """An engine of this package, made anew for every run."""

    def __init__(self, case: Case, ticks: int, *, compiled: bool, record: bool = True) -> None:
        """Lay the problem out; only the compiled engine can do without its log."""
        self._problem = build_problem(case.lasting(ticks))
        self._compiled, self._record = compiled, record
        self._result: EngineResult | None = None
        self.reset()

    def reset(self) -> None:
        """Make a new engine and load what it has compiled."""
        self._engine = (
            CompiledEngine(self._problem, record=self._record)
            if self._compiled
            else ReferenceEngine(self._problem)
        )

    def run(self) -> None:
        """Run to the end."""
        self._result = self._engine.run()

    def angles(self) -> np.ndarray | None:
        """Coordinates of the log, or None without one."""
        if self._result is None or len(self._result.rows) == 0:
            return None
        columns, _ = state_columns(self._problem.world.model)
        positions = self._engine.layout.positions
        return self._result.rows[:, [positions[name] for name in columns]]


class PlainSession:
    """The rooms of the compiled engine over the same kernel, as plain Python, without a log."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Lay the problem out."""
        self._problem = build_problem(case.lasting(ticks))
        self._kernel = bound_kernel(laid_out(self._problem)[0])
        self._trace = np.zeros((ticks, self._problem.world.model.nv))
        self.reset()

    def reset(self) -> None:
        """Make a new engine."""
        self._engine = ReferenceEngine(self._problem, kernel=self._kernel)
        self._engine.episode.recording.on = False

    def run(self) -> None:
        """Step through all ticks."""
        episode, no_rows = self._engine.episode, np.zeros((0, 0))
        for tick in range(len(self._trace)):
            self._trace[tick] = episode.q
            self._engine.run_ticks(tick, tick + 1, no_rows)

    def angles(self) -> np.ndarray | None:
        """Coordinates at every tick."""
        return self._trace


class SimulateSession:
    """The whole call ``simulate(experiment)``: URDF, problem, loop, table of the log."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Keep the experiment."""
        self._experiment = case.lasting(ticks)
        self.last: Run | None = None

    def reset(self) -> None:
        """Nothing is kept between runs."""

    def run(self) -> None:
        """Simulate."""
        self.last = simulate(self._experiment)

    def angles(self) -> np.ndarray | None:
        """Left to the session that times the loop alone."""
        return None


class BatchSession:
    """Many compiled episodes side by side on threads; the loop lets go of the interpreter's lock."""

    def __init__(
        self, case: Case, ticks: int, *, episodes: int = BATCH_EPISODES, threads: int = THREADS
    ) -> None:
        """Lay the episodes out."""
        problem = build_problem(case.lasting(ticks))
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.engines = [CompiledEngine(problem, record=False) for _ in range(episodes)]
        self._start = [part.copy() for part in self.engines[0].parts]

    def reset(self) -> None:
        """Put every episode back to its start; a thousand new engines would take longer than they run."""
        for engine in self.engines:
            for part, start in zip(engine.parts, self._start, strict=True):
                part[...] = start
            engine.point_at_rows()

    def run(self) -> None:
        """Run all episodes."""
        if self._pool is None:
            for engine in self.engines:
                engine.run()
            return
        list(self._pool.map(lambda engine: engine.run(), self.engines))

    def angles(self) -> np.ndarray | None:
        """Nothing is recorded."""
        return None


ENGINES = (
    Implementation("compiled", lambda case, ticks: EngineSession(case, ticks, compiled=True, record=False)),
    Implementation("compiled, log", lambda case, ticks: EngineSession(case, ticks, compiled=True)),
    Implementation("simulate()", SimulateSession),
    Implementation("batch", BatchSession, episodes=BATCH_EPISODES),
    Implementation(
        "Pinocchio", lambda case, ticks: EngineSession(case, ticks, compiled=False), compiled=False
    ),
    Implementation("plain Python", PlainSession, compiled=False),
)
