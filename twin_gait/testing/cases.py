"""Tests of a gait table: every transition at every threshold, in time, and in priority; an approved text.

The tests are derived from the table, so they cannot detect that the table itself was changed. The approved
text can: it is kept in git and approved by a person.
"""

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from twin_gait.configuration.documents import dump_yaml, table_document
from twin_gait.exceptions import MeasurementError
from twin_gait.gait.documents import transition_table, truth_table
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import OTHER, OTHER_TIME, TIME, find_signal
from twin_gait.gait.table import StateTable
from twin_gait.testing.exits import Exit, ExitScenario
from twin_gait.testing.reference import Measurements
from twin_gait.testing.scenarios import scenarios


class Machine(Protocol):
    """Interface that the kit needs; :class:`~twin_gait.gait.machine.GaitStateMachine` implements it.

    Attributes:
        phase: Present phase.
    """

    phase: str

    def step(self, tick: int, signals: Mapping[str, float], member: str | None = None) -> PhaseSwitch | None:
        """Advance by one tick; raise MeasurementError if a measurement is missing or not finite.

        ``signals``: values by name in the unit of the name, without the time in the phase; no signals of
        another leg if there is none. ``member``: phase of the other leg, or for modes the request, or None.
        """


MachineFactory = Callable[[str], Machine]  # argument: phase that the leg enters at tick 0


def machine_of(table: StateTable) -> MachineFactory:
    """Return a factory of the package's own machine for a table; the guards are compiled once."""
    program = compile_guards(table)
    return lambda phase: GaitStateMachine(table, initial_phase=phase, program=program)


@dataclass(frozen=True)
class TransitionTest:
    """One test of a machine against one entry of a gait table."""

    # transition and tested property, for example
    # ``late_stance→swing_flexion (trailing_limb)::holds just below hip.angle_deg < -2.8``
    name: str
    table: StateTable  # the expectation is derived from the table alone
    machine: MachineFactory  # builds the machine under test
    scenario: ExitScenario  # measurements, and expected transitions of the leg

    @property
    def undecided(self) -> str | None:
        """Reason why there is nothing to test, or None for a test that runs."""
        why = "implied by other conditions, shadowed by another exit, or too many choices to try"
        problem = f"there are no measurements with which this condition decides: {why}"
        return None if self.scenario.steps else problem

    def run(self) -> None:
        """Run the scenario on the machine, unless :attr:`undecided`.

        Raises AssertionError if the machine deviates from the table.
        """
        if self.scenario.expects_rejection:
            _check_rejection(self.table, self.scenario, self.machine)
        else:
            _run_scenario(self.table, self.scenario, self.machine)


def transition_tests(table: StateTable, machine: MachineFactory | None = None) -> list[TransitionTest]:
    """Create the tests of a gait table.

    Tested for every transition: it fires just past each threshold, and holds just below and on it; each
    condition of ``all`` and ``any`` by itself; debounce; minimum duration; timeout; priority; the clock of
    the next phase; the rejection of invalid measurements. The expectations are derived from the table alone.

    ``table``: of gait or of modes. ``machine``: builds the machine under test in a phase that it has entered
    at tick 0; if None, the package's own machine for this table. Returns the tests in the order of the table.
    """
    factory = machine_of(table) if machine is None else machine
    return [
        TransitionTest(
            f"{item.source}→{item.target} ({item.cause})::{shown.description}", table, factory, shown
        )
        for index, item in enumerate(table.transitions)
        for shown in scenarios(Exit(table, index))
    ]


def _machine_inputs(table: StateTable, vector: Measurements) -> dict[str, float]:
    """Return the inputs of a machine: 0 for signals missing in a vector, none of an absent other leg."""
    excluded = (TIME, OTHER) if vector.other_phase is None else TIME
    return {name: vector.signals.get(name, 0.0) for name in table.signals if not name.startswith(excluded)}


def _run_scenario(table: StateTable, scenario: ExitScenario, factory: MachineFactory) -> None:
    """Run a scenario on a machine; raise AssertionError at the first tick that is not as expected."""
    machine, phase = factory(scenario.phase), scenario.phase
    inputs: dict[int, dict[str, float]] = {}
    for (tick, vector), index in zip(scenario.steps, scenario.expected, strict=True):
        if id(vector) not in inputs:
            inputs[id(vector)] = _machine_inputs(table, vector)
        switch, source, expected = machine.step(tick, inputs[id(vector)], vector.other_phase), phase, None
        if index is not None:
            item = table.transitions[index]
            expected, phase = (tick, phase, item.target, item.cause), item.target
        got = None if switch is None else (switch.tick, switch.source, switch.target, switch.cause)
        where = f"tick {tick} in {source}"
        _require(got == expected, f"{where}: expected the switch {expected}, got {got}; measured {vector}")
        where = f"{where}: expected {phase}"
        _require(machine.phase == phase, f"{where}, got {machine.phase}; measured {vector}")


def _require(holds: bool, text: str) -> None:
    """Raise AssertionError unless a condition is true, also under ``python -O``, which removes assertions."""
    if not holds:
        raise AssertionError(text)


def _check_rejection(table: StateTable, scenario: ExitScenario, factory: MachineFactory) -> None:
    """Pass one invalid measurement to a machine that is about to take an exit; AssertionError if it accepts.

    Each signal in turn is NaN or infinite, or is missing if it has to be measured.
    """
    *before, last = scenario.steps
    inputs = _machine_inputs(table, last.vector)
    signals = [name for name in inputs if name != OTHER_TIME]
    broken = (math.nan, math.inf, -math.inf)
    spoilt = {f"{name} = {value}": {**inputs, name: value} for name in signals for value in broken}
    for name in signals:
        if math.isnan(find_signal(name).initial_value):
            spoilt[f"{name} is missing"] = {key: inputs[key] for key in inputs if key != name}
    for text, bad in spoilt.items():
        machine = factory(scenario.phase)
        for tick, vector in before:
            machine.step(tick, _machine_inputs(table, vector), vector.other_phase)
        try:
            machine.step(last.tick, bad, last.vector.other_phase)
        except MeasurementError:
            stays = machine.phase == scenario.phase
            _require(stays, f"{text}: rejected, but the phase is now {machine.phase}")
        else:
            raise AssertionError(f"{text}: expected a MeasurementError, but the machine accepted it")


def approval_text(table: StateTable) -> str:
    """Return the text of a table that a person approves.

    It contains the transitions by priority and truth tables in Markdown, then the rest of the table file.
    """
    rest = {key: value for key, value in table_document(table).items() if key != "transitions"}
    return f"{transition_table(table)}\n{truth_table(table)}\n```yaml\n{dump_yaml(rest)}```\n"


def check_approved(path: Path, present: str) -> str | None:
    """Compare the approved text with the present one; return None if equal, else the difference.

    The difference is a unified diff, or a sentence if there is no approved text.
    """
    if not path.exists():
        return f"{path}: there is no approved text yet"
    approved = path.read_text(encoding="utf-8").splitlines()
    lines = difflib.unified_diff(approved, present.splitlines(), str(path), "the table", lineterm="")
    return "\n".join(lines) or None
