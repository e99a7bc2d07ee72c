"""A recorded walk at the ticks of the controller: from the columns of a log file, or from the literature."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from twin_gait.control import SafetyState
from twin_gait.conventions import CONVENTIONS, DEGREES, HOUSE, RADIANS, Convention
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import LONGEST_RUN
from twin_gait.gait.signals import DEVICE_SIGNALS
from twin_gait.gait.table import TICK
from twin_gait.measures import reference
from twin_gait.parameters import Patient, SensorParameters, require
from twin_gait.runs.log_files import LogTable, number_of, read_table
from twin_gait.vocabulary import JointName, Side

# A log whose instants are those of the ticks to this precision is taken as it is.
SAME_INSTANT = 1e-6  # [s]
# A knee bends backwards by a few degrees at most; beyond this the sign convention is the wrong one.
FURTHEST_BACKWARDS = -30.0  # [deg]
LARGEST_ANGLE = 180.0  # [deg]; beyond it degrees were taken for radians
LONGEST_GAP, GAP_ROWS = 0.1, 5.0  # [s] and usual rows: a longer gap hides switches


@dataclass(frozen=True, eq=False)
class Recording:
    """A walk, one value a tick."""

    source: str  # where it comes from, for messages and titles
    start: float  # time of the first tick in [s]
    # of each joint of each leg in [rad], flexion and dorsiflexion positive, shape ``(n,)``
    angles: Mapping[tuple[Side, str], np.ndarray]
    loads: Mapping[Side, np.ndarray]  # normal force of the foot in [N], where it was recorded, shape ``(n,)``
    phases: Mapping[Side, np.ndarray]  # recorded phase by name, where there is one, shape ``(n,)``
    # signals of the device by name in SI, where they were recorded, shape ``(n,)``
    device: Mapping[str, np.ndarray] = field(default_factory=dict)
    body_weight: float | None = None  # of wearer and device in [N], for guards on the load of the foot
    # phase in which a leg begins, where it is not the recorded one of tick 0
    starts: Mapping[Side, str] = field(default_factory=dict)
    # phases into which operating modes sent both legs, by tick
    postures: Mapping[int, str] = field(default_factory=dict)
    fast_time_constant: float = SensorParameters.fast_time_constant  # of the velocity estimate in [s]

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


def _mistakes(time: np.ndarray, angles: Mapping[tuple[Side, str], np.ndarray]) -> Iterator[tuple[str, str]]:
    """What is wrong with the instants of a log, then with the unit or sign of its angles: key and text."""
    if len(time) < 2:
        yield "time", f"expected at least two samples, got {len(time)}"
    steps, duration = np.diff(time), time[-1] - time[0]
    row, last = int(steps.argmax()), int(steps.argmin())
    if steps[last] < SAME_INSTANT:
        yield "time", f"must ascend, but {time[last + 1]:g} s follows {time[last]:g} s in row {last + 2}"
    if not TICK <= duration <= LONGEST_RUN:
        yield "time", f"spans {duration:g} s; expected seconds, {TICK:g} to {LONGEST_RUN:g}: cut it"
    if steps[row] > max(LONGEST_GAP, GAP_ROWS * float(np.median(steps))):
        text = f"has no rows for {steps[row]:.3g} s from {time[row]:g} s on (row {row + 1}); cut it there"
        yield "time", text
    for (side, joint), values in angles.items():
        degrees = np.degrees(values)
        if np.abs(degrees).max() > LARGEST_ANGLE:
            text = f"reaches {np.abs(degrees).max():.4g} deg; are the --units of the log right?"
            yield f"{side} {joint}", text
        if joint == JointName.KNEE and degrees.min() < FURTHEST_BACKWARDS:
            text = f"bends backwards by {-degrees.min():.0f} deg; flexion must come out positive"
            yield f"{side} {joint}", f"{text}, so choose the --convention and --units of the log"


TIME = "time"
_UNIT_ENDINGS = {"_rad": RADIANS, "_deg": DEGREES, "[rad]": RADIANS, "[deg]": DEGREES, "(deg)": DEGREES}
_ANGLES = {f"{side}_{joint}_angle": (side, joint) for side, joint in product(Side, JointName)}
_LOADS = {side: f"{side}_foot_normal_force" for side in Side}
_PHASES = {side: f"{side}_phase" for side in Side}
_OF_DEVICE = {signal.field: signal for signal in DEVICE_SIGNALS if signal.column}
# By quantity what its column is usually called. The controller saw the measured angle; a log of another
# device may have degrees.
_USUAL: Mapping[str, tuple[str, ...]] = {
    TIME: ("time_s", "time", "Time", "t"),
    **{name: (f"{name[:-5]}measured_angle_rad", f"{name}_rad", f"{name}_deg") for name in _ANGLES},
    **{name: (f"{name}_N",) for name in _LOADS.values()},
    **{name: (name,) for name in _PHASES.values()},
    **{name: (signal.column,) for name, signal in _OF_DEVICE.items()},
}


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """How to read a log."""

    # names and signs of the angles; None takes this package's own, and asks for one for files of OpenSim,
    # whose models differ
    convention: Convention | None = None
    # column of a quantity, where it has a name of its own: ``{"left_hip_angle": "hip_l"}``
    columns: Mapping[str, str] = field(default_factory=dict)
    units: str | None = None  # ``rad`` or ``deg``, for columns that do not say

    def __post_init__(self) -> None:
        """Check names and units."""
        for quantity in self.columns:
            if quantity not in _USUAL:
                raise ParameterError(f"columns: no quantity {quantity!r}; there are {', '.join(_USUAL)}")
        require(self.units in (None, RADIANS, DEGREES), "units", "rad or deg", self.units)


def read_recording(path: Path, log_format: LogFormat | None = None) -> Recording:
    """Read a recorded walk.

    ``path``: a .parquet or .csv file with columns such as ``left_hip_angle_rad``, or any with the names
    given; or a .mot or .sto file of OpenSim; ``log_format``: how to read it. Returns the walk at the ticks of
    the controller, in the signs of this package. Raises ParameterFileError if the file has a mistake; the
    message names file, column and the way out. Of a run whose legs were held, what comes before it.
    """
    table, log_format = read_table(path), log_format or LogFormat()
    if "safety_state" in table:  # from a trip on no guard moves the legs
        held = np.flatnonzero(table.numbers("safety_state") == SafetyState.HOLD.code)
        table = replace(table, frame=table.frame.iloc[: held[0]]) if len(held) else table
    if log_format.convention is None and table.opensim:
        text = (
            "OpenSim's models differ in the sign of the knee: add --convention opensim_gait2392 "
            "(flexion negative) or rajagopal (flexion positive)"
        )
        raise ParameterFileError(table.source, "convention", text)
    convention = log_format.convention or HOUSE
    found = _columns_of(table, log_format, convention)

    def radians(column: str) -> np.ndarray:
        # The unit that the name of a column says, else the file, the user, the convention.
        stated = (unit for ending, unit in _UNIT_ENDINGS.items() if column.lower().endswith(ending))
        unit = next(stated, table.unit) or log_format.units or convention.unit
        if unit is None:
            problem = "does not say its unit: add --units deg or --units rad"
            raise ParameterFileError(table.source, column, problem)
        return np.radians(table.numbers(column)) if unit == DEGREES else table.numbers(column)

    angles: dict[tuple[Side, str], np.ndarray] = {
        (side, joint): convention.turned(joint, radians(found[name]))
        for name, (side, joint) in _ANGLES.items()
        if name in found
    }
    loads = {side: table.numbers(found[name]) for side, name in _LOADS.items() if name in found}
    phases = {side: table.words(found[name]) for side, name in _PHASES.items() if name in found}
    device = {
        signal.name: (radians if signal.column.endswith("_rad") else table.numbers)(found[name])
        for name, signal in _OF_DEVICE.items()
        if name in found
    }
    recording = Recording(table.source, 0.0, angles, loads, phases, device)
    return at_ticks(recording, table.numbers(found.get(TIME, TIME)))


def _columns_of(table: LogTable, log_format: LogFormat, convention: Convention) -> dict[str, str]:
    """By quantity the column that was named for it, or else the first of its usual ones that there is."""
    usual = dict(_USUAL)
    if convention.name != HOUSE.name:
        own = convention.columns
        usual |= {name: (own[place],) if place in own else () for name, place in _ANGLES.items()}
    named = {quantity: table.full_name(column) for quantity, column in log_format.columns.items()}
    known = {quantity: next(filter(table.__contains__, names), None) for quantity, names in usual.items()}
    found = {**{quantity: column for quantity, column in known.items() if column}, **named}
    if not _ANGLES.keys() & found.keys():
        names = ", ".join(convention.columns.values()) or f"columns, of which {convention.name} names none"
        way_out = "name the columns with --columns, or choose one of --convention"
        text = f"has none of {names}; {way_out} {', '.join(CONVENTIONS)}"
        raise ParameterFileError(table.source, "", text)
    return found


KOOPMAN, WINTER = "koopman", "winter"


def is_normative(name: str) -> bool:
    """Whether a name asks for a walk from the literature."""
    return name == WINTER or name.startswith(f"{KOOPMAN}@")


def normative_walk(name: str, *, strides: int = 8) -> Recording:
    """A walk of curves from the literature; the left leg begins at heel contact, the right one mid-stride.

    ``name``: ``koopman@1.5`` for the regression of Koopman et al. (2014) at a walking speed in km/h, or
    ``winter`` for the means of Winter (1991) at natural cadence; ``strides``: how many. Raises ParameterError
    if there is no such walk, or the regression does not reach the speed.
    """
    curve: Callable[[JointName, np.ndarray], np.ndarray] = reference.normative_angle
    joints: tuple[JointName, ...] = reference.WINTER_JOINTS
    cycle_time = reference.WINTER_CYCLE_TIME
    if name != WINTER:
        kind, _, text = name.partition("@")
        speed, height = number_of(text) / reference.KILOMETRES_PER_HOUR, Patient().height
        expected = f"{WINTER}, or {KOOPMAN}@ and the speed in km/h"
        require(kind == KOOPMAN and math.isfinite(speed), "log", expected, name)
        curve = partial(reference.reference_curve, speed=speed, height=height)
        joints, cycle_time = tuple(JointName), reference.reference_cycle_time(speed, height)
    time = np.arange(round(strides * cycle_time / TICK)) * TICK
    angles = dict[tuple[Side, str], np.ndarray]()
    for side, lead in ((Side.LEFT, 0.0), (Side.RIGHT, 0.5)):
        percent = reference.CYCLE * np.mod(time / cycle_time + lead, 1.0)
        angles |= {(side, joint): curve(joint, percent) for joint in joints}
    return Recording(name, 0.0, angles, {}, {})
