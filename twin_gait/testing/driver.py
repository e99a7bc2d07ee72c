"""Drive a machine under test: through a scenario, and with measurements that it has to refuse."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from twin_gait.exceptions import MeasurementError
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import (
    DEVICE_NAMES,
    OTHER,
    OTHER_TIME,
    TIME,
    LegSignals,
    leg_signals,
    signal_names,
    signal_scale,
)
from twin_gait.gait.table import GaitTable
from twin_gait.testing.exits import Scenario
from twin_gait.testing.reference import Steps, Vector
from twin_gait.vocabulary import Side

_BROKEN = (math.nan, math.inf, -math.inf)


class Machine(Protocol):
    """What the kit asks of a machine: :class:`~twin_gait.gait.GaitStateMachine` is one.

    Attributes:
        phase: Present phase.
    """

    phase: str

    def step(
        self,
        tick: int,
        own: LegSignals,
        other: LegSignals | None = None,
        other_phase: str | None = None,
        other_time_in_phase: float = 0.0,
    ) -> PhaseSwitch | None:
        """Advance by one tick; raise MeasurementError if a measurement is missing or not finite."""


MachineFactory = Callable[[str], Machine]  # from the phase that the leg has entered at tick 0


def machine_of(table: GaitTable) -> MachineFactory:
    """The package's own machine for a table; the guards are compiled once."""
    program = compile_guards(table)
    return lambda phase: GaitStateMachine(table, Side.LEFT, initial_phase=phase, program=program)


class _Legs(NamedTuple):
    """What a machine is given in a tick, in SI units."""

    own: LegSignals
    other: LegSignals | None
    other_phase: str | None
    other_time: float


def _legs(table: GaitTable, vector: Vector) -> _Legs:
    """Signals of both legs; what a vector does not name is 0."""

    def leg(prefix: str) -> LegSignals:
        return leg_signals(
            table.joints, lambda name: signal_scale(name) * vector.signals.get(prefix + name, 0.0)
        )

    other = None if vector.other_phase is None else leg(OTHER)
    return _Legs(leg(""), other, vector.other_phase, vector.signals.get(OTHER_TIME, 0.0))


def play(table: GaitTable, scenario: Scenario, factory: MachineFactory) -> None:
    """Drive a machine through a scenario.

    Raises:
        AssertionError: At the first tick in which the machine does something else.
    """
    machine, phase = factory(scenario.phase), scenario.phase
    legs: dict[int, _Legs] = {}
    for (tick, vector), index in zip(scenario.steps, scenario.expected, strict=True):
        if id(vector) not in legs:
            legs[id(vector)] = _legs(table, vector)
        switch = machine.step(tick, *legs[id(vector)])
        wanted = None
        if index is not None:
            item = table.transitions[index]
            wanted = (tick, phase, item.target, item.cause)
        got = None if switch is None else (switch.tick, switch.source, switch.target, switch.cause)
        source, phase = phase, phase if wanted is None else wanted[2]
        assert got == wanted and machine.phase == phase, (
            f"tick {tick} in {source}: expected that the leg {_words(wanted)}, the machine {_words(got)}"
            f"; measured {_measured(vector)}"
        )


def _words(switch: tuple[int, str, str, str] | None) -> str:
    return "stays" if switch is None else f"goes to {switch[2]} ({switch[3]})"


def _measured(vector: Vector) -> str:
    values = [f"{name} = {value:.12g}" for name, value in vector.signals.items()]
    other = "no other leg" if vector.other_phase is None else f"other leg in {vector.other_phase}"
    return ", ".join([*values, other])


class Refusal(NamedTuple):
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
        vector = self.steps[-1].vector
        own = [name for name in signal_names(self.table.joints) if name != TIME]
        others = own if vector.other_phase is not None else []
        for name in [*own, *(OTHER + name for name in others), *DEVICE_NAMES]:
            for value in _BROKEN:
                spoilt = vector._replace(signals={**vector.signals, name: value})
                self._refuses(factory, _legs(self.table, spoilt), f"{name} = {value}")

    def missing_signals(self, factory: MachineFactory) -> None:
        """A joint or a whole leg is missing; raises AssertionError if that is accepted."""
        legs = _legs(self.table, self.steps[-1].vector)
        for text, bad in _without_joint(legs.own):
            self._refuses(factory, legs._replace(own=bad), f"this leg: {text}")
        if legs.other is None:
            return
        for text, bad in _without_joint(legs.other):
            self._refuses(factory, legs._replace(other=bad), f"the other leg: {text}")
        self._refuses(factory, legs._replace(other=None), "the other leg has a phase but no signals")

    def _refuses(self, factory: MachineFactory, legs: _Legs, text: str) -> None:
        machine = factory(self.phase)
        for tick, vector in self.steps[:-1]:
            machine.step(tick, *_legs(self.table, vector))
        try:
            machine.step(self.steps[-1].tick, *legs)
        except MeasurementError:
            assert machine.phase == self.phase, f"{text}: refused, but the phase is now {machine.phase}"
            return
        raise AssertionError(f"{text}: expected a MeasurementError, the machine accepted it")


def _without_joint(leg: LegSignals) -> list[tuple[str, LegSignals]]:
    return [
        ("an angle is missing", leg._replace(angles=leg.angles[:-1])),
        ("a velocity is missing", leg._replace(velocities=leg.velocities[:-1])),
    ]
