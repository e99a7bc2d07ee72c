"""Tests that each rule of the check finds its planted defect, and that shipped tables have no errors."""

from __future__ import annotations

import copy
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from errors import raises, states
from table_builder import FIVE_PHASES

from twin_gait.checking.check import (
    RULES,
    build_case,
    check,
    check_before_run,
    counts,
    load_case,
    report,
    rules,
)
from twin_gait.checking.finding import CheckCase, Finding, Severity, waive
from twin_gait.checking.signals import ANY_ANGLE, JOINT_RANGES, SignalSpace
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.experiments import load_experiment, presets
from twin_gait.configuration.gait_table_file import (
    gait_table_from_mapping,
    load_gait_table,
    packaged_gait_tables,
)
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import GaitTable

Mapping = dict[str, Any]


@cache
def experiment() -> Experiment:
    return load_experiment("treadmill_guided").experiment


@cache
def sound() -> Mapping:
    """A table without errors, and without waivers."""
    data: Mapping = yaml.safe_load(FIVE_PHASES.read_text(encoding="utf-8"))
    return data


def case_of(data: Mapping) -> CheckCase:
    return build_case(gait_table_from_mapping(data, "table.yaml", "planted"), experiment())


OF_GUARDS = ("graph", "exits")
GUARD_RULES = [rule for rule in RULES if rule.__module__.rsplit(".", 1)[-1] in OF_GUARDS]


def findings_of(data: Mapping, *names: str) -> list[Finding]:
    """Return the findings of the rules of guards, or of the named rules."""
    chosen = [rule for rule in GUARD_RULES if not names or rule.__name__ in names]
    return check(case_of(data), chosen)


@cache
def checked(name: str) -> list[Finding]:
    """Return the findings of all rules in a shipped table."""
    return check(load_case(name))


def entry(data: Mapping, cause: str, source: str | None = None) -> Mapping:
    found: Mapping = next(
        item for item in data["transitions"] if item["cause"] == cause and source in (None, item["from"])
    )
    return found


def remove(data: Mapping, cause: str, source: str) -> None:
    data["transitions"].remove(entry(data, cause, source))


def add(data: Mapping, source: str, target: str, *conditions: str, **more: Any) -> None:
    guard = {"all": list(conditions)} if conditions else {}
    data["transitions"].append({"from": source, "to": target, "cause": "planted", **guard, **more})


def change(cause: str, source: str, **values: Any) -> Callable[[Mapping], None]:
    return lambda data: entry(data, cause, source).update(values)


def condition(cause: str, old: str, *new: str) -> Callable[[Mapping], None]:
    def replace(data: Mapping) -> None:
        guards = entry(data, cause)["all"]
        position = next(index for index, text in enumerate(guards) if old in text)
        guards[position : position + 1] = new

    return replace


def short_cut(data: Mapping) -> None:
    for item in data["transitions"]:
        if item["from"] == "swing_flexion":
            item["to"] = "early_stance"


def dead_end(data: Mapping) -> None:
    data["transitions"] = [item for item in data["transitions"] if item["from"] != "swing_extension"]


def round_and_round(data: Mapping) -> None:
    entry(data, "hip_extension")["to"] = "early_stance"


def blind(data: Mapping) -> None:
    entry(data, "trailing_limb")["all"] = ["hip.angle_deg < -2.8"]


LATE = "trailing_limb"
FLEXION, EXTENSION = "swing_flexion", "swing_extension"

# Rule, where it is found, severity, and what is done to the table of the treadmill.
PLANTED: dict[str, tuple[str, str | None, str, Callable[[Mapping], None]]] = {
    "phase that nothing leads to": ("unreachable_phase", EXTENSION, "error", short_cut),
    "phase behind a guard that never opens": (
        "unreachable_phase", "late_stance", "error",
        condition("hip_extension", "hip.angle", "hip.angle_deg < -21"),
    ),
    "phase without an exit": ("trap", EXTENSION, "error", dead_end),
    "two phases that lead to one another only": ("trap", "early_stance", "error", round_and_round),
    "phase whose only exit never opens": (
        "trap", "late_stance", "error", condition(LATE, "hip.angle_deg < -2.8", "hip.angle_deg < -40"),
    ),
    "swing without a timeout": (
        "missing_timeout", FLEXION, "warning", lambda d: remove(d, "timeout", FLEXION),
    ),
    "swing whose timeout comes as late as none": (
        "missing_timeout", FLEXION, "warning", change("timeout", FLEXION, after_s=1000),
    ),
    "way back": (
        "undeclared_cycle", FLEXION, "error", lambda d: add(d, FLEXION, "late_stance", "hip.angle_deg < -9"),
    ),
    "phase left out": (
        "undeclared_cycle", FLEXION, "error", lambda d: add(d, FLEXION, "early_stance", "foot.load_bw > 0.5"),
    ),
    "declared cycle with a gap": (
        "undeclared_cycle", EXTENSION, "error",
        lambda d: d.update(cycles=[list(d["phases"]), [EXTENSION, FLEXION]]),
    ),
    "two exits open at once": (
        "ambiguity", FLEXION, "warning", lambda d: add(d, FLEXION, "early_stance", "knee.angle_deg > 60"),
    ),
    "two exits open at once beside alternatives": (
        "ambiguity", "middle_stance", "warning",
        lambda d: add(
            d, "middle_stance", "early_stance", any=["hip.angle_deg > 50", "hip.velocity_deg_per_s > 9"]
        ),
    ),
    "two exits open at once late in the phase": (
        "ambiguity", FLEXION, "warning",
        lambda d: add(d, FLEXION, "early_stance", "knee.angle_deg > 60", after_s=0.9),
    ),
    "entry above the threshold of the exit": (
        "cascade", EXTENSION, "warning", condition("limb_extended", "knee.angle", "knee.angle_deg > 26"),
    ),
    "switch undone by noise": (
        "hysteresis", FLEXION, "warning",
        lambda d: add(d, FLEXION, "late_stance", "hip.angle_deg > -3.1", "knee.angle_deg < 20"),
    ),
    "contradiction": (
        "never_opens", FLEXION, "error",
        condition("clearance", "knee", "knee.angle_deg > 25.7", "knee.angle_deg < 20"),
    ),
    "other leg ahead and behind": (
        "never_opens", "late_stance", "error",
        condition(LATE, "other.phase", "hip.angle_deg - other.hip.angle_deg > 1"),
    ),
    "condition later than the timeout": (
        "never_opens", FLEXION, "error", condition("clearance", "knee", "time_in_phase_s > 1.5"),
    ),
    "debounce longer than the timeout": (
        "never_opens", FLEXION, "error", change("clearance", FLEXION, debounce_ms=1500),
    ),
    "debounce that the rest of the phase is too short for": (
        "never_opens", FLEXION, "error",
        lambda d: entry(d, "clearance").update(debounce_ms=300, all=["time_in_phase_s > 0.8"]),
    ),
    "threshold beyond the stop": (
        "threshold_beyond_limits", FLEXION, "warning", condition("clearance", "knee", "knee.angle_deg > -10"),
    ),
    "velocity beyond the motor": (
        "threshold_beyond_limits", "early_stance", "warning",
        condition("loaded", "velocity", "hip.velocity_deg_per_s < 400"),
    ),
    "load beyond the range of a foot": (
        "threshold_beyond_limits", "late_stance", "warning",
        lambda d: add(d, "late_stance", FLEXION, any=["foot.load_bw > 30", "hip.angle_deg < -15"]),
    ),
    "late stance that does not look at the other leg": ("both_in_swing", "late_stance", "error", blind),
    "late stance that lets go while the other leg swings": (
        "both_in_swing", "late_stance", "error",
        condition(LATE, "other.phase", "other.phase in [late_stance, swing_extension]"),
    ),
    "both legs in one tick": (
        "both_in_swing", "late_stance", "error", condition(LATE, "other.hip", "other.foot.load_bw > 0.1"),
    ),
    "timeout out of stance": (
        "both_in_swing", "late_stance", "error", lambda d: add(d, "late_stance", FLEXION, after_s=2.0),
    ),
    "both legs wait in late stance": (
        "deadlock", "late_stance", "error",
        condition(LATE, "other.phase", "other.phase in [early_stance, middle_stance]"),
    ),
    "both legs wait for the other to swing": (
        "deadlock", "late_stance", "error", condition(LATE, "other.phase", "other.phase in [swing_flexion]"),
    ),
    "waiver of a rule that does not exist": (
        "invalid_waiver", None, "error",
        lambda d: d.update(waive=[{"rule": "ambiguousness", "reason": "so be it"}]),
    ),
    "waiver about a phase that does not exist": (
        "invalid_waiver", None, "error",
        lambda d: d.update(waive=[{"rule": "ambiguity", "phase": "flight", "reason": "so be it"}]),
    ),
    "waiver without a reason": (
        "invalid_waiver", None, "error", lambda d: d.update(waive=[{"rule": "ambiguity", "reason": " "}]),
    ),
}  # fmt: skip


def planted(name: str) -> tuple[list[Finding], list[Finding]]:
    """Return the findings of the rule before and after the defect is planted."""
    rule, _, _, plant = PLANTED[name]
    data = copy.deepcopy(sound())
    plant(data)
    before, after = findings_of(sound(), rule), findings_of(data, rule)
    return [item for item in before if item.rule == rule], [item for item in after if item.rule == rule]


@pytest.mark.parametrize("name", list(PLANTED))
def test_planted_defect_is_found_where_it_is(name: str) -> None:
    rule, phase, severity, _ = PLANTED[name]
    before, after = planted(name)
    new = [item for item in after if item not in before]
    found = [item for item in new if (item.phase, item.severity) == (phase, severity)]
    assert found, f"{rule} not found; {after}"
    for item in found:
        assert item.reason
        assert item.suggestion


def test_a_defect_is_planted_for_every_rule_of_guards() -> None:
    ours = {rule.__name__ for rule in GUARD_RULES}
    assert ours | {"invalid_waiver"} == {rule for rule, *_ in PLANTED.values()}


def test_every_finding_has_the_name_of_its_rule() -> None:
    """Ids in reports and waivers are the names that --rules lists."""
    planted_for = {rule: plant for rule, *_, plant in PLANTED.values()}
    for rule in GUARD_RULES:
        data = copy.deepcopy(sound())
        planted_for[rule.__name__](data)
        assert {item.rule for item in rule(case_of(data))} == {rule.__name__}


@pytest.mark.parametrize("name", packaged_gait_tables())
def test_shipped_tables_have_no_errors(name: str) -> None:
    assert [item for item in checked(name) if item.severity == "error"] == []


@pytest.mark.parametrize("name", ["treadmill_guided", "treadmill_start_stop", "bench_leg"])
def test_every_warning_of_the_tables_that_are_walked_in_is_waived(name: str) -> None:
    case = load_case(name)
    assert case.experiment is not None
    assert case.experiment.name == name
    assert [item for item in checked(name) if item.severity == "warning" and not item.waived] == []


def test_every_waiver_of_a_shipped_table_is_used() -> None:
    for name in packaged_gait_tables():
        table = load_case(name).table
        warnings = [replace(item, waived="") for item in checked(name) if item.severity == "warning"]
        for waiver in table.waivers:
            alone = replace(table, waivers=(waiver,))
            assert any(waive(alone, item).waived for item in warnings), (name, waiver)


# ---------------------------------------------------------------------------------- waivers


def waived(**waiver: str) -> list[Finding]:
    data = copy.deepcopy(sound())
    add(data, FLEXION, "early_stance", "knee.angle_deg > 60")
    add(data, "middle_stance", "early_stance", "hip.angle_deg < -3")
    data["cycles"] = [list(data["phases"]), ["early_stance", "middle_stance"]]
    data["waive"] = [{"rule": "ambiguity", "reason": "the first is meant to win", **waiver}]
    return [item for item in findings_of(data, "ambiguity") if item.rule == "ambiguity"]


@pytest.mark.parametrize(
    ("waiver", "phases"),
    [
        ({}, {FLEXION, "middle_stance"}),
        ({"phase": FLEXION}, {FLEXION}),
        ({"phase": FLEXION, "transition": "planted"}, {FLEXION}),
        ({"transition": "planted"}, {FLEXION, "middle_stance"}),
        ({"phase": FLEXION, "transition": "clearance"}, set()),
        ({"phase": "late_stance"}, set()),
    ],
)
def test_waiver_takes_rule_phase_and_transition(waiver: dict[str, str], phases: set[str]) -> None:
    found = waived(**waiver)
    assert {item.phase for item in found} == {FLEXION, "middle_stance"}
    assert {item.phase for item in found if item.waived} == phases
    assert {item.waived for item in found if item.waived} <= {"the first is meant to win"}


def test_errors_cannot_be_waived() -> None:
    data = copy.deepcopy(sound())
    blind(data)
    data["waive"] = [{"rule": "both_in_swing", "reason": "we hop"}]
    found = findings_of(data, "both_in_swing")
    assert not any(item.waived for item in found)
    assert counts(found)["errors"] > 0


def test_waived_warnings_are_counted_apart() -> None:
    numbers = counts(waived())
    assert numbers == {"errors": 0, "warnings": 0, "notes": 0, "waived": 2}


# ---------------------------------------------------------------------------------- other machines

KNEE_AND_ANKLE = """\
schema_version: 2
joints: [knee, ankle]
phases:
  early_stance: {knee: &j {stiffness_Nm_per_deg: 3, damping_ratio: 0.7, equilibrium_deg: 5, friction_compensation_gain: 0}, ankle: *j}
  late_stance: {knee: *j, ankle: *j}
  swing_flexion: {knee: *j, ankle: *j}
  swing_extension: {knee: *j, ankle: *j}
cycles: [[early_stance, late_stance, swing_flexion, swing_extension]]
transitions:
  - {from: early_stance, to: late_stance, cause: dorsiflexed, all: ["ankle.angle_deg > 5", "foot.load_bw > 0.5"]}
  - {from: late_stance, to: swing_flexion, cause: unloaded, all: ["foot.load_bw < 0.05"]}
  - {from: swing_flexion, to: swing_extension, cause: bent, all: ["knee.velocity_deg_per_s < 0", "knee.angle_deg > 50"]}
  - {from: swing_extension, to: early_stance, cause: loaded, all: ["foot.load_bw > 0.1"]}
"""  # noqa: E501 - a phase a line


def test_machine_with_other_joints_and_four_phases_is_checked_alone(tmp_path: Path) -> None:
    path = tmp_path / "prosthesis.yaml"
    path.write_text(KNEE_AND_ANKLE, encoding="utf-8")
    case = load_case(path)
    assert case.experiment is None
    assert case.limits == {name: JOINT_RANGES[name] for name in ("knee", "ankle")} | {"trunk": ANY_ANGLE}
    found = check(case)
    assert counts(found)["errors"] == 0
    assert {item.phase for item in found if item.rule == "missing_timeout"} == set(case.table.phases)
    # It reads no signal of the other leg, which then may swing too.
    assert [str(item.severity) for item in found if item.rule == "both_in_swing"][:1] == ["warning"]


def test_joints_in_another_order_are_refused_as_in_a_run(tmp_path: Path) -> None:
    path = tmp_path / "turned.yaml"
    path.write_text("schema_version: 2\nextends: treadmill_guided\njoints: [knee, hip]\n", encoding="utf-8")
    with raises(ParameterError, "joints", "hip, knee, ankle", "knee, hip"):
        load_case(path)


def test_messages_about_a_pair_of_equal_phases_and_an_unreachable_threshold(tmp_path: Path) -> None:
    path = tmp_path / "stuck.yaml"
    text = """
    schema_version: 2
    extends: treadmill_guided
    transitions:
      - {from: late_stance, to: swing_flexion, cause: trailing_limb,
         all: ["other.phase in [early_stance]", "hip.angle_deg < 200"]}
    """
    path.write_text(text, encoding="utf-8")
    starts = ["scenario.leading_phase=late_stance", "scenario.trailing_phase=late_stance"]
    found = check(load_case(path, None, starts))
    ways_out = {item.suggestion for item in found if item.rule == "deadlock"}
    assert "add a transition out of one of them for this case, or a timeout" in ways_out
    (reason,) = (item.reason for item in found if item.rule == "threshold_beyond_limits")
    assert states(reason, "hip.angle_deg < 200", "-20", "110")


def test_machine_with_other_joints_shows_its_defects(tmp_path: Path) -> None:
    path = tmp_path / "prosthesis.yaml"
    path.write_text(KNEE_AND_ANKLE.replace("ankle.angle_deg > 5", "ankle.angle_deg > 45"), encoding="utf-8")
    found = {(item.rule, item.phase) for item in check(load_case(path))}
    assert ("never_opens", "early_stance") in found
    assert ("unreachable_phase", "swing_extension") in found


def test_unknown_joint_turns_within_a_whole_turn(tmp_path: Path) -> None:
    path = tmp_path / "toe.yaml"
    path.write_text(KNEE_AND_ANKLE.replace("ankle", "toe"), encoding="utf-8")
    assert SignalSpace(load_case(path)).range("toe.angle_deg") == pytest.approx((-180.0, 180.0))


def test_missing_swing_phase_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "numbered.yaml"
    path.write_text(
        KNEE_AND_ANKLE.replace("swing_flexion", "third").replace("swing_extension", "fourth"),
        encoding="utf-8",
    )
    (found,) = (item for item in check(load_case(path), GUARD_RULES) if item.rule == "both_in_swing")
    assert found.severity == "note"


def test_table_of_one_phase_is_not_reported_as_a_trap() -> None:
    data = copy.deepcopy(yaml.safe_load(KNEE_AND_ANKLE))
    data |= {"phases": {"hold": data["phases"]["early_stance"]}, "transitions": [], "cycles": []}
    table = gait_table_from_mapping(data, "table.yaml", "hold")
    assert counts(check(build_case(table), GUARD_RULES))["errors"] == 0


def test_experiment_that_cannot_drive_the_joints_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "prosthesis.yaml"
    path.write_text(KNEE_AND_ANKLE, encoding="utf-8")
    with raises(ParameterError, "plant.actuators.ankle"):
        load_case(path, "treadmill_guided")


def test_one_leg_cannot_swing_with_another() -> None:
    """On the bench there is no other leg: exits that read it never open."""
    data = copy.deepcopy(sound())
    table = gait_table_from_mapping(data, "table.yaml", "alone")
    bench = build_case(table, load_experiment("bench_leg").experiment)
    found = check(
        bench, [rule for rule in RULES if rule.__name__ in ("both_in_swing", "deadlock", "never_opens")]
    )
    assert {(item.rule, item.phase) for item in found} == {("never_opens", "late_stance")}


def test_single_leg_reads_the_walk_command() -> None:
    """Without another leg its signals are missing, but the walk command exists."""
    data = copy.deepcopy(sound())
    add(data, FLEXION, EXTENSION, "walk > 0.5")
    table = gait_table_from_mapping(data, "table.yaml", "alone")
    bench = build_case(table, load_experiment("bench_leg").experiment)
    (index,) = (index for index, item in enumerate(table.transitions) if item.cause == "planted")
    assert SignalSpace(bench).opening(index) is not None


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("trunk.pitch_deg > 5", {"never_opens": "error", "threshold_beyond_limits": "warning"}),
        ("trunk.pitch_deg > 0", {"never_opens": "error"}),
        ("trunk.pitch_deg < 5", {"threshold_beyond_limits": "warning", "ambiguity": "warning"}),
    ],
)
def test_guided_pelvis_does_not_pitch(condition: str, expected: dict[str, str]) -> None:
    """A guard that only a pitching trunk opens never does, and one that a pitch closes always is."""
    data = copy.deepcopy(sound())
    add(data, FLEXION, "early_stance", condition)
    found = {item.rule: str(item.severity) for item in findings_of(data, *expected) if "planted" in str(item)}
    assert found == expected
    if "threshold_beyond_limits" in expected:
        assert any("trunk.pitch_deg" in item.reason and "0 … 0" in item.reason for item in findings_of(data))


def test_a_free_trunk_may_pitch_until_it_has_fallen() -> None:
    settings = ["scenario.fall_lean_deg=40"]
    free = load_experiment("overground", settings).experiment
    space = SignalSpace(build_case(free.table, free))
    assert space.range("trunk.pitch_deg") == pytest.approx((-40.0, 40.0))


def test_trunk_of_another_machine_may_pitch_within_a_turn(tmp_path: Path) -> None:
    path = tmp_path / "prosthesis.yaml"
    path.write_text(KNEE_AND_ANKLE.replace("ankle.angle_deg > 5", "trunk.pitch_deg > 5"), encoding="utf-8")
    case = load_case(path)
    assert SignalSpace(case).range("other.trunk.pitch_deg") == pytest.approx((-180.0, 180.0))
    assert counts(check(case))["errors"] == 0


def test_noise_of_the_trunk_can_reverse_a_switch(tmp_path: Path) -> None:
    path = tmp_path / "prosthesis.yaml"
    bent = KNEE_AND_ANKLE.replace("ankle.angle_deg > 5", "trunk.pitch_deg > 5")
    back = '  - {from: late_stance, to: early_stance, cause: upright, all: ["trunk.pitch_deg < %s"]}\n'
    found = {}
    for threshold in ("4.8", "4.4"):
        path.write_text(bent + back % threshold, encoding="utf-8")
        found[threshold] = [item for item in check(load_case(path), GUARD_RULES) if item.rule == "hysteresis"]
    assert found["4.8"] and not found["4.4"]
    assert found["4.8"][0].counterexample["trunk.pitch_deg"] == pytest.approx(4.9, abs=0.5)


def test_table_is_scaled_to_the_experiment() -> None:
    slow = load_experiment("treadmill_guided", ["scenario.belt_speed_km_per_h=0.9"]).experiment
    table = load_gait_table(FIVE_PHASES)
    scaled = build_case(table, slow).table
    assert scaled.transitions[0].guard != table.transitions[0].guard
    assert scaled.phases["early_stance"].joints["hip"] != table.phases["early_stance"].joints["hip"]


# ---------------------------------------------------------------------------------- reading and reporting


def test_missing_table_is_refused_in_one_line() -> None:
    with raises(TwinGaitError, "nowhere", "bench_leg") as caught:
        load_case("nowhere")
    assert len(str(caught.value).splitlines()) == 1


def test_report_names_table_experiment_counts_and_findings() -> None:
    data = copy.deepcopy(sound())
    add(data, FLEXION, "early_stance", "knee.angle_deg > 60")
    case = case_of(data)
    found = check(case, [rule for rule in RULES if rule.__name__ in ("ambiguity", "undeclared_cycle")])
    document = report(case, found)
    assert (document["schema_version"], document["table"], document["experiment"]) == (
        2,
        "five_phases",
        "treadmill_guided",
    )
    assert document["counts"] == {"errors": 1, "warnings": 1, "notes": 0, "waived": 0}
    assert [item["severity"] for item in document["findings"]] == ["error", "warning"]
    contending = document["findings"][1]
    assert contending["rule"] == "ambiguity"
    assert contending["phase"] == FLEXION
    assert contending["transition"] == "swing_flexion → early_stance (planted)"
    assert contending["counterexample"]["knee.angle_deg"] > 60
    assert contending["counterexample"]["hip.angle_deg"] > 23.5
    assert states(contending["reason"], "swing_flexion → swing_extension (clearance)")


def test_findings_come_worst_first_and_then_in_the_order_of_the_phases() -> None:
    data = copy.deepcopy(sound())
    blind(data)
    add(data, "early_stance", "late_stance", "hip.angle_deg < 3")
    found = findings_of(data)
    ranks = [list(Severity).index(item.severity) for item in found]
    assert ranks == sorted(ranks)
    phases = list(data["phases"])
    errors = [phases.index(item.phase) for item in found if item.severity == "error" and item.phase]
    assert errors == sorted(errors)


def test_every_rule_is_listed_with_one_line() -> None:
    listed = rules()
    assert set(listed) == {rule.__name__ for rule in RULES} | {"invalid_waiver"}
    for name, meaning in listed.items():
        assert re.fullmatch(r"[a-z_]+", name)
        assert meaning.endswith((".", ":")) and len(meaning) < 110


# ---------------------------------------------------------------------------------- schema


def test_keys_for_the_check_survive_being_written_and_read() -> None:
    data = copy.deepcopy(sound())
    data["cycles"] = [list(data["phases"]), [EXTENSION, "early_stance"]]
    data["waive"] = [
        {"rule": "ambiguity", "reason": "meant", "phase": FLEXION, "transition": "clearance"},
        {"rule": "cascade", "reason": "meant"},
    ]
    entry(data, "loaded")["driven_by"] = "contact"
    table = gait_table_from_mapping(data, "table.yaml", "t")
    assert isinstance(table, GaitTable)
    again = gait_table_from_mapping(table_document(table), "again.yaml", "t")
    assert again == table
    assert str(again.transitions[0].driven_by) == "contact"
    assert again.waivers[0].transition == "clearance"
    assert again.cycles[1] == (EXTENSION, "early_stance")


def test_the_name_of_a_preset_selects_its_own_table() -> None:
    assert "day" in presets() and "day" not in packaged_gait_tables()
    found, own = load_case("day"), load_case(None, "day")
    assert (found.table, found.experiment) == (own.table, own.experiment)


def test_the_check_before_a_run_makes_few_python_calls() -> None:
    """It delays every command: 364,000 calls on the default table, a quarter more are a regression."""
    experiment, calls = load_experiment("treadmill_guided").experiment, 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        check_before_run(experiment)
    finally:
        sys.setprofile(None)
    assert calls < 440_000
