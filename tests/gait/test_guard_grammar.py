"""Tests of the text of a guard: accepted syntax, and explanation of mistakes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table_builder import JOINTS, transition, two_phase_table

from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.guards import (
    LEG_VOCABULARY,
    AllOf,
    AnyOf,
    Comparison,
    Guard,
    PhaseMembership,
    parse_guard,
)
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import DEVICE_NAMES, all_signal_names, find_signal, signal_names, signal_scale
from twin_gait.vocabulary import GaitPhase

PHASES = tuple(str(phase) for phase in GaitPhase)
NAMES = all_signal_names(JOINTS)


def parse(text: str) -> Guard:
    """Parse a guard in a table with the five phases."""
    parsed = parse_guard(text)
    table = load_gait_table("treadmill_guided")
    first, *others = table.transitions
    return replace(table, transitions=(replace(first, guard=parsed), *others)).transitions[0].guard


@st.composite
def comparisons(draw: st.DrawFn) -> Comparison:
    signal = draw(st.sampled_from(NAMES))
    others = [name for name in NAMES if find_signal(name).unit == find_signal(signal).unit]
    return Comparison(
        signal=signal,
        minus=draw(st.none() | st.sampled_from(others)),
        operator=draw(st.sampled_from("<>")),
        threshold=draw(st.floats(allow_nan=False, allow_infinity=False)),
    )


@given(comparison=comparisons())
def test_comparison_survives_writing_and_reading(comparison: Comparison) -> None:
    assert parse(str(comparison)) == comparison


@given(phases=st.lists(st.sampled_from(PHASES), min_size=1, max_size=5, unique=True))
def test_membership_survives_writing_and_reading(phases: list[str]) -> None:
    membership = PhaseMembership(phases=tuple(phases))
    assert parse(str(membership)) == membership


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("hip.angle_deg < -8", ("hip.angle_deg", None, "<", -8.0)),
        ("  knee.velocity_deg_per_s>1e2 ", ("knee.velocity_deg_per_s", None, ">", 100.0)),
        ("other.hip.angle_deg - hip.angle_deg > 10", ("other.hip.angle_deg", "hip.angle_deg", ">", 10.0)),
        ("hip.angle_deg-knee.angle_deg<+.5", ("hip.angle_deg", "knee.angle_deg", "<", 0.5)),
        ("foot.load_bw > 0.05", ("foot.load_bw", None, ">", 0.05)),
        ("time_in_phase_s > 0.15", ("time_in_phase_s", None, ">", 0.15)),
        ("other.time_in_phase_s < 2.", ("other.time_in_phase_s", None, "<", 2.0)),
    ],
)
def test_comparisons_are_read(text: str, expected: tuple[str, str | None, str, float]) -> None:
    signal, minus, operator, threshold = expected
    assert parse(text) == Comparison(signal=signal, minus=minus, operator=operator, threshold=threshold)


def test_membership_is_read_with_any_spacing() -> None:
    expected = PhaseMembership(phases=("early_stance", "late_stance"))
    assert parse("other.phase in [early_stance,late_stance]") == expected
    assert parse("  other.phase  in  [ early_stance , late_stance ] ") == expected


@pytest.mark.parametrize(
    ("text", "explained"),
    [
        ("hip.angel_deg < 3", "hip.angel_deg"),
        ("ankle.angle_deg < 3", "ankle.angle_deg"),
        ("hip.angle_rad < 3", "hip.angle_deg"),
        ("other.other.hip.angle_deg < 3", "other.other.hip.angle_deg"),
        ("hip.angle_deg - thigh.angle_deg < 3", "thigh.angle_deg"),
        ("other.phase in [midstance]", "midstance"),
        ("other.phase in [early_stance, ]swing", "expected"),
        ("other.phase in []", "at least one phase"),
        ("other.phase in [ , ]", "at least one phase"),
        ("phase in [early_stance]", "expected"),
        ("hip.angle_deg <= 3", "strict"),
        ("hip.angle_deg >= 3", "strict"),
        ("hip.angle_deg == 3", "strict"),
        ("hip.angle_deg = 3", "strict"),
        ("hip.angle_deg != 3", "expected"),
        ("hip.angle_deg < knee.angle_deg", "expected"),
        ("hip.angle_deg + knee.angle_deg < 3", "expected"),
        ("2 * hip.angle_deg < 3", "expected"),
        ("3 < hip.angle_deg", "expected"),
        ("hip.angle_deg < 3 and knee.angle_deg > 2", "expected"),
        ("hip.angle_deg <", "expected"),
        ("hip.angle_deg", "expected"),
        ("hip.angle_deg < nan", "expected"),
        ("hip.angle_deg < inf", "expected"),
        ("hip.angle_deg < 1e999", "finite"),
        ("hip.angle_deg < 0x10", "expected"),
        ("hip.angle_deg - foot.load_bw < 3", "different units"),
        ("hip.velocity_deg_per_s - knee.angle_deg > 3", "different units: deg/s and deg"),
        ("time_in_phase_s - other.foot.load_bw > 3", "different units: s and body weights"),
        ("foot.load_bw - walk < 3", "different units: body weights and no unit"),
        ("", "expected"),
        ("hip.angle_deg\n<\n3 ]", "expected"),
    ],
)
def test_mistakes_are_explained_in_one_line(text: str, explained: str) -> None:
    with pytest.raises(TwinGaitError) as caught:
        parse(text)
    message = str(caught.value)
    assert explained in message
    assert "\n" not in message
    assert repr(text) in message


@given(text=st.text(max_size=40))
def test_any_text_is_a_guard_or_an_error_of_this_package(text: str) -> None:
    try:
        parsed = parse(text)
    except TwinGaitError as error:
        assert len(str(error).splitlines()) == 1
    else:
        assert isinstance(parsed, (Comparison, PhaseMembership))


def test_signals_of_a_leg_come_joint_by_joint() -> None:
    own = signal_names(("hip", "knee"))
    known = ("hip.angle_deg", "hip.velocity_deg_per_s", "knee.angle_deg", "knee.velocity_deg_per_s")
    indices = [own.index(name) for name in (*known, "foot.load_bw", "time_in_phase_s")]
    assert indices == sorted(indices)
    assert (*own, *(f"other.{name}" for name in own), *DEVICE_NAMES) == NAMES


def test_table_with_an_ankle_has_signals_for_it() -> None:
    assert (
        LEG_VOCABULARY.find_problem(parse_guard("ankle.angle_deg > 5"), ("hip", "knee", "ankle"), PHASES)
        == ""
    )


def test_degrees_are_scaled_and_other_units_are_not() -> None:
    degree = 2.0 * math.pi / 360.0
    expected = {
        "hip.angle_deg": degree,
        "hip.velocity_deg_per_s": degree,
        "knee.angle_deg": degree,
        "knee.velocity_deg_per_s": degree,
        "foot.load_bw": 1.0,
        "time_in_phase_s": 1.0,
    }
    assert {name: signal_scale(name) for name in expected} == expected


def test_tree_is_written_with_brackets_where_all_and_any_meet() -> None:
    first, second, third = (parse(f"hip.angle_deg > {k}") for k in (1, 2, 3))
    tree = AllOf(guards=(first, AnyOf(guards=(second, third))))
    assert str(tree) == "hip.angle_deg > 1 and (hip.angle_deg > 2 or hip.angle_deg > 3)"
    assert str(AnyOf(guards=(AllOf(guards=(first, second)), third))) == (
        "(hip.angle_deg > 1 and hip.angle_deg > 2) or hip.angle_deg > 3"
    )
    assert str(AllOf(guards=())) == "true"


@pytest.mark.parametrize(
    "wrong",
    [
        Comparison(signal="hip.angel_deg", minus=None, operator=">", threshold=3.0),
        Comparison(signal="hip.angle_deg", minus="thigh.angle_deg", operator=">", threshold=3.0),
    ],
    ids=["signal", "subtracted signal"],
)
def test_a_signal_unknown_to_the_table_is_refused_when_it_is_built_in_python(wrong: Comparison) -> None:
    with pytest.raises(TwinGaitError) as caught:
        compile_guards(two_phase_table(transition("stance", "swing", wrong)))
    unknown = wrong.signal if wrong.minus is None else wrong.minus
    assert unknown in str(caught.value)


@pytest.mark.parametrize(
    ("operator", "threshold"),
    [(">=", 3.0), ("=>", 3.0), ("", 3.0), (">", math.nan), ("<", math.inf)],
)
def test_a_comparison_built_in_python_is_validated_like_one_in_a_file(
    operator: str, threshold: float
) -> None:
    """Otherwise ``>=`` silently means ``<``."""
    with pytest.raises(TwinGaitError):
        compile_guards(
            two_phase_table(
                transition(
                    "stance",
                    "swing",
                    Comparison(signal="hip.angle_deg", minus=None, operator=operator, threshold=threshold),
                )
            )
        )


def test_an_empty_disjunction_is_refused() -> None:
    """It could never open."""
    with pytest.raises(TwinGaitError):
        two_phase_table(transition("stance", "swing", AnyOf(guards=())))
