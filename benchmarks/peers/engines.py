"""Engines of this package as sessions of the benchmark."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from peers.scenarios import Case
from peers.timing import Implementation

from twin_gait import simulate
from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.compiled_engine import CompiledEngine, assemble, kernel_names
from twin_gait.simulation.lane_engine import LaneEngine
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

THREADS = os.cpu_count() or 1
SPREAD = 0.05  # relative spread of the phase parameters in a block


class EngineSession:
    """Engine of this package, created again for every run."""

    def __init__(self, case: Case, ticks: int, *, compiled: bool, record: bool = True) -> None:
        """Prepare the problem; only the compiled engine can run without a log."""
        self._problem = build_setup(case.lasting(ticks))
        self._compiled, self._record = compiled, record
        self._run: Run | None = None
        self.reset()

    def reset(self) -> None:
        """Create a new engine and load its compiled code."""
        if self._compiled:
            self._engine = CompiledEngine(self._problem)
            self._engine.episode["recording"]["on"] = self._record
        else:
            self._engine = ReferenceEngine(self._problem)

    def run(self) -> None:
        """Run the episode to its end."""
        self._run = self._engine.run()

    def angles(self) -> np.ndarray | None:
        """Return the coordinates of the log, shape ``(n_ticks, nv)``, or None without a log."""
        if self._run is None or len(self._run.log) == 0:
            return None
        columns, _ = state_columns(self._problem.world.model)
        return self._run.log[columns].to_numpy()


class PlainSession:
    """Steps of the compiled engine with the same kernel in plain Python, without a log."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Prepare the problem."""
        self._problem = build_setup(case.lasting(ticks))
        self._kernel = kernel_names(assemble(self._problem)[0])
        self._trace = np.zeros((ticks, self._problem.world.model.nv))
        self.reset()

    def reset(self) -> None:
        """Create a new engine."""
        self._engine = ReferenceEngine(self._problem, kernel=self._kernel)
        self._engine.episode.recording.on = False

    def run(self) -> None:
        """Step through all ticks."""
        episode, no_rows = self._engine.episode, np.zeros((0, 0))
        for tick in range(len(self._trace)):
            self._trace[tick] = episode.q
            self._engine.run_ticks(tick, tick + 1, no_rows)

    def angles(self) -> np.ndarray | None:
        """Return the coordinates at every tick, shape ``(n_ticks, nv)``."""
        return self._trace


class SimulateSession:
    """Complete call of ``simulate(experiment)``: URDF, problem, loop, table of the log."""

    def __init__(self, case: Case, ticks: int) -> None:
        """Store the experiment."""
        self._experiment = case.lasting(ticks)

    def reset(self) -> None:
        """Do nothing, because no state is kept between runs."""

    def run(self) -> None:
        """Simulate the experiment."""
        simulate(self._experiment)

    def angles(self) -> np.ndarray | None:
        """Return None; the session that times the loop alone returns the angles."""
        return None


class BatchSession:
    """Blocks of different episodes in lockstep; the loop releases the lock of the interpreter.

    Attributes:
        engines: Engines of the episodes.
    """

    def __init__(self, case: Case, ticks: int, *, threads: int = 1, episodes: int = 0, **log: Any) -> None:
        """Prepare a number of episodes, or a block for each thread; ``log``: columns of the log."""
        problems = unlike(build_setup(case.lasting(ticks)), episodes or WIDTH * threads)
        self._pool, self._log = ThreadPoolExecutor(threads) if threads > 1 else None, log
        self.engines = [CompiledEngine(problem) for problem in problems]
        for engine in self.engines:
            engine.episode["recording"]["on"] = bool(log)
        self._starts = [engine.store.copy() for engine in self.engines]

    def reset(self) -> None:
        """Restore the start of every episode; a thousand new engines would take longer than their run."""
        for engine, start in zip(self.engines, self._starts, strict=True):
            engine.store[:] = start
            engine.point_at_rows()
        blocks = range(0, len(self.engines), WIDTH)
        self._blocks = [LaneEngine(self.engines[first : first + WIDTH]) for first in blocks]

    def run(self) -> None:
        """Run all episodes."""
        run_all = map if self._pool is None else self._pool.map
        for results in run_all(lambda block: block.run(**self._log), self._blocks):
            walked = all(item.status is RunStatus.COMPLETED and item.trip is None for item in results)
            assert walked, "an episode fell or tripped, after which its ticks are others"

    def angles(self) -> np.ndarray | None:
        """Return None, because no angles of a batch are compared."""
        return None


def unlike(problem: SimulationSetup, episodes: int) -> list[SimulationSetup]:
    """Return copies of a problem with phase parameters up to 5 % apart, which switch in different ticks."""
    rows = problem.phase_rows
    scales = np.random.default_rng(1).uniform(1.0 - SPREAD, 1.0 + SPREAD, (episodes, *rows.shape))
    return [replace(problem, phase_rows=rows * scale) for scale in scales]


ALL_CORES = "batch, all cores"
ENGINES = (
    Implementation("compiled", lambda case, ticks: EngineSession(case, ticks, compiled=True, record=False)),
    Implementation("compiled, log", lambda case, ticks: EngineSession(case, ticks, compiled=True)),
    Implementation("simulate()", SimulateSession),
    Implementation("batch", BatchSession, WIDTH, "batch"),
    Implementation("batch, energies", partial(BatchSession, columns=()), WIDTH, "batch"),
    Implementation("batch, log", partial(BatchSession, columns=None), WIDTH, "batch"),
    Implementation(ALL_CORES, partial(BatchSession, threads=THREADS), WIDTH * THREADS, ALL_CORES),
    Implementation(
        "Pinocchio", lambda case, ticks: EngineSession(case, ticks, compiled=False), compiled=False
    ),
    Implementation("plain Python", PlainSession, compiled=False),
)
