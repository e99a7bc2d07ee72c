"""Synthetic logs of a joint test bench in closed form: the current follows from a given motion.

Friction, load and inertia are written out here, independently of the package. The logs are invented, not
measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

KNEE = (1.743, 3.193, 0.2031, 2.06)  # a, b, c, d of table 3.1, in sign-normal form
HIP = (1.664, 4.2, 0.2252, 2.26)
TORQUE_CONSTANT = {"knee": 0.0705, "hip": 0.109}
RATIO, GRAVITY, LEVER = 100.0, 9.81, 0.30
ARMATURE = (3.06e-4 + 0.282e-4) * RATIO**2
LINK_INERTIA = 0.02
COUNT = 2.0 * np.pi / (8192 * RATIO)
WEIGHTS = (1.0, 1.5, 2.0, 2.5, 3.0)
RATE = 1000.0


def rotational(w: np.ndarray, law: tuple[float, float, float, float]) -> np.ndarray:
    a, b, c, d = law
    return np.sqrt(2 * np.e) * (a - b) * np.exp(-((w / c) ** 2)) * w / c + b * np.tanh(w / (c / 10)) + d * w


@dataclass(frozen=True)
class Noise:
    """Errors of the bench: encoder counts, white noise of the current, and offsets constant in a test."""

    count: float = COUNT
    current: float = 0.05  # [A]
    offset: float = 0.01  # [A], drawn for each test
    friction: float = 0.02  # relative, drawn for each test, because a joint varies between tests


QUIET = Noise(count=0.0, current=0.0, offset=0.0, friction=0.0)


def swing(time: np.ndarray, speed: float, period: float, phase: float) -> tuple[np.ndarray, ...]:
    """Return angle, velocity and acceleration of the sum of a slow and a fast sine, shape ``(n,)`` each."""
    w1, w2 = 2 * np.pi / period, 2 * np.pi / (3.7 * period)
    v1, v2 = 0.7 * speed, 0.3 * speed
    angle = np.pi / 2 + v1 / w1 * np.sin(w1 * time + phase) + v2 / w2 * np.sin(w2 * time)
    velocity = v1 * np.cos(w1 * time + phase) + v2 * np.cos(w2 * time)
    return angle, velocity, -v1 * w1 * np.sin(w1 * time + phase) - v2 * w2 * np.sin(w2 * time)


def fall(time: np.ndarray, speed: float, stop: float = np.radians(125.0)) -> tuple[np.ndarray, ...]:
    """Return angle, velocity and acceleration of a drop with a varying velocity that ends at the stop."""
    rise, w = 0.4, 2 * np.pi * 3.0
    grown = 1 - np.exp(-time / rise)
    waver, depth = np.sin(w * time), 0.25
    velocity = speed * grown * (1 + depth * waver)
    acceleration = speed * (
        np.exp(-time / rise) / rise * (1 + depth * waver) + grown * depth * w * np.cos(w * time)
    )
    angle = np.pi / 2 + np.concatenate(
        [[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))]
    )
    stopped = angle >= stop
    return (
        np.where(stopped, stop, angle),
        np.where(stopped, 0.0, velocity),
        np.where(stopped, 0.0, acceleration),
    )


def bench_log(
    motion: tuple[np.ndarray, ...],
    mass: float,
    law: tuple[float, float, float, float],
    rng: np.random.Generator,
    *,
    joint: str = "knee",
    noise: Noise = Noise(),
    friction=rotational,
) -> dict[str, np.ndarray]:
    """Return the columns of a log whose current balances load, inertia and friction."""
    angle, velocity, acceleration = motion
    inertia = ARMATURE + LINK_INERTIA + mass * LEVER**2
    load = mass * GRAVITY * LEVER * np.cos(angle - np.pi / 2)
    torque = friction(velocity, law) * (1 + noise.friction * rng.normal())
    current = (torque + inertia * acceleration - load) / (TORQUE_CONSTANT[joint] * RATIO)
    measured = np.round(angle / noise.count) * noise.count if noise.count else angle
    return {
        "time_s": np.arange(len(angle)) / RATE,
        "position_rad": measured,
        "target_position_rad": np.zeros(len(angle)),
        "measured_current_A": current
        + noise.offset * rng.normal()
        + noise.current * rng.normal(size=len(angle)),
        "target_current_A": current,
        "bus_voltage_V": np.full(len(angle), 28.8),
        "target_torque_Nm": np.zeros(len(angle)),
        "velocity_rad_per_s": np.gradient(measured, 1 / RATE),
        "duty": np.zeros(len(angle)),
    }


def campaign(
    seed: int,
    *,
    joint: str = "knee",
    two_way: bool = True,
    tests: int = 9,
    duration: float = 5.0,
    noise: Noise = Noise(),
) -> list[tuple[float, dict[str, np.ndarray]]]:
    """Return weight [kg] and columns of each test: five weights, by default with nine tests each."""
    rng = np.random.default_rng(seed)
    law = {"knee": KNEE, "hip": HIP}[joint]
    time = np.arange(round(duration * RATE)) / RATE
    logs = []
    for mass in WEIGHTS:
        for speed in np.linspace(0.15, 2.5, tests) if two_way else np.linspace(0.35, 0.6, tests):
            phase = rng.uniform(0, 2 * np.pi)
            motion = swing(time, speed, 2.0, phase) if two_way else fall(time, speed)
            logs.append((mass, bench_log(motion, mass, law, rng, joint=joint, noise=noise)))
    return logs


def write_log(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """Write columns as text and return the path."""
    lines = [",".join(f"{value:.9g}" for value in row) for row in np.column_stack(list(columns.values()))]
    path.write_text("\n".join([",".join(columns), *lines]) + "\n")
    return path
