"""Causes and record of a trip of the safety monitor."""

from typing import NamedTuple

from twin_gait.gait.table import TICK
from twin_gait.vocabulary import CodedEnum, JointName, Side


class TripCause(CodedEnum):
    """Cause of a trip of the monitor; ``code`` is also its number in :mod:`twin_gait.core.safety`."""

    NONE = "none"
    ENCODER_MISSING = "encoder_missing"
    ENCODER_JUMP = "encoder_jump"
    ENCODER_FROZEN = "encoder_frozen"
    ENCODER_MODEL = "encoder_against_model"
    JOINT_SPEED = "joint_speed"
    JOINT_RANGE = "joint_range"
    COMMAND = "command"
    TORQUE = "torque"
    CURRENT = "current"
    WINDING_HEAT = "winding_heat"
    DRIVE = "drive"
    PHASE_TIMEOUT = "phase_timeout"
    FOOT_LOAD_FROZEN = "foot_load_frozen"
    SUPPLY = "supply"
    OPERATOR = "operator"
    BUS = "bus_timeout"
    SETPOINT = "command_against_setpoint"


class SafetyState(CodedEnum):
    """State of the monitor."""

    WATCHING = "watching"
    HOLD = "hold"


_ELSEWHERE = {TripCause.OPERATOR: "operator", TripCause.BUS: "gait controller"}


class Trip(NamedTuple):
    """A trip of the monitor; the leg does not leave the hold by itself."""

    tick: int  # First tick of the hold.
    cause: TripCause  # Cause of the trip.
    side: Side | None  # Leg of the cause, or None for the supply, the operator or the gait controller.
    joint: JointName | None  # Joint of the cause, or None for these, a foot or a phase.

    @property
    def time(self) -> float:
        """Time of the trip in [s]."""
        return self.tick * TICK

    @property
    def location(self) -> str:
        """Origin in words: ``left knee``, ``right leg``, ``supply``, ``operator`` or ``gait controller``."""
        if self.side is None:
            return _ELSEWHERE.get(self.cause, "supply")
        return f"{self.side} {self.joint or 'leg'}"

    @property
    def text(self) -> str:
        """Cause and origin in words: ``encoder frozen, left knee``, or ``operator``, which is both in one."""
        return ", ".join(dict.fromkeys((str(self.cause).replace("_", " "), self.location)))
