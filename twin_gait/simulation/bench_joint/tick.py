"""Tick of the joint bench: measurement, control and log, followed by periods of the current loop.

Each period samples the current, sets the voltage and advances winding and mechanics in alternation: the
back-EMF is that of the velocity in the middle of the period, the winding is solved exactly, and the mean
current drives a Runge-Kutta step of the mechanics. The error decreases with the square of the period, and is
zero at constant speed.
"""

from twin_gait.core.actuator import dead_zone, sagged_bus_voltage
from twin_gait.core.control_tick import measure_joint, target_current
from twin_gait.core.estimation import delayed_sample, first_order_step
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import coulomb_viscous_tanh_torque
from twin_gait.core.impedance import impedance_torque
from twin_gait.core.inertial import angular_acceleration, tangential_specific_force
from twin_gait.core.motor_drive import inverter_voltage, six_step_current
from twin_gait.gait.table import TICK
from twin_gait.simulation.backend import log_row, noise_row, write_row
from twin_gait.simulation.bench_joint.episode import ACCELEROMETER, DUTY, ENCODER, OPEN, BenchEpisode
from twin_gait.simulation.bench_joint.mechanics import drive_winding, mechanical_step, present_accelerations
from twin_gait.simulation.episode import DIVERGED, DIVERGED_VELOCITY
from twin_gait.worlds.bench_control import cosine_path, transparency_duty

# Indices in the noise of a tick; the samples of the current follow, one for each period of the current loop.
ANGLE_NOISE, UNIT_NOISE, CURRENT_NOISE = range(3)


def noise(e: BenchEpisode, tick: int, index: int) -> float:
    """Return the noise of a tick at an index: in [rad] for the encoder, otherwise standard normal."""
    return noise_row(e, tick * (CURRENT_NOISE + e.winding.periods) + index)[0]


def run_ticks(e: BenchEpisode, first: int, end: int) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the test is over or has diverged (see ``e.status``).

    Returns the number of ticks since the start.
    """
    for tick in range(first, end):
        e.time = tick * TICK
        measure(e, tick)
        control(e, tick)
        e.rotor.acceleration, _ = present_accelerations(e, e.time)
        write_row(e, log_row(e, tick))
        e.winding.energy = 0.0
        for number in range(e.winding.periods):
            advance(e, tick, number)
        power, battery = e.winding.energy / TICK, e.test.battery
        e.bus_voltage = sagged_bus_voltage(battery.voltage, battery.internal_resistance, power, e.bus_voltage)
        if not abs(e.rotor.velocity) < DIVERGED_VELOCITY:
            e.status = DIVERGED
            return tick + 1
        if e.link.angle >= e.test.link.upper_stop or e.ticks_at_stop > 0:
            e.ticks_at_stop += 1
        if e.ticks_at_stop > e.test.rest_at_stop / TICK:
            return tick + 1
    return end


def measure(e: BenchEpisode, tick: int) -> None:
    """Read the encoder on the motor, and update both velocity estimates and the acceleration."""
    encoder, acceleration = e.encoder, e.acceleration
    reading = e.rotor.angle + noise(e, tick, ANGLE_NOISE)
    measure_joint(encoder, tick, reading, TICK, e.fast_gain, e.test.sensors.decimation)
    if tick == 0:
        encoder.last_angle = encoder.angle
    if acceleration.source != ENCODER:
        _sense(e, tick)
    else:
        change = (encoder.velocity_fast - encoder.last_fast) / TICK
        acceleration.estimate = first_order_step(acceleration.estimate, change, acceleration.gain)


def _sense(e: BenchEpisode, tick: int) -> None:
    """Estimate the angular acceleration of the link from delayed samples of its inertial unit."""
    unit, acceleration = e.unit, e.acceleration
    taken = _unit_reading(e) + unit.noise * noise(e, tick, UNIT_NOISE)
    sample = delayed_sample(acceleration.line, tick, taken)
    if tick < unit.delay:
        return
    if acceleration.source == ACCELEROMETER:
        angle, gravity = e.encoder.angle, e.test.gravity
        change = angular_acceleration(sample, angle, unit.lever, gravity, e.horizontal_angle)
    else:
        before = sample if tick == unit.delay else acceleration.last_sample
        change = (sample - before) / TICK
    acceleration.last_sample = sample
    acceleration.estimate = first_order_step(acceleration.estimate, change, acceleration.gain)


def _unit_reading(e: BenchEpisode) -> float:
    """Return the reading of the inertial unit without noise: velocity, or specific force along its path."""
    if e.acceleration.source != ACCELEROMETER:
        return e.link.velocity
    _, acceleration = present_accelerations(e, e.time)
    angle, lever = e.link.angle, e.unit.lever
    return tangential_specific_force(acceleration, angle, lever, e.test.gravity, e.horizontal_angle)


def control(e: BenchEpisode, tick: int) -> None:
    """Compute the target current or the duty of a tick."""
    if e.winding.drive == DUTY:
        _control_duty(e, tick)
    elif e.winding.drive != OPEN:
        _control_torque(e)


def _control_duty(e: BenchEpisode, tick: int) -> None:
    """Compute the duty with which the joint can be moved by hand, without a current loop."""
    motor, winding, velocity, counts = e.motor, e.winding, e.encoder.velocity_fast, e.test.drive.counts
    tick += e.variation.duty_start
    duty = transparency_duty(e.duty_control, motor, tick, velocity, e.bus_voltage, counts)
    winding.voltage = inverter_voltage(duty, counts, e.bus_voltage)
    winding.duty = winding.voltage / e.bus_voltage
    # The firmware has only an estimate of the current: that of this voltage at the measured speed.
    back_emf = motor.torque_constant * motor.gear_ratio * velocity
    winding.target_current = (winding.voltage - back_emf) / motor.resistance


def _control_torque(e: BenchEpisode) -> None:
    """Compute the torque of impedance, compensations and target, and the target current for it."""
    law, limits, encoder = e.torque_control, e.test.limits, e.encoder
    setpoint, command = e.setpoint, e.command
    inertia = e.rotor.inertia + e.link.inertia
    angle, path_velocity, path_acceleration = cosine_path(e.path, e.time)
    velocity = encoder.velocity_fast - path_velocity
    setpoint.equilibrium = angle
    command.impedance = impedance_torque(encoder.angle, velocity, law.stiffness, law.damping, angle)
    command.friction = law.friction_compensation_gain * _model_friction(e, path_velocity)
    setpoint.inertia = law.inertia_compensation * inertia * e.acceleration.estimate
    setpoint.target = law.target_torque + inertia * path_acceleration
    command.torque = command.impedance + command.friction + setpoint.inertia + setpoint.target
    e.winding.target_current = target_current(e.motor, command.torque, limits.torque, limits.current)


def _model_friction(e: BenchEpisode, path_velocity: float) -> float:
    """Return the friction torque of the compensation's model; the old model uses the fast velocity."""
    law, old, model = e.torque_control, e.old_model, e.torque_control.friction_model
    measured = e.encoder.velocity_fast if e.uses_old_model else e.encoder.velocity_slow
    velocity = dead_zone(path_velocity if law.follows_path else measured, law.dead_zone)
    if e.uses_old_model:
        return coulomb_viscous_tanh_torque(velocity, old.coulomb, old.viscous, old.steepness)
    return rotational_friction_torque(
        velocity,
        model.breakaway_torque,
        model.coulomb_friction,
        model.breakaway_velocity,
        model.viscous_friction,
    )


def advance(e: BenchEpisode, tick: int, number: int) -> None:
    """Run one period of the current loop: sample, set the voltage, advance winding and mechanics."""
    winding, step = e.winding, e.winding.period
    sample_current(e, tick, number)
    time = e.time + number * step
    acceleration, _ = present_accelerations(e, time)
    drive_winding(e, e.rotor.velocity + 0.5 * step * acceleration)
    winding.energy += winding.voltage * winding.mean_current * step
    mechanical_step(e, time, step)


def sample_current(e: BenchEpisode, tick: int, number: int) -> None:
    """Sample the current in a period of a tick; the current loop receives the sample after its delay."""
    winding, drive = e.winding, e.test.drive
    stray = e.variation.current_offset + drive.noise * noise(e, tick, CURRENT_NOISE + number)
    motor_angle = e.motor.gear_ratio * e.rotor.angle
    sample = six_step_current(winding.current, motor_angle, drive.pole_pairs, drive.ripple, stray)
    winding.sample = delayed_sample(winding.line, tick * winding.periods + number, sample)
