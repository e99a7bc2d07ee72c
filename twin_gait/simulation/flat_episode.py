"""Lay the arrays of an episode out in two flat ones, of which they become views."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.simulation.episode_arrays import Episode, EpisodeInputs, EpisodeState
from twin_gait.simulation.flattening import Place

# Arrays whose shape depends on the transitions of the table, the duration, the faults or the wearer's delay;
# the loop is the same for all of them.
LOOSE_INTEGERS = frozenset(
    {"inputs_transitions", "inputs_nodes", "inputs_faults", "state_debounce", "state_switches"}
)
LOOSE_FIELDS = LOOSE_INTEGERS | {
    "inputs_comparisons",
    "inputs_noise",
    "inputs_magnitudes",
    "inputs_effort_noise",
    "state_efforts",
}


class FlatEpisode(NamedTuple):
    """An episode in flat arrays.

    Attributes:
        numbers: All floating-point numbers; ``x`` of the loop.
        integers: All whole numbers; ``k`` of the loop.
        places: Where each field lies, by ``inputs_name`` or ``state_name``.
        episode: The episode; its arrays of fixed shape are views of the flat ones.
    """

    numbers: np.ndarray
    integers: np.ndarray
    places: tuple[tuple[str, Place], ...]
    episode: Episode


def lay_out(episode: Episode) -> FlatEpisode:
    """Lay an episode out in flat arrays.

    Returns:
        The flat arrays and the same episode as views of them.
    """
    fields = fields_of(episode)
    whole = _size(fields, int) + len(LOOSE_FIELDS) + 1  # their lengths and those of the loose arrays
    flat = {"x": np.zeros(_size(fields, float)), "k": np.zeros(whole, dtype=np.int64)}
    used = {"x": 0, "k": 0}
    places, views = [], {}
    for name, array in fields.items():
        if name in LOOSE_FIELDS:
            flat["k"][used["k"]] = len(array)
            places.append((name, Place("", used["k"], (0, *array.shape[1:]))))
            used["k"] += 1
            # The loop reads them by their addresses: layout and type have to be these.
            kind = np.int64 if name in LOOSE_INTEGERS else np.float64
            views[name] = np.ascontiguousarray(array, dtype=kind)
            continue
        letter = "x" if array.dtype == float else "k"
        start, end = used[letter], used[letter] + array.size
        used[letter] = end
        places.append((name, Place(letter, start, array.shape)))
        views[name] = flat[letter][start:end].reshape(array.shape)
        views[name][...] = array
    inputs = EpisodeInputs(*(views[f"inputs_{name}"] for name in EpisodeInputs._fields))
    state = EpisodeState(*(views[f"state_{name}"] for name in EpisodeState._fields))
    return FlatEpisode(flat["x"], flat["k"], tuple(places), Episode(inputs, state))


def fields_of(episode: Episode) -> dict[str, np.ndarray]:
    """Arrays of an episode by ``inputs_name`` or ``state_name``."""
    inputs = zip(EpisodeInputs._fields, episode.inputs, strict=True)
    state = zip(EpisodeState._fields, episode.state, strict=True)
    return {f"inputs_{name}": array for name, array in inputs} | {
        f"state_{name}": array for name, array in state
    }


def _size(fields: dict[str, np.ndarray], kind: type) -> int:
    fixed = [array for name, array in fields.items() if name not in LOOSE_FIELDS]
    return sum(array.size for array in fixed if array.dtype == kind)
