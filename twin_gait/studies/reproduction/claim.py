"""A number of the thesis beside ours, and what is made again for one of its figures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from matplotlib.figure import Figure


class Kind(StrEnum):
    """Where our number comes from."""

    PREDICTED = "predicted"  # nothing in the program was set to get it; only these are judged
    CALIBRATED = "calibrated"  # a parameter was set to get it, so it proves nothing


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One number of the thesis and ours.

    Attributes:
        name: What is compared, in a few words.
        thesis: What the thesis prints, or None where it states only an order or a sign.
        ours: What the simulated bench gives; NaN if it gives nothing.
        unit: Of both; ``1`` for a ratio.
        kind: Whether ours was predicted or calibrated.
        low: Lower end of the band that a predicted number has to be in.
        high: Upper end.
        reason: Why the band is as wide as it is, or what was calibrated by which parameter.
        source: Equation, figure or section of the thesis.
    """

    name: str
    thesis: float | None
    ours: float
    unit: str
    kind: Kind
    low: float = -math.inf
    high: float = math.inf
    reason: str
    source: str

    @property
    def holds(self) -> bool | None:
        """Whether a predicted number is in its band; None for a calibrated one, which is not judged."""
        if self.kind is Kind.CALIBRATED:
            return None
        return math.isfinite(self.ours) and self.low <= self.ours <= self.high

    @property
    def contradicts(self) -> bool:
        """Whether ours is predicted and in its band while the thesis's number is not: a finding."""
        return bool(self.holds) and self.thesis is not None and not self.low <= self.thesis <= self.high


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """What was made again for one figure or table.

    Attributes:
        key: For ``--only``, such as ``fig-3.7`` or ``table-3.1``.
        title: What it shows.
        figure: Drawn, thesis's numbers and ours in it where there is room.
        claims: Numbers side by side.
        text: A paragraph for the page: what was done, and what it means.
        readings: Where the thesis contradicts itself: the printed reading and the corrected one, with the
            number of each.
    """

    key: str
    title: str
    figure: Figure
    claims: tuple[Claim, ...]
    text: str
    readings: tuple[str, ...] = field(default=())


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How to make a figure again.

    Attributes:
        key: For ``--only``.
        title: What it shows.
        make: Does the work, given a folder for logs that recipes share (campaigns) and the seed.
    """

    key: str
    title: str
    make: Callable[[Path, int], Reproduction]
