"""Warnings that a table lives with, by its own word."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from twin_gait.checking.finding import Finding, Severity, Subject, label
from twin_gait.gait.table import GaitTable, Waiver


def unknown_rule(subject: Subject, rules: Collection[str]) -> list[Finding]:
    """The table waives a rule that does not exist.

    Args:
        subject: What is checked.
        rules: Ids of all rules.

    Returns:
        A finding for each such waiver.
    """
    return [
        Finding(
            rule="unknown_rule",
            severity=Severity.ERROR,
            reason=f"the table waives {waiver.rule!r}, which is no rule",
            suggestion="correct the id under waive; twin-gait check --rules lists them",
        )
        for waiver in subject.table.waivers
        if waiver.rule not in rules
    ]


def unused_waiver(subject: Subject, findings: Sequence[Finding], rules: Collection[str]) -> list[Finding]:
    """The table waives something that is not found, or that cannot be waived.

    Args:
        subject: What is checked.
        findings: What the other rules found.
        rules: Ids of all rules; a waiver of another is :func:`unknown_rule`.

    Returns:
        A finding for each such waiver.
    """
    result = []
    for waiver in subject.table.waivers:
        matching = [item for item in findings if _matches(subject.table, waiver, item)]
        if waiver.rule not in rules or any(item.severity is Severity.WARNING for item in matching):
            continue
        why = "nothing that it matches was found"
        if matching:
            why = f"only warnings can be waived, and it matches {matching[0].severity}s"
        result.append(
            Finding(
                rule="unused_waiver",
                severity=Severity.NOTE,
                phase=waiver.phase,
                reason=f"the waiver of {waiver.rule} has no effect: {why}",
                suggestion="take it out of the table, or correct its phase or transition",
            )
        )
    return result


def waive(table: GaitTable, findings: Sequence[Finding]) -> list[Finding]:
    """Mark the warnings that the table waives with its reason; errors and notes stay as they are."""
    result = []
    for finding in findings:
        reasons = [item.reason for item in table.waivers if _matches(table, item, finding)]
        if reasons and finding.severity is Severity.WARNING:
            result.append(replace(finding, waived=reasons[0]))
        else:
            result.append(finding)
    return result


def _matches(table: GaitTable, waiver: Waiver, finding: Finding) -> bool:
    names = {label(item) for item in table.transitions if item.cause == waiver.transition}
    return (
        waiver.rule == finding.rule
        and waiver.phase in (None, finding.phase)
        and (waiver.transition is None or finding.transition in names)
    )
