"""How the foot passes over the ground in swing."""

from __future__ import annotations

import numpy as np

from twin_gait.measures.foot_contact import FootContacts

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
