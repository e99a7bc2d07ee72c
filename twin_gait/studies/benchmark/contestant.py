"""What a contestant is: something that steps a case through a number of ticks, again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from twin_gait.studies.benchmark.subjects import Case


class Session(Protocol):
    """A contestant set up for a case; everything that may be done beforehand is done."""

    def reset(self) -> None:
        """Go back to the start; not timed."""

    def run(self) -> None:
        """Step through all ticks; this is timed."""

    def angles(self) -> np.ndarray | None:
        """Coordinates at every tick of the last run.

        Returns:
            Shape ``(n_ticks, nv)`` in the order of the leg model; None if the contestant steps another
            motion than the closed loop or keeps no record.
        """


@dataclass(frozen=True)
class Contestant:
    """One way to step through a case.

    Attributes:
        name: Key in the document and word in the table.
        label: What it is, for people.
        open: Sets it up for a case and a number of ticks.
        episodes: Episodes that one run steps at once.
        compiled: Whether the loop is native code; others get fewer ticks.
        needs: Extra of this package that it needs, or None.
    """

    name: str
    label: str
    open: Callable[[Case, int], Session]
    episodes: int = 1
    compiled: bool = True
    needs: str | None = None
