"""The inertial unit of a free trunk in a run: what is felt, what the guards read, and its noise by seed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from twin_gait import load_experiment
from twin_gait.gait.signals import all_signal_names
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

EULER = "integration={method: semi_implicit_euler, step_ms: 0.1}"
QUIET = "gyroscope_noise_rad_per_s: 0, accelerometer_noise_m_per_s2: 0"
# With a filter that soon takes shaking for gravity.
UNIT = f"sensors.trunk={{{QUIET}, gyroscope_bias_deg_per_s: 3, time_constant_s: 0.4}}"


def problem(*settings: str) -> SimulationSetup:
    return build_setup(load_experiment("overground", [EULER, "duration_s=0.25", *settings]).experiment)


@pytest.fixture(scope="module")
def sensed() -> tuple[ReferenceEngine, dict[str, np.ndarray]]:
    """A quarter of a second of stepping onto the floor by a unit without noise: hips and trunk are shaken."""
    engine = ReferenceEngine(problem("sensors.ideal=false", UNIT))
    log = engine.run().log
    return engine, {name: log[name].to_numpy() for name in log}


def test_an_ideal_trunk_unit_measures_the_true_pitch():
    engine = ReferenceEngine(problem("sensors.ideal=true", "duration_s=0.02"))
    log = engine.run().log
    assert (log["measured_trunk_pitch_rad"] == log["trunk_pitch_rad"]).all()


def test_the_unit_measures_the_acceleration_of_its_position(sensed):
    """The same filter with the arctangent, on differences of where the unit was by the log.

    Those are means over two ticks, what the unit feels is of an instant, and the soles chatter as they land.
    """
    _, log = sensed
    pitch = log["trunk_pitch_rad"]
    forwards, upwards = (np.cos(pitch), -np.sin(pitch)), (np.sin(pitch), np.cos(pitch))
    hips = log["pelvis_forward_m"], log["pelvis_height_m"]
    x, z = (hip - 0.15 * ahead + 0.2 * up for hip, ahead, up in zip(hips, forwards, upwards, strict=True))
    ax, az = (np.diff(way, 2) / 1e-6 for way in (x, z))
    rate, estimate, found = np.diff(pitch) / 1e-3, pitch[0], [pitch[0]]
    for tick in range(1, len(pitch) - 1):
        sine, cosine = np.sin(pitch[tick]), np.cos(pitch[tick])
        felt = ax[tick - 1] * cosine - (az[tick - 1] + 9.81) * sine + 0.005 * 9.81
        up = ax[tick - 1] * sine + (az[tick - 1] + 9.81) * cosine
        estimate += rate[tick] * 1e-3 + math.radians(3.0) * 1e-3
        way = math.atan2(-felt, up) - estimate
        estimate += math.sin(way) * (1.0 - math.exp(-1e-3 / 0.4))
        found.append(estimate)
    measured = log["measured_trunk_pitch_rad"][:-1]
    assert np.abs(measured - pitch[:-1]).max() > math.radians(1.0)
    assert_allclose(measured, found, rtol=0.0, atol=math.radians(0.25))


def test_guards_read_the_output_of_the_filter(sensed):
    engine, log = sensed
    names = all_signal_names(engine.setup.table.joints)
    read = engine.episode.controller.signals[names.index("trunk.pitch_deg")]
    assert read == log["measured_trunk_pitch_rad"][-1] != log["trunk_pitch_rad"][-1]


def test_noise_is_seeded_and_does_not_change_the_encoder_noise():
    noisy = ("sensors.ideal=false", "sensors.angle_noise_rad=1e-4", "duration_s=20")
    one, same, other = (problem(*noisy, f"seed={seed}").noise for seed in (1, 1, 2))
    encoders, efforts, unit = np.split(one, (4, 8), axis=1)
    assert (one == same).all() and (encoders != other[:, :4]).all() and (unit != other[:, 8:]).all()
    assert (encoders == 1e-4 * np.random.default_rng(1).standard_normal((20000, 4))).all()
    assert not efforts.any()  # this wearer makes none
    expected = [math.radians(0.005) * math.sqrt(500.0), *[400e-6 * 9.81 * math.sqrt(500.0)] * 2]
    assert_allclose(unit.std(axis=0), expected, rtol=0.03)
    assert np.abs(np.corrcoef(np.hstack([encoders, unit]).T) - np.eye(7)).max() < 0.04


def test_noise_is_drawn_on_demand() -> None:
    """A live page lays an hour out for every change; drawn each time, the noise took 0.7 s and 0.3 GB."""
    hour = build_setup(load_experiment("day", ["duration_s=3600"]).experiment)
    assert "noise" not in vars(hour)


def test_a_guided_pelvis_has_no_trunk_unit():
    settings = ["sensors.ideal=false", "sensors.angle_noise_rad=1e-4", "duration_s=0.1"]
    noise = build_setup(load_experiment("treadmill_guided", settings).experiment).noise
    assert noise.shape == (100, 8) and not noise[:, 4:].any()  # encoders, and efforts that are none
