"""The state machine of one leg, or of the supervisor, on the `transitions` library.

`transitions` provides the states, the triggers and their introspection; the one evaluator in
:mod:`twin_gait.core.guards` decides which transition is due. Time is the tick count that is passed in.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

from transitions import Machine

from twin_gait.core.guards import NO_TRANSITION, GuardProgram, next_transition
from twin_gait.exceptions import MeasurementError
from twin_gait.gait.guards import LEG_VOCABULARY
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import OTHER, TIME
from twin_gait.gait.table import TICK, StateTable
from twin_gait.vocabulary import Side

POSTURE = "posture"  # Cause of a switch that an operating mode requires; it is no transition of the table.


class PhaseSwitch(NamedTuple):
    """Record of one switch of phase."""

    tick: int  # Tick at which the new phase begins.
    side: Side  # Leg.
    source: str  # Phase that was left.
    target: str  # Phase that was entered.
    cause: str  # Cause given in the gait table.
    transition: int  # Index of the transition in the table, -1 for a posture.

    @property
    def time(self) -> float:
        """Time of the switch in [s]."""
        return self.tick * TICK


class GaitStateMachine:
    """Phase of one leg, advanced tick by tick.

    Attributes:
        table: The gait table.
        side: The leg.
        owner: Name of the leg or supervisor in messages.
        program: The table's compiled guards.
        phase: Present phase.
        phase_index: Index of the present phase.
        entry_tick: Tick at which the present phase was entered.
        transition_selector: Function that replaces :func:`~twin_gait.core.guards.next_transition`, or None.
    """

    transition_selector: Callable[..., int] | None = None

    def __init__(
        self,
        table: StateTable,
        side: Side = Side.LEFT,
        *,
        initial_phase: str | None = None,
        program: GuardProgram | None = None,
    ) -> None:
        """Start in a phase, the first of the table if None; legs may share a compiled ``program``.

        The side has no meaning for a table of modes.
        """
        self.table = table
        self.side = side
        self.owner = f"{side} leg" if table.vocabulary is LEG_VOCABULARY else "supervisor"
        self.program = compile_guards(table) if program is None else program
        self.entry_tick = 0
        self._debounce = [0] * len(table.transitions)
        self._names = table.signals
        self._own_indices = [index for index, name in enumerate(self._names) if not name.startswith(OTHER)]
        self.phase: str = table.phase_names[0] if initial_phase is None else initial_phase
        self.phase_index = table.phase_index(self.phase)

    @cached_property
    def machine(self) -> Machine:
        """States and triggers in `transitions`, created at the first switch.

        Their creation takes as long as 15 ticks.
        """
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

    def time_in_phase(self, tick: int) -> float:
        """Return the time since the present phase was entered, in [s]."""
        return (tick - self.entry_tick) * TICK

    def step(self, tick: int, signals: Mapping[str, float], member: str | None = None) -> PhaseSwitch | None:
        """Advance by one tick with signals given by their names.

        ``tick``: present tick. ``signals``: values in the units of a table; the time in the phase is counted.
        A missing signal has its initial value, as before the first measurement: the walk command is given, an
        angle is NaN. ``member``: phase of the other leg at the start of the tick, or None without one; for
        the supervisor the request in this tick, or None. Returns the switch, or None if the phase stays.
        Raises MeasurementError if a measurement is missing or not finite; measurements of an absent leg are
        not required.
        """
        values = self.table.to_si({**signals, TIME: self.time_in_phase(tick)})
        return self.advance(tick, values, self.table.member_index(member))

    def advance(self, tick: int, signals: Sequence[float], other_phase: int) -> PhaseSwitch | None:
        """Advance by one tick with a list of signals.

        ``signals``: this leg's signals, the other's, then the device's, in the order of
        :func:`twin_gait.gait.signals.all_signal_names`, SI units; NaN marks the signals of an absent leg. A
        list is read faster than a NumPy array. ``other_phase``: index of the other leg's phase at the start
        of the tick, -1 without one. Returns the switch, or None if the phase stays. Raises MeasurementError
        if a signal of this leg, of a present other leg, or of the device is not finite.
        """
        self._require_finite(signals, other_phase)
        choose, ticks = self.transition_selector or next_transition, tick - self.entry_tick
        index = choose(self.program, self.phase_index, ticks, signals, other_phase, self._debounce)
        if index == NO_TRANSITION:
            return None
        source = self.phase
        self.machine.events[f"take_{index}"].trigger(self)
        self.phase_index = self.table.phase_index(self.phase)
        self.entry_tick = tick
        item = self.table.transitions[index]
        return PhaseSwitch(tick, self.side, source, self.phase, item.cause, index)

    def enter(self, phase: str, tick: int) -> None:
        """Enter a phase at a tick by an external command, without a transition of the table."""
        self.phase, self.phase_index, self.entry_tick = phase, self.table.phase_index(phase), tick
        self._debounce[:] = [0] * len(self._debounce)

    def _require_finite(self, signals: Sequence[float], other_phase: int) -> None:
        for index in self._own_indices if other_phase < 0 else range(len(self._names)):
            if not math.isfinite(value := signals[index]):
                name = self._names[index].replace(OTHER, "other leg's ")
                raise MeasurementError(f"{self.owner}: the {name} is {value}; expected a finite measurement")
