"""Where a leg enters a phase, comes to rest in it, and can leave it for the next."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twin_gait.checking.hanging_leg import HangingLeg, friction_torque
from twin_gait.checking.signals import Point, SignalSpace
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import impedance_torque
from twin_gait.gait.guards import Comparison, atoms
from twin_gait.gait.signals import ANGLE, OTHER, TIME, VELOCITY, Signal
from twin_gait.parameters import FrictionLaw

_STEPS = 2000
_STILL = 1e-7  # [rad]; a step this small is the end of the search
_SPEEDS = 200  # samples of the friction law up to the break-away velocity

DEPTH = 2  # phases before one that its entry is followed through
SAMPLES = 9  # of the way of each joint; thresholds come on top
_ENTRY_SAMPLES = 3  # enough to find the first opening, which lies at a threshold or at an end
_MOST = 4000  # combinations of angles and velocities that are tried
_BESIDE = 1e-6  # in the unit of the signal: how far beside a threshold a sample lies


def in_contact(leg: HangingLeg, phase: str) -> bool:
    """Whether ground and other leg can move a leg in a phase: on the ground in all but swing."""
    return leg.problem.experiment.scenario.grounded and not leg.problem.table.is_swing(phase)


def left_over_friction(leg: HangingLeg, phase: int) -> np.ndarray:
    r"""Friction that can still hold each joint while it creeps, compensation counted.

    The largest :math:`T_{plant}(\omega) - G\,T_{model}(\omega)` in either direction up to the break-away or
    Stribeck velocity of the plant's law, with the stated friction ratio; above that velocity friction slows a
    joint but no longer holds it. In [N m], 0 or more, shape ``(n_joints,)``.
    """
    experiment = leg.problem.experiment
    true, model = experiment.plant.true_friction(), experiment.control.friction_model
    left = []
    for joint, gain in zip(leg.joints, leg.column(GAIN)[phase], strict=True):
        held, modelled = _creeping(true[joint], model[joint])
        left.append((held - gain * modelled).max())
    return np.maximum(left, 0.0)


@lru_cache(maxsize=32)  # all phases of a table and all tables of a search ask for the same few
def _creeping(true: FrictionLaw, model: FrictionLaw) -> tuple[np.ndarray, np.ndarray]:
    """Friction of the plant, in the direction of the larger, and of the model at the speeds of a creep."""
    speeds = np.linspace(0.0, true.in_plant().stribeck_velocity, _SPEEDS)[1:].tolist()
    held = [max(friction_torque(true, speed), -friction_torque(true, -speed)) for speed in speeds]
    return np.array(held), np.array([friction_torque(model, speed) for speed in speeds])


@dataclass(frozen=True)
class Rest:
    """Where a leg that entered a phase at some posture comes to rest in it."""

    start: np.ndarray  # posture of entry in [rad], shape ``(n_joints,)``
    middle: np.ndarray  # rest without friction in [rad], shape ``(n_joints,)``
    # rests with the left-over friction of every joint for or against it, shape ``(2 ** n_joints, n_joints)``
    corners: np.ndarray
    # largest speed towards the rest that the torque at the start can drive against the damper, with its sign,
    # in [rad] / [s], shape ``(n_joints,)``
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
    return np.asarray(leg.gravity_shares[phase] * leg.modelled_gravity(angles) + target)


def _carried(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Torques for the leg's weight that the motors have to give in [N m]: none if the ground carries it."""
    return np.zeros(len(angles)) if in_contact(leg, leg.phases[phase]) else leg.gravity(angles)


def command_at_rest(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Torques that the controller asks for while the joints are still, in [N m], shape ``(n_joints,)``."""
    # The law is linear: arrays of joints pass as numbers do.
    stiffness, equilibrium = (leg.column(which)[phase] for which in (STIFFNESS, EQUILIBRIUM))
    springs = impedance_torque(angles, 0.0, stiffness, 0.0, equilibrium)  # type: ignore[arg-type]
    return np.asarray(springs + _feed_forward(leg, phase, angles))


def driving_torque(leg: HangingLeg, phase: int, angles: np.ndarray) -> np.ndarray:
    """Torques that move a leg from rest, limits counted, friction apart, in [N m], shape ``(n_joints,)``.

    In the air the motors have to carry the leg; a foot in contact carries it itself.
    """
    limits = leg.torque_limits()
    given = np.clip(command_at_rest(leg, phase, angles), -limits, limits)
    return np.asarray(given - _carried(leg, phase, angles))


def rest_posture(leg: HangingLeg, phase: int, start: np.ndarray, hold: np.ndarray) -> np.ndarray:
    """Posture in [rad] where driving torques come down to holding torques in [N m], or a stop is reached."""
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
    """Find where a leg that enters a phase at a posture in [rad] comes to rest, as far as friction allows."""
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
    """Postures in [rad] in which a phase is taken to be entered: the rests of the phases before it.

    If nothing leads into it, its own equilibrium.
    """
    table = leg.problem.table
    leading = [item.source for item in table.transitions if table.phase_index(item.target) == phase]
    equilibria = leg.column(EQUILIBRIUM)
    found = [
        rest_posture(leg, source, equilibria[source], np.zeros(equilibria.shape[1]))
        for source in dict.fromkeys(map(table.phase_index, leading))
    ]
    return found or [np.clip(equilibria[phase], *leg.limits().T)]


class Postures(NamedTuple):
    """Postures and velocities at which a switch can happen."""

    angles: np.ndarray  # in [rad], shape ``(n, n_joints)``
    velocities: np.ndarray  # in [rad] / [s], shape ``(n, n_joints)``


def _thresholds(space: SignalSpace, index: int, name: str) -> list[float]:
    """Values beside the thresholds that a guard sets one signal, in the units of the table."""
    found = [atom for atom in atoms(space.transition(index).guard) if isinstance(atom, Comparison)]
    thresholds = [atom.threshold for atom in found if (atom.signal, atom.minus) == (name, None)]
    return [value + side for value in dict.fromkeys(thresholds) for side in (-_BESIDE, _BESIDE)]


def _candidates(
    space: SignalSpace, index: int, leg: HangingLeg, rest: Rest, samples: int
) -> Iterator[dict[str, float]]:
    """Signals of the leg on its way through the phase that is left, in the units of the table."""
    waits = space.transition(index).is_time_out
    names, values = [], []
    for joint, (low, high), speed in zip(
        range(len(leg.joints)), rest.path(), rest.velocities.tolist(), strict=True
    ):
        ends = (rest.corners[:, joint].min(), rest.corners[:, joint].max())
        angles = np.degrees(ends) if waits else np.degrees(np.linspace(low, high, samples))
        name = ANGLE.of(leg.joints[joint])
        least, most = space.range(name)
        names.append(name)
        values.append(np.clip([*angles, *_thresholds(space, index, name)], least, most).tolist())
        names.append(VELOCITY.of(leg.joints[joint]))
        values.append([0.0] if waits else [0.0, math.degrees(speed), *_thresholds(space, index, names[-1])])
    choices = [list(dict.fromkeys(several)) for several in values]
    lengths = [len(several) for several in choices]
    count = math.prod(lengths)
    # A fixed choice among too many of them.
    few = count <= _MOST
    chosen = np.arange(count) if few else np.random.default_rng(0).choice(count, size=_MOST, replace=False)
    for number in chosen.tolist():
        picked = zip(choices, np.unravel_index(number, lengths), strict=True)
        yield dict(zip(names, (several[place] for several, place in picked), strict=True))


def _backgrounds(space: SignalSpace, index: int) -> list[Point]:
    """Signals that open a guard, with the other leg's in the middle and at both ends of their ranges."""
    found = []
    for point in space.openings(index):
        found.append(point)
        read = [name for name in point.signals if name.startswith(OTHER) and not name.endswith(TIME)]
        for end in (0, 1) if read else ():
            moved = {name: space.range(name)[end] for name in read}
            found.append(replace(point, signals={**point.signals, **moved}))
    return found


def postures(
    space: SignalSpace, index: int, leg: HangingLeg, rest: Rest, samples: int = SAMPLES
) -> Postures | None:
    """Postures of a guard that lie on the way of the leg through the phase that it leaves.

    Each joint is anywhere between the entry of the phase and its rest, or beside a threshold of the guard, at
    rest or at the speed of :class:`Rest`. A time-out finds the leg at rest.

    None if the guard cannot open.
    """
    backgrounds = _backgrounds(space, index)
    if not backgrounds:
        return None
    found = [
        own
        for own in _candidates(space, index, leg, rest, samples)
        if any(
            space.is_open(index, replace(point, signals={**point.signals, **own})) for point in backgrounds
        )
    ]
    # A guard off the way: the point that opens it has to do.
    found = found or [dict(backgrounds[0].signals)]

    def column(signal: Signal) -> np.ndarray:
        names = [signal.of(joint) for joint in leg.joints]
        return np.array([[own.get(name, 0.0) * signal.unit.factor for name in names] for own in found])

    return Postures(column(ANGLE), column(VELOCITY))


@lru_cache(maxsize=64)  # rules follow each other, and ways into a phase share what comes before
def first_rests(space: SignalSpace, leg: HangingLeg, phase: str, depth: int = DEPTH) -> list[Rest]:
    """Rests of a phase, one for each posture at which the exits into it open first.

    A machine switches as soon as it may: of the postures of each guard that leads into the phase, the one
    nearest to the entry of the phase before is taken. Time-outs count only where no guard leads into the
    phase. So many phases before this one are followed; the first of them is entered at rest.
    """
    number = space.table.phase_index(phase)
    starts: dict[bytes, np.ndarray] = {}  # ways that meet again have one end
    for index, item in enumerate(space.table.transitions):
        if item.target != phase or item.is_time_out or depth == 0:
            continue
        for rest in first_rests(space, leg, item.source, depth - 1):
            opened = postures(space, index, leg, rest, _ENTRY_SAMPLES)
            if opened is not None:
                angles = opened.angles[np.abs(opened.angles - rest.start).sum(axis=1).argmin()]
                starts[angles.tobytes()] = angles
    return [find_rest(leg, number, start) for start in starts.values() or entries(leg, number)]
