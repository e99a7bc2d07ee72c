"""Which transition a phase takes for every combination of truth of its conditions.

The conditions of a phase are the comparisons and memberships in the guards of its exits, and what is counted
in ticks: a minimum duration, a time-out, a debounce. Guards are read here in three values, true, false and
not yet known; the evaluator in :mod:`twin_gait.core.guards` is not asked, so that each can be tested against
the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from twin_gait.gait.feasibility import TIME, ZERO, Bound, atoms, bound_of, solve
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.table import TICK, GaitTable


class Stay(NamedTuple):
    """The leg has been in the phase for at least so many ticks."""

    ticks: int


class Held(NamedTuple):
    """The guard of a transition has been true on so many consecutive ticks."""

    transition: int
    held_ticks: int


Condition = Comparison | PhaseMembership | Stay | Held
Truths = Mapping[Condition, bool]  # of those conditions that are known


class TruthRow(NamedTuple):
    """One row of a truth table.

    Attributes:
        truths: Truth of the conditions that matter; the others may be either.
        transition: Index of the transition that is taken, or None.
    """

    truths: Truths
    transition: int | None


class PhaseLogic:
    """The exits of one phase as a function of the truth of their conditions.

    Attributes:
        phase: Name of the phase.
        needs: For each exit, by its index and in order of priority, the conditions that it reads: minimum
            duration, guard, debounce, time-out.
        conditions: All of them in the order in which they appear.
    """

    def __init__(self, table: GaitTable, phase: str) -> None:
        """Collect the conditions of a phase of a table."""
        self.phase = phase
        self._table = table
        self.needs = {
            index: _needs(table, index)
            for index, item in enumerate(table.transitions)
            if item.source == phase
        }
        self.conditions = tuple(dict.fromkeys(item for items in self.needs.values() for item in items))

    def outcome(self, known: Truths) -> tuple[int | None, bool]:
        """First exit that is not closed, or None, and whether it is known to be open."""
        for index, needs in self.needs.items():
            waits = [known.get(item) for item in needs if isinstance(item, (Stay, Held))]
            due = _every([*waits, _truth(self._table.transitions[index].guard, known)])
            if due is not False:
                return index, due is True
        return None, True

    def rows(self, chosen: Truths | None = None) -> list[TruthRow]:
        """Truth table with as few conditions in each row as decide it.

        It branches on a condition of the first exit that may open. Combinations that no measurements can
        have are left out.

        Args:
            chosen: Truths that all rows begin with.

        Returns:
            Rows that exclude each other and cover every combination that measurements can have.
        """
        chosen = chosen or {}
        known = {**chosen, **self._implied(chosen)}
        index, sure = self.outcome(known)
        if index is None or sure:
            return [TruthRow(chosen, index)]
        branch = next(item for item in self.needs[index] if item not in known)
        true, false = (self.rows({**chosen, branch: value}) for value in (True, False))
        merged = [_without(row, branch) for row in true]
        return merged if merged == [_without(row, branch) for row in false] else true + false

    def _implied(self, chosen: Truths) -> Truths:
        """Truth of further conditions that follows from the chosen ones."""
        values = {
            item: [value for value in (True, False) if self.possible({**chosen, item: value})]
            for item in self.conditions
            if item not in chosen
        }
        return {item: possible[0] for item, possible in values.items() if len(possible) == 1}

    def possible(self, truths: Truths) -> bool:
        """Whether conditions can have these truths together."""
        phases: set[str | None] = {None, *self._table.phase_names}
        bounds = [Bound(ZERO, TIME, 0.0)]
        for item, value in truths.items():
            if isinstance(item, PhaseMembership):
                phases = {name for name in phases if (name in item.phases) is value}
            elif isinstance(item, Comparison):
                bounds.append(bound_of(item, value))
            elif isinstance(item, Stay):
                time = item.ticks * TICK
                bounds.append(Bound(ZERO, TIME, -time) if value else Bound(TIME, ZERO, time, strict=True))
        return bool(phases) and solve(bounds) is not None


def _needs(table: GaitTable, index: int) -> list[Condition]:
    item = table.transitions[index]
    minimum = table.phases[item.source].minimum_ticks
    needs: list[Condition] = [Stay(minimum)] if minimum > 0 else []
    needs += atoms(item.guard)
    if item.debounce_ticks > 1:
        needs.append(Held(index, item.debounce_ticks))
    if item.time_out_ticks is not None:
        needs.append(Stay(item.time_out_ticks))
    return needs


def _truth(guard: Guard, known: Truths) -> bool | None:
    """Truth of a guard; None while it depends on conditions that are not known."""
    if isinstance(guard, AllOf):
        return _every(_truth(inner, known) for inner in guard.guards)
    if isinstance(guard, AnyOf):
        closed = _every(_negated(_truth(inner, known)) for inner in guard.guards)
        return _negated(closed)
    return known.get(guard)


def _every(truths: Iterable[bool | None]) -> bool | None:
    found = list(truths)
    return False if False in found else None if None in found else True


def _negated(truth: bool | None) -> bool | None:
    return None if truth is None else not truth


def _without(row: TruthRow, condition: Condition) -> TruthRow:
    return TruthRow({item: value for item, value in row.truths.items() if item != condition}, row.transition)
