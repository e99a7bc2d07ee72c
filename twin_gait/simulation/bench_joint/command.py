"""The firmware's target of a tick: torque and current, or a duty."""

from __future__ import annotations

from twin_gait.control.gait_controller import CONTROLLED, controller_tick
from twin_gait.core.control_tick import controller_torques, target_current
from twin_gait.core.dead_zone import dead_zone
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import coulomb_viscous_tanh_torque
from twin_gait.core.motor_drive import cosine_path, inverter_voltage
from twin_gait.core.transparency import transparency_duty
from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.episode import DUTY, OPEN, BenchEpisode
from twin_gait.simulation.bench_joint.interface import log_row


def control(e: BenchEpisode, tick: int) -> None:
    """Target current or duty of a tick; writes the controller's columns."""
    if e.winding.drive == DUTY:
        _control_duty(e, tick)
    elif e.winding.drive != OPEN:
        _control_torque(e, tick)


def _control_duty(e: BenchEpisode, tick: int) -> None:
    """Duty that lets the joint be moved; no current loop is asked for anything."""
    motor, winding, velocity, counts = e.motor, e.winding, e.encoder.velocity_fast, e.test.drive.counts
    duty = transparency_duty(e.transparency, tick + e.variation.duty_start, velocity, e.bus_voltage, counts)
    winding.voltage = inverter_voltage(duty, counts, e.bus_voltage)
    winding.duty = winding.voltage / e.bus_voltage
    # What the firmware can know of it: the current that this voltage drives at the measured speed.
    back_emf = motor.torque_constant * motor.gear_ratio * velocity
    winding.target_current = (winding.voltage - back_emf) / motor.resistance


def _control_torque(e: BenchEpisode, tick: int) -> None:
    """Torque of impedance, compensations and target, and the current that gives it."""
    law, limits, encoder, row = e.torque_control, e.test.limits, e.encoder, log_row(e, tick)
    demand, inertia = e.device.joints[0].demand, e.rotor.inertia + e.link.inertia
    row.target_position, path_velocity, path_acceleration = cosine_path(
        tick * TICK, e.path.start_angle, e.path.amplitude, e.path.frequency
    )
    demand.stiffness, demand.damping = law.stiffness, law.damping
    demand.equilibrium, demand.gain = row.target_position, law.friction_compensation_gain
    demand.inertia = law.inertia_compensation * inertia * e.acceleration.estimate
    demand.target = law.target_torque + inertia * path_acceleration
    if CONTROLLED:
        _let_act(e, tick)
    row.impedance_torque, row.friction_compensation_torque = controller_torques(
        encoder.angle,
        encoder.velocity_fast - path_velocity,
        encoder.velocity_slow,
        demand.stiffness,
        demand.damping,
        demand.equilibrium,
        demand.gain,
        _model_friction(e, path_velocity),
    )
    row.inertia_compensation_torque = demand.inertia
    row.target_torque = demand.target
    command = row.impedance_torque + row.friction_compensation_torque + row.inertia_compensation_torque
    command += row.target_torque
    row.motor_command_torque = command
    e.winding.target_current = target_current(e.motor, command, limits.torque, limits.current)


def _let_act(e: BenchEpisode, tick: int) -> None:
    """Let a controller change what is demanded; gravity that it feeds forward goes with the target."""
    joint = e.device.joints[0]
    joint.measurement.angle, joint.measurement.velocity = e.encoder.angle, e.encoder.velocity_fast
    joint.demand.gravity = 0.0
    controller_tick(e.device.memory, e.device, tick, TICK)
    joint.demand.target += joint.demand.gravity


def _model_friction(e: BenchEpisode, path_velocity: float) -> float:
    """Friction torque of the compensator's model; the old one knew no slow velocity."""
    model, old = e.torque_control.friction_model, e.old_model
    measured = e.encoder.velocity_fast if e.old else e.encoder.velocity_slow
    velocity = dead_zone(path_velocity if e.follows_path else measured, e.torque_control.dead_zone)
    if e.old:
        return coulomb_viscous_tanh_torque(velocity, old.coulomb, old.viscous, old.steepness)
    return rotational_friction_torque(
        velocity,
        model.breakaway_torque,
        model.coulomb_friction,
        model.breakaway_velocity,
        model.viscous_friction,
    )
