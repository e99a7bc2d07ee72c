"""Malformed gait tables end in one clear line, on loading, compiling and checking; never a traceback."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from errors import raises
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from twin_gait.checking import exits, graph
from twin_gait.checking.check import build_case, check, load_case, report
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.experiments import load_experiment
from twin_gait.configuration.gait_table_file import gait_table_from_mapping, named_file
from twin_gait.configuration.validation import parse_yaml
from twin_gait.exceptions import GaitTableError, TwinGaitError
from twin_gait.gait.guards import parse_guard
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import MAX_TICKS, JointImpedance
from twin_gait.parameters.quantities import declarations

GUARD_RULES = [rule for module in (graph, exits) for rule in module.RULES]
# Shrinking such trees takes minutes.
quick = settings(
    max_examples=60,
    deadline=None,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@cache
def shipped(name: str) -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load(named_file(name).read_text(encoding="utf-8"))
    return data


def assert_one_line(error: TwinGaitError) -> None:
    message = str(error)
    assert message.strip()
    assert len(message.splitlines()) == 1, message
    assert len(message) < 2000


def ends_well(data: dict[str, Any]) -> bool:
    """Load a table and check its guards: a report, or one line. Whether it could be loaded."""
    try:
        table = gait_table_from_mapping(data, "fuzz.yaml", "fuzz")
    except TwinGaitError as error:
        assert_one_line(error)
        assert str(error).startswith("fuzz.yaml")
        return False
    try:
        case = build_case(table)
        found = check(case, GUARD_RULES)
    except TwinGaitError as error:
        assert_one_line(error)
    else:
        assert len(report(case, found)["findings"]) == len(found)
    return True


# ---------------------------------------------------------------------------------- guards

signals = st.sampled_from(
    ["hip.angle_deg", "knee.velocity_deg_per_s", "other.hip.angle_deg", "foot.load_bw", "time_in_phase_s",
     "other.phase", "other.time_in_phase_s", "other.other.hip.angle_deg", "toe.angle_deg", "hip"]
)  # fmt: skip
numbers = st.one_of(
    st.floats().map(str),
    st.integers().map(str),
    st.sampled_from(["1e999", "-0", "+.5", "1_000", "٣", "0x10", "1e-400", ".", "−3"]),
)
operators = st.sampled_from(["<", ">", "<=", "==", "=", "in", "and", "<>", "≤"])
pieces = st.one_of(
    signals, numbers, operators, st.sampled_from(["-", "[", "]", ",", "early_stance", "\n", " "])
)
guard_texts = st.one_of(
    st.builds("{} {} {}".format, signals, operators, numbers),
    st.builds("{} - {} {} {}".format, signals, signals, operators, numbers),
    st.builds("other.phase in [{}]".format, st.text(max_size=12)),
    st.lists(pieces, max_size=8).map(" ".join),
    st.text(max_size=20),
)


@settings(max_examples=600, deadline=None)
@given(text=guard_texts)
def test_guard_text_is_a_guard_or_one_line(text: str) -> None:
    try:
        parsed = parse_guard(text)
    except GaitTableError as error:
        # The file's name and one line are put around it when it comes from a file.
        assert str(error).strip()
    else:
        assert parse_guard(str(parsed)) == parsed


guards = st.recursive(
    guard_texts
    | st.sampled_from(["hip.angle_deg > 3", "other.phase in [late_stance]", "knee.angle_deg < 9"]),
    lambda inner: st.dictionaries(
        st.sampled_from(["all", "any"]), st.lists(inner, min_size=1, max_size=3), max_size=1
    ),
    max_leaves=8,
)


@quick
@given(guard=guards, joint=st.sampled_from(["all", "any"]))
def test_table_with_any_guard_ends_in_a_report_or_in_one_line(guard: Any, joint: str) -> None:
    data = copy.deepcopy(shipped("treadmill_guided"))
    entry = data["transitions"][0]
    entry.pop("all")
    entry[joint] = [guard]
    ends_well(data)


true_guards = st.recursive(
    st.builds(
        "{} {} {}".format,
        st.sampled_from(
            ["hip.angle_deg", "knee.velocity_deg_per_s", "foot.load_bw", "time_in_phase_s",
             "other.knee.angle_deg", "other.time_in_phase_s", "other.hip.angle_deg - hip.angle_deg"]
        ),
        st.sampled_from(["<", ">"]),
        st.floats(-1e308, 1e308) | st.floats(-50, 50) | st.sampled_from([0.0, -0.0, 1e-320, 0.001]),
    )
    | st.sampled_from(["other.phase in [early_stance]", "other.phase in [swing_flexion, late_stance]"]),
    lambda inner: st.dictionaries(
        st.sampled_from(["all", "any"]), st.lists(inner, min_size=1, max_size=3), min_size=1, max_size=1
    ),
    max_leaves=10,
)  # fmt: skip


@settings(quick, max_examples=12)
@given(data=st.data())
def test_every_well_formed_table_can_be_checked(data: st.DataObject) -> None:
    """Guards, targets, debounces and times at random: loaded always, and checked to the end."""
    tree = copy.deepcopy(shipped("treadmill_guided"))
    tree.pop("waive", None)
    for entry in tree["transitions"]:
        targets = [phase for phase in tree["phases"] if phase != entry["from"]]
        entry["to"] = data.draw(st.sampled_from(targets))
        if "after_s" not in entry and data.draw(st.booleans()):
            entry.pop("all")
            entry["any"] = [data.draw(true_guards)]
            entry["debounce_ms"] = data.draw(st.integers(1, MAX_TICKS))
    assert ends_well(tree)


# ---------------------------------------------------------------------------------- trees

words = st.sampled_from(
    ["hip", "knee", "early_stance", "flight", "left", "all", "any", "waive", "cycles", "driven_by", "contact",
     "rule", "reason", "ambiguity", "hip.angle_deg < 3", "1", "", "é\n"]
)  # fmt: skip
trees = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**40), 10**40)
    | st.floats()
    | words
    | st.text(max_size=5)
    | st.dates(),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(words | st.text(max_size=3), inner, max_size=4)
    ),
    max_leaves=10,
)


def entries(tree: Any) -> list[tuple[Any, Any]]:
    """Every container in a tree with each of its keys or indices."""
    keys: list[Any] = (
        list(tree) if isinstance(tree, dict) else list(range(len(tree))) if isinstance(tree, list) else []
    )
    return [entry for key in keys for entry in [(tree, key), *entries(tree[key])]]


@pytest.mark.parametrize("name", ["treadmill_guided", "osl_walking"])
@quick
@given(data=st.data())
def test_damaged_table_ends_in_a_report_or_in_one_line(name: str, data: st.DataObject) -> None:
    tree = copy.deepcopy(shipped(name))
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(entries(tree)))
        action = data.draw(st.sampled_from(["replace", "delete", "copy"]))
        if action == "delete":
            del container[key]
        elif action == "replace":
            container[key] = data.draw(trees)
        else:
            container[key] = copy.deepcopy(data.draw(st.sampled_from([b[k] for b, k in entries(tree)])))
    ends_well(tree)


@quick
@given(
    tree=st.dictionaries(
        words | st.sampled_from(["phases", "transitions", "joints", "schema_version"]), trees
    )
)
def test_any_mapping_ends_in_one_line(tree: dict[str, Any]) -> None:
    assert not ends_well(tree)


@quick
@given(start=st.integers(0, 5000), length=st.integers(1, 200), text=st.text(max_size=5))
def test_text_with_a_removed_part_ends_in_a_report_or_in_one_line(start: int, length: int, text: str) -> None:
    whole = named_file("treadmill_guided").read_text(encoding="utf-8")
    try:
        data = parse_yaml(whole[:start] + text + whole[start + length :], "fuzz.yaml")
    except TwinGaitError as error:
        assert_one_line(error)
    else:
        ends_well(data)


# ---------------------------------------------------------------------------------- by hand


def nested(depth: int) -> Any:
    guard: Any = "hip.angle_deg < 3"
    for level in range(depth):
        guard = {"all" if level % 2 else "any": [guard]}
    return guard


@pytest.mark.parametrize("depth", [10, 60, 150, 400])
def test_deeply_nested_guard_ends_in_a_report_or_in_one_line(depth: int, tmp_path: Path) -> None:
    data = copy.deepcopy(shipped("treadmill_guided"))
    data["transitions"][0]["all"] = [nested(depth)]
    path = tmp_path / "deep.yaml"
    try:
        path.write_text(yaml.safe_dump(data, default_flow_style=True), encoding="utf-8")
    except RecursionError:
        path.write_text("[" * depth, encoding="utf-8")  # what cannot be written can still be typed
    try:
        table = load_case(path).table
    except TwinGaitError as error:
        assert_one_line(error)
    else:
        assert str(table.transitions[0].guard).count("hip") == 1


def test_guard_with_too_many_conditions_is_one_line() -> None:
    data = copy.deepcopy(shipped("treadmill_guided"))
    data["transitions"][0]["all"] = ["hip.angle_deg < 3"] * 70
    table = gait_table_from_mapping(data, "wide.yaml", "wide")
    for action in (compile_guards, build_and_check):
        with raises(TwinGaitError, "62") as caught:
            action(table)
        assert_one_line(caught.value)


def build_and_check(table: Any) -> None:
    check(build_case(table), GUARD_RULES)


@pytest.mark.parametrize(("count", "fits"), [(62, True), (63, False), (200, False)])
def test_number_of_phases_is_limited_by_the_evaluator(count: int, fits: bool) -> None:
    phase = shipped("osl_walking")["phases"]["early_stance"]
    names = [f"p{index}" for index in range(count)]
    data = {
        "schema_version": 2,
        "joints": ["knee", "ankle"],
        "phases": dict.fromkeys(names, phase),
        "transitions": [
            {"from": name, "to": following, "cause": "on", "all": [f"other.phase in [{names[-1]}]"]}
            for name, following in zip(names, [*names[1:], names[0]], strict=True)
        ],
    }
    if fits:
        compile_guards(gait_table_from_mapping(data, "many.yaml", "many"))
        return
    with raises(TwinGaitError, "1", "62") as caught:
        gait_table_from_mapping(data, "many.yaml", "many")
    assert_one_line(caught.value)


def test_largest_numbers_that_a_table_may_hold_are_checked_by_all_rules() -> None:
    data = copy.deepcopy(shipped("treadmill_guided"))
    del data["waive"]
    ranges = {item.name: item.range for item in declarations(JointImpedance)}
    for phase in data["phases"].values():
        phase["hip"] = {
            "stiffness_Nm_per_rad": ranges["stiffness"].maximum,
            "damping_Nms_per_rad": ranges["damping"].maximum,
            "equilibrium_rad": ranges["equilibrium_angle"].maximum,
            "friction_compensation_gain": 1,
        }
    table = gait_table_from_mapping(data, "large.yaml", "large")
    assert gait_table_from_mapping(table_document(table), "again.yaml", "large") == table
    case = build_case(table, load_experiment("treadmill_guided").experiment)
    assert {"equilibrium_beyond_limits", "unusual_stiffness"} <= {item.rule for item in check(case)}


@pytest.mark.parametrize("joint", ["left.hip", "other", "", "a b", "hüfte-1", "3rd"])
def test_joint_names_unfit_for_signals_are_refused_in_one_line(joint: str) -> None:
    data = copy.deepcopy(shipped("osl_walking"))
    data["joints"] = ["knee", joint]
    for phase in data["phases"].values():
        phase[joint] = phase.pop("ankle")
    data["transitions"][0]["all"] = ["foot.load_bw > 0.25"]
    with raises(TwinGaitError, "joints") as caught:
        gait_table_from_mapping(data, "joints.yaml", "joints")
    assert_one_line(caught.value)
