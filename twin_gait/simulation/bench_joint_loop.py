"""The loop of the joint bench: ticks of the firmware, periods of the current loop within them.

Plain Python over the functions of :mod:`twin_gait.core`; :mod:`twin_gait.simulation.bench_joint` compiles
the same text. In a tick: measure, control, record; then in every period of the current loop: sample the
current, set the voltage, advance winding and mechanics.

Winding and mechanics take turns within a period: the back-EMF is that of the velocity in its middle, the
winding is solved exactly, and the mean current drives a Runge-Kutta step of the mechanics. The error shrinks
with the square of the period, and to nothing at constant speed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from twin_gait.core.actuator import (
    current_to_torque,
    sagged_bus_voltage,
    saturate,
    torque_to_current,
    voltage_limited_current,
)
from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.control_tick import controller_torques, measure_joints
from twin_gait.core.dead_zone import dead_zone
from twin_gait.core.estimation import first_order_step, quantise
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import conditioned_torque, coulomb_viscous_tanh_torque, ripple_torque
from twin_gait.core.inertial import angular_acceleration, tangential_specific_force
from twin_gait.core.motor_drive import (
    cosine_path,
    current_loop_step,
    drive_efficiency,
    gear_loss_torque,
    inverter_voltage,
    link_load_torque,
    six_step_current,
    torsion_torque,
    transparency_duty,
    winding_current_step,
)
from twin_gait.core.plant import hand_torque

Array = np.ndarray[Any, np.dtype[Any]]

# What drives the winding.
OPEN, IDEAL, PI, DUTY = 0.0, 1.0, 2.0, 3.0
# What the inertia compensation takes its acceleration from.
ENCODER, GYROSCOPE, ACCELEROMETER = 0.0, 1.0, 2.0

COLUMNS = (
    "time_s",
    "position_rad",
    "target_position_rad",
    "measured_current_A",
    "target_current_A",
    "bus_voltage_V",
    "target_torque_Nm",
    "velocity_rad_per_s",
    "duty",
    "motor_angle_rad",
    "motor_velocity_rad_per_s",
    "motor_acceleration_rad_per_s2",
    "link_angle_rad",
    "link_velocity_rad_per_s",
    "velocity_fast_rad_per_s",
    "velocity_slow_rad_per_s",
    "current_A",
    "voltage_V",
    "impedance_torque_Nm",
    "friction_compensation_torque_Nm",
    "inertia_compensation_torque_Nm",
    "motor_command_torque_Nm",
    "motor_torque_Nm",
    "friction_torque_Nm",
    "gear_loss_torque_Nm",
    "load_torque_Nm",
    "stop_torque_Nm",
    "hand_torque_Nm",
)

# Positions in the numbers of a test, which do not change.
(
    PERIOD,
    LOOP_PERIOD,
    LOOPS,
    FAST_GAIN,
    DECIMATION,
    MODE,
    TORQUE_CONSTANT,
    GEAR_RATIO,
    GEAR_EFFICIENCY,
    RESISTANCE,
    INDUCTANCE,
    POLE_PAIRS,
    CURRENT_RIPPLE,
    CURRENT_NOISE,
    CURRENT_OFFSET,
    CURRENT_RESOLUTION,
    PROPORTIONAL_GAIN,
    INTEGRAL_GAIN,
    COUNTS,
    BATTERY_VOLTAGE,
    BATTERY_RESISTANCE,
    TORQUE_LIMIT,
    CURRENT_LIMIT,
    MOTOR_INERTIA,
    LINK_INERTIA,
    LINK_MOMENT,
    GRAVITY,
    HORIZONTAL_ANGLE,
    STOP_LOWER,
    STOP_UPPER,
    STOP_STIFFNESS,
    STOP_DISSIPATION,
    TORSION_STIFFNESS,
    TORSION_DAMPING,
    FRICTION_A,
    FRICTION_B,
    FRICTION_C,
    FRICTION_D,
    CONDITIONED,
    COULOMB_PER_LOAD,
    COULOMB_PER_KELVIN,
    VISCOUS_PER_KELVIN,
    FRICTION_TEMPERATURE,
    RIPPLE_COSINE,
    RIPPLE_SINE,
    RIPPLE_ORDER,
    LOSSY,
    GEAR_TEMPERATURE,
    EFFICIENCY_0,
    EFFICIENCY_1,
    EFFICIENCY_2,
    EFFICIENCY_3,
    EFFICIENCY_4,
    EFFICIENCY_5,
    LOSS_VELOCITY,
    HAND_START,
    HAND_AMPLITUDE,
    HAND_FREQUENCY,
    HAND_STIFFNESS,
    HAND_DAMPING,
    HAND_RELEASE,
    OLD_MODEL,
    MODEL_A,
    MODEL_B,
    MODEL_C,
    MODEL_D,
    COMPENSATION_GAIN,
    FOLLOWS_REFERENCE,
    DEAD_ZONE,
    TARGET_TORQUE,
    STIFFNESS,
    DAMPING,
    EQUILIBRIUM,
    INERTIA_SHARE,
    UNIT,
    UNIT_LEVER,
    UNIT_NOISE,
    UNIT_GAIN,
    PATH_AMPLITUDE,
    PATH_FREQUENCY,
    DUTY_AMPLITUDE,
    DUTY_FREQUENCY,
    DUTY_STEPS,
    DUTY_START,
    LOWEST_VELOCITY,
    TRANSPARENCY_GAIN,
    P0,
    P1,
    P2,
    DUTY_LIMIT,
    REST_TICKS,
    DIVERGED_VELOCITY,
) = range(92)
NUMBER_COUNT = DIVERGED_VELOCITY + 1

# Positions in the state, which a test changes.
(
    MOTOR_ANGLE,
    MOTOR_VELOCITY,
    LINK_ANGLE,
    LINK_VELOCITY,
    CURRENT,
    MEAN_CURRENT,
    INTEGRAL,
    VOLTAGE,
    SAMPLE,
    BUS_VOLTAGE,
    ENERGY,
    TARGET_CURRENT,
    DUTY_SHARE,
    RATE,
    LAST_SAMPLE,
    LAST_FAST,
    LAST_ANGLE,
    STOP_TICKS,
    DIVERGED,
) = range(19)
STATE_COUNT = DIVERGED + 1


class BenchArrays(NamedTuple):
    """A test on the joint bench as plain arrays.

    Attributes:
        numbers: See the positions above, shape ``(NUMBER_COUNT,)``.
        state: See the positions above, shape ``(STATE_COUNT,)``; changed in place.
        angles: Room for the motor angle, shape ``(1,)``.
        resolution: Encoder resolution in [rad], shape ``(1,)``.
        measured: Angle, fast and slow velocity, shape ``(1, 3)``.
        decimated_angle: Shape ``(1,)``.
        ring: Slow samples, shape ``(window, 1)``.
        delayed: Samples of the current that are under way, shape ``(delay + 1,)``.
        encoder_noise: Of every tick in [rad], shape ``(n_ticks,)``.
        loop_noise: Of every period of the current loop, standard normal, shape ``(n_ticks * loops,)``.
        inertial: Samples of the inertial unit that are under way, shape ``(delay + 1,)``.
        inertial_noise: Of every tick, standard normal, shape ``(n_ticks,)``; empty without a unit.
    """

    numbers: Array
    state: Array
    angles: Array
    resolution: Array
    measured: Array
    decimated_angle: Array
    ring: Array
    delayed: Array
    encoder_noise: Array
    loop_noise: Array
    inertial: Array
    inertial_noise: Array


def run_ticks(bench: BenchArrays, first: int, end: int, rows: Array) -> int:
    """Run ticks of a test.

    Args:
        bench: The test; its state is changed in place.
        first: Tick to begin with.
        end: Tick to stop before.
        rows: Log, shape ``(n_ticks, len(COLUMNS))``; changed in place.

    Returns:
        Ticks done since tick 0: ``end``, or fewer if the test is over or has diverged.
    """
    numbers, state = bench.numbers, bench.state
    for tick in range(first, end):
        measure(bench, tick)
        control(bench, tick, rows[tick])
        record(bench, tick, rows[tick])
        state[ENERGY] = 0.0
        for loop in range(int(numbers[LOOPS])):
            advance_loop(bench, tick, loop)
        state[BUS_VOLTAGE] = sagged_bus_voltage(
            numbers[BATTERY_VOLTAGE],
            numbers[BATTERY_RESISTANCE],
            state[ENERGY] / numbers[PERIOD],
            state[BUS_VOLTAGE],
        )
        if not abs(state[MOTOR_VELOCITY]) < numbers[DIVERGED_VELOCITY]:
            state[DIVERGED] = 1.0
            return tick + 1
        if state[LINK_ANGLE] >= numbers[STOP_UPPER] or state[STOP_TICKS] > 0.0:
            state[STOP_TICKS] += 1.0
        if state[STOP_TICKS] > numbers[REST_TICKS]:
            return tick + 1
    return end


def measure(bench: BenchArrays, tick: int) -> None:
    """Encoder on the motor, the two velocity estimates and their rate."""
    numbers, state = bench.numbers, bench.state
    bench.angles[0] = state[MOTOR_ANGLE] + bench.encoder_noise[tick]
    state[LAST_FAST], state[LAST_ANGLE] = bench.measured[0, 1], bench.measured[0, 0]
    measure_joints(
        tick,
        bench.angles,
        bench.resolution,
        numbers[PERIOD],
        numbers[FAST_GAIN],
        int(numbers[DECIMATION]),
        bench.measured,
        bench.decimated_angle,
        bench.ring,
    )
    if tick == 0:
        state[LAST_ANGLE] = bench.measured[0, 0]
    if numbers[UNIT] != ENCODER:
        sense_acceleration(bench, tick)
    else:
        change = (bench.measured[0, 1] - state[LAST_FAST]) / numbers[PERIOD]
        state[RATE] = first_order_step(state[RATE], change, numbers[FAST_GAIN])


def sense_acceleration(bench: BenchArrays, tick: int) -> None:
    """Angular acceleration of the link from the inertial unit on it; a sample is used after its delay."""
    numbers, state = bench.numbers, bench.state
    size = bench.inertial.shape[0]
    bench.inertial[tick % size] = inertial_sample(bench, tick) + (
        numbers[UNIT_NOISE] * bench.inertial_noise[tick]
    )
    if tick + 1 < size:
        return
    sample = bench.inertial[(tick + 1) % size]
    if numbers[UNIT] == ACCELEROMETER:
        acceleration = angular_acceleration(
            sample,
            bench.measured[0, 0],
            numbers[UNIT_LEVER],
            numbers[GRAVITY],
            numbers[HORIZONTAL_ANGLE],
        )
    else:
        before = sample if tick + 1 == size else state[LAST_SAMPLE]
        acceleration = (sample - before) / numbers[PERIOD]
    state[LAST_SAMPLE] = sample
    state[RATE] = first_order_step(state[RATE], acceleration, numbers[UNIT_GAIN])


def inertial_sample(bench: BenchArrays, tick: int) -> float:
    """What the unit would report without noise: velocity, or specific force along its path."""
    numbers, state = bench.numbers, bench.state
    if numbers[UNIT] == GYROSCOPE:
        return float(state[LINK_VELOCITY])
    _, acceleration, _, _, _, _, _ = rates(
        numbers,
        tick * numbers[PERIOD],
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        state[LINK_ANGLE],
        state[LINK_VELOCITY],
        motor_torque(numbers, state[CURRENT]),
    )
    return tangential_specific_force(
        acceleration,
        state[LINK_ANGLE],
        numbers[UNIT_LEVER],
        numbers[GRAVITY],
        numbers[HORIZONTAL_ANGLE],
    )


def control(bench: BenchArrays, tick: int, row: Array) -> None:
    """Target current or duty of a tick; writes the controller's columns."""
    numbers, state = bench.numbers, bench.state
    angle, fast, slow = bench.measured[0, 0], bench.measured[0, 1], bench.measured[0, 2]
    row[2], row[6], row[18], row[19], row[20] = 0.0, 0.0, 0.0, 0.0, 0.0
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
        row[2] = path
        row[6] = numbers[TARGET_TORQUE] + inertia * path_acceleration
        row[18], row[19] = controller_torques(
            angle,
            fast - path_velocity,
            slow,
            numbers[STIFFNESS],
            numbers[DAMPING],
            path,
            numbers[COMPENSATION_GAIN],
            model,
        )
        row[20] = numbers[INERTIA_SHARE] * inertia * state[RATE]
    command = row[18] + row[19] + row[20] + row[6]
    row[21] = command
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


def record(bench: BenchArrays, tick: int, row: Array) -> None:
    """Write the columns of a tick that the controller has not written."""
    numbers, state = bench.numbers, bench.state
    angle = bench.measured[0, 0]
    torque = motor_torque(numbers, state[CURRENT])
    acceleration, _, friction, loss, load, stop, hand = rates(
        numbers,
        tick * numbers[PERIOD],
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        state[LINK_ANGLE],
        state[LINK_VELOCITY],
        torque,
    )
    row[0], row[1] = tick * numbers[PERIOD], angle
    row[3], row[4], row[5] = state[SAMPLE], state[TARGET_CURRENT], state[BUS_VOLTAGE]
    row[7] = (angle - state[LAST_ANGLE]) / numbers[PERIOD]
    row[8] = state[DUTY_SHARE]
    row[9], row[10], row[11] = state[MOTOR_ANGLE], state[MOTOR_VELOCITY], acceleration
    row[12], row[13] = state[LINK_ANGLE], state[LINK_VELOCITY]
    row[14], row[15] = bench.measured[0, 1], bench.measured[0, 2]
    row[16], row[17] = state[CURRENT], state[VOLTAGE]
    row[22], row[23], row[24], row[25], row[26], row[27] = torque, friction, loss, load, stop, hand


def motor_torque(numbers: Array, current: float) -> float:
    """Torque of a current at the joint, before the losses of the gear."""
    return current_to_torque(current, numbers[TORQUE_CONSTANT], numbers[GEAR_RATIO], numbers[GEAR_EFFICIENCY])


def advance_loop(bench: BenchArrays, tick: int, loop: int) -> None:
    """One period of the current loop: sample, set the voltage, advance winding and mechanics."""
    numbers, state = bench.numbers, bench.state
    index = tick * int(numbers[LOOPS]) + loop
    sample_current(bench, index)
    step = numbers[LOOP_PERIOD]
    time = tick * numbers[PERIOD] + loop * step
    acceleration, _, _, _, _, _, _ = rates(
        numbers,
        time,
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        state[LINK_ANGLE],
        state[LINK_VELOCITY],
        motor_torque(numbers, state[CURRENT]),
    )
    drive_winding(bench, state[MOTOR_VELOCITY] + 0.5 * step * acceleration)
    state[ENERGY] += state[VOLTAGE] * state[MEAN_CURRENT] * step
    mechanical_step(numbers, state, time, step)


def sample_current(bench: BenchArrays, index: int) -> None:
    """Read the shunts; the loop sees the sample after its delay."""
    numbers, state = bench.numbers, bench.state
    noise = numbers[CURRENT_OFFSET] + numbers[CURRENT_NOISE] * bench.loop_noise[index]
    sample = six_step_current(
        state[CURRENT],
        numbers[GEAR_RATIO] * state[MOTOR_ANGLE],
        numbers[POLE_PAIRS],
        numbers[CURRENT_RIPPLE],
        noise,
    )
    size = bench.delayed.shape[0]
    bench.delayed[index % size] = quantise(sample, numbers[CURRENT_RESOLUTION])
    state[SAMPLE] = bench.delayed[(index + 1) % size]


def drive_winding(bench: BenchArrays, velocity: float) -> None:
    """Current at the end of a period and its mean, at the joint velocity in the middle of it."""
    numbers, state = bench.numbers, bench.state
    if numbers[MODE] == OPEN:
        return
    back_emf = numbers[TORQUE_CONSTANT] * numbers[GEAR_RATIO] * velocity
    if numbers[MODE] == IDEAL:
        current = voltage_limited_current(
            state[TARGET_CURRENT],
            velocity,
            state[BUS_VOLTAGE],
            numbers[RESISTANCE],
            numbers[TORQUE_CONSTANT],
            numbers[GEAR_RATIO],
        )
        state[CURRENT], state[MEAN_CURRENT] = current, current
        state[VOLTAGE] = numbers[RESISTANCE] * current + back_emf
        state[DUTY_SHARE] = state[VOLTAGE] / state[BUS_VOLTAGE]
        return
    if numbers[MODE] == PI:
        wanted, state[INTEGRAL] = current_loop_step(
            state[TARGET_CURRENT] - state[SAMPLE],
            state[INTEGRAL],
            numbers[PROPORTIONAL_GAIN],
            numbers[INTEGRAL_GAIN],
            numbers[LOOP_PERIOD],
            state[BUS_VOLTAGE],
        )
        full = numbers[COUNTS] if numbers[COUNTS] > 0.0 else 1.0
        state[VOLTAGE] = inverter_voltage(
            wanted / state[BUS_VOLTAGE] * full, numbers[COUNTS], state[BUS_VOLTAGE]
        )
        state[DUTY_SHARE] = state[VOLTAGE] / state[BUS_VOLTAGE]
    state[CURRENT], state[MEAN_CURRENT] = winding_current_step(
        state[CURRENT],
        state[VOLTAGE],
        back_emf,
        numbers[RESISTANCE],
        numbers[INDUCTANCE],
        numbers[LOOP_PERIOD],
    )


def rates(
    numbers: Array,
    time: float,
    motor_angle: float,
    motor_velocity: float,
    link_angle: float,
    link_velocity: float,
    torque: float,
) -> tuple[float, float, float, float, float, float, float]:
    """Accelerations of motor and link, and the torques of friction, gear loss, load, stop and hand."""
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
    hand = 0.0
    if numbers[HAND_STIFFNESS] > 0.0 or numbers[HAND_DAMPING] > 0.0:
        hand = hand_torque(
            time,
            link_angle,
            link_velocity,
            numbers[HAND_START],
            numbers[HAND_AMPLITUDE],
            numbers[HAND_FREQUENCY],
            numbers[HAND_STIFFNESS],
            numbers[HAND_DAMPING],
            numbers[HAND_RELEASE],
        )
    on_motor, on_link = torque + friction + loss, load + stop + hand
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
    return motor_acceleration, link_acceleration, friction, loss, load, stop, hand


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
