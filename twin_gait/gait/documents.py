"""A gait table as Markdown: state-transition table and truth table."""

from __future__ import annotations

import math
import string
from collections.abc import Iterable, Mapping, Sequence

from twin_gait.gait.guards import AllOf, AnyOf, Guard
from twin_gait.gait.table import TICK, Blending, GaitTable, JointImpedance, PhaseParameters, Scaling
from twin_gait.gait.truth_table import Condition, Held, PhaseLogic, Stay, TruthRow

# A truth table with more conditions or rows is not read by anyone: the exits are listed in order instead.
MOST_CONDITIONS, MOST_ROWS = 12, 64
_DEGREES = math.degrees(1.0)  # in a radian


def number(value: float, digits: int = 10) -> str:
    """Write a number without noise in its last digits and with a true minus sign.

    Ten digits keep what a file gives and drop what a conversion of units adds.
    """
    return f"{value:.{digits}g}".replace("-", "−")


def transition_table(table: GaitTable) -> str:
    """State-transition table: a row per transition, the exits of a phase in order of priority.

    Args:
        table: The gait table.

    Returns:
        Markdown, ending with a line break; guards as the file writes them.
    """
    rows = []
    for phase, parameters in table.phases.items():
        for item in (entry for entry in table.transitions if entry.source == phase):
            guard = "" if item.is_time_out else f"`{item.guard}`"
            stay, after = parameters.minimum_ticks, item.time_out_ticks
            debounce = "" if item.debounce_ticks == 1 else number(item.debounce_ticks)
            least = "" if stay == 0 else number(stay)
            time_out = "" if after is None else number(after * TICK)
            rows.append((phase, item.target, item.cause, guard, debounce, least, time_out))
    heading = ("from", "to", "cause", "guard", "debounce [ms]", "minimum duration [ms]", "after [s]")
    if not rows:
        rows = [(phase, "", "", "", "", "", "") for phase in table.phases]
    title = f"# State transitions of {_text(table.name)}\n\n"
    return f"{title}Of several exits that are due, the first listed is taken.\n\n{_grid(heading, rows)}"


def truth_table(table: GaitTable) -> str:
    """Truth table of every phase, with what the phase sets.

    Args:
        table: The gait table.

    Returns:
        Markdown, ending with a line break. It holds every number of the table that has an effect, to ten
        digits, and is the same for equal tables: a change of the table is a change of the text.
    """
    parts = [
        f"# Truth tables of {_text(table.name)}\n",
        "T is true, F is false, – either. The rows of a phase exclude each other and cover every "
        "combination\nthat measurements can have.\n",
        *_laws(table.blending, table.scaling),
    ]
    for phase in table.phases:
        parts += [f"## {_text(phase)}\n", _settings(table, phase), _exits(table, phase)]
    return "\n".join(parts)


def _exits(table: GaitTable, phase: str) -> str:
    logic = PhaseLogic(table, phase)
    if not logic.needs:
        return "The phase is never left.\n"
    names = dict(zip(logic.conditions, _letters(len(logic.conditions)), strict=True))
    legend = [f"- {letter}: {_condition(table, item)}" for item, letter in names.items()]
    rows = logic.rows() if len(names) <= MOST_CONDITIONS else []
    few = 0 < len(rows) <= MOST_ROWS
    body = _truth_grid(table, names, rows) if few else _priority_list(table, logic, names)
    return "\n".join(legend) + f"\n\n{body}"


def _truth_grid(table: GaitTable, names: Mapping[Condition, str], rows: Iterable[TruthRow]) -> str:
    marks = {True: "T", False: "F", None: "–"}
    cells = [
        (*(marks[row.truths.get(item)] for item in names), *_result(table, row.transition)) for row in rows
    ]
    return _grid((*names.values(), "next phase", "cause"), cells)


def _result(table: GaitTable, transition: int | None) -> tuple[str, str]:
    if transition is None:
        return "stays", ""
    item = table.transitions[transition]
    return item.target, item.cause


def _priority_list(table: GaitTable, logic: PhaseLogic, names: Mapping[Condition, str]) -> str:
    """The exits in order of priority, for a phase with too many conditions for a table."""
    rows = []
    for index, needs in logic.needs.items():
        item = table.transitions[index]
        parts = [names[need] for need in needs if isinstance(need, (Held, Stay))]
        parts += [] if item.is_time_out else [_formula(item.guard, names)]
        rows.append((" and ".join(parts), *_result(table, index)))
    grid = _grid(("condition", "next phase", "cause"), [*rows, ("otherwise", *_result(table, None))])
    return f"Too many combinations for a table; the first row that holds decides.\n\n{grid}"


def _formula(guard: Guard, names: Mapping[Condition, str]) -> str:
    if isinstance(guard, (AllOf, AnyOf)):
        joiner = " and " if isinstance(guard, AllOf) else " or "
        return f"({joiner.join(_formula(inner, names) for inner in guard.guards)})"
    return names[guard]


def _condition(table: GaitTable, condition: Condition) -> str:
    if isinstance(condition, Stay):
        return f"in the phase for {number(condition.ticks * TICK)} s or longer"
    if isinstance(condition, Held):
        item = table.transitions[condition.transition]
        exit_ = f"{_text(item.cause)} to {_text(item.target)}"
        return f"guard of {exit_} true for {condition.held_ticks} ms without a break"
    return f"`{condition}`"


def _letters(count: int) -> list[str]:
    """Letters of the alphabet, then A1, B1 and so on."""
    alphabet = string.ascii_uppercase
    turns = range(count // len(alphabet) + 1)
    return [f"{letter}{turn or ''}" for turn in turns for letter in alphabet][:count]


def _settings(table: GaitTable, phase: str) -> str:
    """What a phase sets, with the rows of a side where it differs."""
    common = table.phases[phase]
    rows = _impedance_rows(common, "")
    shares = [f"Gravity share {number(common.gravity_compensation)}"]
    for side, own in table.side_phases.items():
        if phase in own:
            rows += _impedance_rows(own[phase], f"{side} ")
            shares.append(f"{side} {number(own[phase].gravity_compensation)}")
    stay = f", minimum duration {common.minimum_ticks} ms"
    heading = ("joint", "k [Nm/°]", "θ0 [°]", "ζ", "b [Nms/rad]", "G")
    return f"{_grid(heading, rows)}\n{', '.join(shares)}{stay}.\n"


def _impedance_rows(phase: PhaseParameters, prefix: str) -> list[tuple[str, ...]]:
    return [(f"{prefix}{name}", *_impedance(joint)) for name, joint in phase.joints.items()]


def _impedance(joint: JointImpedance) -> tuple[str, ...]:
    optional = ["" if value is None else number(value) for value in (joint.damping_ratio, joint.damping)]
    return (
        number(joint.stiffness / _DEGREES),
        number(joint.equilibrium_angle * _DEGREES),
        *optional,
        number(joint.friction_compensation_gain),
    )


def _laws(blending: Blending, scaling: Scaling) -> list[str]:
    lines = [f"Blending at a switch: {blending.law}, {blending.duration_ticks} ms."]
    if scaling.carried_mass is not None:
        phases = ", ".join(_text(name) for name in scaling.stance_phases) or "no phase"
        exponent = scaling.carried_mass_exponent
        power = "" if exponent == 1.0 else f", exponent {number(exponent)}"
        lines.append(f"Stiffness of {phases} as for {number(scaling.carried_mass)} kg carried{power}.")
    centre = number(scaling.hip_centre * _DEGREES)
    for reference, unit, exponent in (
        (scaling.speed, "at {} m/s", scaling.speed_exponent),
        (scaling.height, "for {} m of height", scaling.height_exponent),
    ):
        if reference is not None:
            place = unit.format(number(reference))
            lines.append(f"Hip angles about {centre}° as {place}, exponent {number(exponent)}.")
    return [*lines[:-1], f"{lines[-1]}\n"]


def _grid(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose source is aligned too."""
    cells = [[_text(cell) for cell in row] for row in (heading, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(heading))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]]) + "\n"


def _text(cell: str) -> str:
    """Text that cannot end a table cell or a line, nor be HTML; names come from a user's file."""
    line = " ".join(cell.split()).replace("|", "\\|")
    return line if line.startswith("`") else line.replace("<", "&lt;")
