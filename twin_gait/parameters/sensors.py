"""Encoders and velocity filters."""

from __future__ import annotations

from dataclasses import dataclass

from twin_gait.parameters.checks import require_count, require_non_negative


@dataclass(frozen=True, kw_only=True)
class SensorParameters:
    """Encoders and the velocity estimates of the firmware.

    Attributes:
        ideal: True for exact angles; the velocity filters stay.
        encoder_counts: Counts per motor turn (an assumption).
        angle_noise: Standard deviation of white noise on the motor-side angle, seen at the joint, in [rad].
        fast_time_constant: Of ``velocity_fast`` in [s].
        decimation: Of ``velocity_slow``: every so many ticks one encoder difference.
        window: Samples in the moving average of ``velocity_slow``.
    """

    ideal: bool = True
    encoder_counts: int = 8192
    angle_noise: float = 0.0
    fast_time_constant: float = 0.005
    decimation: int = 10
    window: int = 10

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_count("encoder_counts", self.encoder_counts)
        require_non_negative("angle_noise", self.angle_noise)
        require_non_negative("fast_time_constant", self.fast_time_constant)
        require_count("decimation", self.decimation)
        require_count("window", self.window)
