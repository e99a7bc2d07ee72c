"""Motor and link: the torques on them, and a step in time."""

from __future__ import annotations

from typing import Any

from twin_gait.core.actuator import current_to_torque
from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import conditioned_torque, ripple_torque
from twin_gait.core.motor_drive import drive_efficiency, gear_loss_torque, link_load_torque, torsion_torque
from twin_gait.core.plant import imposed_motion_torque
from twin_gait.simulation.bench_joint.arrays import (
    CONDITIONED,
    COULOMB_PER_KELVIN,
    COULOMB_PER_LOAD,
    EFFICIENCY_0,
    EFFICIENCY_1,
    EFFICIENCY_2,
    EFFICIENCY_3,
    EFFICIENCY_4,
    EFFICIENCY_5,
    FRICTION_A,
    FRICTION_B,
    FRICTION_C,
    FRICTION_D,
    FRICTION_TEMPERATURE,
    GEAR_EFFICIENCY,
    GEAR_RATIO,
    GEAR_TEMPERATURE,
    GRAVITY,
    HORIZONTAL_ANGLE,
    IMPOSED_MOTION_AMPLITUDE,
    IMPOSED_MOTION_DAMPING,
    IMPOSED_MOTION_FREQUENCY,
    IMPOSED_MOTION_RELEASE,
    IMPOSED_MOTION_START,
    IMPOSED_MOTION_STIFFNESS,
    LINK_ANGLE,
    LINK_INERTIA,
    LINK_MOMENT,
    LINK_VELOCITY,
    LOSS_VELOCITY,
    LOSSY,
    MEAN_CURRENT,
    MOTOR_ANGLE,
    MOTOR_INERTIA,
    MOTOR_VELOCITY,
    RIPPLE_COSINE,
    RIPPLE_ORDER,
    RIPPLE_SINE,
    STOP_DISSIPATION,
    STOP_LOWER,
    STOP_STIFFNESS,
    STOP_UPPER,
    TORQUE_CONSTANT,
    TORSION_DAMPING,
    TORSION_STIFFNESS,
    VISCOUS_PER_KELVIN,
    Array,
)


def motor_torque(numbers: Array, current: float) -> float:
    """Torque of a current at the joint, before the losses of the gear."""
    return current_to_torque(current, numbers[TORQUE_CONSTANT], numbers[GEAR_RATIO], numbers[GEAR_EFFICIENCY])


def rates(
    numbers: Array,
    time: float,
    motor_angle: float,
    motor_velocity: float,
    link_angle: float,
    link_velocity: float,
    torque: float,
) -> tuple[float, float, float, float, float, float, float]:
    """Accelerations of motor and link; torques of friction, gear loss, load, stop and imposed motion."""
    load: Any = link_load_torque(
        link_angle, numbers[LINK_MOMENT], numbers[GRAVITY], numbers[HORIZONTAL_ANGLE]
    )
    angle: Any = motor_angle  # the laws of friction_models take arrays and numbers alike
    velocity: Any = motor_velocity
    friction: Any = -rotational_friction_torque(
        motor_velocity, numbers[FRICTION_A], numbers[FRICTION_B], numbers[FRICTION_C], numbers[FRICTION_D]
    )
    if numbers[CONDITIONED] > 0.0:
        friction -= conditioned_torque(
            velocity,
            load,
            numbers[FRICTION_TEMPERATURE],
            0.0,
            numbers[COULOMB_PER_LOAD],
            numbers[COULOMB_PER_KELVIN],
            0.0,
            numbers[VISCOUS_PER_KELVIN],
            0.1 * numbers[FRICTION_C],
        )
    if numbers[RIPPLE_COSINE] != 0.0 or numbers[RIPPLE_SINE] != 0.0:
        friction -= ripple_torque(angle, numbers[RIPPLE_COSINE], numbers[RIPPLE_SINE], numbers[RIPPLE_ORDER])
    loss = 0.0
    if numbers[LOSSY] > 0.0:
        efficiency = drive_efficiency(
            numbers[GEAR_TEMPERATURE],
            numbers[GEAR_RATIO] * motor_velocity,
            numbers[EFFICIENCY_0],
            numbers[EFFICIENCY_1],
            numbers[EFFICIENCY_2],
            numbers[EFFICIENCY_3],
            numbers[EFFICIENCY_4],
            numbers[EFFICIENCY_5],
        )
        loss = gear_loss_torque(torque, motor_velocity, efficiency, numbers[LOSS_VELOCITY])
    stop = mechanical_stop_torque(
        link_angle,
        link_velocity,
        numbers[STOP_LOWER],
        numbers[STOP_UPPER],
        numbers[STOP_STIFFNESS],
        numbers[STOP_DISSIPATION],
    )
    imposed_motion = 0.0
    if numbers[IMPOSED_MOTION_STIFFNESS] > 0.0 or numbers[IMPOSED_MOTION_DAMPING] > 0.0:
        imposed_motion = imposed_motion_torque(
            time,
            link_angle,
            link_velocity,
            numbers[IMPOSED_MOTION_START],
            numbers[IMPOSED_MOTION_AMPLITUDE],
            numbers[IMPOSED_MOTION_FREQUENCY],
            numbers[IMPOSED_MOTION_STIFFNESS],
            numbers[IMPOSED_MOTION_DAMPING],
            numbers[IMPOSED_MOTION_RELEASE],
        )
    on_motor, on_link = torque + friction + loss, load + stop + imposed_motion
    if numbers[TORSION_STIFFNESS] > 0.0:
        torsion = torsion_torque(
            motor_angle - link_angle,
            motor_velocity - link_velocity,
            numbers[TORSION_STIFFNESS],
            numbers[TORSION_DAMPING],
        )
        motor_acceleration = (on_motor - torsion) / numbers[MOTOR_INERTIA]
        link_acceleration = (on_link + torsion) / numbers[LINK_INERTIA]
    else:
        motor_acceleration = (on_motor + on_link) / (numbers[MOTOR_INERTIA] + numbers[LINK_INERTIA])
        link_acceleration = motor_acceleration
    return motor_acceleration, link_acceleration, friction, loss, load, stop, imposed_motion


def mechanical_step(numbers: Array, state: Array, time: float, step: float) -> None:
    """Advance motor and link by a step of the classical Runge-Kutta method at the mean current."""
    torque = motor_torque(numbers, state[MEAN_CURRENT])
    q1, v1, q2, v2 = state[MOTOR_ANGLE], state[MOTOR_VELOCITY], state[LINK_ANGLE], state[LINK_VELOCITY]
    half = 0.5 * step
    a1, b1, _, _, _, _, _ = rates(numbers, time, q1, v1, q2, v2, torque)
    v1b, v2b = v1 + half * a1, v2 + half * b1
    a2, b2, _, _, _, _, _ = rates(numbers, time + half, q1 + half * v1, v1b, q2 + half * v2, v2b, torque)
    v1c, v2c = v1 + half * a2, v2 + half * b2
    a3, b3, _, _, _, _, _ = rates(numbers, time + half, q1 + half * v1b, v1c, q2 + half * v2b, v2c, torque)
    v1d, v2d = v1 + step * a3, v2 + step * b3
    a4, b4, _, _, _, _, _ = rates(numbers, time + step, q1 + step * v1c, v1d, q2 + step * v2c, v2d, torque)
    sixth = step / 6.0
    state[MOTOR_ANGLE] = q1 + sixth * (v1 + 2.0 * v1b + 2.0 * v1c + v1d)
    state[LINK_ANGLE] = q2 + sixth * (v2 + 2.0 * v2b + 2.0 * v2c + v2d)
    state[MOTOR_VELOCITY] = v1 + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    state[LINK_VELOCITY] = v2 + sixth * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
