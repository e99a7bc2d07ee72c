"""A recorded walk at the ticks of the controller, and the other leg of a one-legged one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import find_peaks

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
LONGEST_GAP, GAP_ROWS = 0.1, 5.0  # [s] and usual rows: a longer gap hides switches
LATEST = 1e12  # [s]; seconds since 1970 are fine, nanoseconds are not
Resample = Callable[[np.ndarray], np.ndarray]


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

    def each(self, numbers: Resample, names: Resample) -> Recording:
        """The walk with something done to all its numbers, and to the names of its phases."""
        return replace(
            self,
            angles={
                side: {joint: numbers(item) for joint, item in joints.items()}
                for side, joints in self.angles.items()
            },
            loads={side: numbers(values) for side, values in self.loads.items()},
            phases={side: names(values) for side, values in self.phases.items()},
            device={name: numbers(values) for name, values in self.device.items()},
        )


def at_ticks(samples: Recording, time: np.ndarray) -> Recording:
    """Bring samples of any rate to ticks of 1 ms.

    Samples that lie on the ticks are kept bit for bit. Others are interpolated by PCHIP, a cubic that neither
    overshoots nor leaves corners, so that the velocity estimate sees no steps; a phase holds until the next
    sample. ``samples``: a walk, finite, one value an instant in place of a tick; ``time`` of the instants in
    [s], finite and ascending, shape ``(n,)``. Raises ParameterFileError if there are too few samples, times
    that do not ascend, a gap of more than ``LONGEST_GAP`` and ``GAP_ROWS`` usual rows, a length beyond an
    hour, or if an angle or a load cannot be one in that unit and sign.
    """
    source = samples.source
    _check_time(source, time)
    _check_angles(source, samples.angles)
    for side, load in samples.loads.items():
        if np.abs(load).max() > LARGEST_LOAD:
            text = f"is loaded with {np.abs(load).max():.3g} N; expected newtons"
            raise ParameterFileError(source, f"{side} foot", text)
    recorded = replace(samples, start=float(time[0]))
    grid = time[0] + np.arange(round((time[-1] - time[0]) / TICK) + 1) * TICK
    if len(grid) == len(time) and np.abs(time - grid).max() <= SAME_INSTANT:
        return recorded
    grid = grid[grid <= time[-1] + SAME_INSTANT]
    held = np.clip(np.searchsorted(time, grid + SAME_INSTANT, side="right") - 1, 0, len(time) - 1)

    def smooth(values: np.ndarray) -> np.ndarray:
        return np.asarray(PchipInterpolator(time, values)(np.minimum(grid, time[-1])))

    return recorded.each(smooth, lambda names: names[held])


def _check_time(source: str, time: np.ndarray) -> None:
    if len(time) < 2:
        raise ParameterFileError(source, "time", f"expected at least two samples, got {len(time)}")
    if np.abs(time).max() > LATEST:
        raise ParameterFileError(source, "time", f"reaches {np.abs(time).max():.3g} s; expected seconds")
    steps = np.diff(time)
    if (steps < SAME_INSTANT).any():
        row = int(np.flatnonzero(steps < SAME_INSTANT)[0])
        text = f"must ascend, but {time[row + 1]:g} s follows {time[row]:g} s in row {row + 2}"
        raise ParameterFileError(source, "time", text)
    duration = time[-1] - time[0]
    if not TICK <= duration <= LONGEST_RUN:
        text = f"expected seconds, at least {TICK:g} and at most {LONGEST_RUN:g}: convert or cut it"
        raise ParameterFileError(source, "time", f"spans {duration:g} s; {text}")
    row, usual = int(steps.argmax()), float(np.median(steps))
    if steps[row] > max(LONGEST_GAP, GAP_ROWS * usual):
        text = f"has no rows for {steps[row]:.3g} s from {time[row]:g} s on (row {row + 1}); cut it there"
        raise ParameterFileError(source, "time", text)


def _check_angles(source: str, angles: Mapping[Side, Mapping[str, np.ndarray]]) -> None:
    for side, joints in angles.items():
        for joint, values in joints.items():
            largest = np.abs(values).max()
            if largest > LARGEST_ANGLE:
                text = f"reaches {np.degrees(largest):.4g} deg; are the --units of the log right?"
                raise ParameterFileError(source, f"{side} {joint}", text)
            if joint == JointName.KNEE and values.min() < FURTHEST_BACKWARDS:
                text = (
                    f"bends backwards by {-np.degrees(values.min()):.0f} deg; flexion must come out "
                    "positive, so choose the --convention and --units of the log"
                )
                raise ParameterFileError(source, f"{side} knee", text)


SHORTEST_STRIDE, LONGEST_STRIDE = 0.6, 6.0  # [s]
LEAST_CORRELATION = 0.5  # of a walk with itself one stride later
NEARLY_BEST = 0.95


def mirrored(recording: Recording, period: float | None = None) -> Recording:
    """Make the leg that was not recorded: the recorded one half a stride earlier.

    The first half stride has no such partner and is cut off. ``period``: stride time in [s]; None finds it in
    the angles. Raises ParameterFileError if both legs are there, or the period does not fit the record.
    """
    if len(recording.sides) != 1:
        raise ParameterFileError(recording.source, "mirror", "both legs are in the log; leave --mirror out")
    (side,) = recording.sides
    period = stride_period(recording) if period is None else period
    longest = recording.n_ticks * TICK
    if not (math.isfinite(period) and 2 * TICK <= period <= longest):
        text = f"expected a stride time of at most {longest:g} s, got {period:g}"
        raise ParameterFileError(recording.source, "mirror", text)
    half = round(0.5 * period / TICK)
    own = recording.each(lambda values: values[half:], lambda names: names[half:])
    earlier = recording.each(lambda values: values[:-half], lambda names: names[:-half])
    of_side = {item: own if item is side else earlier for item in Side}
    return replace(
        own,
        start=recording.start + half * TICK,
        angles={item: part.angles[side] for item, part in of_side.items()},
        loads={item: part.loads[side] for item, part in of_side.items() if recording.loads},
        phases={item: part.phases[side] for item, part in of_side.items() if recording.phases},
    )


def stride_period(recording: Recording) -> float:
    """Find the stride time: the shift at which the angles of a leg are most like themselves.

    ``recording``: a walk; its first leg is looked at. Returned in [s]. Raises ParameterFileError if the
    angles do not repeat between 0.6 and 6 s.
    """
    joints = next(iter(recording.angles.values()))
    signals = [values - values.mean() for values in joints.values()]
    total = np.atleast_1d(sum(_autocorrelation(values) for values in signals if values.std() > 0.0))
    first = round(SHORTEST_STRIDE / TICK)
    end = min(round(LONGEST_STRIDE / TICK), recording.n_ticks // 2)
    found, _ = find_peaks(total[first - 1 : end + 1], height=LEAST_CORRELATION * total[0])
    if len(found):
        # Two strides later a walk is just as much like itself: the first good peak is the stride.
        peaks = first - 1 + found
        good = total[peaks] >= NEARLY_BEST * total[peaks].max()
        return int(peaks[good][0]) * TICK
    text = f"the angles do not repeat between {SHORTEST_STRIDE:g} and {LONGEST_STRIDE:g} s over two strides"
    raise ParameterFileError(recording.source, "mirror", f"{text}; state the stride time: --mirror SECONDS")


def _autocorrelation(values: np.ndarray) -> np.ndarray:
    """Mean product of a signal with itself at every shift up to half its length, over that at none."""
    n = len(values)
    spectrum = np.fft.rfft(values, 2 * n)
    product = np.fft.irfft(spectrum * spectrum.conj())[: n // 2 + 1]
    mean = product / (n - np.arange(len(product)))
    return np.asarray(mean / mean[0])
