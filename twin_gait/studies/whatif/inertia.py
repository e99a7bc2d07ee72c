"""How much of the joint's inertia can be compensated, by a differentiated encoder or an inertial unit?

Three parts: what becomes of a joint that a hand holds still, over source, delay and share, for a rigid and
a compliant gear; the largest stable shares by eigenvalues alone; and the noise of the torque beside the
inertia that a hand still feels. The linear witness is :mod:`twin_gait.studies.whatif.inertia_map`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from twin_gait.checking.hanging_leg import friction_slope
from twin_gait.checking.stability import largest_stable
from twin_gait.gait.table import TICK
from twin_gait.parameters import FrictionParameters, SensorParameters
from twin_gait.scenario.bench_joint import (
    INERTIAL_NOISE,
    BenchFriction,
    BenchJoint,
    InertialSensor,
    InertialUnit,
    Torsion,
)
from twin_gait.scenario.bench_leg import HandParameters
from twin_gait.simulation.bench_joint import BenchRun, simulate_bench
from twin_gait.studies.whatif.friction_joint import DEGREE, THESIS_RATIO
from twin_gait.studies.whatif.inertia_map import (
    InertiaLoop,
    Source,
    felt_inertia,
    growth,
    mean_delay,
    torque_noise,
)
from twin_gait.studies.whatif.rig import (
    HAND_AMPLITUDE,
    HAND_FREQUENCY,
    JOINT,
    LEVEL,
    MODEL,
    controlled,
    holding_torque,
    inertia,
    outcome,
    rig,
    root_mean_square,
)
from twin_gait.studies.whatif.work import Job, Means, Row, tables_of

SHARES = tuple(round(0.1 * step, 1) for step in range(1, 12))
# The encoder's delay is that of its filters; that of a unit lies between sample and use.
TIME_CONSTANTS = (0.001, 0.002, 0.005, 0.010, 0.020)  # [s]; 5 ms is the firmware's
DELAYS = (0, 2, 5, 10, 20)  # [ticks]
BUS_DELAY = 2  # [ticks], a bus of 500 Hz
LOAD = 2.0  # [kg]
THESIS_GAIN = 0.35  # G, the thesis's best
START_SPEED = 0.5  # [rad] / [s] of the joint that the hand catches
DURATION, SPAN = 12.0, 3.0  # [s]
UNDECIDED = 0.1  # [1] / [s]; slower growth or decay than this is not judged in a linear run
NOISE_SHARES = (0.25, 0.5, 0.75)
NOISE_FACTORS = (1.0, 10.0)  # on the noise of a common unit, and on the angle of an encoder count
FELT_FREQUENCY, FELT_AMPLITUDE = 1.0, 0.2  # [Hz], [rad]
_TINY = 1e-6  # [rad] / [s], start of a linear run
_LARGE = 1e-5  # [rad]; a linear motion that has come to this has grown, and may not be linear any more
_EARLY = (2.0, 3.0)  # [s]
_ROUNDING = 1e-13  # [rad]
_LARGEST_SHARE = 1.5


class Setting(NamedTuple):
    """One joint with inertia compensation.

    Attributes:
        source: Of the acceleration.
        time_constant: Of each filter behind the sensor in [s].
        delay: Ticks between a sample of a unit and its use; 0 for the encoder.
        share: Of the inertia that is compensated.
        compliant: Whether the gear is.
        held: Whether a hand holds the link.
        noise: Factor on the noise of the sensor; 0 for an ideal one.
    """

    source: Source
    time_constant: float
    delay: int = 0
    share: float = 0.0
    compliant: bool = False
    held: bool = True
    noise: float = 1.0


SENSORS = {
    Source.GYROSCOPE: InertialSensor.GYROSCOPE,
    Source.ACCELEROMETER: InertialSensor.ACCELEROMETER,
}


def bench_of(setting: Setting, friction: FrictionParameters, **control: float) -> BenchJoint:
    """The bench as a setting describes it.

    Args:
        setting: The setting.
        friction: True law.
        control: Attributes of the controller.

    Returns:
        The test; the hand holds still.
    """
    bench = rig(
        LOAD,
        friction=BenchFriction(law=friction),
        sensors=_sensors(setting),
        inertial_unit=_unit(setting),
        torsion=Torsion() if setting.compliant else None,
        hand=HandParameters(joint=JOINT, amplitude=0.0) if setting.held else None,
    )
    wanted = {"inertia_compensation": setting.share, "target_torque": holding_torque(bench), **control}
    return replace(bench, control=controlled(MODEL, **wanted))


def _sensors(setting: Setting) -> SensorParameters:
    firmware = SensorParameters().fast_time_constant
    filtered = setting.time_constant if setting.source is Source.ENCODER else firmware
    if setting.noise == 0.0:
        return SensorParameters(ideal=True, fast_time_constant=filtered)
    counts = round(SensorParameters().encoder_counts / setting.noise)
    return SensorParameters(ideal=False, fast_time_constant=filtered, encoder_counts=counts)


def _unit(setting: Setting) -> InertialUnit | None:
    if setting.source is Source.ENCODER:
        return None
    sensor = SENSORS[setting.source]
    return InertialUnit(
        sensor=sensor,
        noise=setting.noise * INERTIAL_NOISE[sensor],
        delay=setting.delay,
        time_constant=setting.time_constant,
    )


def viscous_law() -> FrictionParameters:
    """Friction of the linear joint: the slope of the true one at 1 rad/s."""
    slope = friction_slope(MODEL.scaled(THESIS_RATIO), 1.0)
    return FrictionParameters(
        breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=slope
    )


def linear_bench(setting: Setting, **control: float) -> BenchJoint:
    """The bench with a linear joint, without friction compensation.

    Args:
        setting: The setting.
        control: Attributes of the controller that differ.

    Returns:
        The test.
    """
    return bench_of(setting, viscous_law(), friction_compensation_gain=0.0, **control)


def loop_of(setting: Setting) -> InertiaLoop:
    """The linear loop of :func:`linear_bench`, for its matrix.

    Args:
        setting: The setting.

    Returns:
        The loop.
    """
    bench = linear_bench(setting)
    hand, torsion = bench.hand, bench.torsion
    return InertiaLoop(
        source=setting.source,
        share=setting.share,
        delay=setting.delay,
        time_constant=setting.time_constant,
        motor_inertia=bench.actuator.armature,
        link_inertia=bench.link.total_inertia,
        friction=bench.friction.law.viscous_friction,
        hand_stiffness=0.0 if hand is None else hand.stiffness,
        hand_damping=0.0 if hand is None else hand.damping,
        gear_stiffness=0.0 if torsion is None else torsion.stiffness,
        gear_damping=0.0 if torsion is None else torsion.damping,
    )


# ---------------------------------------------------------------------- who grows


def stability_row(setting: Setting) -> Row:
    """Predict whether a small motion grows, run it, and run the joint with its friction.

    Args:
        setting: The setting; its sensor is taken as ideal.

    Returns:
        A row.
    """
    ideal, law = setting._replace(noise=0.0), MODEL.scaled(THESIS_RATIO)
    true = bench_of(ideal, law, friction_compensation_gain=THESIS_GAIN)
    run = simulate_bench(replace(true, start_velocity=START_SPEED, duration=DURATION))
    ending, amplitude = outcome(run, SPAN)
    torque = run.column("motor_torque_Nm")[-round(SPAN / TICK) :]
    return {
        **_where(setting),
        "share": setting.share,
        "growth_per_s": round(growth(loop_of(setting)), 4),
        "linear_run_grows": linear_run_grows(setting),
        "ending": str(ending),
        "amplitude_deg": round(amplitude / DEGREE, 4),
        "torque_amplitude_Nm": round(0.5 * float(np.ptp(torque)), 3),
    }


def _where(setting: Setting) -> Row:
    return {
        "source": str(setting.source),
        "filter_ms": 1e3 * setting.time_constant,
        "bus_delay_ms": 1e3 * TICK * setting.delay,
        "mean_delay_ms": round(1e3 * mean_delay(loop_of(setting)), 3),
        "gear": "compliant" if setting.compliant else "rigid",
        "held": setting.held,
    }


def linear_run_grows(setting: Setting) -> bool:
    """Whether a small motion of the linear joint grows in the simulation.

    Args:
        setting: The setting; its sensor is taken as ideal.

    Returns:
        True if it becomes large, or is larger at the end than early on.
    """
    bench = linear_bench(setting._replace(noise=0.0), target_torque=0.0)
    test = replace(bench, gravity=0.0, start_velocity=_TINY, duration=DURATION)
    angle = simulate_bench(test).column("motor_angle_rad") - LEVEL
    first, last = (round(time / TICK) for time in _EARLY)
    early, late = (float(np.ptp(part)) for part in (angle[first:last], angle[first - last :]))
    return bool(np.abs(angle).max() > _LARGE) or late > max(early, _ROUNDING)


def largest_share(setting: Setting) -> float:
    """Largest stable share by the eigenvalues of the tick map.

    Args:
        setting: The setting; its share is put in.

    Returns:
        The share, at most ``1.5``.
    """
    loop = loop_of(setting)

    def radius(share: float) -> float:
        return math.exp(growth(replace(loop, share=share)) * TICK)

    found = largest_stable(radius, 0.0, _LARGEST_SHARE)
    return math.nan if found is None else found


def limit_row(setting: Setting) -> Row:
    """The largest stable share.

    Args:
        setting: Without a share.

    Returns:
        A row.
    """
    return {**_where(setting), "largest_share": round(largest_share(setting), 4)}


# ---------------------------------------------------------------------- noise and use


def noise_row(setting: Setting) -> Row:
    """Noise of the torque, and the inertia that a hand still feels: linear run beside closed form.

    Args:
        setting: With a rigid gear, held.

    Returns:
        A row.
    """
    loop = loop_of(setting)
    return {
        **_where(setting),
        "share": setting.share,
        "noise_factor": setting.noise,
        "torque_noise_Nm": round(_seen_noise(setting), 5),
        "linear_torque_noise_Nm": round(torque_noise(loop, sample_deviation(setting)), 5),
        "felt_inertia_share": round(_seen_inertia(setting), 4),
        "closed_felt_inertia_share": round(felt_inertia(loop, FELT_FREQUENCY), 4),
    }


def sample_deviation(setting: Setting) -> float:
    """Standard deviation of a sample in the unit of what it measures, as the tick map takes it.

    Args:
        setting: The setting.

    Returns:
        In [rad] for the encoder, a count over √12; in [rad] / [s] or [rad] / [s²] for a unit.
    """
    unit, sensors = _unit(setting), _sensors(setting)
    if unit is None:
        count = 2.0 * math.pi / (sensors.encoder_counts * rig().actuator.gear_ratio)
        return count / math.sqrt(12.0)
    return unit.noise / unit.lever if unit.sensor is InertialSensor.ACCELEROMETER else unit.noise


def _led(setting: Setting, amplitude: float, frequency: float, cycles: float) -> BenchRun:
    hand = HandParameters(joint=JOINT, amplitude=amplitude, frequency=frequency)
    return simulate_bench(replace(linear_bench(setting), hand=hand, duration=cycles / frequency))


def _seen_noise(setting: Setting) -> float:
    """RMS of what noise adds to the compensating torque, the first second left out, in [N m]."""
    runs = [
        _led(item, HAND_AMPLITUDE, HAND_FREQUENCY, 1.5) for item in (setting, setting._replace(noise=0.0))
    ]
    noisy, ideal = (run.column("inertia_compensation_torque_Nm")[round(1.0 / TICK) :] for run in runs)
    return root_mean_square(noisy - ideal)


def _seen_inertia(setting: Setting) -> float:
    """Inertia over the true one in the hand's torque, by least squares over the last two of four cycles."""
    run = _led(setting._replace(noise=0.0), FELT_AMPLITUDE, FELT_FREQUENCY, 4.0)
    cycles = slice(-round(2.0 / FELT_FREQUENCY / TICK), None)
    names = ("motor_acceleration_rad_per_s2", "motor_velocity_rad_per_s", "hand_torque_Nm", "load_torque_Nm")
    acceleration, velocity, hand, load = (run.column(name)[cycles] for name in names)
    causes = np.column_stack([acceleration, velocity, np.ones_like(velocity)])
    found = np.linalg.lstsq(causes, hand + load, rcond=None)[0]
    return float(found[0] / inertia(run.test))


# ---------------------------------------------------------------------- study


def settings_by_delay(*, quick: bool = False) -> list[Setting]:
    """Settings of a joint that is held, without shares: gear, source, delay, in order.

    Args:
        quick: Two delays and a rigid gear.

    Returns:
        The settings; the delay of the encoder is that of its filters.
    """
    filters, delays = (TIME_CONSTANTS[1:4:2], DELAYS[1:4:2]) if quick else (TIME_CONSTANTS, DELAYS)
    found: list[Setting] = []
    for compliant, source in itertools.product((False,) if quick else (False, True), Source):
        if source is Source.ENCODER:
            lags = [(time_constant, 0) for time_constant in filters]
        else:
            lags = [(TIME_CONSTANTS[0], delay) for delay in delays]
        found += [Setting(source, lag, delay, compliant=compliant) for lag, delay in lags]
    return found


def settings_by_filter(*, quick: bool = False) -> list[Setting]:
    """Settings of a joint that is held, without shares: source, filter, noise, in order.

    Args:
        quick: Two filters and one noise.

    Returns:
        The settings, with a rigid gear; samples of a unit come over the bus.
    """
    filters = TIME_CONSTANTS[2:4] if quick else TIME_CONSTANTS
    return [
        Setting(source, value, 0 if source is Source.ENCODER else BUS_DELAY, noise=factor)
        for source, value in itertools.product(Source, filters)
        for factor in (NOISE_FACTORS[:1] if quick else NOISE_FACTORS)
    ]


@dataclass(frozen=True, eq=False)
class InertiaStudy:
    """Results of the study.

    Attributes:
        stability: One row per setting and share.
        limits: One row per setting, held and free.
        noise: One row per source, filter, noise and share; rigid gear.
    """

    stability: pd.DataFrame
    limits: pd.DataFrame
    noise: pd.DataFrame


def study_inertia(means: Means, *, quick: bool = False) -> InertiaStudy:
    """Run the whole study.

    Args:
        means: Processes, progress, interruption.
        quick: A small part of each grid.

    Returns:
        The tables.

    Raises:
        Interrupted: If it was stopped.
    """
    held = settings_by_delay(quick=quick)
    shares, noise_shares = (SHARES[3::4], NOISE_SHARES[1:2]) if quick else (SHARES, NOISE_SHARES)
    filtered = settings_by_filter(quick=quick)
    parts = (
        [Job(stability_row, item._replace(share=share)) for item in held for share in shares],
        [Job(limit_row, item._replace(held=kept)) for kept in (True, False) for item in held],
        [Job(noise_row, item._replace(share=share)) for item in filtered for share in noise_shares],
    )
    return InertiaStudy(*tables_of(parts, means))
