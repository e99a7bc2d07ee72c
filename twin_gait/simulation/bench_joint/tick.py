"""A tick of the joint bench: measure, control, record; then periods of the current loop.

In every period: sample the current, set the voltage, advance winding and mechanics. These two take turns:
the back-EMF is that of the velocity in the middle of the period, the winding is solved exactly, and the mean
current drives a Runge-Kutta step of the mechanics. The error shrinks with the square of the period, and to
nothing at constant speed.
"""

from __future__ import annotations

from twin_gait.core.actuator import sagged_bus_voltage
from twin_gait.gait.table import TICK
from twin_gait.simulation.bench_joint.command import control
from twin_gait.simulation.bench_joint.episode import BenchEpisode
from twin_gait.simulation.bench_joint.interface import log_row
from twin_gait.simulation.bench_joint.mechanics import mechanical_step, motor_torque, present_accelerations
from twin_gait.simulation.bench_joint.sensing import measure
from twin_gait.simulation.bench_joint.winding import drive_winding, sample_current
from twin_gait.simulation.engine import DIVERGED_VELOCITY
from twin_gait.simulation.episode import DIVERGED


def run_ticks(e: BenchEpisode, first: int, end: int) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the test is over or has diverged.

    ``e``: the test; changed in place. Returns the ticks that have been run since the start; ``e.status`` says
    whether it has diverged.
    """
    for tick in range(first, end):
        measure(e, tick)
        control(e, tick)
        record(e, tick)
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


def record(e: BenchEpisode, tick: int) -> None:
    """Write the columns that the controller has not written, at the state before the motion."""
    time, encoder, winding, torques, row = tick * TICK, e.encoder, e.winding, e.torques, log_row(e, tick)
    row.time = time
    row.position = encoder.angle
    row.measured_current = winding.sample
    row.target_current = winding.target_current
    row.bus_voltage = e.bus_voltage
    row.velocity = (encoder.angle - encoder.last_angle) / TICK
    row.duty = winding.duty
    row.motor_angle = e.rotor.angle
    row.motor_velocity = e.rotor.velocity
    row.motor_acceleration, _ = present_accelerations(e, time)
    row.link_angle = e.link.angle
    row.link_velocity = e.link.velocity
    row.velocity_fast = encoder.velocity_fast
    row.velocity_slow = encoder.velocity_slow
    row.current = winding.current
    row.voltage = winding.voltage
    row.motor_torque = motor_torque(e, winding.current)
    row.friction_torque = torques.friction
    row.gear_loss_torque = torques.gear_loss
    row.load_torque = torques.load
    row.stop_torque = torques.stop
    row.imposed_motion_torque = e.imposed_motion.torque


def advance(e: BenchEpisode, tick: int, number: int) -> None:
    """One period of the current loop: sample, set the voltage, advance winding and mechanics."""
    winding, step = e.winding, e.winding.period
    sample_current(e, tick, number)
    time = tick * TICK + number * step
    acceleration, _ = present_accelerations(e, time)
    drive_winding(e, e.rotor.velocity + 0.5 * step * acceleration)
    winding.energy += winding.voltage * winding.mean_current * step
    mechanical_step(e, time, step)
