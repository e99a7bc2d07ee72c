"""What a check finds, what it looks at, and warnings that a table lives with.

A rule is a function under :func:`rule` that takes a :class:`CheckCase` and gives its findings, one for each
place. Its name is the id of all its findings, the first line of its docstring says what is found, and its
module lists it in ``RULES``.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, lru_cache, wraps
from typing import Any

from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable, StateTable, Transition
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.vocabulary import Side


class Severity(StrEnum):
    """How bad a finding is. Errors fail the check, warnings can be waived, notes only inform."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class Finding:
    """One finding of a check."""

    severity: Severity  # how bad it is
    reason: str  # what is wrong, in one sentence with numbers and units
    suggestion: str  # the way out, in one sentence
    phase: str | None = None  # phase it is about, if any
    transition: str | None = None  # transition it is about, as ``source → target (cause)``, if any
    side: Side | None = None  # leg it is about where the sides differ
    # signals by name in the units of the table that show it, if there is such a point
    counterexample: Mapping[str, float | str] = field(default_factory=dict)
    waived: str = ""  # reason that the table gives for living with it; empty if it does not
    rule: str = ""  # id of the rule, for example ``ambiguity``


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckCase:
    """What is checked: a table and the leg, motor and wearer that it drives."""

    table: StateTable  # the gait table, scaled to the experiment where there is one, or a table of modes
    experiment: Experiment | None  # what the table drives; None if it has joints that no leg model here has
    # lowest and highest angle in [rad] of each joint of the table, and of what else has signals
    limits: Mapping[str, tuple[float, float]]
    # highest speed of each joint of the table in [rad] / [s]
    velocity_limits: Mapping[str, float] = field(default_factory=dict)
    first_phases: tuple[str, ...] = ()  # in which the legs start, leg by leg; nothing without an experiment
    known_problem: Problem | None = None  # the experiment as an engine needs it, if it was set up before

    @cached_property
    def problem(self) -> Problem:
        """The experiment as an engine needs it."""
        assert self.experiment is not None  # a table by itself has none
        return self.known_problem or build_problem(self.experiment)

    @property
    def gait(self) -> GaitTable:
        """The table, for rules about legs."""
        assert isinstance(self.table, GaitTable)  # modes are checked by rules of their own
        return self.table

    @property
    def has_other_leg(self) -> bool:
        """Whether the table drives two legs, so that guards may read the other one."""
        return self.experiment is None or len(self.experiment.leg.legs) == 2


Rule = Callable[[CheckCase], list[Finding]]
once = lru_cache(maxsize=4)  # works something out once for all rules of a case, which follow each other


def rule(find: Callable[[CheckCase], Iterator[Finding]]) -> Rule:
    """Make a rule of a function, whose name its findings bear."""

    @wraps(find)
    def found(case: CheckCase) -> list[Finding]:
        return [replace(finding, rule=find.__name__) for finding in find(case)]

    return found


def label(transition: Transition) -> str:
    """How findings name a transition."""
    return f"{transition.source} → {transition.target} ({transition.cause})"


def about(item: Transition, severity: Severity, reason: str, suggestion: str, **more: Any) -> Finding:
    """A finding about a transition."""
    return Finding(severity, reason, suggestion, phase=item.source, transition=label(item), **more)


def invalid_waiver(case: CheckCase, rules: Collection[str]) -> Iterator[Finding]:
    """The table waives a rule or a phase that does not exist, or says no reason."""
    suggestion = "correct the entry under waive; twin-gait check --rules lists the rules"
    for waiver in case.table.waivers:
        known = waiver.rule in rules and waiver.phase in (None, *case.table.phases)
        if not known or not waiver.reason.strip():
            reason = f"{waiver.rule!r} of the phase {waiver.phase!r} because {waiver.reason!r} waives nothing"
            yield Finding(Severity.ERROR, reason, suggestion, rule="invalid_waiver")


def waive(table: StateTable, finding: Finding) -> Finding:
    """Mark a warning that the table waives with its reason; errors and notes stay as they are."""
    cause = {label(item): item.cause for item in table.transitions}.get(finding.transition or "")
    about = finding.rule, finding.phase, cause
    for item in table.waivers if finding.severity is Severity.WARNING else ():
        if (item.rule, item.phase or finding.phase, item.transition or cause) == about:
            return replace(finding, waived=item.reason)
    return finding
