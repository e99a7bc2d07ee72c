"""Faults between the true state and what the controller sees, or between command and motor.

``joint`` and ``leg`` are numbers, ``tick`` is the present one, ``period`` its length in [s], ``faults`` are
those of the episode.
"""

import math
from dataclasses import dataclass

# Kinds of faults, as the array numbers them.
ENCODER_FREEZE, ENCODER_JUMP, ENCODER_MISSING, ENCODER_DRIFT, ENCODER_OFFSET = range(5)
MOTOR_DEAD, MOTOR_STUCK, CONTROLLER_RUNAWAY, FOOT_LOAD_STUCK, SUPPLY_DIP = range(5, 10)

NO_FAULT = -1
JUMP_TICKS = 5  # a jump is a glitch of so many ticks; what lasts is an offset
DIP_TICKS = 500  # length of a dip of the supply
LEAST_BUS_VOLTAGE = 1.0  # [V]; the capacitors of the bus are never quite empty


@dataclass(slots=True)
class Fault:
    """A fault of an episode."""

    kind: int  # See above.
    place: int  # A joint, a leg, or of no meaning for the supply.
    start_tick: int  # First tick with the fault.
    # In SI units: angle in [rad] of a jump or an offset, rate in [rad] / [s] of a drift, torque in [N m] of a
    # stuck motor, its rate in [N m] / [s] of a runaway, voltage in [V] of a dip.
    magnitude: float


def faulty_angle(
    joint: int, tick: int, period: float, faults: list[Fault], reading: float, last_reading: float
) -> float:
    """What a joint's encoder reads under its faults in [rad]; NaN if it is missing.

    ``reading``: of the healthy encoder. ``last_reading``: what it read in the tick before.
    """
    for fault in faults:
        elapsed = tick - fault.start_tick
        if elapsed < 0 or fault.kind > ENCODER_OFFSET or fault.place != joint:
            continue
        if fault.kind == ENCODER_FREEZE:
            reading = last_reading
        elif fault.kind == ENCODER_MISSING:
            reading = math.nan
        elif fault.kind == ENCODER_DRIFT:
            reading += fault.magnitude * (elapsed * period)
        elif fault.kind == ENCODER_OFFSET or elapsed < JUMP_TICKS:
            reading += fault.magnitude
    return reading


def faulty_load(leg: int, tick: int, faults: list[Fault], load: float, last_load: float) -> float:
    """What the load sensor of a foot reads under its faults, in the unit of the load.

    ``load``: of the healthy sensor. ``last_load``: what it read in the tick before.
    """
    for fault in faults:
        stuck = fault.kind == FOOT_LOAD_STUCK and fault.place == leg
        if stuck and tick >= fault.start_tick:
            load = last_load
    return load


def runaway_torque(joint: int, tick: int, period: float, faults: list[Fault]) -> float:
    """Torque in [N m] that a controller gone wrong adds: a ramp."""
    torque = 0.0
    for fault in faults:
        elapsed = tick - fault.start_tick
        if fault.kind == CONTROLLER_RUNAWAY and fault.place == joint and elapsed >= 0:
            torque += fault.magnitude * (elapsed * period)
    return torque


def drive_fault(joint: int, tick: int, faults: list[Fault]) -> int:
    """Row of the fault of a joint's drive that is at work, the first one of several, or ``NO_FAULT``."""
    for row in range(len(faults)):
        fault = faults[row]
        broken = fault.kind == MOTOR_DEAD or fault.kind == MOTOR_STUCK
        if broken and fault.place == joint and tick >= fault.start_tick:
            return row
    return NO_FAULT


def supply_drop(tick: int, faults: list[Fault]) -> float:
    """Voltage in [V] that the supply lacks, 0 without a dip."""
    drop = 0.0
    for fault in faults:
        elapsed = tick - fault.start_tick
        if fault.kind == SUPPLY_DIP and 0 <= elapsed < DIP_TICKS:
            drop += fault.magnitude
    return drop


def dipped_bus_voltage(voltage: float, drop: float, highest_back_emf: float) -> float:
    """Bus voltage in [V] in a dip of the supply.

    Turning motors charge the bus through the diodes of their bridges, so that it does not fall below the
    highest back-EMF of all motors; what feeds the bus is cut off, so nothing but its capacitors takes that
    current.
    """
    return max(voltage - drop, highest_back_emf, LEAST_BUS_VOLTAGE)
