"""Experiments in and out of YAML."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from errors import raises
from numpy.testing import assert_allclose
from twin_device import HIP_FRICTION, KNEE_FRICTION

import twin_gait
from twin_gait import load_experiment, presets, simulate
from twin_gait.configuration.documents import dump_yaml, experiment_document, table_document
from twin_gait.configuration.experiments import experiment_from_mapping, resolved_document
from twin_gait.configuration.gait_table_file import (
    gait_table_from_mapping,
    load_gait_table,
    packaged_gait_tables,
)
from twin_gait.configuration.validation import assign, merge, parse_assignment
from twin_gait.exceptions import ParameterError, ParameterFileError, TwinGaitError
from twin_gait.parameters.environment import CONTACTS
from twin_gait.parameters.friction import AsymmetricFriction, LuGreFriction
from twin_gait.vocabulary import JointName


def reread(document: dict, folder: Path = Path()):
    return experiment_from_mapping(yaml.safe_load(dump_yaml(document)), "again.yaml", folder)


def with_stepping(experiment):
    """The experiment with the integrator and step that it left to its engine written out."""
    return dataclasses.replace(experiment, integration=experiment.resolved_integration)


@pytest.mark.parametrize("name", sorted(presets()))
def test_every_preset_survives_being_written_and_read_in_si(name):
    experiment = load_experiment(name).experiment
    assert reread(experiment_document(experiment)) == experiment


@pytest.mark.parametrize("name", sorted(presets()))
def test_every_preset_survives_being_written_and_read_as_typed(name):
    loaded = load_experiment(name, ["duration_s=3"])
    document = resolved_document(loaded.experiment, loaded.document, {})
    assert reread(document) == with_stepping(loaded.experiment)


@pytest.mark.parametrize("name", packaged_gait_tables())
def test_every_gait_table_survives_being_written_and_read(name):
    table = load_gait_table(name)
    assert gait_table_from_mapping(table_document(table), "again.yaml", name) == table


def test_resolved_document_keeps_the_units_as_typed():
    loaded = load_experiment("treadmill_guided")
    document = resolved_document(loaded.experiment, loaded.document, {})
    assert document["scenario"]["belt_speed_km_per_h"] == 1.5
    assert "stiffness_Nm_per_deg" in document["table"]["phases"]["early_stance"]["hip"]


def test_resolved_document_of_an_experiment_changed_in_python_has_the_changes():
    loaded = load_experiment("treadmill_guided")
    changed = dataclasses.replace(loaded.experiment, duration=3.0)
    document = resolved_document(changed, loaded.document, {})
    assert document["duration_s"] == 3.0
    assert reread(document) == with_stepping(changed)


def test_experiment_of_a_changed_urdf_is_refused(tmp_path):
    urdf = tmp_path / "leg.urdf"
    from twin_gait.leg_model.urdf import packaged_urdf

    urdf.write_text(packaged_urdf("twin_leg.urdf").read_text())
    loaded = load_experiment("bench_leg", [f"leg.urdf={urdf}", "duration_s=1"])
    document = resolved_document(loaded.experiment, loaded.document, {})
    assert reread(document) == with_stepping(loaded.experiment)
    urdf.write_text(urdf.read_text() + "<!-- changed -->\n")
    with raises(ParameterFileError, "urdf_sha256", "leg.urdf"):
        reread(document)


def test_running_the_written_experiment_again_gives_the_same_log_bit_for_bit(tmp_path):
    loaded = load_experiment("treadmill_guided", ["duration_s=0.6", "patient.mass_kg=81.3"])
    path = tmp_path / "experiment.yaml"
    path.write_text(dump_yaml(resolved_document(loaded.experiment, loaded.document, {})))
    first, second = simulate(loaded.experiment), simulate(load_experiment(path).experiment)
    for name in first.log.columns:
        assert first.log[name].equals(second.log[name]), name


@pytest.mark.parametrize("preset", ["treadmill_guided", "overground"])
def test_a_word_stands_for_a_whole_set_of_contact_parameters(preset):
    experiment = load_experiment(preset, ["scenario.contact=calibrated"]).experiment
    assert experiment.scenario.contact == CONTACTS["calibrated"]
    assert reread(experiment_document(experiment)).scenario.contact == CONTACTS["calibrated"]
    with raises(ParameterFileError, "scenario.contact", "soft or calibrated", "'hard'"):
        load_experiment(preset, ["scenario.contact=hard"])


def test_a_file_over_a_preset_changes_only_its_keys(tmp_path):
    path = tmp_path / "heavy.yaml"
    path.write_text("schema_version: 2\npreset: treadmill_guided\npatient: {mass_kg: 85}\n")
    experiment = load_experiment(path).experiment
    base = load_experiment("treadmill_guided").experiment
    assert experiment.name == "heavy"
    assert experiment.patient.mass == 85.0
    assert experiment.patient.height == base.patient.height
    assert experiment.table == base.table


def test_a_file_may_change_a_part_of_the_preset_table(tmp_path):
    path = tmp_path / "stiff.yaml"
    path.write_text(
        "preset: treadmill_guided\ntable: {phases: {early_stance: {knee: {stiffness_Nm_per_rad: 300}}}}\n"
    )
    table = load_experiment(path).experiment.table
    assert table.phases["early_stance"].joints["knee"].stiffness == 300.0
    base = load_gait_table("treadmill_guided")
    assert table.phases["early_stance"].joints["hip"] == base.phases["early_stance"].joints["hip"]


def test_a_table_is_found_next_to_the_file(tmp_path):
    (tmp_path / "mine.yaml").write_text(dump_yaml(table_document(load_gait_table("bench_leg"))))
    (tmp_path / "run.yaml").write_text("preset: bench_leg\ntable: mine.yaml\n")
    assert load_experiment(tmp_path / "run.yaml").experiment.table == load_gait_table("bench_leg")


def test_setting_a_value_in_another_unit_replaces_the_old_one():
    slow = load_experiment("treadmill_guided", ["scenario.belt_speed_m_per_s=0.36"]).experiment
    assert slow.scenario.belt_speed == 0.36


def test_settings_reach_defaults_that_the_preset_does_not_name():
    experiment = load_experiment("treadmill_guided", ["plant.friction_ratio.knee=0.9"]).experiment
    assert experiment.plant.friction_ratio == {"hip": 0.5, "knee": 0.9}


def test_settings_reach_list_elements():
    loaded = load_experiment("treadmill_guided", ['table.transitions[0].all[0]="hip.angle_deg < 5"'])
    assert str(loaded.experiment.table.transitions[0].guard).startswith("hip.angle_deg < 5")


def test_each_engine_has_its_own_default_integrator():
    def stepping(preset, *settings):
        used = load_experiment(preset, settings).experiment.resolved_integration
        return str(used.method), used.step

    assert stepping("treadmill_guided") == ("rk4", 0.25e-3)
    assert stepping("bench_leg") == ("rk4", 1e-3)
    assert stepping("treadmill_guided", "engine=pinocchio") == ("semi_implicit_euler", 0.25e-3)
    assert stepping("treadmill_guided", "integration.step_ms=0.2") == ("rk4", 0.2e-3)
    euler = "integration.method=semi_implicit_euler"
    assert stepping("treadmill_guided", euler) == ("semi_implicit_euler", 0.125e-3)


@pytest.mark.parametrize(
    ("settings", "step"),
    [
        ((), 0.25e-3),
        (("scenario.support.share=0.4",), 0.25e-3),  # 1.5 km/h: step times rate is 2.64 of 2.785
        (("scenario.support.share=0.3",), 0.2e-3),
        (("scenario.support.share=0",), 0.125e-3),
        (("scenario.belt_speed_km_per_h=2",), 0.2e-3),
        (("scenario.belt_speed_km_per_h=4",), 0.125e-3),  # the estimate of the load peak is limited
        (("scenario.contact.transition_velocity_m_per_s=0.01",), 0.05e-3),
        (("scenario.contact=calibrated",), 0.25e-3),
        (("scenario.contact.stiffness_N_per_m1p5=2e6",), 0.2e-3),
        (("scenario.contact.transition_velocity_m_per_s=1e-5",), 0.01e-3),  # the smallest
    ],
)
def test_step_on_the_belt_follows_the_friction_of_a_loaded_foot(settings, step):
    assert load_experiment("treadmill_guided", settings).experiment.resolved_integration.step == step


def test_merge_replaces_a_quantity_in_another_unit():
    merged = merge({"damping_ratio": 0.7, "a": {"x": 1}}, {"damping_Nms_per_rad": 40, "a": {"y": 2}})
    assert merged == {"damping_Nms_per_rad": 40, "a": {"x": 1, "y": 2}}


def test_merge_and_assign_do_not_change_their_arguments():
    base = {"a": {"b": [1, 2]}}
    assert assign(base, ["a", "b", 1], 5) == {"a": {"b": [1, 5]}}
    assert base == {"a": {"b": [1, 2]}}


def test_assignment_values_are_yaml():
    assert parse_assignment("a.b[2].c={x: [1, false]}") == (["a", "b", 2, "c"], {"x": [1, False]})


BAD_SETTINGS = {
    "speed=0.8": "did you mean 'scenario.belt_speed_m_per_s' or 'scenario.belt_speed_km_per_h'",
    "scenario.speed=2": "scenario.speed: unknown key; did you mean 'belt_speed_m_per_s'",
    "mass=80": "did you mean 'patient.mass_kg'",
    "voltage=24": "did you mean 'plant.battery.voltage_V'",
    "sead=1": "did you mean 'seed'",
    "patient.mass=3": "did you mean 'mass_kg'",
    "patient.mass_kg=-3": "10 to 160 kg",
    "patient.mass_kg=heavy": "expected a number",
    "patient.mass_kg=true": "expected a number",
    "patient.height_m=3": "0.70 to 2.20 m",
    "patient.height_m=2": "1.464 to 1.951 m",
    "patient.segment_model=dempster": "'de_leva' or 'winter'",
    "plant.friction_ratio.knee=-1": "friction_ratio.knee: expected a number from 0 to 10",
    "plant.actuators.hip.gear_efficiency=0.2": "hip.gear_efficiency: expected 0.5 to 1, got 0.2",
    "plant.electronics.regeneration=1.1": "regeneration: expected",
    "plant.friction.knee={law: lugr}": "'rotational', 'asymmetric', 'lugre'",
    "plant.friction.knee={law: lugre, coulomb_friction_Nm: 2}": "bristle_stiffness_Nm_per_rad: is missing",
    "plant.friction.knee={law: lugre, sigma0: 2}": "plant.friction.knee.sigma0: unknown key; allowed:",
    "plant.friction.knee={law: asymmetric, bristle_damping: 2}": "transition_velocity_rad_per_s",
    "plant.friction.knee={law: lugre, coulomb_friction_Nm: -2, bristle_stiffness_Nm_per_rad: 9}": (
        "knee.coulomb_friction_Nm: expected a number above 0"
    ),
    "control.friction_model.knee={law: lugre}": "input should be 'rotational', got 'lugre'",
    "scenario.amplitude_m=1": "unknown key; allowed: kind, belt_speed_m_per_s",
    "table.phases.early_stance.hip.stiffness_Nm_per_deg=-2": "expected a number from 0 to",
    "table.phases.early_stance.hip.stiffness_Nm=2": "unknown key",
    "table.phases.early_stance.hip.friction_compensation_gain=1.5": "expected a number from 0 to 1, got 1.5",
    "table.phases.early_stance.hip.damping_ratio=.inf": "finite number",
    "table.transitions[2].all[0]=hip.angle_deg < x": "expected a strict 'signal < number'",
    "table.transitions[2].to=nowhere": "no phase 'nowhere'",
    "table.transitions[99].to=late_stance": "table.transitions is a list with positions [0] to",
    "table=no_such_table": "no gait table",
    "table.sides.lefft={}": "sides.lefft: input should be 'left' or 'right'",
    "plant.friction=mine.yaml": "plant.friction: expected keys and values, got 'mine.yaml'",
    "patient.left=3": "patient.left: expected keys and values, got 3",
    "duration_s=.nan": "finite number",
    "duration_s=0": "duration",
    "duration_s=1e6": "0.001 to 3600",
    "scenario.kind=moon": "moon",
    "scenario.support.share=1.2": "from 0 to 1",
    "scenario.belt_speed_m_per_s=-1": "belt speed",
    "scenario.leading_phase=flying": "leading_phase: expected a phase of gait table 'treadmill_guided'",
    "modes=walking": "expected one of the postures of gait table 'treadmill_guided' (none), got",
    "requests=walk@2s": "requests: input should be a valid list, got 'walk@2s'",
    "leg.urdf=no.urdf": "no such URDF",
    "integration.step_ms=0.3": "whole number of steps",
    "integration.method=magic": "rk4",
    "control.limits.torque_Nm=150": "control.limits.hip.torque_Nm: expected at most 110",
    "engine=warp": "pinocchio",
    "seed=-1": "seed",
    "name=a/b": "a name without slashes",
    "nonsense": "key=value",
    "=3": "key=value",
    "a b=3": "a key of names joined by dots",
    "patient.mass_kg=[1": "not valid YAML",
}


@pytest.mark.parametrize(("setting", "message"), BAD_SETTINGS.items(), ids=BAD_SETTINGS.keys())
def test_bad_settings_are_refused_in_one_line_with_a_suggestion(setting, message):
    with pytest.raises(TwinGaitError) as caught:
        simulate(load_experiment("treadmill_guided", ["duration_s=0.01", setting]).experiment)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_mistake_in_a_variant_names_the_keys_of_that_variant():
    with raises(ParameterFileError, "scenario.strat", "start", "kind"):
        load_experiment("bench_leg", ["scenario.strat=3"])


LUGRE = "{law: lugre, coulomb_friction_Nm: 2, bristle_stiffness_Nm_per_rad: 900"
FRICTION_LAWS = {
    LUGRE + "}": LuGreFriction(coulomb_friction=2.0, bristle_stiffness=900.0),
    LUGRE + ", viscous_friction_forward_Nm: 3, viscous_friction_backward_Nm: 3}": LuGreFriction(
        coulomb_friction=2.0,
        bristle_stiffness=900.0,
        viscous_friction_forward=3.0,
        viscous_friction_backward=3.0,
    ),
    "{law: asymmetric, coulomb_friction_Nm: 2, transition_velocity_rad_per_s: 0.02, offset_Nm: -0.3, "
    "viscous_friction_forward_Nm: 3, viscous_exponent: 0.6, breakaway_torque_Nm: 4, "
    "stribeck_velocity_rad_per_s: 0.1}": AsymmetricFriction(
        coulomb_friction=2.0,
        transition_velocity=0.02,
        offset=-0.3,
        viscous_friction_forward=3.0,
        viscous_exponent=0.6,
        breakaway_torque=4.0,
        stribeck_velocity=0.1,
    ),
    "{law: rotational, breakaway_torque_Nm: 2}": replace(KNEE_FRICTION.normalised(), breakaway_torque=2.0),
}


@pytest.mark.parametrize(("text", "law"), FRICTION_LAWS.items(), ids=range(len(FRICTION_LAWS)))
def test_a_plant_takes_every_friction_law_and_writes_it_down(text, law, tmp_path):
    if "rotational" in text:  # a law of other keys takes the place of the whole
        text = text.replace("}", ", coulomb_friction_Nm: 3.193, breakaway_velocity_rad_per_s: 0.2031, "
                                 "viscous_friction_Nms_per_rad: 2.06}")  # fmt: skip
    loaded = load_experiment("bench_leg", [f"plant.friction.knee={text}"])
    friction = loaded.experiment.plant.friction
    assert friction == {JointName.HIP: HIP_FRICTION, JointName.KNEE: law}
    for document in (loaded.document, experiment_document(loaded.experiment)):
        path = tmp_path / "again.yaml"
        path.write_text(dump_yaml(document))
        assert load_experiment(path).experiment.plant.friction == friction
    changed = load_experiment(path, ["plant.friction.knee.coulomb_friction_Nm=2.5"]).experiment
    assert changed.plant.friction[JointName.KNEE] == replace(law, coulomb_friction=2.5)


def test_a_file_may_set_the_friction_law_of_one_joint_only(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"preset: bench_leg\nplant: {{friction: {{hip: {LUGRE}}}}}}}\n")
    friction = load_experiment(path).experiment.plant.friction
    law = LuGreFriction(coulomb_friction=2.0, bristle_stiffness=900.0)
    assert friction == {JointName.HIP: law, JointName.KNEE: KNEE_FRICTION}


def test_unknown_urdf_joint_lists_the_joints_of_the_urdf():
    with raises(TwinGaitError, "hinge", "left", "hip", "left_hip"):
        load_experiment("treadmill_guided", ["leg.left.hip=hinge"]).experiment.build_world()


def test_unknown_preset_lists_the_presets():
    folder = Path(twin_gait.__file__).parent / "configuration" / "presets"
    shipped = sorted(path.stem for path in folder.glob("*.yaml"))
    assert {"bench_leg", "day", "overground", "treadmill_guided"} <= set(shipped)
    with raises(ParameterError, *shipped):
        load_experiment("no_such_preset")


def test_unknown_base_preset_lists_the_presets(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("preset: moon\n")
    with raises(ParameterFileError, "run.yaml", "preset", "moon", "bench_leg"):
        load_experiment(path)


def test_an_experiment_that_extends_like_a_table_is_refused(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("extends: treadmill_guided\n")
    with raises(ParameterFileError, "run.yaml", "extends"):
        load_experiment(path)


# ---------------------------------------------------------------------- one quantity, two units


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        (
            "preset: treadmill_guided\nscenario: {belt_speed_m_per_s: 0.3, belt_speed_km_per_h: 2}",
            ("belt_speed_m_per_s", "belt_speed_km_per_h"),
        ),
        (
            "preset: treadmill_guided\ntable: {extends: treadmill_guided, phases: {late_stance: "
            "{hip: {stiffness_Nm_per_rad: 90, stiffness_Nm_per_deg: 1}}}}",
            ("stiffness_Nm_per_rad", "stiffness_Nm_per_deg"),
        ),
        (
            "preset: treadmill_guided\ntable: {extends: treadmill_guided, sides: {left: {late_stance: "
            "{hip: {damping_ratio: 1, damping_Nms_per_rad: 9}}}}}",
            ("damping_ratio", "damping_Nms_per_rad"),
        ),
    ],
)
def test_one_file_with_a_quantity_in_two_units_is_refused(tmp_path, text, keys):
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterFileError) as caught:
        load_experiment(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: line 2, column ") and "\n" not in message
    assert all(key in message for key in keys)


@pytest.mark.parametrize(
    ("settings", "keys"),
    [
        (
            ["scenario.belt_speed_m_per_s=0.4", "scenario.belt_speed_km_per_h=2"],
            ("scenario.belt_speed_m_per_s", "scenario.belt_speed_km_per_h"),
        ),
        (["scenario.leading_start={hip_deg: 20, hip_rad: 0.1, knee_deg: 5}"], ("hip_deg", "hip_rad")),
    ],
)
def test_one_command_line_with_a_quantity_in_two_units_is_refused(settings, keys):
    with raises(TwinGaitError, "--set", *keys) as caught:
        load_experiment("treadmill_guided", settings)
    assert "\n" not in str(caught.value)


def test_each_level_replaces_a_quantity_of_the_level_below_in_any_unit(tmp_path):
    """Preset in km/h and Nm/deg; a file over it in m/s and Nm/rad; settings over that the other way again."""
    path = tmp_path / "mine.yaml"
    path.write_text(
        "preset: treadmill_guided\nscenario: {belt_speed_m_per_s: 0.3}\n"
        "table: {extends: treadmill_guided, phases: {late_stance: {hip: {stiffness_Nm_per_rad: 90}}}}\n",
        encoding="utf-8",
    )

    def found(*settings):
        experiment = load_experiment(path, settings).experiment
        return (
            experiment.scenario.belt_speed,
            experiment.table.phases["late_stance"].joints["hip"].stiffness,
        )

    assert found() == (0.3, 90.0)
    above = ["scenario.belt_speed_km_per_h=1.8", "table.phases.late_stance.hip.stiffness_Nm_per_deg=2"]
    assert_allclose(found(*above), (0.5, math.degrees(2.0)), rtol=1e-15)


def test_the_last_of_two_settings_with_the_same_key_counts():
    settings = ["scenario.belt_speed_m_per_s=0.4", "scenario.belt_speed_m_per_s=0.5"]
    assert load_experiment("treadmill_guided", settings).experiment.scenario.belt_speed == 0.5


@pytest.mark.parametrize(
    ("key", "outside"),
    [
        ("patient.mass_kg", 9),
        ("patient.height_m", 1.46),  # that of the device
        ("patient.height_m", 2.05),
        ("patient.effort_delay_s", 2),
        ("patient.both.knee.passive", 4),
        ("scenario.support.share", 1.2),
        ("duration_s", 1e9),
    ],
)
def test_a_message_with_a_range_states_the_range_that_is_applied(key, outside):
    def refusal(value):
        try:
            load_experiment("treadmill_guided", [f"{key}={value!r}"]).experiment.build_world()
        except TwinGaitError as error:
            return str(error)
        return ""

    found = re.search(r"expected .*?([\d.]+) to ([\d.]+)", refusal(outside))
    assert found is not None
    low, high = map(float, found.groups())
    assert refusal(low) == refusal(high) == ""
    assert refusal(low * 0.999 or -0.001) and refusal(high * 1.001)


@pytest.mark.parametrize(("height", "fits"), [(0.69, False), (0.70, True), (2.20, True), (2.21, False)])
def test_a_device_made_to_measure_fits_every_wearer(height: float, fits: bool) -> None:
    settings = ["leg.sizes=null", f"patient.height_m={height}"]
    if fits:
        assert load_experiment("treadmill_guided", settings).experiment.build_world().model.sizes is not None
    else:
        with raises(ParameterFileError, "patient.height_m", "0.70 to 2.20 m"):
            load_experiment("treadmill_guided", settings)
