"""Faults between the true state and the controller's measurements, or between command and motor.

``joint`` and ``leg`` are indices, ``tick`` is the present tick, ``period`` its length in [s], and ``faults``
are those of the episode.
"""

import math
from dataclasses import dataclass

# Kinds of faults.
ENCODER_FREEZE, ENCODER_JUMP, ENCODER_MISSING, ENCODER_DRIFT, ENCODER_OFFSET = range(5)
MOTOR_DEAD, MOTOR_STUCK, CONTROLLER_RUNAWAY, FOOT_LOAD_STUCK, SUPPLY_DIP = range(5, 10)
SUPPLY_LOSS_SHORTED, SUPPLY_LOSS_OPEN = range(10, 12)

NO_FAULT = -1
JUMP_TICKS = 5  # Length of a jump, which is a glitch; a lasting error is an offset.
DIP_TICKS = 500  # Length of a dip of the supply.
MIN_BUS_VOLTAGE = 1.0  # Lower limit in [V]; the capacitors of the bus are never completely empty.


@dataclass(slots=True)
class FaultRecord:
    """A fault of an episode."""

    kind: int  # One of the kinds above.
    index: int  # Index of the joint or leg; without meaning for the supply.
    start_tick: int  # First tick with the fault.
    # Magnitude in SI units: angle in [rad] of a jump or an offset, rate in [rad/s] of a drift, torque in
    # [N·m] of a stuck motor, its rate in [N·m/s] of a runaway, voltage in [V] of a dip.
    magnitude: float


def faulty_angle(
    joint: int, tick: int, period: float, faults: list[FaultRecord], reading: float, last_reading: float
) -> float:
    """Compute the reading of a joint's encoder in [rad] under its faults; NaN if it is missing.

    ``reading``: reading of the healthy encoder. ``last_reading``: reading of the tick before, faults
    included.
    """
    for fault in faults:
        elapsed = tick - fault.start_tick
        if elapsed < 0 or fault.kind > ENCODER_OFFSET or fault.index != joint:
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


def faulty_load(leg: int, tick: int, faults: list[FaultRecord], load: float, last_load: float) -> float:
    """Compute the reading of a foot's load sensor under its faults, in the unit of the load.

    ``load``: reading of the healthy sensor. ``last_load``: reading of the tick before, faults included.
    """
    for fault in faults:
        stuck = fault.kind == FOOT_LOAD_STUCK and fault.index == leg
        if stuck and tick >= fault.start_tick:
            load = last_load
    return load


def runaway_torque(joint: int, tick: int, period: float, faults: list[FaultRecord]) -> float:
    """Compute the torque in [N·m] that a defective controller adds: a ramp."""
    torque = 0.0
    for fault in faults:
        elapsed = tick - fault.start_tick
        if fault.kind == CONTROLLER_RUNAWAY and fault.index == joint and elapsed >= 0:
            torque += fault.magnitude * (elapsed * period)
    return torque


def drive_fault(joint: int, tick: int, faults: list[FaultRecord]) -> int:
    """Find the index of the active fault of a joint's drive, the first of several, or return ``NO_FAULT``."""
    for row in range(len(faults)):
        fault = faults[row]
        broken = fault.kind == MOTOR_DEAD or fault.kind == MOTOR_STUCK
        if broken and fault.index == joint and tick >= fault.start_tick:
            return row
    return NO_FAULT


def supply_loss(tick: int, faults: list[FaultRecord]) -> int:
    """Find the index of the active loss of the supply, the first of several, or return ``NO_FAULT``."""
    for row in range(len(faults)):
        fault = faults[row]
        lost = fault.kind == SUPPLY_LOSS_SHORTED or fault.kind == SUPPLY_LOSS_OPEN
        if lost and tick >= fault.start_tick:
            return row
    return NO_FAULT


def supply_drop(tick: int, faults: list[FaultRecord]) -> float:
    """Compute the voltage in [V] by which the faults reduce the supply.

    It is 0 without a dip or a loss, and infinite after a loss.
    """
    drop = 0.0
    for fault in faults:
        elapsed = tick - fault.start_tick
        if fault.kind == SUPPLY_DIP and 0 <= elapsed < DIP_TICKS:
            drop += fault.magnitude
    return drop if supply_loss(tick, faults) == NO_FAULT else math.inf


def dipped_bus_voltage(voltage: float, drop: float, highest_back_emf: float) -> float:
    """Compute the bus voltage in [V] in a dip of the supply, or after its loss.

    Turning motors charge the bus through the diodes of their bridges, so that it does not fall below the
    highest back-EMF of all motors. The supply is cut off, so only the capacitors of the bus absorb that
    current.
    """
    return max(voltage - drop, highest_back_emf, MIN_BUS_VOLTAGE)
