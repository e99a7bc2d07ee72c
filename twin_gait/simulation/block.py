"""A block: records of episodes in lockstep, number by number side by side."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

# With 8 or 16 LLVM unrolls a loop over the lanes before it could turn it into vectors.
WIDTH = 32
# Fields that the lanes of a block have in common and no tick changes, after the field that their record
# stands in: where something is, which law it has, and what the whole tick goes by.
SHARED = frozenset(
    "episode.step episode.substeps episode.watching episode.ankles episode.passive rates.period "
    "rates.decimation rates.blend_law recording.on recording.log recording.first_row effort_line.delay "
    "joints.index joints.model_index limbs.index encoder.window friction.law imposed_motion.index "
    "program.n_transitions program.minimum_ticks nodes.operation nodes.operand comparisons.signal_a "
    "comparisons.signal_b transitions.source transitions.target transitions.first_node "
    "transitions.end_node transitions.debounce_ticks transitions.timeout_ticks".split()
)


def fields_of(dtype: np.dtype[Any], owner: str = "episode") -> list[str]:
    """Fields of all numbers of a record one after the other, each after that of its record."""
    found: list[str] = []
    for name, (kind, *_) in (dtype.fields or {}).items():
        entry, _ = kind.subdtype or (kind, ())
        found += (fields_of(entry, name) or [f"{owner}.{name}"]) * (kind.itemsize // entry.itemsize)
    return found


@lru_cache(maxsize=32)
def shared_words(dtype: np.dtype[Any]) -> np.ndarray:
    """Which numbers of a record the lanes of a block have in common, shape ``(numbers,)``."""
    return np.array([name in SHARED for name in fields_of(dtype)])


@lru_cache(maxsize=256)
def number_index(dtype: np.dtype[Any], name: str) -> int:
    """Place of a number among those of a record."""
    return fields_of(dtype).index(name)


def interleave(stores: Sequence[np.ndarray]) -> np.ndarray:
    """Return a block of at most :data:`WIDTH` records; lanes without one are copies of the first.

    ``stores``: arrays of shape ``(1,)`` with the records. Returns their numbers as whole numbers of 64 bits,
    shape ``(numbers, WIDTH)``.
    """
    words, lanes = np.array([store.view(np.int64) for store in stores]), np.arange(WIDTH)
    return np.ascontiguousarray(words[np.where(lanes < len(stores), lanes, 0)].T)
