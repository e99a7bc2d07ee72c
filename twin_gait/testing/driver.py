"""Drive a machine under test: through a scenario, and with measurements that it has to refuse."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

from twin_gait.exceptions import MeasurementError
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import OTHER, OTHER_TIME, TIME, LegSignals, leg_signals, signal_scale
from twin_gait.gait.table import StateTable
from twin_gait.testing.exits import Scenario
from twin_gait.testing.reference import Steps, Vector

_BROKEN = (math.nan, math.inf, -math.inf)


class Machine(Protocol):
    """What the kit asks of a machine: :class:`~twin_gait.gait.GaitStateMachine` is one.

    Of a gait table it asks ``step``, of a table of modes ``take``.

    Attributes:
        phase: Present phase.
    """

    phase: str

    def take(self, tick: int, signals: Mapping[str, float], member: str | None = None) -> PhaseSwitch | None:
        """Advance by one tick on signals in the units of their names, and a request; as ``step``."""

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


def machine_of(table: StateTable) -> MachineFactory:
    """The package's own machine for a table; the guards are compiled once."""
    program = compile_guards(table)
    return lambda phase: GaitStateMachine(table, initial_phase=phase, program=program)


class _Legs(NamedTuple):
    """What a machine is given in a tick, in SI units."""

    own: LegSignals
    other: LegSignals | None
    other_phase: str | None
    other_time: float

    def taken_by(self, machine: Machine, tick: int) -> PhaseSwitch | None:
        """What the machine does."""
        return machine.step(tick, *self)


def _legs(table: StateTable, vector: Vector) -> _Legs:
    """Signals of both legs; what a vector does not name is 0."""

    def leg(prefix: str) -> LegSignals:
        return leg_signals(
            table.joints, lambda name: signal_scale(name) * vector.signals.get(prefix + name, 0.0)
        )

    other = None if vector.other_phase is None else leg(OTHER)
    return _Legs(leg(""), other, vector.other_phase, vector.signals.get(OTHER_TIME, 0.0))


class _Asked(NamedTuple):
    """What a machine of modes is given in a tick, in the units of the table."""

    signals: Mapping[str, float]
    request: str | None

    def taken_by(self, machine: Machine, tick: int) -> PhaseSwitch | None:
        """What the machine does."""
        return machine.take(tick, self.signals, self.request)


def _given(table: StateTable, vector: Vector) -> _Legs | _Asked:
    if isinstance(table, ModeTable):
        return _Asked(vector.signals, vector.other_phase)
    return _legs(table, vector)


def play(table: StateTable, scenario: Scenario, factory: MachineFactory) -> None:
    """Drive a machine through a scenario; AssertionError at the first tick that is not as expected."""
    machine, phase = factory(scenario.phase), scenario.phase
    given: dict[int, _Legs | _Asked] = {}
    for (tick, vector), index in zip(scenario.steps, scenario.expected, strict=True):
        if id(vector) not in given:
            given[id(vector)] = _given(table, vector)
        switch = given[id(vector)].taken_by(machine, tick)
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
    """A machine that is about to take an exit is given one bad measurement instead."""

    table: StateTable  # the gait table
    phase: str  # phase that the leg has entered at tick 0
    steps: Steps  # good steps that take the exit; the last one is spoilt

    def broken_signals(self, factory: MachineFactory) -> None:
        """Each signal in turn is NaN or infinite; raises AssertionError if that is accepted."""
        vector = self.steps[-1].vector
        alone = vector.other_phase is None
        for name in self.table.signals:
            if name == TIME or (alone and name.startswith(OTHER)) or name == OTHER_TIME:
                continue
            for value in _BROKEN:
                spoilt = vector._replace(signals={**vector.signals, name: value})
                self._refuses(factory, _given(self.table, spoilt), f"{name} = {value}")

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

    def _refuses(self, factory: MachineFactory, given: _Legs | _Asked, text: str) -> None:
        machine = factory(self.phase)
        for tick, vector in self.steps[:-1]:
            _given(self.table, vector).taken_by(machine, tick)
        try:
            given.taken_by(machine, self.steps[-1].tick)
        except MeasurementError:
            assert machine.phase == self.phase, f"{text}: refused, but the phase is now {machine.phase}"
            return
        raise AssertionError(f"{text}: expected a MeasurementError, the machine accepted it")


def _without_joint(leg: LegSignals) -> list[tuple[str, LegSignals]]:
    return [
        ("an angle is missing", leg._replace(angles=leg.angles[:-1])),
        ("a velocity is missing", leg._replace(velocities=leg.velocities[:-1])),
    ]
