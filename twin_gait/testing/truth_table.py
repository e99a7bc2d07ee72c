"""The truth table of a gait table: for each phase, which conditions make the leg leave it, and how.

Every row is one way through the conditions of a phase, read exit by exit in their order of priority;
a condition that cannot change the outcome any more is left open. The rows of a phase exclude each
other and together cover every combination. A row says which exit is due once its debounce and the least
stay in the phase are over.

The kit reads the guards here for itself, in three values, because what it expects of a machine must not
come from the evaluator that the machine runs on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from twin_gait.gait.guards import AllOf, AnyOf, Guard
from twin_gait.gait.table import TICK, GaitTable, Transition


@dataclass(frozen=True, kw_only=True)
class TruthRow:
    """One way through the conditions of a phase.

    Attributes:
        truths: Truth of each condition of the phase; None where it does not matter.
        transition: Index of the exit in the table, or None if the leg stays.
        next_phase: Phase that follows; the phase itself if the leg stays.
    """

    truths: tuple[bool | None, ...]
    transition: int | None
    next_phase: str


@dataclass(frozen=True, kw_only=True)
class PhaseTruth:
    """The rows of one phase.

    Attributes:
        phase: The phase.
        conditions: Texts of its conditions, each once, in the order in which they are listed.
        rows: All ways through them.
    """

    phase: str
    conditions: tuple[str, ...]
    rows: tuple[TruthRow, ...]


@dataclass(frozen=True, kw_only=True)
class TruthTable:
    """The truth tables of all phases.

    Attributes:
        name: Name of the gait table.
        phases: One entry per phase, in the order of the cycle.
    """

    name: str
    phases: tuple[PhaseTruth, ...]


def truth_table(table: GaitTable) -> TruthTable:
    """Write the transitions of a table as truth tables.

    Args:
        table: The gait table.

    Returns:
        The rows of every phase; the same for the same table, to be compared and kept.
    """
    return TruthTable(name=table.name, phases=tuple(_phase_truth(table, phase) for phase in table.phases))


def time_condition(ticks: int) -> str:
    """Name the condition that a time-out waits for.

    Args:
        ticks: Least time in the phase.

    Returns:
        For example ``after 1.2 s``.
    """
    return f"after {ticks * TICK:.12g} s"


def _phase_truth(table: GaitTable, phase: str) -> PhaseTruth:
    exits = {index: item for index, item in enumerate(table.transitions) if item.source == phase}
    names = tuple(dict.fromkeys(name for item in exits.values() for name in _conditions(item)))
    rows = tuple(
        TruthRow(
            truths=tuple(known.get(name) for name in names),
            transition=index,
            next_phase=phase if index is None else table.transitions[index].target,
        )
        for known, index in _ways(exits, {})
    )
    return PhaseTruth(phase=phase, conditions=names, rows=rows)


def _conditions(item: Transition) -> list[str]:
    time = [] if item.time_out_ticks is None else [time_condition(item.time_out_ticks)]
    return [*_atoms(item.guard), *time]


def _atoms(guard: Guard) -> list[str]:
    if isinstance(guard, (AllOf, AnyOf)):
        return [name for inner in guard.guards for name in _atoms(inner)]
    return [str(guard)]


def _ways(
    exits: Mapping[int, Transition], known: dict[str, bool]
) -> Iterator[tuple[dict[str, bool], int | None]]:
    """Branch on the first condition that is still open, true first."""
    for index, item in exits.items():
        truth = _due(item, known)
        if truth is True:
            yield known, index
            return
        if truth is None:
            name = next(name for name in _deciding(item, known))
            yield from _ways(exits, {**known, name: True})
            yield from _ways(exits, {**known, name: False})
            return
    yield known, None


def _deciding(item: Transition, known: Mapping[str, bool]) -> Iterator[str]:
    """Conditions of an exit that can still change its truth."""
    if _truth(item.guard, known) is None:
        yield from _undecided(item.guard, known)
    if item.time_out_ticks is not None:
        yield time_condition(item.time_out_ticks)


def _undecided(guard: Guard, known: Mapping[str, bool]) -> Iterator[str]:
    if not isinstance(guard, (AllOf, AnyOf)):
        yield str(guard)
        return
    for inner in guard.guards:
        if _truth(inner, known) is None:
            yield from _undecided(inner, known)


def _due(item: Transition, known: Mapping[str, bool]) -> bool | None:
    parts = [_truth(item.guard, known)]
    if item.time_out_ticks is not None:
        parts.append(known.get(time_condition(item.time_out_ticks)))
    return _all(parts)


def _truth(guard: Guard, known: Mapping[str, bool]) -> bool | None:
    """Truth of a guard in three values: None while it depends on conditions that are not known."""
    if isinstance(guard, AllOf):
        return _all([_truth(inner, known) for inner in guard.guards])
    if isinstance(guard, AnyOf):
        closed = _all([None if truth is None else not truth for truth in _truths(guard, known)])
        return None if closed is None else not closed
    return known.get(str(guard))


def _truths(guard: AnyOf, known: Mapping[str, bool]) -> list[bool | None]:
    return [_truth(inner, known) for inner in guard.guards]


def _all(truths: list[bool | None]) -> bool | None:
    if False in truths:
        return False
    return None if None in truths else True
