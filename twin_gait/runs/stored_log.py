"""Check of the log of a run folder, which may have been edited, cut or written by another program."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterFileError, RunDirectoryError
from twin_gait.gait.table import TICK
from twin_gait.runs.log_files import LogTable
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.simulation_setup import SimulationSetup


def check_log(log: pd.DataFrame, simulation_setup: SimulationSetup, path: Path) -> pd.DataFrame:
    """Check that a log has the columns of an experiment, with numbers, known phases and a row for every tick.

    Returns the log with its phases as categories of the gait table. Raises RunDirectoryError with the column
    and the row of the first deviation.
    """
    again = f"restore the file, or run it again: twin-gait simulate {path.parent}"
    if log.empty:
        raise RunDirectoryError(f"{path}: has no rows; {again}")
    names = ["time_s", *log_layout(simulation_setup).names]
    missing = [name for name in names if name not in log.columns]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise RunDirectoryError(f"{path}: {missing[0]}{more}: there is no such column; {again}")
    table = LogTable(str(path), log)
    found: dict[str, Any] = {}
    for name in names:
        if name.endswith("_phase"):
            own = name.endswith("_own_phase")
            phases = simulation_setup.own_phase_names if own else simulation_setup.table.phase_names
            codes = pd.Index(phases).get_indexer(pd.Index(log[name].astype(str).to_numpy()))
            wrong = np.flatnonzero(codes < 0)
            if len(wrong):
                mismatch = f"row {wrong[0] + 1}, got {str(log[name].iloc[wrong[0]])[:40]!r}"
                raise RunDirectoryError(
                    f"{path}: {name}: expected a phase of the gait table in {mismatch}; {again}"
                )
            found[name] = pd.Categorical.from_codes(codes, categories=pd.Index(phases))
        elif log[name].dtype.kind not in "fib":
            try:
                found[name] = table.numbers(name, gaps=True)
            except ParameterFileError as error:
                raise RunDirectoryError(f"{error}; {again}") from error
    late = np.flatnonzero(~(np.abs(log["time_s"].to_numpy(float) - TICK * np.arange(len(log))) < TICK / 2))
    if len(late):
        raise RunDirectoryError(
            f"{path}: time_s: expected a row for every tick from 0 s, got another time in row {late[0] + 1}; "
            f"{again}"
        )
    return log.assign(**found)
