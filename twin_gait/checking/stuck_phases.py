"""Rule that finds phases that a leg can leave by the timeout only, not by its own motors."""

from collections.abc import Iterator

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity, rule
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.postures import Rest, entry_postures, find_rest, in_contact
from twin_gait.checking.signals import SignalSpace, signal_space
from twin_gait.gait.feasibility import Requirement
from twin_gait.gait.signals import ANGLE, LOAD, LONGEST_STAY, OTHER_TIME, TIME, VELOCITY
from twin_gait.gait.table import TICK, DrivenBy

_POINT = 1e-7  # [rad]; half the width of a range that represents one angle, above the rounding of sums


@rule
def cannot_leave(case: CheckCase) -> Iterator[Finding]:
    """Find phases in which the leg comes to rest, or sticks, before any exit but the timeout opens.

    The rest is the static balance of the joints: spring with its torque, current and angle limits, gravity
    and its compensation, and the friction that compensation leaves over at the stated friction ratio. In
    stance on a belt the foot carries the leg, and the belt and the other leg move the hip; the finding is
    therefore a warning there, and is omitted if an exit of the phase is declared ``driven_by: contact``. If
    the wearer moves joints of the leg, it is omitted for such an exit in swing, too. It is a warning, too, if
    an exit opens during the motion but no longer at rest. There are no findings if the controller does not
    move the legs by their phases.
    """
    space = signal_space(case)
    for leg in hanging_legs(case):
        for phase in leg.phases if leg.setup.controller.phase_driven else ():
            guarded = space.guarded(phase)
            exits, contact = [space.transition(index) for index in guarded], in_contact(leg, phase)
            carried = contact or leg.setup.own_gait is not None
            declared = carried and any(item.driven_by is DrivenBy.CONTACT for item in exits)
            if exits and not declared:
                in_motion, at_rest, rest = _worst_way(space, leg, phase, guarded)
                if not at_rest:
                    causes = " or ".join(dict.fromkeys(item.cause for item in exits))
                    waits = len(guarded) < len(space.exits(phase))
                    remains = "only the timeout remains" if waits else "there is no timeout"
                    posture = _words(leg, rest)
                    reason = f"without contact the motors hold the leg at {posture}, where {causes} is closed"
                    yield _finding(leg, phase, rest, in_motion, reason, remains)


def _finding(leg: HangingLeg, phase: str, rest: Rest, in_motion: bool, reason: str, remains: str) -> Finding:
    """Create the finding: an error if only the motors move the leg and no exit opens on the way.

    Otherwise it is a warning.
    """
    severity = Severity.WARNING if in_motion else Severity.ERROR
    way = ", though it can open on the way" if in_motion else ", and it did not open on the way"
    suggestion = (
        "move the equilibrium beyond the threshold of an exit, or raise the stiffness; declare driven_by: "
        "contact on an exit that contact with the ground opens"
    )
    if in_contact(leg, phase):
        severity, way = Severity.WARNING, ""
        suggestion = (
            "declare driven_by: contact at an exit to which belt or other leg move the leg, or move the "
            "equilibrium beyond the threshold"
        )
    middle = leg.signals(rest.middle)
    return leg.finding(phase, severity, f"{reason}{way}; {remains}", suggestion, counterexample=middle)


def _words(leg: HangingLeg, rest: Rest) -> str:
    """Format the ranges of rest of all joints."""
    low, high = np.degrees(rest.corners.min(axis=0)), np.degrees(rest.corners.max(axis=0))
    parts = zip(leg.joints, low.tolist(), high.tolist(), strict=True)
    return ", ".join(f"{joint} {least:.1f} … {most:.1f}°" for joint, least, most in parts)


def _worst_way(space: SignalSpace, leg: HangingLeg, phase: str, exits: list[int]) -> tuple[bool, bool, Rest]:
    """Determine whether exits open in motion, and at rest, on the worst of the ways into a phase.

    There is one way for each phase that leads into this one. At rest, one exit has to be open with all joints
    still, wherever the left-over friction stops the leg between its extremes. In motion, one has to be open
    somewhere between entry and rest, with each joint anywhere on its way and at most as fast as torque and
    damper allow. All signals of the other leg are free. The foot carries a load in stance on a belt, and
    there also for exits that are declared to be driven by contact. Returns whether an exit opens in motion,
    whether one opens at rest, and the rest.
    """
    index, ways = leg.setup.table.phase_index(phase), []
    for start in entry_postures(leg, index):
        rest = find_rest(leg, index, start)
        still = np.zeros((len(start), 2))
        corners = [np.array([corner - _POINT, corner + _POINT]).T for corner in rest.corners]
        moving = np.sort(np.array([np.zeros(len(start)), rest.velocities]).T, axis=1)
        at_rest = all(_some_exit_opens(space, leg, exits, corner, still) for corner in corners)
        in_motion = at_rest or _some_exit_opens(space, leg, exits, rest.path(), moving)
        ways.append((in_motion, at_rest, rest))
    return min(ways, key=lambda way: way[:2])


def _some_exit_opens(
    space: SignalSpace, leg: HangingLeg, exits: list[int], angles: np.ndarray, velocities: np.ndarray
) -> bool:
    """Check whether one of the exits can be open for angles and velocities in given ranges, in SI units."""
    phase = space.transition(exits[0]).source
    ranges = {TIME: (TICK, space.timeout(phase)), OTHER_TIME: (0.0, LONGEST_STAY)}
    for joint, angle, velocity in zip(leg.joints, angles, velocities, strict=True):
        for signal, (low, high) in ((ANGLE, angle.tolist()), (VELOCITY, velocity.tolist())):
            ranges[signal.joint_signal_name(joint)] = (low / signal.unit.factor, high / signal.unit.factor)
    grounded = leg.setup.experiment.scenario.grounded
    for index in exits:
        landing = grounded and space.transition(index).driven_by is DrivenBy.CONTACT
        load = space.range(LOAD.name) if landing or in_contact(leg, phase) else (0.0, 0.0)
        if space.possible([Requirement(space.transition(index).guard)], {**ranges, LOAD.name: load}):
            return True
    return False


RULES = (cannot_leave,)
