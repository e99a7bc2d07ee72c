"""Tests that summary, description and pages identify wearer, gait table, device and controller of a run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import yaml
from errors import raises

from twin_gait import load_experiment, simulate
from twin_gait.cli.simulate import report
from twin_gait.configuration.experiments import experiment_from_mapping, resolved_document
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment.experiment import Experiment
from twin_gait.live.page import LiveScene
from twin_gait.parameters.wearer import Patient
from twin_gait.report.formatting import describe
from twin_gait.runs.record import load_run, save_run
from twin_gait.runs.run_page import page_texts
from twin_gait.runs.stored_run import StoredRun
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import override_experiment, simulate_batch

STROKE = ("patient=stroke_left", "patient.mass_kg=62", "patient.height_m=1.63")
KEYS = ("patient", "table", "device", "controller")
DIFFERENCES = {
    "patient": ["patient=stroke_left"],
    "table": ["table=treadmill_pre_swing"],
    "device": ["plant.friction_ratio.hip=0.6"],
    "controller": ["control.mode=position"],
}


def experiment(*settings: str, source: str | Path = "treadmill_guided") -> Experiment:
    return load_experiment(source, ["duration_s=0.02", *settings]).experiment


def stored(*settings: str) -> StoredRun:
    run = simulate(experiment(*settings))
    return StoredRun(run, summarise_run(run))


@pytest.fixture(scope="module")
def plain() -> StoredRun:
    return stored()


@pytest.mark.parametrize("key", DIFFERENCES)
def test_summaries_and_pages_of_two_runs_differ_only_in_the_changed_values(
    key: str, plain: StoredRun
) -> None:
    other = stored(*DIFFERENCES[key])
    assert [name for name in KEYS if plain.summary[name] != other.summary[name]] == [key]
    (text,) = page_texts(other, plain)["differing"]
    (counterpart,) = page_texts(plain, other)["differing"]
    assert text in describe(other.run.experiment) and counterpart in describe(plain.run.experiment)
    same = [part for part in describe(other.run.experiment) if part != text]
    assert same == [part for part in describe(plain.run.experiment) if part != counterpart]
    assert sum(other.summary["description"] in line for line in report(other.summary)) == 1


def test_a_changed_person_is_named_and_marked_as_changed() -> None:
    shipped, changed = experiment("patient=stroke_left"), experiment(*STROKE)
    digest = summarise_run(simulate(changed))["patient"]["sha256"]
    walk, device = "1.50 km/h, 60 % of the weight supported", "device twin"
    parts = ["stroke_left, 70 kg, 1.75 m", walk, "table treadmill_guided", device, "controller impedance"]
    assert describe(shipped) == parts
    assert describe(changed)[0] == f"stroke_left with changes ({digest[:6]}), 62 kg, 1.63 m"
    assert describe(experiment(*STROKE, "patient.effort_noise=0.3"))[0] != describe(changed)[0]
    assert describe(replace(changed, patient=shipped.patient)) == describe(shipped)  # changed back in Python
    assert describe(replace(shipped, patient=Patient(mass=80.0)))[0] == "80 kg, 1.75 m"
    assert describe(replace(shipped, patient=None))[0] == "no wearer"


def test_own_parts_are_named_by_their_files_and_two_versions_differ(tmp_path: Path) -> None:
    (tmp_path / "anna.yaml").write_text("mass_kg: 60\nleft: {knee: {passive: 1}}\n", encoding="utf-8")
    (tmp_path / "slow.yaml").write_text(
        "extends: treadmill_guided\nblending: {duration_ms: 90}\n", encoding="utf-8"
    )
    settings = [f"{key}={tmp_path / name}.yaml" for key, name in (("patient", "anna"), ("table", "slow"))]
    found = describe(experiment(*settings))
    for text, name in zip(
        found[::2] + found[3:4],
        ("anna (", "table slow (", "controller", "device twin"),
        strict=True,
    ):
        assert text.startswith(name)
    other = describe(experiment(*settings, "patient.left.knee.passive=2", "table.blending.duration_ms=80"))
    assert other[0].startswith("anna (") and other[2].startswith("table slow (")
    assert other[0] != found[0] and other[2] != found[2]


@pytest.mark.parametrize(
    "preset", ["overground", "day", "treadmill_ankle", "bench_leg", "treadmill_start_stop"]
)
def test_presets_are_as_shipped(preset: str) -> None:
    assert not [text for text in describe(load_experiment(preset).experiment) if "(" in text]


@pytest.mark.parametrize("typed", [True, False])
def test_names_are_read_back_from_a_run_folder(typed: bool, tmp_path: Path) -> None:
    loaded = load_experiment("treadmill_guided", ["duration_s=0.02", *STROKE])
    run = simulate(loaded.experiment)
    document = resolved_document(loaded.experiment, loaded.document if typed else None, {})
    assert document["patient"]["name"] == "stroke_left"
    again = experiment_from_mapping(yaml.safe_load(json.dumps(document)), "again", Path())
    expected = replace(
        loaded.experiment, integration=loaded.experiment.resolved_integration
    )  # which a folder has
    assert again == expected and describe(again) == describe(loaded.experiment)
    folder = save_run(run, tmp_path / "walk", pictures=False)
    assert describe(load_run(folder).experiment) == describe(loaded.experiment)
    kept = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert {key: kept[key] for key in KEYS} == {key: summarise_run(run)[key] for key in KEYS}


def test_a_name_changes_no_number_of_a_run(plain: StoredRun) -> None:
    named = replace(plain.run.experiment, patient=replace(plain.run.experiment.patient, name="Anna"))
    assert simulate(named).log.equals(plain.run.log)


def test_a_sweep_has_the_same_columns_and_numbers_with_a_named_wearer() -> None:
    named = experiment("patient=stroke_left")
    nameless = replace(named, patient=replace(named.patient, name=None))
    overrides = [{"patient.mass_kg": mass} for mass in (55, 70)]
    tables = [simulate_batch(walk, overrides, workers=1) for walk in (named, nameless)]
    pd.testing.assert_frame_equal(*tables)
    changed, as_shipped = (override_experiment(named, item) for item in overrides)
    assert describe(changed)[0].startswith("stroke_left with changes (")
    assert describe(as_shipped) == describe(named)


def test_the_live_page_describes_its_walk() -> None:
    walk = experiment(*STROKE)
    assert LiveScene(build_setup(walk)).page["subtitle"] == describe(walk)


@pytest.mark.parametrize("name", ["", "../anna", "a\nb", ".", "x" * 81, "\x1b[2J"])
def test_a_name_with_special_characters_is_refused(name: str, tmp_path: Path) -> None:
    with raises(ParameterError, "name", "1", "80"):
        Patient(name=name)
    file = tmp_path / "anna.yaml"
    file.write_text(json.dumps({"name": name}), encoding="utf-8")
    if name:  # an empty one is that of the file
        with raises(TwinGaitError, "anna.yaml", "name"):
            experiment(f"patient={file}")
