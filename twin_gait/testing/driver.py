"""Drive a machine under test: through a scenario, and with measurements that it has to refuse."""

import math
from collections.abc import Callable, Mapping
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


def _told(table: StateTable, vector: Vector) -> dict[str, float]:
    """What a machine is told: 0 of what a vector does not name, nothing of a leg that is not there."""
    untold = (TIME, OTHER) if vector.other_phase is None else TIME
    return {name: vector.signals.get(name, 0.0) for name in table.signals if not name.startswith(untold)}


def play(table: StateTable, scenario: Scenario, factory: MachineFactory) -> None:
    """Drive a machine through a scenario; AssertionError at the first tick that is not as expected."""
    machine, phase = factory(scenario.phase), scenario.phase
    told: dict[int, dict[str, float]] = {}
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


def refuse(table: StateTable, phase: str, steps: Steps, factory: MachineFactory) -> None:
    """A machine about to take an exit is given one bad measurement instead; AssertionError if it accepts.

    Each signal in turn is NaN or infinite, or is missing if it has to be measured. ``phase``: phase that the
    leg has entered at tick 0. ``steps``: good ones that take an exit.
    """
    *before, last = steps
    told = _told(table, last.vector)
    signals = [name for name in told if name != OTHER_TIME]
    spoilt = {f"{name} = {value}": {**told, name: value} for name in signals for value in _BROKEN}
    for name in signals:
        if math.isnan(signal_of(name).first):
            spoilt[f"{name} is missing"] = {key: told[key] for key in told if key != name}
    for text, bad in spoilt.items():
        machine = factory(phase)
        for tick, vector in before:
            machine.step(tick, _told(table, vector), vector.other_phase)
        try:
            machine.step(last.tick, bad, last.vector.other_phase)
        except MeasurementError:
            assert machine.phase == phase, f"{text}: refused, but the phase is now {machine.phase}"
        else:
            raise AssertionError(f"{text}: expected a MeasurementError, the machine accepted it")
