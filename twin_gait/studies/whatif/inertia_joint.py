"""The joint with inertia compensation: a bench for the simulation and a linear loop for its matrix."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from twin_gait.checking.hanging_leg import friction_slope
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
from twin_gait.studies.whatif.friction_joint import THESIS_RATIO
from twin_gait.studies.whatif.inertia_map import InertiaLoop, Source
from twin_gait.studies.whatif.rig import JOINT, MODEL, controlled, holding_torque, rig

LOAD = 2.0  # [kg]


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
