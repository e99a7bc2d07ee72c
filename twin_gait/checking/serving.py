"""Stiffness that torque, current or voltage limit cannot serve."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twin_gait.checking.balance import command_at_rest
from twin_gait.checking.finding import Finding, Severity, Subject
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.signals import SignalSpace
from twin_gait.checking.switch_postures import first_rests
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, STIFFNESS
from twin_gait.core.impedance import damping_ratio_of


class Demand(NamedTuple):
    """What a spring asks of a motor when a phase is entered.

    Attributes:
        joint: Position of the joint.
        torque: Commanded at rest at the entry in [N m].
        speed: Largest speed on the way if the spring were served in full, in [rad] / [s].
        angles: Posture of entry in [rad], shape ``(n_joints,)``.
    """

    joint: int
    torque: float
    speed: float
    angles: np.ndarray


def release_speed(deflection: float, stiffness: float, damping: float, inertia: float) -> float:
    r"""Largest speed of a damped spring and mass that are let go at rest.

    From :math:`\ddot x + 2 \zeta \omega_0 \dot x + \omega_0^2 x = 0`:

    .. math::

        v = A\,\omega_0\,\exp\left(-\frac{\zeta}{\sqrt{1-\zeta^2}} \arccos \zeta\right), \qquad
        \omega_0 = \sqrt{k / I}

    and its continuation beyond :math:`\zeta = 1`.

    Args:
        deflection: A in [rad].
        stiffness: k in [N m] / [rad].
        damping: b in [N m s] / [rad].
        inertia: I in [kg m²].

    Returns:
        Speed in [rad] / [s], zero or more.
    """
    if stiffness == 0.0 or deflection == 0.0:
        return 0.0
    ratio = damping_ratio_of(damping, stiffness, inertia)
    if ratio < 1.0:
        exponent = ratio / math.sqrt(1.0 - ratio * ratio) * math.acos(ratio)
    elif ratio > 1.0:
        exponent = ratio / math.sqrt(ratio * ratio - 1.0) * math.acosh(ratio)
    else:
        exponent = 1.0
    return abs(deflection) * math.sqrt(stiffness / inertia) * math.exp(-exponent)


def demands(leg: HangingLeg, phase: int, angles: np.ndarray) -> list[Demand]:
    """Torque and speed that the springs of a phase ask for at an entry.

    Args:
        leg: The leg.
        phase: Index of the phase.
        angles: Posture of entry in [rad], shape ``(n_joints,)``.

    Returns:
        One demand per joint.
    """
    torques = command_at_rest(leg, phase, angles)
    deflections = angles - leg.column(EQUILIBRIUM)[phase]
    stiffness, damping = leg.column(STIFFNESS)[phase], leg.column(DAMPING)[phase]
    inertias = np.diag(leg.mass(angles))
    return [
        Demand(
            joint,
            float(torques[joint]),
            release_speed(deflections[joint], stiffness[joint], damping[joint], inertias[joint]),
            angles,
        )
        for joint in range(len(angles))
    ]


def stiffness_not_served(subject: Subject) -> list[Finding]:
    """A spring asks for more than the torque or current limit gives, or faster than the voltage allows.

    Looked at where the phase is first entered on the way through the one before, with the joints at rest.

    Args:
        subject: What is checked.

    Returns:
        A warning for each phase, with all joints that ask for too much.
    """
    space = SignalSpace(subject)
    findings = []
    for leg in hanging_legs(subject):
        for number, phase in enumerate(leg.phases):
            asked = [
                demand
                for rest in first_rests(space, leg, phase)
                for demand in demands(leg, number, rest.start)
            ]
            reasons = []
            for joint in range(len(leg.joints)):
                own = [demand for demand in asked if demand.joint == joint]
                reasons += _too_much_torque(leg, number, max(own, key=lambda item: abs(item.torque)))
                reasons += _too_much_speed(leg, max(own, key=lambda item: item.speed))
            if reasons:
                findings.append(
                    Finding(
                        rule="stiffness_not_served",
                        severity=Severity.WARNING,
                        phase=phase,
                        side=leg.shown_side,
                        reason="; ".join(reasons),
                        suggestion="lower the stiffness, or begin the phase closer to its equilibrium",
                    )
                )
    return findings


def _too_much_torque(leg: HangingLeg, phase: int, demand: Demand) -> list[str]:
    joint = leg.joints[demand.joint]
    torque_limit = leg.problem.experiment.control.limits.torque
    current_limit = leg.current_limited_torque(joint)
    limit = min(torque_limit, current_limit)
    if abs(demand.torque) <= limit:
        return []
    named = "torque limit" if torque_limit <= current_limit else "current limit"
    stiffness = math.radians(leg.column(STIFFNESS)[phase, demand.joint])
    angle = math.degrees(demand.angles[demand.joint])
    serves = f", {limit / stiffness:.0f}° of its {stiffness:.3g} Nm/deg" if stiffness > 0.0 else ""
    return [
        f"the {joint} asks for {demand.torque:.0f} Nm where it enters at {angle:.1f}°; the {named} gives "
        f"{limit:.0f} Nm{serves}"
    ]


def _too_much_speed(leg: HangingLeg, demand: Demand) -> list[str]:
    joint = leg.joints[demand.joint]
    fastest = leg.no_load_speed(joint)
    if demand.speed <= fastest:
        return []
    return [
        f"the {joint} would reach {math.degrees(demand.speed):.0f} deg/s; the voltage allows "
        f"{math.degrees(fastest):.0f} deg/s without load"
    ]


RULES = (stiffness_not_served,)
