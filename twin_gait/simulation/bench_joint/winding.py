"""The current loop within a tick: sample, set the voltage, let the winding follow."""

from __future__ import annotations

from twin_gait.core.actuator import voltage_limited_current
from twin_gait.core.estimation import quantise
from twin_gait.core.motor_drive import (
    current_loop_step,
    inverter_voltage,
    six_step_current,
    winding_current_step,
)
from twin_gait.simulation.bench_joint.arrays import (
    BUS_VOLTAGE,
    COUNTS,
    CURRENT,
    CURRENT_NOISE,
    CURRENT_OFFSET,
    CURRENT_RESOLUTION,
    CURRENT_RIPPLE,
    DUTY_SHARE,
    GEAR_RATIO,
    IDEAL,
    INDUCTANCE,
    INTEGRAL,
    INTEGRAL_GAIN,
    LOOP_PERIOD,
    MEAN_CURRENT,
    MODE,
    MOTOR_ANGLE,
    OPEN,
    PI,
    POLE_PAIRS,
    PROPORTIONAL_GAIN,
    RESISTANCE,
    SAMPLE,
    TARGET_CURRENT,
    TORQUE_CONSTANT,
    VOLTAGE,
    BenchArrays,
)


def sample_current(bench: BenchArrays, index: int) -> None:
    """Read the shunts; the loop sees the sample after its delay."""
    numbers, state = bench.numbers, bench.state
    noise = numbers[CURRENT_OFFSET] + numbers[CURRENT_NOISE] * bench.loop_noise[index]
    sample = six_step_current(
        state[CURRENT],
        numbers[GEAR_RATIO] * state[MOTOR_ANGLE],
        numbers[POLE_PAIRS],
        numbers[CURRENT_RIPPLE],
        noise,
    )
    size = bench.delayed.shape[0]
    bench.delayed[index % size] = quantise(sample, numbers[CURRENT_RESOLUTION])
    state[SAMPLE] = bench.delayed[(index + 1) % size]


def drive_winding(bench: BenchArrays, velocity: float) -> None:
    """Current at the end of a period and its mean, at the joint velocity in the middle of it."""
    numbers, state = bench.numbers, bench.state
    if numbers[MODE] == OPEN:
        return
    back_emf = numbers[TORQUE_CONSTANT] * numbers[GEAR_RATIO] * velocity
    if numbers[MODE] == IDEAL:
        current = voltage_limited_current(
            state[TARGET_CURRENT],
            velocity,
            state[BUS_VOLTAGE],
            numbers[RESISTANCE],
            numbers[TORQUE_CONSTANT],
            numbers[GEAR_RATIO],
        )
        state[CURRENT], state[MEAN_CURRENT] = current, current
        state[VOLTAGE] = numbers[RESISTANCE] * current + back_emf
        state[DUTY_SHARE] = state[VOLTAGE] / state[BUS_VOLTAGE]
        return
    if numbers[MODE] == PI:
        wanted, state[INTEGRAL] = current_loop_step(
            state[TARGET_CURRENT] - state[SAMPLE],
            state[INTEGRAL],
            numbers[PROPORTIONAL_GAIN],
            numbers[INTEGRAL_GAIN],
            numbers[LOOP_PERIOD],
            state[BUS_VOLTAGE],
        )
        full = numbers[COUNTS] if numbers[COUNTS] > 0.0 else 1.0
        state[VOLTAGE] = inverter_voltage(
            wanted / state[BUS_VOLTAGE] * full, numbers[COUNTS], state[BUS_VOLTAGE]
        )
        state[DUTY_SHARE] = state[VOLTAGE] / state[BUS_VOLTAGE]
    state[CURRENT], state[MEAN_CURRENT] = winding_current_step(
        state[CURRENT],
        state[VOLTAGE],
        back_emf,
        numbers[RESISTANCE],
        numbers[INDUCTANCE],
        numbers[LOOP_PERIOD],
    )
