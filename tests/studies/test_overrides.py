"""An override converts what it touches, and gives what the whole document would give."""

import pytest
from errors import raises

from twin_gait.configuration.experiments import experiment_from_mapping, load_experiment
from twin_gait.studies.batch import apply_override, attach_document

OVERRIDES = [
    {"patient.mass_kg": 80},
    {"scenario.contact.stiffness_N_per_m1p5": 2e5},
    {"scenario.belt_speed_km_per_h": 1.7},
    {"plant.friction.hip.coulomb_friction_Nm": 5.0},
    {"plant.actuators.knee.gear_ratio": 120},
    {"control.friction_model.knee.viscous_friction_Nms_per_rad": 2.5},
    {"control.safety.enabled": False, "control.limits.current_A": 9},
    {"sensors.ideal": False, "sensors.trunk.time_constant_s": 2.0},
    {"table.phases.late_stance.hip.stiffness_Nm_per_deg": 1.1, "table.blending.duration_ms": 100},
    {"table.transitions[0].debounce_ms": 7},
    {"integration.step_ms": 0.2},
    {"interface": "brace", "patient.height_m": 1.8},
    {"duration_s": 3, "seed": 5, "faults": ["encoder_freeze:left_knee@1s"]},
]


@pytest.fixture(scope="module")
def base():
    return attach_document(load_experiment("treadmill_guided").experiment)


@pytest.mark.parametrize("override", OVERRIDES, ids=lambda override: next(iter(override)))
def test_an_override_equals_a_setting_of_the_whole_file(base, override):
    texts = [
        f"{key}={str(value).lower() if isinstance(value, bool) else value}" for key, value in override.items()
    ]
    assert apply_override(base, override) == load_experiment("treadmill_guided", texts).experiment


def test_an_override_converts_only_the_changed_values(base):
    found, experiment = apply_override(base, {"plant.actuators.knee.gear_ratio": 120}), base.experiment
    untouched = ("scenario", "leg", "table", "patient", "control", "sensors")
    assert all(getattr(found, name) is getattr(experiment, name) for name in untouched)
    assert found.plant.battery is experiment.plant.battery
    found = apply_override(base, {"table.phases.late_stance.hip.stiffness_Nm_per_deg": 1.1})
    assert all(
        one is other for one, other in zip(found.table.transitions, experiment.table.transitions, strict=True)
    )
    same = {name for name, phase in found.table.phases.items() if phase is experiment.table.phases[name]}
    assert same == set(experiment.table.phases) - {"late_stance"}


def test_a_table_for_other_joints_inherits_no_phase_from_the_old_one(base):
    document = {**base.document, "table": {**base.document["table"], "joints": ["hip", "foot"]}}
    with raises(Exception, "phases.early_stance.knee"):
        experiment_from_mapping(document, "override", None, base)
