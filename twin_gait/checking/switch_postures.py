"""Postures at which a leg can leave a phase, and so enter the next."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from twin_gait.checking.balance import Rest, entries, find_rest
from twin_gait.checking.hanging_leg import HangingLeg
from twin_gait.checking.polyhedra import TIME
from twin_gait.checking.signals import Point, SignalSpace
from twin_gait.gait.guards import OTHER, signal_scale

DEPTH = 2  # phases before one that its entry is followed through
SAMPLES = 9  # of the way of each joint; thresholds come on top
_ENTRY_SAMPLES = 3  # enough to find the first opening, which lies at a threshold or at an end
_MOST = 4000  # combinations of angles and velocities that are tried
_BESIDE = 1e-6  # in the unit of the signal: how far beside a threshold a sample lies


@dataclass(frozen=True)
class Postures:
    """Postures and velocities at which a switch can happen.

    Attributes:
        angles: In [rad], shape ``(n, n_joints)``.
        velocities: In [rad] / [s], shape ``(n, n_joints)``.
    """

    angles: np.ndarray
    velocities: np.ndarray


def _thresholds(space: SignalSpace, index: int, name: str) -> list[float]:
    """Values beside the thresholds that a guard sets one signal, in the units of the table."""
    thresholds = [
        item.threshold
        for clause in space.clauses(index)
        for item in clause.inequalities
        if item.signals == (name,)
    ]
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
        name = f"{leg.joints[joint]}.angle_deg"
        least, most = space.range(name)
        names.append(name)
        values.append(np.clip([*angles, *_thresholds(space, index, name)], least, most).tolist())
        names.append(f"{leg.joints[joint]}.velocity_deg_per_s")
        values.append([0.0] if waits else [0.0, math.degrees(speed), *_thresholds(space, index, names[-1])])
    choices = [list(dict.fromkeys(several)) for several in values]
    lengths = [len(several) for several in choices]
    for number in _some(math.prod(lengths)):
        picked = zip(choices, np.unravel_index(number, lengths), strict=True)
        yield dict(zip(names, (several[place] for several, place in picked), strict=True))


def _some(count: int) -> Iterable[int]:
    """All numbers below a count, or a fixed choice among too many of them."""
    if count <= _MOST:
        return range(count)
    chosen: list[int] = np.random.default_rng(0).choice(count, size=_MOST, replace=False).tolist()
    return chosen


def _backgrounds(space: SignalSpace, index: int) -> list[Point]:
    """Signals that open a guard, with the other leg's in the middle and at both ends of their ranges."""
    times = {TIME: space.window(index)}
    found = []
    for clause in space.clauses(index):
        if times[TIME][0] > times[TIME][1]:
            continue
        point = space.find(
            clause.inequalities, clause.others, times, lambda point: space.is_open(index, point)
        )
        if point is None:
            continue
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
    rest or at the speed of :class:`~twin_gait.checking.balance.Rest`. A time-out finds the leg at rest.

    Args:
        space: Signals of the table.
        index: The transition.
        leg: The leg.
        rest: Of the phase that is left.
        samples: Angles along the way of each joint.

    Returns:
        The postures at which the guard is open, or None if it cannot open.
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

    def column(quantity: str) -> np.ndarray:
        names = [f"{joint}.{quantity}" for joint in leg.joints]
        return np.array([[own.get(name, 0.0) * signal_scale(name) for name in names] for own in found])

    return Postures(column("angle_deg"), column("velocity_deg_per_s"))


def first_entries(space: SignalSpace, leg: HangingLeg, phase: str, depth: int = DEPTH) -> list[np.ndarray]:
    """Postures at which the exits into a phase open first.

    A machine switches as soon as it may: of the postures of each guard that leads into the phase, the one
    nearest to the entry of the phase before is taken. Time-outs count only where no guard leads into the
    phase.

    Args:
        space: Signals of the table.
        leg: The leg.
        phase: Name of the phase.
        depth: Phases before this one that are followed; the first of them is entered at rest.

    Returns:
        Postures in [rad], each once, of all ways into the phase.
    """
    shared = space.subject.shared
    key = (first_entries, leg.side, phase, depth)
    if key not in shared:
        shared[key] = _first_entries(space, leg, phase, depth)
    found: list[np.ndarray] = shared[key]
    return found


def _first_entries(space: SignalSpace, leg: HangingLeg, phase: str, depth: int) -> list[np.ndarray]:
    number = space.table.phase_index(phase)
    found: dict[bytes, np.ndarray] = {}  # ways that meet again have one end
    for index, item in enumerate(space.table.transitions):
        if item.target != phase or item.is_time_out or depth == 0:
            continue
        source = space.table.phase_index(item.source)
        for start in first_entries(space, leg, item.source, depth - 1):
            rest = _shared_rest(space, leg, source, start)
            opened = postures(space, index, leg, rest, _ENTRY_SAMPLES)
            if opened is not None:
                angles = opened.angles[np.abs(opened.angles - start).sum(axis=1).argmin()]
                found[angles.tobytes()] = angles
    return list(found.values()) or entries(leg, number)


def first_rests(space: SignalSpace, leg: HangingLeg, phase: str) -> list[Rest]:
    """Rests of a phase from its first entries.

    Args:
        space: Signals of the table.
        leg: The leg.
        phase: Name of the phase.

    Returns:
        One rest for each way into the phase.
    """
    number = space.table.phase_index(phase)
    return [_shared_rest(space, leg, number, start) for start in first_entries(space, leg, phase)]


def _shared_rest(space: SignalSpace, leg: HangingLeg, phase: int, start: np.ndarray) -> Rest:
    """Rest of a leg in a phase, found once for all rules and ways."""
    shared, key = space.subject.shared, (find_rest, leg.side, phase, start.tobytes())
    if key not in shared:
        shared[key] = find_rest(leg, phase, start)
    found: Rest = shared[key]
    return found
