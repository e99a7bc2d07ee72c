"""One exit of a phase among its rivals, and the measurements under which it decides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.table import TICK, GaitTable, Transition
from twin_gait.testing.bounds import Bound
from twin_gait.testing.solver import Window, Wish, find, reads_only_own_time
from twin_gait.testing.witness import Step, Vector, exits, holds, is_pure_time_out

Atom = Comparison | PhaseMembership

LONGEST_RUN = 20_000  # ticks; a longer debounce or time-out is not driven through tick by tick


@dataclass(frozen=True)
class Scenario:
    """Measurements tick by tick, and what the leg has to do.

    Attributes:
        what: What it shows, in words.
        phase: Phase that the leg has entered at tick 0.
        steps: The measurements.
        expected: For every step the index of the transition that is taken, or None.
    """

    what: str
    phase: str
    steps: tuple[Step, ...]
    expected: tuple[int | None, ...]


@dataclass(frozen=True)
class Decisive:
    """A condition of a guard, and what makes it alone decide.

    Attributes:
        atom: The condition.
        wishes: All other parts of the guard, as they have to be.
        group: The innermost list that holds it with others, or None.
    """

    atom: Atom
    wishes: tuple[Wish, ...] = ()
    group: AllOf | AnyOf | None = None


def decisive(guard: Guard) -> Iterator[Decisive]:
    """Every condition of a guard with the wishes under which it alone decides.

    Beside it, the others of an ``all`` are open and the others of an ``any`` closed, on every level.

    Args:
        guard: The guard.

    Yields:
        One entry per place in the tree.
    """
    if isinstance(guard, (Comparison, PhaseMembership)):
        yield Decisive(guard)
        return
    for place, inner in enumerate(guard.guards):
        beside = guard.guards[:place] + guard.guards[place + 1 :]
        wishes = tuple(Wish(other, isinstance(guard, AllOf)) for other in beside)
        for item in decisive(inner):
            group = item.group or (guard if beside else None)
            yield Decisive(item.atom, (*wishes, *item.wishes), group)


def latest_leave(table: GaitTable, phase: str) -> float:
    """Ticks after which a phase is left whatever is measured; infinite without a time-out."""
    items = [table.transitions[index] for index in exits(table, phase)]
    times = [max(item.time_out_ticks or 0, item.debounce_ticks) for item in items if is_pure_time_out(item)]
    return float(min(times)) if times else float("inf")


@dataclass(frozen=True)
class Exit:
    """A transition with what its phase says about it.

    Attributes:
        table: The gait table.
        index: Index of the transition.
    """

    table: GaitTable
    index: int

    @cached_property
    def item(self) -> Transition:
        """The transition."""
        return self.table.transitions[self.index]

    @property
    def phase(self) -> str:
        """Phase that it leaves."""
        return self.item.source

    @property
    def debounce(self) -> int:
        """Its debounce in ticks."""
        return self.item.debounce_ticks

    @property
    def minimum(self) -> int:
        """Minimum duration in the phase in ticks."""
        return self.table.phases[self.phase].minimum_ticks

    @property
    def gate(self) -> int:
        """First tick in the phase in which it may be taken, its debounce apart."""
        return max(1, self.minimum, self.item.time_out_ticks or 0)

    @cached_property
    def latest(self) -> float:
        """See :func:`latest_leave`."""
        return latest_leave(self.table, self.phase)

    @cached_property
    def rivals(self) -> tuple[Exit, ...]:
        """Exits of the same phase with a guard."""
        others = [Exit(self.table, index) for index in exits(self.table, self.phase) if index != self.index]
        return tuple(item for item in others if not is_pure_time_out(item.item))

    @cached_property
    def own_time_ticks(self) -> tuple[int, ...]:
        """Ticks about which a threshold on the time in the phase changes its truth."""
        guards = [self.item.guard, *(item.item.guard for item in self.rivals)]
        times = {
            round(entry.atom.threshold / TICK)
            for guard in guards
            for entry in decisive(guard)
            if isinstance(entry.atom, Comparison) and reads_only_own_time(entry.atom)
        }
        return tuple(sorted(times))

    def starts(self, ticks: int, *, gate: int | None = None) -> list[int]:
        """First ticks of windows worth trying.

        Args:
            ticks: Length of the window.
            gate: Earliest start; the exit's own gate if None.

        Returns:
            Ticks, so that the window ends before the phase is left anyway.
        """
        earliest = self.gate if gate is None else gate
        near = {time + shift for time in self.own_time_ticks for shift in range(-1, 3)}
        candidates = {earliest, *near, *(tick - ticks + 1 for tick in near)}
        return sorted(tick for tick in candidates if earliest <= tick and tick + ticks - 1 < self.latest)

    def closings(self, window: Window) -> list[tuple[Wish, ...]]:
        """Which rivals to close, in the order of preference: all, those that could be due, the earlier."""
        ticks = int(window.last) - window.first + 1
        able = [item for item in self.rivals if item.debounce <= ticks and item.gate <= window.last]
        earlier = [item for item in able if item.index < self.index]
        choices = [
            tuple(Wish(item.item.guard, False) for item in chosen) for chosen in (self.rivals, able, earlier)
        ]
        return list(dict.fromkeys(choices))

    def look(self, wishes: Sequence[Wish], window: Window, pinned: Sequence[Bound] = ()) -> Iterator[Vector]:
        """Measurements that fulfil the wishes, with ever fewer rivals closed; last without another leg."""
        for phases in (self.table.phase_names, (None,)):
            for closing in self.closings(window):
                found = find(phases, [*wishes, *closing], window, pinned)
                if found is not None:
                    yield found


def constant(vector: Vector, first: int, last: int) -> tuple[Step, ...]:
    """The same measurements from tick to tick, both ends included."""
    return tuple(Step(tick, vector) for tick in range(first, last + 1))


def turning_tick(atom: Comparison) -> int:
    """First tick at which a comparison of the own time alone has its later truth."""
    near = round(atom.threshold / TICK)
    start = max(0, near - 2)
    before = holds(atom, Vector({}, None), start)
    ticks = range(start, near + 4)
    return next((tick for tick in ticks if holds(atom, Vector({}, None), tick) is not before), start)
