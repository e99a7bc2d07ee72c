"""What a check finds, and what it looks at.

A rule is a function that takes a :class:`Subject` and returns its findings. Its name is the id of all
its findings, the first line of its docstring says what is found, and its module lists it in ``RULES``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable, Transition
from twin_gait.vocabulary import Side


class Severity(StrEnum):
    """How bad a finding is. Errors fail the check, warnings can be waived, notes only inform."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding of a check.

    Attributes:
        rule: Id of the rule, for example ``ambiguity``.
        severity: How bad it is.
        reason: What is wrong, in one sentence with numbers and units.
        suggestion: The way out, in one sentence.
        phase: Phase it is about, if any.
        transition: Transition it is about, as ``source → target (cause)``, if any.
        side: Leg it is about where the sides differ.
        witness: Signals by name in the units of the table that show it, if there is such a point.
        waived: Reason that the table gives for living with it; empty if it does not.
    """

    rule: str
    severity: Severity
    reason: str
    suggestion: str
    phase: str | None = None
    transition: str | None = None
    side: Side | None = None
    witness: Mapping[str, float | str] = field(default_factory=dict)
    waived: str = ""


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What is checked: a table and the leg, motor and wearer that it drives.

    Attributes:
        table: The gait table, scaled to the experiment where there is one.
        experiment: What the table drives; None if it has joints that no leg model here has.
        limits: Lowest and highest angle of each joint of the table in [rad].
        velocity_limits: Highest speed of each joint of the table in [rad] / [s].
        shared: What one rule has worked out and another needs too.
    """

    table: GaitTable
    experiment: Experiment | None
    limits: Mapping[str, tuple[float, float]]
    velocity_limits: Mapping[str, float] = field(default_factory=dict)
    shared: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def has_other_leg(self) -> bool:
        """Whether the table drives two legs, so that guards may read the other one."""
        return self.experiment is None or len(self.experiment.leg.legs) == 2


def label(transition: Transition) -> str:
    """How findings name a transition."""
    return f"{transition.source} → {transition.target} ({transition.cause})"
