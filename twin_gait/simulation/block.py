"""Records of episodes side by side in a block, number by number.

The number at byte o of a record lies at ``o * WIDTH + 8 * lane`` bytes from the block's address, so that a
field of all episodes is one vector.
"""

from functools import lru_cache
from typing import Any

import numpy as np

# With 8 or 16 LLVM unrolls a loop over the lanes before it could turn it into vectors.
WIDTH = 32
# Fields that the lanes of a block have in common and no tick changes, after the field that their record
# stands in: where something is, which law it has, and what the whole tick goes by.
SHARED = frozenset(
    {
        *("episode.step", "episode.substeps", "episode.watching"),
        *("rates.period", "rates.decimation", "rates.blend_law"),
        *("recording.on", "recording.log", "recording.first_row", "efforts.n_ring"),
        *("joints.place", "joints.control_place", "limbs.place", "episode.ankles", "episode.passive"),
        *("encoder.window", "friction.law"),
        *("imposed_motion.place", "program.n_transitions", "program.minimum_ticks"),
        *("nodes.operation", "nodes.operand", "comparisons.signal_a", "comparisons.signal_b"),
        *(f"transitions.{name}" for name in ("source", "target", "first_node", "end_node")),
        *("transitions.debounce_ticks", "transitions.time_out_ticks"),
    }
)
_WORD = 8  # bytes of every number


@lru_cache(maxsize=32)
def shared_words(dtype: np.dtype[Any]) -> np.ndarray:
    """Which numbers of a record the lanes of a block have in common, shape ``(numbers,)``."""
    found = np.zeros(dtype.itemsize // _WORD, dtype=bool)
    _mark(dtype, "episode", 0, found)
    return found


def _mark(dtype: np.dtype[Any], owner: str, first: int, found: np.ndarray) -> None:
    """Mark the shared numbers of a record that begins at a byte."""
    assert dtype.fields is not None
    for name, (kind, offset, *_) in dtype.fields.items():
        entry, _ = kind.subdtype or (kind, ())
        for place in range(first + offset, first + offset + kind.itemsize, entry.itemsize):
            if entry.fields is not None:
                _mark(entry, name, place, found)
            else:
                found[place // _WORD] = f"{owner}.{name}" in SHARED


def word_of(dtype: np.dtype[Any], *path: str) -> int:
    """Place of a number among those of a record, by the names of the fields that lead to it."""
    place = 0
    for name in path:
        assert dtype.fields is not None
        dtype, offset = dtype.fields[name][:2]
        place += offset
    return place // _WORD


def side_by_side(records: np.ndarray) -> np.ndarray:
    """A block of at most :data:`WIDTH` records; lanes without one are copies of the first.

    Returns their numbers as whole numbers of 64 bits, shape ``(numbers, WIDTH)``.
    """
    words = records.view(np.int64).reshape(len(records), -1)
    lanes = np.arange(WIDTH)
    return np.ascontiguousarray(words[np.where(lanes < len(records), lanes, 0)].T)
