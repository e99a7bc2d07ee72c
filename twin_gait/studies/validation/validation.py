"""The witnesses of this package, for users: what it is checked against, and the verdicts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from twin_gait.exceptions import ParameterError
from twin_gait.runs.summary.summary import versions
from twin_gait.studies.validation.check import Check, CheckPlan
from twin_gait.studies.validation.dynamics import DYNAMICS_CHECKS
from twin_gait.studies.validation.laws import LAW_CHECKS
from twin_gait.studies.validation.runs import RUN_CHECKS

CHECKS: tuple[CheckPlan, ...] = (*DYNAMICS_CHECKS, *LAW_CHECKS, *RUN_CHECKS)
COLUMNS = ("check", "witness", "figure", "tolerance", "verdict", "")


def chosen_checks(names: Sequence[str] = ()) -> list[CheckPlan]:
    """Checks by name.

    Args:
        names: Names; none for all checks.

    Returns:
        The checks in their own order.

    Raises:
        ParameterError: If there is no check of that name.
    """
    known = [plan.name for plan in CHECKS]
    for name in names:
        if name not in known:
            raise ParameterError(f"no check {name!r}; there are {', '.join(known)}")
    return [plan for plan in CHECKS if not names or plan.name in names]


def validate(
    plans: Sequence[CheckPlan] = CHECKS, *, progress: Callable[[int, int], None] | None = None
) -> list[Check]:
    """Run checks.

    Args:
        plans: The checks.
        progress: Called with checks done and in all.

    Returns:
        Their verdicts in the same order.
    """
    done: list[Check] = []
    for plan in plans:
        if progress is not None:
            progress(len(done), len(plans))
        done.append(plan.run())
    if progress is not None:
        progress(len(done), len(plans))
    return done


def all_passed(checks: Sequence[Check]) -> bool:
    """Whether no check failed; a skipped one has not."""
    return all(check.passed is not False for check in checks)


def draw_checks(checks: Sequence[Check]) -> str:
    """Draw checks as an aligned table with a last line that sums up.

    Args:
        checks: From :func:`validate`.

    Returns:
        The text.
    """
    rows = [COLUMNS, *(_cells(check) for check in checks)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    return "\n".join([*lines, _total(checks)])


def _cells(check: Check) -> tuple[str, ...]:
    unit = "" if check.unit == "1" else f" {check.unit}"
    figure = "-" if check.figure is None else f"{_short(check.figure)}{unit}"
    return (
        check.name,
        check.witness,
        figure,
        f"{_short(check.tolerance)}{unit}",
        _verdict(check),
        check.note,
    )


def _short(number: float) -> str:
    return f"{number:.1e}" if number else "0"


def _verdict(check: Check) -> str:
    return {None: "-", True: "passed", False: "FAILED"}[check.passed]


def _total(checks: Sequence[Check]) -> str:
    failed = sum(check.passed is False for check in checks)
    skipped = sum(check.passed is None for check in checks)
    parts = [f"{len(checks) - failed - skipped} passed", f"{failed} failed"]
    return ", ".join([*parts, f"{skipped} skipped"] if skipped else parts)


def checks_document(checks: Sequence[Check]) -> dict[str, Any]:
    """Checks as a mapping for JSON.

    Args:
        checks: From :func:`validate`.

    Returns:
        Versions, verdict and every check; a figure that is skipped or not a number is None.
    """
    return {
        "versions": versions(),
        "passed": all_passed(checks),
        "checks": [{**check._asdict(), "figure": _plain(check.figure)} for check in checks],
    }


def _plain(figure: float | None) -> float | None:
    return figure if figure is not None and math.isfinite(figure) else None
