"""The firmware's target of a tick: torque and current, or a duty."""

from __future__ import annotations

from typing import Any

from twin_gait.core.actuator import saturate, torque_to_current
from twin_gait.core.control_tick import controller_torques
from twin_gait.core.dead_zone import dead_zone
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import coulomb_viscous_tanh_torque
from twin_gait.core.motor_drive import cosine_path, inverter_voltage, transparency_duty
from twin_gait.simulation.bench_joint.arrays import (
    BUS_VOLTAGE,
    COLUMN_FRICTION_COMPENSATION_TORQUE,
    COLUMN_IMPEDANCE_TORQUE,
    COLUMN_INERTIA_COMPENSATION_TORQUE,
    COLUMN_MOTOR_COMMAND_TORQUE,
    COLUMN_TARGET_POSITION,
    COLUMN_TARGET_TORQUE,
    COMPENSATION_GAIN,
    COUNTS,
    CURRENT_LIMIT,
    DAMPING,
    DEAD_ZONE,
    DUTY,
    DUTY_AMPLITUDE,
    DUTY_FREQUENCY,
    DUTY_LIMIT,
    DUTY_SHARE,
    DUTY_START,
    DUTY_STEPS,
    EQUILIBRIUM,
    FOLLOWS_REFERENCE,
    GEAR_EFFICIENCY,
    GEAR_RATIO,
    IDEAL,
    INERTIA_SHARE,
    LINK_INERTIA,
    LOWEST_VELOCITY,
    MODE,
    MODEL_A,
    MODEL_B,
    MODEL_C,
    MODEL_D,
    MOTOR_INERTIA,
    OLD_MODEL,
    OPEN,
    P0,
    P1,
    P2,
    PATH_AMPLITUDE,
    PATH_FREQUENCY,
    PERIOD,
    PI,
    RATE,
    RESISTANCE,
    STIFFNESS,
    TARGET_CURRENT,
    TARGET_TORQUE,
    TORQUE_CONSTANT,
    TORQUE_LIMIT,
    TRANSPARENCY_GAIN,
    VOLTAGE,
    Array,
    BenchArrays,
)


def control(bench: BenchArrays, tick: int, row: Array) -> None:
    """Target current or duty of a tick; writes the controller's columns."""
    numbers, state = bench.numbers, bench.state
    angle, fast, slow = bench.measured[0, 0], bench.measured[0, 1], bench.measured[0, 2]
    (
        row[COLUMN_TARGET_POSITION],
        row[COLUMN_TARGET_TORQUE],
        row[COLUMN_IMPEDANCE_TORQUE],
        row[COLUMN_FRICTION_COMPENSATION_TORQUE],
        row[COLUMN_INERTIA_COMPENSATION_TORQUE],
    ) = 0.0, 0.0, 0.0, 0.0, 0.0
    if numbers[MODE] == DUTY:
        duty = transparency_duty(
            tick + numbers[DUTY_START],
            fast,
            numbers[DUTY_AMPLITUDE],
            numbers[DUTY_FREQUENCY],
            numbers[DUTY_STEPS],
            numbers[LOWEST_VELOCITY],
            numbers[TRANSPARENCY_GAIN],
            numbers[P0],
            numbers[P1],
            numbers[P2],
            state[BUS_VOLTAGE],
            numbers[COUNTS],
            numbers[DUTY_LIMIT],
        )
        state[VOLTAGE] = inverter_voltage(duty, numbers[COUNTS], state[BUS_VOLTAGE])
        state[DUTY_SHARE] = state[VOLTAGE] / state[BUS_VOLTAGE]
        # What the firmware can know of it: the current that this voltage drives at the measured speed.
        back_emf = numbers[TORQUE_CONSTANT] * numbers[GEAR_RATIO] * fast
        state[TARGET_CURRENT] = (state[VOLTAGE] - back_emf) / numbers[RESISTANCE]
    elif numbers[MODE] != OPEN:
        path, path_velocity, path_acceleration = cosine_path(
            tick * numbers[PERIOD], numbers[EQUILIBRIUM], numbers[PATH_AMPLITUDE], numbers[PATH_FREQUENCY]
        )
        inertia = numbers[MOTOR_INERTIA] + numbers[LINK_INERTIA]
        model = model_friction(
            numbers,
            compensated_velocity(numbers, fast, path_velocity),
            compensated_velocity(numbers, slow, path_velocity),
        )
        row[COLUMN_TARGET_POSITION] = path
        row[COLUMN_TARGET_TORQUE] = numbers[TARGET_TORQUE] + inertia * path_acceleration
        row[COLUMN_IMPEDANCE_TORQUE], row[COLUMN_FRICTION_COMPENSATION_TORQUE] = controller_torques(
            angle,
            fast - path_velocity,
            slow,
            numbers[STIFFNESS],
            numbers[DAMPING],
            path,
            numbers[COMPENSATION_GAIN],
            model,
        )
        row[COLUMN_INERTIA_COMPENSATION_TORQUE] = numbers[INERTIA_SHARE] * inertia * state[RATE]
    command = (
        row[COLUMN_IMPEDANCE_TORQUE]
        + row[COLUMN_FRICTION_COMPENSATION_TORQUE]
        + row[COLUMN_INERTIA_COMPENSATION_TORQUE]
        + row[COLUMN_TARGET_TORQUE]
    )
    row[COLUMN_MOTOR_COMMAND_TORQUE] = command
    if numbers[MODE] == IDEAL or numbers[MODE] == PI:
        limited = saturate(command, numbers[TORQUE_LIMIT])
        wanted = torque_to_current(
            limited, numbers[TORQUE_CONSTANT], numbers[GEAR_RATIO], numbers[GEAR_EFFICIENCY]
        )
        state[TARGET_CURRENT] = saturate(wanted, numbers[CURRENT_LIMIT])


def compensated_velocity(numbers: Array, measured: float, reference: float) -> float:
    """Velocity at which the friction is compensated."""
    velocity = reference if numbers[FOLLOWS_REFERENCE] > 0.0 else measured
    return dead_zone(velocity, numbers[DEAD_ZONE])


def model_friction(numbers: Array, fast: float, slow: float) -> float:
    """Friction torque of the compensator's model; the old one knew no slow velocity."""
    if numbers[OLD_MODEL] > 0.0:
        velocity: Any = fast  # the law takes arrays and numbers alike, its types say arrays
        return float(
            coulomb_viscous_tanh_torque(velocity, numbers[MODEL_B], numbers[MODEL_D], numbers[MODEL_C])
        )
    return rotational_friction_torque(
        slow, numbers[MODEL_A], numbers[MODEL_B], numbers[MODEL_C], numbers[MODEL_D]
    )
