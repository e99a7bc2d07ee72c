"""From the command of the controller to the torques of the motors and the voltage of the battery."""

from __future__ import annotations

from twin_gait.core.actuator import battery_power, motor_electrical_power, sagged_bus_voltage
from twin_gait.core.control_tick import controller_torques, drive_motor
from twin_gait.core.estimation import delayed_sample, first_order_step
from twin_gait.core.faults import (
    MOTOR_STUCK,
    NO_FAULT,
    dipped_bus_voltage,
    drive_fault,
    runaway_torque,
    supply_drop,
)
from twin_gait.core.safety import (
    COMMAND_TRIP,
    NO_TRIP,
    command_is_plausible,
    hold_torque,
    motor_speed,
    support_share,
)
from twin_gait.simulation.episode import Episode, Joint
from twin_gait.simulation.interface import (
    ASSISTS,
    DELAYED,
    FAULTY,
    FOLLOWS,
    INERTIA_WANTED,
    JOINTS_PER_LEG,
    control_gravity,
    control_inertia,
    each,
    lanes,
)
from twin_gait.simulation.rooms.monitor import trip


def feed_forward(e: Episode) -> None:
    """Gravity and inertia torques of the controller's model, where a share of them is wanted."""
    wanted = False
    for one in lanes(e):
        wanted |= _wants_gravity(one)
    if wanted:
        for number in range(len(e.joints)):
            for one in lanes(e):
                joint = one.joints[number]
                angle = joint.hold_angle if one.trip.tick >= 0 else joint.encoder.angle
                one.control.q[joint.control_place] = angle
        for one in lanes(e):
            if _wants_gravity(one):
                model = one.control
                control_gravity(model.q, model.bodies, one.gravity, model.gravity_torque)
    if INERTIA_WANTED:
        for number in range(len(e.joints)):
            for one in lanes(e):
                _estimate_acceleration(one, number)
        for one in lanes(e):
            model = one.control
            control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def _wants_gravity(e: Episode) -> bool:
    """Whether the weight of a leg is compensated, or carried in the hold."""
    wanted = INERTIA_WANTED or e.trip.tick >= 0
    for leg in e.legs:
        wanted = wanted or leg.gravity != 0.0
    return wanted


def _estimate_acceleration(e: Episode, number: int) -> None:
    """Acceleration of a joint, from the change of its fast velocity."""
    joint = e.joints[number]
    rate = (joint.encoder.velocity_fast - joint.encoder.last_fast) / e.rates.period
    joint.rate = first_order_step(joint.rate, rate, e.rates.fast_gain)
    e.control.a[joint.control_place] = joint.rate


def control(e: Episode, tick: int) -> None:
    """Command and drive joint after joint: one is driven before the next one's command is known."""
    for one in lanes(e):
        one.supply.power = 0.0
    for number in range(len(e.joints)):
        implausible = False
        for one in lanes(e):
            demand(one, number)
            if not FAULTY:
                check_command(one, number)
        if FAULTY:
            for one in each(e):
                _run_away(one, number, tick)
                check_command(one, number)
        for one in lanes(e):
            implausible |= one.joints[number].command.cause != NO_TRIP
        if implausible:
            for one in each(e):
                trip(one, tick, one.joints[number].command.cause, number)
        for one in lanes(e):
            drive(one, number, tick)
            if not FAULTY:
                _note_drive(one, number)
        if FAULTY:
            for one in each(e):
                _drive_faulty(one, number, tick)
                _note_drive(one, number)
        if DELAYED:
            for one in each(e):
                joint = one.joints[number]
                joint.due = delayed_sample(joint.line, tick, joint.command.torque)
    for one in lanes(e):
        battery = one.supply
        battery.power = battery_power(battery.power, battery.constant_power, battery.regeneration)


def demand(e: Episode, number: int) -> None:
    """What the controller asks of a joint."""
    joint, leg = e.joints[number], e.legs[number // JOINTS_PER_LEG]
    asked, encoder, setpoint, place = joint.command, joint.encoder, joint.blended, joint.control_place
    weight, inertia = e.control.gravity_torque[place], e.control.inertia_torque[place]
    if e.trip.tick < 0:
        stiffness, damping = setpoint.stiffness, setpoint.damping
        if ASSISTS:
            stiffness *= joint.assistance
            damping *= joint.assistance
        asked.stiffness, asked.damping = stiffness, damping
        asked.equilibrium, asked.gain = setpoint.equilibrium, setpoint.gain
        asked.impedance, asked.friction = controller_torques(
            encoder.angle,
            encoder.velocity_fast,
            encoder.velocity_slow,
            stiffness,
            damping,
            setpoint.equilibrium,
            setpoint.gain,
            joint.model_friction,
        )
        asked.gravity = leg.gravity * weight if leg.gravity != 0.0 else 0.0
        asked.inertia = e.control.inertia_gain * inertia
        asked.target = joint.target
        if FOLLOWS:
            asked.target += joint.lead


def _run_away(e: Episode, number: int, tick: int) -> None:
    """Add what a controller gone wrong asks for."""
    if tick >= e.first_fault and e.trip.tick < 0:
        e.joints[number].command.impedance += runaway_torque(number, tick, e.rates.period, e.faults)


def check_command(e: Episode, number: int) -> None:
    """Sum the command up, and note the cause of a trip if no drive may be asked for it."""
    joint, watching = e.joints[number], e.watching
    asked = joint.command
    asked.torque = asked.impedance + asked.friction + asked.gravity + asked.inertia + asked.target
    wild = (
        watching and e.trip.tick < 0 and not command_is_plausible(asked.torque, joint.bounds.highest_command)
    )
    asked.cause = COMMAND_TRIP if wild else NO_TRIP


def hold(joint: Joint, damping: float, support: float, weight: float) -> None:
    """Brake a joint after a trip, and let it down slowly.

    Args:
        joint: Its command is changed in place.
        damping: In [N m s] / [rad].
        support: Share of the weight that is still carried.
        weight: Gravity torque in [N m].
    """
    asked = joint.command
    asked.stiffness, asked.damping, asked.gain = 0.0, damping, 0.0
    asked.equilibrium = joint.hold_angle
    asked.friction, asked.inertia, asked.target = 0.0, 0.0, 0.0
    asked.impedance = hold_torque(joint.watched.motor_speed, damping)
    asked.gravity = support * weight if support != 0.0 else 0.0
    asked.torque = asked.impedance + asked.friction + asked.gravity + asked.inertia + asked.target


def drive(e: Episode, number: int, tick: int) -> None:
    """Current and torque of a motor, of the command or in the hold."""
    joint = e.joints[number]
    place, weight = joint.place, e.control.gravity_torque[joint.control_place]
    asked, motor, watched = joint.command, joint.motor, joint.watched
    if e.trip.tick >= 0:
        # In the tick of a trip on the command this is still a walk, whose weight is not carried.
        walks = asked.cause != NO_TRIP
        support = 0.0 if walks else support_share(tick - e.trip.tick, e.limits.lowering_ticks)
        hold(joint, e.limits.hold_damping, support, weight)
    command = joint.due if DELAYED else asked.torque
    target_current, current, torque = drive_motor(
        motor, command, e.v[place], e.supply.bus_voltage, e.limits.torque, e.limits.current
    )
    off = joint.drive_off
    asked.target_current = 0.0 if off else target_current
    watched.motor_current = 0.0 if off else current
    e.motor[place] = 0.0 if off else torque
    watched.current_deviation = 0.0


def _drive_faulty(e: Episode, number: int, tick: int) -> None:
    """Current and torque of a motor under its faults."""
    joint = e.joints[number]
    motor, watched = joint.motor, joint.watched
    if tick >= e.first_fault and not joint.drive_off:
        row = drive_fault(number, tick, e.faults)
        if row != NO_FAULT:
            fault, expected = e.faults[row], watched.motor_current
            wrong = fault.magnitude if fault.kind == MOTOR_STUCK else 0.0
            _, watched.motor_current, e.motor[joint.place] = drive_motor(
                motor, wrong, e.v[joint.place], e.supply.bus_voltage, e.limits.torque, e.limits.current
            )
            watched.current_deviation = watched.motor_current - expected


def _note_drive(e: Episode, number: int) -> None:
    """What the monitor keeps of a drive, and what it draws."""
    joint = e.joints[number]
    motor, watched, velocity = joint.motor, joint.watched, e.v[joint.place]
    current = watched.motor_current
    watched.commanded = joint.command.torque
    watched.motor_speed = motor_speed(
        current, velocity, motor.resistance, joint.bounds.emf_constant, joint.bounds.model_resistance
    )
    e.supply.power += motor_electrical_power(
        current, velocity, motor.resistance, motor.torque_constant, motor.gear_ratio
    )


def supply(e: Episode, tick: int) -> None:
    """Bus voltage of the next tick."""
    for one in lanes(e):
        battery = one.supply
        battery.bus_voltage = sagged_bus_voltage(
            battery.voltage, battery.resistance, battery.power, battery.bus_voltage
        )
    if FAULTY:
        for one in each(e):
            if tick >= one.first_fault:
                _dip(one, tick)


def _dip(e: Episode, tick: int) -> None:
    """Let a fault of the supply lower its voltage."""
    drop, highest = supply_drop(tick, e.faults), 0.0
    if drop > 0.0:
        for joint in e.joints:
            highest = max(highest, joint.bounds.emf_constant * abs(e.v[joint.place]))
        e.supply.bus_voltage = dipped_bus_voltage(e.supply.bus_voltage, drop, highest)
