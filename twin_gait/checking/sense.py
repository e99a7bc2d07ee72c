"""Numbers outside what others have published or measured."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from twin_gait.checking.finding import CheckCase, Finding, Severity, rule
from twin_gait.checking.hanging_leg import hanging_legs
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, STIFFNESS
from twin_gait.core.impedance import damping_ratio_of
from twin_gait.gait.table import JointImpedance, PhaseParameters
from twin_gait.vocabulary import JointName, Side


class PublishedRange(NamedTuple):
    """Least and largest published value, and where they stand."""

    least: float
    most: float
    source: str


_DEGREE = math.pi / 180.0
# Chapter 4 of the thesis on TWIN's hip and knee: the loop with 0.20 to 0.60 was usable, 0.35 the best.
GAIN_JOINTS = (JointName.HIP, JointName.KNEE)
GAIN_RANGE = PublishedRange(0.20, 0.60, "the thesis on TWIN's joints, chapter 4")
# Ogata, Modern Control Engineering (from memory, high confidence): a transient that neither oscillates much
# nor is sluggish. No leg exoskeleton with a table of ζ per phase was found.
DAMPING_RATIO_RANGE = PublishedRange(0.4, 0.8, "Ogata, Modern Control Engineering")
# In [N m] / [deg]. Hip and knee: the least and the largest spring that least squares finds in one of the five
# phases in the mean curves of moment over angle of Winter (1991; slow, normal) and Fukuchi et al. (2018;
# 0.9 and 1.2 m/s), for 75 kg: 16 to 231 Nm/rad and none to 359 Nm/rad. The human hip in swing at 0.5 m/s,
# 34 to 66 Nm/rad (van der Kooij et al., 2022), and the knees of Sup et al. (2009; 0 to 5 Nm/deg) lie inside.
# Ankle, found in the tables of prostheses: from the swing of the Open-Source Leg, 7.9 Nm/rad, to the
# stance of Sup et al. (2009); the swings of Sup et al., 0.3 to 0.7 Nm/deg, lie inside.
STIFFNESS_RANGES: Mapping[str, PublishedRange] = {
    JointName.HIP: PublishedRange(16.0 * _DEGREE, 231.0 * _DEGREE, "Winter 1991, Fukuchi et al. 2018"),
    JointName.KNEE: PublishedRange(0.0, 359.0 * _DEGREE, "Winter 1991, Fukuchi et al. 2018, Sup et al. 2009"),
    JointName.ANKLE: PublishedRange(7.9 * _DEGREE, 5.0, "Open-Source Leg, Sup et al. 2009"),
}


# What is said of a joint in a phase, as one side (or None for both) has it; empty if nothing is.
_Look = Callable[[Side | None, str, str, JointImpedance], str]


def _find(case: CheckCase, suggestion: str, look: _Look) -> Iterator[Finding]:
    """One warning for each phase, with what was seen of all its joints."""
    common: list[tuple[Side | None, Mapping[str, PhaseParameters]]] = [(None, case.gait.phases)]
    for side, phases in [*common, *case.gait.side_phases.items()]:
        for phase, parameters in phases.items():
            said = [look(side, phase, name, joint) for name, joint in parameters.joints.items()]
            seen = [text for text in said if text]
            if seen:
                yield Finding(Severity.WARNING, "; ".join(seen), suggestion, phase=phase, side=side)


def _out_of(what: str, value: float | None, published: PublishedRange | None, unit: str = "") -> str:
    """Where a value lies outside a range in words; empty if inside, or if one of them is not known."""
    if value is None or published is None or published.least <= value <= published.most:
        return ""
    least, most, source = published
    return f"{what} {value:.2f}{unit} is outside {least:.2f} … {most:.2f}{unit} ({source})"


@rule
def unusual_gain(case: CheckCase) -> Iterator[Finding]:
    """A friction compensation gain lies outside 0.20 to 0.60, what was usable on the bench.

    The range is that of TWIN's hip and knee; for other joints and devices there is no published one.
    """

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        published = GAIN_RANGE if name in GAIN_JOINTS else None
        return _out_of(f"{name} G", joint.friction_compensation_gain, published)

    if case.experiment is not None:
        yield from _find(case, "take a gain from 0.20 to 0.60", look)


@rule
def equilibrium_beyond_limits(case: CheckCase) -> Iterator[Finding]:
    """An equilibrium angle lies outside the limits of its joint: the spring presses it into the stop."""

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        low, high = (math.degrees(value) for value in case.limits[name])
        angle = math.degrees(joint.equilibrium_angle)
        outside = f"{name} θ0 {angle:.1f}° is outside {low:.1f} … {high:.1f}°, the joint's limits"
        return "" if low <= angle <= high else outside

    return _find(case, "move the equilibrium inside the limits", look)


@rule
def unusual_stiffness(case: CheckCase) -> Iterator[Finding]:
    """A stiffness lies outside the published ranges of its joint."""

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        return _out_of(f"{name} k", math.radians(joint.stiffness), STIFFNESS_RANGES.get(name), " Nm/deg")

    suggestion = "compare with the source; a drive with more friction and inertia needs more stiffness"
    return _find(case, suggestion, look)


@rule
def unusual_damping_ratio(case: CheckCase) -> Iterator[Finding]:
    """A damping ratio, given or resulting from b, lies outside 0.4 to 0.8.

    Where the table gives b, ζ = b / (2 √(k I)) takes the inertia of the leg in the air; without a leg model
    or a spring it is left out.
    """
    legs = hanging_legs(case)

    def look(side: Side | None, phase: str, name: str, joint: JointImpedance) -> str:
        ratio = joint.damping_ratio
        own = case.gait.side_phases
        # What both sides share is that of a leg that has nothing of its own there.
        sharing = (
            leg for leg in legs if side in (None, leg.side) and (side or phase not in own.get(leg.side, {}))
        )
        leg = next(sharing, None)
        if ratio is None and leg is not None and joint.stiffness > 0.0:
            index, place = leg.phases.index(phase), leg.joints.index(JointName(name))
            k, b, zero = (leg.column(which)[index] for which in (STIFFNESS, DAMPING, EQUILIBRIUM))
            ratio = damping_ratio_of(float(b[place]), float(k[place]), leg.mass(zero)[place, place])
        return _out_of(f"{name} ζ", ratio, DAMPING_RATIO_RANGE)

    return _find(case, "take a damping ratio from 0.4 to 0.8", look)


RULES = (unusual_gain, equilibrium_beyond_limits, unusual_stiffness, unusual_damping_ratio)
