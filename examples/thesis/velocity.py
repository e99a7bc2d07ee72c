"""Delay of the velocity filter: half a second as printed, or the delay of ten samples at 100 Hz."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from thesis.bench import (
    GAINS,
    HAND_VELOCITIES,
    KNEE,
    SEED,
    SHORT_REACH,
    last_period,
    moved_by_hand,
    torque_control,
)
from thesis.friction import DEVIATIONS, FACTOR, PERIOD, WINDOW

from twin_gait.gait.table import TICK
from twin_gait.identification.signals import moving_average
from twin_gait.simulation.bench_joint.loop import BenchRun, simulate_bench
from twin_gait.studies.campaign import Campaign, planned_tests

# ---------------------------------------------------------------------- of a fall, figure 3.1


@dataclass(frozen=True, eq=False)
class FilteredFall:
    """Velocity of a fall until the stop in [rad/s]: logged, decimated, averaged; and the true one."""

    raw: np.ndarray
    slow: np.ndarray
    late: np.ndarray
    true: np.ndarray

    @property
    def delay(self) -> float:
        """Return the delay of the average in [s]."""
        return delay_of(self.slow, self.late)


def filtered_fall(name: str = "knee_2kg_5.log", seed: int = SEED) -> FilteredFall:
    """Return a fall of the knee's campaign, by default neither the slowest nor the fastest."""
    plans = planned_tests(Campaign(joint=KNEE, seed=seed))
    plan = next(item for item in plans if item.name == name)
    run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
    raw, angle = _before_stop(run), run.column("motor_angle_rad")
    true = np.diff(angle, prepend=angle[:1])[: len(raw)] / TICK
    slow = raw[::FACTOR]
    return FilteredFall(raw, slow, _averaged(slow), true[::FACTOR])


def _before_stop(run: BenchRun) -> np.ndarray:
    reached = run.column("link_angle_rad") >= run.test.link.upper_stop
    end = int(np.argmax(reached)) if reached.any() else len(reached)
    return run.column("velocity_rad_per_s")[:end]


def _averaged(values: np.ndarray) -> np.ndarray:
    """Compute the moving average for a joint that is at rest before the log begins."""
    return moving_average(np.concatenate([np.zeros(WINDOW), values]), WINDOW)[WINDOW:]


def delay_of(signal: np.ndarray, late: np.ndarray) -> float:
    """Return the delay [s]: the missing distance of a delayed velocity over the final speed.

    It holds for any motion that ends with a constant speed; samples are a
    decimated period apart, and at rest in the beginning.
    """
    return float(np.sum(signal - late)) * PERIOD / float(late[-1])


def fall_numbers(fall: FilteredFall) -> dict[str, float]:
    """Return the delay of the average, and its residual noise."""
    closed, number = 1.0 / math.sqrt(WINDOW), len(fall.slow)
    # Of the averages only one in a window is independent.
    margin = DEVIATIONS * closed * math.sqrt(0.5 / number + 0.5 * WINDOW / number)
    before, after = fall.slow - fall.true, fall.late - _averaged(fall.true)
    return {
        "delay": fall.delay,
        "delay_ms": 1e3 * fall.delay,
        "noise": float(after.std() / before.std()),
        "noise_low": closed - margin,
        "noise_high": closed + margin,
    }


# ---------------------------------------------------------------------- of the firmware and of a log


def delay_between(signal: np.ndarray, late: np.ndarray, longest: int = 200) -> float:
    """Return the lag [samples], up to ``longest``, of the largest cross-correlation of two periodic signals.

    The lag is interpolated by the vertex of the parabola through the three largest values.
    """
    lags = np.arange(longest + 1)
    correlation = np.array([float(np.dot(signal, np.roll(late, -lag))) for lag in lags])
    top = int(np.clip(np.argmax(correlation), 1, longest - 1))
    before, here, after = correlation[top - 1 : top + 2]
    return float(top + 0.5 * (before - after) / (before - 2.0 * here + after))


def closed_delay(window: int, decimation: int) -> float:
    r"""Return the mean delay of the filter of the firmware in [s].

    The mean of :math:`n` samples :math:`D` ticks apart is late by :math:`(n-1)D/2`, the difference over
    :math:`D` ticks by :math:`D/2`, and the value is held until the next one, :math:`(D-1)/2` in the mean.
    """
    return 0.5 * TICK * ((window - 1) * decimation + decimation + decimation - 1)


def log_filter(velocity: np.ndarray, window: int, decimation: int) -> np.ndarray:
    """Apply the post-processing to a log at 1 kHz (thesis 2.3.1), with each sample held until the next."""
    slow = moving_average(velocity[::decimation], window)
    return np.repeat(slow, decimation)[: len(velocity)]


@dataclass(frozen=True, eq=False)
class FilterDelay:
    """Filters of firmware and log in a test: velocities in [rad/s], and their delays in [s]."""

    run: BenchRun
    slow: np.ndarray
    held: np.ndarray
    firmware: float
    log: float


def filter_delay(seed: int = SEED) -> FilterDelay:
    """Measure both delays with the motion of the sharpest reversal, which shows a lag best."""
    hand = moved_by_hand(torque_control(GAINS[0]), reach=SHORT_REACH, fastest=HAND_VELOCITIES[1])
    run = simulate_bench(hand, seed=seed)
    rows, sensors = last_period(run), run.test.sensors
    slow = run.column("velocity_slow_rad_per_s")
    held = log_filter(run.column("velocity_rad_per_s"), sensors.window, sensors.decimation)
    true = run.column("motor_velocity_rad_per_s")[rows]
    return FilterDelay(run, slow, held, *(delay_between(true, late[rows]) * TICK for late in (slow, held)))


def delay_numbers(found: FilterDelay) -> dict[str, float]:
    """Return both delays, and the delay by the definition of the filter."""
    sensors = found.run.test.sensors
    return {
        "firmware": found.firmware,
        "log": found.log,
        "firmware_ms": 1e3 * found.firmware,
        "log_ms": 1e3 * found.log,
        "closed_ms": 1e3 * closed_delay(sensors.window, sensors.decimation),
    }
