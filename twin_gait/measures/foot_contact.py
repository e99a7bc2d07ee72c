"""Contacts of a foot with the ground, from its normal force, and how it passes over the ground in swing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

CONTACT_FORCE = 20.0  # [N]; heel strike is the first rise above it after swing
# A foot that is off the ground for less than this has bounced, not swung: a swing lasts 0.4 s in healthy
# walking (Winter 1991) and some 0.3 s in running. Heels on this belt bounce for up to 0.23 s.
SHORTEST_SWING = 0.25  # [s]
# A touch that is shorter than this between two swings is a scuff, not a stance.
SHORTEST_STANCE = 0.15  # [s]


class FootContacts(NamedTuple):
    """Contacts of one foot.

    Attributes:
        heel_strikes: Ticks at which a stance begins, shape ``(n,)``; a stance that begins
            within ``SHORTEST_SWING`` of the start of the record has no swing before it and no strike.
        toe_offs: Ticks at which the foot leaves the ground for a swing, shape ``(m,)``.
        further_contacts: Ticks of all other rises: bounces and scuffs.
    """

    heel_strikes: np.ndarray
    toe_offs: np.ndarray
    further_contacts: np.ndarray


def find_foot_contacts(normal_force: np.ndarray, tick: float) -> FootContacts:
    """Find heel strikes, toe-offs and further contacts.

    Args:
        normal_force: Of one foot in [N], shape ``(n,)``.
        tick: Sampling period in [s].

    Returns:
        The contacts, as sample indices.
    """
    loaded = np.concatenate(([False], normal_force > CONTACT_FORCE, [False]))
    edges = np.flatnonzero(loaded[1:] != loaded[:-1])
    starts, ends = edges[0::2], edges[1::2]
    strikes: list[int] = []
    offs: list[int] = []
    further: list[int] = []
    for group in _groups(starts, ends, SHORTEST_SWING / tick):
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


def _groups(starts: np.ndarray, ends: np.ndarray, shortest_gap: float) -> list[list[tuple[int, int]]]:
    """Join contact spells that are less than a swing apart."""
    groups: list[list[tuple[int, int]]] = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if groups and start - groups[-1][-1][1] < shortest_gap:
            groups[-1].append((start, end))
        else:
            groups.append([(start, end)])
    return groups


# Lift-off and landing are left out: there the foot has to be low.
MIDDLE_OF_SWING = (0.25, 0.75)


def swings(contacts: FootContacts) -> np.ndarray:
    """Swings that the record holds from toe-off to heel strike.

    Args:
        contacts: Of one foot.

    Returns:
        First tick of each swing and of the stance after it, shape ``(n, 2)``, integers.
    """
    strikes = contacts.heel_strikes
    pairs = [(off, strikes[strikes > off][0]) for off in contacts.toe_offs if (strikes > off).any()]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def swing_clearances(clearance: np.ndarray, contacts: FootContacts) -> np.ndarray:
    """Least clearance of the foot in the middle half of each swing.

    Args:
        clearance: Height of the lowest point of the sole in [m], shape ``(n_ticks,)``.
        contacts: Of the same foot.

    Returns:
        Clearances in [m], shape ``(n_swings,)``.
    """
    early, late = MIDDLE_OF_SWING
    least = []
    for start, end in swings(contacts):
        first = start + round(early * (end - start))
        last = start + round(late * (end - start))
        least.append(clearance[first : last + 1].min())
    return np.array(least)


def scuffs(contacts: FootContacts) -> np.ndarray:
    """Further contacts in swing; those in stance are bounces.

    Args:
        contacts: Of one foot.

    Returns:
        Ticks, shape ``(n,)``, integers.
    """
    touches = [touch for touch in contacts.further_contacts if _is_in_swing(contacts, touch)]
    return np.array(touches, dtype=int)


def _is_in_swing(contacts: FootContacts, tick: int) -> bool:
    """Whether the foot left the ground last, rather than landed."""
    last_off = max(contacts.toe_offs[contacts.toe_offs < tick], default=-1)
    last_strike = max(contacts.heel_strikes[contacts.heel_strikes < tick], default=-1)
    return bool(last_off > last_strike)
