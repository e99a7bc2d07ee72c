"""The loop of the compiled engine: a whole episode on plain arrays.

This module is plain Python that calls the functions of :mod:`twin_gait.core`; it is compiled together with
a generated kernel, which takes the place of the imports from ``kernel_interface``. The order of things in a
tick is that of the Pinocchio engine: measure, watch, decide, control, record, integrate.

Every function here that needs the episode takes it first and begins with
``inputs, state = episode.inputs, episode.state``: :mod:`twin_gait.simulation.flattening` hands the arrays
over one by one in the compiled text, which compiles in half the time.
"""

from __future__ import annotations

import numpy as np

from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.assistance import adapted_assistance, cycle_place
from twin_gait.core.belt import (
    BELT_CRUISE,
    BELT_DELAY,
    BELT_RAMP,
    BELT_START,
    BELT_STOP,
    belt_speed,
    walk_command,
)
from twin_gait.core.control_tick import (
    COLUMNS_PER_JOINT,
    DAMPING,
    EQUILIBRIUM,
    GAIN,
    STIFFNESS,
    blend_phase,
    controller_torques,
    drive_motor,
    leg_signals,
    measure_joints,
)
from twin_gait.core.estimation import first_order_step
from twin_gait.core.faults import (
    KIND,
    MOTOR_STUCK,
    NO_FAULT,
    dipped_bus_voltage,
    drive_fault,
    faulty_angle,
    faulty_load,
    runaway_torque,
    supply_drop,
)
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.guards import NO_TRANSITION, TARGET, next_transition
from twin_gait.core.integrators import rk4_step, semi_implicit_euler_step
from twin_gait.core.plant import (
    CONTACT_WORK,
    FRICTION,
    FRICTION_WORK,
    MOTOR_WORK,
    PATIENT_WORK,
    SPRING,
    SPRING_WORK,
    STOP,
    STOP_WORK,
    hand_torque,
    passive_torque,
)
from twin_gait.core.safety import (
    COMMAND_TRIP,
    COMMANDED,
    CURRENT_DEVIATION,
    DRIVE_STREAK,
    DRIVE_TICKS,
    EMF_CONSTANT,
    FROZEN_SPEED,
    HIGHEST_COMMAND,
    LOAD_TRIP,
    MODEL_RESISTANCE,
    MOTOR_CURRENT,
    MOTOR_SPEED,
    NO_TRIP,
    OVERSTAY_TRIP,
    SUPPLY_TRIP,
    command_is_plausible,
    hold_torque,
    motor_speed,
    support_share,
    watch_joint,
)
from twin_gait.core.wearer import (
    CATCH_GAIN,
    CATCH_SPEED,
    CONTRACTURE,
    EFFORT,
    PASSIVE_SHARE,
    passive_hip_torque,
    passive_knee_torque,
    posture_place,
    spastic_torque,
)
from twin_gait.simulation.episode_arrays import (
    ADAPTS,
    ALLOWANCE,
    ANKLE_WIDTH,
    ASSISTANCE_GAIN,
    ASSISTS,
    BATTERY_RESISTANCE,
    BATTERY_VOLTAGE,
    BLEND_LAW,
    BLEND_TICKS,
    BODY_WEIGHT,
    BUS_VOLTAGE,
    COMPLETED,
    CONTACT_POWER,
    CONTROLLED,
    CURRENT_LIMIT,
    CYCLE_TICKS,
    DECIMATION,
    DIVERGED,
    DIVERGED_VELOCITY,
    DRIVES_OFF,
    ELECTRICAL,
    FALL_HEIGHT,
    FAST_GAIN,
    FAULTY,
    FELL,
    FIRST_FAULT,
    FIRST_ROW,
    FOLLOWS,
    FOOT_WIDTH,
    FORGETTING,
    FROZEN_LOAD_TICKS,
    GRAVITY,
    HAND_INDEX,
    HAND_TORQUE,
    HOLD_DAMPING,
    INERTIA_GAIN,
    INERTIA_WANTED,
    JOINT_WIDTH,
    JOINTS_PER_LEG,
    LAST_CONTACT_POWER,
    LEAST_ASSISTANCE,
    LEAST_VOLTAGE,
    LOW_VOLTAGE_STREAK,
    LOWERING_TICKS,
    LOWEST_POSTURE,
    MEASURED,
    N_ANKLES,
    N_LEGS,
    OVERSTAY_TICKS,
    PASSIVE,
    PELVIS_INDEX,
    PELVIS_WIDTH,
    PERIOD,
    POINTS_PER_FOOT,
    POSTURE_STEP,
    RECORD,
    STEP,
    SUBSTEPS,
    TIME,
    TORQUE_LIMIT,
    TRIP_CAUSE,
    TRIP_PLACE,
    TRIP_TICK,
    USE_RK4,
    VOLTAGE_TICKS,
    WATCHING,
    WEARER,
    Array,
    Episode,
)
from twin_gait.simulation.kernel_interface import (
    contact_forces,
    control_gravity,
    control_inertia,
    dynamics,
    observe,
)


def _acceleration(episode: Episode, offset: float, weight: float, q: Array, v: Array, out: Array) -> None:
    """Acceleration of a state with everything that acts on it; adds the work of Runge-Kutta stages."""
    inputs, state = episode.inputs, episode.state
    for i in range(q.shape[0]):
        friction, stop, spring = passive_torque(
            q[i],
            v[i],
            inputs.plant_rows[i, 0],
            inputs.plant_rows[i, 1],
            inputs.plant_rows[i, 2],
            inputs.plant_rows[i, 3],
            inputs.plant_rows[i, 4],
            inputs.plant_rows[i, 5],
            inputs.plant_rows[i, 6],
            inputs.plant_rows[i, 7],
            inputs.plant_rows[i, 8],
            inputs.plant_rows[i, 9],
            inputs.plant_rows[i, 10],
        )
        state.passive[i, FRICTION] = friction
        state.passive[i, STOP] = stop
        state.passive[i, SPRING] = spring
        state.torque[i] = state.motor[i] + state.external[i] + (friction + stop + spring)
    hand = inputs.integers[HAND_INDEX]
    if hand >= 0:
        state.changing[HAND_TORQUE] = hand_torque(
            state.changing[TIME] + offset * inputs.numbers[STEP],
            q[hand],
            v[hand],
            inputs.hand[0],
            inputs.hand[1],
            inputs.hand[2],
            inputs.hand[3],
            inputs.hand[4],
            inputs.hand[5],
        )
        state.torque[hand] += state.changing[HAND_TORQUE]
    state.changing[CONTACT_POWER] = dynamics(
        q, v, state.torque, inputs.bodies, inputs.numbers[GRAVITY], inputs.contact, out, state.points
    )
    if inputs.integers[USE_RK4] != 0 and inputs.integers[RECORD] != 0:
        _add_work(episode, weight * inputs.numbers[STEP], state.changing[CONTACT_POWER], v)


def _add_work(episode: Episode, duration: float, contact_power: float, v: Array) -> None:
    """Add the work that every source does on the leg in a short time."""
    inputs, state = episode.inputs, episode.state
    for i in range(v.shape[0]):
        state.works[MOTOR_WORK] += duration * state.motor[i] * v[i]
        state.works[FRICTION_WORK] += duration * state.passive[i, FRICTION] * v[i]
        state.works[STOP_WORK] += duration * state.passive[i, STOP] * v[i]
        state.works[SPRING_WORK] += duration * state.passive[i, SPRING] * v[i]
        state.works[PATIENT_WORK] += duration * state.external[i] * v[i]
    state.works[CONTACT_WORK] += duration * contact_power
    hand = inputs.integers[HAND_INDEX]
    if hand >= 0:
        state.works[PATIENT_WORK] += duration * state.changing[HAND_TORQUE] * v[hand]


def _integrate(episode: Episode, tick: int) -> None:
    """All substeps of one tick."""
    inputs, state = episode.inputs, episode.state
    step = inputs.numbers[STEP]
    for substep in range(inputs.integers[SUBSTEPS]):
        state.changing[TIME] = tick * inputs.numbers[PERIOD] + substep * step
        if inputs.integers[USE_RK4] != 0:
            room = (state.stage_q, state.stage_v, state.a, state.sum_v, state.sum_a)
            rk4_step(_acceleration, episode, state.q, state.v, step, room)
        else:
            _euler_step(episode, step)


def _euler_step(episode: Episode, step: float) -> None:
    """One semi-implicit Euler step; the torques work on the mean of old and new velocity."""
    inputs, state = episode.inputs, episode.state
    n = state.q.shape[0]
    mean = state.mean_v
    for i in range(n):
        mean[i] = state.v[i]
    semi_implicit_euler_step(_acceleration, episode, state.q, state.v, step, state.a)
    if inputs.integers[RECORD] != 0:
        for i in range(n):
            mean[i] = 0.5 * (mean[i] + state.v[i])
        contact = 0.5 * (state.changing[CONTACT_POWER] + state.changing[LAST_CONTACT_POWER])
        state.changing[LAST_CONTACT_POWER] = state.changing[CONTACT_POWER]
        _add_work(episode, step, contact, mean)


def _foot_sum(points: Array, leg: int, points_per_foot: int, column: int) -> float:
    total = 0.0
    for number in range(leg * points_per_foot, (leg + 1) * points_per_foot):
        total += points[number, column]
    return total


def _command(episode: Episode, tick: int) -> None:
    """Let the belt follow its profile, and tell the legs to walk or to stand."""
    inputs, state = episode.inputs, episode.state
    if inputs.belt[BELT_RAMP] > 0.0:
        time = tick * inputs.numbers[PERIOD]
        inputs.contact[0] = belt_speed(
            time - inputs.belt[BELT_DELAY],
            inputs.belt[BELT_CRUISE],
            inputs.belt[BELT_START],
            inputs.belt[BELT_STOP],
            inputs.belt[BELT_RAMP],
        )
        walk = walk_command(time, inputs.belt[BELT_START], inputs.belt[BELT_STOP])
        state.signals[state.signals.shape[0] - 1] = walk
        if walk == 0.0:
            state.counters[2] = tick


def _measure(episode: Episode, tick: int) -> None:
    """Encoders, velocity estimates and foot loads."""
    inputs, state = episode.inputs, episode.state
    noise_row = tick % inputs.noise.shape[0]
    for joint in range(inputs.coordinates.shape[0]):
        reading = state.q[inputs.coordinates[joint]] + inputs.noise[noise_row, joint]
        if inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
            reading = faulty_angle(
                joint,
                tick,
                inputs.numbers[PERIOD],
                inputs.faults,
                inputs.magnitudes,
                reading,
                state.angles[joint],
            )
        state.angles[joint] = reading
        state.last_angle[joint] = state.measured[joint, 0]
        # The estimate of the acceleration needs the last fast velocity.
        state.last_fast[joint] = state.measured[joint, 1]
    measure_joints(
        tick,
        state.angles,
        inputs.resolution,
        inputs.numbers[PERIOD],
        inputs.numbers[FAST_GAIN],
        inputs.integers[DECIMATION],
        state.measured,
        state.decimated_angle,
        state.ring,
    )
    if tick % inputs.integers[DECIMATION] == 0:
        _model_friction(episode)
    if inputs.integers[POINTS_PER_FOOT] > 0:
        contact_forces(state.q, state.v, inputs.bodies, inputs.contact, state.points)
        for leg in range(inputs.integers[N_LEGS]):
            load = _foot_sum(state.points, leg, inputs.integers[POINTS_PER_FOOT], 1)
            load /= inputs.numbers[BODY_WEIGHT]
            state.last_load[leg] = state.legs[leg]
            if inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
                load = faulty_load(leg, tick, inputs.faults, load, state.last_load[leg])
            state.legs[leg] = load


def _model_friction(episode: Episode) -> None:
    """Friction torque of the compensator's model; it changes only with the slow velocity."""
    inputs, state = episode.inputs, episode.state
    for joint in range(inputs.coordinates.shape[0]):
        state.model_friction[joint] = rotational_friction_torque(
            state.measured[joint, 2],
            inputs.friction_model[joint, 0],
            inputs.friction_model[joint, 1],
            inputs.friction_model[joint, 2],
            inputs.friction_model[joint, 3],
        )


def _watch(episode: Episode, tick: int) -> None:
    """Let the safety monitor look at measurements, phases and the drives' last tick."""
    inputs, state = episode.inputs, episode.state
    joints = inputs.coordinates.shape[0]
    for joint in range(joints):
        cause = watch_joint(
            joint,
            inputs.numbers[PERIOD],
            inputs.bounds,
            state.measured,
            state.last_angle,
            state.watch_memory,
            state.watch_streaks,
        )
        if cause != NO_TRIP:
            _trip(episode, tick, cause, joint)
            if state.watch_streaks[joint, DRIVE_STREAK] >= inputs.bounds[joint, DRIVE_TICKS]:
                state.drive_off[joint] = 1
                state.safety[DRIVES_OFF] = 1
    for leg in range(inputs.integers[N_LEGS]):
        if tick - max(state.entry_tick[leg], state.counters[2]) > inputs.integers[OVERSTAY_TICKS]:
            _trip(episode, tick, OVERSTAY_TRIP, joints + leg)
    if inputs.integers[POINTS_PER_FOOT] > 0:
        _watch_feet(episode, tick)
    low = state.changing[BUS_VOLTAGE] < inputs.numbers[LEAST_VOLTAGE]
    state.safety[LOW_VOLTAGE_STREAK] = state.safety[LOW_VOLTAGE_STREAK] + 1 if low else 0
    if state.safety[LOW_VOLTAGE_STREAK] >= inputs.integers[VOLTAGE_TICKS]:
        _trip(episode, tick, SUPPLY_TRIP, -1)


def _watch_feet(episode: Episode, tick: int) -> None:
    """Trip if the load of a foot stands still while the hip above it turns."""
    inputs, state = episode.inputs, episode.state
    for leg in range(inputs.integers[N_LEGS]):
        hip = leg * inputs.integers[JOINTS_PER_LEG]
        still = state.legs[leg] == state.last_load[leg] and state.legs[leg] > 0.0
        turning = abs(state.watch_memory[hip, MOTOR_SPEED]) > inputs.bounds[hip, FROZEN_SPEED]
        state.load_streaks[leg] = state.load_streaks[leg] + 1 if still and turning else 0
        if state.load_streaks[leg] >= inputs.integers[FROZEN_LOAD_TICKS]:
            _trip(episode, tick, LOAD_TRIP, inputs.coordinates.shape[0] + leg)


def _trip(episode: Episode, tick: int, cause: int, place: int) -> None:
    """Go to the safe hold; the first cause is kept."""
    inputs, state = episode.inputs, episode.state
    if state.safety[TRIP_TICK] >= 0:
        return
    state.safety[TRIP_TICK] = tick
    state.safety[TRIP_CAUSE] = cause
    state.safety[TRIP_PLACE] = place
    for joint in range(inputs.coordinates.shape[0]):
        # The angles of this tick may be what the monitor tripped on.
        state.hold_angle[joint] = state.last_angle[joint]


def _decide(episode: Episode, tick: int) -> None:
    """Advance all legs on one snapshot, then blend their parameters."""
    inputs, state = episode.inputs, episode.state
    legs, per_leg = inputs.integers[N_LEGS], inputs.integers[JOINTS_PER_LEG]
    half = state.signals.shape[0] // 2
    for leg in range(legs):
        state.leg_ticks[leg] = tick - state.entry_tick[leg]
        state.before[leg] = state.phase[leg]
    for leg in range(legs):
        period = inputs.numbers[PERIOD]
        leg_signals(leg, per_leg, state.measured, state.legs, state.leg_ticks, period, state.signals, 0)
        other = -1
        if legs == 2:
            leg_signals(
                1 - leg, per_leg, state.measured, state.legs, state.leg_ticks, period, state.signals, half
            )
            other = state.before[1 - leg]
        chosen = next_transition(
            state.before[leg],
            state.leg_ticks[leg],
            inputs.minimum_ticks[state.before[leg]],
            inputs.transitions,
            inputs.nodes,
            inputs.comparisons,
            state.signals,
            other,
            state.dwell,
            leg * inputs.transitions.shape[0],
        )
        if chosen != NO_TRANSITION:
            _switch(episode, leg, tick, chosen)
    for leg in range(legs):
        ticks = tick - state.entry_tick[leg]
        if ticks > inputs.integers[BLEND_TICKS]:
            continue  # the fade is over
        blend_phase(
            leg,
            ticks,
            inputs.integers[BLEND_TICKS],
            inputs.integers[BLEND_LAW],
            state.blend_start,
            inputs.phase_rows[leg, state.phase[leg]],
            state.blended,
        )


def _switch(episode: Episode, leg: int, tick: int, chosen: int) -> None:
    """Enter a phase and note it."""
    inputs, state = episode.inputs, episode.state
    target = inputs.transitions[chosen, TARGET]
    number = state.counters[0]
    if number < state.switches.shape[0]:
        state.switches[number, 0] = tick
        state.switches[number, 1] = leg
        state.switches[number, 2] = state.phase[leg]
        state.switches[number, 3] = target
        state.switches[number, 4] = chosen
    state.counters[0] = number + 1
    state.phase[leg] = target
    state.entry_tick[leg] = tick
    for column in range(state.blended.shape[1]):
        state.blend_start[leg, column] = state.blended[leg, column]


def _follow(episode: Episode, tick: int) -> None:
    """Move the equilibrium angles along the path, and let the dampers move with it."""
    inputs, state = episode.inputs, episode.state
    per_leg, cycle = inputs.integers[JOINTS_PER_LEG], inputs.integers[CYCLE_TICKS]
    spacing = cycle * inputs.numbers[PERIOD] / (inputs.path.shape[0] - 1)
    for leg in range(inputs.integers[N_LEGS]):
        before, share = cycle_place(inputs.path_starts[leg] + tick / cycle, inputs.path.shape[0])
        for number in range(per_leg):
            start = inputs.path[before, number]
            change = inputs.path[before + 1, number] - start
            column = COLUMNS_PER_JOINT * number
            state.blended[leg, column + EQUILIBRIUM] = start + share * change
            state.lead[leg * per_leg + number] = state.blended[leg, column + DAMPING] * change / spacing


def _judge(episode: Episode, tick: int) -> None:
    """Sum up how far the joints are from the path, and adapt the help when a stride is over."""
    inputs, state = episode.inputs, episode.state
    per_leg = inputs.integers[JOINTS_PER_LEG]
    for leg in range(inputs.integers[N_LEGS]):
        if tick > 0 and state.phase[leg] == 0 and state.entry_tick[leg] == tick:
            _end_stride(episode, leg, tick)
        progress = (tick - state.stride_start[leg]) / state.stride_ticks[leg]
        if state.stride_start[leg] == 0:
            progress += inputs.path_starts[leg]
        before, share = cycle_place(progress, inputs.path.shape[0])
        for number in range(per_leg):
            start = inputs.path[before, number]
            wanted = start + share * (inputs.path[before + 1, number] - start)
            joint = leg * per_leg + number
            state.tracking[joint] += abs(state.measured[joint, 0] - wanted)


def _end_stride(episode: Episode, leg: int, tick: int) -> None:
    """Adapt the help of one leg to the errors of the stride that ends with this foot contact."""
    inputs, state = episode.inputs, episode.state
    per_leg = inputs.integers[JOINTS_PER_LEG]
    duration = tick - state.stride_start[leg]
    for joint in range(leg * per_leg, (leg + 1) * per_leg):
        state.assistance[joint] = adapted_assistance(
            state.assistance[joint],
            state.tracking[joint] / duration,
            inputs.numbers[FORGETTING],
            inputs.numbers[ASSISTANCE_GAIN],
            inputs.numbers[ALLOWANCE],
            inputs.numbers[LEAST_ASSISTANCE],
        )
        state.tracking[joint] = 0.0
    if state.stride_start[leg] > 0:  # the first stride may have begun half-way
        state.stride_ticks[leg] = duration
    state.stride_start[leg] = tick


def _feed_forward(episode: Episode) -> None:
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


def _control(episode: Episode, joint: int, tick: int, rows: Array) -> float:
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
                _trip(episode, tick, COMMAND_TRIP, joint)
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


def _push(episode: Episode, tick: int) -> None:
    """Torques from outside for this tick: a push, and what the wearer does."""
    inputs, state = episode.inputs, episode.state
    for joint in range(inputs.coordinates.shape[0]):
        state.external[inputs.coordinates[joint]] = inputs.push[joint]
    if inputs.integers[WEARER] != 0:
        per_leg = inputs.integers[JOINTS_PER_LEG]
        for leg in range(inputs.integers[N_LEGS]):
            hip = state.q[inputs.coordinates[leg * per_leg]]
            knee = state.q[inputs.coordinates[leg * per_leg + 1]]
            ankle = 0.0
            if inputs.integers[N_ANKLES] > 0:
                ankle = state.q[inputs.ankles[leg]]
            passive = passive_hip_torque(
                hip - inputs.conditions[leg * per_leg, CONTRACTURE],
                knee - inputs.conditions[leg * per_leg + 1, CONTRACTURE],
            )
            _wear(episode, tick, leg * per_leg, passive, hip)
            passive = passive_knee_torque(
                hip - inputs.conditions[leg * per_leg, CONTRACTURE],
                knee - inputs.conditions[leg * per_leg + 1, CONTRACTURE],
                ankle,
            )
            _wear(episode, tick, leg * per_leg + 1, passive, hip)


def _wear(episode: Episode, tick: int, joint: int, passive: float, hip: float) -> None:
    """Add the wearer's torque on one joint; his effort comes late."""
    inputs, state = episode.inputs, episode.state
    ring = state.efforts.shape[0]
    phase = state.phase[joint // inputs.integers[JOINTS_PER_LEG]]
    below, share = posture_place(
        hip, inputs.numbers[LOWEST_POSTURE], inputs.numbers[POSTURE_STEP], inputs.effort_moments.shape[2]
    )
    lower = inputs.effort_moments[joint, phase, below]
    moment = lower + share * (inputs.effort_moments[joint, phase, below + 1] - lower)
    state.efforts[tick % ring, joint] = inputs.conditions[joint, EFFORT] * moment
    effort = state.efforts[(tick + 1) % ring, joint]
    effort *= 1.0 + inputs.effort_noise[tick % inputs.effort_noise.shape[0], joint]
    index = inputs.coordinates[joint]
    catch = spastic_torque(
        state.v[index], inputs.conditions[joint, CATCH_SPEED], inputs.conditions[joint, CATCH_GAIN]
    )
    state.external[index] += inputs.conditions[joint, PASSIVE_SHARE] * passive + catch + effort


def _supply(episode: Episode, tick: int, battery_power: float) -> None:
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


def _record(episode: Episode, tick: int, battery_power: float, rows: Array) -> None:
    """Write everything that is not a controller's, at the state before integration."""
    inputs, state = episode.inputs, episode.state
    state.changing[TIME] = tick * inputs.numbers[PERIOD]
    _acceleration(episode, 0.0, 0.0, state.q, state.v, state.a)
    row = tick - inputs.integers[FIRST_ROW]
    for leg in range(inputs.integers[N_LEGS]):
        rows[row, leg] = state.phase[leg]
    for joint in range(inputs.coordinates.shape[0]):
        index = inputs.coordinates[joint]
        first = inputs.integers[N_LEGS] + JOINT_WIDTH * joint
        rows[row, first] = state.q[index]
        rows[row, first + 1] = state.v[index]
        rows[row, first + PASSIVE] = state.passive[index, FRICTION]
        rows[row, first + PASSIVE + 1] = state.passive[index, STOP]
        hand = state.changing[HAND_TORQUE] if inputs.integers[HAND_INDEX] == index else 0.0
        rows[row, first + PASSIVE + 2] = hand + state.external[index]
    place = inputs.integers[N_LEGS] + JOINT_WIDTH * inputs.coordinates.shape[0]
    for ankle in range(inputs.integers[N_ANKLES]):
        index = inputs.ankles[ankle]
        rows[row, place] = state.q[index]
        rows[row, place + 1] = state.v[index]
        rows[row, place + 2] = state.passive[index, SPRING]
        place += ANKLE_WIDTH
    per_foot = inputs.integers[POINTS_PER_FOOT]
    if per_foot > 0:
        for leg in range(inputs.integers[N_LEGS]):
            rows[row, place] = _foot_sum(state.points, leg, per_foot, 1)
            rows[row, place + 1] = _foot_sum(state.points, leg, per_foot, 0)
            lowest = state.points[leg * per_foot, 2]
            for number in range(leg * per_foot, (leg + 1) * per_foot):
                lowest = min(lowest, state.points[number, 2])
            rows[row, place + 2] = lowest
            place += FOOT_WIDTH
    kinetic, potential, force, moment = observe(
        state.q, state.v, state.a, inputs.bodies, inputs.numbers[GRAVITY], state.points
    )
    pelvis = inputs.integers[PELVIS_INDEX]
    if pelvis >= 0:
        rows[row, place] = state.q[pelvis]
        rows[row, place + 1] = state.v[pelvis]
        rows[row, place + 2] = state.passive[pelvis, SPRING]
        rows[row, place + 3] = force
        rows[row, place + 4] = moment
        place += PELVIS_WIDTH
    rows[row, place] = state.changing[BUS_VOLTAGE]
    rows[row, place + 1] = battery_power
    rows[row, place + 2] = kinetic
    rows[row, place + 3] = potential
    place += 4
    for source in range(state.works.shape[0]):
        rows[row, place + source] = state.works[source]
    place += state.works.shape[0]
    rows[row, place] = 1.0 if state.safety[TRIP_TICK] >= 0 else 0.0
    rows[row, place + 1] = state.safety[TRIP_CAUSE]


def _status(episode: Episode) -> int:
    """Whether the run goes on."""
    inputs, state = episode.inputs, episode.state
    for i in range(state.q.shape[0]):
        if not (np.isfinite(state.q[i]) and abs(state.v[i]) < inputs.numbers[DIVERGED_VELOCITY]):
            return DIVERGED
    pelvis = inputs.integers[PELVIS_INDEX]
    if pelvis >= 0 and state.q[pelvis] < inputs.numbers[FALL_HEIGHT]:
        return FELL
    return COMPLETED


def run_ticks(episode: Episode, first: int, end: int, rows: Array) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the wearer falls or the state diverges.

    Args:
        episode: Inputs and state; the state is changed in place.
        first: First tick.
        end: One past the last tick.
        rows: Log, shape ``(n_rows, n_columns)``; if the episode records, a tick is written to row
            ``tick - FIRST_ROW``.

    Returns:
        Ticks that have been run since the start of the episode; ``state.counters[1]`` is the status.
    """
    inputs, state = episode.inputs, episode.state
    record = inputs.integers[RECORD] != 0
    for tick in range(first, end):
        _command(episode, tick)
        _measure(episode, tick)
        if inputs.integers[WATCHING] != 0:
            _watch(episode, tick)
        if state.safety[TRIP_TICK] < 0:
            _decide(episode, tick)
            if inputs.integers[FOLLOWS] != 0:
                _follow(episode, tick)
            if inputs.integers[ADAPTS] != 0:
                _judge(episode, tick)
        _feed_forward(episode)
        battery_power = 0.0
        for joint in range(inputs.coordinates.shape[0]):
            battery_power += _control(episode, joint, tick, rows)
        _push(episode, tick)
        if record:
            _record(episode, tick, battery_power, rows)
        _supply(episode, tick, battery_power)
        _integrate(episode, tick)
        status = _status(episode)
        if status != COMPLETED:
            state.counters[1] = status
            return tick + 1
    return end
