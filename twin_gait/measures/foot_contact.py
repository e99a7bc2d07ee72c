"""Contacts of a foot with the ground, found in its normal force, and its clearance in swing.

A leg moves back with the belt in stance and forwards in swing. A foot that leaves the ground and comes back
has swung if it was off the ground for long enough and its leg moved forwards meanwhile. Otherwise it has
bounced, however long that took, and its heel strike is the first touch of all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twin_gait.measures.strides import last_event_before

# A foot is loaded from a rise above the first threshold to a fall below the second one, so that a force that
# fluctuates about either threshold is one contact. Force plates are read at 20 N in the field; the release at
# half of it is our choice.
CONTACT_FORCE, RELEASE_FORCE = 20.0, 10.0  # [N]
# A foot that is off the ground for less than this has bounced, not swung: a swing lasts 0.4 s in healthy
# walking (Winter 1991) and some 0.3 s in running. Heels on this belt bounce for up to 0.23 s.
SHORTEST_SWING = 0.25  # [s]
# A foot has also not swung if the hip flexes by less than this from the angle at which the foot left the
# ground. In healthy swings it flexes by 25 to 30° (Koopman 2014); after a heel strike the leg goes back, also
# while its foot bounces.
MIN_HIP_FLEXION = math.radians(5.0)
# A touch that is shorter than this between two swings is a scuff, not a stance.
SHORTEST_STANCE = 0.15  # [s]


class FootContacts(NamedTuple):
    """Contacts of one foot."""

    # Ticks at which a stance begins, shape ``(n,)``. A stance that begins within ``SHORTEST_SWING`` of the
    # start of the record has no swing before it and no heel strike.
    heel_strikes: np.ndarray
    toe_offs: np.ndarray  # ticks at which the foot leaves the ground for a swing, shape ``(m,)``
    further_contacts: np.ndarray  # ticks of all other rises of the force: bounces and scuffs

    def truncate(self, tick: int) -> FootContacts:
        """Return the contacts before a tick."""
        return FootContacts(*(ticks[ticks < tick] for ticks in self))


def is_loaded(normal_force: np.ndarray) -> np.ndarray:
    """Determine whether a foot carries load, with hysteresis.

    ``normal_force``: force on one foot in [N], shape ``(n,)``. Returns booleans for each tick, shape
    ``(n,)``. Between the two thresholds the previous state is kept; the foot is unloaded at the start.
    """
    loaded = np.asarray(normal_force > CONTACT_FORCE)
    for start, end in find_spells(~(loaded | (normal_force < RELEASE_FORCE))):
        loaded[start:end] = start > 0 and loaded[start - 1]
    return loaded


def find_spells(condition: np.ndarray) -> list[tuple[int, int]]:
    """Return first tick and first tick after it of each interval in which a condition is true."""
    padded = np.concatenate(([False], condition, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1]).tolist()
    return list(zip(edges[0::2], edges[1::2], strict=True))


def find_foot_contacts(
    normal_force: np.ndarray,
    tick: float,
    hip_angle: np.ndarray | None = None,
    loaded: np.ndarray | None = None,
) -> FootContacts:
    """Find heel strikes, toe-offs and further contacts.

    ``normal_force``: force on one foot in [N]; ``hip_angle``: angle of the same leg in [rad], flexion
    positive, NaN where it is not known; without it, swings and bounces are distinguished by the time off the
    ground alone; ``loaded``: result of :func:`is_loaded`, computed by default. Returns the contacts as sample
    indices.
    """
    if loaded is None:
        loaded = is_loaded(normal_force)
    strikes: list[int] = []
    offs: list[int] = []
    further: list[int] = []
    for group in _groups(find_spells(loaded), SHORTEST_SWING / tick, hip_angle):
        first, last = group[0][0], group[-1][1]
        duration = sum(end - start for start, end in group)
        touches_edge = first < SHORTEST_SWING / tick or last == len(normal_force)
        if duration < SHORTEST_STANCE / tick and not touches_edge:
            further += [start for start, _ in group]
            continue
        if first >= SHORTEST_SWING / tick:
            strikes.append(first)
        further += [start for start, _ in group[1:]]
        if last < len(normal_force):
            offs.append(last)
    return FootContacts(np.array(strikes, dtype=int), np.array(offs, dtype=int), np.array(further, dtype=int))


def _groups(
    spells: list[tuple[int, int]], shortest_gap: float, hip_angle: np.ndarray | None
) -> list[list[tuple[int, int]]]:
    """Join contacts without a swing between them, each given as first tick and first tick after it."""
    groups: list[list[tuple[int, int]]] = []
    for start, end in spells:
        if groups and not _is_swing(groups[-1][-1][1], start, shortest_gap, hip_angle):
            groups[-1].append((start, end))
        else:
            groups.append([(start, end)])
    return groups


def _is_swing(start: int, end: int, shortest: float, hip_angle: np.ndarray | None) -> bool:
    """Decide whether a time off the ground is a swing."""
    if end - start < shortest:
        return False
    if hip_angle is None:
        return True
    known = hip_angle[start:end][~np.isnan(hip_angle[start:end])]
    return len(known) == 0 or bool(known.max() - known[0] >= MIN_HIP_FLEXION)


# Lift-off and landing are left out, because the foot has to be low there.
MIDDLE_OF_SWING = (0.25, 0.75)


def find_swings(contacts: FootContacts) -> np.ndarray:
    """Find the swings that the record contains from toe-off to heel strike.

    Returns the first tick of each swing and of the stance after it, shape ``(n, 2)``, integers.
    """
    offs, strikes = contacts.toe_offs, contacts.heel_strikes
    following = np.searchsorted(strikes, offs, side="right")
    ends = following < len(strikes)
    return np.array([offs[ends], strikes[following[ends]]], dtype=int).T


def swing_clearances(clearance: np.ndarray, contacts: FootContacts) -> np.ndarray:
    """Compute the least clearance of the foot in the middle half of each swing.

    ``clearance``: height of the lowest point of the sole in [m], shape ``(n_ticks,)``. Returns clearances in
    [m], shape ``(n_swings,)``.
    """
    early, late = MIDDLE_OF_SWING
    least = []
    for start, end in find_swings(contacts).tolist():
        first = start + round(early * (end - start))
        last = start + round(late * (end - start))
        least.append(clearance[first : last + 1].min())
    return np.array(least)


def find_scuffs(contacts: FootContacts) -> np.ndarray:
    """Find the further contacts in swing; those in stance are bounces.

    Returns ticks, shape ``(n,)``, integers.
    """
    touches = contacts.further_contacts
    left = last_event_before(contacts.toe_offs, touches) > last_event_before(contacts.heel_strikes, touches)
    return np.asarray(touches[left])
