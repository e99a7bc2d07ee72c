"""A recorded walk at the ticks of the controller."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.interpolate import PchipInterpolator

from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import LONGEST_RUN
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName, Side

# A log whose instants are those of the ticks to this precision is taken as it is.
SAME_INSTANT = 1e-6  # [s]
# A knee bends backwards by a few degrees at most; beyond this the sign convention is the wrong one.
FURTHEST_BACKWARDS = -30.0  # [deg]
LARGEST_ANGLE = 180.0  # [deg]; beyond it degrees were taken for radians
LONGEST_GAP, GAP_ROWS = 0.1, 5.0  # [s] and usual rows: a longer gap hides switches
Key = TypeVar("Key", bound=str)


@dataclass(frozen=True, eq=False)
class Recording:
    """A walk, one value a tick."""

    source: str  # where it comes from, for messages and titles
    start: float  # time of the first tick in [s]
    # of each joint of each leg in [rad], flexion and dorsiflexion positive, shape ``(n,)``
    angles: Mapping[Side, Mapping[str, np.ndarray]]
    loads: Mapping[Side, np.ndarray]  # normal force of the foot in [N], where it was recorded, shape ``(n,)``
    phases: Mapping[Side, np.ndarray]  # recorded phase by name, where there is one, shape ``(n,)``
    # signals of the device by name in SI, where they were recorded, shape ``(n,)``
    device: Mapping[str, np.ndarray] = field(default_factory=dict)

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


def at_ticks(samples: Recording, time: np.ndarray) -> Recording:
    """Bring samples of any rate to ticks of 1 ms.

    Samples that lie on the ticks are kept bit for bit. Others are interpolated by PCHIP, a cubic that neither
    overshoots nor leaves corners, so that the velocity estimate sees no steps; a phase holds until the next
    sample. ``samples``: a walk, finite, one value an instant in place of a tick; ``time`` of the instants in
    [s], finite, shape ``(n,)``. Raises ParameterFileError if there are too few samples, times that do not
    ascend, a gap of more than ``LONGEST_GAP`` and ``GAP_ROWS`` usual rows, a length beyond an hour, or if an
    angle cannot be one in that unit and sign.
    """
    for key, problem in _mistakes(time, samples.angles):
        raise ParameterFileError(samples.source, key, problem)
    recorded = replace(samples, start=float(time[0]))
    grid = time[0] + np.arange(round((time[-1] - time[0]) / TICK) + 1) * TICK
    if len(grid) == len(time) and np.abs(time - grid).max() <= SAME_INSTANT:
        return recorded
    grid = grid[grid <= time[-1] + SAME_INSTANT]
    held = np.clip(np.searchsorted(time, grid + SAME_INSTANT, side="right") - 1, 0, len(time) - 1)

    def smooth(columns: Mapping[Key, np.ndarray]) -> dict[Key, np.ndarray]:
        within = np.minimum(grid, time[-1])
        return {name: PchipInterpolator(time, values)(within) for name, values in columns.items()}

    return replace(
        recorded,
        angles={side: smooth(joints) for side, joints in samples.angles.items()},
        loads=smooth(samples.loads),
        phases={side: names[held] for side, names in samples.phases.items()},
        device=smooth(samples.device),
    )


def _mistakes(time: np.ndarray, angles: Mapping[Side, Mapping[str, np.ndarray]]) -> Iterator[tuple[str, str]]:
    """What is wrong with the instants of a log, then with the unit or sign of its angles: key and text."""
    if len(time) < 2:
        yield "time", f"expected at least two samples, got {len(time)}"
    steps, duration = np.diff(time), time[-1] - time[0]
    row, last = int(steps.argmax()), int(steps.argmin())
    if steps[last] < SAME_INSTANT:
        yield "time", f"must ascend, but {time[last + 1]:g} s follows {time[last]:g} s in row {last + 2}"
    if not TICK <= duration <= LONGEST_RUN:
        yield (
            "time",
            f"spans {duration:g} s; expected seconds, {TICK:g} to {LONGEST_RUN:g}: cut it",
        )
    if steps[row] > max(LONGEST_GAP, GAP_ROWS * float(np.median(steps))):
        text = f"has no rows for {steps[row]:.3g} s from {time[row]:g} s on (row {row + 1}); cut it there"
        yield "time", text
    for side, joints in angles.items():
        for joint, values in joints.items():
            degrees = np.degrees(values)
            if np.abs(degrees).max() > LARGEST_ANGLE:
                text = f"reaches {np.abs(degrees).max():.4g} deg; are the --units of the log right?"
                yield f"{side} {joint}", text
            if joint == JointName.KNEE and degrees.min() < FURTHEST_BACKWARDS:
                text = f"bends backwards by {-degrees.min():.0f} deg; flexion must come out positive"
                yield f"{side} {joint}", f"{text}, so choose the --convention and --units of the log"
