"""From the command of the controller to the torques of the motors and the voltage of the battery."""

from __future__ import annotations

from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.control_tick import (
    COLUMNS_PER_JOINT,
    DAMPING,
    EQUILIBRIUM,
    GAIN,
    STIFFNESS,
    controller_torques,
    drive_motor,
)
from twin_gait.core.estimation import first_order_step
from twin_gait.core.faults import (
    KIND,
    MOTOR_STUCK,
    NO_FAULT,
    dipped_bus_voltage,
    drive_fault,
    runaway_torque,
    supply_drop,
)
from twin_gait.core.safety import (
    COMMAND_TRIP,
    COMMANDED,
    CURRENT_DEVIATION,
    EMF_CONSTANT,
    HIGHEST_COMMAND,
    MODEL_RESISTANCE,
    MOTOR_CURRENT,
    MOTOR_SPEED,
    command_is_plausible,
    hold_torque,
    motor_speed,
    support_share,
)
from twin_gait.simulation.episode.monitor import trip
from twin_gait.simulation.episode_arrays import (
    ASSISTS,
    BATTERY_RESISTANCE,
    BATTERY_VOLTAGE,
    BUS_VOLTAGE,
    CONTROLLED,
    CURRENT_LIMIT,
    DRIVES_OFF,
    ELECTRICAL,
    FAST_GAIN,
    FAULTY,
    FIRST_FAULT,
    FIRST_ROW,
    FOLLOWS,
    GRAVITY,
    HOLD_DAMPING,
    INERTIA_GAIN,
    INERTIA_WANTED,
    JOINT_WIDTH,
    JOINTS_PER_LEG,
    LOWERING_TICKS,
    MEASURED,
    N_LEGS,
    PERIOD,
    RECORD,
    TORQUE_LIMIT,
    TRIP_TICK,
    WATCHING,
    Array,
    Episode,
)
from twin_gait.simulation.kernel_interface import control_gravity, control_inertia


def feed_forward(episode: Episode) -> None:
    """Gravity and inertia torques of the controller's model, where a share of them is wanted."""
    inputs, state = episode.inputs, episode.state
    holding = state.safety[TRIP_TICK] >= 0
    wanted = holding or inputs.integers[INERTIA_WANTED] != 0
    last = state.blended.shape[1] - 1
    for leg in range(inputs.integers[N_LEGS]):
        wanted = wanted or state.blended[leg, last] != 0.0
    if not wanted:
        return
    joints = inputs.coordinates.shape[0]
    for joint in range(joints):
        angle = state.hold_angle[joint] if holding else state.measured[joint, 0]
        state.control_q[inputs.control_coordinates[joint]] = angle
    control_gravity(state.control_q, inputs.control_bodies, inputs.numbers[GRAVITY], state.gravity_torque)
    if inputs.integers[INERTIA_WANTED] != 0 and not holding:
        for joint in range(joints):
            rate = (state.measured[joint, 1] - state.last_fast[joint]) / inputs.numbers[PERIOD]
            state.rate[joint] = first_order_step(state.rate[joint], rate, inputs.numbers[FAST_GAIN])
            state.control_a[inputs.control_coordinates[joint]] = state.rate[joint]
        control_inertia(state.control_q, state.control_a, inputs.control_bodies, state.inertia_torque)


def control(episode: Episode, joint: int, tick: int, rows: Array) -> float:
    """Torque of one motor for this tick; returns its electrical power."""
    inputs, state = episode.inputs, episode.state
    per_leg = inputs.integers[JOINTS_PER_LEG]
    leg = joint // per_leg
    column = COLUMNS_PER_JOINT * (joint % per_leg)
    place = inputs.control_coordinates[joint]
    stiffness, damping = state.blended[leg, column + STIFFNESS], state.blended[leg, column + DAMPING]
    equilibrium, gain = state.blended[leg, column + EQUILIBRIUM], state.blended[leg, column + GAIN]
    if inputs.integers[ASSISTS] != 0:
        stiffness *= state.assistance[joint]
        damping *= state.assistance[joint]
    impedance, friction, gravity, inertia, target, command = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    support = 0.0
    if state.safety[TRIP_TICK] >= 0:
        support = support_share(tick - state.safety[TRIP_TICK], inputs.integers[LOWERING_TICKS])
    else:
        impedance, friction = controller_torques(
            state.measured[joint, 0],
            state.measured[joint, 1],
            state.measured[joint, 2],
            stiffness,
            damping,
            equilibrium,
            gain,
            state.model_friction[joint],
        )
        if inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
            impedance += runaway_torque(joint, tick, inputs.numbers[PERIOD], inputs.faults, inputs.magnitudes)
        share = state.blended[leg, state.blended.shape[1] - 1]
        gravity = share * state.gravity_torque[place] if share != 0.0 else 0.0
        inertia = inputs.numbers[INERTIA_GAIN] * state.inertia_torque[place]
        target = inputs.target_torque[joint]
        if inputs.integers[FOLLOWS] != 0:
            target += state.lead[joint]
        command = impedance + friction + gravity + inertia + target
        if inputs.integers[WATCHING] != 0:
            if not command_is_plausible(command, inputs.bounds[joint, HIGHEST_COMMAND]):
                trip(episode, tick, COMMAND_TRIP, joint)
    if state.safety[TRIP_TICK] >= 0:
        stiffness, damping, gain = 0.0, inputs.numbers[HOLD_DAMPING], 0.0
        equilibrium = state.hold_angle[joint]
        friction, inertia, target = 0.0, 0.0, 0.0
        impedance = hold_torque(state.watch_memory[joint, MOTOR_SPEED], damping)
        gravity = support * state.gravity_torque[place] if support != 0.0 else 0.0
        command = impedance + friction + gravity + inertia + target
    velocity = state.v[inputs.coordinates[joint]]
    target_current, current, torque = drive_motor(
        command,
        velocity,
        state.changing[BUS_VOLTAGE],
        inputs.numbers[TORQUE_LIMIT],
        inputs.numbers[CURRENT_LIMIT],
        inputs.actuators[joint, 0],
        inputs.actuators[joint, 1],
        inputs.actuators[joint, 2],
        inputs.actuators[joint, 3],
    )
    expected = current
    if state.safety[DRIVES_OFF] != 0 and state.drive_off[joint] != 0:
        target_current, expected, current, torque = 0.0, 0.0, 0.0, 0.0
    elif inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
        fault = drive_fault(joint, tick, inputs.faults)
        if fault != NO_FAULT:
            wrong = inputs.magnitudes[fault] if inputs.faults[fault, KIND] == MOTOR_STUCK else 0.0
            _, current, torque = drive_motor(
                wrong,
                velocity,
                state.changing[BUS_VOLTAGE],
                inputs.numbers[TORQUE_LIMIT],
                inputs.numbers[CURRENT_LIMIT],
                inputs.actuators[joint, 0],
                inputs.actuators[joint, 1],
                inputs.actuators[joint, 2],
                inputs.actuators[joint, 3],
            )
    state.motor[inputs.coordinates[joint]] = torque
    state.watch_memory[joint, COMMANDED] = command
    state.watch_memory[joint, MOTOR_CURRENT] = current
    state.watch_memory[joint, CURRENT_DEVIATION] = current - expected
    state.watch_memory[joint, MOTOR_SPEED] = motor_speed(
        current,
        velocity,
        inputs.actuators[joint, 3],
        inputs.bounds[joint, EMF_CONSTANT],
        inputs.bounds[joint, MODEL_RESISTANCE],
    )
    if inputs.integers[RECORD] != 0:
        row = tick - inputs.integers[FIRST_ROW]
        first = inputs.integers[N_LEGS] + JOINT_WIDTH * joint
        for i in range(3):
            rows[row, first + MEASURED + i] = state.measured[joint, i]
        rows[row, first + CONTROLLED] = impedance
        rows[row, first + CONTROLLED + 1] = friction
        rows[row, first + CONTROLLED + 2] = gravity
        rows[row, first + CONTROLLED + 3] = inertia
        rows[row, first + CONTROLLED + 4] = target
        rows[row, first + CONTROLLED + 5] = command
        rows[row, first + CONTROLLED + 6] = torque
        rows[row, first + ELECTRICAL] = target_current
        rows[row, first + ELECTRICAL + 1] = current
        rows[row, first + ELECTRICAL + 2] = stiffness
        rows[row, first + ELECTRICAL + 3] = damping
        rows[row, first + ELECTRICAL + 4] = equilibrium
        rows[row, first + ELECTRICAL + 5] = gain
    return motor_electrical_power(
        current, velocity, inputs.actuators[joint, 3], inputs.actuators[joint, 0], inputs.actuators[joint, 1]
    )


def supply(episode: Episode, tick: int, battery_power: float) -> None:
    """Bus voltage of the next tick."""
    inputs, state = episode.inputs, episode.state
    voltage = sagged_bus_voltage(
        inputs.numbers[BATTERY_VOLTAGE],
        inputs.numbers[BATTERY_RESISTANCE],
        battery_power,
        state.changing[BUS_VOLTAGE],
    )
    if inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
        drop = supply_drop(tick, inputs.faults, inputs.magnitudes)
        if drop > 0.0:
            highest = 0.0
            for joint in range(inputs.coordinates.shape[0]):
                speed = abs(state.v[inputs.coordinates[joint]])
                highest = max(highest, inputs.bounds[joint, EMF_CONSTANT] * speed)
            voltage = dipped_bus_voltage(voltage, drop, highest)
    state.changing[BUS_VOLTAGE] = voltage
