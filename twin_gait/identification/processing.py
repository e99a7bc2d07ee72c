"""From a log to samples of speed and friction torque (thesis 2.3.1, 2.3.2 and 3.1)."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification import signals
from twin_gait.identification.bench import BenchSetup, Processing, ProcessingOptions
from twin_gait.identification.plausibility import FEWEST, clean
from twin_gait.identification.reading import Log, Quantity
from twin_gait.identification.samples import FrictionTest
from twin_gait.identification.signals import decimate, moving_average, zero_phase

RATE = 100.0  # [Hz] of the samples that a fit sees, the thesis's
WINDOW = 10  # samples of the thesis's moving average
_SLOWEST = 50.0  # [Hz] of a log whose acceleration can be used
# Of 1/cutoff. So long after an impulse 1e-4 of the filter's response is left. After 1/cutoff it is 0.7 %:
# with the jump of friction in a reversal the break-away velocity of the knee is 0.1 % too large.
REVERSAL_REACH = 2.0
_UNEVEN = 0.02  # of a period, beyond which a log is put on an even grid
# Without a sample, in periods, and in shares of 1/cutoff: across so little the filter sees the same curve.
_GAP, _SHORT = 1.5, 0.125
_STANDSTILL = 0.002  # [rad] / [s] that a log of a bench must exceed


def process_log(log: Log, bench: BenchSetup | None, options: ProcessingOptions) -> FrictionTest:
    """Turn a log into samples of friction torque; without a bench only friction torques are expected.

    Raises ParameterFileError if the log lacks what is needed, or cannot be what it is read as.
    """
    log, counts, notes = clean(log, joint_known=bench is not None)
    series = bench is None or Quantity.FRICTION_TORQUE in log.columns
    told = (Quantity.VELOCITY, Quantity.FRICTION_TORQUE) if series else (Quantity.TIME, Quantity.ANGLE)
    for quantity in told:
        values = _needed(log, quantity)
        if np.ptp(values) == 0.0:
            text = f"is {values[0]:g} in every row; nothing can be fitted"
            raise ParameterFileError(log.source, quantity, text)
    usual, slowest = (Processing.NONE, 0.0) if series else (Processing.ZERO_PHASE, _STANDSTILL)
    options = replace(options, processing=options.processing or usual)
    if options.standstill_velocity is not None:
        slowest = options.standstill_velocity
    column = log.columns.get(Quantity.MASS)
    log = replace(log, mass=log.mass if column is None else float(np.median(column)))
    if series:
        test = _series(log, options, slowest)
    else:
        assert bench is not None  # else it is a series
        test = _balance(log, bench, options, slowest)
    return replace(test, counts={**counts, **test.counts, "used": int(test.used.sum())}, notes=notes)


def _series(log: Log, options: ProcessingOptions, slowest: float) -> FrictionTest:
    """A plain series of velocity and friction torque."""
    velocity, torque = log.columns[Quantity.VELOCITY], log.columns[Quantity.FRICTION_TORQUE]
    if options.processing is Processing.THESIS:
        velocity = moving_average(velocity, WINDOW)
    elif options.processing is Processing.ZERO_PHASE:
        rate, cutoff = _rate(log, options)
        velocity, torque = zero_phase(velocity, cutoff, rate), zero_phase(torque, cutoff, rate)
    used = np.abs(velocity) >= slowest
    return FrictionTest(
        name=Path(log.source).name,
        velocity=velocity,
        torque=torque,
        used=used,
        time=log.columns.get(Quantity.TIME),
        angle=log.columns.get(Quantity.ANGLE),
        load=log.columns.get(Quantity.LOAD_TORQUE),
        temperature=log.columns.get(Quantity.TEMPERATURE),
        mass=log.mass,
        counts={"standstill": int((~used).sum())},
    )


def _balance(log: Log, bench: BenchSetup, options: ProcessingOptions, slowest: float) -> FrictionTest:
    """Friction torque at 100 Hz by the balance of torques, equation (2.12)."""
    mass, (rate, cutoff) = _weight(log, bench), _rate(log, options)
    time, columns, recorded = _even(log, rate, cutoff)
    thesis, filtered = (options.processing is item for item in (Processing.THESIS, Processing.ZERO_PHASE))
    step, guard = max(1, round(rate / RATE)), WINDOW if thesis else int(np.ceil(rate / cutoff))
    shortest = (WINDOW + FEWEST) * step if thesis else 4 * guard + FEWEST
    if len(time) < shortest:
        text = f"lasts {len(time) / rate:.3g} s; expected at least {shortest / rate:.2g}"
        raise ParameterFileError(log.source, "time", text)

    def smooth(values: np.ndarray) -> np.ndarray:
        """Angle, current and load go through the same filter."""
        return zero_phase(values, cutoff, rate) if filtered else values

    raw = bench.joint_angle(columns[Quantity.ANGLE])
    angle, load = smooth(raw), decimate(smooth(bench.load_torque(raw, mass)), step)
    motor_torque = decimate(smooth(bench.motor_torque(columns[_current(log, options)])), step)
    if thesis:
        speed = columns.get(Quantity.VELOCITY, np.gradient(raw, 1.0 / rate))
        motion = _late_motion(decimate(speed, step), decimate(recorded, step), rate / step)
    else:
        motion = tuple(decimate(item, step) for item in _motion(angle, recorded, rate, guard))
    velocity, acceleration, settled = motion
    angle, inertial = decimate(angle, step), bench.inertia(mass) * acceleration
    torque = motor_torque + load - inertial
    stopped = signals.hard_stop(angle, _impact(raw, cutoff, rate, step), int(RATE / cutoff))
    kept = settled & ~stopped
    if kept.any():
        told = (angle, velocity, torque, inertial)
        stopped[kept] |= signals.soft_stop(*(values[kept] for values in told))
    standing = ~stopped & (np.abs(velocity) < slowest)
    # So near a fast reversal the filter mixes friction of both directions: what comes out of it is the
    # filtered friction, not the friction at the filtered velocity.
    near = np.abs(velocity) < REVERSAL_REACH * np.abs(acceleration) / cutoff
    turning = ~stopped & ~standing & near & filtered
    rejected = {"stop": stopped, "standstill": standing, "reversal": turning}
    temperature = columns.get(Quantity.TEMPERATURE)
    return FrictionTest(
        name=Path(log.source).name,
        velocity=velocity,
        torque=torque,
        used=settled & ~stopped & ~standing & ~turning,
        time=decimate(time, step),
        angle=angle,
        load=load,
        temperature=None if temperature is None else decimate(smooth(temperature), step),
        mass=mass,
        counts={
            "after_decimation": len(torque),
            **{cause: int((samples & settled).sum()) for cause, samples in rejected.items()},
            "edge": int((~settled).sum()),
        },
    )


def _weight(log: Log, bench: BenchSetup) -> float:
    """The weight on the link in [kg]."""
    mass = bench.mass if log.mass is None else log.mass
    if mass is None:
        text = (
            "does not say which weight hung on the link: add --mass, a line '# mass_kg: 2.5', or name the "
            "file so (knee_2.5kg_1.log)"
        )
        raise ParameterFileError(log.source, "mass", text)
    return mass


def _motion(angle: np.ndarray, recorded: np.ndarray, rate: float, guard: int) -> tuple[np.ndarray, ...]:
    """Velocity and acceleration, and where only recorded samples are within so many: from the angle."""
    velocity = np.gradient(angle, 1.0 / rate)
    settled = ~signals.widened(~recorded, guard)
    settled[:guard] = settled[-guard:] = False
    return velocity, np.gradient(velocity, 1.0 / rate), settled


def _late_motion(speed: np.ndarray, recorded: np.ndarray, rate: float) -> tuple[np.ndarray, ...]:
    """The same by the thesis: the velocity alone is averaged, and so late against current and load."""
    velocity = moving_average(speed, WINDOW)
    settled = ~signals.widened(~recorded, WINDOW)
    settled[: WINDOW - 1] = settled[-1:] = False
    return velocity, signals.forward_difference(velocity, 1.0 / rate), settled


def _needed(log: Log, quantity: Quantity) -> np.ndarray:
    if quantity not in log.columns:
        text = f"no such column; name one with --columns {quantity}=NAME"
        raise ParameterFileError(log.source, quantity, text)
    return log.columns[quantity]


def _rate(log: Log, options: ProcessingOptions) -> tuple[float, float]:
    """Sampling rate in [Hz], and the cutoff that it allows: a slow log less."""
    rate = 1.0 / float(np.median(np.diff(_needed(log, Quantity.TIME))))
    return rate, min(options.cutoff, 0.2 * rate)


def _even(log: Log, rate: float, cutoff: float) -> tuple[np.ndarray, dict[Quantity, np.ndarray], np.ndarray]:
    """Put a log on an even grid: time, columns, and where there were samples."""
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
        text = f"has gaps that are {number / len(time):.0f} times as long as what was recorded"
        raise ParameterFileError(log.source, "time", text)
    grid = time[0] + np.arange(number) / rate
    columns = {quantity: np.interp(grid, time, values) for quantity, values in log.columns.items()}
    bridged = max(_GAP, _SHORT * rate / cutoff)
    before = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 2)
    return grid, columns, (time[before + 1] - time[before]) * rate < bridged


def _current(log: Log, options: ProcessingOptions) -> Quantity:
    """The current that drives: the one asked for, else the usual one of the processing, else the other."""
    order = [Quantity.MEASURED_CURRENT, Quantity.TARGET_CURRENT]
    if options.processing is Processing.THESIS:
        order.reverse()
    if options.current is not None:
        order = [Quantity(f"{options.current}_current")]
    found = next((quantity for quantity in order if quantity in log.columns), order[0])
    _needed(log, found)
    return found


def _impact(angle: np.ndarray, cutoff: float, rate: float, step: int) -> np.ndarray:
    """Largest acceleration up to the next decimated sample in [rad] / [s²], from the zero-phase angle.

    A late average would hide an impact, and so would a sample beside its peak.
    """
    velocity = np.gradient(zero_phase(angle, cutoff, rate), 1.0 / rate)
    acceleration = np.abs(np.gradient(velocity, 1.0 / rate))
    return np.asarray(np.maximum.reduceat(acceleration, np.arange(0, len(angle), step)))
