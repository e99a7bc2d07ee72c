"""People: in files, by name, on the command line, and drawn by the dozen."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml
from errors import raises, states

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.configuration.documents import dump_yaml, experiment_document
from twin_gait.configuration.experiments import (
    experiment_from_mapping,
    list_patients,
    load_named_document,
    presets,
    resolved_document,
)
from twin_gait.exceptions import ParameterFileError, TwinGaitError
from twin_gait.parameters.wearer import JointCondition, Patient
from twin_gait.studies.batch import override_experiment
from twin_gait.vocabulary import JointName, SegmentModel, Side

HIP, KNEE = JointName.HIP, JointName.KNEE
FOLDER = Path(str(files("twin_gait.configuration"))) / "patients"
NAMES = ("complete_sci", "healthy", "incomplete_sci", "passive_body", "stroke_left", "stroke_right")


def patient(*settings: str, source: str | Path = "treadmill_guided") -> Patient:
    found = load_experiment(source, settings).experiment.patient
    assert found is not None
    return found


def reread(document: dict[str, Any]) -> Any:
    return experiment_from_mapping(yaml.safe_load(dump_yaml(document)), "again.yaml", Path())


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str, str], Path]:
    def write(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


# ---------------------------------------------------------------- the block of a file


def test_units_of_a_condition_follow_its_keys():
    found = patient(
        "patient.left.hip={passive: 0.5, contracture_deg: 9, stretch_reflex_threshold_deg_per_s: 90,"
        " stretch_reflex_gain_Nms_per_rad: 2, effort: 0.4, strength: 0.7}",
        "patient.effort_delay_ms=120",
        "patient.effort_noise=0.05",
    )
    assert found.conditions == {
        (Side.LEFT, HIP): JointCondition(
            passive=0.5,
            contracture=math.radians(9.0),
            stretch_reflex_threshold=math.radians(90.0),
            stretch_reflex_gain=2.0,
            effort=0.4,
            strength=0.7,
        )
    }
    assert (found.effort_delay, found.effort_noise) == (0.12, 0.05)


def test_values_of_one_side_override_both():
    found = patient(
        "patient.both.knee={passive: 1, contracture_deg: 10}", "patient.right.knee.contracture_rad=0.1"
    )
    left, right = (found.conditions[side, KNEE] for side in Side)
    assert (left.passive, right.passive) == (1.0, 1.0)
    assert (left.contracture, right.contracture) == (math.radians(10.0), 0.1)


def test_setting_in_another_unit_replaces_the_old_one():
    found = patient(
        "patient.both.knee={passive: 1, contracture_deg: 10, stretch_reflex_threshold_deg_per_s: 50,"
        " stretch_reflex_gain_Nms_per_rad: 1}",
        "patient.both.knee.contracture_rad=0.2",
        "patient.both.knee.stretch_reflex_threshold_rad_per_s=2",
        "patient.effort_delay_ms=200",  # the complete document below has it in seconds
    )
    condition = found.conditions[Side.LEFT, KNEE]
    assert (condition.contracture, condition.stretch_reflex_threshold, found.effort_delay) == (0.2, 2.0, 0.2)


@pytest.mark.parametrize("name", sorted(presets()))
def test_wearer_of_every_shipped_experiment_makes_no_effort(name):
    """The wearer is mass alone, but for the passive moments of treadmill."""
    found = load_experiment(name).experiment.patient
    assert found is None or found.is_torque_free or name == "treadmill"
    assert found is None or all(condition.effort == 0.0 for condition in found.conditions.values())


MISTAKES = {
    "patient.left.kne.effort=1": ("patient.left.kne", "knee"),
    "patient.left.hip.efort=1": ("patient.left.hip.efort", "effort"),
    "patient.middle.hip.effort=1": ("patient.middle",),
    "patient.left.ankle.effort=1": ("patient.left.ankle", "hip", "knee"),
    "patient.left.hip.effort=2": ("patient.left.hip.effort", "0", "1", "2"),
    "patient.both.knee.passive=true": ("patient.both.knee.passive", "true"),
    "patient.both.knee.passive=-1": ("patient.both.knee.passive", "0", "3", "-1"),
    "patient.both.knee={passive: 1, contracture_deg: 80}": (
        "patient.both.knee.contracture_deg",
        "0",
        "60",
        "80 deg",
    ),
    "patient.both.knee.contracture_deg=5": ("both.knee.contracture", "0"),
    "patient.both.knee={contracture_deg: 5, contracture_rad: 0.1}": ("contracture_deg", "contracture_rad"),
    "patient.effort_delay_ms=2000": ("patient.effort_delay_ms", "0", "1000", "2000 ms"),
    "patient.effort_noise=.nan": ("patient.effort_noise", "nan"),
    "patient=nobody": ("patient", "nobody", "complete_sci", "healthy"),
    "patient={preset: 7}": ("patient", "7"),
}


@pytest.mark.parametrize("setting", MISTAKES)
def test_mistake_is_one_line_with_key_value_and_suggestion(setting):
    with raises(TwinGaitError, *MISTAKES[setting]) as caught:
        load_experiment("treadmill_guided", [setting])
    assert len(str(caught.value).splitlines()) == 1


# ---------------------------------------------------------------- by name


def test_five_people_ship_each_with_a_description():
    assert tuple(list_patients()) == NAMES
    assert all(list_patients().values())
    assert not set(list_patients()) & set(presets())  # one name, one thing to print


@pytest.mark.parametrize("name", NAMES)
def test_every_person_is_read_from_an_own_file(name):
    found = patient(f"patient={name}")
    assert not found.is_torque_free
    assert (found.mass, found.height) == (70.0, 1.75)  # what differs is what they do
    assert yaml.safe_load((FOLDER / f"{name}.yaml").read_text())["name"] == name


@pytest.mark.parametrize("name", NAMES)
def test_every_number_of_a_person_has_a_source_or_is_marked_as_an_assumption(name):
    """In the comment on its line or on the lines right above it."""
    lines = (FOLDER / f"{name}.yaml").read_text().splitlines()
    words = (
        "assumption",
        "19",
        "20",
        "as healthy",
        "as in complete",
        "by definition",
        "differ in what they do",
    )
    explained = False
    for line in lines:
        code, _, comment = line.partition("#")
        if not code.strip():
            explained = explained or any(word in comment for word in words)
            continue
        number = any(character.isdigit() for character in code) and not code.startswith("schema_version")
        explained = any(word in comment for word in words) or explained
        if number and not code.startswith(("mass_kg", "height_m")):
            assert explained, f"{name}: {line}"
        if code.rstrip().endswith(":"):
            explained = False


def test_two_strokes_are_mirror_images():
    left, right = patient("patient=stroke_left"), patient("patient=stroke_right")
    other = {Side.LEFT: Side.RIGHT, Side.RIGHT: Side.LEFT}
    assert {(other[side], joint): item for (side, joint), item in left.conditions.items()} == right.conditions


def test_paretic_knee_has_the_measured_strength():
    """0.90 against 1.24 N·m/kg (Watanabe et al. 2015)."""
    strength = patient("patient=stroke_left").conditions[Side.LEFT, KNEE].strength
    assert strength == pytest.approx(0.90 / 1.24, abs=0.005)


def test_complete_injury_has_no_effort_and_incomplete_injury_less_than_healthy():
    def given(name: str) -> set[float]:
        return {item.effort * item.strength for item in patient(f"patient={name}").conditions.values()}

    assert given("complete_sci") == {0.0}
    assert max(given("incomplete_sci")) < min(given("healthy")) == 1.0


def test_settings_change_a_named_person_in_any_order():
    orders = [("patient.mass_kg=82", "patient=healthy"), ("patient=healthy", "patient.mass_kg=82")]
    first, second = (patient(*order) for order in orders)
    assert first == second
    assert first.mass == 82.0
    assert first.conditions == patient("patient=healthy").conditions


def test_file_names_a_person_with_changes_or_a_person_file(file):
    own_file = file("mine.yaml", "description: mine\nmass_kg: 61\nboth: {knee: {passive: 0.5}}\n")
    by_name = file("a.yaml", "schema_version: 2\npreset: treadmill_guided\npatient: stroke_left\n")
    changed = file("b.yaml", "preset: treadmill_guided\npatient: {preset: stroke_left, height_m: 1.6}\n")
    beside = file("c.yaml", "preset: treadmill_guided\npatient: mine.yaml\n")
    stroke = patient("patient=stroke_left")
    assert patient(source=by_name) == stroke
    assert patient(source=changed).conditions == stroke.conditions
    assert patient(source=changed).height == 1.6
    assert patient(source=beside) == patient(f"patient={own_file}")
    assert patient(source=beside).mass == 61.0


def test_named_person_replaces_another_completely(file):
    base = file("base.yaml", "preset: treadmill_guided\npatient: stroke_left\n")
    assert patient("patient=complete_sci", source=base) == patient("patient=complete_sci")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("both: {knee: {pasive: 1}}", ("mine.yaml", "both.knee.pasive", "passive")),
        ("mass_kg: 200", ("mine.yaml", "mass_kg", "10", "160 kg")),
        ("left: {hip: {effort: 3}}", ("mine.yaml", "left.hip.effort", "0", "1")),
        ("{effort_delay_ms: 5, effort_delay_s: 1}", ("mine.yaml", "line 1", "effort_delay_ms")),
        ("[1, 2]", ("mine.yaml",)),
        ("preset: healthy", ("mine.yaml", "preset")),
        ("{preset: treadmill_guided, patient: {mass_kg: 60}}", ("mine.yaml", "preset")),
    ],
)
def test_mistake_in_the_file_of_a_person_names_that_file(file, text, message):
    with raises(ParameterFileError, *message):
        load_experiment("treadmill_guided", [f"patient={file('mine.yaml', text)}"])


def test_a_gait_table_is_exchanged_by_name_in_a_batch():
    base = load_experiment("treadmill_guided").experiment
    key = "table.phases.pre_swing.minimum_duration_ms"
    found = override_experiment(base, {key: 20, "table": "treadmill_pre_swing"}).table
    assert (
        found
        == load_experiment("treadmill_guided", ["table=treadmill_pre_swing", f"{key}=20"]).experiment.table
    )
    with raises(ParameterFileError, "override", "table", "x"):
        override_experiment(base, {"table": "x"})


def test_person_is_exchanged_by_name_in_a_batch():
    base = load_experiment("treadmill_guided", ["patient=stroke_left"]).experiment
    assert override_experiment(base, {"patient": "healthy"}).patient == patient("patient=healthy")
    heavy = override_experiment(base, {"patient": "healthy", "patient.mass_kg": 90}).patient
    assert override_experiment(base, {"patient.mass_kg": 90, "patient": "healthy"}).patient == heavy
    assert heavy == patient("patient=healthy", "patient.mass_kg=90")
    with raises(ParameterFileError, "override", "patient", "x"):
        override_experiment(base, {"patient": "x"})


# ---------------------------------------------------------------- there and back


@pytest.mark.parametrize("name", NAMES)
def test_person_survives_being_written_and_read(name):
    loaded = load_experiment("treadmill_guided", [f"patient={name}", "control.patient.mass_kg=65"])
    assert reread(experiment_document(loaded.experiment)) == loaded.experiment
    assert reread(loaded.document) == loaded.experiment
    as_kept = reread(resolved_document(loaded.experiment, loaded.document, {}))
    assert as_kept.patient == loaded.experiment.patient
    assert (
        load_named_document("patient", name, Path()).items() <= loaded.document["patient"].items()
    )  # units as typed


def test_segments_of_winter_survive_being_written_and_change_the_run():
    settings = ["engine=pinocchio", "duration_s=0.05"]
    loaded = load_experiment("bench_leg", [*settings, "patient.segment_model=winter"])
    document = experiment_document(loaded.experiment)
    assert document["patient"]["segment_model"] == "winter"
    again = reread(document)
    assert again.patient.segment_model is SegmentModel.WINTER and again == loaded.experiment
    ours, theirs = (simulate(item).log for item in (again, load_experiment("bench_leg", settings).experiment))
    assert (ours["right_hip_angle_rad"] != theirs["right_hip_angle_rad"]).any()


def test_written_wearer_omits_inactive_conditions():
    document = experiment_document(load_experiment("treadmill_guided").experiment)["patient"]
    assert not {"both", "left", "right"} & set(document)


def test_running_a_written_person_again_gives_the_same_log():
    settings = [
        "engine=pinocchio",
        "patient=incomplete_sci",
        "duration_s=0.15",
        "scenario.start_phase=swing_flexion",
    ]
    loaded = load_experiment("bench_leg", settings)
    again = reread(resolved_document(loaded.experiment, loaded.document, {}))
    first, second = simulate(loaded.experiment), simulate(again)
    assert (first.log["right_hip_external_torque_Nm"] != 0.0).any()
    assert first.log.equals(second.log)


# ---------------------------------------------------------------- the command line


def test_people_are_listed_and_printed_as_editable_files(capsys, tmp_path):
    assert main(["presets"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in (*NAMES, "treadmill_guided", "osl_walking"))
    assert main(["presets", "stroke_left"]) == 0
    (tmp_path / "edited.yaml").write_text(capsys.readouterr().out)
    assert patient(f"patient={tmp_path / 'edited.yaml'}") == patient("patient=stroke_left")


def test_wrong_person_ends_in_one_line_and_makes_no_folder(capsys, tmp_path):
    out = tmp_path / "run"
    assert main(["simulate", "treadmill_guided", "--set", "patient=nobody", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1
    assert states(error, "nobody")
    assert not out.exists()
