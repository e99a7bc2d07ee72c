"""Run a test on the joint bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from twin_gait.core.control_tick import controller_torques
from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK
from twin_gait.scenario.bench_joint import BenchJoint, TorqueControl
from twin_gait.simulation.bench_joint.arrays import COLUMNS, DIVERGED
from twin_gait.simulation.bench_joint.layout import BenchVariation, bench_arrays
from twin_gait.simulation.bench_joint.loop import compiled_loop, plain_loop
from twin_gait.simulation.run import RunStatus

CHUNK_TICKS = 5000  # between two looks at progress and interruption
# Columns of the thesis's log files, in this order; the others are what no bench can see.
LOG_COLUMNS = COLUMNS[:9]


@dataclass(frozen=True, eq=False)
class BenchRun:
    """What a test left behind.

    Attributes:
        test: The test.
        rows: Log, shape ``(n_ticks, n_columns)``.
        status: Completed, diverged or interrupted.
    """

    test: BenchJoint
    rows: np.ndarray
    status: RunStatus

    def column(self, name: str) -> np.ndarray:
        """A column by its name, shape ``(n_ticks,)``.

        Args:
            name: One of :data:`twin_gait.simulation.bench_joint.arrays.COLUMNS`.

        Returns:
            The values.

        Raises:
            ParameterError: If there is no such column.
        """
        if name not in COLUMNS:
            raise ParameterError(f"{name}: no such column; there are {', '.join(COLUMNS)}")
        return np.asarray(self.rows[:, COLUMNS.index(name)])

    def log(self, *, truth: bool = True) -> pd.DataFrame:
        """The log as a table.

        Args:
            truth: Also what no bench can see: friction, true motion, true current.

        Returns:
            One row per tick.
        """
        columns = COLUMNS if truth else LOG_COLUMNS
        return pd.DataFrame(self.rows[:, : len(columns)], columns=list(columns))


def simulate_bench(
    test: BenchJoint,
    *,
    seed: int = 0,
    variation: BenchVariation | None = None,
    compiled: bool = True,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> BenchRun:
    """Simulate a test.

    Args:
        test: The bench and what is done on it.
        seed: Of the noise of current and encoder.
        variation: What chance adds to this test.
        compiled: False runs the same loop as plain Python, some hundred times slower.
        progress: Called with ticks done and in all.
        should_stop: Asked between chunks; True ends the test there.
        on_compile: Called if the loop has to be compiled.

    Returns:
        The run.

    Raises:
        ParameterError: If parts of the test do not go together.
    """
    law = test.control.controller.law if isinstance(test.control, TorqueControl) else controller_torques
    run_ticks = compiled_loop(law, on_compile) if compiled else plain_loop(law)
    ticks = max(1, round(test.duration / TICK))
    bench = bench_arrays(test, ticks, seed, variation or BenchVariation())
    rows = np.zeros((ticks, len(COLUMNS)))
    done, status = 0, RunStatus.COMPLETED
    while done < ticks:
        if should_stop is not None and should_stop():
            status = RunStatus.INTERRUPTED
            break
        end = min(done + CHUNK_TICKS, ticks)
        reached = int(run_ticks(bench, done, end, rows))
        done = reached
        if progress is not None:
            progress(done, ticks)
        if bench.state[DIVERGED]:
            status = RunStatus.DIVERGED
        if reached < end or status is RunStatus.DIVERGED:
            break
    return BenchRun(test, rows[:done], status)
