"""Reference implementation of a gait table: expected transitions of a leg for a sequence of measurements.

It is a plain recursion over the guards and a plain count of ticks. It does not call the evaluator in
:mod:`twin_gait.core.guards`, because the kit compares the two.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from twin_gait.gait.guards import AllOf, AnyOf, Guard, PhaseMembership
from twin_gait.gait.signals import OTHER, TIME, signal_scale
from twin_gait.gait.table import TICK, StateTable


class Measurements(NamedTuple):
    """Measurements of both legs, without the own time in the phase."""

    signals: Mapping[str, float]  # value by name in the units of the table; irrelevant names are 0
    # phase of the other leg, or None without another leg; for modes the request, or None
    other_phase: str | None


class TickInput(NamedTuple):
    """Measurements of one tick."""

    tick: int
    vector: Measurements


TickInputs = tuple[TickInput, ...]


def holds(guard: Guard, vector: Measurements, ticks: int) -> bool:
    """Return whether a guard is open some ticks after the entry of the phase.

    A condition that reads another leg is closed if there is no other leg.
    """
    if isinstance(guard, AllOf):
        return all(holds(inner, vector, ticks) for inner in guard.guards)
    if isinstance(guard, AnyOf):
        return any(holds(inner, vector, ticks) for inner in guard.guards)
    if isinstance(guard, PhaseMembership):
        return vector.other_phase in guard.phases
    left = 0.0
    for name, sign in ((guard.signal, 1.0), (guard.minus, -1.0)):
        if name is None:
            continue
        if name.startswith(OTHER) and vector.other_phase is None:
            return False
        value = ticks * TICK if name == TIME else vector.signals.get(name, 0.0)
        left += sign * (value * signal_scale(name))
    threshold = guard.threshold * signal_scale(guard.signal)
    return left > threshold if guard.operator == ">" else left < threshold


def exit_indices(table: StateTable, phase: str) -> list[int]:
    """Return the indices of the transitions that leave a phase, in their order of priority."""
    return [index for index, item in enumerate(table.transitions) if item.source == phase]


def outcomes(table: StateTable, phase: str, steps: Sequence[TickInput]) -> list[int | None]:
    """Return the transition that a leg takes at each step, or None; the leg entered the phase at tick 0."""
    entry, open_ticks, taken = 0, dict[int, int](), list[int | None]()
    for tick, vector in steps:
        due = None
        for index in exit_indices(table, phase):
            item = table.transitions[index]
            is_open = holds(item.guard, vector, tick - entry)
            open_ticks[index] = open_ticks.get(index, 0) + 1 if is_open else 0
            least = max(table.phases[phase].minimum_ticks, item.timeout_ticks or 0)
            if due is None and open_ticks[index] >= item.debounce_ticks and tick - entry >= least:
                due = index
        if due is not None:
            phase, entry, open_ticks = table.transitions[due].target, tick, {}
        taken.append(due)
    return taken
