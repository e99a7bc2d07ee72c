"""Tests of the notes on a healthy reference that is used outside of its range."""

from dataclasses import replace

import pytest
from errors import raises, states

from twin_gait import load_experiment, presets
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.reference_gait import ReferenceGait
from twin_gait.report.formatting import extrapolation_note
from twin_gait.report.reference import reference_notes
from twin_gait.runs.summary import describe_identity
from twin_gait.vocabulary import JointName


def notes(*settings, preset="treadmill_guided"):
    return reference_notes(load_experiment(preset, list(settings)).experiment)


def test_no_shipped_preset_is_outside_of_the_range():
    assert {name: notes(preset=name) for name in presets()} == {name: [] for name in presets()}


@pytest.mark.parametrize(("speed", "nearest"), [(0.4, "0.5"), (5.5, "5")])
def test_a_speed_without_a_reference_is_stated(speed, nearest):
    (note,) = notes(f"scenario.belt_speed_km_per_h={speed}")
    assert states(note, f"{speed} km/h", "0.5 to 5 km/h", f"use {nearest} km/h", "Koopman")


@pytest.mark.parametrize("speed", [0.5, 5.0])
def test_the_limits_of_the_speed_are_within_the_range(speed):
    assert notes(f"scenario.belt_speed_km_per_h={speed}") == []


@pytest.mark.parametrize(("age", "count"), [(46.9, 1), (47, 0), (68, 0), (68.1, 1), (9, 1)])
def test_only_a_known_age_outside_of_that_of_the_subjects_is_stated(age, count):
    found = notes(f"patient.age_years={age}")
    assert len(found) == count and all(states(note, "47", "68", f"{age:g}") for note in found)


def test_a_measured_reference_has_no_age_and_errors_at_any_speed():
    settings = ["patient.age_years=9", "scenario.belt_speed_km_per_h=0.4"]
    experiment = load_experiment("treadmill_guided", settings).experiment
    own = ReferenceGait(source="own", strides=1, subjects=1, mean={JointName.KNEE: (0.5,) * 101})
    (note,) = reference_notes(replace(experiment, reference=own))
    assert "missing" not in note and states(note, "effort", "use 0.5 km/h")


def test_nothing_is_stated_without_a_walk_or_a_wearer():
    assert notes("patient.age_years=9", preset="bench_leg") == []
    assert notes("patient=null", "scenario.belt_speed_km_per_h=0.4") == []


def test_terminal_page_and_summary_read_the_same_note():
    experiment = load_experiment(
        "treadmill_guided", ["patient.age_years=9", "patient.mass_kg=130"]
    ).experiment
    (note,) = reference_notes(experiment)
    assert extrapolation_note(describe_identity(experiment)).endswith(note)
    assert states(extrapolation_note(describe_identity(experiment)), "130 kg")


def test_an_age_has_a_range():
    with raises(ParameterFileError, "patient.age_years", "0 to 130 years", "-1"):
        load_experiment("treadmill_guided", ["patient.age_years=-1"])
