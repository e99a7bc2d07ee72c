"""Walks of a recorded session, their conditions and strides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.table import TICK
from twin_gait.labels import label_of
from twin_gait.live.journal import read_walks
from twin_gait.live.session_records import RUNNING, SessionError, list_sessions, read_session
from twin_gait.live.session_strides import WORK_SHARE, Condition, conditions_of, strides_by_condition
from twin_gait.runs.folders import journal_path
from twin_gait.runs.record import load_run
from twin_gait.simulation.run import Run


@dataclass(frozen=True)
class SessionWalks:
    """Walks of a recorded session."""

    record: Mapping[str, Any]  # result of :func:`read_session`
    runs: Sequence[Run]

    @cached_property
    def starts(self) -> np.ndarray:
        """Times in [s] at which the walks begin and the last one ends, without the time after a trip."""
        ends = {walk: item.end for walk, item in self.conditions}
        return TICK * np.cumsum([0, *ends.values()])

    @cached_property
    def conditions(self) -> list[tuple[int, Condition]]:
        """All conditions in their order, each with the number of its walk from 0."""
        return [(walk, item) for walk, run in enumerate(self.runs) for item in conditions_of(run)]

    @cached_property
    def strides(self) -> pd.DataFrame:
        """Strides of all walks with ``time_s`` as in ``starts``, and the condition from 1."""
        tables, first = [], 1
        for walk, run in enumerate(self.runs):
            table = strides_by_condition(run)
            times = {"time_s": self.starts[walk] + table["start_s"], "walk": walk}
            tables.append(table.assign(condition=table["condition"] + first, **times))
            first += sum(number == walk for number, _ in self.conditions)
        return pd.concat(tables, ignore_index=True)

    @cached_property
    def settled(self) -> pd.DataFrame:
        """Strides that count."""
        return self.strides[self.strides["settled"]]

    @property
    def keys(self) -> list[str]:
        """Keys of the measures of the strides on the page."""
        joints = dict.fromkeys(joint for record in self.runs[0].leg_records() for joint in record.angles)
        keys = (
            "stride_time_s",
            "swing_share",
            "load_peak",
            *(f"{joint}_error_total_deg" for joint in joints),
        )
        return [key for key in (*keys, WORK_SHARE) if key in self.strides]

    def cell(self, condition: int, side: str, key: str) -> tuple[float, float, int]:
        """Return mean, standard deviation and count of a measure in its display unit; NaN without values."""
        rows = self.settled[(self.settled["condition"] == condition) & (self.settled["side"] == side)]
        values = label_of(key).factor * rows[key].dropna() if key in rows else pd.Series(dtype=float)
        return float(values.mean()), float(values.std(ddof=1)), len(values)


def read_walks_of(records: Path, session: int) -> SessionWalks:
    """Read the walks of a session from its run directories, or from the journal before these exist.

    Raises SessionError if there is no such session or none of its walks, and RunDirectoryError if a walk
    cannot be read.
    """
    record, runs = read_session(records, session), list[Run]()
    for folder in map(Path, record["folders"]):
        if journal_path(folder).exists():
            runs += [run for run, _ in read_walks(journal_path(folder))[1]]
        elif folder.is_dir():
            runs.append(load_run(folder))
    runs = [run for run in runs if len(run.columns) > 1]
    if not runs:
        folders = ", ".join(record["folders"])
        raise SessionError(f"session {session}: has no walk in {folders}; choose another session")
    return SessionWalks(record, runs)


def find_previous(records: Path, session: SessionWalks) -> SessionWalks | None:
    """Return the last earlier session of the same patient with strides that count, or None."""
    patient = session.record["patient"]
    for entry in list_sessions(records, patient=patient) if patient else ():
        if entry["id"] < session.record["id"] and entry["status"] != RUNNING:
            with suppress(TwinGaitError):  # its run directories may have been deleted
                found = read_walks_of(records, entry["id"])
                if len(found.settled):
                    return found
    return None
