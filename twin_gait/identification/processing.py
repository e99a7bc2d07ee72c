"""Processing of logs of the joint test bench to speed and friction torque (thesis 2.2.1, 2.3 and 3.1)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.identification import signals
from twin_gait.identification.models import FrictionTest, join_tests
from twin_gait.identification.reading import FEWEST, Log, Quantity, clean
from twin_gait.identification.signals import moving_average, zero_phase
from twin_gait.parameters import quantities
from twin_gait.parameters.drives import ActuatorParameters
from twin_gait.worlds.bench_joint import BENCH_STOPS, HORIZONTAL, MOMENT, LoadAngle

_GRAVITY = 9.81  # [m/s²]


@dataclass(frozen=True, kw_only=True)
class BenchSetup(quantities.Parameters):
    """Test bench of one joint (thesis 2.2.1).

    Attributes:
        actuator: Motor and gear.
        mass: Mass on the link in [kg], used if the name of a log does not contain it.
        lever: Lever b, from the axis to the weight, in [m]. The thesis does not print it: an assumption.
        link_inertia: Inertia of the link about the axis in [kg·m²]; an assumption.
        link_moment: Mass of the link times the distance of its centre from the axis in [kg·m].
        start_angle: Angle to which the first angle of a log is set in [rad]; None leaves the angles
            unchanged.
        load_angle: Form of the load torque.
        mass_as_printed: Whether J_mass is m b, as printed, instead of m b².
        current_delay: Time in [s] by which the current leads the angle in the logs, and by which it is
            delayed. A current that is logged at the start of the period in which it is held leads by half a
            period.
    """

    actuator: ActuatorParameters
    mass: Annotated[quantities.Mass | None, quantities.NOT_NEGATIVE] = None
    lever: Annotated[quantities.Length, quantities.POSITIVE] = 0.30
    link_inertia: Annotated[quantities.Inertia, quantities.NOT_NEGATIVE] = 0.02
    link_moment: Annotated[float, MOMENT, quantities.NOT_NEGATIVE] = 0.0
    start_angle: Annotated[quantities.Angle | None, BENCH_STOPS] = HORIZONTAL
    load_angle: LoadAngle = LoadAngle.CORRECTED
    mass_as_printed: bool = False
    current_delay: Annotated[
        quantities.Time, quantities.Range(-0.05, 0.05, reason="fifty samples at 1 kHz")
    ] = 0.0

    def load_torque(self, angle: np.ndarray, mass: float | np.ndarray) -> np.ndarray:
        """Compute the torque of gravity on the joint in [N·m], equation (2.8); positive along the fall.

        ``angle``: joint angle in [rad], shape ``(n,)``. ``mass``: mass on the link in [kg].
        """
        tilt = angle - HORIZONTAL if self.load_angle is LoadAngle.CORRECTED else angle
        return np.asarray(_GRAVITY * (mass * self.lever + self.link_moment) * np.cos(tilt))

    def inertia(self, mass: float | np.ndarray) -> float | np.ndarray:
        """Compute J of equation (2.12) at the joint in [kg·m²]: armature, link and weight."""
        weight = mass * self.lever if self.mass_as_printed else mass * self.lever * self.lever
        return self.actuator.armature + self.link_inertia + weight


class Processing(StrEnum):
    """Smoothing of a log of a bench before the friction torque is computed; a series is not smoothed."""

    ZERO_PHASE = "zero_phase"  # the same filter without delay for angle, current and load
    THESIS = "thesis"  # decimate by 10, moving average of 10 over the velocity alone, forward difference


CUTOFF = 40.0  # [Hz], cutoff of the zero-phase filter; a fifth of the rate of a slow log
RATE = 100.0  # [Hz], rate of the samples of a fit, as in the thesis
WINDOW = 10  # samples of the thesis's moving average
_SLOWEST = 50.0  # [Hz], least rate of a log whose acceleration can be used
# Reach of the filter in units of 1/cutoff. At this time after an impulse 1e-4 of the filter's response is
# left. After 1/cutoff it is 0.7 %: with the jump of friction in a reversal the break-away velocity of the
# knee would be 0.1 % too large.
REVERSAL_REACH = 2.0
_UNEVEN = 0.02  # deviation in periods beyond which a log is interpolated to an even grid
# Gaps without a sample, in periods and in shares of 1/cutoff, that are interpolated because the filter
# removes the difference.
_GAP, _SHORT = 1.5, 0.125
_STANDSTILL = 0.002  # [rad/s], speed that samples of a bench must exceed


def process_log(
    log: Log, bench: BenchSetup | None, processing: Processing = Processing.ZERO_PHASE
) -> FrictionTest:
    """Convert a log to samples of friction torque; without a bench only friction torques are expected.

    Raises ParameterFileError if the log lacks a needed column, or its columns contradict their names.
    """
    log, counts, notes = clean(log, joint_known=bench is not None)
    series = Quantity.FRICTION_TORQUE in log.columns
    required = (Quantity.TIME, Quantity.ANGLE)
    if bench is None or series:
        required = (Quantity.VELOCITY, Quantity.FRICTION_TORQUE)
    for quantity in required:
        values = _needed(log, quantity)
        if np.ptp(values) == 0.0:
            text = f"is {values[0]:g} in every row; nothing can be fitted"
            raise ParameterFileError(log.source, quantity, text)
    test = _series(log) if bench is None or series else _balance(log, bench, processing)
    return replace(test, counts={**counts, **test.counts, "used": int(test.used.sum())}, notes=notes)


def _series(log: Log) -> FrictionTest:
    """Return a plain series of velocity and friction torque, as it was recorded."""
    return FrictionTest(
        name=Path(log.source).name,
        velocity=log.columns[Quantity.VELOCITY],
        torque=log.columns[Quantity.FRICTION_TORQUE],
        used=np.ones(len(log), dtype=bool),
        time=log.columns.get(Quantity.TIME),
        angle=log.columns.get(Quantity.ANGLE),
        load=log.columns.get(Quantity.LOAD_TORQUE),
        temperature=log.columns.get(Quantity.TEMPERATURE),
        mass=log.mass,
    )


def _balance(log: Log, bench: BenchSetup, processing: Processing) -> FrictionTest:
    """Compute the friction torque at 100 Hz by the balance of torques, equation (2.12)."""
    mass, thesis = bench.mass if log.mass is None else log.mass, processing is Processing.THESIS
    if mass is None:
        text = "is not known; add --mass, or state it in the name of the file, such as knee_2.5kg_1.log"
        raise ParameterFileError(log.source, "mass", text)
    rate = 1.0 / float(np.median(np.diff(log.columns[Quantity.TIME])))
    cutoff = min(CUTOFF, 0.2 * rate)
    time, columns, recorded = _even(log, rate, cutoff)
    step, guard = max(1, round(rate / RATE)), WINDOW if thesis else int(np.ceil(rate / cutoff))
    shortest = (WINDOW + FEWEST) * step if thesis else 4 * guard + FEWEST
    if len(time) < shortest:
        text = f"lasts {len(time) / rate:.3g} s; expected at least {shortest / rate:.2g}"
        raise ParameterFileError(log.source, "time", text)

    def smooth(values: np.ndarray) -> np.ndarray:
        """Filter angle, current and load equally."""
        return values if thesis else zero_phase(values, cutoff, rate)

    raw = columns[Quantity.ANGLE]
    if bench.start_angle is not None:
        raw = raw - raw[0] + bench.start_angle
    angle, load = smooth(raw), smooth(bench.load_torque(raw, mass))[::step]
    currents = (Quantity.TARGET_CURRENT, Quantity.MEASURED_CURRENT)[:: 1 if thesis else -1]
    current = next(filter(columns.__contains__, currents), currents[0])
    _needed(log, current)
    motor_torque = columns[current] * bench.actuator.torque_constant * bench.actuator.gear_ratio  # K_t τ I
    motor_torque = np.interp(time - bench.current_delay, time, smooth(motor_torque))
    if thesis:
        speed = columns.get(Quantity.VELOCITY, np.gradient(raw, 1.0 / rate))
        motion = _late_motion(speed[::step], recorded[::step], rate / step)
    else:
        motion = tuple(item[::step] for item in _motion(angle, recorded, rate, guard))
    velocity, acceleration, settled = motion
    angle, inertial = angle[::step], bench.inertia(mass) * acceleration
    torque = motor_torque[::step] + load - inertial
    stopped = signals.hard_stop(angle, _impact(raw, cutoff, rate, step), int(RATE / cutoff))
    kept = settled & ~stopped
    if kept.any():
        balance = (angle, velocity, torque, inertial)
        stopped[kept] |= signals.soft_stop(*(values[kept] for values in balance))
    standing = ~stopped & (np.abs(velocity) < _STANDSTILL)
    # Near a fast reversal the filter mixes friction of both directions: its output is the filtered friction,
    # not the friction at the filtered velocity.
    near = np.abs(velocity) < REVERSAL_REACH * np.abs(acceleration) / cutoff
    turning = ~stopped & ~standing & near & (not thesis)
    rejected = {"stop": stopped, "standstill": standing, "reversal": turning}
    temperature = columns.get(Quantity.TEMPERATURE)
    return FrictionTest(
        name=Path(log.source).name,
        velocity=velocity,
        torque=torque,
        used=settled & ~stopped & ~standing & ~turning,
        time=time[::step],
        angle=angle,
        load=load,
        motor_rate=np.gradient(motor_torque, 1.0 / rate)[::step],
        temperature=None if temperature is None else smooth(temperature)[::step],
        mass=mass,
        counts={
            "after_decimation": len(torque),
            **{cause: int((samples & settled).sum()) for cause, samples in rejected.items()},
            "edge": int((~settled).sum()),
        },
    )


def _motion(angle: np.ndarray, recorded: np.ndarray, rate: float, guard: int) -> tuple[np.ndarray, ...]:
    """Compute velocity and acceleration, and whether only recorded samples are within ``guard``."""
    velocity = np.gradient(angle, 1.0 / rate)
    settled = ~signals.widened(~recorded, guard)
    settled[:guard] = settled[-guard:] = False
    return velocity, np.gradient(velocity, 1.0 / rate), settled


def _late_motion(speed: np.ndarray, recorded: np.ndarray, rate: float) -> tuple[np.ndarray, ...]:
    """Compute the same as in the thesis: only the velocity is averaged, so it lags current and load."""
    velocity = moving_average(speed, WINDOW)
    settled = ~signals.widened(~recorded, WINDOW)
    settled[: WINDOW - 1] = settled[-1:] = False
    return velocity, np.diff(velocity, append=velocity[-1]) * rate, settled


def _needed(log: Log, quantity: Quantity) -> np.ndarray:
    """Return a column; raise ParameterFileError if it is missing."""
    if quantity not in log.columns:
        text = f"there is no such column; name it with --columns {quantity}=NAME"
        raise ParameterFileError(log.source, quantity, text)
    return log.columns[quantity]


def _even(log: Log, rate: float, cutoff: float) -> tuple[np.ndarray, dict[Quantity, np.ndarray], np.ndarray]:
    """Interpolate a log to an even grid: time, columns, and whether there were samples."""
    if rate < 0.999 * _SLOWEST:
        text = (
            f"has {rate:.3g} samples per second; expected at least {_SLOWEST:g} to see the acceleration: is "
            "it in another unit (--units time=ms)?"
        )
        raise ParameterFileError(log.source, "time", text)
    time = log.columns[Quantity.TIME]
    if np.abs(np.diff(time) * rate - 1.0).max() < _UNEVEN:
        return time, dict(log.columns), np.ones(len(time), dtype=bool)
    number = int((time[-1] - time[0]) * rate) + 1
    if number > 20 * len(time):
        text = f"has gaps that are {number / len(time):.0f} times as long as the recorded time"
        raise ParameterFileError(log.source, "time", text)
    grid = time[0] + np.arange(number) / rate
    columns = {quantity: np.interp(grid, time, values) for quantity, values in log.columns.items()}
    bridged = max(_GAP, _SHORT * rate / cutoff)
    before = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 2)
    return grid, columns, (time[before + 1] - time[before]) * rate < bridged


def _impact(angle: np.ndarray, cutoff: float, rate: float, step: int) -> np.ndarray:
    """Compute the largest acceleration up to the next decimated sample in [rad/s²], without filter delay.

    The filter has zero phase, because a late average would hide an impact. All samples in between are used,
    because a single one could miss its peak.
    """
    velocity = np.gradient(zero_phase(angle, cutoff, rate), 1.0 / rate)
    acceleration = np.abs(np.gradient(velocity, 1.0 / rate))
    return np.asarray(np.maximum.reduceat(acceleration, np.arange(0, len(angle), step)))


_SPEEDS = 100  # classes of speed, with equal numbers of samples
# Least RMS of the part of the load that is independent of the speed, for a statement about the load [N·m].
_SIGNIFICANT_LOAD = 0.5
# Limits of warnings; load-dependent friction of a one-way fall, or a slightly wrong inertia, have smaller
# effects.
_GAIN, _TILT = 0.15, 8.0  # relative error of the load's size, and error of its angle in [deg]


def balance_warnings(
    tests: Sequence[FrictionTest], bench: BenchSetup | None, processing: Processing
) -> list[str]:
    r"""Check whether the motor carries the weight that the bench setup states, and return a warning if not.

    Friction of any law depends on the speed. With a load that is truly g times as large, at angles that are δ
    smaller, the balance of torques is
    :math:`f(\omega) + (1 - g \cos\delta)\,F\ell\cos\varphi - g \sin\delta\,F\ell\sin\varphi` at the angle φ
    from the horizontal; its parts are separated within classes of equal speed. The thesis's late velocity
    would look like such an angle, and has a warning of its own. Raises ParameterError if the current has the
    sign of a weight that pulls upwards.
    """
    tests = [test for test in tests if test.from_bench]
    if bench is None or not tests:
        return []
    if processing is Processing.THESIS:
        late = 0.5 * (WINDOW - 1) / RATE
        text = f"the thesis's processing delays the velocity by {1e3 * late:.0f} ms against current and load"
        return [f"{text}: the parameters are biased (--processing zero_phase)"]
    rows = join_tests(tests)
    mass = np.array([test.mass for test in tests], dtype=float)[rows.test]
    load, across = (bench.load_torque(np.asarray(rows.angle) - turn, mass) for turn in (0.0, np.pi / 2))
    columns = {"speed": rows.velocity, "load": load, "across": across, "torque": rows.torque}
    table = pd.DataFrame(columns)[rows.used]
    classes = pd.qcut(table.pop("speed"), _SPEEDS, labels=False, duplicates="drop")
    rest = (table - table.groupby(classes).transform("mean")).to_numpy()
    share, _, _, sizes = np.linalg.lstsq(rest[:, :2], rest[:, 2])
    if sizes[-1] < _SIGNIFICANT_LOAD * np.sqrt(len(rest)):
        return []
    true = complex(1.0 - share[0], -share[1])
    if true.real < 0.0:
        raise ParameterError(
            "logs: according to the current, the weight pulls upwards; make current and angle positive along "
            "the fall: --columns measured_current=-NAME,angle=-NAME"
        )
    gain, tilt = float(abs(true)), float(np.angle(true, deg=True))
    if abs(gain - 1.0) < _GAIN and abs(tilt) < _TILT:
        return []
    return [
        f"according to the current, the weight's torque is {gain:.2f} times that of mass and lever, and the "
        f"angle {tilt:+.0f}° too large (expected 1 and 0): check --joint or --torque-constant, --gear-ratio "
        "and --rotor-inertia of the motor, --mass, --lever-m, --link-inertia-kgm2, the unit of the current, "
        "and --start-angle-deg for logs that do not begin with the link horizontal"
    ]
