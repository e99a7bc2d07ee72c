"""Log of a run as numbers, and the further results of an engine."""

from typing import Any

import numpy as np

from twin_gait.simulation.run import Run


def rows_of(run: Run) -> np.ndarray:
    """Return the log without time, with phases as numbers, shape ``(n_ticks, n_columns)``."""
    log = run.log.drop(columns="time_s")
    columns = [log[name].cat.codes if name.endswith("_phase") else log[name] for name in log]
    return np.array(columns, dtype=float).reshape(log.shape[1], len(log)).T


def ending_of(run: Run) -> tuple[Any, ...]:
    """Return switches, status, reason, trip and traffic of a run."""
    return run.switches, run.status, run.reason, run.trip, run.traffic
