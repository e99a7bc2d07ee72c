"""Postures in which a leg enters a phase, comes to rest in it, and leaves it for the next phase."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from twin_gait.checking.hanging_leg import HangingLeg, friction_torque
from twin_gait.checking.signals import SignalPoint, SignalSpace
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import impedance_torque
from twin_gait.gait.feasibility import Requirement
from twin_gait.gait.guards import Comparison, atoms
from twin_gait.gait.signals import ANGLE, OTHER, TIME, VELOCITY
from twin_gait.parameters.friction import FrictionLaw

_STEPS = 2000
_STILL = 1e-7  # [rad]; the search ends when a step is smaller
_SPEEDS = 200  # samples of the friction law up to the break-away velocity

DEPTH = 2  # number of preceding phases through which the entry of a phase is followed
SAMPLES = 9  # samples of the way of each joint, without those at thresholds
_ENTRY_SAMPLES = 3  # enough to find the first opening, which is at a threshold or at an end
_MOST = 4000  # largest number of combinations of angles and velocities that are tested
_BESIDE = 1e-6  # distance of a sample from a threshold, in the unit of the signal


def in_contact(leg: HangingLeg, phase: str) -> bool:
    """Return whether ground and other leg can move a leg: on the ground, in all phases but swing."""
    return leg.setup.experiment.scenario.grounded and not leg.setup.table.is_swing(phase)


def left_over_friction(leg: HangingLeg, phase: int) -> np.ndarray:
    r"""Compute the friction that can still hold each joint while it creeps, less the compensation.

    This is the largest :math:`T_{plant}(\omega) - G\,T_{model}(\omega)` in either direction up to the
    break-away or Stribeck velocity of the plant's law, with the stated friction ratio; above that velocity
    friction slows a joint but no longer holds it. Returns torques in [N·m], 0 or more, shape ``(n_joints,)``.
    """
    experiment = leg.setup.experiment
    true, model = experiment.plant.true_friction(), experiment.control.friction_model
    left = []
    for joint, gain in zip(leg.joints, leg.column(GAIN)[phase], strict=True):
        held, modelled = _creeping(true[joint], model[joint])
        left.append((held - gain * modelled).max())
    return np.maximum(left, 0.0)


@lru_cache(maxsize=32)  # all phases of a table and all tables of a search use the same few laws
def _creeping(true: FrictionLaw, model: FrictionLaw) -> tuple[np.ndarray, np.ndarray]:
    """Return the friction of the plant and of the model at creeping speeds, in [N·m].

    The friction of the plant is the larger one of both directions.
    """
    speeds = np.linspace(0.0, true.to_plant_friction().stribeck_velocity, _SPEEDS)[1:].tolist()
    held = [max(friction_torque(true, speed), -friction_torque(true, -speed)) for speed in speeds]
    return np.array(held), np.array([friction_torque(model, speed) for speed in speeds])


@dataclass(frozen=True)
class Rest:
    """Rest posture of a leg that entered a phase at some posture."""

    start: np.ndarray  # posture of entry in [rad], shape ``(n_joints,)``
    middle: np.ndarray  # rest without friction in [rad], shape ``(n_joints,)``
    # rests with the left-over friction of every joint for or against it, shape ``(2 ** n_joints, n_joints)``
    corners: np.ndarray
    # largest speed towards the rest that the torque at the start can drive against the damper, with its sign,
    # in [rad/s], shape ``(n_joints,)``
    velocities: np.ndarray

    def path(self) -> np.ndarray:
        """Return the lowest and highest angle of each joint on its way to the nearest rest.

        In [rad], shape ``(n_joints, 2)``.
        """
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        nearest = np.clip(self.start, low, high)
        return np.array([np.minimum(self.start, nearest), np.maximum(self.start, nearest)]).T


def _feed_forward(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Compute the gravity compensation plus the target torque in [N·m], shape ``(n_joints,)``."""
    targets = leg.setup.experiment.control.target_torque
    target = np.array([targets.get(joint, 0.0) for joint in leg.joints])
    return np.asarray(leg.gravity_shares[phase] * leg.modelled_gravity(angles) + target)


def _carried(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Compute the torques in [N·m] by which the motors carry the leg: zero if the ground carries it."""
    return np.zeros(len(angles)) if in_contact(leg, leg.phases[phase]) else leg.gravity(angles)


def command_at_rest(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Compute the torques that the controller commands at zero velocity, in [N·m], ``(n_joints,)``."""
    # The law is linear, so that it accepts arrays over the joints as well as numbers.
    stiffness, equilibrium = (leg.column(which)[phase] for which in (STIFFNESS, EQUILIBRIUM))
    springs = impedance_torque(angles, 0.0, stiffness, 0.0, equilibrium)  # type: ignore[arg-type]
    return np.asarray(springs + _feed_forward(leg, phase, angles))


def driving_torque(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Compute the torques that move a leg from rest, within the limits, in [N·m], ``(n_joints,)``.

    Friction is left out. In the air the motors have to carry the leg; a foot in contact carries the leg
    itself.
    """
    limits = leg.torque_limits()
    given = np.clip(command_at_rest(leg, phase, angles), -limits, limits)
    return np.asarray(given - _carried(leg, phase, angles))


def rest_posture(leg: HangingLeg, phase: int, start: np.ndarray, hold: np.ndarray) -> np.ndarray:
    """Find the posture at which the driving torques fall to the holding torques, or a stop is reached.

    ``start``: posture in [rad]. ``hold``: holding torques in [N·m]. Returns the posture in [rad]; each array
    has the shape ``(n_joints,)``.
    """
    low, high = leg.limits().T
    # The stiffest direction limits the steps: stiffness of the spring plus that of the uncompensated weight.
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
    """Find the rest of a leg that enters a phase at a posture in [rad], and its range due to friction."""
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


def entry_postures(leg: HangingLeg, phase: int) -> list[np.ndarray]:
    """Return the postures in [rad] at which a phase is assumed to be entered.

    These are the rests of the phases before it; if no transition leads into it, its own equilibrium.
    """
    table, equilibria = leg.setup.table, leg.column(EQUILIBRIUM)
    leading = [item.source for item in table.transitions if table.phase_index(item.target) == phase]
    found = [
        rest_posture(leg, source, equilibria[source], np.zeros(len(leg.joints)))
        for source in dict.fromkeys(map(table.phase_index, leading))
    ]
    return found or [np.clip(equilibria[phase], *leg.limits().T)]


def _thresholds(space: SignalSpace, index: int, name: str) -> list[float]:
    """Return values next to the thresholds that a guard sets for one signal, in the units of the table."""
    return [
        atom.threshold + side
        for atom in dict.fromkeys(atoms(space.transition(index).guard))
        for side in (-_BESIDE, _BESIDE)
        if isinstance(atom, Comparison) and (atom.signal, atom.minus) == (name, None)
    ]


def _candidates(
    space: SignalSpace, index: int, leg: HangingLeg, rest: Rest, samples: int
) -> dict[str, np.ndarray]:
    """Return signals of the leg on its way through the phase that is left, in the units of the table.

    Each signal has one value for each candidate.
    """
    waits = space.transition(index).is_timeout
    choices: dict[str, list[float]] = {}
    ways = zip(leg.joints, rest.path(), rest.corners.T, rest.velocities.tolist(), strict=True)
    for joint, (low, high), rests, speed in ways:
        angle, velocity = ANGLE.joint_signal_name(joint), VELOCITY.joint_signal_name(joint)
        angles = (rests.min(), rests.max()) if waits else np.linspace(low, high, samples)
        all_angles = [*np.degrees(angles), *_thresholds(space, index, angle)]
        choices[angle] = np.clip(all_angles, *space.range(angle)).tolist()
        moving = [] if waits else [math.degrees(speed), *_thresholds(space, index, velocity)]
        choices[velocity] = [0.0, *moving]
    several = [list(dict.fromkeys(values)) for values in choices.values()]
    count = math.prod(map(len, several))
    # If there are too many combinations, a fixed random selection is tested.
    few = count <= _MOST
    chosen = np.arange(count) if few else np.random.default_rng(0).choice(count, size=_MOST, replace=False)
    rows_by_signal = np.unravel_index(chosen, list(map(len, several)))
    return {
        name: np.array(values)[rows]
        for name, values, rows in zip(choices, several, rows_by_signal, strict=True)
    }


def _backgrounds(space: SignalSpace, index: int) -> list[SignalPoint]:
    """Return signals that open a guard, for several values of those of the other leg.

    The signals of the other leg are in the middle and at both ends of their ranges.
    """
    found = []
    guard = Requirement(space.transition(index).guard)
    for point in space.find([guard], {TIME: space.window(index)}):
        found.append(point)
        read = [name for name in point.signals if name.startswith(OTHER) and not name.endswith(TIME)]
        for end in (0, 1) if read else ():
            moved = {name: space.range(name)[end] for name in read}
            found.append(replace(point, signals={**point.signals, **moved}))
    return found


def exit_postures(
    space: SignalSpace, index: int, leg: HangingLeg, rest: Rest, samples: int = SAMPLES
) -> np.ndarray:
    """Return the postures at which a guard opens on the way of the leg through the phase that it leaves.

    Each joint is anywhere between the entry of the phase and its rest, or next to a threshold of the guard,
    at rest or at the speed of :class:`Rest`. A timeout occurs with the leg at rest.

    Returns angles in [rad] and velocities in [rad/s], shape ``(n, 2, n_joints)``; n is 0 if the guard
    cannot open.
    """
    backgrounds = _backgrounds(space, index)
    if not backgrounds:
        return np.zeros((0, 2, len(leg.joints)))
    candidates = _candidates(space, index, leg, rest, samples)
    rows = _in_si(leg, candidates)
    # The evaluation of a guard takes arrays as well as numbers: all candidates are tested at once.
    opened = np.zeros(rows.shape[-1], dtype=bool)
    for point in backgrounds:
        everything: dict[str, Any] = {**point.signals, **candidates}
        opened |= space.is_open(index, replace(point, signals=everything))
    if opened.any():
        return rows[..., opened].transpose(2, 0, 1)
    return _in_si(leg, backgrounds[0].signals)[None]  # otherwise the point that opens the guard


def _in_si(leg: HangingLeg, known: Mapping[str, Any]) -> np.ndarray:
    """Return angles and velocities of the joints in SI units, shape ``(2, n_joints, …)``; 0 if unknown."""
    return np.array(
        [
            [known.get(item.joint_signal_name(joint), 0.0) * item.unit.factor for joint in leg.joints]
            for item in (ANGLE, VELOCITY)
        ]
    )


@lru_cache(maxsize=64)  # rules run in succession, and ways into a phase share the phases before
def first_rests(space: SignalSpace, leg: HangingLeg, phase: str, depth: int = DEPTH) -> list[Rest]:
    """Return the rests of a phase, one for each posture at which the exits into it open first.

    A leg switches as soon as the guard opens: of the postures of each guard that leads into the phase, the
    one nearest to the entry of the preceding phase is taken. Timeouts count only if no guard leads into the
    phase. ``depth``: number of preceding phases that are followed; the first of them is entered at rest.
    """
    number = space.table.phase_index(phase)
    starts: dict[bytes, np.ndarray] = {}  # ways that meet again have the same end
    for index, item in enumerate(space.table.transitions):
        if item.target != phase or item.is_timeout or depth == 0:
            continue
        for rest in first_rests(space, leg, item.source, depth - 1):
            opened = exit_postures(space, index, leg, rest, _ENTRY_SAMPLES)[:, 0]
            if len(opened):
                angles = opened[np.abs(opened - rest.start).sum(axis=1).argmin()]
                starts[angles.tobytes()] = angles
    return [find_rest(leg, number, start) for start in starts.values() or entry_postures(leg, number)]
