"""Where a leg comes to rest in a phase, and what friction leaves open about it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from twin_gait.checking.hanging_leg import HangingLeg, friction_torque
from twin_gait.core.actuator import saturate
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import impedance_torque
from twin_gait.scenario import TreadmillScenario
from twin_gait.vocabulary import STANCE_PHASES

_STEPS = 2000
_STILL = 1e-7  # [rad]; a step this small is the end of the search
_SPEEDS = 200  # samples of the friction law up to the break-away velocity


def in_contact(leg: HangingLeg, phase: str) -> bool:
    """Whether ground and other leg can move a leg in a phase.

    Args:
        leg: The leg.
        phase: Name of the phase.

    Returns:
        True on a treadmill in the stance phases of the five, and in those that the table's scaling names.
    """
    if not isinstance(leg.problem.experiment.scenario, TreadmillScenario):
        return False
    return phase in STANCE_PHASES or phase in leg.problem.table.scaling.stance_phases


def left_over_friction(leg: HangingLeg, phase: int) -> np.ndarray:
    r"""Friction that can still hold each joint while it creeps, compensation counted.

    The largest :math:`T_{plant}(\omega) - G\,T_{model}(\omega)` up to the break-away velocity of the plant's
    law, with the stated friction ratio; above that velocity friction slows a joint but no longer holds it.

    Args:
        leg: The leg.
        phase: Index of the phase.

    Returns:
        Torques in [N m], 0 or more, shape ``(n_joints,)``.
    """
    experiment = leg.problem.experiment
    true, model = experiment.plant.true_friction(), experiment.control.friction_model
    left = []
    for joint, gain in zip(leg.joints, leg.column(GAIN)[phase], strict=True):
        speeds = np.linspace(0.0, abs(true[joint].breakaway_velocity), _SPEEDS)[1:].tolist()
        left.append(
            max(
                friction_torque(true[joint], speed) - gain * friction_torque(model[joint], speed)
                for speed in speeds
            )
        )
    return np.maximum(left, 0.0)


@dataclass(frozen=True)
class Rest:
    """Where a leg that entered a phase at some posture comes to rest in it.

    Attributes:
        start: Posture of entry in [rad], shape ``(n_joints,)``.
        middle: Rest without friction in [rad], shape ``(n_joints,)``.
        corners: Rests with the left-over friction of every joint for or against it, shape
            ``(2 ** n_joints, n_joints)``.
        velocities: Largest speed towards the rest that the torque at the start can drive against the damper,
            with its sign, in [rad] / [s], shape ``(n_joints,)``.
    """

    start: np.ndarray
    middle: np.ndarray
    corners: np.ndarray
    velocities: np.ndarray

    def path(self) -> np.ndarray:
        """Lowest and highest angle of each joint from start to nearest rest in [rad], ``(n_joints, 2)``."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        nearest = np.clip(self.start, low, high)
        return np.array([np.minimum(self.start, nearest), np.maximum(self.start, nearest)]).T


def _feed_forward(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Gravity compensation and target torque in [N m], shape ``(n_joints,)``."""
    targets = leg.problem.experiment.control.target_torque
    target = np.array([targets.get(joint, 0.0) for joint in leg.joints])
    return np.asarray(leg.gravity_shares[phase] * leg.reckoned_gravity(angles) + target)


def _carried(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Torques for the leg's weight that the motors have to give in [N m]: none if the ground carries it."""
    return np.zeros(len(angles)) if in_contact(leg, leg.phases[phase]) else leg.gravity(angles)


def command_at_rest(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Torques that the controller asks for while the joints are still, in [N m], shape ``(n_joints,)``."""
    stiffness, equilibrium = leg.column(STIFFNESS)[phase], leg.column(EQUILIBRIUM)[phase]
    springs = [
        impedance_torque(angle, 0.0, k, 0.0, zero)
        for angle, k, zero in zip(angles, stiffness, equilibrium, strict=True)
    ]
    return np.asarray(np.array(springs) + _feed_forward(leg, phase, angles))


def driving_torque(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Torques that move a leg from rest, limits counted, friction apart.

    In the air the motors have to carry the leg; a foot in contact carries it itself.

    Args:
        leg: The leg.
        phase: Index of the phase.
        angles: Posture in [rad], shape ``(n_joints,)``.

    Returns:
        Torques in [N m], shape ``(n_joints,)``.
    """
    command, limits = command_at_rest(leg, phase, angles), leg.torque_limits()
    given = [saturate(torque, limit) for torque, limit in zip(command, limits, strict=True)]
    return np.asarray(np.array(given) - _carried(leg, phase, angles))


def rest_posture(leg: HangingLeg, phase: int, start: np.ndarray, hold: np.ndarray) -> np.ndarray:
    """Posture at which the driving torques come down to given holding torques, or a stop is reached.

    Args:
        leg: The leg.
        phase: Index of the phase.
        start: Where the search begins in [rad], shape ``(n_joints,)``.
        hold: Torques that hold the joints in [N m], shape ``(n_joints,)``.

    Returns:
        The posture in [rad].
    """
    low, high = leg.limits().T
    # Steps as the stiffest direction allows: the spring's, and what the uncompensated weight can add.
    weight = [_feed_forward(leg, phase, q) - _carried(leg, phase, q) for q in (low, high, start)]
    stiffest = leg.column(STIFFNESS)[phase] + np.abs(weight).max(axis=0).sum() + 1.0
    angles = np.clip(start, low, high)
    for _ in range(_STEPS):
        moved = np.clip(angles + (driving_torque(leg, phase, angles) - hold) / stiffest, low, high)
        if np.abs(moved - angles).max() < _STILL:
            break
        angles = moved
    return np.asarray(angles)


def find_rest(leg: HangingLeg, phase: int, start: np.ndarray) -> Rest:
    """Find where a leg comes to rest in a phase.

    Args:
        leg: The leg.
        phase: Index of the phase.
        start: Posture of entry in [rad], shape ``(n_joints,)``.

    Returns:
        The rests that friction allows.
    """
    friction = left_over_friction(leg, phase)
    middle = rest_posture(leg, phase, start, np.zeros(len(start)))
    corners = [
        rest_posture(leg, phase, middle, np.array(signs) * friction)
        for signs in itertools.product((-1.0, 1.0), repeat=len(start))
    ]
    torque, damping = driving_torque(leg, phase, start), leg.column(DAMPING)[phase]
    fastest = np.array([leg.no_load_speed(joint) for joint in leg.joints])
    pushing = np.sign(torque) * np.maximum(np.abs(torque) - friction, 0.0)
    speed = np.sign(pushing) * fastest
    np.divide(pushing, damping, out=speed, where=damping > 0.0)
    return Rest(start, middle, np.array(corners), np.clip(speed, -fastest, fastest))


def entries(leg: HangingLeg, phase: int) -> list[np.ndarray]:
    """Postures in which a phase is taken to be entered: the rests of the phases before it.

    Args:
        leg: The leg.
        phase: Index of the phase.

    Returns:
        Postures in [rad]; the phase's own equilibrium if nothing leads into it.
    """
    table = leg.problem.table
    sources = dict.fromkeys(
        table.phase_index(item.source)
        for item in table.transitions
        if table.phase_index(item.target) == phase
    )
    equilibria = leg.column(EQUILIBRIUM)
    found = [
        rest_posture(leg, source, equilibria[source], np.zeros(equilibria.shape[1])) for source in sources
    ]
    return found or [np.clip(equilibria[phase], *leg.limits().T)]
