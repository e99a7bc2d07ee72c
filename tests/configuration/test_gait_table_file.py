"""Gait tables as YAML: what is read, and how every mistake ends in one line with file and key."""

from __future__ import annotations

import copy
import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from errors import raises
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from twin_gait import load_experiment, simulate
from twin_gait.configuration.gait_table_file import (
    gait_table_from_mapping,
    load_gait_table,
)
from twin_gait.configuration.validation import MAXIMUM_FILE_SIZE, parse_yaml
from twin_gait.exceptions import ParameterFileError
from twin_gait.gait.guards import AllOf, AnyOf, parse_guard
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import BlendingLaw, GaitTable, Waiver
from twin_gait.vocabulary import GaitPhase, Side

TABLE = """\
schema_version: 2
name: example
description: A table of this test.
joints: [hip, knee]
blending: {law: linear, duration_ms: 80}
scaling: {carried_mass_kg: 36, stance_phases: [early_stance], speed_m_per_s: 0.42, hip_centre_deg: 9}
phases:
  early_stance:
    hip: {stiffness_Nm_per_deg: 2.5, damping_ratio: 0.7, equilibrium_deg: 12, friction_compensation_gain: 0.35}
    knee: {stiffness_Nm_per_deg: 6.0, damping_Nms_per_rad: 40, equilibrium_deg: 5, friction_compensation_gain: 0.40}
    minimum_duration_ms: 50
  middle_stance:
    hip: {stiffness_Nm_per_rad: 90, damping_Nms_per_deg: 0.5, equilibrium_rad: 0.1, friction_compensation_gain: 0}
    knee: {stiffness_Nm_per_deg: 4, damping_ratio: 0.7, equilibrium_deg: 5, friction_compensation_gain: 1}
  late_stance:
    hip: {stiffness_Nm_per_deg: 2, damping_ratio: 0.7, equilibrium_deg: -12, friction_compensation_gain: 0.35}
    knee: {stiffness_Nm_per_deg: 4, damping_ratio: 0.7, equilibrium_deg: 9, friction_compensation_gain: 0.40}
  swing_flexion:
    hip: {stiffness_Nm_per_deg: 3, damping_ratio: 0.7, equilibrium_deg: 30, friction_compensation_gain: 0.35}
    knee: {stiffness_Nm_per_deg: 3, damping_ratio: 0.7, equilibrium_deg: 60, friction_compensation_gain: 0.40}
    gravity_compensation: 1.0
  swing_extension:
    hip: {stiffness_Nm_per_deg: 3, damping_ratio: 0.7, equilibrium_deg: 25, friction_compensation_gain: 0.35}
    knee: {stiffness_Nm_per_deg: 3, damping_ratio: 0.7, equilibrium_deg: 5, friction_compensation_gain: 0.40}
transitions:
  - {from: early_stance, to: middle_stance, cause: loaded, all: ["hip.angle_deg < 10"]}
  - from: middle_stance
    to: late_stance
    cause: hip_extension
    any: ["hip.angle_deg < -2", {all: ["hip.angle_deg < 0", "foot.load_bw > 0.2"]}]
  - {from: late_stance, to: swing_flexion, cause: trailing_limb, debounce_ms: 5, all: ["hip.angle_deg < -8"]}
  - {from: swing_flexion, to: swing_extension, cause: clearance, all: ["knee.angle_deg > 40"]}
  - {from: swing_flexion, to: swing_extension, cause: timeout, after_s: 1.0}
  - {from: swing_extension, to: early_stance, cause: limb_extended, all: ["knee.angle_deg < 10"]}
sides:
  left:
    swing_flexion:
      knee: {stiffness_Nm_per_rad: 100, damping_Nms_per_rad: 9}
"""  # noqa: E501 - a joint a line, as in the shipped tables


def mapping() -> dict[str, Any]:
    return copy.deepcopy(yaml.safe_load(TABLE))


def load_text(text: str, folder: Path) -> GaitTable:
    path = folder / "table.yaml"
    path.write_text(text, encoding="utf-8")
    return load_gait_table(path)


def check_message(error: ParameterFileError, file: str, *parts: str) -> None:
    message = str(error)
    assert len(message.splitlines()) == 1, message
    assert file in message
    for part in parts:
        assert part in message


def refuse(text: str, folder: Path, *parts: str) -> None:
    with pytest.raises(ParameterFileError) as caught:
        load_text(text, folder)
    check_message(caught.value, str(folder / "table.yaml"), *parts)


# ---------------------------------------------------------------------------------- reading


def test_units_in_the_keys_are_converted_to_si(tmp_path: Path) -> None:
    table = load_text(TABLE, tmp_path)
    early, middle = table.phases["early_stance"], table.phases["middle_stance"]
    assert_allclose(early.joints["hip"].stiffness, 2.5 * 180.0 / math.pi, rtol=1e-14)
    assert_allclose(early.joints["hip"].equilibrium_angle, math.radians(12), rtol=1e-14)
    assert early.joints["hip"].damping is None
    assert early.joints["hip"].damping_ratio == 0.7
    assert early.joints["knee"].damping == 40.0
    assert early.joints["knee"].friction_compensation_gain == 0.4
    assert middle.joints["hip"].stiffness == 90.0
    assert middle.joints["hip"].equilibrium_angle == 0.1
    assert middle.joints["hip"].damping is not None
    assert_allclose(middle.joints["hip"].damping, 0.5 * 180.0 / math.pi, rtol=1e-14)


def test_the_rest_of_the_table_is_read(tmp_path: Path) -> None:
    table = load_text(TABLE, tmp_path)
    assert (table.name, table.description, table.joints) == (
        "example",
        "A table of this test.",
        ("hip", "knee"),
    )
    assert table.phase_names == tuple(str(phase) for phase in GaitPhase)
    assert table.blending.law is BlendingLaw.LINEAR
    assert table.blending.duration_ticks == 80
    assert table.phases["early_stance"].minimum_ticks == 50
    assert table.phases["swing_flexion"].gravity_compensation == 1.0
    assert table.phases["early_stance"].gravity_compensation == 0.0
    assert table.scaling.carried_mass == 36.0
    assert_allclose(table.scaling.hip_centre, math.radians(9), rtol=1e-14)


def test_transitions_keep_their_order_and_their_conditions(tmp_path: Path) -> None:
    table = load_text(TABLE, tmp_path)
    assert [item.cause for item in table.transitions] == [
        "loaded", "hip_extension", "trailing_limb", "clearance", "timeout", "limb_extended",
    ]  # fmt: skip

    def guard(text: str) -> Any:
        return parse_guard(text)

    assert table.transitions[1].guard == AnyOf(
        guards=(
            guard("hip.angle_deg < -2"),
            AllOf(guards=(guard("hip.angle_deg < 0"), guard("foot.load_bw > 0.2"))),
        )
    )
    assert table.transitions[2].debounce_ticks == 5
    assert table.transitions[0].debounce_ticks == 1
    assert table.transitions[4].is_timeout
    assert table.transitions[4].timeout_ticks == 1000


def test_differences_of_a_side_override_the_common_values(tmp_path: Path) -> None:
    table = load_text(TABLE, tmp_path)
    knee = table.phases_of(Side.LEFT)["swing_flexion"].joints["knee"]
    common = table.phases_of(Side.RIGHT)["swing_flexion"].joints["knee"]
    assert (knee.stiffness, knee.damping, knee.damping_ratio) == (100.0, 9.0, None)
    assert knee.equilibrium_angle == common.equilibrium_angle
    assert common.damping_ratio == 0.7
    assert table.phases_of(Side.LEFT)["swing_flexion"].gravity_compensation == 1.0


def test_name_defaults_to_the_file_name(tmp_path: Path) -> None:
    assert load_text(TABLE.replace("name: example\n", ""), tmp_path).name == "table"


def test_own_phases_replace_the_five(tmp_path: Path) -> None:
    """A table may declare its own phases and joints."""
    joint = "{stiffness_Nm_per_deg: 2, damping_ratio: 1, equilibrium_deg: 0, friction_compensation_gain: 0}"
    text = f"""
schema_version: 2
joints: [ankle]
phases: {{stance: {{ankle: {joint}}}, swing: {{ankle: {joint}}}}}
transitions:
  - {{from: stance, to: swing, cause: push_off, all: ["ankle.angle_deg < -10"]}}
  - {{from: swing, to: stance, cause: timeout, after_s: 0.4}}
"""
    table = load_text(text, tmp_path)
    assert table.joints == ("ankle",)
    assert table.phase_names == ("stance", "swing")


@pytest.mark.parametrize(("seconds", "ticks"), [("0.001", 1), ("0.0149", 15), ("0.4", 400), ("1.2", 1200)])
def test_timeout_is_rounded_to_whole_ticks(seconds: str, ticks: int, tmp_path: Path) -> None:
    table = load_text(TABLE.replace("after_s: 1.0", f"after_s: {seconds}"), tmp_path)
    assert table.transitions[4].timeout_ticks == ticks


def test_declarations_for_the_check_are_kept(tmp_path: Path) -> None:
    text = TABLE.replace("cause: loaded", "cause: loaded, driven_by: contact").replace(
        "sides:",
        "cycles: [[early_stance, middle_stance]]\n"
        "waive: [{rule: cascade, phase: late_stance, transition: clearance, reason: it is slow}]\nsides:",
    )
    table = load_text(text, tmp_path)
    assert [str(item.driven_by) for item in table.transitions[:2]] == ["contact", "joint"]
    assert table.cycles == (("early_stance", "middle_stance"),)
    assert table.waivers == (
        Waiver(rule="cascade", reason="it is slow", phase="late_stance", transition="clearance"),
    )
    assert load_text(TABLE, tmp_path).waivers == load_text(TABLE, tmp_path).cycles == ()


def test_declarations_for_the_check_do_not_change_the_guards(tmp_path: Path) -> None:
    plain = load_text(TABLE, tmp_path)
    declared = load_text(TABLE.replace("cause: loaded", "cause: loaded, driven_by: contact"), tmp_path)
    assert compile_guards(declared) == compile_guards(plain)


def test_machine_of_four_of_the_five_phases_declares_its_cycle() -> None:
    data = mapping()
    del data["phases"]["middle_stance"]
    data["transitions"][0]["to"] = "late_stance"
    del data["transitions"][1]
    with pytest.raises(ParameterFileError) as caught:
        gait_table_from_mapping(data, "table.yaml", "t")
    check_message(caught.value, "table.yaml", "phases", "missing middle_stance", "cycles")
    data["cycles"] = [list(data["phases"])]
    assert gait_table_from_mapping(data, "table.yaml", "t").phase_names == tuple(data["phases"])


# ---------------------------------------------------------------------------------- mistakes

HIP_KEY = "phases.early_stance.hip"

MISTAKES = {
    "wrong unit key": (
        "stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_degree: 2.5",
        HIP_KEY, "stiffness_Nm_per_deg",
    ),
    "missing unit": ("equilibrium_deg: 12", "equilibrium: 12", HIP_KEY, "did you mean 'equilibrium_"),
    "spelling": (
        "friction_compensation_gain: 0.35", "friction_compensation_gian: 0.35",
        HIP_KEY, "did you mean",
    ),
    "negative stiffness": (
        "stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_deg: -2.5",
        "stiffness_Nm_per_deg", "-2.5",
    ),
    "negative damping": ("damping_Nms_per_rad: 40", "damping_Nms_per_rad: -40", "damping_Nms_per_rad", "-40"),
    "negative ratio": ("damping_ratio: 0.7", "damping_ratio: -0.7", f"{HIP_KEY}.damping_ratio", "-0.7"),
    "gain above 1": ("gain: 0.35", "gain: 1.35", "friction_compensation_gain", "1.35"),
    "gain below 0": ("gain: 0.35", "gain: -0.1", "friction_compensation_gain", "-0.1"),
    "not a number": (
        "stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_deg: .nan",
        "stiffness_Nm_per_deg", "nan",
    ),
    "infinite": ("equilibrium_deg: 12", "equilibrium_deg: .inf", "equilibrium_deg", "inf"),
    "text": ("equilibrium_deg: 12", "equilibrium_deg: twelve", "equilibrium_deg", "twelve"),
    "truth value": ("equilibrium_deg: 12", "equilibrium_deg: true", "equilibrium_deg", "true"),
    "empty value": (
        "stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_deg:",
        "phases.early_stance.hip.stiffness_Nm_per_rad", "is missing",
    ),
    "list": ("equilibrium_deg: 12", "equilibrium_deg: [12]", "equilibrium_deg", "[12]"),
    "two stiffnesses": (
        "stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_deg: 2.5, stiffness_Nm_per_rad: 3",
        "line 9", "exactly one",
    ),
    "two dampings": (
        "damping_ratio: 0.7", "damping_ratio: 0.7, damping_Nms_per_rad: 3",
        "line 9", "exactly one",
    ),
    "no damping": (
        "damping_ratio: 0.7, ", "",
        "phases.early_stance.hip: damping", "exactly one of damping and damping_ratio",
    ),
    "no gain": (", friction_compensation_gain: 0.35}", "}", "friction_compensation_gain", "missing"),
    "joint missing": (
        "    knee: {stiffness_Nm_per_deg: 6.0", "    #knee: {",
        "phases.early_stance.knee", "missing",
    ),
    "joint unknown": (
        "    minimum_duration_ms: 50", "    ankle: {}",
        "phases.early_stance.ankle", "hip, knee",
    ),
    "minimum": (
        "minimum_duration_ms: 50", "minimum_duration_ms: -1",
        "phases.early_stance.minimum_duration_ms", "-1"),
    "minimum not whole": (
        "minimum_duration_ms: 50", "minimum_duration_ms: 0.5",
        "phases.early_stance.minimum_duration_ms", "0.5"),
    "gravity share": ("gravity_compensation: 1.0", "gravity_compensation: 2", "gravity_compensation", "2"),
    "duplicate key": (
        "equilibrium_deg: 12", "equilibrium_deg: 12, equilibrium_deg: 13",
        "line 9", "given twice",
    ),
    "phase missing": ("  late_stance:\n", "  late_stance2:\n", "transitions[1]", "late_stance"),
    "version": ("schema_version: 2", "schema_version: 1", "schema_version", "1"),
    "no version": ("schema_version: 2", "", "schema_version", "missing"),
    "top-level spelling": ("transitions:", "transition:", "transition", "did you mean 'transitions'"),
    "blending law": ("law: linear", "law: cubic", "blending.law", "cubic"),
    "blending duration": ("duration_ms: 80", "duration_ms: -80", "blending.duration_ms", "-80"),
    "scaling phase": ("stance_phases: [early_stance]", "stance_phases: [flight]", "stance_phases", "flight"),
    "scaling mass": ("carried_mass_kg: 36", "carried_mass_kg: 0", "scaling.carried_mass_kg", "0"),
    "transition to nowhere": ("to: late_stance", "to: flight", "transitions[1]", "flight"),
    "transition to itself": ("to: middle_stance", "to: early_stance", "transitions[0]", "itself"),
    "transition twice": (
        "transitions:\n",
        "transitions:\n  - {from: early_stance, to: middle_stance, cause: loaded, after_s: 2}\n",
        "transitions[1]", "the same from, to and cause as another one; leave one out",
    ),
    "stiffness below 0": (
        "stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_deg: -2.5",
        "phases.early_stance.hip.stiffness_Nm_per_deg", "got -2.5 Nm/deg",
    ),
    "no cause": ("cause: loaded, ", "", "transitions[0].cause", "missing"),
    "empty cause": ("cause: loaded", "cause: ''", "transitions[0].cause", ""),
    "no condition": (", all: [\"hip.angle_deg < 10\"]", "", "transitions[0]", "no condition"),
    "no guards": ("all: [\"hip.angle_deg < 10\"]", "all: []", "transitions[0]", "has no condition"),
    "all and any": (
        "cause: loaded", "cause: loaded, any: [\"hip.angle_deg < 10\"]",
        "transitions[0]", "either",
    ),
    "nested nothing": (
        "{all: [\"hip.angle_deg < 0\", \"foot.load_bw > 0.2\"]}", "{all: []}",
        "transitions[1]", "all:",
    ),
    "nested wrong word": (
        "{all: [\"hip.angle_deg < 0\"", "{both: [\"hip.angle_deg < 0\"",
        "transitions[1]", "both",
    ),
    "guard not strict": ("hip.angle_deg < 10", "hip.angle_deg <= 10", "transitions[0]", "strict"),
    "guard signal": ("hip.angle_deg < 10", "hip.angle < 10", "transitions[0]", "hip.angle_deg"),
    "guard number": ("[\"hip.angle_deg < 10\"]", "[10]", "transitions[0]", "10"),
    "debounce": ("debounce_ms: 5", "debounce_ms: 0", "transitions[2].debounce_ms", "0"),
    "negative timeout": ("after_s: 1.0", "after_s: -1.0", "transitions[4].after_s", "-1"),
    "timeout below a tick": ("after_s: 1.0", "after_s: 0.0004", "transitions[4]", "after_s"),
    "timeout below min time": (
        "gravity_compensation: 1.0", "minimum_duration_ms: 1500", "transitions[4]", "1500",
    ),
    "side unknown": ("  left:", "  middle:", "sides", "middle"),
    "phase of a side unknown": (
        "    swing_flexion:\n      knee", "    flight:\n      knee",
        "sides.left.flight", "swing",
    ),
    "joint of a side unknown": (
        "      knee: {stiffness_Nm_per_rad", "      toe: {stiffness_Nm_per_rad",
        "sides.left.swing_flexion.toe", "allowed",
    ),
    "no joints": ("joints: [hip, knee]", "joints: []", "joints", ""),
    "joint twice": ("joints: [hip, knee]", "joints: [hip, hip, knee]", "hip", ""),
    "hip centre twice": (
        "hip_centre_deg: 9", "hip_centre_deg: 9, hip_centre_rad: 0.3",
        "line 6", "hip_centre_rad",
    ),
    "driven by": ("cause: loaded", "cause: loaded, driven_by: wind", "transitions[0].driven_by", "contact"),
    "waiver without reason": ("sides:", "waive: [{rule: cascade}]\nsides:", "waive[0].reason", "missing"),
    "waiver with an unknown key": (
        "sides:", "waive: [{rule: cascade, reason: so, phas: flight}]\nsides:", "waive[0].phas", "phase",
    ),
    "cycle through an unknown phase": (
        "sides:", "cycles: [[early_stance, flight]]\nsides:", "cycles[0]", "flight",
    ),
    "cycle of one phase": ("sides:", "cycles: [[early_stance]]\nsides:", "cycles[0]", "two or more"),
    "cycle that passes a phase twice": (
        "sides:", "cycles: [[early_stance, late_stance, early_stance]]\nsides:", "cycles[0]", "different",
    ),
    "unclosed": ("joints: [hip, knee]", "joints: [hip, knee", "line", "YAML"),
    "tab": ("name: example", "\tname: example", "line 2", "YAML"),
    "python object": ("name: example", "name: !!python/object/apply:os.getcwd []", "line 2", "YAML"),
    "number as key": ("name: example", "3: example", "line 2", "3"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "explained"), MISTAKES.values(), ids=list(MISTAKES))
def test_mistake_is_explained_in_one_line_with_file_and_key(
    old: str, new: str, key: str, explained: str, tmp_path: Path
) -> None:
    assert old in TABLE
    refuse(TABLE.replace(old, new, 1), tmp_path, key, explained)


@pytest.mark.parametrize("missing", [str(phase) for phase in GaitPhase])
def test_missing_phase_is_named(missing: str) -> None:
    data = mapping()
    del data["phases"][missing]
    with pytest.raises(ParameterFileError) as caught:
        gait_table_from_mapping(data, "table.yaml", "t")
    check_message(caught.value, "table.yaml", "phases", f"missing {missing}")


@pytest.mark.parametrize(
    ("text", "explained"),
    [
        ("", "expected keys and values, got nothing"),
        ("- a\n- b\n", "expected keys and values, got ['a', 'b']"),
        ("just text", "expected keys and values, got 'just text'"),
        ("42", "expected keys and values, got 42"),
        ("a: b: c", "not valid YAML"),
        ("--- a\n--- b\n", "not valid YAML"),
        ("\x00", "not valid YAML"),
        ("schema_version: 2001-01-01", "got '2001-01-01'"),
        ("a: *nowhere", "not valid YAML"),
        ("a: &a [*a]", "not valid YAML"),
        ("a: !!timestamp 2001-01-01", "not valid YAML"),
        ("<<: {a: 1}", "<<: unknown key"),
        ("[" * 5000, "not valid YAML"),
        ("a: " + "9" * 5000, "not valid YAML"),
    ],
)
def test_text_without_a_table_is_refused(text: str, explained: str, tmp_path: Path) -> None:
    refuse(text, tmp_path, explained)


def test_misspelt_phase_over_another_table_is_reported(tmp_path: Path) -> None:
    text = "extends: treadmill_guided\nphases: {late_stanc: {hip: {stiffness_Nm_per_deg: 2}}}\n"
    refuse(text, tmp_path, "phases.late_stanc.hip", "is missing")


def test_phase_that_is_set_to_nothing_is_refused(tmp_path: Path) -> None:
    text = "schema_version: 2\nextends: treadmill_guided\nphases: {late_stance: null}\n"
    refuse(text, tmp_path, "phases.late_stance: expected keys and values, got None")


def test_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    for path, explained in ((tmp_path / "nowhere.yaml", "No such file"), (tmp_path, "cannot be read")):
        with pytest.raises(ParameterFileError) as caught:
            load_gait_table(path)
        check_message(caught.value, str(path), explained)


def test_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.yaml"
    path.write_bytes(b"\xff\xfe\x81")
    with pytest.raises(ParameterFileError) as caught:
        load_gait_table(path)
    check_message(caught.value, str(path), "UTF-8")


def test_huge_file_is_not_read(tmp_path: Path) -> None:
    refuse("#" * (MAXIMUM_FILE_SIZE + 1), tmp_path, "larger than")


def test_long_values_are_shortened_in_the_message(tmp_path: Path) -> None:
    with pytest.raises(ParameterFileError) as caught:
        load_text(TABLE.replace("equilibrium_deg: 12", f"equilibrium_deg: {'x' * 10_000}"), tmp_path)
    assert len(str(caught.value)) < 400


SET: dict[str, Callable[[dict[str, Any], Any], None]] = {
    "top-level key": lambda data, value: data.update({value: 1}),
    "phase key": lambda data, value: data["phases"]["early_stance"].update({value: 1}),
    "joint key": lambda data, value: data["phases"]["early_stance"]["hip"].update({value: 1}),
    "phase": lambda data, value: data["phases"].update({value: {}}),
    "target": lambda data, value: data["transitions"][0].update(to=value),
    "cause": lambda data, value: data["transitions"][0].update(cause=value, to="nowhere"),
    "guard": lambda data, value: data["transitions"][0].update(all=[value]),
    "joint": lambda data, value: data["joints"].append(value),
    "side": lambda data, value: data["sides"].update({value: {}}),
    "phase of a side": lambda data, value: data["sides"]["left"].update({value: {}}),
}


@pytest.mark.parametrize("name", list(SET))
@pytest.mark.parametrize("value", ["two\nlines", "two\r\nlines\u2028three"])
def test_line_breaks_in_the_file_do_not_reach_the_message(name: str, value: str) -> None:
    data = mapping()
    SET[name](data, value)
    with pytest.raises(ParameterFileError) as caught:
        gait_table_from_mapping(data, "table.yaml", "t")
    check_message(caught.value, "table.yaml")


def bomb(levels: int) -> str:
    """Return nested lists of ten aliases each: a short text that expands to 10^levels words."""
    if levels == 0:
        return "lol"
    rest = f", *b{levels - 1}" * 9 if levels > 1 else ", lol" * 9
    return f"&b{levels} [{bomb(levels - 1)}{rest}]"


BOMB = bomb(5)


@pytest.mark.parametrize(
    "text",
    [
        f"schema_version: {BOMB}",
        f"schema_version: 2\njoints: {BOMB}",
        f"? {BOMB}\n: 1",
        f"b: {BOMB}",
        TABLE.replace("equilibrium_deg: 12", f"equilibrium_deg: {BOMB}"),
        TABLE.replace('all: ["hip.angle_deg < 10"]', f"all: [{BOMB}]"),
        TABLE.replace('all: ["hip.angle_deg < 10"]', f"all: {BOMB}"),
        TABLE.replace('all: ["hip.angle_deg < 10"]', f"all: [{{both: {BOMB}}}]"),
        TABLE.replace("name: example", f"name: {BOMB}"),
        TABLE.replace("minimum_duration_ms: 50", f"gravity_compensation: {BOMB}"),
    ],
    ids=["version", "joints", "key", "value", "number", "guard", "guards", "nested guards", "name", "share"],
)
def test_aliases_are_not_expanded_in_memory(text: str) -> None:
    """Expanding five levels takes 700 000 characters; nine would exhaust the memory."""
    tracemalloc.start()
    try:
        with pytest.raises(ParameterFileError) as caught:
            gait_table_from_mapping(parse_yaml(text, "table.yaml"), "table.yaml", "t")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    check_message(caught.value, "table.yaml")
    assert len(str(caught.value)) < 2000
    assert peak < 2_000_000


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("after_s: 1.0", "after_s: 1.0e+300"),
        ("after_s: 1.0", "after_s: 1.0e+307"),
        ("debounce_ms: 5", f"debounce_ms: {10**30}"),
        ("minimum_duration_ms: 50", f"minimum_duration_ms: {10**30}"),
        ("stiffness_Nm_per_deg: 2.5", "stiffness_Nm_per_deg: 1.0e+308"),
        ("equilibrium_deg: 12", f"equilibrium_deg: {10**400}"),
    ],
)
def test_extreme_numbers_are_refused_like_any_other_mistake(old: str, new: str, tmp_path: Path) -> None:
    refuse(TABLE.replace(old, new, 1), tmp_path)


# ---------------------------------------------------------------------------------- fuzzing

words = st.sampled_from(
    ["hip", "knee", "early_stance", "swing_flexion", "flight", "left", "all", "any", "hip.angle_deg < 3",
     "other.phase in [late_stance]", "linear", "1", "", "é\n"]
)  # fmt: skip
scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(10**40), 10**40)
    | st.integers(-3, 3)
    | st.floats()
    | words
    | st.text(max_size=5)
    | st.binary(max_size=3)
    | st.dates()
)
trees = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(words | st.text(max_size=3), inner, max_size=4)
    ),
    max_leaves=12,
)


def entries(tree: Any) -> list[tuple[Any, Any]]:
    """Return every container in a tree with each of its keys or indices."""
    if isinstance(tree, dict):
        keys: list[Any] = list(tree)
    elif isinstance(tree, list):
        keys = list(range(len(tree)))
    else:
        return []
    return [entry for key in keys for entry in [(tree, key), *entries(tree[key])]]


def ends_well(data: dict[str, Any]) -> None:
    """Check that the result is a table that can be compiled, or one line that names the file."""
    try:
        table = gait_table_from_mapping(data, "fuzz.yaml", "fuzz")
    except ParameterFileError as error:
        check_message(error, "fuzz.yaml")
    else:
        assert len(compile_guards(table).transitions) == len(table.transitions)


# Shrinking such trees takes minutes.
@settings(max_examples=100, phases=[Phase.generate])
@given(data=st.data())
def test_damaged_table_ends_in_a_table_or_in_one_line(data: st.DataObject) -> None:
    tree = mapping()
    for _ in range(data.draw(st.integers(1, 2))):
        container, key = data.draw(st.sampled_from(entries(tree)))
        action = data.draw(st.sampled_from(["replace", "delete", "add"]))
        if action == "delete":
            del container[key]
        elif action == "replace" or isinstance(container, list):
            container[key] = data.draw(trees)
        else:
            container[data.draw(words | st.text(max_size=5))] = data.draw(trees)
    ends_well(tree)


@given(tree=st.dictionaries(st.sampled_from(list(yaml.safe_load(TABLE))), trees))
def test_any_mapping_ends_in_a_table_or_in_one_line(tree: dict[str, Any]) -> None:
    ends_well(tree)


@settings(max_examples=100)
@given(text=st.text(alphabet="ab:-[]{}&*!#|>'\"%@?,\n\t 1.e~\x00\u2028", max_size=40))
def test_any_text_ends_in_a_table_or_in_one_line(text: str) -> None:
    try:
        parsed = parse_yaml(text, "fuzz.yaml")
    except ParameterFileError as error:
        check_message(error, "fuzz.yaml")
    else:
        ends_well(parsed)


# ---------------------------------------------------------------------- tables that extend others

STANDING = """\
schema_version: 2
extends: {base}
phases:
  middle_stance:
    hip: {{equilibrium_deg: 3}}
  stand:
    hip: {{stiffness_Nm_per_deg: 2, damping_ratio: 0.7, equilibrium_deg: 0, friction_compensation_gain: 0.35}}
    knee: {{stiffness_Nm_per_deg: 5, damping_ratio: 1, equilibrium_deg: 5, friction_compensation_gain: 0.40}}
transitions:
  - {{from: early_stance, to: stand, cause: halt, all: ["walk < 0.5"]}}
  - {{from: stand, to: early_stance, cause: go, all: ["walk > 0.5"]}}
waive: [{{rule: cascade, reason: of the upper table}}]
"""


def test_a_table_extends_a_packaged_one_key_by_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(STANDING.format(base="treadmill_guided"), encoding="utf-8")
    base, table = load_gait_table("treadmill_guided"), load_gait_table(path)
    assert table.name == "mine"
    assert table.phase_names == (*base.phase_names, "stand")
    changed = table.phases["middle_stance"].joints["hip"]
    assert changed.equilibrium_angle == math.radians(3.0)
    assert changed.stiffness == base.phases["middle_stance"].joints["hip"].stiffness
    assert table.phases["late_stance"] == base.phases["late_stance"]
    assert table.transitions[: len(base.transitions)] == base.transitions
    assert [item.cause for item in table.transitions[len(base.transitions) :]] == ["halt", "go"]
    assert table.waivers == (*base.waivers, Waiver(rule="cascade", reason="of the upper table"))
    assert (table.blending, table.scaling) == (base.blending, base.scaling)


def test_a_table_extends_another_one_in_its_folder(tmp_path: Path) -> None:
    (tmp_path / "below.yaml").write_text(TABLE, encoding="utf-8")
    path = tmp_path / "above.yaml"
    path.write_text(STANDING.format(base="below.yaml"), encoding="utf-8")
    assert load_gait_table(path).blending == load_gait_table(tmp_path / "below.yaml").blending


@pytest.mark.parametrize(
    ("base", "words"),
    [
        ("moonwalk", ("extends", "moonwalk", "bench_leg")),
        ("[1, 2]", ("extends", "[1, 2]")),
        ("above.yaml", ("extends", "above.yaml")),
    ],
)
def test_a_table_that_extends_nothing_or_itself_is_refused(
    tmp_path: Path, base: str, words: tuple[object, ...]
) -> None:
    path = tmp_path / "above.yaml"
    path.write_text(STANDING.format(base=base), encoding="utf-8")
    with raises(ParameterFileError, *words) as caught:
        load_gait_table(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_transitions_must_be_a_list(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("schema_version: 2\nextends: treadmill_guided\ntransitions: 7\n", encoding="utf-8")
    with raises(ParameterFileError, "transitions", "list", "7"):
        load_gait_table(path)


CHANGED = """\
schema_version: 2
extends: treadmill_guided
transitions:
  - {from: late_stance, to: early_stance, cause: stumble, all: ["hip.angle_deg > 40"]}
  - {from: middle_stance, to: late_stance, cause: hip_extension, all: ["hip.angle_deg < -1.25"]}
  - {from: swing_extension, to: early_stance, cause: timeout, remove: true}
"""


def changed(folder: Path, text: str = CHANGED) -> GaitTable:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_gait_table(path)


def names(table: GaitTable) -> list[tuple[str, str, str]]:
    return [(item.source, item.target, item.cause) for item in table.transitions]


def test_a_transition_with_the_same_from_to_and_cause_takes_the_place_of_the_inherited_one(
    tmp_path: Path,
) -> None:
    base, table = load_gait_table("treadmill_guided"), changed(tmp_path)
    expected = [name for name in names(base) if name != ("swing_extension", "early_stance", "timeout")]
    assert names(table) == [*expected, ("late_stance", "early_stance", "stumble")]
    index = names(base).index(("middle_stance", "late_stance", "hip_extension"))
    assert str(table.transitions[index].guard) == "hip.angle_deg < -1.25"
    others = [item for item in table.transitions if item.cause not in ("hip_extension", "stumble")]
    assert others == [
        item for item in base.transitions if item.cause != "hip_extension" and item in table.transitions
    ]


def test_a_replaced_value_may_be_inherited_over_two_files(tmp_path: Path) -> None:
    changed(tmp_path)
    path = tmp_path / "above.yaml"
    path.write_text(CHANGED.replace("treadmill_guided", "mine.yaml").replace("-1.25", "-1.5").replace(
        "{from: swing_extension, to: early_stance, cause: timeout, remove: true}",
        "{from: late_stance, to: early_stance, cause: stumble2, all: [\"hip.angle_deg > 50\"]}",
    ), encoding="utf-8")  # fmt: skip
    table = load_gait_table(path)
    assert names(table)[:-1] == names(changed(tmp_path))
    assert [str(item.guard) for item in table.transitions if item.cause == "hip_extension"] == [
        "hip.angle_deg < -1.5"
    ]


@pytest.mark.parametrize(
    ("old", "new", "key", "explained"),
    [
        ("cause: timeout, remove", "cause: tired, remove", "transitions[2]",
         "treadmill_guided has no transition swing_extension → early_stance (tired)"),
        ("remove: true", "remove: maybe", "transitions[2].remove", "maybe"),
        ("remove: true", "remove: true, after_s: 1", "transitions[2]", "after_s"),
        ("from: late_stance, to: early_stance, cause: stumble", "from: middle_stance, to: late_stance, "
         "cause: hip_extension", "transitions[1]", "the same from, to and cause"),
        ("hip.angle_deg < -1.25", "hip.angle_dog < -1.25", "transitions[1]", "hip.angle_deg"),
        ("to: early_stance, cause: stumble", "to: flight, cause: stumble",
         "transitions[0] (stumble)", "flight"),
        ("to: early_stance, cause: stumble", "to: early_stance", "transitions[0].cause", "missing"),
        ("transitions:", "waive: [{rule: cascade, reason: so, phase: 5}]\ntransitions:",
         "waive[0].phase", "5"),
        ("extends: treadmill_guided", "extends: below.yaml",
         "transitions[2]", "below.yaml has no transition swing_extension"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("within", ["table", "experiment", "inline"])
def test_mistakes_under_extends_name_the_entry_of_the_file_that_was_written(
    old: str, new: str, key: str, explained: str, within: str, tmp_path: Path
) -> None:
    """Neither the index in the merged list nor the preset is named."""
    (tmp_path / "below.yaml").write_text(TABLE, encoding="utf-8")
    text = CHANGED.replace(old, new, 1)
    assert text != CHANGED
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    inline = tmp_path / "inline.yaml"
    inline.write_text(
        yaml.safe_dump({"preset": "treadmill_guided", "table": yaml.safe_load(text)}), encoding="utf-8"
    )
    location = {"table": path, "experiment": path, "inline": f"{inline}: table"}[within]
    with pytest.raises(ParameterFileError) as caught:
        if within == "inline":
            load_experiment(inline)
        elif within == "experiment":
            load_experiment("treadmill_guided", [f"table={path}"])
        else:
            load_gait_table(path)
    check_message(caught.value, f"{location}: {key}", explained)


def test_a_mistake_in_the_base_table_names_that_file(tmp_path: Path) -> None:
    below = tmp_path / "below.yaml"
    below.write_text(TABLE.replace("knee.angle_deg > 40", "knee.angle > 40"), encoding="utf-8")
    with pytest.raises(ParameterFileError) as caught:
        changed(tmp_path, "schema_version: 2\nextends: below.yaml\ntransitions:\n"
                "  - {from: early_stance, to: middle_stance, cause: loaded, remove: true}\n"
                "  - {from: early_stance, to: middle_stance, cause: late, after_s: 2}\n")  # fmt: skip
    check_message(caught.value, f"{below}: transitions[3]", "knee.angle")


def test_removal_requires_a_base_table(tmp_path: Path) -> None:
    refuse(
        TABLE.replace("cause: loaded", "cause: loaded, remove: true"), tmp_path, "transitions[0]", "extends"
    )


def test_an_inline_table_extends_the_named_table_and_not_the_table_of_the_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "preset: treadmill_guided\ntable: {extends: treadmill_start_stop, blending: {duration_ms: 31}}",
        encoding="utf-8",
    )
    table = load_experiment(path).experiment.table
    assert table.blending.duration_ticks == 31
    assert table.phases == load_gait_table("treadmill_start_stop").phases


@pytest.mark.slow
def test_a_changed_threshold_changes_the_walk(tmp_path: Path) -> None:
    """The walk uses the values of the extending file: its log differs from the default."""
    changed(tmp_path)
    settings = ["duration_s=3", f"table={tmp_path / 'mine.yaml'}"]
    switches = [
        simulate(load_experiment("treadmill_guided", some).experiment).switches
        for some in (settings[:1], settings)
    ]
    entered = [[item.tick for item in found if item.target == "late_stance"] for found in switches]
    assert entered[0] and entered[0] != entered[1]


def test_an_own_waiver_takes_the_place_of_an_inherited_one_for_the_same():
    base, own = (load_gait_table(name).waivers for name in ("treadmill_guided", "treadmill_ankle"))
    reasons = {item.rule: item.reason for item in own if item.phase is item.transition is None}
    inherited = {item.rule: item.reason for item in base if item.phase is item.transition is None}
    assert "orthosis" in reasons["unusual_damping_ratio"] != inherited["unusual_damping_ratio"]
    assert len(own) == len(base)
    assert reasons["effective_damping"] == inherited["effective_damping"]
