"""The one evaluator of guards, against plain recursion over the guard tree."""

from __future__ import annotations

import math

import pytest
from guard_solver import holds
from hypothesis import given, settings
from hypothesis import strategies as st
from table_builder import JOINTS, guard, transition, two_phase_table

from twin_gait.core.guards import NO_TRANSITION, evaluate_guard, next_transition
from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import all_signal_names, find_signal, signal_scale

NAMES = all_signal_names(JOINTS)
PHASES = ("stance", "swing")


def evaluate(tree: Guard, signals: dict[str, float], other_phase: str | None) -> bool:
    """Compile a guard and let the core evaluate it; signals in the units of the table."""
    program = compile_guards(two_phase_table(transition("stance", "swing", tree, timeout_ticks=1)))
    measured = [signals[name] * signal_scale(name) for name in NAMES]
    index = -1 if other_phase is None else PHASES.index(other_phase)
    rule = program.transitions[0]
    return evaluate_guard(program, rule.first_node, rule.end_node, measured, index)


def signals_of(**known: float) -> dict[str, float]:
    return dict.fromkeys(NAMES, 0.0) | {name.replace("__", "."): value for name, value in known.items()}


def same_unit(name: str) -> list[str]:
    return [other for other in NAMES if find_signal(other).unit == find_signal(name).unit and other != name]


@st.composite
def atoms(draw: st.DrawFn) -> Guard:
    if draw(st.integers(0, 4)) == 0:
        members = draw(st.lists(st.sampled_from(PHASES), min_size=1, max_size=2, unique=True))
        return PhaseMembership(phases=tuple(members))
    signal = draw(st.sampled_from(NAMES))
    minus = draw(st.none() | st.sampled_from(same_unit(signal)))
    # Signals below are whole numbers; half a unit between keeps rounding of differences out.
    threshold = draw(st.integers(-20, 20)) + (0.0 if minus is None else 0.5)
    return Comparison(
        signal=signal, minus=minus, operator=draw(st.sampled_from("<>")), threshold=float(threshold)
    )


trees = st.recursive(
    atoms(),
    lambda inner: st.lists(inner, min_size=1, max_size=4).flatmap(
        lambda guards: st.sampled_from([AllOf(guards=tuple(guards)), AnyOf(guards=tuple(guards))])
    ),
    max_leaves=15,
)
values = st.integers(-25, 25).map(float)


@settings(max_examples=100)
@given(
    tree=trees,
    numbers=st.lists(values, min_size=len(NAMES), max_size=len(NAMES)),
    other_phase=st.sampled_from([*PHASES, None]),
)
def test_core_agrees_with_recursion_over_the_tree(
    tree: Guard, numbers: list[float], other_phase: str | None
) -> None:
    signals = dict(zip(NAMES, numbers, strict=True))
    assert evaluate(tree, signals, other_phase) is holds(tree, signals, other_phase)


@given(
    tree=trees,
    numbers=st.lists(values | st.just(math.nan), min_size=len(NAMES), max_size=len(NAMES)),
    other_phase=st.sampled_from([*PHASES, None]),
)
def test_core_agrees_with_recursion_when_signals_are_missing(
    tree: Guard, numbers: list[float], other_phase: str | None
) -> None:
    signals = dict(zip(NAMES, numbers, strict=True))
    assert evaluate(tree, signals, other_phase) is holds(tree, signals, other_phase)


@given(tree=trees)
def test_nothing_measured_opens_no_guard(tree: Guard) -> None:
    assert not evaluate(tree, dict.fromkeys(NAMES, math.nan), None)


@given(operator=st.sampled_from("<>"), threshold=st.floats(-180.0, 180.0), name=st.sampled_from(NAMES))
def test_inequalities_are_strict(operator: str, threshold: float, name: str) -> None:
    atom = Comparison(signal=name, minus=None, operator=operator, threshold=threshold)
    outwards = math.inf if operator == ">" else -math.inf
    just_beyond = threshold + math.copysign(max(abs(threshold), 1.0) * 1e-12, outwards)
    assert not evaluate(atom, signals_of(**{name: threshold}), None)
    assert evaluate(atom, signals_of(**{name: just_beyond}), None)


@pytest.mark.parametrize("name", ["hip.angle_deg", "other.knee.velocity_deg_per_s"])
def test_thresholds_in_degrees_are_compared_in_radians(name: str) -> None:
    program = compile_guards(two_phase_table(transition("stance", "swing", f"{name} > 30")))
    signals = [0.0] * len(NAMES)
    for value, expected in ((0.5235, False), (0.5237, True)):  # π/6 = 0.523599
        signals[NAMES.index(name)] = value
        assert evaluate_guard(program, 0, 1, signals, -1) is expected


@pytest.mark.parametrize("name", ["foot.load_bw", "time_in_phase_s"])
def test_loads_and_times_are_not_scaled(name: str) -> None:
    assert evaluate(guard(f"{name} > 0.3"), signals_of(**{name: 0.31}), None)
    assert not evaluate(guard(f"{name} > 0.3"), signals_of(**{name: 0.29}), None)


@pytest.mark.parametrize("count", [1, 2, 31, 32, 62, 63, 64, 100])
@pytest.mark.parametrize("last_is_open", [True, False])
def test_long_conjunctions_are_evaluated_to_their_last_member_or_refused(
    count: int, last_is_open: bool
) -> None:
    """Results are bits of one integer: its width must not cut a conjunction short."""
    opened, shut = guard("hip.angle_deg > 0"), guard("hip.angle_deg < 0")
    tree = AllOf(guards=(*[opened] * (count - 1), opened if last_is_open else shut))
    try:
        result = evaluate(tree, signals_of(**{"hip.angle_deg": 1.0}), None)
    except TwinGaitError:
        assert count > 32
    else:
        assert result is last_is_open


def test_empty_conjunction_is_open() -> None:
    """A pure timeout has no guard beside the time."""
    assert evaluate(AllOf(guards=()), signals_of(), None)


def test_membership_needs_the_other_leg() -> None:
    tree = guard("other.phase in [stance, swing]")
    assert evaluate(tree, signals_of(), "stance")
    assert not evaluate(tree, signals_of(), None)


def test_debounce_of_every_exit_is_counted_and_others_are_reset() -> None:
    """The counters belong to consecutive ticks with an open guard in the present phase."""
    program = compile_guards(
        two_phase_table(
            transition("stance", "swing", "hip.angle_deg > 10", debounce_ticks=100),
            transition("stance", "swing", "knee.angle_deg > 10", debounce_ticks=100),
        )
    )
    debounce = [0, 7, 9]
    signals = [0.0] * len(NAMES)
    signals[NAMES.index("hip.angle_deg")] = 1.0
    for tick in range(1, 4):
        assert next_transition(program, 0, tick, signals, -1, debounce) == NO_TRANSITION
        assert debounce == [tick, 0, 0]


def test_entries_past_the_number_of_transitions_mean_nothing() -> None:
    """The compiled engine fills its lists up."""
    lifted = transition("stance", "swing", "hip.angle_deg > 10")
    table = two_phase_table(lifted, transition("stance", "swing", "knee.angle_deg > 10"))
    program, debounce = compile_guards(table), [0, 0, 0]
    signals = [0.0] * len(NAMES)
    signals[NAMES.index("knee.angle_deg")] = 1.0
    assert next_transition(program, 0, 1, signals, -1, debounce) == 1
    program.n_transitions = 1
    assert next_transition(program, 0, 2, signals, -1, debounce) == NO_TRANSITION
    assert debounce == [0, 1, 0]


def test_a_table_whose_guards_compare_nothing_is_evaluated():
    """Every node reads a comparison, so that a program has at least one."""
    both = (
        transition("stance", "swing", PhaseMembership(phases=("stance",))),
        transition("swing", "stance", AnyOf(guards=(PhaseMembership(phases=("swing",)),))),
    )
    program = compile_guards(two_phase_table(transitions=both))
    signals = [0.0] * len(NAMES)
    assert next_transition(program, 0, 100, signals, 0, [0, 0]) == 0
    assert next_transition(program, 0, 100, signals, 1, [0, 0]) == NO_TRANSITION
    assert next_transition(program, 1, 100, signals, 1, [0, 0]) == 1
