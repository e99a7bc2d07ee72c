"""Faults between the true state and what the controller sees, or between command and motor.

The faults of an episode are two arrays, so that a campaign runs on one compiled loop: ``faults`` with the
columns kind, place and first tick, and ``magnitudes`` in SI units. The place is a joint, a leg, or of no
meaning for the supply.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]

# Kinds of faults, as the array numbers them.
(
    ENCODER_FREEZE,
    ENCODER_JUMP,
    ENCODER_MISSING,
    ENCODER_DRIFT,
    ENCODER_OFFSET,
    MOTOR_DEAD,
    MOTOR_STUCK,
    CONTROLLER_RUNAWAY,
    FOOT_LOAD_STUCK,
    SUPPLY_DIP,
) = range(10)
KIND, PLACE, START_TICK = range(3)

NO_FAULT = -1
JUMP_TICKS = 5  # a jump is a glitch of so many ticks; what lasts is an offset
DIP_TICKS = 500  # length of a dip of the supply
LEAST_BUS_VOLTAGE = 1.0  # [V]; the capacitors of the bus are never quite empty


def faulty_angle(
    joint: int,
    tick: int,
    period: float,
    faults: Array,
    magnitudes: Array,
    reading: float,
    last_reading: float,
) -> float:
    """What a joint's encoder reads under its faults.

    Args:
        joint: Index of the joint.
        tick: Present tick.
        period: Length of a tick in [s].
        faults: Shape ``(n, 3)``.
        magnitudes: Angle in [rad] of a jump or an offset, rate in [rad] / [s] of a drift, shape ``(n,)``.
        reading: Of the healthy encoder in [rad].
        last_reading: What it read in the tick before in [rad].

    Returns:
        Reading in [rad]; NaN if it is missing.
    """
    for row in range(faults.shape[0]):
        elapsed = tick - faults[row, START_TICK]
        kind = faults[row, KIND]
        if elapsed < 0 or kind > ENCODER_OFFSET or faults[row, PLACE] != joint:
            continue
        if kind == ENCODER_FREEZE:
            reading = last_reading
        elif kind == ENCODER_MISSING:
            reading = math.nan
        elif kind == ENCODER_DRIFT:
            reading += magnitudes[row] * (elapsed * period)
        elif kind == ENCODER_OFFSET or elapsed < JUMP_TICKS:
            reading += magnitudes[row]
    return reading


def faulty_load(leg: int, tick: int, faults: Array, load: float, last_load: float) -> float:
    """What the load sensor of a foot reads under its faults.

    Args:
        leg: Index of the leg.
        tick: Present tick.
        faults: Shape ``(n, 3)``.
        load: Of the healthy sensor.
        last_load: What it read in the tick before.

    Returns:
        Reading, in the unit of the load.
    """
    for row in range(faults.shape[0]):
        stuck = faults[row, KIND] == FOOT_LOAD_STUCK and faults[row, PLACE] == leg
        if stuck and tick >= faults[row, START_TICK]:
            load = last_load
    return load


def runaway_torque(joint: int, tick: int, period: float, faults: Array, magnitudes: Array) -> float:
    """Torque that a controller gone wrong adds: a ramp.

    Args:
        joint: Index of the joint.
        tick: Present tick.
        period: Length of a tick in [s].
        faults: Shape ``(n, 3)``.
        magnitudes: Rate in [N m] / [s], shape ``(n,)``.

    Returns:
        Torque in [N m].
    """
    torque = 0.0
    for row in range(faults.shape[0]):
        elapsed = tick - faults[row, START_TICK]
        if faults[row, KIND] == CONTROLLER_RUNAWAY and faults[row, PLACE] == joint and elapsed >= 0:
            torque += magnitudes[row] * (elapsed * period)
    return torque


def drive_fault(joint: int, tick: int, faults: Array) -> int:
    """The fault of a joint's drive that is at work.

    Args:
        joint: Index of the joint.
        tick: Present tick.
        faults: Shape ``(n, 3)``.

    Returns:
        Its row, the first one if there are several, or ``NO_FAULT``.
    """
    for row in range(faults.shape[0]):
        kind = faults[row, KIND]
        broken = kind == MOTOR_DEAD or kind == MOTOR_STUCK
        if broken and faults[row, PLACE] == joint and tick >= faults[row, START_TICK]:
            return row
    return NO_FAULT


def supply_drop(tick: int, faults: Array, magnitudes: Array) -> float:
    """Voltage that the supply lacks.

    Args:
        tick: Present tick.
        faults: Shape ``(n, 3)``.
        magnitudes: In [V], shape ``(n,)``.

    Returns:
        Voltage in [V], 0 without a dip.
    """
    drop = 0.0
    for row in range(faults.shape[0]):
        elapsed = tick - faults[row, START_TICK]
        if faults[row, KIND] == SUPPLY_DIP and 0 <= elapsed < DIP_TICKS:
            drop += magnitudes[row]
    return drop


def dipped_bus_voltage(voltage: float, drop: float, highest_back_emf: float) -> float:
    """Bus voltage in a dip of the supply.

    Turning motors charge the bus through the diodes of their bridges, so that it does not fall below the
    highest back-EMF; what feeds the bus is cut off, so nothing but its capacitors takes that current.

    Args:
        voltage: Without the dip in [V].
        drop: Of the supply in [V].
        highest_back_emf: Largest magnitude over the motors in [V].

    Returns:
        Voltage in [V].
    """
    return max(voltage - drop, highest_back_emf, LEAST_BUS_VOLTAGE)
