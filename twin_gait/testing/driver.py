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
    """What a machine of a gait table is given in a tick, in SI units."""

    own: LegSignals
    other: LegSignals | None
    other_phase: str | None
    other_time: float


# Advances a machine by a tick on what was measured.
Advance = Callable[[Machine, int], PhaseSwitch | None]


def _legs(table: StateTable, vector: Vector) -> _Legs:
    """Signals of both legs; what a vector does not name is 0."""

    def leg(prefix: str) -> LegSignals:
        return leg_signals(
            table.joints, lambda name: signal_scale(name) * vector.signals.get(prefix + name, 0.0)
        )

    other = None if vector.other_phase is None else leg(OTHER)
    return _Legs(leg(""), other, vector.other_phase, vector.signals.get(OTHER_TIME, 0.0))


def _on_legs(legs: _Legs) -> Advance:
    return lambda machine, tick: machine.step(tick, *legs)


def _on(table: StateTable, vector: Vector) -> Advance:
    if isinstance(table, ModeTable):
        return lambda machine, tick: machine.take(tick, vector.signals, vector.other_phase)
    return _on_legs(_legs(table, vector))


def play(table: StateTable, scenario: Scenario, factory: MachineFactory) -> None:
    """Drive a machine through a scenario; AssertionError at the first tick that is not as expected."""
    machine, phase = factory(scenario.phase), scenario.phase
    advances: dict[int, Advance] = {}
    for (tick, vector), index in zip(scenario.steps, scenario.expected, strict=True):
        if id(vector) not in advances:
            advances[id(vector)] = _on(table, vector)
        switch, source, wanted = advances[id(vector)](machine, tick), phase, None
        if index is not None:
            item = table.transitions[index]
            wanted, phase = (tick, phase, item.target, item.cause), item.target
        got = None if switch is None else (switch.tick, switch.source, switch.target, switch.cause)
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


def refuse_broken(table: StateTable, phase: str, steps: Steps, factory: MachineFactory) -> None:
    """Each signal in turn is NaN or infinite in the last of some steps; AssertionError if that is accepted.

    ``phase``: phase that the leg has entered at tick 0. ``steps``: good ones that take an exit.
    """
    vector = steps[-1].vector
    alone = vector.other_phase is None
    for name in table.signals:
        if name == TIME or (alone and name.startswith(OTHER)) or name == OTHER_TIME:
            continue
        for value in _BROKEN:
            spoilt = vector._replace(signals={**vector.signals, name: value})
            _refuse(table, phase, factory, steps, _on(table, spoilt), f"{name} = {value}")


def refuse_missing(table: StateTable, phase: str, steps: Steps, factory: MachineFactory) -> None:
    """A joint or a whole leg is missing; as :func:`refuse_broken`."""
    legs = _legs(table, steps[-1].vector)
    spoilt = [(f"this leg: {text}", legs._replace(own=bad)) for text, bad in _without_joint(legs.own)]
    if legs.other is not None:
        for text, bad in _without_joint(legs.other):
            spoilt.append((f"the other leg: {text}", legs._replace(other=bad)))
        spoilt.append(("the other leg has a phase but no signals", legs._replace(other=None)))
    for text, bad_legs in spoilt:
        _refuse(table, phase, factory, steps, _on_legs(bad_legs), text)


def _refuse(
    table: StateTable, phase: str, factory: MachineFactory, steps: Steps, spoilt: Advance, text: str
) -> None:
    """A machine that is about to take an exit is given one bad measurement instead."""
    machine = factory(phase)
    for tick, vector in steps[:-1]:
        _on(table, vector)(machine, tick)
    try:
        spoilt(machine, steps[-1].tick)
    except MeasurementError:
        assert machine.phase == phase, f"{text}: refused, but the phase is now {machine.phase}"
        return
    raise AssertionError(f"{text}: expected a MeasurementError, the machine accepted it")


def _without_joint(leg: LegSignals) -> list[tuple[str, LegSignals]]:
    return [
        ("an angle is missing", leg._replace(angles=leg.angles[:-1])),
        ("a velocity is missing", leg._replace(velocities=leg.velocities[:-1])),
    ]
