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
    log_row,
)
from twin_gait.simulation.rooms.monitor import trip


def feed_forward(e: Episode) -> None:
    """Gravity and inertia torques of the controller's model, where a share of them is wanted."""
    model, holding = e.control, e.trip.tick >= 0
    wanted = holding or INERTIA_WANTED
    for leg in e.legs:
        wanted = wanted or leg.gravity != 0.0
    if not wanted:
        return
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


def control(e: Episode, number: int, tick: int) -> float:
    """Torque of one motor for this tick; returns its electrical power in [W]."""
    joint, leg = e.joints[number], e.legs[number // JOINTS_PER_LEG]
    encoder, setpoint = joint.encoder, joint.blended
    stiffness, damping = setpoint.stiffness, setpoint.damping
    equilibrium, gain = setpoint.equilibrium, setpoint.gain
    if ASSISTS:
        stiffness *= joint.assistance
        damping *= joint.assistance
    impedance, friction, gravity, inertia, target, command = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    support = 0.0
    if e.trip.tick >= 0:
        support = support_share(tick - e.trip.tick, e.limits.lowering_ticks)
    else:
        impedance, friction = controller_torques(
            encoder.angle,
            encoder.velocity_fast,
            encoder.velocity_slow,
            stiffness,
            damping,
            equilibrium,
            gain,
            joint.model_friction,
        )
        if FAULTY:
            if tick >= e.first_fault:
                impedance += runaway_torque(number, tick, e.rates.period, e.faults)
        gravity = leg.gravity * e.control.gravity_torque[joint.control_place] if leg.gravity != 0.0 else 0.0
        inertia = e.control.inertia_gain * e.control.inertia_torque[joint.control_place]
        target = joint.target
        if FOLLOWS:
            target += joint.lead
        command = impedance + friction + gravity + inertia + target
        if e.watching:
            if not command_is_plausible(command, joint.bounds.highest_command):
                trip(e, tick, COMMAND_TRIP, number)
    if e.trip.tick >= 0:
        stiffness, damping, gain = 0.0, e.limits.hold_damping, 0.0
        equilibrium = joint.hold_angle
        friction, inertia, target = 0.0, 0.0, 0.0
        impedance = hold_torque(joint.watched.motor_speed, damping)
        gravity = support * e.control.gravity_torque[joint.control_place] if support != 0.0 else 0.0
        command = impedance + friction + gravity + inertia + target
    target_current, current, torque = drive(e, number, tick, command)
    if e.recording.on:
        row = log_row(e, tick).joints[number]
        row.measured_angle = encoder.angle
        row.velocity_fast = encoder.velocity_fast
        row.velocity_slow = encoder.velocity_slow
        row.impedance_torque = impedance
        row.friction_compensation_torque = friction
        row.gravity_compensation_torque = gravity
        row.inertia_compensation_torque = inertia
        row.target_torque = target
        row.motor_command_torque = command
        row.motor_torque = torque
        row.target_current = target_current
        row.measured_current = current
        row.stiffness = stiffness
        row.damping = damping
        row.equilibrium = equilibrium
        row.friction_compensation_gain = gain
    motor = joint.motor
    return motor_electrical_power(
        current, e.v[joint.place], motor.resistance, motor.torque_constant, motor.gear_ratio
    )


def drive(e: Episode, number: int, tick: int, command: float) -> tuple[float, float, float]:
    """Target current, measured current and torque of a motor, and what the monitor keeps of them."""
    joint, voltage = e.joints[number], e.supply.bus_voltage
    velocity, motor, watched = e.v[joint.place], joint.motor, joint.watched
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
    watched.commanded = command
    watched.motor_current = current
    watched.current_deviation = current - expected
    watched.motor_speed = motor_speed(
        current, velocity, motor.resistance, joint.bounds.emf_constant, joint.bounds.model_resistance
    )
    return target_current, current, torque


def supply(e: Episode, tick: int, battery_power: float) -> None:
    """Bus voltage of the next tick."""
    battery = e.supply
    voltage = sagged_bus_voltage(battery.voltage, battery.resistance, battery_power, battery.bus_voltage)
    if FAULTY:
        if tick >= e.first_fault:
            drop = supply_drop(tick, e.faults)
            if drop > 0.0:
                highest = 0.0
                for joint in e.joints:
                    highest = max(highest, joint.bounds.emf_constant * abs(e.v[joint.place]))
                voltage = dipped_bus_voltage(voltage, drop, highest)
    battery.bus_voltage = voltage
