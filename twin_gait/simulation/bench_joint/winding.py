"""The current loop within a tick: sample, set the voltage, let the winding follow."""

from __future__ import annotations

from twin_gait.core.actuator import voltage_limited_current
from twin_gait.core.estimation import delayed_sample, quantise
from twin_gait.core.motor_drive import (
    current_loop_step,
    inverter_voltage,
    six_step_current,
    winding_current_step,
)
from twin_gait.simulation.bench_joint.episode import IDEAL, OPEN, PI, BenchEpisode
from twin_gait.simulation.bench_joint.interface import CURRENT_NOISE, noise


def sample_current(e: BenchEpisode, tick: int, number: int) -> None:
    """Read the shunts in a period of a tick; the loop sees the sample after its delay."""
    winding, drive = e.winding, e.test.drive
    stray = e.variation.current_offset + drive.noise * noise(e, tick, CURRENT_NOISE + number)
    motor_angle = e.motor.gear_ratio * e.rotor.angle
    sample = six_step_current(winding.current, motor_angle, drive.pole_pairs, drive.ripple, stray)
    taken = quantise(sample, drive.resolution)
    winding.sample = delayed_sample(winding.line, tick * winding.periods + number, taken)


def drive_winding(e: BenchEpisode, velocity: float) -> None:
    """Current at the end of a period and its mean, at the joint velocity in the middle of it."""
    motor, winding, counts = e.motor, e.winding, e.test.drive.counts
    if winding.drive == OPEN:
        return
    back_emf = motor.torque_constant * motor.gear_ratio * velocity
    if winding.drive == IDEAL:
        current = voltage_limited_current(
            winding.target_current,
            velocity,
            e.bus_voltage,
            motor.resistance,
            motor.torque_constant,
            motor.gear_ratio,
        )
        winding.current = current
        winding.mean_current = current
        winding.voltage = motor.resistance * current + back_emf
        winding.duty = winding.voltage / e.bus_voltage
        return
    if winding.drive == PI:
        wanted, winding.integral = current_loop_step(
            winding.target_current - winding.sample,
            winding.integral,
            winding.proportional_gain,
            winding.integral_gain,
            winding.period,
            e.bus_voltage,
        )
        full = counts if counts > 0 else 1
        winding.voltage = inverter_voltage(wanted / e.bus_voltage * full, counts, e.bus_voltage)
        winding.duty = winding.voltage / e.bus_voltage
    winding.current, winding.mean_current = winding_current_step(
        winding.current,
        winding.voltage,
        back_emf,
        motor.resistance,
        e.test.drive.inductance,
        winding.period,
    )
