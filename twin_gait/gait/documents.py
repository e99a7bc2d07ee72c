"""A gait table as Markdown: state-transition table and truth table.

A truth table lists the transition that is taken for every combination of truth values of the conditions of a
phase: the comparisons and memberships in the guards of its exits, and the conditions counted in ticks
(minimum duration, timeout, debounce). Guards are evaluated here in three values, true, false and not yet
known; the evaluator in :mod:`twin_gait.core.guards` is not used, so that each can be tested against the
other.
"""

import itertools
import string
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from twin_gait.gait.feasibility import ZERO, Bound, comparison_bound, solve
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership, atoms
from twin_gait.gait.signals import TIME
from twin_gait.gait.table import TICK, StateTable

# Limits beyond which a truth table is too long to be readable.
MOST_CONDITIONS, MOST_ROWS = 12, 64


class MinimumTime(NamedTuple):
    """Condition that the leg has been in the phase for at least so many ticks."""

    ticks: int


class Debounced(NamedTuple):
    """Condition that the guard of a transition has been true for so many consecutive ticks."""

    transition: int
    held_ticks: int


Condition = Comparison | PhaseMembership | MinimumTime | Debounced
Truths = Mapping[Condition, bool]  # Truth values of the conditions that are known.


class TruthRow(NamedTuple):
    """One row of a truth table."""

    truths: Truths  # Truth values of the conditions that matter; the others may be either.
    transition: int | None  # Index of the transition that is taken, or None.


class PhaseLogic:
    """The exits of one phase as a function of the truth values of their conditions.

    Attributes:
        phase: Name of the phase.
        exit_conditions: For each exit, by its index and in order of priority, the conditions that it reads:
            minimum duration, guard, debounce, timeout.
        conditions: All conditions in the order in which they appear.
    """

    def __init__(self, table: StateTable, phase: str) -> None:
        """Collect the conditions of a phase of a table."""
        self.phase = phase
        self._table = table
        self.exit_conditions = {
            index: _needs(table, index)
            for index, item in enumerate(table.transitions)
            if item.source == phase
        }
        self.conditions = tuple(
            dict.fromkeys(item for items in self.exit_conditions.values() for item in items)
        )

    def first_possible_exit(self, known: Truths) -> tuple[int | None, bool]:
        """Return the first exit that is not false, or None, and whether it is known to be true."""
        for index, needs in self.exit_conditions.items():
            waits = [known.get(item) for item in needs if isinstance(item, (MinimumTime, Debounced))]
            due = _joined([*waits, _truth(self._table.transitions[index].guard, known)], False)
            if due is not False:
                return index, due is True
        return None, True

    def rows(self, chosen: Truths | None = None) -> list[TruthRow]:
        """Compute the truth table with as few conditions in each row as determine its result.

        The method branches on a condition of the first exit that may be taken, and omits combinations that
        are impossible for measurements.

        Returns rows that exclude each other and cover every combination that measurements can have.
        """
        chosen = chosen or {}
        if not self.possible(chosen):
            return []
        index, sure = self.first_possible_exit(chosen)
        if index is None or sure:
            return [TruthRow(chosen, index)]
        branch = next(item for item in self.exit_conditions[index] if item not in chosen)
        true, false = (self.rows({**chosen, branch: value}) for value in (True, False))
        without = [[_without(row, branch) for row in rows] for rows in (true, false) if rows]
        return without[0] if without[0] == without[-1] else true + false

    def possible(self, truths: Truths) -> bool:
        """Check whether conditions can have these truth values together."""
        phases: set[str | None] = {None, *self._table.members}
        bounds = [Bound(ZERO, TIME, 0.0)]
        for item, value in truths.items():
            if isinstance(item, PhaseMembership):
                phases = {name for name in phases if (name in item.phases) is value}
            elif isinstance(item, Comparison):
                bounds.append(comparison_bound(item, value))
            elif isinstance(item, MinimumTime):
                time = item.ticks * TICK
                bounds.append(Bound(ZERO, TIME, -time) if value else Bound(TIME, ZERO, time, strict=True))
        return bool(phases) and solve(bounds) is not None


def _needs(table: StateTable, index: int) -> list[Condition]:
    item = table.transitions[index]
    minimum = table.phases[item.source].minimum_ticks
    needs: list[Condition] = [MinimumTime(minimum)] if minimum > 0 else []
    needs += atoms(item.guard)
    if item.debounce_ticks > 1:
        needs.append(Debounced(index, item.debounce_ticks))
    if item.timeout_ticks is not None:
        needs.append(MinimumTime(item.timeout_ticks))
    return needs


def _truth(guard: Guard, known: Truths) -> bool | None:
    """Evaluate a guard; None while it depends on conditions that are not known."""
    if isinstance(guard, (AllOf, AnyOf)):
        return _joined([_truth(inner, known) for inner in guard.guards], isinstance(guard, AnyOf))
    return known.get(guard)


def _joined(truths: Sequence[bool | None], decisive: bool) -> bool | None:
    """Combine truth values: one ``decisive`` value determines the result; None while it is undetermined."""
    if decisive in truths:
        return decisive
    return None if None in truths else not decisive


def _without(row: TruthRow, condition: Condition) -> TruthRow:
    return TruthRow({item: value for item, value in row.truths.items() if item != condition}, row.transition)


def format_number(value: float, digits: int = 10) -> str:
    """Format a number without noise in its last digits and with a true minus sign.

    Ten digits keep the digits of a file and remove those that a conversion of units adds.
    """
    return f"{value:.{digits}g}".replace("-", "−")


def transition_table(table: StateTable) -> str:
    """Format the state-transition table in Markdown.

    There is a row for each transition, and the exits of a phase are in order of priority.
    """

    def shown(value: float) -> str:
        return format_number(value) if value else ""

    rows = [
        (
            *(item.source, item.target, item.cause, "" if item.is_timeout else f"`{item.guard}`"),
            shown(item.debounce_ticks if item.debounce_ticks > 1 else 0),
            shown(table.phases[item.source].minimum_ticks),
            shown((item.timeout_ticks or 0) * TICK),
        )
        for item in sorted(table.transitions, key=lambda item: table.phase_index(item.source))
    ]
    heading = ("from", "to", "cause", "guard", "debounce [ms]", "minimum duration [ms]", "after [s]")
    title = f"# State transitions of {_text(table.name)}\n\n"
    return f"{title}If several exits are due, the first one in the list is taken.\n\n{_grid(heading, rows)}"


def truth_table(table: StateTable) -> str:
    """Format the truth table of every phase in Markdown."""
    parts = [
        f"# Truth tables of {_text(table.name)}\n",
        "T is true, F is false, – either. The rows of a phase exclude each other and cover every "
        "combination\nthat measurements can have.\n",
    ]
    for phase in table.phases:
        parts += [f"## {_text(phase)}\n", _exits(table, phase)]
    return "\n".join(parts)


def _exits(table: StateTable, phase: str) -> str:
    logic = PhaseLogic(table, phase)
    if not logic.exit_conditions:
        return "The phase is never left.\n"
    letters = (f"{letter}{turn or ''}" for turn in itertools.count() for letter in string.ascii_uppercase)
    names = dict(zip(logic.conditions, letters, strict=False))
    legend = [f"- {letter}: {_condition(table, item)}" for item, letter in names.items()]
    rows = logic.rows() if len(names) <= MOST_CONDITIONS else []
    body = "Too many combinations for a table; the first transition that is due is taken.\n"
    if 0 < len(rows) <= MOST_ROWS:
        marks = {True: "T", False: "F", None: "–"}
        results: dict[int | None, tuple[str, str]] = {None: ("stays", "")}
        results |= {index: (item.target, item.cause) for index, item in enumerate(table.transitions)}
        cells = [(*(marks[row.truths.get(item)] for item in names), *results[row.transition]) for row in rows]
        body = _grid((*names.values(), "next phase", "cause"), cells)
    return "\n".join(legend) + f"\n\n{body}"


def _condition(table: StateTable, condition: Condition) -> str:
    if isinstance(condition, MinimumTime):
        return f"in the phase for {format_number(condition.ticks * TICK)} s or longer"
    if isinstance(condition, Debounced):
        item = table.transitions[condition.transition]
        exit_ = f"{_text(item.cause)} to {_text(item.target)}"
        return f"guard of {exit_} true for {condition.held_ticks} ms without a break"
    return f"`{condition}`"


def _grid(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a Markdown table with an aligned source."""
    cells = [[_text(cell) for cell in row] for row in (heading, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(heading))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]]) + "\n"


def _text(cell: str) -> str:
    """Escape text so that it cannot end a table cell or a line, nor be HTML; names may come from a user."""
    line = " ".join(cell.split()).replace("|", "\\|")
    return line if line.startswith("`") else line.replace("<", "&lt;")
