"""A test on the joint bench laid out as arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin_gait.core.estimation import first_order_gain
from twin_gait.core.motor_drive import current_loop_gains
from twin_gait.gait.table import TICK
from twin_gait.parameters import require
from twin_gait.scenario.bench_joint import (
    HORIZONTAL,
    TRANSPARENCY_STEPS,
    BenchJoint,
    CompensationVelocity,
    CurrentLoop,
    DutyControl,
    InertialSensor,
    LoadAngle,
    TorqueControl,
)
from twin_gait.simulation.bench_joint import arrays as at
from twin_gait.simulation.engine import DIVERGED_VELOCITY


@dataclass(frozen=True, eq=False)
class BenchVariation:
    """What differs from one test to the next though nothing was changed.

    Attributes:
        current_offset: Of the current measurement in [A].
        friction_ratio: On the friction law.
        ripple_phase: Of the friction that repeats with the angle, in [rad].
        duty_start: Ticks that the sine of (2.1a) has run when the test begins.
    """

    current_offset: float = 0.0
    friction_ratio: float = 1.0
    ripple_phase: float = 0.0
    duty_start: int = 0


def bench_arrays(test: BenchJoint, ticks: int, seed: int, variation: BenchVariation) -> at.BenchArrays:
    """Lay a test out as arrays.

    Returns:
        The arrays, with the state at tick 0.
    """
    numbers = _numbers(test, variation)
    loops = int(numbers[at.LOOPS])
    rng = np.random.default_rng(seed)
    sensors = test.sensors
    encoder_noise = np.zeros(ticks)
    if not sensors.ideal and sensors.angle_noise > 0.0:
        encoder_noise = sensors.angle_noise * rng.standard_normal(ticks)
    loop_noise = rng.standard_normal(ticks * loops) if test.drive.noise > 0.0 else np.zeros(ticks * loops)
    unit = test.inertial_unit
    inertial_noise = np.zeros(0) if unit is None else rng.standard_normal(ticks)
    resolution = 2.0 * math.pi / (sensors.encoder_counts * test.actuator.gear_ratio)
    state = np.zeros(at.STATE_COUNT)
    state[at.MOTOR_ANGLE] = state[at.LINK_ANGLE] = test.start_angle
    state[at.MOTOR_VELOCITY] = state[at.LINK_VELOCITY] = test.start_velocity
    state[at.BUS_VOLTAGE] = test.battery.voltage
    return at.BenchArrays(
        numbers=numbers,
        state=state,
        angles=np.zeros(1),
        resolution=np.array([0.0 if sensors.ideal else resolution]),
        measured=np.zeros((1, 3)),
        decimated_angle=np.zeros(1),
        ring=np.zeros((sensors.window, 1)),
        delayed=np.zeros(test.drive.delay + 1),
        encoder_noise=encoder_noise,
        loop_noise=loop_noise,
        inertial=np.zeros(1 if unit is None else unit.delay + 1),
        inertial_noise=inertial_noise,
    )


def _numbers(test: BenchJoint, variation: BenchVariation) -> np.ndarray:
    values = {
        **_plant_numbers(test, variation),
        **_drive_numbers(test, variation),
        **_control_numbers(test, variation),
    }
    numbers = np.zeros(at.NUMBER_COUNT)
    for position, value in values.items():
        numbers[position] = value
    return numbers


def _plant_numbers(test: BenchJoint, variation: BenchVariation) -> dict[int, float]:
    link, friction = test.link, test.friction
    law = friction.law.scaled(variation.friction_ratio).in_plant()
    values = {
        at.MOTOR_INERTIA: test.actuator.armature,
        at.LINK_INERTIA: link.total_inertia,
        at.LINK_MOMENT: link.total_moment,
        at.GRAVITY: test.gravity,
        at.HORIZONTAL_ANGLE: HORIZONTAL if link.load_angle is LoadAngle.CORRECTED else 0.0,
        at.STOP_LOWER: link.lower_stop,
        at.STOP_UPPER: link.upper_stop,
        at.STOP_STIFFNESS: link.stops.stiffness,
        at.STOP_DISSIPATION: link.stops.dissipation,
        at.FRICTION_A: law.breakaway_torque,
        at.FRICTION_B: law.coulomb_friction,
        at.FRICTION_C: law.stribeck_velocity,
        at.FRICTION_D: law.viscous_friction_forward,
        at.CONDITIONED: float(friction.depends_on_conditions),
        at.COULOMB_PER_LOAD: friction.coulomb_per_load,
        at.COULOMB_PER_KELVIN: friction.coulomb_per_kelvin,
        at.VISCOUS_PER_KELVIN: friction.viscous_per_kelvin,
        at.FRICTION_TEMPERATURE: friction.temperature,
        at.RIPPLE_COSINE: friction.ripple * math.cos(variation.ripple_phase),
        at.RIPPLE_SINE: friction.ripple * math.sin(variation.ripple_phase),
        at.RIPPLE_ORDER: 2.0 * test.actuator.gear_ratio,
        at.LOSS_VELOCITY: 1.0,
        at.REST_TICKS: test.rest_at_stop / TICK,
        at.DIVERGED_VELOCITY: DIVERGED_VELOCITY,
        at.IMPOSED_MOTION_FREQUENCY: 1.0,
    }
    if test.torsion is not None:
        values[at.TORSION_STIFFNESS] = test.torsion.stiffness
        values[at.TORSION_DAMPING] = test.torsion.damping
    if test.efficiency is not None:
        values[at.LOSSY] = 1.0
        values[at.GEAR_TEMPERATURE] = test.efficiency.temperature
        values[at.LOSS_VELOCITY] = test.efficiency.transition_velocity
        for place, coefficient in enumerate(test.efficiency.coefficients):
            values[at.EFFICIENCY_0 + place] = coefficient
    if test.imposed_motion is not None:
        values[at.IMPOSED_MOTION_START] = test.start_angle
        values[at.IMPOSED_MOTION_AMPLITUDE] = test.imposed_motion.amplitude
        values[at.IMPOSED_MOTION_FREQUENCY] = test.imposed_motion.frequency
        values[at.IMPOSED_MOTION_STIFFNESS] = test.imposed_motion.stiffness
        values[at.IMPOSED_MOTION_DAMPING] = test.imposed_motion.damping
        values[at.IMPOSED_MOTION_RELEASE] = test.imposed_motion.release_time
    return values


def _drive_numbers(test: BenchJoint, variation: BenchVariation) -> dict[int, float]:
    actuator, drive = test.actuator, test.drive
    proportional, integral = current_loop_gains(actuator.resistance, drive.inductance, drive.bandwidth)
    loops = round(drive.rate * TICK)
    return {
        at.PERIOD: TICK,
        at.LOOP_PERIOD: TICK / loops,
        at.LOOPS: loops,
        at.MODE: _mode(test),
        at.TORQUE_CONSTANT: actuator.torque_constant,
        at.GEAR_RATIO: actuator.gear_ratio,
        at.GEAR_EFFICIENCY: actuator.gear_efficiency,
        at.RESISTANCE: actuator.resistance,
        at.INDUCTANCE: drive.inductance,
        at.POLE_PAIRS: drive.pole_pairs,
        at.CURRENT_RIPPLE: drive.ripple,
        at.CURRENT_NOISE: drive.noise,
        at.CURRENT_OFFSET: variation.current_offset,
        at.CURRENT_RESOLUTION: drive.resolution,
        at.PROPORTIONAL_GAIN: proportional,
        at.INTEGRAL_GAIN: integral,
        at.COUNTS: drive.counts,
        at.BATTERY_VOLTAGE: test.battery.voltage,
        at.BATTERY_RESISTANCE: test.battery.internal_resistance,
        at.TORQUE_LIMIT: test.limits.torque,
        at.CURRENT_LIMIT: test.limits.current,
    }


def _mode(test: BenchJoint) -> float:
    if test.control is None:
        return at.OPEN
    if isinstance(test.control, DutyControl):
        return at.DUTY
    return at.PI if test.drive.loop is CurrentLoop.PI else at.IDEAL


def _control_numbers(test: BenchJoint, variation: BenchVariation) -> dict[int, float]:
    values = {
        at.FAST_GAIN: first_order_gain(TICK, test.sensors.fast_time_constant),
        at.DECIMATION: float(test.sensors.decimation),
        at.MODEL_C: 1.0,
        at.DUTY_STEPS: TRANSPARENCY_STEPS,
        at.PATH_FREQUENCY: 1.0,
    }
    if isinstance(test.control, DutyControl):
        return values | _duty_numbers(test, test.control, variation)
    if isinstance(test.control, TorqueControl):
        return values | _torque_numbers(test.control) | _unit_numbers(test)
    return values


def _unit_numbers(test: BenchJoint) -> dict[int, float]:
    unit = test.inertial_unit
    if unit is None:
        return {at.UNIT: at.ENCODER}
    gyroscope = unit.sensor is InertialSensor.GYROSCOPE
    return {
        at.UNIT: at.GYROSCOPE if gyroscope else at.ACCELEROMETER,
        at.UNIT_LEVER: unit.lever,
        at.UNIT_NOISE: unit.noise,
        at.UNIT_GAIN: first_order_gain(TICK, unit.time_constant),
    }


def _duty_numbers(test: BenchJoint, control: DutyControl, variation: BenchVariation) -> dict[int, float]:
    require(test.drive.counts > 0, "pwm counts", "1 or more for a controller of duties", test.drive.counts)
    static, linear, quadratic = control.voltages(test.actuator)
    return {
        at.DUTY_AMPLITUDE: control.amplitude,
        at.DUTY_FREQUENCY: control.frequency,
        at.DUTY_START: float(variation.duty_start),
        at.LOWEST_VELOCITY: control.lowest_velocity,
        at.TRANSPARENCY_GAIN: control.transparency_gain,
        at.P0: static,
        at.P1: linear,
        at.P2: quadratic,
        at.DUTY_LIMIT: control.duty_limit * test.drive.counts,
    }


def _torque_numbers(control: TorqueControl) -> dict[int, float]:
    model = control.controller.friction_model.normalised()
    values = {
        at.MODEL_A: model.breakaway_torque,
        at.MODEL_B: model.coulomb_friction,
        at.MODEL_C: model.breakaway_velocity,
        at.MODEL_D: model.viscous_friction,
        at.COMPENSATION_GAIN: control.friction_compensation_gain,
        at.FOLLOWS_REFERENCE: float(control.compensation_velocity is CompensationVelocity.REFERENCE),
        at.DEAD_ZONE: control.dead_zone,
        at.TARGET_TORQUE: control.target_torque,
        at.STIFFNESS: control.stiffness,
        at.DAMPING: control.damping,
        at.EQUILIBRIUM: control.equilibrium_angle,
        at.INERTIA_SHARE: control.inertia_compensation,
    }
    if control.old_model is not None:
        values[at.OLD_MODEL] = 1.0
        values[at.MODEL_B] = control.old_model.coulomb
        values[at.MODEL_C] = control.old_model.steepness
        values[at.MODEL_D] = control.old_model.viscous
    if control.path is not None:
        values[at.EQUILIBRIUM] = control.path.start_angle
        values[at.PATH_AMPLITUDE] = control.path.amplitude
        values[at.PATH_FREQUENCY] = control.path.frequency
    return values
