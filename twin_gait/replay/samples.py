"""A recorded walk with one value per tick, and its resampling from samples of any rate."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from twin_gait.configuration.device_file import load_device
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.experiment import LONGEST_RUN
from twin_gait.gait.table import TICK
from twin_gait.vocabulary import JointName, Side

# A log whose instants equal the ticks to this precision is used without resampling.
SAME_INSTANT = 1e-6  # [s]
LONGEST_GAP = 0.1  # [s]; a longer gap hides switches: a phase of swing lasts 0.2 s or more
LARGEST_ANGLE = 180.0  # [deg]; a larger angle means that degrees were read as radians
# Genu recurvatum is a hyperextension of 5° and more, rarely beyond 15°. Up to 30° it is a warning.
HYPEREXTENDED, FURTHEST_BACKWARDS = 15.0, 30.0  # [deg]
LEAST_HIP_RANGE = 5.0  # [deg]; the range of the hip in the reference at 0.5 km/h is 26°
CLOSED = 10.0  # [deg] between the ends of one stride; the ends of strides in a walk differ by less
_MISSING_ROWS, _SHORT_STEP = 1.5, 0.02  # in median steps and in [s]; a step that is longer than both is a gap


class Gap(NamedTuple):
    """A gap in the samples of a walk."""

    column: str  # signal that has no value there; ``time`` if rows are missing
    start: float  # time of the last sample before the gap in [s]
    length: float  # time from the last sample before the gap to the first one behind it in [s]


def _time_constant_of_twin() -> float:
    """Return the time constant of the velocity filter of TWIN in [s]."""
    sensors = load_device("twin").parameters()["sensors"]
    return float(sensors.fast_time_constant)


@dataclass(frozen=True, eq=False)
class Recording:
    """A walk with one value per tick."""

    source: str  # origin of the walk, for messages and titles
    start: float  # time of the first tick in [s]
    # angle of each joint of each leg in [rad], flexion and dorsiflexion positive, shape ``(n,)``
    angles: Mapping[tuple[Side, str], np.ndarray]
    loads: Mapping[Side, np.ndarray]  # normal force of the foot in [N], if it was recorded, shape ``(n,)``
    phases: Mapping[Side, np.ndarray]  # name of the recorded phase, if there is one, shape ``(n,)``
    # signals of the device by name in SI units, if they were recorded, shape ``(n,)``
    device: Mapping[str, np.ndarray] = field(default_factory=dict)
    body_weight: float | None = None  # weight of wearer and device in [N], for guards on foot load
    # phase in which a leg begins, if it differs from the recorded one of tick 0
    starts: Mapping[Side, str] = field(default_factory=dict)
    # phases into which operating modes sent both legs, by tick
    postures: Mapping[int, str] = field(default_factory=dict)
    fast_time_constant: float = field(default_factory=_time_constant_of_twin)  # of the velocity filter in [s]
    gaps: tuple[Gap, ...] = ()  # gaps that were interpolated
    warnings: tuple[str, ...] = ()  # doubtful properties of the log, one line each
    # recorded times of foot strikes and foot offs in [s], ascending
    foot_strikes: Mapping[Side, np.ndarray] = field(default_factory=dict)
    foot_offs: Mapping[Side, np.ndarray] = field(default_factory=dict)

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs that were recorded."""
        return tuple(dict.fromkeys(side for side, _ in self.angles))

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return len(next(iter(self.angles.values())))

    @property
    def time(self) -> np.ndarray:
        """Time of each tick in [s], shape ``(n,)``."""
        return self.start + np.arange(self.n_ticks) * TICK


def resample_to_ticks(samples: Recording, time: np.ndarray, *, max_gap: float = LONGEST_GAP) -> Recording:
    """Resample samples of any rate to ticks of 1 ms.

    Samples that coincide with the ticks are kept bit for bit. Others are interpolated by PCHIP, a cubic
    without overshoot or corners, so that the velocity estimate has no steps; a phase holds until the next
    sample. Gaps are filled in the same way. Rows before all signals have begun, or after one has ended, are
    left out.

    ``samples``: a walk with one value per instant instead of per tick, NaN for missing values. ``time``:
    instants in [s], finite, shape ``(n,)``. ``max_gap``: longest gap in [s].

    Raises ParameterFileError if there are too few samples, times that do not ascend, samples that are more
    than ``LONGEST_GAP`` apart, a longer gap, a duration above one hour, or an angle that is implausible in
    its unit and sign.
    """
    for problem in _find_time_errors(time, max_gap):
        raise ParameterFileError(samples.source, "time", problem)
    samples, time = _trim_ends(samples, time)
    samples = _fill_gaps(samples, time, max_gap)
    for key, problem in _find_angle_errors(samples.angles):
        raise ParameterFileError(samples.source, key, problem)
    doubts = tuple(_find_doubtful_angles(samples.angles))
    recorded = replace(samples, start=float(time[0]), warnings=(*samples.warnings, *doubts))
    grid = time[0] + np.arange(round((time[-1] - time[0]) / TICK) + 1) * TICK
    if len(grid) == len(time) and np.abs(time - grid).max() <= SAME_INSTANT:
        return recorded
    grid = grid[grid <= time[-1] + SAME_INSTANT]
    held = np.clip(np.searchsorted(time, grid + SAME_INSTANT, side="right") - 1, 0, len(time) - 1)

    def smooth(columns: Mapping[Any, np.ndarray]) -> dict[Any, np.ndarray]:
        within = np.minimum(grid, time[-1])
        return {name: PchipInterpolator(time, values)(within) for name, values in columns.items()}

    return replace(
        recorded,
        angles=smooth(samples.angles),
        loads=smooth(samples.loads),
        phases={side: names[held] for side, names in samples.phases.items()},
        device=smooth(samples.device),
    )


def repeat_stride(
    samples: Recording, time: np.ndarray, cycle_time: float, strides: int
) -> tuple[Recording, np.ndarray]:
    """Repeat a walk of one stride; its last sample is the first one of the next stride.

    ``time``: any measure that grows evenly from the first to the last sample, such as per cent, shape
    ``(n,)``. ``cycle_time``: duration of the stride in [s]. Returns the walk, and the time of its samples in
    [s].
    """
    if len(time) < 3 or np.diff(time).min() <= 0.0:
        text = "must ascend from the start of one stride to its end, in three rows or more"
        raise ParameterFileError(samples.source, "time", text)
    share = (time - time[0]) / (time[-1] - time[0])
    rows = np.append(np.tile(np.arange(len(time) - 1), strides), 0)
    instants = np.append(np.add.outer(np.arange(strides), share[:-1]).ravel(), strides) * cycle_time
    columns = _numbers(samples)
    open_ended = [
        f"the {side} {joint} ends {degrees:.0f} deg from its start: use a log of exactly one stride"
        for (side, joint), values in samples.angles.items()
        if (degrees := abs(np.degrees(values[-1] - values[0]))) > CLOSED
    ]
    repeated = _replace_signals(samples, {name: values[rows] for name, values in columns.items()}, rows)
    text = f"one stride of {cycle_time:g} s was repeated {strides} times"
    return replace(repeated, warnings=(*samples.warnings, text, *open_ended)), instants


def _find_time_errors(time: np.ndarray, max_gap: float) -> Iterator[str]:
    """Yield the mistakes in the instants of a log."""
    if len(time) < 2:
        yield f"expected at least two samples, got {len(time)}"
    steps, duration = np.diff(time), time[-1] - time[0]
    row, last, usual = int(steps.argmax()), int(steps.argmin()), float(np.median(steps))
    if steps[last] < SAME_INSTANT:
        yield f"must ascend, but {time[last + 1]:g} s follows {time[last]:g} s in row {last + 2}"
    if not TICK <= duration <= LONGEST_RUN:
        yield (
            f"spans {duration:g} s; expected seconds, {TICK:g} to {LONGEST_RUN:g}: cut it, or name another "
            "unit (--time-unit ms)"
        )
    if usual > LONGEST_GAP:
        yield (
            f"advances by {usual:.3g} s from row to row; expected at most {LONGEST_GAP:g} s, because slower "
            "samples hide switches: name its unit (--time-unit ms), or, if it is per cent of one stride, the "
            "duration (--cycle-time-s S)"
        )
    if steps[row] > max_gap:
        yield (
            f"has no rows for {steps[row]:.3g} s from {time[row]:g} s on (row {row + 1}); cut it there, or "
            f"interpolate with --max-gap-s (at most {max_gap:g} s now)"
        )


def _numbers(samples: Recording) -> dict[str, np.ndarray]:
    """Return the numeric signals of a walk, by the names that messages use."""
    angles = {f"{side} {joint}": values for (side, joint), values in samples.angles.items()}
    loads = {f"{side} foot_normal_force": values for side, values in samples.loads.items()}
    return {**angles, **loads, **samples.device}


def _replace_signals(
    samples: Recording, change: Mapping[str, np.ndarray], phases: slice | np.ndarray
) -> Recording:
    """Return a walk with changed numbers, by the names of :func:`_numbers`, and a selection of its phases."""
    return replace(
        samples,
        angles={(side, joint): change[f"{side} {joint}"] for side, joint in samples.angles},
        loads={side: change[f"{side} foot_normal_force"] for side in samples.loads},
        device={name: change[name] for name in samples.device},
        phases={side: names[phases] for side, names in samples.phases.items()},
    )


def _trim_ends(samples: Recording, time: np.ndarray) -> tuple[Recording, np.ndarray]:
    """Remove the rows before all signals have begun and after one has ended."""
    columns = _numbers(samples)
    known = {name: np.flatnonzero(np.isfinite(values)) for name, values in columns.items()}
    for name, rows in known.items():
        if len(rows) < 2:
            raise ParameterFileError(samples.source, name, f"has {len(rows)} values; expected at least two")
    first, last = max(rows[0] for rows in known.values()), min(rows[-1] for rows in known.values())
    if last <= first:
        raise ParameterFileError(samples.source, "", "no two rows have a value of every signal")
    if last - first + 1 == len(time):
        return samples, time
    within = slice(first, last + 1)
    trimmed = _replace_signals(samples, {name: values[within] for name, values in columns.items()}, within)
    left, missing = len(time) - (last - first + 1), _first_missing(columns)
    text = f"{left} rows at the ends of the log were left out, because {missing} has no values there"
    return replace(trimmed, warnings=(*samples.warnings, text)), time[within]


def _first_missing(columns: Mapping[str, np.ndarray]) -> str:
    return next(name for name, values in columns.items() if not np.isfinite(values[[0, -1]]).all())


def _fill_gaps(samples: Recording, time: np.ndarray, max_gap: float) -> Recording:
    """Fill the gaps of a walk whose first and last rows are complete, and list them."""
    steps = np.diff(time)
    least = max(_MISSING_ROWS * float(np.median(steps)), _SHORT_STEP - SAME_INSTANT)
    gaps = [Gap("time", float(time[row]), float(steps[row])) for row in np.flatnonzero(steps > least)]
    filled = dict[str, np.ndarray]()
    for name, values in _numbers(samples).items():
        known = np.flatnonzero(np.isfinite(values))
        filled[name] = values
        if len(known) == len(values):
            continue
        last = np.flatnonzero(np.diff(known) > 1)  # sample before each gap, as an index of the known samples
        starts, ends = time[known[last]].tolist(), time[known[last + 1]].tolist()
        found = [Gap(name, start, end - start) for start, end in zip(starts, ends, strict=True)]
        longest = max(found, key=lambda gap: gap.length)
        if longest.length > max_gap:
            text = (
                f"has no values for {longest.length:.3g} s from {longest.start:g} s on; cut the log there, "
                f"or interpolate with --max-gap-s (at most {max_gap:g} s now)"
            )
            raise ParameterFileError(samples.source, name, text)
        gaps += found
        filled[name] = np.where(
            np.isfinite(values), values, PchipInterpolator(time[known], values[known])(time)
        )
    return replace(_replace_signals(samples, filled, slice(None)), gaps=tuple(gaps))


def _find_angle_errors(angles: Mapping[tuple[Side, str], np.ndarray]) -> Iterator[tuple[str, str]]:
    """Yield the mistakes in unit or sign of the angles of a log: key and text."""
    for (side, joint), values in angles.items():
        degrees = np.degrees(values)
        if np.abs(degrees).max() > LARGEST_ANGLE:
            text = f"reaches {np.abs(degrees).max():.4g} deg; are the --units of the log right?"
            yield f"{side} {joint}", text
        backwards, forwards = -degrees.min(), degrees.max()
        reversed_sign = HYPEREXTENDED < backwards > forwards
        if joint == JointName.KNEE and (reversed_sign or backwards > FURTHEST_BACKWARDS):
            text = (
                f"bends backwards by {backwards:.0f} deg and forwards by {forwards:.0f} deg; flexion must "
                "come out positive, so choose the --convention and --units of the log, or turn the column "
                f"with --columns {side}_{joint}_angle=-NAME"
            )
            yield f"{side} {joint}", text


def _find_doubtful_angles(angles: Mapping[tuple[Side, str], np.ndarray]) -> Iterator[str]:
    """Yield doubtful properties of the angles of a log."""
    for (side, joint), values in angles.items():
        degrees = np.degrees(values)
        if joint == JointName.HIP and np.ptp(degrees) < LEAST_HIP_RANGE:
            yield (
                f"the {side} hip moves by {np.ptp(degrees):.2g} deg in all; a step moves it by more than "
                f"{LEAST_HIP_RANGE:g} deg: are the --units of the log right?"
            )
        if joint == JointName.KNEE and degrees.min() < -HYPEREXTENDED:
            yield (
                f"the {side} knee bends backwards by {-degrees.min():.0f} deg, which is more than "
                f"{HYPEREXTENDED:g} deg: are its sign and its zero right?"
            )
