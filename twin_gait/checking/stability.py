"""Rules on the stability of the sampled control loop of the joints in every phase."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity, once, rule
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.linear_loop import (
    LinearLoop,
    effective_damping_ratio,
    spectral_radius,
    transition_matrix,
)

# Friction is linearised at rest and at 1 rad/s, in the direction in which it rises less.
VELOCITIES = (0.0, 1.0)  # [rad/s]
_ABOUT = ("rest", "±1 rad/s")
LEAST_DAMPING_RATIO = 0.5
# A joint without a spring has an eigenvalue of exactly 1, which rounding changes; this margin allows a growth
# of 1 % in 17 minutes.
NEUTRAL = 1e-7
LARGEST_DAMPING = 1e5  # [N·m·s/rad]; the search goes no further
LARGEST_GAIN = 1.0  # the largest gain that a table may have
_BISECTIONS = 12


class _Phase(NamedTuple):
    """One phase of one leg; lists have one value for each element of ``VELOCITIES``."""

    leg: HangingLeg
    name: str
    loops: list[LinearLoop]
    radii: list[float]  # spectral radii
    ratios: list[float]  # effective damping ratios

    @property
    def is_unstable(self) -> bool:
        """Whether a small motion fails to decay."""
        return max(self.radii) > 1.0 + NEUTRAL


@once
def _phases(case: CheckCase) -> list[_Phase]:
    found = []
    for leg in hanging_legs(case):
        rings = bool(leg.bristles.any())  # at rest within its bristles for every table
        for index, name in enumerate(leg.phases):
            loops = [leg.linear_loop(index, velocity) for velocity in VELOCITIES]
            maps = [transition_matrix(loop) for loop in loops]
            ratios = [
                1.0 if rings and not velocity else effective_damping_ratio(matrix, loops[0].frame)
                for velocity, matrix in zip(VELOCITIES, maps, strict=True)
            ]
            found.append(_Phase(leg, name, loops, list(map(spectral_radius, maps)), ratios))
    return found


@rule
def unstable(case: CheckCase) -> Iterator[Finding]:
    """Find phases in which the sampled loop of the joints is unstable: its spectral radius is above 1.

    The radius is computed from the closed-loop transition matrix, at rest and at ±1 rad/s. The leg is in the
    air with its pelvis held, at the equilibrium angles of the phase and under the stated friction of the
    plant; ground and belt are not part of the loop.
    """
    for phase in _phases(case):
        if not phase.is_unstable:
            continue
        worst = int(np.argmax(phase.radii))
        radius = phase.radii[worst]
        reason = (
            f"a small motion about {_ABOUT[worst]} is amplified by {radius - 1.0:.2%} in every "
            f"{1e3 * phase.loops[0].frame:g} ms (spectral radius {radius:.4f})"
        )
        suggestion = f"move the equilibrium, lower the stiffness, or stay below the largest {_margins(phase)}"
        yield phase.leg.finding(phase.name, Severity.ERROR, reason, suggestion)


@rule
def effective_damping(case: CheckCase) -> Iterator[Finding]:
    """Find phases that oscillate: damping ratio below 0.5, delays and friction compensation included."""
    for phase in _phases(case):
        worst = int(np.argmin(phase.ratios))
        if phase.is_unstable or phase.ratios[worst] >= LEAST_DAMPING_RATIO:
            continue
        reason = (
            f"delays and friction compensation leave an effective damping ratio of {phase.ratios[worst]:.2f} "
            f"about {_ABOUT[worst]}, below {LEAST_DAMPING_RATIO:g}"
        )
        suggestion = "raise the damping, or lower the friction compensation gain"
        yield phase.leg.finding(phase.name, Severity.WARNING, reason, suggestion)


@rule
def stability_margin(case: CheckCase) -> Iterator[Finding]:
    """Report the margin of each stable phase: spectral radius, and the largest b and G of each joint."""
    for phase in _phases(case):
        if not phase.is_unstable:
            reason = (
                f"spectral radius {max(phase.radii):.4f}, effective damping ratio {min(phase.ratios):.2f}; "
                f"the loop is unstable beyond {_margins(phase)}"
            )
            suggestion = "stay below these values when you change k, b or G"
            yield phase.leg.finding(phase.name, Severity.NOTE, reason, suggestion)


def largest_stable(radius: Callable[[float], float], start: float, most: float) -> float | None:
    """Search for the value at which the spectral radius passes 1.

    The search starts at ``start`` and ends at ``most``. If the loop is unstable at ``start``, it searches
    between 0 and ``start``. Returns the largest stable value found; None if the loop is unstable at 0, too.
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


def largest_value(loops: list[LinearLoop], name: str, joint: int, most: float) -> float | None:
    """Return the largest stable ``damping`` or ``gain`` of one joint, at most ``most``.

    Everything else in the loops stays as it is. Returns None if there is no stable value.
    """
    present: np.ndarray = getattr(loops[0], name)

    def radius(value: float) -> float:
        changed = np.where(np.arange(len(present)) == joint, value, present)
        changes: dict[str, Any] = {name: changed}
        return max(spectral_radius(transition_matrix(replace(loop, **changes))) for loop in loops)

    return largest_stable(radius, float(present[joint]), most)


def _margins(phase: _Phase) -> str:
    """Return the largest stable b and G of each joint as text, with the values of the table."""

    def margin(name: str, most: float, form: str, joint: int) -> str:
        value = largest_value(phase.loops, name, joint, most)
        actual = getattr(phase.loops[0], name)[joint]
        over = "over " if value is not None and value >= most else ""
        found = "none" if value is None else f"{over}{value:{form}}"
        return f"{phase.leg.joints[joint]} {found} ({actual:{form}})"

    joints = range(len(phase.leg.joints))
    damping = ", ".join(margin("damping", LARGEST_DAMPING, ".0f", joint) for joint in joints)
    gain = ", ".join(margin("gain", LARGEST_GAIN, ".2f", joint) for joint in joints)
    return f"b {damping} N·m·s/rad and G {gain}, the values of the table in brackets"


RULES = (unstable, effective_damping, stability_margin)
