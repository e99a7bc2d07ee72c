"""From a log to samples of speed and friction torque (thesis 2.3.1, 2.3.2 and 3.1)."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin_gait.exceptions import ParameterFileError
from twin_gait.identification import signals
from twin_gait.identification.bench import BenchSetup, Processing, ProcessingOptions
from twin_gait.identification.plausibility import FEWEST, clean
from twin_gait.identification.reading import Log, Quantity
from twin_gait.identification.samples import FrictionTest
from twin_gait.identification.signals import decimate, moving_average, zero_phase
from twin_gait.parameters.quantities import taken_from

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


@dataclass(frozen=True, eq=False)
class _Motion:
    """Signals of a test after the filter, all of the same shape."""

    time: np.ndarray
    angle: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    impact: np.ndarray  # acceleration at which stops are looked for, the same whatever the processing
    motor_torque: np.ndarray
    load: np.ndarray
    temperature: np.ndarray | None
    settled: np.ndarray  # where the filter saw recorded samples only


def process_log(log: Log, bench: BenchSetup | None, options: ProcessingOptions) -> FrictionTest:
    """Turn a log into samples of friction torque; without a bench only friction torques are expected.

    Raises ParameterFileError if the log lacks what is needed, or cannot be what it is read as.
    """
    log, counts, notes = clean(log, joint_known=bench is not None)
    series = Quantity.FRICTION_TORQUE in log.columns
    usual, slowest = (Processing.NONE, 0.0) if series else (Processing.ZERO_PHASE, _STANDSTILL)
    options = replace(options, processing=options.processing or usual)
    if options.standstill_velocity is not None:
        slowest = options.standstill_velocity
    if series:
        test = _series(log, options, slowest)
    elif bench is not None:
        test = _balance(log, bench, options, slowest)
    else:
        text = "no such column; name one with --columns friction_torque=NAME"
        raise ParameterFileError(log.source, "friction_torque", text)
    return replace(test, counts={**counts, **test.counts, "used": int(test.used.sum())}, notes=notes)


def _series(log: Log, options: ProcessingOptions, slowest: float) -> FrictionTest:
    """A plain series of velocity and friction torque."""
    velocity = _needed(log, Quantity.VELOCITY)
    torque = log.columns[Quantity.FRICTION_TORQUE]
    for name, values in ((Quantity.VELOCITY, velocity), (Quantity.FRICTION_TORQUE, torque)):
        if np.ptp(values) == 0.0:
            text = f"is {values[0]:g} in every row; nothing can be fitted"
            raise ParameterFileError(log.source, name, text)
    if options.processing is not Processing.NONE and Quantity.TIME not in log.columns:
        raise ParameterFileError(log.source, "time", "no such column; a filter needs it")
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
        mass=_stated_mass(log),
        counts={"standstill": int((~used).sum())},
    )


def _balance(log: Log, bench: BenchSetup, options: ProcessingOptions, slowest: float) -> FrictionTest:
    """Friction torque by the balance of torques, equation (2.12)."""
    stated = _stated_mass(log)
    mass = bench.mass if stated is None else stated
    if mass is None:
        text = (
            "does not say which weight hung on the link: add --mass, a line '# mass_kg: 2.5', or name the "
            "file so (knee_2.5kg_1.log)"
        )
        raise ParameterFileError(log.source, "mass", text)
    _needed(log, Quantity.TIME)
    options = replace(options, cutoff=_rate(log, options)[1])  # a slow log allows less
    motion = _motion(log, bench, mass, options)
    inertial = bench.inertia(mass) * motion.acceleration
    torque = motion.motor_torque + motion.load - inertial
    stopped = _stopped(motion, torque, inertial, options.cutoff)
    standing = ~stopped & (np.abs(motion.velocity) < slowest)
    filtered = options.processing is Processing.ZERO_PHASE
    turning = ~stopped & ~standing & filtered & _turning(motion, options.cutoff)
    rejected = {"stop": stopped, "standstill": standing, "reversal": turning}
    return taken_from(
        FrictionTest,
        motion,
        name=Path(log.source).name,
        torque=torque,
        used=motion.settled & ~stopped & ~standing & ~turning,
        mass=mass,
        counts={
            "after_decimation": len(torque),
            **{cause: int((samples & motion.settled).sum()) for cause, samples in rejected.items()},
            "edge": int((~motion.settled).sum()),
        },
    )


def _stated_mass(log: Log) -> float | None:
    """The weight in [kg] that a log's column, comments or name say."""
    column = log.columns.get(Quantity.MASS)
    return log.mass if column is None else float(np.median(column))


def _needed(log: Log, quantity: Quantity, other: str = "") -> np.ndarray:
    if quantity not in log.columns:
        text = f"no such column; name it, such as --columns {quantity}=NAME{other}"
        raise ParameterFileError(log.source, quantity, text)
    return log.columns[quantity]


def _rate(log: Log, options: ProcessingOptions) -> tuple[float, float]:
    """Sampling rate in [Hz], and the cutoff that it allows."""
    rate = 1.0 / float(np.median(np.diff(log.columns[Quantity.TIME])))
    return rate, min(options.cutoff, 0.2 * rate)


def _even(log: Log, rate: float, cutoff: float) -> tuple[np.ndarray, dict[Quantity, np.ndarray], np.ndarray]:
    """Put a log on an even grid: time, columns, and where there were samples."""
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


def _current(log: Log, columns: dict[Quantity, np.ndarray], options: ProcessingOptions) -> np.ndarray:
    order = [Quantity.MEASURED_CURRENT, Quantity.TARGET_CURRENT]
    if options.processing is Processing.THESIS:
        order.reverse()
    if options.current is not None:
        order = [Quantity(f"{options.current}_current")]
    found = next((quantity for quantity in order if quantity in columns), order[0])
    _needed(log, found, ", or friction_torque=NAME if that is known")
    return columns[found]


def _motion(log: Log, bench: BenchSetup, mass: float, options: ProcessingOptions) -> _Motion:
    """Signals of a test of the bench at 100 Hz.

    Zero phase: angle, current and load through the same filter; velocity and acceleration from the angle.
    The thesis: decimated signals, the velocity alone averaged, and so late against current and load.
    """
    _needed(log, Quantity.ANGLE)
    rate, cutoff = _rate(log, options)
    if rate < 0.999 * _SLOWEST:
        text = (
            f"has {rate:.3g} samples per second; expected at least {_SLOWEST:g} to see the acceleration: is "
            "it in another unit (--units time=ms)?"
        )
        raise ParameterFileError(log.source, "time", text)
    time, columns, recorded = _even(log, rate, cutoff)
    raw = bench.joint_angle(columns[Quantity.ANGLE])
    if np.ptp(raw) == 0.0:
        raise ParameterFileError(log.source, "angle", "is the same in every row; the joint never moved")
    motor_torque = bench.motor_torque(_current(log, columns, options))
    temperature = columns.get(Quantity.TEMPERATURE)
    thesis, step = options.processing is Processing.THESIS, max(1, round(rate / RATE))
    guard = WINDOW if thesis else int(np.ceil(rate / cutoff))
    shortest = (WINDOW + FEWEST) * step if thesis else 4 * guard + FEWEST
    if len(time) < shortest:
        text = f"lasts {len(time) / rate:.3g} s; expected at least {shortest / rate:.2g}"
        raise ParameterFileError(log.source, "time", text)

    def smooth(values: np.ndarray) -> np.ndarray:
        return zero_phase(values, cutoff, rate) if options.processing is Processing.ZERO_PHASE else values

    angle = smooth(raw)
    if thesis:
        speed = columns.get(Quantity.VELOCITY)
        speed = np.gradient(raw, 1.0 / rate) if speed is None else speed
        velocity = moving_average(decimate(speed, step), WINDOW)
        acceleration = signals.forward_difference(velocity, step / rate)
        load = bench.load_torque(decimate(angle, step), mass)
        settled = ~signals.widened(~decimate(recorded, step), guard)
        settled[: guard - 1] = settled[-1:] = False
    else:
        velocity = np.gradient(angle, 1.0 / rate)
        acceleration = decimate(np.gradient(velocity, 1.0 / rate), step)
        velocity, load = decimate(velocity, step), decimate(smooth(bench.load_torque(raw, mass)), step)
        settled = ~signals.widened(~recorded, guard)
        settled[:guard] = settled[-guard:] = False
        settled = decimate(settled, step)
    return _Motion(
        time=decimate(time, step),
        angle=decimate(angle, step),
        velocity=velocity,
        acceleration=acceleration,
        impact=_impact(raw, cutoff, rate, step),
        motor_torque=decimate(smooth(motor_torque), step),
        load=load,
        temperature=None if temperature is None else decimate(smooth(temperature), step),
        settled=settled,
    )


def _turning(motion: _Motion, cutoff: float) -> np.ndarray:
    """Samples so near a fast reversal that the filter mixes friction of both directions.

    The friction torque that comes out of a filter is the filtered friction, not the friction at the filtered
    velocity; the two part where the law bends within the filter's reach, 1/cutoff.
    """
    return np.asarray(np.abs(motion.velocity) < REVERSAL_REACH * np.abs(motion.acceleration) / cutoff)


def _impact(angle: np.ndarray, cutoff: float, rate: float, step: int) -> np.ndarray:
    """Largest acceleration up to the next decimated sample in [rad] / [s²], from the zero-phase angle.

    A late average would hide an impact, and so would a sample beside its peak.
    """
    velocity = np.gradient(zero_phase(angle, cutoff, rate), 1.0 / rate)
    acceleration = np.abs(np.gradient(velocity, 1.0 / rate))
    return np.asarray(np.maximum.reduceat(acceleration, np.arange(0, len(angle), step)))


def _stopped(motion: _Motion, torque: np.ndarray, inertial: np.ndarray, cutoff: float) -> np.ndarray:
    """Samples at a hard or a soft stop."""
    hard = signals.hard_stop(motion.angle, motion.impact, int(RATE / cutoff))
    kept = motion.settled & ~hard
    if kept.any():
        told = (motion.angle, motion.velocity, torque, inertial)
        hard[kept] |= signals.soft_stop(*(values[kept] for values in told))
    return hard
