"""Measurements that a machine has to refuse, and another leg that is not there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from twin_gait.exceptions import MeasurementError
from twin_gait.gait.guards import OTHER, WALK, signal_names
from twin_gait.gait.machine import LegSignals
from twin_gait.gait.table import GaitTable
from twin_gait.testing.driver import Machine, MachineFactory, other_time, signals_of
from twin_gait.testing.edges import Steps
from twin_gait.testing.leaving import Exit
from twin_gait.testing.witness import OWN_TIME, Step, outcomes

_BROKEN = (math.nan, math.inf, -math.inf)


@dataclass(frozen=True)
class Refusal:
    """A machine that is about to take an exit is given one bad measurement instead.

    Attributes:
        table: The gait table.
        phase: Phase that the leg has entered at tick 0.
        steps: Good steps that take the exit; the last one is spoilt.
    """

    table: GaitTable
    phase: str
    steps: Steps

    def broken_signals(self, factory: MachineFactory) -> None:
        """Each signal in turn is NaN or infinite; raises AssertionError if that is accepted."""
        own = [name for name in signal_names(self.table.joints) if name != OWN_TIME]
        last = self.steps[-1]
        others = own if last.vector.other_phase is not None else []
        for name in [*own, *(OTHER + name for name in others), WALK]:
            for value in _BROKEN:
                signals = {**last.vector.signals, name: value}
                spoilt = replace(last, vector=replace(last.vector, signals=signals))
                self._refuses(factory, spoilt, f"{name} = {value}")

    def missing_signals(self, factory: MachineFactory) -> None:
        """A joint or a whole leg is missing; raises AssertionError if that is accepted."""
        vector = self.steps[-1].vector
        own = signals_of(self.table, vector)
        other = None if vector.other_phase is None else signals_of(self.table, vector, OTHER)
        for text, bad in _without_joint(own):
            self._refuses_legs(factory, bad, other, f"this leg: {text}")
        if other is None:
            return
        for text, bad in _without_joint(other):
            self._refuses_legs(factory, own, bad, f"the other leg: {text}")
        self._refuses_legs(factory, own, None, "the other leg has a phase but no signals")

    def _refuses(self, factory: MachineFactory, spoilt: Step, text: str) -> None:
        own, vector = signals_of(self.table, spoilt.vector), spoilt.vector
        other = None if vector.other_phase is None else signals_of(self.table, vector, OTHER)
        self._refuses_legs(factory, own, other, text)

    def _refuses_legs(
        self, factory: MachineFactory, own: LegSignals, other: LegSignals | None, text: str
    ) -> None:
        machine = self._ready(factory)
        last = self.steps[-1]
        try:
            machine.step(last.tick, own, other, last.vector.other_phase, other_time(last.vector))
        except MeasurementError:
            assert machine.phase == self.phase, f"{text}: refused, but the phase is now {machine.phase}"
            return
        raise AssertionError(f"{text}: expected a MeasurementError, the machine accepted it")

    def _ready(self, factory: MachineFactory) -> Machine:
        """A machine after all good steps but the last."""
        machine = factory(self.phase)
        for step in self.steps[:-1]:
            vector = step.vector
            other = None if vector.other_phase is None else signals_of(self.table, vector, OTHER)
            own = signals_of(self.table, vector)
            machine.step(step.tick, own, other, vector.other_phase, other_time(vector))
        return machine


def _without_joint(leg: LegSignals) -> list[tuple[str, LegSignals]]:
    return [
        ("an angle is missing", leg._replace(angles=leg.angles[:-1])),
        ("a velocity is missing", leg._replace(velocities=leg.velocities[:-1])),
    ]


def without_other_leg(leave: Exit, steps: Steps) -> Iterator[Steps]:
    """The same measurements without the other leg, if that closes the exit.

    Args:
        leave: The exit.
        steps: Steps that take it.

    Yields:
        Steps that do not; nothing if the exit does not need the other leg.
    """
    alone = tuple(replace(step, vector=replace(step.vector, other_phase=None)) for step in steps)
    if leave.index not in outcomes(leave.table, leave.phase, alone):
        yield alone
