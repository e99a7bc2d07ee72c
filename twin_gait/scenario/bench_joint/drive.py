"""Winding and inverter, and what the gear loses and yields."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from twin_gait.parameters import require, require_count, require_non_negative, require_positive


class CurrentLoop(StrEnum):
    """How a target current becomes a current."""

    IDEAL = "ideal"  # at once, as far as the bus voltage drives it
    PI = "pi"  # figure 2.13: PI on the six-step measurement


@dataclass(frozen=True, kw_only=True)
class DriveParameters:
    """Winding, inverter and current loop.

    Attributes:
        inductance: L, line to line, in [H].
        pole_pairs: Of the motor (data sheet: 12).
        rate: Of the current loop in [Hz], a whole multiple of 1 kHz; 20 kHz as the thesis's position loop.
        counts: Counts of full duty: 120 MHz of the controller over 20 kHz (computed). 0 for no steps.
        loop: Ideal or PI.
        bandwidth: Of the PI loop in [rad] / [s]; an assumption, a fortieth of the loop's rate.
        noise: Standard deviation of a current sample in [A]; chosen so that the RMSE of target and measured
            current is near the thesis's 0.0113 A (calibrated, not predicted).
        ripple: Relative first harmonic of the commutation. A sine of back-EMF over 60° varies by 13.4 % from
            end to end, a cosine of 0.067; the loop sees that as current. An assumption: a tenth is left.
        delay: Periods of the loop between a sample and its use; an assumption.
        resolution: Of the current converter in [A]; 0 for none.
    """

    inductance: float
    pole_pairs: int = 12
    rate: float = 20_000.0
    counts: int = 6000
    loop: CurrentLoop = CurrentLoop.PI
    bandwidth: float = 2.0 * math.pi * 500.0
    noise: float = 0.011
    ripple: float = 0.0067
    delay: int = 1
    resolution: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("inductance", self.inductance)
        require_count("pole_pairs", self.pole_pairs)
        require_positive("current loop rate", self.rate)
        per_tick = self.rate / 1000.0
        require(per_tick == round(per_tick), "current loop rate", "a whole multiple of 1000 Hz", self.rate)
        require(self.counts >= 0, "pwm counts", "0 or more", self.counts)
        require_positive("current loop bandwidth", self.bandwidth)
        require_non_negative("current noise", self.noise)
        require_non_negative("current ripple", self.ripple)
        require(0 <= self.delay <= 100, "current delay", "0 to 100 periods of the loop", self.delay)
        require_non_negative("current resolution", self.resolution)


@dataclass(frozen=True, kw_only=True)
class CatalogueEfficiency:
    """Efficiency of the CSD-25-100 at rated torque with grease, a quadratic in temperature and input speed.

    Least squares over 44 values of Harmonic Drive's catalogue (−10 to 40 °C, 500 to 3500 1/min): RMS error
    0.011, largest 0.024 (computed). Below rated torque the efficiency is lower still.

    Attributes:
        temperature: Of the grease in [°C].
        coefficients: See :func:`twin_gait.core.motor_drive.drive_efficiency`.
        transition_velocity: Of the loss at a reversal, in [rad] / [s]; an assumption.
    """

    temperature: float = 25.0
    coefficients: tuple[float, float, float, float, float, float] = (
        0.688878205,
        9.24475524e-3,
        -1.18764569e-4,
        -1.47423702e-3,
        1.06902515e-5,
        1.57005966e-6,
    )
    transition_velocity: float = 0.02

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(
            -10.0 <= self.temperature <= 40.0,
            "gear temperature",
            "-10 to 40 °C, the range of the catalogue",
            self.temperature,
        )
        require_positive("transition_velocity", self.transition_velocity)


@dataclass(frozen=True, kw_only=True)
class Torsion:
    """Compliance of the flexspline between motor and link.

    Attributes:
        stiffness: In [N m] / [rad]; 3.1e4 is CSF-25 at low torque (from memory, medium confidence).
        damping: In [N m s] / [rad]; an assumption, about 3 % of critical for the default link.
    """

    stiffness: float = 3.1e4
    damping: float = 5.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("torsional stiffness", self.stiffness)
        require_non_negative("torsional damping", self.damping)
