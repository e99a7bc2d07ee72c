"""What the loop of the joint bench is bound to: what is behind addresses."""

from __future__ import annotations

from twin_gait.simulation.bench_joint.episode import BenchEpisode, BenchRow

# Places in the noise of a tick; the samples of the current follow, one for each period of the loop.
ANGLE_NOISE, UNIT_NOISE, CURRENT_NOISE = range(3)


def bench_at(address: int) -> BenchEpisode:
    """The test at an address."""
    raise NotImplementedError


def log_row(e: BenchEpisode, tick: int) -> BenchRow:
    """Row of the log for a tick."""
    raise NotImplementedError


def noise(e: BenchEpisode, tick: int, place: int) -> float:
    """Noise of a tick: of the encoder in [rad], else standard normal."""
    raise NotImplementedError
