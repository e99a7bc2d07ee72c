"""The log of a run as numbers, and all else that an engine says of it."""

from typing import Any

import numpy as np

from twin_gait.simulation.run import Run


def log_matrix(run: Run) -> np.ndarray:
    """The log without the time and with phases by number, shape ``(n_ticks, n_columns)``."""
    log = run.log.drop(columns="time_s")
    columns = [log[name].cat.codes if name.endswith("_phase") else log[name] for name in log]
    return np.array(columns, dtype=float).reshape(log.shape[1], len(log)).T


def run_result(run: Run) -> tuple[Any, ...]:
    """Switches, how it ended, trip and traffic."""
    return run.switches, run.status, run.reason, run.trip, run.traffic
