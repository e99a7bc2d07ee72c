"""Rules that find numbers outside the ranges that others have published or measured."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from twin_gait.checking.finding import CheckCase, Finding, Severity, rule
from twin_gait.checking.hanging_leg import hanging_legs
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, STIFFNESS
from twin_gait.core.impedance import ratio_from_damping
from twin_gait.gait.table import JointImpedance, PhaseParameters
from twin_gait.vocabulary import JointName, Side


class PublishedRange(NamedTuple):
    """Least and largest published value, and their source."""

    low: float
    high: float
    source: str


_DEGREE = math.pi / 180.0
# Chapter 4 of the thesis on TWIN's hip and knee: the loop was usable with gains of 0.20–0.60, best with 0.35.
GAIN_JOINTS = (JointName.HIP, JointName.KNEE)
GAIN_RANGE = PublishedRange(0.20, 0.60, "the thesis on TWIN's joints, chapter 4")
# Ogata, Modern Control Engineering (from memory, high confidence): a transient that neither oscillates much
# nor is sluggish. No leg exoskeleton with a table of ζ per phase was found.
DAMPING_RATIO_RANGE = PublishedRange(0.4, 0.8, "Ogata, Modern Control Engineering")
# Ranges of stiffness in [N·m/deg]. Hip and knee: the smallest and the largest spring that a fit by least
# squares finds in one of the five phases, in the mean curves of moment over angle of Winter (1991; slow,
# normal) and Fukuchi et al. (2018; 0.9 and 1.2 m/s), for 75 kg: hip 16–231 N·m/rad, knee 0–359 N·m/rad.
# The human hip in swing at 0.5 m/s, 34–66 N·m/rad (van der Kooij et al., 2022), and the knees of Sup et al.
# (2009; 0–5 N·m/deg) lie inside. Ankle, from the tables of prostheses: from the swing of the Open-Source Leg,
# 7.9 N·m/rad, to the stance of Sup et al. (2009); the swings of Sup et al., 0.3–0.7 N·m/deg, lie inside.
STIFFNESS_RANGES: Mapping[str, PublishedRange] = {
    JointName.HIP: PublishedRange(16.0 * _DEGREE, 231.0 * _DEGREE, "Winter 1991, Fukuchi et al. 2018"),
    JointName.KNEE: PublishedRange(0.0, 359.0 * _DEGREE, "Winter 1991, Fukuchi et al. 2018, Sup et al. 2009"),
    JointName.ANKLE: PublishedRange(7.9 * _DEGREE, 5.0, "Open-Source Leg, Sup et al. 2009"),
}


# Function that returns the text of a finding on a joint in a phase of one side (None for both sides), or an
# empty text.
_Look = Callable[[Side | None, str, str, JointImpedance], str]


def _find(case: CheckCase, suggestion: str, look: _Look) -> Iterator[Finding]:
    """Yield one warning for each phase that has a finding, with the texts of all its joints."""
    common: list[tuple[Side | None, Mapping[str, PhaseParameters]]] = [(None, case.gait.phases)]
    for side, phases in [*common, *case.gait.side_phases.items()]:
        for phase, parameters in phases.items():
            texts = [look(side, phase, name, joint) for name, joint in parameters.joints.items()]
            seen = [text for text in texts if text]
            if seen:
                yield Finding(Severity.WARNING, "; ".join(seen), suggestion, phase=phase, side=side)


def _range_text(label: str, value: float | None, published: PublishedRange | None, unit: str = "") -> str:
    """Describe how a value is outside a range; the text is empty if it is inside or if either is None."""
    if value is None or published is None or published.low <= value <= published.high:
        return ""
    least, most, source = published
    return f"{label} {value:.2f}{unit} is outside {least:.2f} … {most:.2f}{unit} ({source})"


@rule
def unusual_gain(case: CheckCase) -> Iterator[Finding]:
    """Find friction compensation gains outside 0.20 to 0.60, the range that was usable on the bench.

    The range applies to TWIN's hip and knee; no range is published for other joints and devices.
    """

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        published = GAIN_RANGE if name in GAIN_JOINTS else None
        return _range_text(f"{name} G", joint.friction_compensation_gain, published)

    if case.experiment is not None:
        yield from _find(case, "choose a gain from 0.20 to 0.60", look)


@rule
def equilibrium_beyond_limits(case: CheckCase) -> Iterator[Finding]:
    """Find equilibrium angles outside the limits of their joint: the spring presses it into the stop."""

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        low, high = (math.degrees(value) for value in case.limits[name])
        angle = math.degrees(joint.equilibrium_angle)
        outside = f"{name} θ0 {angle:.1f}° is outside {low:.1f} … {high:.1f}°, the joint's limits"
        return "" if low <= angle <= high else outside

    return _find(case, "move the equilibrium inside the limits", look)


@rule
def unusual_stiffness(case: CheckCase) -> Iterator[Finding]:
    """Find stiffnesses outside the published ranges of their joint."""

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        return _range_text(f"{name} k", math.radians(joint.stiffness), STIFFNESS_RANGES.get(name), " N·m/deg")

    suggestion = "compare with the source; a drive with more friction and inertia needs a higher stiffness"
    return _find(case, suggestion, look)


@rule
def unusual_damping_ratio(case: CheckCase) -> Iterator[Finding]:
    """Find damping ratios, given or computed from b, outside 0.4 to 0.8.

    If the table gives b, the ratio ζ = b / (2 √(k I)) is computed with the inertia of the leg in the air. It
    is not checked without a leg model or without a spring.
    """
    legs = hanging_legs(case)

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        ratio = joint.damping_ratio
        separate = case.gait.side_phases
        # A phase that both sides share is checked on a leg that has no phase of its own in its place.
        sharing = (
            leg
            for leg in legs
            if side in (None, leg.side) and (side or phase not in separate.get(leg.side, {}))
        )
        leg = next(sharing, None)
        if ratio is None and leg is not None and joint.stiffness > 0.0:
            index, joint_index = leg.phases.index(phase), leg.joints.index(JointName(name))
            k, b, zero = (leg.column(which)[index] for which in (STIFFNESS, DAMPING, EQUILIBRIUM))
            inertia = leg.mass(zero)[joint_index, joint_index]
            ratio = ratio_from_damping(float(b[joint_index]), float(k[joint_index]), inertia)
        return _range_text(f"{name} ζ", ratio, DAMPING_RATIO_RANGE)

    return _find(case, "choose a damping ratio from 0.4 to 0.8", look)


RULES = (unusual_gain, equilibrium_beyond_limits, unusual_stiffness, unusual_damping_ratio)
