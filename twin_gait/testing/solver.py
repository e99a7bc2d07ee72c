"""Measurements that open or close the guards of a table at once.

The tree of a guard leaves choices (which condition of an ``all`` is missing, which one of an ``any``
opens it); they are tried in turn, and each set of conditions is a system of bounds
(:mod:`twin_gait.testing.bounds`) with the allowed phases of the other leg.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from twin_gait.gait.guards import OTHER, WALK, AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.testing.bounds import ZERO, Bound, feasible, solve
from twin_gait.testing.witness import OTHER_TIME, OWN_TIME, Vector, holds, own_time

Phases = tuple[str | None, ...]

# Comfortable distance from a threshold, in the unit at the end of a signal's name.
_ROOM = {"angle_deg": 1.0, "velocity_deg_per_s": 5.0, "load_bw": 0.05, "time_in_phase_s": 0.01, WALK: 0.25}
_SHARES = (1.0, 1e-2, 1e-4, 0.0)  # of that distance, the largest that is possible is kept


class Wish(NamedTuple):
    """A guard and the truth that it shall have."""

    guard: Guard
    true: bool = True


@dataclass(frozen=True)
class Window:
    """Ticks in the phase over which wishes have to hold.

    Attributes:
        first: First tick.
        last: Last tick, or infinity.
        free: Whether one moment in between is enough, found by the solver, instead of all of them.
    """

    first: int
    last: float
    free: bool = False


def reads_own_time(atom: Comparison) -> bool:
    """Whether a comparison reads the time in the leg's own phase."""
    return OWN_TIME in (atom.signal, atom.minus)


def reads_only_own_time(atom: Comparison) -> bool:
    """Whether a comparison reads nothing else."""
    return {atom.signal, atom.minus} <= {OWN_TIME, None}


def find(
    phases: Phases, wishes: Sequence[Wish], window: Window, pinned: Sequence[Bound] = ()
) -> Vector | None:
    """Find measurements that fulfil all wishes over a window.

    Args:
        phases: Allowed phases of the other leg; ``(None,)`` for a leg without another.
        wishes: What has to be open or closed.
        window: Ticks in the phase.
        pinned: Bounds on the signals in addition.

    Returns:
        The measurements, as far from all other thresholds as can be; None if there are none.
    """
    if _first(phases, wishes, window, pinned, 0.0) is None:
        return None
    found = (_first(phases, wishes, window, pinned, share) for share in _SHARES)
    return next(item for item in found if item is not None)


def is_possible(phases: Phases, wishes: Sequence[Wish], window: Window) -> bool:
    """Whether any measurements fulfil all wishes, however narrow the room for them.

    Args:
        phases: Allowed phases of the other leg; ``(None,)`` for a leg without another.
        wishes: What has to be open or closed.
        window: Ticks in the phase.

    Returns:
        False if that is proved to be impossible.
    """
    return _state(phases, wishes, window, (), None) is not None


@dataclass(frozen=True)
class _State:
    phases: Phases
    bounds: tuple[Bound, ...]
    window: Window
    share: float | None  # None to ask only whether there is a solution

    def is_possible(self) -> bool:
        if self.share is None:
            return feasible(self.bounds)
        return solve(self.bounds, self.share) is not None

    def with_atom(self, atom: Comparison | PhaseMembership, true: bool) -> _State | None:
        if isinstance(atom, PhaseMembership):
            kept = tuple(name for name in self.phases if (name in atom.phases) is true)
            return replace(self, phases=kept) if kept else None
        if self.phases == (None,) and _reads_other(atom):
            return None if true else self
        if reads_only_own_time(atom) and not self.window.free:
            always = all(holds(atom, Vector({}, None), tick) is true for tick in self._ends())
            return self if always else None
        grown = replace(self, bounds=(*self.bounds, *self._bounds_of(atom, true)))
        return grown if grown.is_possible() else None

    def _ends(self) -> list[int]:
        return sorted({self.window.first, int(self.window.last)})

    def _bounds_of(self, atom: Comparison, true: bool) -> list[Bound]:
        if reads_own_time(atom) and not self.window.free:
            return [_bound(atom, true, own_time(tick)) for tick in self._ends()]
        return [_bound(atom, true, None)]


def _reads_other(atom: Comparison) -> bool:
    return any(name is not None and name.startswith(OTHER) for name in (atom.signal, atom.minus))


def _bound(atom: Comparison, true: bool, time: float | None) -> Bound:
    """A comparison as a bound, the own time replaced by its value if that is given."""
    shift = 0.0
    ends = []
    for name, sign in ((atom.signal, 1.0), (atom.minus, -1.0)):
        if name == OWN_TIME and time is not None:
            shift += sign * time
            name = ZERO
        ends.append(ZERO if name is None else name)
    signal, minus = ends
    limit = atom.threshold - shift
    room = _ROOM[atom.signal.rsplit(".", 1)[-1]]
    if (atom.operator == "<") is true:
        return Bound(signal, minus, limit, strict=true, room=room)
    return Bound(minus, signal, -limit, strict=true, room=room)


def _first(
    phases: Phases, wishes: Sequence[Wish], window: Window, pinned: Sequence[Bound], share: float
) -> Vector | None:
    state = _state(phases, wishes, window, pinned, share)
    if state is None:
        return None
    signals = solve(state.bounds, share)
    assert signals is not None  # every state of the search has a solution
    return Vector(signals, state.phases[0])


def _state(
    phases: Phases, wishes: Sequence[Wish], window: Window, pinned: Sequence[Bound], share: float | None
) -> _State | None:
    """First way to fulfil all wishes."""
    bounds = (*pinned, Bound(ZERO, OTHER_TIME, 0.0))
    if window.free:
        bounds = (*bounds, Bound(ZERO, OWN_TIME, -own_time(window.first)))
        bounds = (*bounds, Bound(OWN_TIME, ZERO, window.last * own_time(1)))
    start = _State(phases, bounds, window, share)
    return next(_branches(list(wishes), start), None) if start.is_possible() else None


def _branches(agenda: list[Wish], state: _State) -> Iterator[_State]:
    """All ways to fulfil an agenda, those without a choice first."""
    if not agenda:
        yield state
        return
    agenda = sorted(agenda, key=_is_choice)
    (guard, true), rest = agenda[0], agenda[1:]
    if isinstance(guard, (Comparison, PhaseMembership)):
        grown = state.with_atom(guard, true)
        if grown is not None:
            yield from _branches(rest, grown)
    elif _is_choice(agenda[0]):
        for inner in guard.guards:
            yield from _branches([Wish(inner, true), *rest], state)
    else:
        yield from _branches([*(Wish(inner, true) for inner in guard.guards), *rest], state)


def _is_choice(wish: Wish) -> bool:
    return (isinstance(wish.guard, AnyOf) and wish.true) or (isinstance(wish.guard, AllOf) and not wish.true)
