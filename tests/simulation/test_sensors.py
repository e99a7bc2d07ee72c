"""Encoders that were mounted askew: what they read in excess is there from tick 0 on, and moves nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from errors import raises
from twin_device import SENSORS

from twin_gait import load_experiment, simulate, simulate_batch
from twin_gait.configuration.bench_device import bench_joint
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.experiment import Experiment
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.sweep.spec import sweep_from_mapping
from twin_gait.vocabulary import JointName, Side

OFFSETS = {"left_hip": 2.0, "left_knee": 0.0, "right_hip": 0.0, "right_knee": -1.5}  # [deg]
ASKEW = "sensors.offset={left: {hip_deg: 2}, right: {knee_deg: -1.5}}"


def experiment(preset: str, *settings: str) -> Experiment:
    return load_experiment(preset, ["integration.method=semi_implicit_euler", *settings]).experiment


def test_an_encoder_reads_its_offset_in_excess_from_the_first_tick_on():
    log = simulate(experiment("treadmill_guided", ASKEW, "duration_s=0.3")).log
    for name, offset in OFFSETS.items():
        excess = log[f"{name}_measured_angle_rad"] - log[f"{name}_angle_rad"]
        np.testing.assert_allclose(excess, math.radians(offset), rtol=0.0, atol=1e-15)
        assert log[f"{name}_velocity_fast_rad_per_s"][0] == 0.0  # no jump that the filters could see


def test_offset_noise_and_counts_add_up():
    settings = ("sensors.ideal=false", "sensors.angle_noise_rad=1e-4", "duration_s=2")
    log = simulate(experiment("bench_leg", "sensors.offset.right.hip_deg=-3", *settings)).log
    excess = log["right_hip_measured_angle_rad"] - log["right_hip_angle_rad"]
    assert excess.mean() == pytest.approx(math.radians(-3.0), abs=1e-5)
    assert excess.std() == pytest.approx(1e-4, rel=0.1)


def test_an_encoder_offset_acts_as_an_equilibrium_offset():
    """Closed form: −k (θ + δ − θ0) is the law of an encoder that is right about θ0 − δ."""
    phase, settings = "table.phases.early_stance", ("duration_s=0.2", "control.safety.enabled=false")
    table = experiment("bench_leg").table
    rest = math.degrees(table.phases["early_stance"].joints["knee"].equilibrium_angle)
    # A damping ratio would hang on the inertia at the equilibrium.
    dampings = [f"{phase}.{joint}.damping_Nms_per_rad=15" for joint in ("hip", "knee")]
    weightless = (f"{phase}.gravity_compensation=0", *dampings, *settings)
    askew, other = (
        simulate(experiment("bench_leg", *weightless, change))
        for change in ("sensors.offset.right.knee_deg=2", f"{phase}.knee.equilibrium_deg={rest - 2.0!r}")
    )
    assert askew.switches == other.switches == ()
    assert abs(askew.log["right_knee_angle_rad"].iloc[-1] - math.radians(10.0)) > 1e-3  # it moves
    np.testing.assert_allclose(
        askew.log["right_knee_angle_rad"], other.log["right_knee_angle_rad"], rtol=0.0, atol=1e-13
    )


def test_a_trip_in_the_first_tick_holds_the_angle_that_the_encoder_reads():
    """Without the offset in the filters' start the hold would begin with a jump."""
    engine = CompiledEngine(build_setup(experiment("bench_leg", "sensors.offset.right.hip_deg=2")))
    joint = engine.episode["joints"][0]
    assert joint["board"]["encoder"]["angle"] == engine.episode["q"][0] + math.radians(2.0)


def test_offsets_are_swept_drawn_and_stored():
    spec = {
        "experiment": "bench_leg",
        "settings": {"duration_s": 0.05},
        "method": "latin_hypercube",
        "parameters": {"sensors.offset.right.hip_deg": {"from": -3, "to": 3}},
        "samples": 3,
    }
    sweep = sweep_from_mapping(spec, "spec", Path())
    table = simulate_batch(sweep.experiment, sweep.overrides)
    assert table["right_hip_torque_rms_Nm"].nunique() == 3
    assert table["status"].tolist() == ["completed"] * 3
    again = sweep_from_mapping(dict(sweep.document), "document", Path())
    assert again.document == sweep.document


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sensors.offset.right.hip_deg=10.1", ("sensors.offset.right.hip_deg", "-10", "10", "10.1 deg")),
        ("sensors.offset.left.hip_deg=1", ("offset", "left")),
        ("sensors.offset.right.ankle_deg=1", ("sensors offset", "hip", "knee", "ankle")),
    ],
)
def test_an_impossible_offset_is_refused_in_one_line(setting, words):
    with raises(ParameterFileError, *words) as caught:
        load_experiment("bench_leg", [setting])
    assert len(str(caught.value).splitlines()) == 1


def test_the_joint_bench_has_no_offset():
    sensors = replace(SENSORS, offset={Side.LEFT: {JointName.KNEE: 0.01}})
    with raises(ParameterError, "sensors offset", "knee"):
        bench_joint(JointName.KNEE, sensors=sensors)


def test_only_joints_that_the_table_drives_have_an_offset():
    with raises(ParameterFileError, "sensors offset", "hip", "knee", "ankle"):
        load_experiment("treadmill_guided", ["sensors.offset.left.ankle_deg=1"])
