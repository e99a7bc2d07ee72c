"""A recorded walk, brought to the ticks of the controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import LONGEST_RUN
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName, Side

# A log whose instants are those of the ticks to this precision is taken as it is.
SAME_INSTANT = 1e-6  # [s]
# A knee bends backwards by a few degrees at most; beyond this the sign convention is the wrong one.
FURTHEST_BACKWARDS = np.radians(-30.0)
LARGEST_ANGLE = np.pi  # [rad]; beyond it degrees were taken for radians
LARGEST_LOAD = 1e5  # [N]
LATEST = 1e12  # [s]; seconds since 1970 are fine, nanoseconds are not


@dataclass(frozen=True, eq=False)
class Recording:
    """A walk, one value a tick.

    Attributes:
        source: Where it comes from, for messages and titles.
        start: Time of the first tick in [s].
        angles: Of each joint of each leg in [rad], flexion and dorsiflexion positive, shape ``(n,)``.
        loads: Normal force of the foot in [N], where it was recorded, shape ``(n,)``.
        phases: Recorded phase by name, where there is one, shape ``(n,)``.
    """

    source: str
    start: float
    angles: Mapping[Side, Mapping[str, np.ndarray]]
    loads: Mapping[Side, np.ndarray]
    phases: Mapping[Side, np.ndarray]

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs that were recorded."""
        return tuple(self.angles)

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return len(next(iter(next(iter(self.angles.values())).values())))

    @property
    def time(self) -> np.ndarray:
        """Time of each tick in [s], shape ``(n,)``."""
        return self.start + np.arange(self.n_ticks) * TICK


def at_ticks(
    source: str,
    time: np.ndarray,
    angles: Mapping[Side, Mapping[str, np.ndarray]],
    loads: Mapping[Side, np.ndarray],
    phases: Mapping[Side, np.ndarray],
) -> Recording:
    """Bring samples of any rate to ticks of 1 ms.

    Samples that lie on the ticks are kept bit for bit. Others are interpolated by PCHIP, a cubic that
    neither overshoots nor leaves corners, so that the velocity estimate sees no steps; a phase holds until
    the next sample.

    Args:
        source: Where they come from, for messages.
        time: Of the samples in [s], finite and ascending, shape ``(n,)``.
        angles: Of each joint of each leg in [rad], finite, shape ``(n,)`` each.
        loads: Normal force of the feet in [N], finite, shape ``(n,)`` each.
        phases: Phases by name, shape ``(n,)`` each.

    Returns:
        The recording.

    Raises:
        ParameterFileError: If there are too few samples, times that do not ascend or a length beyond an
            hour, or if an angle or a load cannot be one in that unit and sign.
    """
    _check_time(source, time)
    _check_angles(source, angles)
    for side, load in loads.items():
        if np.abs(load).max() > LARGEST_LOAD:
            raise ParameterFileError(
                source, f"{side} foot", f"is loaded with {np.abs(load).max():.3g} N; expected newtons"
            )
    grid = time[0] + np.arange(round((time[-1] - time[0]) / TICK) + 1) * TICK
    if len(grid) == len(time) and np.abs(time - grid).max() <= SAME_INSTANT:
        return Recording(source, float(time[0]), angles, loads, phases)
    grid = grid[grid <= time[-1] + SAME_INSTANT]
    held = np.clip(np.searchsorted(time, grid + SAME_INSTANT, side="right") - 1, 0, len(time) - 1)

    def smooth(values: np.ndarray) -> np.ndarray:
        return np.asarray(PchipInterpolator(time, values)(np.minimum(grid, time[-1])))

    return Recording(
        source,
        float(time[0]),
        {side: {joint: smooth(item) for joint, item in joints.items()} for side, joints in angles.items()},
        {side: smooth(values) for side, values in loads.items()},
        {side: values[held] for side, values in phases.items()},
    )


def _check_time(source: str, time: np.ndarray) -> None:
    if len(time) < 2:
        raise ParameterFileError(source, "time", f"expected at least two samples, got {len(time)}")
    if np.abs(time).max() > LATEST:
        raise ParameterFileError(source, "time", f"reaches {np.abs(time).max():.3g} s; expected seconds")
    steps = np.diff(time)
    if (steps < SAME_INSTANT).any():
        row = int(np.flatnonzero(steps < SAME_INSTANT)[0])
        raise ParameterFileError(
            source, "time", f"must ascend, but {time[row + 1]:g} s follows {time[row]:g} s in row {row + 2}"
        )
    duration = time[-1] - time[0]
    if duration > LONGEST_RUN:
        raise ParameterFileError(
            source,
            "time",
            f"spans {duration:g} s; expected seconds and at most {LONGEST_RUN:g} of them: convert or cut it",
        )
    if duration < TICK:
        raise ParameterFileError(source, "time", f"spans {duration:g} s; expected at least {TICK:g}")


def _check_angles(source: str, angles: Mapping[Side, Mapping[str, np.ndarray]]) -> None:
    for side, joints in angles.items():
        for joint, values in joints.items():
            largest = np.abs(values).max()
            if largest > LARGEST_ANGLE:
                raise ParameterFileError(
                    source,
                    f"{side} {joint}",
                    f"reaches {np.degrees(largest):.4g} deg; are the --units of the log right?",
                )
            if joint == JointName.KNEE and values.min() < FURTHEST_BACKWARDS:
                raise ParameterFileError(
                    source,
                    f"{side} knee",
                    f"bends backwards by {-np.degrees(values.min()):.0f} deg; flexion must come out "
                    "positive, so choose the --convention and --units of the log",
                )
