"""Whether a change of the live settings is safe, by the rules of ``twin-gait check``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from twin_gait.checking.check import build_case
from twin_gait.checking.finding import CheckCase, Finding, Rule, Severity, waive
from twin_gait.checking.leaving import cannot_leave
from twin_gait.checking.sense import (
    equilibrium_beyond_limits,
    unusual_damping_ratio,
    unusual_gain,
    unusual_stiffness,
)
from twin_gait.checking.stability import effective_damping, unstable
from twin_gait.checking.torques import stiffness_not_served, torque_jump
from twin_gait.live.settings import Mode, Settings

# Rules that k, b, θ0 and G can break, quick ones first; an error of one of them refuses a change. The phases
# of the monitor's controls are all alike: there is nothing to leave, and no switch to jump at.
GATE: tuple[Rule, ...] = (unstable, cannot_leave, torque_jump)
GATE_OF_MONITOR: tuple[Rule, ...] = (unstable,)
# What these find is told after a change has been applied.
TOLD: tuple[Rule, ...] = (
    equilibrium_beyond_limits, unusual_gain, unusual_stiffness, unusual_damping_ratio, effective_damping,
    stiffness_not_served,
)  # fmt: skip
TOLD_OF_MONITOR: tuple[Rule, ...] = (equilibrium_beyond_limits, unusual_gain, effective_damping)

Place = tuple[str, str | None, str | None, str | None]


class Checked(NamedTuple):
    """What the check says of some settings."""

    case: CheckCase  # what was checked
    errors: tuple[Finding, ...]  # findings that refuse them

    @property
    def places(self) -> frozenset[Place]:
        """Rule and place of every error."""
        return frozenset(place_of(item) for item in self.errors)


def check_settings(settings: Settings, known: frozenset[Place] = frozenset()) -> Checked:
    """Hold settings to the rules whose errors make them unsafe.

    ``known``: errors that are there already, and so are not the fault of a change. Returns the checked; it
    stops at the first rule with an error that is not known.
    """
    case = build_case(settings.driving.table, settings.driving)
    errors: list[Finding] = []
    for rule in GATE if settings.mode is Mode.WALK else GATE_OF_MONITOR:
        found = [item for item in rule(case) if item.severity is Severity.ERROR]
        errors += found
        if any(place_of(item) not in known for item in found):
            break
    return Checked(case, tuple(errors))


def refusal(checked: Checked, known: frozenset[Place]) -> str:
    """Why settings are refused, in one sentence; empty if they are not."""
    new = [item for item in checked.errors if place_of(item) not in known]
    return described(new[0], way_out=True) if new else ""


def warnings(settings: Settings) -> dict[Place, str]:
    """What the check warns of, where the table does not waive it."""
    case = build_case(settings.driving.table, settings.driving)
    found: list[Finding] = []
    for rule in TOLD if settings.mode is Mode.WALK else TOLD_OF_MONITOR:
        found += rule(case)
    return {place_of(item): described(item) for item in _live(case, found)}


def _live(case: CheckCase, found: Sequence[Finding]) -> list[Finding]:
    marked = waive(case.table, found)
    return [item for item in marked if item.severity is Severity.WARNING and not item.waived]


def place_of(finding: Finding) -> Place:
    """Rule, phase, transition and side that tell one finding from another."""
    side = None if finding.side is None else str(finding.side)
    return finding.rule, finding.phase, finding.transition, side


def described(finding: Finding, *, way_out: bool = False) -> str:
    """A finding in one sentence."""
    where = finding.transition or finding.phase or ""
    text = f"{finding.rule}{f' ({where})' if where else ''}: {finding.reason}"
    return f"{text}; {finding.suggestion}" if way_out else text
