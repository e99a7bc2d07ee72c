"""From the command of the controller to the torques of the motors and the voltage of the battery."""

from __future__ import annotations

from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.control_tick import controller_torques, drive_motor
from twin_gait.core.estimation import first_order_step
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
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import (
    ASSISTS,
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
        wanted |= _wants_feed_forward(one)
    if wanted:
        for one in lanes(e):
            if _wants_feed_forward(one):
                _compensate_gravity(one)
    if INERTIA_WANTED:
        for one in lanes(e):
            if one.trip.tick < 0:
                _compensate_inertia(one)


def _wants_feed_forward(e: Episode) -> bool:
    wanted = INERTIA_WANTED or e.trip.tick >= 0
    for leg in e.legs:
        wanted = wanted or leg.gravity != 0.0
    return wanted


def _compensate_gravity(e: Episode) -> None:
    """Gravity torques at the measured angles, or at those that are held."""
    model = e.control
    for joint in e.joints:
        model.q[joint.control_place] = joint.hold_angle if e.trip.tick >= 0 else joint.encoder.angle
    control_gravity(model.q, model.bodies, e.gravity, model.gravity_torque)


def _compensate_inertia(e: Episode) -> None:
    """Inertia torques at the measured angles and accelerations."""
    model = e.control
    for joint in e.joints:
        rate = (joint.encoder.velocity_fast - joint.encoder.last_fast) / e.rates.period
        joint.rate = first_order_step(joint.rate, rate, e.rates.fast_gain)
        model.a[joint.control_place] = joint.rate
    control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def control(e: Episode, tick: int) -> None:
    """Command and drive joint after joint: one is driven before the next one's command is known."""
    for one in lanes(e):
        one.supply.power = 0.0
    for number in range(len(e.joints)):
        causes = NO_TRIP
        for one in lanes(e):
            causes |= demand(one, number, tick)
        if causes != NO_TRIP:
            for one in each(e):
                trip(one, tick, one.joints[number].command.cause, number)
        for one in lanes(e):
            drive(one, number, tick)


def demand(e: Episode, number: int, tick: int) -> int:
    """What the controller asks of a joint; the cause of a trip if no drive may be asked for it."""
    joint, leg = e.joints[number], e.legs[number // JOINTS_PER_LEG]
    asked, encoder, setpoint = joint.command, joint.encoder, joint.blended
    asked.cause = NO_TRIP
    if e.trip.tick < 0:
        asked.stiffness, asked.damping = setpoint.stiffness, setpoint.damping
        asked.equilibrium, asked.gain = setpoint.equilibrium, setpoint.gain
        if ASSISTS:
            asked.stiffness *= joint.assistance
            asked.damping *= joint.assistance
        asked.impedance, asked.friction = controller_torques(
            encoder.angle,
            encoder.velocity_fast,
            encoder.velocity_slow,
            asked.stiffness,
            asked.damping,
            asked.equilibrium,
            asked.gain,
            joint.model_friction,
        )
        if FAULTY:
            if tick >= e.first_fault:
                asked.impedance += runaway_torque(number, tick, e.rates.period, e.faults)
        weight = e.control.gravity_torque[joint.control_place]
        asked.gravity = leg.gravity * weight if leg.gravity != 0.0 else 0.0
        asked.inertia = e.control.inertia_gain * e.control.inertia_torque[joint.control_place]
        asked.target = joint.target
        if FOLLOWS:
            asked.target += joint.lead
        asked.torque = asked.impedance + asked.friction + asked.gravity + asked.inertia + asked.target
        if e.watching:
            if not command_is_plausible(asked.torque, joint.bounds.highest_command):
                asked.cause = COMMAND_TRIP
    return asked.cause


def hold(e: Episode, number: int, tick: int) -> None:
    """Brake a joint after a trip, and let it down slowly."""
    joint = e.joints[number]
    asked, support = joint.command, 0.0
    if asked.cause == NO_TRIP:  # otherwise this is still the tick of a walk, whose weight is not carried
        support = support_share(tick - e.trip.tick, e.limits.lowering_ticks)
    asked.stiffness, asked.damping, asked.gain = 0.0, e.limits.hold_damping, 0.0
    asked.equilibrium = joint.hold_angle
    asked.friction, asked.inertia, asked.target = 0.0, 0.0, 0.0
    asked.impedance = hold_torque(joint.watched.motor_speed, asked.damping)
    asked.gravity = support * e.control.gravity_torque[joint.control_place] if support != 0.0 else 0.0
    asked.torque = asked.impedance + asked.friction + asked.gravity + asked.inertia + asked.target


def drive(e: Episode, number: int, tick: int) -> None:
    """Torque and power of a motor, and what the monitor keeps of them."""
    joint, voltage = e.joints[number], e.supply.bus_voltage
    if e.trip.tick >= 0:
        hold(e, number, tick)
    velocity, motor, watched, command = e.v[joint.place], joint.motor, joint.watched, joint.command.torque
    target_current, current, torque = drive_motor(
        motor, command, velocity, voltage, e.limits.torque, e.limits.current
    )
    expected = current
    if joint.drive_off:
        target_current, expected, current, torque = 0.0, 0.0, 0.0, 0.0
    elif FAULTY:
        if tick >= e.first_fault:
            row = drive_fault(number, tick, e.faults)
            if row != NO_FAULT:
                fault = e.faults[row]
                wrong = fault.magnitude if fault.kind == MOTOR_STUCK else 0.0
                _, current, torque = drive_motor(
                    motor, wrong, velocity, voltage, e.limits.torque, e.limits.current
                )
    e.motor[joint.place] = torque
    joint.command.target_current = target_current
    watched.commanded = command
    watched.motor_current = current
    watched.current_deviation = current - expected
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
