"""The state machine of one leg, or of the supervisor, on the `transitions` library.

`transitions` carries the states, the triggers and their introspection; which transition is due is
decided by the one evaluator in :mod:`twin_gait.core.guards`. Time is the tick count handed in.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

from transitions import Machine

from twin_gait.core.guards import NO_TRANSITION, GuardProgram, next_transition
from twin_gait.exceptions import MeasurementError
from twin_gait.gait.guards import LEG_WORDS
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import DEVICE_SIGNALS, OTHER, TIME, LegSignals, values_of_leg
from twin_gait.gait.table import TICK, StateTable
from twin_gait.vocabulary import Side

POSTURE = "posture"  # cause of a switch that an operating mode asks for; it is no transition of the table


class PhaseSwitch(NamedTuple):
    """One switch of phase."""

    tick: int  # tick at which the new phase begins
    side: Side  # leg
    source: str  # phase that was left
    target: str  # phase that was entered
    cause: str  # cause written in the gait table
    transition: int  # index of the transition in the table, -1 for a posture

    @property
    def time(self) -> float:
        """Time of the switch in [s]."""
        return self.tick * TICK


class GaitStateMachine:
    """Phase of one leg, advanced tick by tick.

    Attributes:
        table: The gait table.
        side: The leg.
        owner: What messages call it.
        program: The table's compiled guards.
        entry_tick: Tick at which the present phase was entered.
        choose: What takes the place of :func:`~twin_gait.core.guards.next_transition`, if anything.
    """

    choose: Callable[..., int] | None = None

    def __init__(
        self,
        table: StateTable,
        side: Side = Side.LEFT,
        *,
        initial_phase: str | None = None,
        program: GuardProgram | None = None,
    ) -> None:
        """Begin in a phase, the first of the table if None; legs may share a compiled ``program``.

        The side has no meaning for a table of modes.
        """
        self.table = table
        self.side = side
        self.owner = f"{side} leg" if table.words is LEG_WORDS else "supervisor"
        self.program = compile_guards(table) if program is None else program
        self.entry_tick = 0
        self._debounce = [0] * len(table.transitions)
        self._names = table.signals
        self._own_places = [place for place, name in enumerate(self._names) if not name.startswith(OTHER)]
        self.phase: str = table.phase_names[0] if initial_phase is None else initial_phase
        self._index = table.phase_index(self.phase)

    @cached_property
    def machine(self) -> Machine:
        """States and triggers in `transitions`; made at the first switch: it takes as long as 15 ticks."""
        return Machine(
            model=self,
            states=list(self.table.phase_names),
            initial=self.phase,
            transitions=[
                {"trigger": f"take_{index}", "source": item.source, "dest": item.target}
                for index, item in enumerate(self.table.transitions)
            ],
            auto_transitions=False,
            model_attribute="phase",
        )

    @property
    def phase_index(self) -> int:
        """Index of the present phase."""
        return self._index

    def time_in_phase(self, tick: int) -> float:
        """Time since the present phase was entered, in [s]."""
        return (tick - self.entry_tick) * TICK

    def step(
        self,
        tick: int,
        own: LegSignals,
        other: LegSignals | None = None,
        other_phase: str | None = None,
        other_time_in_phase: float = 0.0,
    ) -> PhaseSwitch | None:
        """Advance by one tick on named signals.

        ``tick``: present tick. ``own``: measurements of this leg. ``other``: measurements of the other leg,
        or None for a one-legged bench. ``other_phase``: phase of the other leg at the start of the tick, or
        None. ``other_time_in_phase``: time since the other leg entered its phase in [s]. Returns the switch,
        or None if the leg stays. Raises MeasurementError if a measurement is missing or not finite.
        """
        signals = signal_list(self.table, self.time_in_phase(tick), own, other, other_time_in_phase)
        other_index = -1 if other_phase is None else self.table.phase_index(other_phase)
        return self.advance(tick, signals, other_index)

    def take(self, tick: int, signals: Mapping[str, float], member: str | None = None) -> PhaseSwitch | None:
        """Advance by one tick on signals by their names.

        ``tick``: present tick. ``signals``: in the units of their names; what is missing is 0, the time in
        the phase is counted. ``member``: phase of the other leg, or of the supervisor the request that is
        made, or None. Returns the switch, or None if the phase stays. Raises MeasurementError if a signal is
        not finite.
        """
        values = self.table.in_si({**signals, TIME: self.time_in_phase(tick)})
        return self.advance(tick, values, self.table.member_index(member))

    def advance(self, tick: int, signals: Sequence[float], other_phase: int) -> PhaseSwitch | None:
        """Advance by one tick on a list of signals.

        ``signals``: this leg's signals, the other's, then the device's, in the order of
        :func:`twin_gait.gait.signals.all_signal_names`, SI units; NaN marks the signals of a leg that is not
        there. A list is read faster than a NumPy array. ``other_phase``: index of the other leg's phase at
        the start of the tick, -1 without one. Returns the switch, or None if the leg stays. Raises
        MeasurementError if a signal of this leg, of a present other leg, or of the device is not finite.
        """
        self._refuse_non_finite(signals, other_phase)
        choose, ticks = self.choose or next_transition, tick - self.entry_tick
        index = choose(self.program, self._index, ticks, signals, other_phase, self._debounce)
        if index == NO_TRANSITION:
            return None
        source = self.phase
        self.machine.events[f"take_{index}"].trigger(self)
        self._index = self.table.phase_index(self.phase)
        self.entry_tick = tick
        item = self.table.transitions[index]
        return PhaseSwitch(tick, self.side, source, self.phase, item.cause, index)

    def enter(self, phase: str, tick: int) -> None:
        """Be in a phase from a tick on, whatever the table says: it is entered from outside."""
        self.phase, self._index, self.entry_tick = phase, self.table.phase_index(phase), tick
        self._debounce[:] = [0] * len(self._debounce)

    def _refuse_non_finite(self, signals: Sequence[float], other_phase: int) -> None:
        names = self._names
        if len(signals) != len(names):
            raise MeasurementError(f"{self.owner}: expected {len(names)} signals, got {len(signals)}")
        places = self._own_places if other_phase < 0 else range(len(names))
        broken = [place for place in places if not math.isfinite(signals[place])]
        if broken:
            name = names[broken[0]].replace(OTHER, "other leg's ")
            raise MeasurementError(
                f"{self.owner}: the {name} is {signals[broken[0]]}; expected a finite measurement"
            )


def signal_list(
    table: StateTable,
    time_in_phase: float,
    own: LegSignals,
    other: LegSignals | None,
    other_time_in_phase: float = 0.0,
) -> list[float]:
    """Signals of both legs and the device as the guard program reads them; NaN for an absent other leg.

    Times in a phase are in [s]. Raises MeasurementError if the number of joints is not that of the table.
    """
    for leg in (own,) if other is None else (own, other):
        if len(leg.angles) != len(table.joints) or len(leg.velocities) != len(table.joints):
            raise MeasurementError(
                f"expected an angle and a velocity for each of {', '.join(table.joints)}, "
                f"got {len(leg.angles)} angles and {len(leg.velocities)} velocities"
            )
    first = values_of_leg(own, time_in_phase)
    second = [math.nan] * len(first) if other is None else values_of_leg(other, other_time_in_phase)
    return [*first, *second, *(getattr(own, signal.field) for signal in DEVICE_SIGNALS)]
