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
)


def feed_forward(e: Episode) -> None:
    """Gravity and inertia torques of the controller's model, where a share of them is wanted."""
    model, holding = e.control, e.trip.tick >= 0
    wanted = holding or INERTIA_WANTED
    for leg in e.legs:
        wanted = wanted or leg.gravity != 0.0
    if wanted:
        for joint in e.joints:
            model.q[joint.control_place] = joint.hold_angle if holding else joint.encoder.angle
        control_gravity(model.q, model.bodies, e.gravity, model.gravity_torque)
    if INERTIA_WANTED:
        if not holding:
            for joint in e.joints:
                rate = (joint.encoder.velocity_fast - joint.encoder.last_fast) / e.rates.period
                joint.rate = first_order_step(joint.rate, rate, e.rates.fast_gain)
                model.a[joint.control_place] = joint.rate
            control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def demand(e: Episode, number: int, tick: int) -> int:
    """What the controller asks of a joint; the cause of a trip if no drive may be asked for it."""
    joint, leg = e.joints[number], e.legs[number // JOINTS_PER_LEG]
    asked, encoder, setpoint, cause = joint.command, joint.encoder, joint.blended, NO_TRIP
    if e.trip.tick < 0:
        stiffness, damping = setpoint.stiffness, setpoint.damping
        if ASSISTS:
            stiffness *= joint.assistance
            damping *= joint.assistance
        impedance, friction = controller_torques(
            encoder.angle,
            encoder.velocity_fast,
            encoder.velocity_slow,
            stiffness,
            damping,
            setpoint.equilibrium,
            setpoint.gain,
            joint.model_friction,
        )
        if FAULTY:
            if tick >= e.first_fault:
                impedance += runaway_torque(number, tick, e.rates.period, e.faults)
        weight = e.control.gravity_torque[joint.control_place]
        gravity = leg.gravity * weight if leg.gravity != 0.0 else 0.0
        inertia = e.control.inertia_gain * e.control.inertia_torque[joint.control_place]
        target = joint.target
        if FOLLOWS:
            target += joint.lead
        torque = impedance + friction + gravity + inertia + target
        if e.watching:
            if not command_is_plausible(torque, joint.bounds.highest_command):
                cause = COMMAND_TRIP
        asked.torque = torque
        if e.recording.on:
            asked.stiffness, asked.damping = stiffness, damping
            asked.equilibrium, asked.gain = setpoint.equilibrium, setpoint.gain
            asked.impedance, asked.friction, asked.gravity = impedance, friction, gravity
            asked.inertia, asked.target = inertia, target
    asked.cause = cause
    return cause


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
    battery = e.supply
    voltage = sagged_bus_voltage(battery.voltage, battery.resistance, battery.power, battery.bus_voltage)
    if FAULTY:
        if tick >= e.first_fault:
            drop = supply_drop(tick, e.faults)
            if drop > 0.0:
                highest = 0.0
                for joint in e.joints:
                    highest = max(highest, joint.bounds.emf_constant * abs(e.v[joint.place]))
                voltage = dipped_bus_voltage(voltage, drop, highest)
    battery.bus_voltage = voltage
