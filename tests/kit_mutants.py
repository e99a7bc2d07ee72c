"""Single mutations of a machine: tables that differ from the original in one property.

The kit reads the unchanged table, and the machine follows the mutant. A mutant that no test of the kit
detects must be proved equivalent (:mod:`kit_equivalence`).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.signals import OTHER, all_signal_names, signal_scale
from twin_gait.gait.table import MAX_TICKS, TICK, GaitTable, PhaseParameters, Transition
from twin_gait.testing.reference import exit_indices

SHIFT = 1e-6  # shift of a threshold, relative to it or to 1, in the unit of the table; one tick for a time
_UNIT = {"deg": 180.0 / math.pi, "bw": 100.0, "s": 1000.0}  # in rad, per cent, ms


@dataclass(frozen=True)
class Mutant:
    """Machine that differs from its table in one property.

    Attributes:
        kind: Kind of mutation.
        text: Description of the change.
        table: Table that the machine follows; it may be invalid in a file.
        phase: Phase whose exits were changed.
        transitions: Indices of the changed transitions; empty if the phase itself was changed.
    """

    kind: str
    text: str
    table: GaitTable
    phase: str
    transitions: tuple[int, ...] = ()


def mutants(table: GaitTable) -> Iterator[Mutant]:
    """Make every single mutation.

    Args:
        table: The gait table.

    Yields:
        Mutants, including those that are equal to the table (a list of one condition, zero in another
        unit).
    """
    for index, item in enumerate(table.transitions):
        title = f"{item.source}→{item.target} ({item.cause})"
        for kind, text, changed in _transition_mutants(table, item):
            yield Mutant(
                kind, f"{title}: {text}", _replace_transition(table, index, changed), item.source, (index,)
            )
        yield from _add_to_all_phases(table, index, title)
    yield from _orders(table)
    yield from _minimum_durations(table)


def unchecked(table: GaitTable, **changes: object) -> GaitTable:
    """Copy a table without its checks, because the table of a broken machine may be incomplete."""
    changed = copy.copy(table)
    for name, value in changes.items():
        object.__setattr__(changed, name, value)
    return changed


def _replace_transition(table: GaitTable, index: int, item: Transition) -> GaitTable:
    items = (*table.transitions[:index], item, *table.transitions[index + 1 :])
    return unchecked(table, transitions=items)


def _add_to_all_phases(table: GaitTable, index: int, title: str) -> Iterator[Mutant]:
    """Yield the mutants that have an exit in one more phase, below all others."""
    item = table.transitions[index]
    for phase in table.phase_names:
        if phase not in (item.source, item.target):
            items = (*table.transitions, replace(item, source=phase))
            changed = unchecked(table, transitions=items)
            yield Mutant("source", f"{title}: leaves {phase} too", changed, phase, (len(items) - 1,))


Changed = Iterator[tuple[str, str, Transition]]


def _transition_mutants(table: GaitTable, item: Transition) -> Changed:
    for kind, text, guard in _guard_mutants(table, item.guard):
        yield kind, text, replace(item, guard=guard)
    yield from _debounces(item)
    yield from _timeouts(item)
    for phase in table.phase_names:
        if phase not in (item.source, item.target):
            yield "source", f"leaves {phase}", replace(item, source=phase)
            yield "target", f"leads to {phase}", replace(item, target=phase)


def _debounces(item: Transition) -> Changed:
    for debounce in sorted({1, item.debounce_ticks - 1, item.debounce_ticks + 1} - {0, item.debounce_ticks}):
        yield "debounce", f"debounce of {debounce} ticks", replace(item, debounce_ticks=debounce)


def _timeouts(item: Transition) -> Changed:
    time = item.timeout_ticks
    if time is None:
        return
    changes = {"never": MAX_TICKS, "at once": 1, "one tick sooner": time - 1, "one tick later": time + 1}
    for text, ticks in changes.items():
        if 1 <= ticks <= MAX_TICKS and ticks != time:
            yield "timeout", text, replace(item, timeout_ticks=ticks)
    if time * 1000 <= MAX_TICKS:
        yield "unit", "timeout read in another unit", replace(item, timeout_ticks=time * 1000)


def _orders(table: GaitTable) -> Iterator[Mutant]:
    for phase in table.phase_names:
        leaving = exit_indices(table, phase)
        for index, first in enumerate(leaving):
            for second in leaving[index + 1 :]:
                items = list(table.transitions)
                items[first], items[second] = items[second], items[first]
                text = f"{phase}: {items[second].cause} and {items[first].cause} change places"
                changed = unchecked(table, transitions=tuple(items))
                yield Mutant("order", text, changed, phase, (first, second))


def _minimum_durations(table: GaitTable) -> Iterator[Mutant]:
    for phase, values in table.phases.items():
        least = values.minimum_ticks
        for ticks in sorted({0, least - 1, least + 1}) if least else ():
            phases: Mapping[str, PhaseParameters] = {
                **table.phases,
                phase: replace(values, minimum_ticks=ticks),
            }
            yield Mutant(
                "minimum duration", f"{phase}: {ticks} ticks", unchecked(table, phases=phases), phase
            )


Guards = Iterator[tuple[str, str, Guard]]


def _guard_mutants(table: GaitTable, guard: Guard) -> Guards:
    if isinstance(guard, Comparison):
        yield from _comparison_mutants(table, guard)
    elif isinstance(guard, PhaseMembership):
        yield from _membership_mutants(table, guard)
    else:
        yield from _list_mutants(guard)
        for index, inner in enumerate(guard.guards):
            for kind, text, changed in _guard_mutants(table, inner):
                items = (*guard.guards[:index], changed, *guard.guards[index + 1 :])
                yield kind, text, replace(guard, guards=items)


def _list_mutants(guard: AllOf | AnyOf) -> Guards:
    if not guard.guards:
        return
    text = f"[{', '.join(str(inner) for inner in guard.guards)}]"
    if isinstance(guard, AllOf):
        yield "all↔any", f"any of {text}", AnyOf(guards=guard.guards)
    else:
        yield "all↔any", f"all of {text}", AllOf(guards=guard.guards)
    for index, inner in enumerate(guard.guards):
        rest = guard.guards[:index] + guard.guards[index + 1 :]
        if rest:
            yield "condition", f"{inner} is dropped", replace(guard, guards=rest)


def _membership_mutants(table: GaitTable, guard: PhaseMembership) -> Guards:
    for phase in table.phase_names:
        members = tuple(name for name in guard.phases if name != phase)
        change = "without" if phase in guard.phases else "also in"
        changed = members if phase in guard.phases else (*guard.phases, phase)
        yield "membership", f"other leg {change} {phase}", PhaseMembership(phases=changed)


def _comparison_mutants(table: GaitTable, guard: Comparison) -> Guards:
    flipped = "<" if guard.operator == ">" else ">"
    yield "comparison", f"{guard} with {flipped}", replace(guard, operator=flipped)
    yield "comparison", f"{guard} not strict", replace(guard, threshold=_not_strict(guard))
    for shifted in _shifted(guard):
        yield "threshold", f"{guard} at {shifted!r}", replace(guard, threshold=shifted)
    if guard.signal not in ("walk", "step"):
        factor = _UNIT[guard.signal.rsplit("_", 1)[-1]]
        yield "unit", f"{guard} in another unit", replace(guard, threshold=guard.threshold * factor)
    for name in _confusable_signals(table, guard.signal):
        if name != guard.minus:
            yield "signal", f"{guard} reads {name} for {guard.signal}", replace(guard, signal=name)
    if guard.minus is not None:
        for name in _confusable_signals(table, guard.minus):
            if name != guard.signal:
                yield "signal", f"{guard} reads {name} for {guard.minus}", replace(guard, minus=name)
        turned = replace(guard, signal=guard.minus, minus=guard.signal)
        yield "signal", f"{guard} the other way round", turned
        yield "signal", f"{guard} without {guard.minus}", replace(guard, minus=None)


def _shifted(guard: Comparison) -> tuple[float, float]:
    step = TICK if guard.signal.endswith("time_in_phase_s") else SHIFT * max(1.0, abs(guard.threshold))
    return guard.threshold - step, guard.threshold + step


def _not_strict(guard: Comparison) -> float:
    """Return the next threshold for which the present threshold value passes the comparison."""
    outward = -math.inf if guard.operator == ">" else math.inf
    if guard.threshold == 0.0:
        return math.copysign(1e-300, outward)
    present, moved = guard.threshold * signal_scale(guard.signal), guard.threshold
    while moved * signal_scale(guard.signal) == present:
        moved = math.nextafter(moved, outward)
    return moved


def _confusable_signals(table: GaitTable, name: str) -> list[str]:
    """Return the signals that one mistake confuses with a signal: other leg, joint or quantity."""
    leg = OTHER if name.startswith(OTHER) else ""
    part, _, quantity = name.removeprefix(OTHER).rpartition(".")
    known = all_signal_names(table.joints)
    slips = [
        name.removeprefix(OTHER) if leg else OTHER + name,
        *(f"{leg}{joint}.{quantity}" for joint in table.joints),
        *(f"{leg}{part}.{other}" for other in ("angle_deg", "velocity_deg_per_s")),
    ]
    same = [item for item in dict.fromkeys(slips) if item in known and item != name]
    return [item for item in same if signal_scale(item) == signal_scale(name)]
