"""Stability of the sampled loop of hip and knee in every phase."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.linear_loop import (
    LinearLoop,
    effective_damping_ratio,
    spectral_radius,
    transition_matrix,
)

# Friction is linearised at rest and at 1 rad/s; the laws are odd, so that −1 rad/s has the slopes of 1 rad/s.
VELOCITIES = (0.0, 1.0)  # [rad] / [s]
LEAST_DAMPING_RATIO = 0.5
# A joint without a spring has a mode at exactly 1, which rounding moves; this much is 1 % in 17 minutes.
NEUTRAL = 1e-7
LARGEST_DAMPING = 1e5  # [N m s] / [rad]; the search goes no further
LARGEST_GAIN = 1.0  # no table can ask for more
_BISECTIONS = 12


class _Phase(NamedTuple):
    """One phase of one leg, with its loop at each of ``VELOCITIES``."""

    leg: HangingLeg
    name: str
    loops: list[LinearLoop]


def _phases(case: CheckCase) -> Iterator[_Phase]:
    for leg in hanging_legs(case):
        for index, name in enumerate(leg.phases):
            yield _Phase(leg, name, [leg.linear_loop(index, velocity) for velocity in VELOCITIES])


def _about(velocity: float) -> str:
    return f"±{velocity:g} rad/s" if velocity else "rest"


def unstable(case: CheckCase) -> list[Finding]:
    """The sampled loop of hip and knee grows from a small disturbance in a phase.

    The spectral radius of the closed-loop transition matrix is above 1 at rest or at
    ±1 rad/s. The leg is in the air with its pelvis held, at the equilibrium angles of the phase and under
    the plant's stated friction; ground and belt are not in it.
    """
    findings = []
    for leg, phase, loops in _phases(case):
        radii = [spectral_radius(transition_matrix(loop)) for loop in loops]
        worst = int(np.argmax(radii))
        if radii[worst] <= 1.0 + NEUTRAL:
            continue
        findings.append(
            Finding(
                rule="unstable",
                severity=Severity.ERROR,
                phase=phase,
                side=leg.shown_side,
                reason=(
                    f"a small motion about {_about(VELOCITIES[worst])} grows by {radii[worst] - 1.0:.1%} in "
                    f"every {1e3 * loops[0].frame:g} ms (spectral radius {radii[worst]:.4f})"
                ),
                suggestion=f"stay below the largest {_margins(leg, loops)}",
            )
        )
    return findings


def effective_damping(case: CheckCase) -> list[Finding]:
    """A phase oscillates: damping ratio below 0.5 with delays and friction compensation counted in."""
    findings = []
    for leg, phase, loops in _phases(case):
        maps = [transition_matrix(loop) for loop in loops]
        ratios = [effective_damping_ratio(matrix, loops[0].frame) for matrix in maps]
        worst = int(np.argmin(ratios))
        grows = max(spectral_radius(matrix) for matrix in maps) > 1.0 + NEUTRAL
        if grows or ratios[worst] >= LEAST_DAMPING_RATIO:
            continue
        findings.append(
            Finding(
                rule="effective_damping",
                severity=Severity.WARNING,
                phase=phase,
                side=leg.shown_side,
                reason=(
                    f"delays and friction compensation leave an effective damping ratio of "
                    f"{ratios[worst]:.2f} about {_about(VELOCITIES[worst])}, below {LEAST_DAMPING_RATIO:g}"
                ),
                suggestion="raise the damping, or lower the friction compensation gain",
            )
        )
    return findings


def stability_margin(case: CheckCase) -> list[Finding]:
    """Distance of a stable phase from growing: spectral radius, largest b and G of each joint."""
    findings = []
    for leg, phase, loops in _phases(case):
        maps = [transition_matrix(loop) for loop in loops]
        radius = max(spectral_radius(matrix) for matrix in maps)
        ratio = min(effective_damping_ratio(matrix, loops[0].frame) for matrix in maps)
        if radius > 1.0 + NEUTRAL:
            continue
        findings.append(
            Finding(
                rule="stability_margin",
                severity=Severity.NOTE,
                phase=phase,
                side=leg.shown_side,
                reason=(
                    f"spectral radius {radius:.4f}, effective damping ratio {ratio:.2f}; the loop grows "
                    f"beyond {_margins(leg, loops)}"
                ),
                suggestion="keep these distances when you change k, b or G",
            )
        )
    return findings


# ---------------------------------------------------------------------- margins


def largest_stable(radius: Callable[[float], float], start: float, most: float) -> float | None:
    """Largest value up to which a loop is stable, beginning from the value that it has.

    Args:
        radius: Spectral radius for a value.
        start: Value that the loop has.
        most: Largest value of interest.

    Returns:
        The value at which the spectral radius passes 1, ``most`` if it does not; None if even 0 is unstable.
    """

    def stable(value: float) -> bool:
        return radius(value) <= 1.0 + NEUTRAL

    if stable(start):
        low, high = start, max(start, most / 2.0**_BISECTIONS)
        while stable(high):
            if high >= most:
                return most
            low, high = high, min(2.0 * high, most)
    elif stable(0.0):
        low, high = 0.0, start
    else:
        return None
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _changed(values: np.ndarray, joint: int, value: float) -> np.ndarray:
    changed = values.copy()
    changed[joint] = value
    return changed


def largest_damping(loops: list[LinearLoop], joint: int) -> float | None:
    """Largest stable damping of one joint in [N m s] / [rad], the rest as it is."""

    def radius(value: float) -> float:
        damping = _changed(loops[0].damping, joint, value)
        return max(spectral_radius(transition_matrix(replace(loop, damping=damping))) for loop in loops)

    return largest_stable(radius, float(loops[0].damping[joint]), LARGEST_DAMPING)


def largest_gain(loops: list[LinearLoop], joint: int) -> float | None:
    """Largest stable friction compensation gain of one joint, at most 1, the rest as it is."""

    def radius(value: float) -> float:
        gain = _changed(loops[0].gain, joint, value)
        return max(spectral_radius(transition_matrix(replace(loop, gain=gain))) for loop in loops)

    return largest_stable(radius, float(loops[0].gain[joint]), LARGEST_GAIN)


def _margins(leg: HangingLeg, loops: list[LinearLoop]) -> str:
    """Largest b and G in words, with what the table has."""
    dampings, gains = [], []
    for joint, name in enumerate(leg.joints):
        most, has = largest_damping(loops, joint), loops[0].damping[joint]
        dampings.append(f"{name} {_number(most, LARGEST_DAMPING, '.0f')} ({has:.0f})")
        most, has = largest_gain(loops, joint), loops[0].gain[joint]
        gains.append(f"{name} {_number(most, LARGEST_GAIN, '.2f')} ({has:.2f})")
    return f"b {', '.join(dampings)} Nms/rad and G {', '.join(gains)}, the table's in brackets"


def _number(value: float | None, most: float, form: str) -> str:
    """A margin in words; "over" stands for one that the search has not found."""
    if value is None:
        return "none"
    return f"over {format(most, form)}" if value >= most else format(value, form)


RULES = (unstable, effective_damping, stability_margin)
