"""The gait state machine of one leg, on the `transitions` library.

`transitions` carries the states, the triggers and their introspection; which transition is due is
decided by the one evaluator in :mod:`twin_gait.core.guards`. Time is the tick count handed in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from transitions import Machine

from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.exceptions import MeasurementError
from twin_gait.gait.guards import OTHER, WALK, all_signal_names, signal_names
from twin_gait.gait.program import GuardProgram, compile_guards
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.vocabulary import Side


class PhaseSwitch(NamedTuple):
    """One switch of phase.

    Attributes:
        tick: Tick at which the new phase begins.
        side: Leg.
        source: Phase that was left.
        target: Phase that was entered.
        cause: Cause written in the gait table.
        transition: Index of the transition in the table.
    """

    tick: int
    side: Side
    source: str
    target: str
    cause: str
    transition: int

    @property
    def time(self) -> float:
        """Time of the switch in [s]."""
        return self.tick * TICK


class LegSignals(NamedTuple):
    """Measured signals of one leg in SI units, and what it is told.

    Attributes:
        angles: Joint angles in [rad], in the order of the table's joints.
        velocities: Joint velocities in [rad] / [s].
        foot_load: Normal force of the foot over body weight.
        walk: Command: 1 to walk, 0 to stand. A leg reads its own only.
    """

    angles: tuple[float, ...]
    velocities: tuple[float, ...]
    foot_load: float = 0.0
    walk: float = 1.0


class GaitStateMachine:
    """Phase of one leg, advanced tick by tick.

    Attributes:
        table: The gait table.
        side: The leg.
        program: The table's guards as arrays.
        entry_tick: Tick at which the present phase was entered.
    """

    def __init__(
        self,
        table: GaitTable,
        side: Side,
        *,
        initial_phase: str | None = None,
        program: GuardProgram | None = None,
    ) -> None:
        """Build the machine.

        Args:
            table: The gait table.
            side: The leg.
            initial_phase: Phase at tick 0; the first of the table if None.
            program: The compiled table, to share it between legs.

        Raises:
            GaitTableError: If the initial phase is not in the table.
        """
        self.table = table
        self.side = side
        self.program = compile_guards(table) if program is None else program
        self.entry_tick = 0
        self._debounce = np.zeros(len(table.transitions), dtype=np.int64)
        initial = table.phase_names[0] if initial_phase is None else initial_phase
        table.phase_index(initial)
        self.machine = Machine(
            model=self,
            states=list(table.phase_names),
            initial=initial,
            transitions=[
                {"trigger": f"take_{index}", "source": item.source, "dest": item.target}
                for index, item in enumerate(table.transitions)
            ],
            auto_transitions=False,
            model_attribute="phase",
        )
        self.phase: str = initial
        self._index = table.phase_index(initial)

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

        Args:
            tick: Present tick.
            own: Measurements of this leg.
            other: Measurements of the other leg, or None for a one-legged bench.
            other_phase: Phase of the other leg at the start of the tick, or None.
            other_time_in_phase: Time since the other leg entered its phase in [s].

        Returns:
            The switch, or None if the leg stays.

        Raises:
            MeasurementError: If a measurement is missing or not finite.
        """
        signals = signal_array(self.table, self.time_in_phase(tick), own, other, other_time_in_phase)
        other_index = -1 if other_phase is None else self.table.phase_index(other_phase)
        return self.advance(tick, signals, other_index)

    def advance(self, tick: int, signals: np.ndarray, other_phase: int) -> PhaseSwitch | None:
        """Advance by one tick on a signal array.

        Args:
            tick: Present tick.
            signals: This leg's signals, the other's, then the command, in the order of
                :func:`twin_gait.gait.guards.all_signal_names`, SI units; NaN marks the signals of a
                leg that is not there.
            other_phase: Index of the other leg's phase at the start of the tick, -1 without one.

        Returns:
            The switch, or None if the leg stays.

        Raises:
            MeasurementError: If a signal of this leg, of a present other leg, or the command is not finite.
        """
        self._refuse_non_finite(signals, other_phase)
        index = next_transition(
            self._index,
            tick - self.entry_tick,
            int(self.program.minimum_ticks[self._index]),
            self.program.transitions,
            self.program.nodes,
            self.program.comparisons,
            signals,
            other_phase,
            self._debounce,
        )
        if index == NO_TRANSITION:
            return None
        source = self.phase
        self.trigger(f"take_{index}")  # type: ignore[attr-defined]  # added by transitions
        self._index = self.table.phase_index(self.phase)
        self.entry_tick = tick
        item = self.table.transitions[index]
        return PhaseSwitch(tick, self.side, source, self.phase, item.cause, index)

    def _refuse_non_finite(self, signals: np.ndarray, other_phase: int) -> None:
        names = all_signal_names(self.table.joints)
        if len(signals) != len(names):
            raise MeasurementError(f"{self.side} leg: expected {len(names)} signals, got {len(signals)}")
        broken = ~np.isfinite(signals)
        if other_phase < 0:
            own = len(signal_names(self.table.joints))
            broken[own : names.index(WALK)] = False
        if not broken.any():
            return
        position = int(np.flatnonzero(broken)[0])
        name = names[position].replace(OTHER, "other leg's ")
        raise MeasurementError(
            f"{self.side} leg: the {name} is {signals[position]}; expected a finite measurement"
        )


def signal_array(
    table: GaitTable,
    time_in_phase: float,
    own: LegSignals,
    other: LegSignals | None,
    other_time_in_phase: float = 0.0,
) -> np.ndarray:
    """Lay the signals of both legs out as the guard program reads them.

    Args:
        time_in_phase: Of this leg in [s].
        other: Measurements of the other leg, or None.
        other_time_in_phase: Of the other leg in [s].

    Returns:
        Shape ``(2 n + 1,)`` with n signals a leg and the command; NaN for an absent other leg.

    Raises:
        MeasurementError: If the number of joints is not that of the table.
    """
    halves = [_leg_array(table, own, time_in_phase)]
    if other is None:
        halves.append(np.full(len(halves[0]), np.nan))
    else:
        halves.append(_leg_array(table, other, other_time_in_phase))
    return np.concatenate([*halves, [own.walk]])


def _leg_array(table: GaitTable, leg: LegSignals, time_in_phase: float) -> np.ndarray:
    if len(leg.angles) != len(table.joints) or len(leg.velocities) != len(table.joints):
        raise MeasurementError(
            f"expected an angle and a velocity for each of {', '.join(table.joints)}, "
            f"got {len(leg.angles)} angles and {len(leg.velocities)} velocities"
        )
    pairs = [value for pair in zip(leg.angles, leg.velocities, strict=True) for value in pair]
    return np.array([*pairs, leg.foot_load, time_in_phase])
