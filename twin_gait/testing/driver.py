"""Drive a machine under test: through a scenario, and with measurements that it has to refuse."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from twin_gait.exceptions import MeasurementError
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import OTHER, OTHER_TIME, TIME, signal_of
from twin_gait.gait.table import StateTable
from twin_gait.testing.exits import Scenario
from twin_gait.testing.reference import Steps, Vector

_BROKEN = (math.nan, math.inf, -math.inf)


class Machine(Protocol):
    """What the kit asks of a machine: :class:`~twin_gait.gait.GaitStateMachine` is one.

    Attributes:
        phase: Present phase.
    """

    phase: str

    def step(self, tick: int, signals: Mapping[str, float], member: str | None = None) -> PhaseSwitch | None:
        """Advance by one tick; raise MeasurementError if a measurement is missing or not finite.

        ``signals``: by name in the unit of that, but for the time in the phase; none of a leg that is not
        there. ``member``: phase of the other leg, or of modes the request, or None.
        """


MachineFactory = Callable[[str], Machine]  # from the phase that the leg has entered at tick 0


def machine_of(table: StateTable) -> MachineFactory:
    """The package's own machine for a table; the guards are compiled once."""
    program = compile_guards(table)
    return lambda phase: GaitStateMachine(table, initial_phase=phase, program=program)


Signals = Mapping[str, float]


def _told(table: StateTable, vector: Vector) -> dict[str, float]:
    """What a machine is told: 0 of what a vector does not name, nothing of a leg that is not there."""
    untold = (TIME, OTHER) if vector.other_phase is None else TIME
    return {name: vector.signals.get(name, 0.0) for name in table.signals if not name.startswith(untold)}


def play(table: StateTable, scenario: Scenario, factory: MachineFactory) -> None:
    """Drive a machine through a scenario; AssertionError at the first tick that is not as expected."""
    machine, phase = factory(scenario.phase), scenario.phase
    told: dict[int, Signals] = {}
    for (tick, vector), index in zip(scenario.steps, scenario.expected, strict=True):
        if id(vector) not in told:
            told[id(vector)] = _told(table, vector)
        switch, source, wanted = machine.step(tick, told[id(vector)], vector.other_phase), phase, None
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
    told = _told(table, steps[-1].vector)
    cases = [(name, value) for name in told if name != OTHER_TIME for value in _BROKEN]
    spoilt = ((f"{name} = {value}", {**told, name: value}) for name, value in cases)
    _refuse(table, phase, steps, factory, spoilt)


def refuse_missing(table: StateTable, phase: str, steps: Steps, factory: MachineFactory) -> None:
    """Each signal that has to be measured is missing in turn; as :func:`refuse_broken`."""
    told = _told(table, steps[-1].vector)
    measured = [name for name in told if name != OTHER_TIME and math.isnan(signal_of(name).first)]
    spoilt = ((f"{name} is missing", {key: told[key] for key in told if key != name}) for name in measured)
    _refuse(table, phase, steps, factory, spoilt)


def _refuse(
    table: StateTable,
    phase: str,
    steps: Steps,
    factory: MachineFactory,
    spoilt: Iterable[tuple[str, Signals]],
) -> None:
    """A machine that is about to take an exit is given one bad measurement instead."""
    *before, last = steps
    for text, signals in spoilt:
        machine = factory(phase)
        for tick, vector in before:
            machine.step(tick, _told(table, vector), vector.other_phase)
        try:
            machine.step(last.tick, signals, last.vector.other_phase)
        except MeasurementError:
            assert machine.phase == phase, f"{text}: refused, but the phase is now {machine.phase}"
        else:
            raise AssertionError(f"{text}: expected a MeasurementError, the machine accepted it")
