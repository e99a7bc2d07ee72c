"""Results of the requests of a run: the mode after each request, or the reason for its rejection."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from twin_gait.gait.modes import ModeTable, rejection_reason
from twin_gait.gait.signals import LEFT, LEGS_IN_SWING, LOAD, MODE_SIGNALS, RIGHT, TIME_IN_PHASE, signal_scale
from twin_gait.gait.table import TICK, GaitTable


class RequestResult(NamedTuple):
    """Result of a request."""

    tick: int  # Tick of the request.
    request: str  # Name of the request.
    mode_before: str  # Mode in which the request was made.
    mode_after: str  # Mode after the request.
    rejection: str = ""  # Reason for the rejection in words; empty if the request was executed.

    @property
    def time(self) -> float:
        """Time of the request in [s]."""
        return self.tick * TICK

    @property
    def text(self) -> str:
        """Result as a line of text: ``sit at 5.000 s: standing for 1.2 s, less than 3 s``."""
        result = self.rejection or f"{self.mode_before} to {self.mode_after}"
        return f"{self.request} at {self.time:.3f} s: {result}"


def request_result(
    log: pd.DataFrame, tick: int, before: str, ticks: int, modes: ModeTable, table: GaitTable, weight: float
) -> RequestResult:
    """Return the result of the request of a tick, ``ticks`` after the mode ``before`` was entered."""
    row = log.iloc[tick]
    after, request = modes.phase_names[int(row["mode"])], modes.requests[int(row["request"]) - 1]
    why = ""
    if row["rejected"]:
        measured = signals_in(log, modes.joints, table, tick, weight)
        otherwise = f"the device went to {after} in the same tick"
        why = rejection_reason(modes, before, request, measured, ticks) or otherwise
    return RequestResult(tick, request, before, after, why)


def signals_in(
    log: pd.DataFrame, joints: Sequence[str], table: GaitTable, tick: int, body_weight: float
) -> Mapping[str, float]:
    """Return the signals that the supervisor has read in a tick, by name and in the units of the names.

    The times in the phases are left out. ``body_weight`` in [N].
    """
    row, found = log.iloc[tick], {}
    for leg in (LEFT, RIGHT):
        side = leg.removesuffix(".")
        for joint in joints:
            found[f"{leg}{joint}.angle_deg"] = row[f"{side}_{joint}_measured_angle_rad"]
            found[f"{leg}{joint}.velocity_deg_per_s"] = row[f"{side}_{joint}_velocity_fast_rad_per_s"]
        found[leg + LOAD.name] = row.get(f"{side}_foot_normal_force_N", 0.0) / body_weight
    for signal in MODE_SIGNALS:
        if signal not in (TIME_IN_PHASE, LEGS_IN_SWING):
            found[signal.name] = row.get(signal.column, signal.initial_value)
    phases = log.iloc[max(0, tick - 1)]
    swinging = sum(table.is_swing(str(phases[f"{leg.removesuffix('.')}_phase"])) for leg in (LEFT, RIGHT))
    found[LEGS_IN_SWING.name] = float(swinging)
    return {name: value / signal_scale(name) for name, value in found.items()}
