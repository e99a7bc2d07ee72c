"""The inertial unit on the link."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from twin_gait.parameters import require, require_non_negative, require_positive


class InertialSensor(StrEnum):
    """What an inertial unit measures."""

    GYROSCOPE = "gyroscope"  # the velocity of the link, differentiated by the firmware
    ACCELEROMETER = "accelerometer"  # the specific force along the path of the unit


# Noise of a sample at 1 kHz: density times √500 Hz, with the 0.005 °/s/√Hz and 400 µg/√Hz of a common MEMS
# unit (MPU-6050 data sheet, from memory).
INERTIAL_NOISE: Mapping[InertialSensor, float] = {
    InertialSensor.GYROSCOPE: math.radians(0.005) * math.sqrt(500.0),  # [rad] / [s]
    InertialSensor.ACCELEROMETER: 400e-6 * 9.81 * math.sqrt(500.0),  # [m] / [s²]
}


@dataclass(frozen=True, kw_only=True)
class InertialUnit:
    """An inertial unit on the link, sampled at 1 kHz.

    Attributes:
        sensor: What it measures.
        noise: Standard deviation of a sample in [rad] / [s] or [m] / [s²]; white.
        delay: Ticks between a sample and its use; 2 for a bus of 500 Hz (thesis 2.1.2).
        lever: From the axis to the unit in [m].
        time_constant: Of the first-order filter behind it in [s].
    """

    sensor: InertialSensor
    noise: float = 0.0
    delay: int = 2
    lever: float = 0.30
    time_constant: float = 0.001

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_non_negative("inertial noise", self.noise)
        require(0 <= self.delay <= 1000, "inertial delay", "0 to 1000 ticks", self.delay)
        require_positive("inertial lever", self.lever)
        require_non_negative("inertial time_constant", self.time_constant)
