"""The state machine of a leg on small tables whose thresholds are known."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from table_builder import JOINTS, guard, phase, transition, two_phase_table

from twin_gait.exceptions import GaitTableError, MeasurementError
from twin_gait.gait.guards import AllOf, AnyOf
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import OTHER_TIME, all_signal_names
from twin_gait.gait.table import GaitTable
from twin_gait.vocabulary import Side


def leg(hip: float = 0.0, knee: float = 0.0, load: float = 0.0) -> dict[str, float]:
    """Signals of a leg with angles in degrees."""
    return {
        "hip.angle_deg": hip,
        "knee.angle_deg": knee,
        "hip.velocity_deg_per_s": 0.0,
        "knee.velocity_deg_per_s": 0.0,
        "foot.load_bw": load,
    }


def legs(own: dict[str, float], other: dict[str, float], other_time: float = 0.0) -> dict[str, float]:
    """Signals of both."""
    return {**own, **{f"other.{name}": value for name, value in other.items()}, OTHER_TIME: other_time}


def machine(*leaving_stance: object, **changes: object) -> GaitStateMachine:
    return GaitStateMachine(two_phase_table(*leaving_stance, **changes), Side.LEFT)  # type: ignore[arg-type]


def switches(fsm: GaitStateMachine, hips: list[float], first_tick: int = 1) -> list[PhaseSwitch]:
    """Step through hip angles in degrees, one a tick."""
    found = [fsm.step(first_tick + k, leg(hip)) for k, hip in enumerate(hips)]
    return [item for item in found if item is not None]


def test_leg_switches_in_the_tick_in_which_its_guard_becomes_true() -> None:
    fsm = machine(transition("stance", "swing", "hip.angle_deg > 10", cause="lifted"))
    assert switches(fsm, [9.0, 9.99, 10.01]) == [PhaseSwitch(3, Side.LEFT, "stance", "swing", "lifted", 0)]
    assert fsm.phase == "swing"
    assert fsm.phase_index == 1
    assert fsm.entry_tick == 3
    assert fsm.time_in_phase(13) == pytest.approx(0.010)


def test_switch_has_its_time_in_seconds() -> None:
    assert PhaseSwitch(1234, Side.LEFT, "stance", "swing", "lifted", 0).time == pytest.approx(1.234)


def test_guard_at_its_threshold_is_closed() -> None:
    assert switches(machine(), [10.0] * 5) == []


@pytest.mark.parametrize("debounce", [1, 2, 5])
def test_guard_has_to_hold_on_consecutive_ticks(debounce: int) -> None:
    entry = transition("stance", "swing", "hip.angle_deg > 10", debounce_ticks=debounce)
    assert switches(machine(entry), [20.0] * (debounce - 1)) == []
    assert [item.tick for item in switches(machine(entry), [20.0] * debounce)] == [debounce]
    interrupted = [20.0] * (debounce - 1) + [0.0] + [20.0] * debounce
    assert [item.tick for item in switches(machine(entry), interrupted)] == [2 * debounce]


def test_debounce_starts_anew_when_a_phase_is_entered_again() -> None:
    """Two of three ticks before leaving by another exit must not count after coming back."""
    table = two_phase_table(
        transition("stance", "swing", "hip.angle_deg > 10", cause="slow", debounce_ticks=3),
        transition("stance", "swing", "knee.angle_deg > 10", cause="fast"),
        transition("swing", "stance", "knee.angle_deg < -10", cause="back"),
    )
    fsm = GaitStateMachine(table, Side.LEFT)
    path = [leg(20, 0), leg(20, 20), leg(20, -20), leg(20, 0), leg(20, 0), leg(20, 0)]
    causes = [(tick, found.cause) for tick, item in enumerate(path) if (found := fsm.step(tick, item))]
    assert causes == [(1, "fast"), (2, "back"), (5, "slow")]


def test_phase_is_not_left_before_its_minimum_duration() -> None:
    phases = {"stance": phase(minimum_ticks=5), "swing": phase()}
    fsm = machine(transition("stance", "swing", "hip.angle_deg > 10"), phases=phases)
    assert [item.tick for item in switches(fsm, [20.0] * 10)] == [5]


def test_minimum_duration_counts_from_the_entry() -> None:
    table = two_phase_table(
        transition("stance", "swing", "hip.angle_deg > 10"),
        transition("swing", "stance", "hip.angle_deg > 10"),
        phases={"stance": phase(minimum_ticks=4), "swing": phase(minimum_ticks=7)},
    )
    found = switches(GaitStateMachine(table, Side.LEFT), [20.0] * 30)
    assert [item.tick for item in found] == [4, 11, 15, 22, 26]


@pytest.mark.parametrize("after", [1, 7, 1000])
def test_timeout_fires_at_its_tick_and_not_before(after: int) -> None:
    fsm = machine(transition("stance", "swing", timeout_ticks=after, cause="timeout"))
    assert switches(fsm, [0.0] * (after - 1)) == []
    assert switches(fsm, [0.0], first_tick=after) == [
        PhaseSwitch(after, Side.LEFT, "stance", "swing", "timeout", 0)
    ]


def test_timeout_with_a_guard_needs_both() -> None:
    entry = transition("stance", "swing", "hip.angle_deg > 10", timeout_ticks=5)
    assert [item.tick for item in switches(machine(entry), [20.0] * 8)] == [5]
    assert [item.tick for item in switches(machine(entry), [0.0] * 8 + [20.0])] == [9]


@pytest.mark.parametrize("order", [*itertools.permutations(["hip.angle_deg > 10", "knee.angle_deg > 10"])])
def test_first_listed_of_two_open_exits_wins(order: tuple[str, str]) -> None:
    entries = [transition("stance", "swing", text, cause=text) for text in order]
    fsm = machine(*entries)
    switch = fsm.step(1, leg(20, 20))
    assert switch is not None
    assert (switch.cause, switch.transition) == (order[0], 0)


def test_lower_exit_fires_while_the_exits_above_are_closed() -> None:
    fsm = machine(
        transition("stance", "swing", "hip.angle_deg > 10", cause="first"),
        transition("stance", "swing", "knee.angle_deg > 10", cause="second"),
    )
    switch = fsm.step(1, leg(0, 20))
    assert switch is not None
    assert (switch.cause, switch.transition) == ("second", 1)


def test_at_most_one_switch_a_tick() -> None:
    """Both guards are open for ever: the leg alternates, one phase a tick."""
    table = two_phase_table(
        transition("stance", "swing", "hip.angle_deg > 10"),
        transition("swing", "stance", "hip.angle_deg > 10"),
    )
    found = switches(GaitStateMachine(table, Side.LEFT), [20.0] * 6)
    assert [item.tick for item in found] == [1, 2, 3, 4, 5, 6]
    assert [item.target for item in found] == ["swing", "stance"] * 3


def test_time_in_phase_is_a_signal() -> None:
    fsm = machine(transition("stance", "swing", "time_in_phase_s > 0.15"))
    assert [item.tick for item in switches(fsm, [0.0] * 160)] == [151]


def test_other_leg_is_read_in_its_phase_at_the_start_of_the_tick() -> None:
    """Two legs that may only leave stance while the other is in stance: the later one must wait."""
    open_guard = AllOf(guards=(guard("hip.angle_deg > 10"), guard("other.phase in [stance]")))
    table = two_phase_table(transition("stance", "swing", open_guard))
    left, right = GaitStateMachine(table, Side.LEFT), GaitStateMachine(table, Side.RIGHT)
    snapshot = left.phase, right.phase
    both = [
        left.step(1, legs(leg(20), leg(20)), snapshot[1]),
        right.step(1, legs(leg(20), leg(20)), snapshot[0]),
    ]
    assert [item.side if item else None for item in both] == [Side.LEFT, Side.RIGHT]
    waiting = GaitStateMachine(table, Side.LEFT)
    assert waiting.step(1, legs(leg(20), leg(20)), "swing") is None


def test_signals_of_the_other_leg_are_its_own() -> None:
    fsm = machine(transition("stance", "swing", "other.hip.angle_deg - hip.angle_deg > 10"))
    assert fsm.step(1, legs(leg(20), leg(9)), "stance") is None
    assert fsm.step(2, legs(leg(0), leg(9)), "stance") is None
    assert fsm.step(3, legs(leg(0), leg(11)), "stance") is not None


def test_time_of_the_other_leg_in_its_phase_is_a_signal() -> None:
    fsm = machine(transition("stance", "swing", "other.time_in_phase_s > 0.1"))
    assert fsm.step(1, legs(leg(), leg(), 0.1), "stance") is None
    assert fsm.step(2, legs(leg(), leg(), 0.101), "stance") is not None


def test_bench_leg_without_another_leg_takes_guards_on_its_own_signals() -> None:
    own_or_other = AnyOf(guards=(guard("other.hip.angle_deg > -500"), guard("hip.angle_deg > 10")))
    fsm = machine(transition("stance", "swing", own_or_other))
    assert fsm.step(1, leg(0)) is None
    assert fsm.step(2, leg(20)) is not None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("named", leg())
def test_measurement_that_is_not_finite_is_refused_by_name(named: str, bad: float) -> None:
    """Also where no guard reads it: a broken sensor must not pass in silence."""
    fsm, broken = machine(transition("stance", "swing", timeout_ticks=1)), {**leg(), named: bad}
    with raises(MeasurementError, "left", named, bad) as caught:
        fsm.step(5, broken)
    assert len(str(caught.value).splitlines()) == 1
    with raises(MeasurementError, "left", "other", named, bad):
        fsm.step(5, legs(leg(), broken), "stance")
    assert fsm.phase == "stance"


@pytest.mark.parametrize("named", leg())
def test_missing_measurement_is_refused(named: str) -> None:
    fsm, rest = machine(), {name: value for name, value in leg().items() if name != named}
    with raises(MeasurementError, "left", named, "nan"):
        fsm.step(1, rest)
    with raises(MeasurementError, "left", "other", named, "nan"):
        fsm.step(1, legs(leg(), rest), "stance")


def test_a_declared_leg_must_be_measured() -> None:
    with raises(MeasurementError, "left", "other", "hip.angle_deg", "nan"):
        machine().step(1, leg(), "stance")


def test_signals_are_in_the_order_that_guards_read() -> None:
    given = {
        "hip.angle_deg": 1.0,
        "knee.angle_deg": 2.0,
        "hip.velocity_deg_per_s": 3.0,
        "knee.velocity_deg_per_s": 4.0,
        "foot.load_bw": 5.0,
        "time_in_phase_s": 6.0,
        "other.hip.angle_deg": 7.0,
        "other.knee.angle_deg": 8.0,
        "other.hip.velocity_deg_per_s": 9.0,
        "other.knee.velocity_deg_per_s": 10.0,
        "other.foot.load_bw": 11.0,
        "other.time_in_phase_s": 12.0,
        "trunk.pitch_deg": 13.0,
        "step": 0.125,
        "walk": 0.25,
    }
    named = dict(zip(all_signal_names(JOINTS), two_phase_table().to_si(given), strict=True))
    degrees = [name for name in given if "_deg" in name]
    assert [named[name] for name in degrees] == [math.radians(given[name]) for name in degrees]
    assert all(named[name] == given[name] for name in given if name not in degrees)
    own = {name: value for name, value in given.items() if not name.startswith("other.")}
    alone = dict(zip(named, two_phase_table().to_si(own), strict=True))
    assert all(np.isnan(alone[name]) for name in given if name.startswith("other."))
    assert all(alone[name] == named[name] for name in own)


def test_unknown_phases_are_refused() -> None:
    with raises(GaitTableError, "stance", "swing"):
        GaitStateMachine(two_phase_table(), Side.LEFT, initial_phase="flight")
    with raises(GaitTableError, "stance", "swing"):
        machine().step(1, legs(leg(), leg()), "flight")


def test_machine_starts_in_the_given_phase() -> None:
    assert GaitStateMachine(two_phase_table(), Side.LEFT, initial_phase="swing").phase == "swing"
    assert machine().phase == "stance"


def test_transitions_library_gives_the_same_switches() -> None:
    fsm = machine()
    assert set(fsm.machine.states) == {"stance", "swing"}
    assert fsm.machine.get_triggers("stance") == ["take_0"]
    assert fsm.machine.get_triggers("swing") == ["take_1"]


def test_two_legs_share_a_program_but_no_state() -> None:
    table = two_phase_table(transition("stance", "swing", "hip.angle_deg > 10", debounce_ticks=2))
    program = compile_guards(table)
    left = GaitStateMachine(table, Side.LEFT, program=program)
    right = GaitStateMachine(table, Side.RIGHT, program=program)
    assert left.step(1, leg(20)) is None
    assert right.step(1, leg(20)) is None
    assert left.step(2, leg(20)) is not None
    assert right.step(2, leg(0)) is None
    assert (left.phase, right.phase) == ("swing", "stance")


def three_phase_table() -> GaitTable:
    return GaitTable(
        name="ring",
        joints=JOINTS,
        phases={name: phase(minimum_ticks=ticks) for name, ticks in (("a", 0), ("b", 3), ("c", 0))},
        transitions=(
            transition("a", "b", guard("hip.angle_deg > 10")),
            transition("a", "b", timeout_ticks=20),
            transition("b", "c", guard("knee.angle_deg > 10"), debounce_ticks=2),
            transition("b", "a", guard("hip.angle_deg < -10")),
            transition("c", "a", guard("foot.load_bw > 0.5")),
        ),
    )


@given(
    steps=st.lists(
        st.tuples(st.floats(-30, 30), st.floats(-30, 30), st.floats(0, 1), st.integers(1, 12)), max_size=40
    )
)
def test_any_measurements_keep_the_leg_in_the_cycle(steps: list[tuple[float, float, float, int]]) -> None:
    table = three_phase_table()
    fsm = GaitStateMachine(table, Side.RIGHT)
    listed = {(item.source, item.target) for item in table.transitions}
    tick, before = 0, fsm.phase
    for hip, knee, load, repeats in steps:
        for _ in range(repeats):
            tick += 1
            switch = fsm.step(tick, leg(hip, knee, load=load))
            if switch is None:
                assert fsm.phase == before
            else:
                assert (before, fsm.phase) == (switch.source, switch.target)
                assert (switch.source, switch.target) in listed
                assert table.transitions[switch.transition].cause == switch.cause
            before = fsm.phase
