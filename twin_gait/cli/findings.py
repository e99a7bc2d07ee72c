"""Texts of the findings of a check."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin_gait.checking.finding import Finding


def heading(finding: Finding) -> str:
    """Return the severity and rule of a finding, and the transition or phase and the leg that it concerns."""
    parts = [str(part) for part in (finding.transition or finding.phase, finding.side) if part is not None]
    return f"{finding.severity} {finding.rule}" + (f": {' · '.join(parts)}" if parts else "")


def counted(numbers: Mapping[str, int]) -> str:
    """Return numbers of findings as text, such as "1 error, 2 warnings"; their keys are plural nouns."""
    words = (plural.removesuffix("s") if number == 1 else plural for plural, number in numbers.items())
    return ", ".join(f"{number} {word}" for number, word in zip(numbers.values(), words, strict=True))
