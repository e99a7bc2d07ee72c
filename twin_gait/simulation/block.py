"""Block: records of episodes in lockstep, in which the same number of all episodes is contiguous."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

# Lanes of a block. With 8 or 16 lanes LLVM unrolls a loop over the lanes before it can vectorize the loop.
WIDTH = 32
# Fields that are equal in all lanes of a block and that no tick changes, with the field that contains their
# record: indices, selections of laws, and settings of the whole tick.
SHARED = frozenset(
    "episode.step episode.substeps episode.watching episode.has_wearer_torques episode.has_inertial_unit "
    "episode.ankles episode.passive episode.soles rates.period rates.decimation rates.blend_law recording.on "
    "recording.log recording.first_row effort_line.delay joints.index joints.model_index limbs.index "
    "encoder.window friction.law imposed_motion.index program.n_transitions program.minimum_ticks "
    "nodes.operation nodes.operand comparisons.signal_a comparisons.signal_b transitions.source "
    "transitions.target transitions.first_node transitions.end_node transitions.debounce_ticks "
    "transitions.timeout_ticks".split()
)


def fields_of(dtype: np.dtype[Any], owner: str = "episode") -> list[str]:
    """Return the field of every number of a record in order, as ``field of its record.field``."""
    found: list[str] = []
    for name, (kind, *_) in (dtype.fields or {}).items():
        entry, _ = kind.subdtype or (kind, ())
        found += (fields_of(entry, name) or [f"{owner}.{name}"]) * (kind.itemsize // entry.itemsize)
    return found


@lru_cache(maxsize=32)
def shared_words(dtype: np.dtype[Any]) -> np.ndarray:
    """Return a mask of the numbers of a record that all lanes of a block share, shape ``(numbers,)``."""
    return np.array([name in SHARED for name in fields_of(dtype)])


@lru_cache(maxsize=256)
def number_index(dtype: np.dtype[Any], name: str) -> int:
    """Return the index of a number among the numbers of a record."""
    return fields_of(dtype).index(name)


# Alignment of a block in bytes, which is a cache line. In a block at other addresses a tick takes 6 to 12 %
# longer, because vectors cross two lines (measured with AVX-512).
ALIGNMENT = 64


def interleave(stores: Sequence[np.ndarray]) -> np.ndarray:
    """Return a block of at most :data:`WIDTH` records; lanes without a record are copies of the first record.

    ``stores``: arrays of shape ``(1,)`` with the records. Returns the bits of their numbers as 64-bit
    integers, shape ``(numbers, WIDTH)``.
    """
    words, lanes = np.array([store.view(np.int64) for store in stores]), np.arange(WIDTH)
    block = _aligned_array(words.shape[1], WIDTH)
    block[:] = words[np.where(lanes < len(stores), lanes, 0)].T
    return block


def _aligned_array(rows: int, columns: int) -> np.ndarray:
    """Return an array of 64-bit integers at an address that is a multiple of :data:`ALIGNMENT`."""
    spare = ALIGNMENT // 8
    memory = np.empty(rows * columns + spare, dtype=np.int64)
    start = -(memory.ctypes.data // 8) % spare
    return memory[start : start + rows * columns].reshape(rows, columns)
