"""Drive a machine under test through the steps of a scenario and compare."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from twin_gait.gait.guards import OTHER, WALK
from twin_gait.gait.machine import GaitStateMachine, LegSignals, PhaseSwitch
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import GaitTable
from twin_gait.testing.leaving import Scenario
from twin_gait.testing.witness import OTHER_TIME, Vector, to_si
from twin_gait.vocabulary import Side


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
    """The package's own machine for a table.

    Args:
        table: The gait table.

    Returns:
        A function from the initial phase to a machine; the guards are compiled once.
    """
    program = compile_guards(table)

    def build(phase: str) -> GaitStateMachine:
        return GaitStateMachine(table, Side.LEFT, initial_phase=phase, program=program)

    return build


def signals_of(table: GaitTable, vector: Vector, prefix: str = "") -> LegSignals:
    """Signals of one leg in SI units.

    Args:
        table: The gait table, for its joints.
        vector: Measurements in the units of the table; what is not named is 0.
        prefix: ``other.`` for the other leg.

    Returns:
        The signals.
    """

    def value(name: str) -> float:
        return to_si(name, vector.signals.get(prefix + name, 0.0))

    return LegSignals(
        angles=tuple(value(f"{joint}.angle_deg") for joint in table.joints),
        velocities=tuple(value(f"{joint}.velocity_deg_per_s") for joint in table.joints),
        foot_load=value("foot.load_bw"),
        walk=value(WALK),
    )


def other_time(vector: Vector) -> float:
    """Time of the other leg in its phase in [s]."""
    return vector.signals.get(OTHER_TIME, 0.0)


def play(table: GaitTable, scenario: Scenario, factory: MachineFactory) -> None:
    """Drive a machine through a scenario.

    Args:
        table: The gait table that the scenario was made for.
        scenario: Steps and expected switches.
        factory: Builds the machine.

    Raises:
        AssertionError: At the first tick in which the machine does something else.
    """
    machine = factory(scenario.phase)
    expected_phase = scenario.phase
    sides: dict[int, tuple[LegSignals, LegSignals | None]] = {}
    for step, index in zip(scenario.steps, scenario.expected, strict=True):
        vector = step.vector
        if id(vector) not in sides:
            other = None if vector.other_phase is None else signals_of(table, vector, OTHER)
            sides[id(vector)] = signals_of(table, vector), other
        switch = machine.step(step.tick, *sides[id(vector)], vector.other_phase, other_time(vector))
        source = expected_phase
        if index is not None:
            expected_phase = table.transitions[index].target
        wanted = _words(table, index)
        cause = None if index is None else table.transitions[index].cause
        got = "stays" if switch is None else f"goes to {switch.target} ({switch.cause})"
        right = _fits(switch, step.tick, source, expected_phase, cause) and machine.phase == expected_phase
        assert right, (
            f"tick {step.tick} in {source}: expected that the leg {wanted}, the machine {got}"
            f"; measured {_measured(vector)}"
        )


def _fits(switch: PhaseSwitch | None, tick: int, source: str, target: str, cause: str | None) -> bool:
    if switch is None or cause is None:
        return switch is None and cause is None
    return (switch.tick, switch.source, switch.target, switch.cause) == (tick, source, target, cause)


def _words(table: GaitTable, index: int | None) -> str:
    if index is None:
        return "stays"
    return f"goes to {table.transitions[index].target} ({table.transitions[index].cause})"


def _measured(vector: Vector) -> str:
    values = [f"{name} = {value:.12g}" for name, value in vector.signals.items()]
    other = "no other leg" if vector.other_phase is None else f"other leg in {vector.other_phase}"
    return ", ".join([*values, other])
