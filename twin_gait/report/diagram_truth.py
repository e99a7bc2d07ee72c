"""Which transition a phase takes for every combination of truth of its conditions.

The conditions of a phase are the comparisons and memberships in the guards of its exits, and what is
counted in ticks: a minimum duration, a time-out, a debounce. Guards are not read a second time here: each
condition becomes a signal that is 0 or 1, and :func:`twin_gait.core.guards.next_transition` runs on the
compiled guards with these signals in place of the measured ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin_gait.core.guards import (
    DEBOUNCE_TICKS,
    END_NODE,
    FIRST_NODE,
    OP_COMPARE,
    OP_PHASE,
    TIME_OUT_TICKS,
    next_transition,
)
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import TICK, GaitTable

TIME = "time_in_phase_s"


@dataclass(frozen=True)
class Stay:
    """The leg has been in the phase for at least so many ticks."""

    ticks: int


@dataclass(frozen=True)
class Held:
    """The guard of a transition has been true on so many consecutive ticks."""

    transition: int
    ticks: int


Condition = Comparison | PhaseMembership | Stay | Held


class TruthRow(NamedTuple):
    """One row of a truth table.

    Attributes:
        truth: Truth by the index of the condition; the others may be either.
        transition: Index of the transition that is taken, or ``NO_TRANSITION``.
    """

    truth: Mapping[int, bool]
    transition: int


def leaves(guard: Guard) -> Iterator[Comparison | PhaseMembership]:
    """Comparisons and memberships of a guard, in the order in which they are compiled."""
    if isinstance(guard, (AllOf, AnyOf)):
        for inner in guard.guards:
            yield from leaves(inner)
    else:
        yield guard


class PhaseLogic:
    """The exits of one phase as a function of the truth of their conditions.

    Attributes:
        phase: Name of the phase.
        exits: Indices of the transitions that leave it, in order of priority.
        needs: For each exit the conditions that it reads: minimum duration, guard, debounce, time-out.
        conditions: All of them in the order in which they appear.
    """

    def __init__(self, table: GaitTable, phase: str) -> None:
        """Compile the exits of a phase.

        Args:
            table: The gait table.
            phase: Name of the phase.

        Raises:
            GaitTableError: If there is no such phase.
        """
        self.phase = phase
        self.exits = [index for index, item in enumerate(table.transitions) if item.source == phase]
        self.needs = {index: _needs(table, phase, index) for index in self.exits}
        self.conditions = tuple(dict.fromkeys(item for index in self.exits for item in self.needs[index]))
        self._table = table
        self._index = table.phase_index(phase)
        self._program = compile_guards(table)
        self._nodes = self._nodes_on_conditions()
        count = len(self.conditions)
        self._comparisons = np.array([(k, 1.0, 0.0, 0.0, 0.5) for k in range(count)]).reshape(-1, 5)

    def _nodes_on_conditions(self) -> np.ndarray:
        """Guard program in which each comparison or membership asks for the truth of its condition."""
        nodes = self._program.nodes.copy()
        for index in self.exits:
            first, end = self._program.transitions[index, [FIRST_NODE, END_NODE]]
            places = [node for node in range(first, end) if nodes[node, 0] in (OP_COMPARE, OP_PHASE)]
            for place, leaf in zip(places, leaves(self._table.transitions[index].guard), strict=True):
                nodes[place] = OP_COMPARE, self.conditions.index(leaf)
        return nodes

    def outcome(self, truth: Sequence[bool]) -> int:
        """Transition that is taken.

        Args:
            truth: Of each condition.

        Returns:
            Index of the transition, or ``NO_TRANSITION``.
        """
        known = dict(zip(self.conditions, truth, strict=True))
        transitions = self._program.transitions.copy()
        for index in self.exits:
            item = self._table.transitions[index]
            # Counted ticks are conditions too: 0 elapsed ticks are enough, or 1 would be needed.
            held = known.get(Held(index, item.debounce_ticks), True)
            over = item.time_out_ticks is None or known[Stay(item.time_out_ticks)]
            transitions[index, DEBOUNCE_TICKS] = 1 if held else 2
            transitions[index, TIME_OUT_TICKS] = 0 if over else 1
        stayed = known.get(Stay(self._table.phases[self.phase].minimum_ticks), True)
        return next_transition(
            self._index,
            0,
            0 if stayed else 1,
            transitions,
            self._nodes,
            self._comparisons,
            np.array(truth, dtype=float),
            -1,
            np.zeros(len(transitions), dtype=np.int64),
        )

    def rows(self) -> list[TruthRow]:
        """Truth table with as few conditions in each row as decide it.

        Guards know no negation. So the transition is decided once it is the same with all open
        conditions false and with all of them true; otherwise the table branches on a condition of the
        first exit that may open. Combinations that no measurements can have are left out.

        Returns:
            Rows that exclude each other and cover every combination that measurements can have.
        """
        return self._rows({})

    def _rows(self, chosen: Mapping[int, bool]) -> list[TruthRow]:
        known = {**chosen, **self._implied(chosen)}
        count = range(len(self.conditions))
        lowest = self.outcome([known.get(k, False) for k in count])
        highest = self.outcome([known.get(k, True) for k in count])
        if lowest == highest:
            return [TruthRow(chosen, lowest)]
        needed = (self.conditions.index(item) for item in self.needs[highest])
        branch = next(k for k in needed if k not in known)
        true = self._rows({**chosen, branch: True})
        false = self._rows({**chosen, branch: False})
        merged = [_without(row, branch) for row in true]
        return merged if merged == [_without(row, branch) for row in false] else true + false

    def _implied(self, chosen: Mapping[int, bool]) -> dict[int, bool]:
        """Truth of further conditions that follows from the chosen ones."""
        implied = {}
        for k in range(len(self.conditions)):
            if k in chosen:
                continue
            possible = [value for value in (True, False) if self.possible({**chosen, k: value})]
            if len(possible) == 1:
                implied[k] = possible[0]
        return implied

    def possible(self, truth: Mapping[int, bool]) -> bool:
        """Whether conditions can have these truths together, judged signal by signal.

        Comparisons of the same signal, or of the difference of the same two, are held against each other,
        and so are memberships; how a difference follows from its two signals is not looked at.

        Args:
            truth: Truth by the index of the condition.

        Returns:
            False if it is impossible.
        """
        phases: set[str | None] = {None, *self._table.phase_names}
        lower: dict[tuple[str, str | None], tuple[float, bool]] = {(TIME, None): (0.0, False)}
        upper: dict[tuple[str, str | None], tuple[float, bool]] = {}
        for k, value in truth.items():
            condition = self.conditions[k]
            if isinstance(condition, PhaseMembership):
                phases = {name for name in phases if (name in condition.phases) is value}
            elif not isinstance(condition, Held):
                form, above, bound, strict = _bound(condition, value)
                if above:
                    lower[form] = max(lower.get(form, (-math.inf, False)), (bound, strict))
                else:
                    limit, closed = upper.get(form, (math.inf, True))
                    upper[form] = min((limit, closed), (bound, not strict))
        return bool(phases) and all(
            lower[form][0] < limit or (lower[form] == (limit, False) and closed)
            for form, (limit, closed) in upper.items()
            if form in lower
        )


def _needs(table: GaitTable, phase: str, index: int) -> list[Condition]:
    item = table.transitions[index]
    minimum = table.phases[phase].minimum_ticks
    needs: list[Condition] = [Stay(minimum)] if minimum > 0 else []
    needs += leaves(item.guard)
    if item.debounce_ticks > 1:
        needs.append(Held(index, item.debounce_ticks))
    if item.time_out_ticks is not None:
        needs.append(Stay(item.time_out_ticks))
    return needs


def _bound(condition: Comparison | Stay, value: bool) -> tuple[tuple[str, str | None], bool, float, bool]:
    """What a truth says of a signal: the signal, whether it is bounded below, by what, and strictly."""
    if isinstance(condition, Stay):
        return (TIME, None), value, condition.ticks * TICK, not value
    above = (condition.operator == ">") is value
    if condition.minus is not None and condition.minus < condition.signal:
        return (condition.minus, condition.signal), not above, -condition.threshold, value
    return (condition.signal, condition.minus), above, condition.threshold, value


def _without(row: TruthRow, condition: int) -> TruthRow:
    return TruthRow({k: value for k, value in row.truth.items() if k != condition}, row.transition)
