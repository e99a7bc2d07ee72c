"""Drives of other makers on a CAN bus, as the central unit sees them: commands, reports, faults and silence.

Nothing here reads a clock: time is counted in cycles, in each of which every drive receives a setpoint.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import NamedTuple


class MotorFrame(NamedTuple):
    """Frame on the bus."""

    identifier: int  # Identifier of 11 bits.
    data: bytes  # Payload.


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorSetpoint:
    """Command for a drive in a cycle, with the measurements from which its torque was computed."""

    stiffness: float  # k in [N·m/rad].
    damping: float  # b in [N·m·s/rad].
    equilibrium: float  # θ0 in [rad].
    torque: float  # Whole torque of the command within its limits, in [N·m].
    angle: float  # Measured joint angle in [rad].
    velocity: float  # Measured joint velocity in [rad/s].


class DriveReport(NamedTuple):
    """Measurement of a drive, at the joint."""

    angle: float  # Joint angle in [rad].
    velocity: float  # Joint velocity in [rad/s].
    torque: float  # Torque in [N·m].


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """Properties of a drive that its frames depend on."""

    board: str  # Name of the joint's board, such as ``left_hip``.
    node: int  # Number of the drive on the bus.
    angles: tuple[float, float]  # Range of plausible angles in [rad].
    torque_limit: float  # Largest torque in [N·m].
    gear_ratio: float  # Motor turns per joint turn.
    start_cycles: int  # Cycles in which the drive has to become ready.
    silent_cycles: int  # Cycles without a report after which a ready drive counts as silent.
    silence_ms: int  # Their duration in [ms].


class Drive(ABC):
    """A drive on the bus.

    Attributes:
        settings: Properties of the drive.
        ready: Whether the drive executes setpoints.
        report: Last report, or None.
        fault: First fault, in words; empty for none. A faulty drive is never switched on again.
    """

    def __init__(self, settings: DriveSettings) -> None:
        """Begin with a drive that is off."""
        self.settings, self.ready, self.fault = settings, False, ""
        self.report: DriveReport | None = None
        self._silent = 0  # Cycles since the last report, or since the start.

    def cycle(self, setpoint: MotorSetpoint) -> list[MotorFrame]:
        """Return the frames of a cycle, and detect a silent drive, and a torque that is no number."""
        self._silent += 1
        if self.ready and self._silent > self.settings.silent_cycles:
            self.fail(f"is silent for {self.settings.silence_ms} ms")
        elif not self.ready and self._silent > self.settings.start_cycles:
            self.fail("did not become ready")
        if not math.isfinite(setpoint.torque):
            self.fail("receives no torque, because the command of the walk is not a finite number")
            setpoint = replace(setpoint, torque=0.0)
        return self._frames(setpoint)

    def fail(self, text: str) -> None:
        """Store the first fault."""
        self.fault = self.fault or f"drive {self.settings.node} ({self.settings.board}) {text}"

    def _store(self, report: DriveReport) -> None:
        """Store a report, and detect an angle outside its range."""
        self.report = report
        if self.ready:
            self._silent = 0
        low, high = self.settings.angles
        if not low <= report.angle <= high:
            self.fail(f"reports {report.angle:.3g} rad, outside {low:.3g} to {high:.3g} rad")

    @abstractmethod
    def receive(self, frame: MotorFrame) -> None:
        """Process a frame from the bus; frames of others are ignored."""

    def stop(self) -> list[MotorFrame]:
        """Return the frames that switch the drive off; the next cycle begins to switch it on again."""
        frames = self._stop_frames()
        self.ready, self._silent = False, 0
        return frames

    @abstractmethod
    def _stop_frames(self) -> list[MotorFrame]:
        """Return the frames that switch the drive off, and prepare another start."""

    @abstractmethod
    def _frames(self, setpoint: MotorSetpoint) -> list[MotorFrame]:
        """Return the frames of a cycle."""
