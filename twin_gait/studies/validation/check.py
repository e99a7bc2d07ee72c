"""A check of this package against an independent witness: what it is and how it is judged."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from twin_gait.exceptions import MissingOptionalDependency


class Finding(NamedTuple):
    """What a check found.

    Attributes:
        figure: The number to be judged, in the unit of its check; not finite if there is none.
        note: What was looked at, in a few words.
        sound: Whether everything that is no number is right too, such as equal phase switches.
    """

    figure: float
    note: str
    sound: bool = True


class Check(NamedTuple):
    """A judged check.

    Attributes:
        name: For ``--only``.
        witness: What the package was compared with.
        figure: What was found, or None if the check was skipped.
        unit: Of figure and tolerance; ``1`` for a ratio.
        tolerance: Largest figure that passes.
        passed: The verdict, or None if the check was skipped.
        note: What was looked at, or how to get a skipped check to run.
    """

    name: str
    witness: str
    figure: float | None
    unit: str
    tolerance: float
    passed: bool | None
    note: str


@dataclass(frozen=True, kw_only=True)
class CheckPlan:
    """A check before it is run.

    Attributes:
        name: For ``--only``.
        witness: What the package is compared with.
        unit: Of figure and tolerance; ``1`` for a ratio.
        tolerance: Largest figure that passes.
        find: Does the work.
    """

    name: str
    witness: str
    unit: str
    tolerance: float
    find: Callable[[], Finding]

    def run(self) -> Check:
        """Do the work and judge it.

        Returns:
            The judged check; skipped if it needs an optional package that is not there.
        """
        try:
            finding = self.find()
        except MissingOptionalDependency as missing:
            way_out = f"skipped: pip install 'twin-gait[{missing.extra}]'"
            return Check(self.name, self.witness, None, self.unit, self.tolerance, None, way_out)
        # A figure that is not a number is not within any tolerance.
        passed = finding.sound and math.isfinite(finding.figure) and finding.figure <= self.tolerance
        return Check(self.name, self.witness, finding.figure, self.unit, self.tolerance, passed, finding.note)
