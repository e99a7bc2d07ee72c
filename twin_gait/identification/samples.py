"""What a friction model is fitted to: samples of speed and friction torque, test by test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

PATH_FACTOR = 8
LONGEST_GAP = 10.0  # samples; a longer gap in a test restarts the state of a dynamic model


@dataclass(frozen=True, eq=False)
class FrictionTest:
    """One test after its processing.

    Attributes:
        name: Of the file it came from.
        velocity: Joint velocity in [rad] / [s], shape ``(n,)``.
        torque: Friction torque in [N m] with the sign of the velocity, shape ``(n,)``.
        used: Which samples a fit may use, shape ``(n,)``; the others only carry the state of dynamic models.
        time: In [s], ascending, shape ``(n,)``; None if the file has none.
        angle: Joint angle in [rad], or None.
        load: Load torque in [N m], or None.
        temperature: In [°C], or None.
        mass: Weight on the link in [kg], or None.
        counts: How many samples were read, used, and rejected by cause.
        notes: What a reader should know about how the file was read.
    """

    name: str
    velocity: np.ndarray
    torque: np.ndarray
    used: np.ndarray
    time: np.ndarray | None = None
    angle: np.ndarray | None = None
    load: np.ndarray | None = None
    temperature: np.ndarray | None = None
    mass: float | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Samples, used or not."""
        return len(self.velocity)

    @property
    def from_bench(self) -> bool:
        """Whether the torque is a balance of torques on a bench, not a column of the file."""
        return "after_decimation" in self.counts


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one or more tests in one row of arrays, each of shape ``(n,)``.

    Attributes:
        velocity: In [rad] / [s].
        torque: Friction torque in [N m].
        used: Which samples count.
        test: Index of the test.
        fresh: Where the state of a dynamic model starts anew.
        period: Since the sample before in [s]; None if a test has no time.
        time: In [s] from the start of each test, or None.
        angle: In [rad]; None unless all tests have it, like the next two.
        load: In [N m].
        temperature: In [°C].
    """

    velocity: np.ndarray
    torque: np.ndarray
    used: np.ndarray
    test: np.ndarray
    fresh: np.ndarray
    period: np.ndarray | None = None
    time: np.ndarray | None = None
    angle: np.ndarray | None = None
    load: np.ndarray | None = None
    temperature: np.ndarray | None = None

    def __len__(self) -> int:
        """Samples, used or not."""
        return len(self.velocity)

    def rows(self, chosen: np.ndarray) -> Samples:
        """Some of the samples.

        Args:
            chosen: Mask or indices; a dynamic model needs whole tests.

        Returns:
            The samples.
        """
        columns = {name: None if values is None else values[chosen] for name, values in vars(self).items()}
        return Samples(**cast("dict[str, Any]", columns))

    def used_only(self) -> Samples:
        """The samples that count, for models without a state."""
        return self if self.used.all() else self.rows(self.used)


def join_tests(tests: Sequence[FrictionTest]) -> Samples:
    """Lay tests end to end.

    Args:
        tests: At least one.

    Returns:
        Their samples; a quantity that one of the tests lacks is left out.
    """
    lengths = [len(test) for test in tests]
    fresh = np.concatenate([_fresh(test) for test in tests])
    period = _joined([None if test.time is None else _periods(test.time) for test in tests])
    time = _joined([None if test.time is None else test.time - test.time[:1] for test in tests])
    return Samples(
        velocity=np.concatenate([test.velocity for test in tests]),
        torque=np.concatenate([test.torque for test in tests]),
        used=np.concatenate([test.used for test in tests]),
        test=np.repeat(np.arange(len(tests)), lengths),
        fresh=fresh,
        period=None if period is None else np.where(fresh, 0.0, period),
        time=time,
        angle=_joined([test.angle for test in tests]),
        load=_joined([test.load for test in tests]),
        temperature=_joined([test.temperature for test in tests]),
    )


def thinned_path(samples: Samples, limit: int) -> Samples:
    """Fewer samples for a model with a state, which needs the path between them."""
    path = thinned(samples, PATH_FACTOR * limit)
    counted = np.flatnonzero(path.used)
    step = -(-len(counted) // limit)
    if step <= 1:
        return path
    used = np.zeros(len(path), dtype=bool)
    used[counted[::step]] = True
    return replace(path, used=used)


def thinned(samples: Samples, limit: int) -> Samples:
    """Every so many samples, so that a fit of millions takes no longer than one of thousands."""
    step = -(-len(samples) // limit)
    if step <= 1:
        return samples
    kept = np.arange(0, len(samples), step)
    chosen = samples.rows(kept)
    piece = np.cumsum(samples.fresh)[kept]
    fresh = np.concatenate([[True], np.diff(piece) > 0])
    period = None
    if samples.period is not None:
        elapsed = np.cumsum(samples.period)[kept]
        period = np.where(fresh, 0.0, np.diff(elapsed, prepend=elapsed[0]))
    return replace(chosen, fresh=fresh, period=period)


def _joined(columns: Sequence[np.ndarray | None]) -> np.ndarray | None:
    present = [column for column in columns if column is not None]
    return np.concatenate(present) if len(present) == len(columns) else None


def _periods(time: np.ndarray) -> np.ndarray:
    return np.diff(time, prepend=time[:1])


def _fresh(test: FrictionTest) -> np.ndarray:
    fresh = np.zeros(len(test), dtype=bool)
    if len(test) > 2 and test.time is not None:
        steps = np.diff(test.time)
        forward = steps[steps > 0.0]  # a coarse clock repeats its times
        fresh[1:] = steps > LONGEST_GAP * float(np.median(forward)) if len(forward) else False
    fresh[:1] = True
    return fresh
