"""An approved text of a gait table: whoever edits the table sees in a diff what has changed.

The tests of the kit follow the table, so they cannot notice that the table itself was edited; this text,
kept in git and approved by a person, can.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path

from twin_gait.exceptions import ParameterFileError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters
from twin_gait.testing.truth_table import PhaseTruth, truth_table

_DEGREES = 180.0 / math.pi
_TRUTH = {True: "yes", False: "no", None: "–"}


def approval_text(table: GaitTable) -> str:
    """Write everything that a gait table says as Markdown.

    Args:
        table: The gait table.

    Returns:
        Laws, parameters of the phases, transitions in their order of priority, truth table of each phase;
        the same text for the same table.
    """
    lines = [
        f"# Gait table {table.name}",
        "",
        f"- joints: {', '.join(table.joints)}",
        f"- blending: {table.blending.law}, {table.blending.duration_ticks} ms",
        *_scaling(table),
        "",
        "## Phases",
        "",
        *_phases(table.phases),
    ]
    for side, phases in table.side_phases.items():
        lines += ["", f"## Differences of the {side} side", "", *_phases(phases)]
    lines += ["", "## Transitions in their order of priority", "", *_transitions(table)]
    for phase in truth_table(table).phases:
        lines += ["", f"## Truth table of {phase.phase}", "", *_truths(table, phase)]
    return "\n".join(lines) + "\n"


def check_approved(path: Path, present: str) -> str | None:
    """Compare a text with the one that was approved.

    Args:
        path: File with the approved text.
        present: The text of the table as it is.

    Returns:
        None if they are the same, else what is wrong: a unified diff, or that there is no such file.

    Raises:
        ParameterFileError: If the file cannot be read.
    """
    if not path.exists():
        return f"{path}: there is no approved text yet"
    try:
        approved = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterFileError(path, "", f"cannot be read as text ({error})") from error
    lines = difflib.unified_diff(
        approved.splitlines(), present.splitlines(), fromfile=str(path), tofile="the table", lineterm=""
    )
    return "\n".join(lines) or None


def write_approved(path: Path, text: str) -> None:
    """Approve a text: write it, whole or not at all.

    Args:
        path: The file; its folder is made.
        text: The text.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(f"{path.parent}: cannot be made ({error.strerror})") from error
    write_atomically(path, text)


def _number(value: float) -> str:
    """Digits enough to see any edit, few enough to hide the rounding of a unit."""
    return f"{value + 0.0:.12g}"


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _grid(head: list[str], rows: Iterable[Iterable[str]]) -> list[str]:
    return [_row(head), "|" + "---|" * len(head), *(_row(row) for row in rows)]


def _scaling(table: GaitTable) -> list[str]:
    law = table.scaling
    lines = []
    if law.carried_mass is not None:
        phases = ", ".join(law.stance_phases)
        power = "" if law.carried_mass_exponent == 1.0 else f", exponent {_number(law.carried_mass_exponent)}"
        lines.append(
            f"- stance stiffness follows the load: {_number(law.carried_mass)} kg{power}, in {phases}"
        )
    for quantity, reference, unit, exponent in (
        ("speed", law.speed, "m/s", law.speed_exponent),
        ("height", law.height, "m", law.height_exponent),
    ):
        if reference is not None:
            lines.append(
                f"- hip excursion follows the {quantity}: {_number(reference)} {unit}, exponent "
                f"{_number(exponent)}, about {_number(law.hip_centre * _DEGREES)}°"
            )
    return lines


def _phases(phases: Mapping[str, PhaseParameters]) -> list[str]:
    head = [
        "phase",
        "joint",
        "k [Nm/deg]",
        "damping",
        "θ0 [deg]",
        "G",
        "gravity share",
        "minimum duration [ms]",
    ]
    rows = [
        [phase, name, *_joint(joint), _number(values.gravity_compensation), str(values.minimum_ticks)]
        for phase, values in phases.items()
        for name, joint in values.joints.items()
    ]
    return _grid(head, rows)


def _joint(joint: JointImpedance) -> list[str]:
    damping = f"ζ = {_number(joint.damping_ratio or 0.0)}"
    if joint.damping is not None:
        damping = f"{_number(joint.damping)} Nms/rad"
    return [
        _number(joint.stiffness / _DEGREES),
        damping,
        _number(joint.equilibrium_angle * _DEGREES),
        _number(joint.friction_compensation_gain),
    ]


def _transitions(table: GaitTable) -> list[str]:
    head = ["#", "from", "to", "cause", "guard", "debounce [ms]", "after [ms]"]
    rows = [
        [
            str(index),
            item.source,
            item.target,
            item.cause,
            f"`{item.guard}`",
            str(item.debounce_ticks),
            "–" if item.time_out_ticks is None else str(item.time_out_ticks),
        ]
        for index, item in enumerate(table.transitions)
    ]
    return _grid(head, rows)


def _truths(table: GaitTable, phase: PhaseTruth) -> list[str]:
    head = [*(f"`{name}`" for name in phase.conditions), "the leg"]
    rows = []
    for row in phase.rows:
        goes = "stays"
        if row.transition is not None:
            goes = f"goes to {row.next_phase} ({table.transitions[row.transition].cause})"
        rows.append([*(_TRUTH[truth] for truth in row.truths), goes])
    return _grid(head, rows)
