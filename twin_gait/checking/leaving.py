"""Can a leg leave a phase by its own motors, or does only the time-out take it on?"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity, once, rule
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.postures import Rest, entries, find_rest, in_contact
from twin_gait.checking.signals import SignalSpace, signal_space
from twin_gait.gait.signals import ANGLE, LOAD, LONGEST_STAY, OTHER_TIME, TIME, VELOCITY
from twin_gait.gait.table import TICK, DrivenBy

_POINT = 1e-7  # [rad]; half the width of a range that stands for one angle, beyond the rounding of sums


class _Leaving(NamedTuple):
    """How a phase of a leg can be left at best on the way to its rest, from the worst entry."""

    leg: HangingLeg
    phase: str
    in_motion: bool  # whether an exit with a guard opens on the way at all
    at_rest: bool  # whether one is open once the leg rests
    contact: bool  # whether ground and other leg can move the leg
    rest: Rest
    causes: str  # of the exits with a guard, in words
    remains: str  # what is left where none of them opens, in words

    @property
    def posture(self) -> str:
        """Rests of all joints in words."""
        low, high = np.degrees(self.rest.corners.min(axis=0)), np.degrees(self.rest.corners.max(axis=0))
        parts = zip(self.leg.joints, low.tolist(), high.tolist(), strict=True)
        return ", ".join(f"{joint} {least:.1f} … {most:.1f}°" for joint, least, most in parts)

    def finding(self, severity: Severity, reason: str, suggestion: str) -> Finding:
        """A finding with the posture in which the leg rests."""
        middle = self.leg.signals(self.rest.middle)
        return self.leg.finding(self.phase, severity, reason, suggestion, counterexample=middle)


def _leaving(space: SignalSpace, leg: HangingLeg, phase: str, exits: list[int]) -> _Leaving:
    """How a phase can be left at best, from the worst of the phases that lead into it.

    Only exits with a guard count. At rest one of them has to be open with all joints still, wherever between
    its extremes the left-over friction stops the leg. In motion one has to be open somewhere between entry
    and rest, each joint anywhere on its way and as fast as torque and damper allow. All signals of the other
    leg are free; the foot carries a load in stance on a belt, and for exits that are declared to be driven by
    contact there.
    """
    index, ways = leg.problem.table.phase_index(phase), []
    for start in entries(leg, index):
        rest = find_rest(leg, index, start)
        still = np.zeros((len(start), 2))
        corners = [np.array([corner - _POINT, corner + _POINT]).T for corner in rest.corners]
        moving = np.sort(np.array([np.zeros(len(start)), rest.velocities]).T, axis=1)
        at_rest = all(_some_exit_opens(space, leg, exits, corner, still) for corner in corners)
        in_motion = at_rest or _some_exit_opens(space, leg, exits, rest.path(), moving)
        ways.append((in_motion, at_rest, rest))
    in_motion, at_rest, rest = min(ways, key=lambda way: way[:2])
    ends = any(space.transition(index).is_time_out for index in space.exits(phase))
    causes = " or ".join(dict.fromkeys(space.transition(index).cause for index in exits))
    remains = "only the time-out remains" if ends else "there is no time-out"
    return _Leaving(leg, phase, in_motion, at_rest, in_contact(leg, phase), rest, causes, remains)


def _some_exit_opens(
    space: SignalSpace, leg: HangingLeg, exits: list[int], angles: np.ndarray, velocities: np.ndarray
) -> bool:
    """Whether one of some exits can be open with angles and velocities of joints in some ranges, in SI."""
    phase = space.transition(exits[0]).source
    ranges = {TIME: (TICK, space.time_out(phase)), OTHER_TIME: (0.0, LONGEST_STAY)}
    for joint, angle, velocity in zip(leg.joints, angles, velocities, strict=True):
        for signal, (low, high) in ((ANGLE, angle.tolist()), (VELOCITY, velocity.tolist())):
            ranges[signal.of(joint)] = (low / signal.unit.factor, high / signal.unit.factor)
    grounded = leg.problem.experiment.scenario.grounded
    for index in exits:
        landing = grounded and space.transition(index).driven_by is DrivenBy.CONTACT
        load = space.range(LOAD.name) if landing or in_contact(leg, phase) else (0.0, 0.0)
        if space.possible([space.requirement(index)], {**ranges, LOAD.name: load}):
            return True
    return False


@once
def _leavings(case: CheckCase) -> list[_Leaving]:
    """Worst way out of every phase with guarded exits; not of a stance that is declared to end by contact.

    None where the controller moves the legs by something else than their phases.
    """
    space, found = signal_space(case), []
    for leg in hanging_legs(case):
        for phase in leg.phases if leg.problem.controller.by_phases else ():
            exits = [index for index in space.exits(phase) if not space.transition(index).is_time_out]
            declared = in_contact(leg, phase) and any(
                space.transition(index).driven_by is DrivenBy.CONTACT for index in exits
            )
            if exits and not declared:
                found.append(_leaving(space, leg, phase, exits))
    return found


@rule
def cannot_leave(case: CheckCase) -> Iterator[Finding]:
    """The leg comes to rest in a phase, or friction stops it, before any exit but the time-out opens.

    The static balance of the joints: spring with its torque, current and angle limits, gravity and its
    compensation, and the friction that compensation leaves over at the stated friction ratio. In stance on
    a belt the foot carries the leg and belt and other leg move the hip, so the finding is a warning there,
    and none if an exit of the phase is declared ``driven_by: contact``.
    """
    for found in _leavings(case):
        stops = f"by its motors the leg stops at {found.posture}, where {found.causes} is not open"
        if found.contact and not found.at_rest:
            suggestion = (
                "declare driven_by: contact at the exit that belt or other leg bring about, or move the "
                "equilibrium beyond the threshold"
            )
            yield found.finding(Severity.WARNING, f"{stops}; {found.remains}", suggestion)
        elif not found.in_motion:
            reason = f"{stops}, nor was it on the way; {found.remains}"
            suggestion = "move the equilibrium beyond the threshold of an exit, or raise the stiffness"
            yield found.finding(Severity.ERROR, reason, suggestion)


@rule
def leaves_in_motion_only(case: CheckCase) -> Iterator[Finding]:
    """The exits of a swing open only on the way: once the leg rests, only the time-out is left."""
    for found in _leavings(case):
        if found.in_motion and not found.at_rest and not found.contact:
            reason = (
                f"{found.causes} can open on the way only: once the leg rests at {found.posture}, "
                f"{found.remains}"
            )
            suggestion = "move the equilibrium beyond the thresholds of one exit, or keep an early time-out"
            yield found.finding(Severity.WARNING, reason, suggestion)


RULES = (cannot_leave, leaves_in_motion_only)
