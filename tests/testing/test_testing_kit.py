"""The test kit for gait tables: on random tables, on broken machines, and its solver by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from errors import raises
from firmware_tools import require_tools
from hypothesis import given, settings
from random_tables import tables
from table_builder import FIVE_PHASES, JOINTS, guard, phase, transition, two_phase_table

from twin_gait.configuration.gait_table_file import load_gait_table, packaged_gait_tables
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import AllOf, AnyOf
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.table import GaitTable
from twin_gait.testing.cases import TransitionTest, approval_text, check_approved, transition_tests
from twin_gait.testing.compiled import compiled_machines
from twin_gait.testing.exits import Exit, ExitScenario, decisive
from twin_gait.testing.scenarios import MARGIN, edges
from twin_gait.vocabulary import Side


def rich_table() -> GaitTable:
    """Something of everything: nested lists, debounce, minimum duration, timeouts, the other leg."""
    either = AnyOf(guards=(guard("hip.angle_deg < -8"), guard("foot.load_bw > 0.3")))
    far = guard("other.hip.angle_deg - hip.angle_deg > 10")
    both = AllOf(guards=(either, guard("other.phase in [stance]"), far))
    late = AnyOf(guards=(guard("time_in_phase_s > 0.025"), guard("hip.angle_deg < -2")))
    exits = (
        transition("stance", "swing", both, cause="ready", debounce_ticks=5),
        transition("stance", "swing", "knee.angle_deg > 60", cause="bent"),
        transition("stance", "rest", None, cause="timeout", timeout_ticks=90),
        transition("swing", "stance", "knee.velocity_deg_per_s < -3", cause="back", timeout_ticks=30),
        transition("swing", "stance", AllOf(guards=(guard("foot.load_bw > 1"), late)), cause="loaded"),
        transition("rest", "swing", "other.time_in_phase_s > 0.04", cause="rested", debounce_ticks=2),
        transition("rest", "stance", guard("other.phase in [swing]"), cause="other", debounce_ticks=3),
        transition(
            "rest", "stance", "hip.velocity_deg_per_s - other.hip.velocity_deg_per_s < 0", cause="slower"
        ),
    )
    phases = {"stance": phase(minimum_ticks=20), "swing": phase(minimum_ticks=12), "rest": phase()}
    return GaitTable(name="rich", joints=JOINTS, phases=phases, transitions=exits)


def shadowed_table() -> GaitTable:
    """Below −1000° the hip is also below −2°, and that exit is listed first."""
    return two_phase_table(
        transition("stance", "swing", "hip.angle_deg > 3"),
        transition("swing", "stance", "hip.angle_deg < -2", cause="behind"),
    )


@cache
def rich_tests() -> dict[str, TransitionTest]:
    return {test.name: test for test in transition_tests(rich_table())}


def failures(table: GaitTable, machine: Callable[[str], object]) -> list[str]:
    """Names of the tests of a table that a machine fails."""
    failed = []
    for test in transition_tests(table, machine):  # type: ignore[arg-type]
        try:
            test.run()
        except AssertionError:
            failed.append(test.name)
    return failed


@settings(max_examples=12)
@given(table=tables())
def test_machine_of_the_package_passes_on_any_table(table: GaitTable) -> None:
    for test in transition_tests(table):
        test.run()


def test_every_test_of_a_table_without_redundant_conditions_is_decided() -> None:
    assert [name for name, test in rich_tests().items() if test.undecided] == []
    for test in rich_tests().values():
        test.run()


def test_only_what_an_exit_above_shadows_is_undecided() -> None:
    undecided = [test.name for test in transition_tests(shadowed_table()) if test.undecided]
    assert undecided
    assert all(name.startswith("swing→stance (never)::") for name in undecided)


def test_names_state_the_transition_and_the_claim() -> None:
    names = {test.name for test in transition_tests(load_gait_table(FIVE_PHASES))}
    title = "late_stance→swing_flexion (trailing_limb)::"
    assert title + "holds just below hip.angle_deg < -2.8" in names
    assert title + "fires just past other.hip.angle_deg - hip.angle_deg > 5.7" in names
    assert title + "fires while the other leg is in early_stance" in names
    assert title + "holds while the other leg is in swing_flexion" in names


@pytest.mark.parametrize(
    "claim",
    [
        "any: fires by foot.load_bw > 0.3 alone",
        "all: holds while only other.hip.angle_deg - hip.angle_deg > 10 is missing",
        "debounce: holds for 4 ticks, fires on tick 5",
        "debounce: one closed tick starts the count of 5 anew",
        "minimum duration: open before, fires after 20 ticks",
        "priority: wins over swing (bent) when both are due",
        "priority: wins over rest (timeout) when both are due",
        "clock: 30 ticks for back count from the entry of swing",
        "clock: 26 ticks for loaded count from the entry of swing",
        "holds in rest, which it does not leave",
        "holds without another leg",
    ],
)
def test_kit_shows(claim: str) -> None:
    assert f"stance→swing (ready)::{claim}" in rich_tests()


def test_edges_are_a_billionth_from_the_threshold_typed_here() -> None:
    """Angles just on either side of −8°, five ticks long, when the minimum duration is over."""
    leave = Exit(rich_table(), 0)
    entry = next(item for item in decisive(leave.item.guard) if str(item.atom) == "hip.angle_deg < -8")
    past, below, on, _ = edges(leave, entry)
    assert isinstance(past, ExitScenario) and isinstance(below, ExitScenario) and isinstance(on, ExitScenario)
    angles = [item.steps[0].vector.signals["hip.angle_deg"] for item in (past, below, on)]
    assert angles == pytest.approx([-8 - 8e-9, -8 + 8e-9, -8], abs=1e-14)
    assert angles[0] < angles[2] == -8 < angles[1]
    assert pytest.approx(1e-9) == MARGIN
    assert past.expected == (None, None, None, None, 0)
    assert below.expected == on.expected == (None,) * 5
    assert past.steps[0].tick == 20


def test_condition_that_another_one_implies_is_reported_and_not_passed_over() -> None:
    implied = AllOf(guards=(guard("hip.angle_deg > 10"), guard("hip.angle_deg > 5")))
    tests = {
        test.name: test for test in transition_tests(two_phase_table(transition("stance", "swing", implied)))
    }
    title = "stance→swing (stance_to_swing)::"
    assert tests[title + "fires just past hip.angle_deg > 10"].undecided is None
    undecided = tests[title + "fires just past hip.angle_deg > 5"].undecided
    assert undecided is not None and "implied" in undecided


class ForgivesNaN(GaitStateMachine):
    """A broken sensor passes in silence."""

    def _require_finite(self, signals: list[float], other_phase: int) -> None:
        signals[:] = [value if math.isfinite(value) else 0.0 for value in signals]


class CountsAllOpenTicks(GaitStateMachine):
    """A closed tick does not start the debounce anew."""

    def advance(self, tick: int, signals: list[float], other_phase: int) -> PhaseSwitch | None:
        before = self._debounce.copy()
        phase = self.phase_index
        switch = super().advance(tick, signals, other_phase)
        if self.phase_index == phase:
            self._debounce = [max(pair) for pair in zip(self._debounce, before, strict=True)]
        return switch


class NeverResetsItsClock(GaitStateMachine):
    """Time in the phase is time since the start."""

    def advance(self, tick: int, signals: list[float], other_phase: int) -> PhaseSwitch | None:
        switch = super().advance(tick, signals, other_phase)
        self.entry_tick = 0
        return switch


class IgnoresTheOtherLeg(GaitStateMachine):
    """The other leg is always thought to be in the same phase."""

    def advance(self, tick: int, signals: list[float], other_phase: int) -> PhaseSwitch | None:
        return super().advance(tick, signals, other_phase if other_phase < 0 else self.phase_index)


class ReportsAnotherCause(GaitStateMachine):
    """The right phase for the wrong reason."""

    def advance(self, tick: int, signals: list[float], other_phase: int) -> PhaseSwitch | None:
        switch = super().advance(tick, signals, other_phase)
        return None if switch is None else switch._replace(cause="something")


class LeavesWithoutReport(GaitStateMachine):
    """The phase changes and no switch is reported."""

    def advance(self, tick: int, signals: list[float], other_phase: int) -> None:
        super().advance(tick, signals, other_phase)


@pytest.mark.parametrize(
    ("broken", "part"),
    [
        (ForgivesNaN, "rejects signals that are NaN"),
        (CountsAllOpenTicks, "debounce: one closed tick"),
        (NeverResetsItsClock, "clock: "),
        (IgnoresTheOtherLeg, "while the other leg is in"),
        (ReportsAnotherCause, "fires just past"),
        (LeavesWithoutReport, "fires just past"),
    ],
)
def test_broken_machine_fails_the_tests_of_what_is_broken(broken: type[GaitStateMachine], part: str) -> None:
    table = rich_table()
    failed = failures(table, lambda phase: broken(table, Side.LEFT, initial_phase=phase))
    assert any(part in name for name in failed), failed
    assert len(failed) < len(rich_tests())


def test_machine_of_the_package_fails_nothing() -> None:
    table = rich_table()
    assert failures(table, lambda phase: GaitStateMachine(table, Side.RIGHT, initial_phase=phase)) == []


def test_failure_states_tick_phase_expectation_and_measurements() -> None:
    table = rich_table()
    test = next(
        item
        for item in transition_tests(
            table, lambda phase: ReportsAnotherCause(table, Side.LEFT, initial_phase=phase)
        )
        if "fires just past hip.angle_deg < -8" in item.name
    )
    expected = ("tick 24", "stance", "(24, 'stance', 'swing', 'ready')")
    with raises(AssertionError, *expected) as caught:
        test.run()
    assert "'something')" in str(caught.value)
    assert "'hip.angle_deg': -8.000000008" in str(caught.value)


def edited(**changes: object) -> GaitTable:
    return replace(rich_table(), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "table",
    [
        edited(
            transitions=tuple(
                replace(item, debounce_ticks=item.debounce_ticks + 1) for item in rich_table().transitions
            )
        ),
        edited(transitions=rich_table().transitions[1::-1] + rich_table().transitions[2:]),
        edited(transitions=rich_table().transitions[:1] + rich_table().transitions[2:]),
        edited(phases={**rich_table().phases, "swing": phase(minimum_ticks=13)}),
        edited(phases={**rich_table().phases, "swing": phase(minimum_ticks=12, gravity_compensation=0.1)}),
        edited(side_phases={Side.LEFT: {"swing": phase(minimum_ticks=14)}}),
        edited(blending=replace(rich_table().blending, duration_ticks=61)),
        edited(scaling=replace(rich_table().scaling, speed=0.4)),
    ],
    ids=["debounce", "order", "exit", "minimum duration", "gravity", "side", "blending", "scaling"],
)
def test_approved_text_detects_an_edit(table: GaitTable, tmp_path: Path) -> None:
    path = tmp_path / "rich.md"
    path.write_text(approval_text(rich_table()), encoding="utf-8")
    assert check_approved(path, approval_text(rich_table())) is None
    problem = check_approved(path, approval_text(table))
    assert problem is not None
    assert any(line.startswith("+") for line in problem.splitlines()[2:]) or "\n-" in problem


def test_approved_text_is_the_same_for_the_same_table() -> None:
    assert approval_text(rich_table()) == approval_text(rich_table())
    assert "| stance | swing  | ready " in approval_text(rich_table())


def test_guard_that_leaves_too_many_choices_is_reported_and_not_an_error(monkeypatch) -> None:
    monkeypatch.setattr("twin_gait.gait.feasibility.MAX_BRANCHES", 3)
    tests = transition_tests(rich_table())
    undecided = [test.undecided for test in tests if test.undecided is not None]
    assert undecided and all("too many choices" in text for text in undecided)
    for test in tests:
        test.run()


# ---------------------------------------------------------------------- machines in C


@pytest.mark.parametrize("table", [*packaged_gait_tables(), "rich"])
def test_tables_pass_in_c(table: str) -> None:
    require_tools("gcc")
    made = rich_table() if table == "rich" else load_gait_table(table)
    (machine,) = compiled_machines([made])
    tests = [test for test in transition_tests(made, machine) if test.undecided is None]
    for test in tests:
        test.run()
    assert tests


def test_the_machine_in_c_leaves_the_choice_to_c(monkeypatch) -> None:
    require_tools("gcc")
    (machine,) = compiled_machines([rich_table()])
    monkeypatch.setattr("twin_gait.gait.machine.next_transition", None)
    assert failures(rich_table(), machine) == []


def trunk_table() -> GaitTable:
    return two_phase_table(
        transition("stance", "swing", "trunk.pitch_deg > 5", cause="bent", debounce_ticks=3),
        transition("stance", "swing", "trunk.pitch_deg - hip.angle_deg < -3", cause="apart"),
    )


def test_the_trunk_is_driven_like_any_signal() -> None:
    tests = {test.name: test for test in transition_tests(trunk_table())}
    for claim in ("fires just past", "holds just below", "holds on the threshold of"):
        test = tests[f"stance→swing (bent)::{claim} trunk.pitch_deg > 5"]
        assert test.undecided is None
        test.run()
    assert failures(trunk_table(), lambda phase: Upright(trunk_table(), phase))  # a machine that reads none
    (machine,) = compiled_machines([trunk_table()])
    assert not failures(trunk_table(), machine)


class Upright(GaitStateMachine):
    """Takes the trunk for upright."""

    def __init__(self, table: GaitTable, phase: str) -> None:
        super().__init__(table, Side.LEFT, initial_phase=phase)

    def step(self, tick, signals, *member):
        return super().step(tick, {**signals, "trunk.pitch_deg": 0.0}, *member)


def test_tables_larger_than_the_bits_of_the_device_are_refused() -> None:
    """The results of conditions, and phases, are bits of one number of 32."""
    many = [guard(f"hip.angle_deg > {number}") for number in range(31)]
    nested = AnyOf(guards=(AnyOf(guards=tuple(many[:30])), many[30]))
    back = transition("swing", "stance", "hip.angle_deg < -2")
    wide = two_phase_table(transition("stance", "swing", AnyOf(guards=tuple(many)), cause="wide"), back)
    with raises(GaitTableError, "wide", "31", "30"):
        compiled_machines([wide])
    assert compiled_machines([two_phase_table(transition("stance", "swing", nested), back)])

    names = [f"phase_{number}" for number in range(31)]
    ring = [transition(one, two, "hip.angle_deg > 3") for one, two in pairwise([*names, names[0]])]
    table = GaitTable(
        name="long", joints=JOINTS, phases=dict.fromkeys(names, phase()), transitions=tuple(ring)
    )
    with raises(GaitTableError, "31", "30"):
        compiled_machines([table])
