"""The engines of this package as sessions of the benchmark."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from peers.scenarios import Case
from peers.timing import Implementation

from twin_gait import JointName, Run, simulate
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.engine import EngineResult
from twin_gait.simulation.pinocchio.engine import PinocchioEngine
from twin_gait.simulation.problem import Problem, build_problem

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
        if not self._compiled:
            self._engine: CompiledEngine | PinocchioEngine = PinocchioEngine(self._problem)
            return
        self._engine = CompiledEngine(self._problem, record=self._record)
        self._engine.warm_up()

    def run(self) -> None:
        """Run to the end."""
        self._result = self._engine.run()

    def angles(self) -> np.ndarray | None:
        """Coordinates of the log, or None without one."""
        if self._result is None or len(self._result.rows) == 0:
            return None
        columns = coordinate_columns(self._problem)
        positions = self._engine.layout.positions
        return self._result.rows[:, [positions[name] for name in columns]]


def coordinate_columns(problem: Problem) -> list[str]:
    """Log columns of the coordinates, in the order of the leg model."""
    model = problem.world.model
    names = [""] * model.nv
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            names[model.index(side, JointName(joint))] = f"{side}_{joint}_angle_rad"
    if model.pelvis_index is not None:
        names[model.pelvis_index] = "pelvis_height_m"
    return names


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
        self.engines[0].warm_up()
        self._start = [array.copy() for array in self.engines[-1].episode.state]

    def reset(self) -> None:
        """Put every episode back to its start; a thousand new engines would take longer than they run."""
        for engine in self.engines:
            for array, start in zip(engine.episode.state, self._start, strict=True):
                array[...] = start

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
)
