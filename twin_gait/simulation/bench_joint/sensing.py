"""Encoder and inertial unit of the joint bench."""

from __future__ import annotations

from twin_gait.core.control_tick import measure_joints
from twin_gait.core.estimation import first_order_step
from twin_gait.core.inertial import angular_acceleration, tangential_specific_force
from twin_gait.simulation.bench_joint.arrays import (
    ACCELEROMETER,
    CURRENT,
    DECIMATION,
    ENCODER,
    FAST_GAIN,
    GRAVITY,
    GYROSCOPE,
    HORIZONTAL_ANGLE,
    LAST_ANGLE,
    LAST_FAST,
    LAST_SAMPLE,
    LINK_ANGLE,
    LINK_VELOCITY,
    MOTOR_ANGLE,
    MOTOR_VELOCITY,
    PERIOD,
    RATE,
    UNIT,
    UNIT_GAIN,
    UNIT_LEVER,
    UNIT_NOISE,
    BenchArrays,
)
from twin_gait.simulation.bench_joint.mechanics import motor_torque, rates


def measure(bench: BenchArrays, tick: int) -> None:
    """Encoder on the motor, the two velocity estimates and their rate."""
    numbers, state = bench.numbers, bench.state
    bench.angles[0] = state[MOTOR_ANGLE] + bench.encoder_noise[tick]
    state[LAST_FAST], state[LAST_ANGLE] = bench.measured[0, 1], bench.measured[0, 0]
    measure_joints(
        tick,
        bench.angles,
        bench.resolution,
        numbers[PERIOD],
        numbers[FAST_GAIN],
        int(numbers[DECIMATION]),
        bench.measured,
        bench.decimated_angle,
        bench.ring,
    )
    if tick == 0:
        state[LAST_ANGLE] = bench.measured[0, 0]
    if numbers[UNIT] != ENCODER:
        sense_acceleration(bench, tick)
    else:
        change = (bench.measured[0, 1] - state[LAST_FAST]) / numbers[PERIOD]
        state[RATE] = first_order_step(state[RATE], change, numbers[FAST_GAIN])


def sense_acceleration(bench: BenchArrays, tick: int) -> None:
    """Angular acceleration of the link from the inertial unit on it; a sample is used after its delay."""
    numbers, state = bench.numbers, bench.state
    size = bench.inertial.shape[0]
    bench.inertial[tick % size] = inertial_sample(bench, tick) + (
        numbers[UNIT_NOISE] * bench.inertial_noise[tick]
    )
    if tick + 1 < size:
        return
    sample = bench.inertial[(tick + 1) % size]
    if numbers[UNIT] == ACCELEROMETER:
        acceleration = angular_acceleration(
            sample,
            bench.measured[0, 0],
            numbers[UNIT_LEVER],
            numbers[GRAVITY],
            numbers[HORIZONTAL_ANGLE],
        )
    else:
        before = sample if tick + 1 == size else state[LAST_SAMPLE]
        acceleration = (sample - before) / numbers[PERIOD]
    state[LAST_SAMPLE] = sample
    state[RATE] = first_order_step(state[RATE], acceleration, numbers[UNIT_GAIN])


def inertial_sample(bench: BenchArrays, tick: int) -> float:
    """What the unit would report without noise: velocity, or specific force along its path."""
    numbers, state = bench.numbers, bench.state
    if numbers[UNIT] == GYROSCOPE:
        return float(state[LINK_VELOCITY])
    _, acceleration, _, _, _, _, _ = rates(
        numbers,
        tick * numbers[PERIOD],
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        state[LINK_ANGLE],
        state[LINK_VELOCITY],
        motor_torque(numbers, state[CURRENT]),
    )
    return tangential_specific_force(
        acceleration,
        state[LINK_ANGLE],
        numbers[UNIT_LEVER],
        numbers[GRAVITY],
        numbers[HORIZONTAL_ANGLE],
    )
