"""The loop of the joint bench: ticks of the firmware, periods of the current loop within them.

Plain Python over the functions of :mod:`twin_gait.core`; :mod:`twin_gait.simulation.bench_joint` compiles
the same text. In a tick: measure, control, record; then in every period of the current loop: sample the
current, set the voltage, advance winding and mechanics.

Winding and mechanics take turns within a period: the back-EMF is that of the velocity in its middle, the
winding is solved exactly, and the mean current drives a Runge-Kutta step of the mechanics. The error shrinks
with the square of the period, and to nothing at constant speed.
"""

from __future__ import annotations

from twin_gait.core.actuator import sagged_bus_voltage
from twin_gait.simulation.bench_joint.arrays import (
    BATTERY_RESISTANCE,
    BATTERY_VOLTAGE,
    BUS_VOLTAGE,
    COLUMN_BUS_VOLTAGE,
    COLUMN_CURRENT,
    COLUMN_DUTY,
    COLUMN_FRICTION_TORQUE,
    COLUMN_GEAR_LOSS_TORQUE,
    COLUMN_HAND_TORQUE,
    COLUMN_LINK_ANGLE,
    COLUMN_LINK_VELOCITY,
    COLUMN_LOAD_TORQUE,
    COLUMN_MEASURED_CURRENT,
    COLUMN_MOTOR_ACCELERATION,
    COLUMN_MOTOR_ANGLE,
    COLUMN_MOTOR_TORQUE,
    COLUMN_MOTOR_VELOCITY,
    COLUMN_POSITION,
    COLUMN_STOP_TORQUE,
    COLUMN_TARGET_CURRENT,
    COLUMN_TIME,
    COLUMN_VELOCITY,
    COLUMN_VELOCITY_FAST,
    COLUMN_VELOCITY_SLOW,
    COLUMN_VOLTAGE,
    CURRENT,
    DIVERGED,
    DIVERGED_VELOCITY,
    DUTY_SHARE,
    ENERGY,
    LAST_ANGLE,
    LINK_ANGLE,
    LINK_VELOCITY,
    LOOP_PERIOD,
    LOOPS,
    MEAN_CURRENT,
    MOTOR_ANGLE,
    MOTOR_VELOCITY,
    PERIOD,
    REST_TICKS,
    SAMPLE,
    STOP_TICKS,
    STOP_UPPER,
    TARGET_CURRENT,
    VOLTAGE,
    Array,
    BenchArrays,
)
from twin_gait.simulation.bench_joint.command import control
from twin_gait.simulation.bench_joint.mechanics import mechanical_step, motor_torque, rates
from twin_gait.simulation.bench_joint.sensing import measure
from twin_gait.simulation.bench_joint.winding import drive_winding, sample_current


def run_ticks(bench: BenchArrays, first: int, end: int, rows: Array) -> int:
    """Run ticks of a test.

    Args:
        bench: The test; its state is changed in place.
        rows: Log, shape ``(n_ticks, len(COLUMNS))``; changed in place.

    Returns:
        Ticks done since tick 0: ``end``, or fewer if the test is over or has diverged.
    """
    numbers, state = bench.numbers, bench.state
    for tick in range(first, end):
        measure(bench, tick)
        control(bench, tick, rows[tick])
        record(bench, tick, rows[tick])
        state[ENERGY] = 0.0
        for loop in range(int(numbers[LOOPS])):
            advance_loop(bench, tick, loop)
        state[BUS_VOLTAGE] = sagged_bus_voltage(
            numbers[BATTERY_VOLTAGE],
            numbers[BATTERY_RESISTANCE],
            state[ENERGY] / numbers[PERIOD],
            state[BUS_VOLTAGE],
        )
        if not abs(state[MOTOR_VELOCITY]) < numbers[DIVERGED_VELOCITY]:
            state[DIVERGED] = 1.0
            return tick + 1
        if state[LINK_ANGLE] >= numbers[STOP_UPPER] or state[STOP_TICKS] > 0.0:
            state[STOP_TICKS] += 1.0
        if state[STOP_TICKS] > numbers[REST_TICKS]:
            return tick + 1
    return end


def record(bench: BenchArrays, tick: int, row: Array) -> None:
    """Write the columns of a tick that the controller has not written."""
    numbers, state = bench.numbers, bench.state
    angle = bench.measured[0, 0]
    torque = motor_torque(numbers, state[CURRENT])
    acceleration, _, friction, loss, load, stop, imposed_motion = rates(
        numbers,
        tick * numbers[PERIOD],
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        state[LINK_ANGLE],
        state[LINK_VELOCITY],
        torque,
    )
    row[COLUMN_TIME], row[COLUMN_POSITION] = tick * numbers[PERIOD], angle
    row[COLUMN_MEASURED_CURRENT], row[COLUMN_TARGET_CURRENT], row[COLUMN_BUS_VOLTAGE] = (
        state[SAMPLE],
        state[TARGET_CURRENT],
        state[BUS_VOLTAGE],
    )
    row[COLUMN_VELOCITY] = (angle - state[LAST_ANGLE]) / numbers[PERIOD]
    row[COLUMN_DUTY] = state[DUTY_SHARE]
    row[COLUMN_MOTOR_ANGLE], row[COLUMN_MOTOR_VELOCITY], row[COLUMN_MOTOR_ACCELERATION] = (
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        acceleration,
    )
    row[COLUMN_LINK_ANGLE], row[COLUMN_LINK_VELOCITY] = state[LINK_ANGLE], state[LINK_VELOCITY]
    row[COLUMN_VELOCITY_FAST], row[COLUMN_VELOCITY_SLOW] = bench.measured[0, 1], bench.measured[0, 2]
    row[COLUMN_CURRENT], row[COLUMN_VOLTAGE] = state[CURRENT], state[VOLTAGE]
    (
        row[COLUMN_MOTOR_TORQUE],
        row[COLUMN_FRICTION_TORQUE],
        row[COLUMN_GEAR_LOSS_TORQUE],
        row[COLUMN_LOAD_TORQUE],
        row[COLUMN_STOP_TORQUE],
        row[COLUMN_HAND_TORQUE],
    ) = torque, friction, loss, load, stop, imposed_motion


def advance_loop(bench: BenchArrays, tick: int, loop: int) -> None:
    """One period of the current loop: sample, set the voltage, advance winding and mechanics."""
    numbers, state = bench.numbers, bench.state
    index = tick * int(numbers[LOOPS]) + loop
    sample_current(bench, index)
    step = numbers[LOOP_PERIOD]
    time = tick * numbers[PERIOD] + loop * step
    acceleration, _, _, _, _, _, _ = rates(
        numbers,
        time,
        state[MOTOR_ANGLE],
        state[MOTOR_VELOCITY],
        state[LINK_ANGLE],
        state[LINK_VELOCITY],
        motor_torque(numbers, state[CURRENT]),
    )
    drive_winding(bench, state[MOTOR_VELOCITY] + 0.5 * step * acceleration)
    state[ENERGY] += state[VOLTAGE] * state[MEAN_CURRENT] * step
    mechanical_step(numbers, state, time, step)
