"""Mechanics of the joint bench: current of the winding, torques on rotor and link, and a step in time."""

from twin_gait.core.actuator import current_to_torque, voltage_limited_current
from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.friction import (
    WITH_OTHER_FRICTION_LAWS,
    advance_deflection,
    friction_torque,
    gear_loss_torque,
)
from twin_gait.core.friction_models import load_and_temperature_torque, ripple_torque
from twin_gait.core.motor_drive import (
    current_loop_step,
    drive_efficiency,
    inverter_voltage,
    link_load_torque,
    torsion_torque,
    winding_current_step,
)
from twin_gait.core.plant import imposed_motion_torque
from twin_gait.simulation.bench_joint.episode import IDEAL, OPEN, PI, BenchEpisode


def drive_winding(e: BenchEpisode, velocity: float) -> None:
    """Compute the current at the end of a period and its mean, at the joint velocity in its middle."""
    motor, winding, counts = e.motor, e.winding, e.test.drive.counts
    if winding.drive == OPEN:
        return
    back_emf = motor.torque_constant * motor.gear_ratio * velocity
    if winding.drive == IDEAL:
        current = voltage_limited_current(motor, winding.target_current, velocity, e.bus_voltage)
        winding.current = current
        winding.mean_current = current
        winding.voltage = motor.resistance * current + back_emf
        winding.duty = winding.voltage / e.bus_voltage
        return
    if winding.drive == PI:
        error, limit = winding.target_current - winding.sample, e.bus_voltage
        voltage, winding.integral = current_loop_step(
            error, winding.integral, winding.proportional_gain, winding.integral_gain, winding.period, limit
        )
        full = counts if counts > 0 else 1
        winding.voltage = inverter_voltage(voltage / e.bus_voltage * full, counts, e.bus_voltage)
        winding.duty = winding.voltage / e.bus_voltage
    winding.current, winding.mean_current = winding_current_step(
        winding.current, winding.voltage, back_emf, motor.resistance, e.test.drive.inductance, winding.period
    )


def motor_torque(e: BenchEpisode, current: float) -> float:
    """Return the torque of a current in [A] at the joint in [N·m], before the losses of the gear."""
    return current_to_torque(current, e.motor.torque_constant, e.motor.gear_ratio)


def present_accelerations(e: BenchEpisode, time: float) -> tuple[float, float]:
    """Return the accelerations of rotor and link in [rad/s²] at the present state and current."""
    torque = motor_torque(e, e.winding.current)
    e.torques.motor = torque
    return accelerations(e, time, torque, e.rotor.angle, e.rotor.velocity, e.link.angle, e.link.velocity)


def accelerations(
    e: BenchEpisode, time: float, torque: float, q1: float, v1: float, q2: float, v2: float
) -> tuple[float, float]:
    """Return the accelerations of rotor and link at angles and velocities of rotor (1) and link (2).

    ``torque``: motor torque in [N·m]. The other torques are written to ``e.torques`` and the imposed motion.
    """
    torques, motion, link = e.torques, e.imposed_motion, e.test.link
    base = link.stops
    load = link_load_torque(q2, e.mass_moment, e.test.gravity, e.horizontal_angle)
    friction = _friction(e, q1, v1, load)
    stop = mechanical_stop_torque(q2, v2, link.lower_stop, link.upper_stop, base.stiffness, base.dissipation)
    imposed = 0.0
    if motion.index >= 0:
        imposed = imposed_motion_torque(motion, time, q2, v2)
    torques.load = load
    torques.friction = friction
    torques.stop = stop
    motion.torque = imposed
    on_rotor, on_link = torque + friction, load + stop + imposed
    if e.compliant:
        torsion = torsion_torque(q1 - q2, v1 - v2, e.torsion.stiffness, e.torsion.damping)
        loss = _gear_loss(e, torsion, v1, 0.0)
        torques.gear_loss = loss
        return (on_rotor + loss - torsion) / e.rotor.inertia, (on_link + torsion) / e.link.inertia
    inertia = e.rotor.inertia + e.link.inertia
    share = e.rotor.inertia / inertia
    loss = _gear_loss(e, torque - share * (on_rotor + on_link), v1, share)
    torques.gear_loss = loss
    together = (on_rotor + loss + on_link) / inertia
    return together, together


def _friction(e: BenchEpisode, angle: float, velocity: float, load: float) -> float:
    law, more, deflection = e.friction, e.test.friction, e.deflection
    if WITH_OTHER_FRICTION_LAWS:
        deflection = advance_deflection(law, angle - e.rotor.angle, velocity, deflection)
    friction = -friction_torque(law, velocity, deflection)
    per_load, coulomb, viscous = more.coulomb_per_load, more.coulomb_per_kelvin, more.viscous_per_kelvin
    if per_load != 0.0 or coulomb != 0.0 or viscous != 0.0:
        turnover = 0.1 * law.stribeck_velocity
        friction -= load_and_temperature_torque(
            velocity, load, more.temperature, 0.0, per_load, coulomb, 0.0, viscous, turnover
        )
    if e.ripple_cosine != 0.0 or e.ripple_sine != 0.0:
        friction -= ripple_torque(angle, e.ripple_cosine, e.ripple_sine, 2.0 * e.motor.gear_ratio)
    return friction


def _gear_loss(e: BenchEpisode, load: float, velocity: float, share: float) -> float:
    r"""Return the torque on the rotor that the gear loses under load, in [N·m].

    A loss :math:`T_l = s\,\tau` slows the rotor, and the rotor's inertia adds the share :math:`c` of it to
    the load of the gear: :math:`\tau = \tau_0 + c\,T_l = \tau_0 / (1 - c s)`.

    ``load``: torque :math:`\tau_0` that the gear would transmit without losses, in [N·m]. ``velocity``:
    velocity of the rotor at the joint in [rad/s]. ``share``: :math:`c`, rotor inertia over total inertia.
    """
    gear = e.efficiency
    efficiency = drive_efficiency(gear.temperature, e.motor.gear_ratio * velocity, gear.coefficients)
    if efficiency == 1.0 or load == 0.0:
        return 0.0
    loss = gear_loss_torque(velocity, load, efficiency, gear.transition_velocity)
    return -loss / (1.0 - share * (loss / load))


def mechanical_step(e: BenchEpisode, time: float, step: float) -> None:
    """Advance rotor and link by a step of the classical Runge-Kutta method at the mean current."""
    torque = motor_torque(e, e.winding.mean_current)
    rotor, link, half = e.rotor, e.link, 0.5 * step
    q1, v1, q2, v2 = rotor.angle, rotor.velocity, link.angle, link.velocity
    a1, b1 = accelerations(e, time, torque, q1, v1, q2, v2)
    v1b, v2b = v1 + half * a1, v2 + half * b1
    a2, b2 = accelerations(e, time + half, torque, q1 + half * v1, v1b, q2 + half * v2, v2b)
    v1c, v2c = v1 + half * a2, v2 + half * b2
    a3, b3 = accelerations(e, time + half, torque, q1 + half * v1b, v1c, q2 + half * v2b, v2c)
    v1d, v2d = v1 + step * a3, v2 + step * b3
    a4, b4 = accelerations(e, time + step, torque, q1 + step * v1c, v1d, q2 + step * v2c, v2d)
    sixth = step / 6.0
    rotor.velocity = v1 + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    link.velocity = v2 + sixth * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    rotor.angle = q1 + sixth * (v1 + 2.0 * v1b + 2.0 * v1c + v1d)
    link.angle = q2 + sixth * (v2 + 2.0 * v2b + 2.0 * v2c + v2d)
    if WITH_OTHER_FRICTION_LAWS:
        moved = rotor.angle - q1
        e.deflection = advance_deflection(e.friction, moved, rotor.velocity, e.deflection)
