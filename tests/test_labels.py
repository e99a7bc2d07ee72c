"""Labels of quantities: names for people, composed from keys, with unit and display unit."""

from __future__ import annotations

import math
import re

import pytest
from synthetic_run import synthetic_run

from twin_gait import load_experiment, presets
from twin_gait.configuration.documents import experiment_document
from twin_gait.labels import Label, label_of
from twin_gait.report.formatting import walk_table
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import SUMMARY_COLUMNS
from twin_gait.studies.compare.writing import shown_measures
from twin_gait.vocabulary import JointName

BRACED = ["interface=brace", "scenario.support.guide=harness"]
# Spellings of units at the end of a key, which no name may contain.
UNIT_WORDS = re.compile(r"\b(deg|rad|pct|percent|Nm|Nms|Ohm)\b|_")


def numbers_of(value: object, path: str = "") -> list[str]:
    """Paths of all numbers in a document."""
    if isinstance(value, dict):
        return [
            found for key, item in value.items() for found in numbers_of(item, f"{path}.{key}".strip("."))
        ]
    return [path] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def check_label(key: str) -> None:
    label = label_of(key)
    assert label.name and label.unit and label.display_unit, key
    assert not UNIT_WORDS.search(label.name), (key, label.name)
    assert "_" not in label.axis, key


@pytest.mark.parametrize(
    ("key", "axis"),
    [
        ("left_knee_angle_rad", "left knee angle θ [°]"),
        ("right_hip_stiffness_Nm_per_rad", "right hip stiffness k [N·m/°]"),
        ("left_foot_cop_ratio", "left foot centre of pressure"),
        ("battery_power_W", "battery power P [W]"),
        ("hip_lowest_deg", "hip angle, smallest [°]"),
        ("right_knee_error_shift_percent", "right knee time shift [% of stride]"),
        ("sides.right.errors.knee.shift_percent", "right knee time shift [% of stride]"),
        ("sides.left.joints.hip.saturated_share", "left hip time at a motor limit [%]"),
        ("sides.left.phase_duration_mean_s.early_stance", "mean duration of left early stance [s]"),
        ("interaction.left_hip.torque_rms_Nm", "left hip brace torque, RMS [N·m]"),
        ("scenario.belt_speed_m_per_s", "belt speed [m/s]"),
        ("scenario.belt_speed_km_per_h", "belt speed [km/h]"),
        ("scenario.support.share", "body-weight support [%]"),
        ("patient.mass_kg", "wearer mass [kg]"),
        ("control.limits.torque_Nm", "torque limit [N·m]"),
        ("control.target_torque_Nm.left_hip", "left hip target torque [N·m]"),
        ("table.phases.early_stance.knee.stiffness_Nm_per_deg", "early stance knee stiffness k [N·m/°]"),
        ("plant.actuators.hip.resistance_Ohm", "hip motor resistance [Ω]"),
        ("plant.friction_ratio.hip", "hip friction over model friction"),
        ("scenario.chair.hip_height_m", "height of the hips above the chair [m]"),
        ("set.duration_s", "duration [s]"),
        ("mine", "mine"),
        ("table", "table"),
        ("patient", "wearer"),
    ],
)
def test_places_and_sections_of_a_key_come_before_the_name(key: str, axis: str) -> None:
    assert label_of(key).axis == axis


def test_values_are_converted_to_the_display_unit() -> None:
    assert label_of("left_hip_angle_rad").convert(math.pi) == pytest.approx(180.0)
    assert label_of("left_hip_stiffness_Nm_per_rad").convert(180.0 / math.pi) == pytest.approx(1.0)
    assert label_of("swing_share").convert(0.4) == pytest.approx(40.0)
    assert label_of("symmetry.stride_time_mean_s").convert(0.1) == pytest.approx(10.0)
    assert label_of("sides.left.toe_clearance_min_m").convert(0.012) == pytest.approx(12.0)
    assert label_of("hip_lowest_deg").convert(12.0) == 12.0 and label_of("slip_m").convert(None) is None
    assert Label("name").title == "name"


def test_every_column_of_the_log_has_a_label_with_a_unit() -> None:
    for preset, given in (*((name, []) for name in presets()), ("treadmill_guided", BRACED)):
        for column in log_layout(build_setup(load_experiment(preset, given).experiment)).names:
            check_label(column)


def test_no_label_of_a_number_of_an_experiment_contains_an_underscore() -> None:
    for preset in presets():
        keys = numbers_of(experiment_document(load_experiment(preset).experiment))
        assert len(keys) > 50 and not [key for key in keys if "_" in label_of(key).axis]


def test_every_number_of_a_summary_has_a_label_and_the_table_of_the_walk_shows_no_key() -> None:
    summary = summarise_run(synthetic_run())
    keys = numbers_of(summary)
    assert len(keys) > 150
    for key in keys:
        check_label(key)
    rows = [row[0] for row in walk_table(summary)]
    assert len(set(rows)) == len(rows) > 30
    assert not [row for row in rows if UNIT_WORDS.search(row.split(" [")[0])]


def test_columns_of_sweeps_and_rows_of_comparisons_have_labels() -> None:
    for column in SUMMARY_COLUMNS:
        check_label(column)
    titles = [label_of(column).title for column in SUMMARY_COLUMNS if column != "trip_time_s"]
    assert len(set(titles)) == len(titles)
    for rows in shown_measures(tuple(JointName)).values():
        for name, shown in rows.items():
            check_label(name)
            assert shown.label == label_of(name).title and shown.factor == label_of(name).factor
