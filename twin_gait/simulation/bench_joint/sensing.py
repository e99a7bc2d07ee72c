"""Encoder and inertial unit of the joint bench."""

from __future__ import annotations

from twin_gait.core.control_tick import measure_joint
from twin_gait.core.estimation import delayed_sample, first_order_step
from twin_gait.core.inertial import angular_acceleration, tangential_specific_force
from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.episode import ACCELEROMETER, ENCODER, GYROSCOPE, BenchEpisode
from twin_gait.simulation.bench_joint.interface import ANGLE_NOISE, UNIT_NOISE, noise
from twin_gait.simulation.bench_joint.mechanics import present_accelerations


def measure(e: BenchEpisode, tick: int) -> None:
    """Encoder on the motor, the two velocity estimates, and the acceleration."""
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
    """Angular acceleration of the link from the inertial unit on it; a sample is used after its delay."""
    unit, acceleration = e.unit, e.acceleration
    taken = _unit_reading(e, tick) + unit.noise * noise(e, tick, UNIT_NOISE)
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


def _unit_reading(e: BenchEpisode, tick: int) -> float:
    """What the unit would report without noise: velocity, or specific force along its path."""
    if e.acceleration.source == GYROSCOPE:
        return e.link.velocity
    _, acceleration = present_accelerations(e, tick * TICK)
    return tangential_specific_force(
        acceleration, e.link.angle, e.unit.lever, e.test.gravity, e.horizontal_angle
    )
