"""Motion in a log: postures, phases and forces at the frame rate of the viewer, and curves.

Curves have few points that represent them faithfully: corners of recorded curves, extremes of live ones.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from twin_gait.control.safety import SafetyState
from twin_gait.exceptions import ViewerError
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.measures.leg_record import moved_joints, phase_column
from twin_gait.palette import TORQUE_COLOURS
from twin_gait.simulation.log import state_columns
from twin_gait.viewer.commands import SceneState
from twin_gait.vocabulary import HOLD, JointName, Side

FRAMES_PER_SECOND = 30.0
_MOST_FRAMES = 3000  # longer runs get fewer frames per second, so that a page stays small
_RARE_PARTS = ("inertia_compensation", "target")  # parts of the torque that are shown only if they are used
MODE = "mode"  # name of the log column
FAITHFUL = 0.002  # largest deviation of a drawn curve from the log, as a share of the curve's range
EXTREMES_TICKS = 5  # ticks per span, in which a live curve has its minimum and maximum: 200 spans per second


class PhaseSpells(NamedTuple):
    """Intervals of one phase each, in their order."""

    starts: np.ndarray  # start of each interval in [s], shape ``(m,)``
    codes: np.ndarray  # phase of each interval as an index into ``Motion.phase_names``, shape ``(m,)``

    def code_at(self, time: float) -> int:
        """Return the code of the phase at a time in [s]."""
        return int(self.codes[max(0, int(np.searchsorted(self.starts, time, side="right")) - 1)])


@dataclass(frozen=True)
class LegMotion:
    """Motion of one leg over time."""

    phases: PhaseSpells
    # angles in [deg] by the names of the joints, torques of motors or muscles in [N·m] as ``hip_torque`` and
    # so on, the parts of the commanded torque in [N·m] as ``hip_impedance`` and so on, and the normal forces
    # of foot and crutch in [N] as ``force`` and ``crutch``; each has points at the frames, and between them
    # where its shape needs them
    curves: Mapping[str, Curve]


@dataclass(frozen=True)
class Motion:
    """Motion in a log at the frame rate of the viewer."""

    times: np.ndarray  # in [s], shape ``(n,)``
    q: np.ndarray  # coordinates of the model, shape ``(n, nv)``
    legs: Mapping[Side, LegMotion]  # motion of each leg by its side
    phase_names: tuple[str, ...]  # phases in the order of their codes, followed by the hold if there is one
    # numeric columns of the log by their names, shape ``(n,)`` each
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    modes: PhaseSpells | None = None  # intervals of the operating modes, or None


# Function of a moving part of the scene: it returns the state of the part in the frame to which the figure
# has moved.
Element = Callable[[Motion, int], SceneState]


def read_motion(
    log: pd.DataFrame,
    model: LegModel,
    *,
    frames_per_second: float = FRAMES_PER_SECOND,
    frame_times: Sequence[float] = (),
) -> Motion:
    """Select the frames of a log to show.

    Returns evenly spaced frames (fewer per second if the log is very long), one at every change of a phase,
    and one at each of ``frame_times`` in [s] since the first row. Rows after a coordinate that is not finite
    (a run that diverged) are omitted. Raises ViewerError if the log is empty or lacks a coordinate of the
    model.
    """
    coordinates, _ = state_columns(model)
    phase_columns = [phase_column(log.columns, side) for side in model.sides]
    for name in ("time_s", *coordinates, *phase_columns):
        if name not in log.columns:
            raise ViewerError(f"the log has no column {name!r}; expected a log of {model.urdf_path.name}")
    finite = np.isfinite(log[coordinates].to_numpy(dtype=float)).all(axis=1)
    log = log.iloc[: finite.cumprod().sum()]
    if log.empty:
        raise ViewerError("the log has no row that can be shown; run the simulation again")
    times = (log["time_s"] - log["time_s"].iloc[0]).to_numpy(dtype=float)
    # Phases of the device first; a leg without a device has those of the wearer's own gait.
    phase_columns.sort(key=lambda name: name.endswith("_own_phase"))
    names = tuple(dict.fromkeys(name for column in phase_columns for name in log[column].cat.categories))
    if held_rows(log).any():
        names = (*names, HOLD)
    spells = {side: _spells(log, times, side, names) for side in model.sides}
    changes = [one.starts for one in spells.values()]
    rows = _rows_to_show(times, frames_per_second, np.concatenate([*changes, frame_times]))
    legs = {}
    for side, phases in spells.items():
        curves = {
            name: simplify_curve(times, known, rows)
            for name, known in leg_values(log, side).items()
            if known.any() or not name.endswith(_RARE_PARTS)
        }
        legs[side] = LegMotion(phases, curves)
    shown = log.iloc[rows].select_dtypes("number")
    columns = {str(name): values.to_numpy() for name, values in shown.items()}
    modes = _changes(log[MODE].to_numpy(dtype=int), times) if MODE in log else None
    return Motion(times[rows], shown[coordinates].to_numpy(dtype=float), legs, names, columns, modes)


def frame_rate(duration: float) -> float:
    """Return the frame rate in [1/s] at which a run of ``duration`` in [s] fits in a page."""
    return FRAMES_PER_SECOND if duration <= 0.0 else min(FRAMES_PER_SECOND, _MOST_FRAMES / duration)


def phase_changes(log: pd.DataFrame) -> np.ndarray:
    """Return the times of phase changes and of the start of a hold in [s] since the first row, sorted."""
    phases = log.filter(regex="_phase$").astype(str).assign(held=held_rows(log))
    clock, changed = log["time_s"].to_numpy(dtype=float), (phases != phases.shift()).any(axis=1).to_numpy()
    return np.asarray(clock[1:][changed[1:]] - clock[0])


def _rows_to_show(times: np.ndarray, frames_per_second: float, frame_times: np.ndarray) -> np.ndarray:
    """Return the rows of evenly spaced frames, of the last one, and of ``frame_times`` in [s]; ``(n,)``."""
    span = float(times[-1])
    step = 1.0 / min(frames_per_second, frame_rate(span))
    inside = frame_times[(frame_times >= 0.0) & (frame_times <= span + 1e-9)]
    shown_times = np.concatenate((step * np.arange(int(span / step + 1e-9) + 1), inside, [span]))
    rows = np.searchsorted(times, shown_times - 1e-9)
    return np.unique(np.minimum(rows, len(times) - 1))


def _spells(log: pd.DataFrame, times: np.ndarray, side: Side, names: Sequence[str]) -> PhaseSpells:
    phases = log[phase_column(log.columns, side)].astype(str).mask(held_rows(log), HOLD)
    return _changes(phases.map(names.index).to_numpy(dtype=int), times)


def _changes(codes: np.ndarray, times: np.ndarray) -> PhaseSpells:
    first = np.concatenate(([0], np.flatnonzero(np.diff(codes)) + 1))
    return PhaseSpells(times[first], codes[first])


def held_rows(log: pd.DataFrame) -> np.ndarray:
    """Return a mask of the rows after a trip, in which the phase has no effect; shape ``(n,)``."""
    return np.asarray(log["safety_state"] == SafetyState.HOLD.code)


def leg_values(log: Mapping[Any, Any] | pd.DataFrame, side: Side) -> dict[str, np.ndarray]:
    """Return the values of a leg that a page shows, one per row.

    ``log``: columns by name. The values are by the names of :class:`LegMotion`, in the displayed units.
    """
    found = {name: np.asarray(log[column], dtype=float) for name, column in leg_columns(log, side).items()}
    return {name: np.degrees(value) if name in list(JointName) else value for name, value in found.items()}


def leg_columns(log: Container[str], side: Side) -> dict[str, str]:
    """Return the columns of a log that a page shows of a leg, by the names of :class:`LegMotion`."""
    columns = {}
    for joint in moved_joints(log, side):
        columns[str(joint)] = f"{side}_{joint}_angle_rad"
        own, motor = f"{side}_{joint}_own_torque_Nm", f"{side}_{joint}_motor_torque_Nm"
        columns[f"{joint}_torque"] = own if own in log else motor
        columns |= {f"{joint}_{part}": f"{side}_{joint}_{part}_torque_Nm" for part in TORQUE_COLOURS}
    columns |= {"force": f"{side}_foot_normal_force_N", "crutch": f"{side}_crutch_normal_force_N"}
    return {name: column for name, column in columns.items() if column in log}


def has_muscles(columns: Iterable[str]) -> bool:
    """Return whether the torques of some joints in a log are those of the wearer's own gait."""
    return any(name.endswith("_own_torque_Nm") for name in columns)


class Curve(NamedTuple):
    """Curve of straight lines between points."""

    times: np.ndarray  # in [s], in ascending order, shape ``(n,)``
    values: np.ndarray  # shape ``(n,)``; NaN where there is no line


def simplify_curve(times: np.ndarray, values: np.ndarray, fixed_rows: np.ndarray) -> Curve:
    """Simplify a curve so that it deviates by at most 0.2 % of the range of its values.

    The row that is farthest from its line becomes a corner, until no row is too far: the algorithm of Ramer
    (1972), Douglas and Peucker (1973) on all lines at once, with distances along the axis of the values.
    ``times`` in [s], shape ``(n,)``; ``values``: shape ``(n,)``; lines end at NaN; ``fixed_rows``: rows that
    are always corners, sorted, including the first and the last one.
    """
    finite = np.isfinite(values)
    tolerance = FAITHFUL * float(np.ptp(values[finite])) if finite.any() else 0.0
    ends = np.flatnonzero(np.diff(finite))
    rows, fixed_rows = np.arange(len(values)), np.union1d(fixed_rows, np.concatenate((ends, ends + 1)))
    while True:
        off = np.nan_to_num(np.abs(values - np.interp(rows, fixed_rows, values[fixed_rows])))[:-1]
        worst = np.repeat(np.maximum.reduceat(off, fixed_rows[:-1]), np.diff(fixed_rows)) if len(off) else off
        found = np.flatnonzero((off == worst) & (off > tolerance))
        if not len(found):
            return Curve(times[fixed_rows], values[fixed_rows])
        fixed_rows = np.union1d(fixed_rows, found)


def extremes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the minimum and the maximum of every span of ``EXTREMES_TICKS`` ticks, in the order of time.

    ``values``: one row per tick, shape ``(n, m)``. Returns rows and their values, shape ``(k, m)`` each.
    """
    rows = []
    for start in range(0, len(values), EXTREMES_TICKS):
        span = values[start : start + EXTREMES_TICKS]
        rows.append(start + np.sort([span.argmin(axis=0), span.argmax(axis=0)], axis=0))
    found = np.concatenate(rows) if rows else np.zeros((0, values.shape[1]), dtype=int)
    return found, np.take_along_axis(values, found, axis=0)
