"""Findings of a check, the case that is checked, and warnings that a table waives.

A rule is a function decorated with :func:`rule` that takes a :class:`CheckCase` and yields its findings, one
for each occurrence. Its name is the id of all its findings, the first line of its docstring says which
mistake it finds, and its module lists it in ``RULES``.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, lru_cache, wraps
from typing import Any

from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import GaitTable, StateTable, Transition
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.vocabulary import Side


class Severity(StrEnum):
    """Severity of a finding: errors fail the check, warnings can be waived, notes only inform."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class Finding:
    """One finding of a check."""

    severity: Severity  # severity of the mistake
    reason: str  # description of the mistake in one sentence with numbers and units
    suggestion: str  # remedy in one sentence
    phase: str | None = None  # phase that the finding concerns, if any
    transition: str | None = None  # transition that it concerns, as ``source → target (cause)``, if any
    side: Side | None = None  # leg that it concerns, if the sides differ
    # signals by name, in the units of the table, at which the mistake occurs, if there is such a point
    counterexample: Mapping[str, float | str] = field(default_factory=dict)
    waived: str = ""  # reason for which the table waives the finding; empty if it does not
    rule: str = ""  # id of the rule, for example ``ambiguity``


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckCase:
    """Table to be checked, with the leg, motor and wearer that it drives."""

    table: StateTable  # the gait table, scaled to the experiment if there is one, or a table of modes
    experiment: Experiment | None  # experiment that the table drives; None if no leg model has its joints
    # lowest and highest angle in [rad] of each joint of the table and of the trunk
    limits: Mapping[str, tuple[float, float]]
    # highest speed of each joint of the table in [rad/s]
    velocity_limits: Mapping[str, float] = field(default_factory=dict)
    first_phases: tuple[str, ...] = ()  # phase in which each leg starts; empty without an experiment
    built_setup: SimulationSetup | None = None  # simulation setup of the experiment, if it was built before

    @cached_property
    def setup(self) -> SimulationSetup:
        """Simulation setup of the experiment."""
        assert self.experiment is not None  # a table without an experiment has no setup
        return self.built_setup or build_setup(self.experiment)

    @property
    def gait(self) -> GaitTable:
        """The gait table, for rules on legs."""
        assert isinstance(self.table, GaitTable)  # tables of modes have their own rules
        return self.table

    @property
    def has_other_leg(self) -> bool:
        """Whether the table drives two legs, so that guards may read the other one."""
        return self.experiment is None or len(self.experiment.sides) == 2


Rule = Callable[[CheckCase], list[Finding]]
once = lru_cache(maxsize=4)  # caches a result for all rules of a case, which run in succession


def rule(find: Callable[[CheckCase], Iterator[Finding]]) -> Rule:
    """Make a rule of a function; its findings carry the name of the function as their id."""

    @wraps(find)
    def found(case: CheckCase) -> list[Finding]:
        return [replace(finding, rule=find.__name__) for finding in find(case)]

    return found


def label(transition: Transition) -> str:
    """Return the name of a transition in findings."""
    return f"{transition.source} → {transition.target} ({transition.cause})"


def transition_finding(
    item: Transition, severity: Severity, reason: str, suggestion: str, **more: Any
) -> Finding:
    """Create a finding about a transition."""
    return Finding(severity, reason, suggestion, phase=item.source, transition=label(item), **more)


def invalid_waiver(case: CheckCase, rules: Collection[str]) -> Iterator[Finding]:
    """Find waivers of the table that name an unknown rule or phase, or give no reason."""
    suggestion = "correct the entry under waive; twin-gait check --rules lists the rules"
    for waiver in case.table.waivers:
        known = waiver.rule in rules and waiver.phase in (None, *case.table.phases)
        if not known or not waiver.reason.strip():
            reason = f"{waiver.rule!r} of the phase {waiver.phase!r} because {waiver.reason!r} has no effect"
            yield Finding(Severity.ERROR, reason, suggestion, rule="invalid_waiver")


def waive(table: StateTable, finding: Finding) -> Finding:
    """Mark a warning that the table waives with the reason; return errors and notes unchanged."""
    cause = {label(item): item.cause for item in table.transitions}.get(finding.transition or "")
    about = finding.rule, finding.phase, cause
    for item in table.waivers if finding.severity is Severity.WARNING else ():
        if (item.rule, item.phase or finding.phase, item.transition or cause) == about:
            return replace(finding, waived=item.reason)
    return finding
