"""Can a leg leave a phase by its own motors, or does only the time-out take it on?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from twin_gait.checking.balance import Rest, entries, find_rest, in_contact
from twin_gait.checking.finding import Finding, Severity, Subject
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.polyhedra import TIME, find_point
from twin_gait.checking.signals import LONGEST_STAY, SignalSpace
from twin_gait.gait.guards import signal_scale
from twin_gait.gait.table import TICK, DrivenBy
from twin_gait.scenario import TreadmillScenario

Ranges = Mapping[str, tuple[float, float]]

_LOAD = "foot.load_bw"
_POINT = 1e-7  # [rad]; half the width of a range that stands for one angle, as a linear program needs some


class Way(IntEnum):
    """How a phase can be left, from worst to best."""

    NONE = 0
    IN_MOTION = 1
    AT_REST = 2


class _Leaving(NamedTuple):
    """A phase of a leg, the rest that it leads to from one entry, and how it can be left on the way there."""

    leg: HangingLeg
    phase: str
    rest: Rest
    way: Way


def ways_out(space: SignalSpace, leg: HangingLeg, phase: str) -> list[tuple[Rest, Way]]:
    """How a phase can be left, for each phase that leads into it.

    Only exits with a guard count. At rest one of them has to be open with all joints still, wherever between
    its extremes the left-over friction stops the leg. In motion one has to be open somewhere between entry
    and rest, each joint anywhere on its way and as fast as torque and damper allow. All signals of the other
    leg are free; the foot carries a load in stance on a belt, and for exits that are declared to be driven by
    contact there.

    Args:
        space: Signals of the table.
        leg: The leg.
        phase: Name of the phase.

    Returns:
        Rest and best way for each entry.
    """
    index = leg.problem.table.phase_index(phase)
    found = []
    for start in entries(leg, index):
        rest = find_rest(leg, index, start)
        still = np.zeros((len(start), 2))
        corners = [np.array([corner - _POINT, corner + _POINT]).T for corner in rest.corners]
        moving = np.sort(np.array([np.zeros(len(start)), rest.velocities]).T, axis=1)
        if all(_some_exit_opens(space, leg, phase, corner, still) for corner in corners):
            way = Way.AT_REST
        elif _some_exit_opens(space, leg, phase, rest.path(), moving):
            way = Way.IN_MOTION
        else:
            way = Way.NONE
        found.append((rest, way))
    return found


def _guarded_exits(space: SignalSpace, phase: str) -> list[int]:
    return [index for index in space.exits(phase) if not space.transition(index).is_time_out]


def _some_exit_opens(
    space: SignalSpace, leg: HangingLeg, phase: str, angles: np.ndarray, velocities: np.ndarray
) -> bool:
    """Whether a guarded exit can be open with angles and velocities of the joints in some ranges, in SI."""
    ranges: dict[str, tuple[float, float]] = {}
    for joint, angle, velocity in zip(leg.joints, angles, velocities, strict=True):
        for name, (low, high) in (
            (f"{joint}.angle_deg", angle.tolist()),
            (f"{joint}.velocity_deg_per_s", velocity.tolist()),
        ):
            ranges[name] = (low / signal_scale(name), high / signal_scale(name))
    for index in _guarded_exits(space, phase):
        loaded = in_contact(leg, phase) or _is_driven_by_contact(space, leg, index)
        load = space.range(_LOAD) if loaded else (0.0, 0.0)
        if _opens(space, index, {**ranges, _LOAD: load}):
            return True
    return False


def _opens(space: SignalSpace, index: int, ranges: Ranges) -> bool:
    latest = space.time_out(space.transition(index).source)

    def range_of(name: str) -> tuple[float, float]:
        if name.endswith(TIME):
            return (TICK, latest) if name == TIME else (0.0, LONGEST_STAY)
        return ranges[name] if name in ranges else space.range(name)

    for clause in space.clauses(index):
        names = {name for item in clause.inequalities for name in item.signals}
        if find_point(clause.inequalities, {name: range_of(name) for name in names}) is not None:
            return True
    return False


# ---------------------------------------------------------------------- rules


def _leavings(subject: Subject) -> Iterator[_Leaving]:
    """Worst way out of every phase with guarded exits; not of a stance that is declared to end by contact."""
    space = SignalSpace(subject)
    for leg in hanging_legs(subject):
        for phase in leg.phases:
            exits = _guarded_exits(space, phase)
            declared = any(_is_driven_by_contact(space, leg, index) for index in exits)
            if not exits or (declared and in_contact(leg, phase)):
                continue
            rest, way = min(ways_out(space, leg, phase), key=lambda found: found[1])
            yield _Leaving(leg, phase, rest, way)


def _is_driven_by_contact(space: SignalSpace, leg: HangingLeg, index: int) -> bool:
    """Whether an exit is declared so, in a world that has ground and another leg."""
    grounded = isinstance(leg.problem.experiment.scenario, TreadmillScenario)
    return grounded and space.transition(index).driven_by is DrivenBy.CONTACT


def cannot_leave(subject: Subject) -> list[Finding]:
    """The leg comes to rest in a phase, or friction stops it, before any exit but the time-out opens.

    The static balance of hip and knee: spring with its torque, current and angle limits, gravity and its
    compensation, and the friction that compensation leaves over at the stated friction ratio. In stance on
    a belt the foot carries the leg and belt and other leg move the hip, so the finding is a warning there,
    and none if an exit of the phase is declared ``driven_by: contact``.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such phase.
    """
    findings = []
    for leg, phase, rest, way in _leavings(subject):
        stance = in_contact(leg, phase)
        if way is Way.AT_REST or (way is Way.IN_MOTION and not stance):
            continue
        findings.append(
            Finding(
                rule="cannot_leave",
                severity=Severity.WARNING if stance else Severity.ERROR,
                phase=phase,
                side=leg.shown_side,
                reason=(
                    f"by its motors the leg stops at {_posture(leg, rest)}, where {_causes(subject, phase)} "
                    f"is not open{'' if stance else ', nor was it on the way'}; {_remains(subject, phase)}"
                ),
                suggestion=(
                    "declare driven_by: contact at the exit that belt or other leg bring about, or move the "
                    "equilibrium beyond the threshold"
                    if stance
                    else "move the equilibrium beyond the threshold of an exit, or raise the stiffness"
                ),
                witness=_witness(leg, rest),
            )
        )
    return findings


def leaves_in_motion_only(subject: Subject) -> list[Finding]:
    """The exits of a swing open only on the way: once the leg rests, only the time-out is left.

    Args:
        subject: What is checked.

    Returns:
        A warning for each such phase.
    """
    return [
        Finding(
            rule="leaves_in_motion_only",
            severity=Severity.WARNING,
            phase=phase,
            side=leg.shown_side,
            reason=(
                f"{_causes(subject, phase)} can open on the way only: once the leg rests at "
                f"{_posture(leg, rest)}, {_remains(subject, phase)}"
            ),
            suggestion="move the equilibrium beyond the thresholds of one exit, or keep an early time-out",
            witness=_witness(leg, rest),
        )
        for leg, phase, rest, way in _leavings(subject)
        if way is Way.IN_MOTION and not in_contact(leg, phase)
    ]


def _causes(subject: Subject, phase: str) -> str:
    names = [
        item.cause for item in subject.table.transitions if item.source == phase and not item.is_time_out
    ]
    return " or ".join(dict.fromkeys(names))


def _remains(subject: Subject, phase: str) -> str:
    ends = any(item.is_time_out for item in subject.table.transitions if item.source == phase)
    return "only the time-out remains" if ends else "there is no time-out"


def _posture(leg: HangingLeg, rest: Rest) -> str:
    """Rests of all joints in words."""
    low, high = np.degrees(rest.corners.min(axis=0)), np.degrees(rest.corners.max(axis=0))
    parts = zip(leg.joints, low.tolist(), high.tolist(), strict=True)
    return ", ".join(f"{joint} {least:.1f} … {most:.1f}°" for joint, least, most in parts)


def _witness(leg: HangingLeg, rest: Rest) -> dict[str, float | str]:
    pairs = zip(leg.joints, rest.middle.tolist(), strict=True)
    return {f"{joint}.angle_deg": round(math.degrees(angle), 2) for joint, angle in pairs}


RULES = (cannot_leave, leaves_in_motion_only)
