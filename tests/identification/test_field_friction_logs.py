"""Friction logs of other benches: names with an index, encoders that wrap, motors of one's own, bristles."""

from __future__ import annotations

import argparse
import json
import math
import re

import numpy as np
import pytest
from errors import raises
from friction_bench import KNEE, QUIET, WEIGHTS, bench_log, rotational, swing, write_log

from twin_gait.cli import friction
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.identification.fitting import FitOptions, fit_model
from twin_gait.identification.laws import MODELS
from twin_gait.identification.models import FrictionTest, join_tests
from twin_gait.identification.processing import process_log
from twin_gait.identification.reading import ColumnOptions, Quantity, read_log

TIME = np.arange(400) / 100.0
VELOCITY = 1.5 * np.sin(2.0 * np.pi * 0.5 * TIME)


def call(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    friction.add_parser(parser.add_subparsers())
    parsed = parser.parse_args(["identify", *map(str, arguments)])
    return parsed.run(parsed)


def test_an_index_in_brackets_is_not_a_unit(tmp_path):
    columns = {"time_ms": 1e3 * TIME, "q_d[3]": 0.0 * TIME, "dq[3]": VELOCITY, "tau_J[3]": 2.0 * VELOCITY}
    path = write_log(tmp_path / "a.csv", columns)
    for name in ("tau_J[3]", "tau_J"):
        log = read_log(path, ColumnOptions(names={Quantity.FRICTION_TORQUE: name}))
        np.testing.assert_allclose(log.columns[Quantity.VELOCITY], VELOCITY, rtol=1e-7)
        np.testing.assert_allclose(log.columns[Quantity.FRICTION_TORQUE], 2.0 * VELOCITY, rtol=1e-7)
        np.testing.assert_allclose(log.columns[Quantity.TIME], TIME)


def test_lines_above_the_names_are_skipped_without_columns(tmp_path):
    path = tmp_path / "a.csv"
    rows = "\n".join(f"{a:.4f};{b:.6f};{2 * b:.6f}" for a, b in zip(TIME, VELOCITY, strict=True))
    path.write_text(f"Export;v2\nRate;100\n\ntime;velocity;friction_torque\n{rows}\n")
    np.testing.assert_allclose(read_log(path).columns[Quantity.VELOCITY], VELOCITY, atol=1e-6)


def wrapping_log(path):
    """A log of the bench whose encoder starts again at each turn, which the motion passes."""
    time = np.arange(5000) / 1000.0
    columns = bench_log(swing(time, 0.6, 3.0, 0.4), 2.0, KNEE, np.random.default_rng(0), noise=QUIET)
    shift = 2.0 * math.pi - columns["position_rad"][1000]
    return write_log(
        path, {**columns, "position_rad": np.mod(columns["position_rad"] + shift, 2.0 * math.pi)}
    )


def test_an_encoder_that_wraps_is_named_and_unwrapped(tmp_path):
    path = wrapping_log(tmp_path / "knee_2kg.log")
    with raises(ParameterFileError, "angle", "--unwrap"):
        call(path, "--joint", "knee", "--out", tmp_path / "out")
    angle = read_log(path, ColumnOptions(unwrap=True)).columns[Quantity.ANGLE]
    assert np.abs(np.diff(angle)).max() < 0.01
    fast = ("--model", "coulomb_viscous", "--no-pictures", "--joint", "knee", "--unwrap")
    assert call(path, *fast, "--out", tmp_path / "out") == 0
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert document["tests"][0]["samples"]["stop"] == 0


def test_a_series_omits_a_wrapping_angle(tmp_path):
    angle = np.mod(np.cumsum(VELOCITY) / 100.0 + 0.1, 2.0 * math.pi) - 2.0 * math.pi * (TIME > 3.5)
    columns = {"time": TIME, "angle": angle, "velocity": VELOCITY, "friction_torque": 2.0 * VELOCITY}
    test = process_log(read_log(write_log(tmp_path / "a.csv", columns)), None)
    assert test.angle is None and "add --unwrap" in test.notes[0]


# ---------------------------------------------------------------------- a motor of one's own

OWN = {"torque_constant": 0.03, "gear_ratio": 50.0, "rotor_inertia": 4e-4}
FLAGS = ("--torque-constant", "0.03", "--gear-ratio", "50", "--rotor-inertia", "4e-4")


@pytest.fixture(scope="module")
def own_motor_logs(tmp_path_factory):
    """Logs of a bench with another motor: the same torque, but for another inertia of the rotor."""
    folder, time = tmp_path_factory.mktemp("own"), np.arange(4000) / 1000.0
    rng, knee = np.random.default_rng(3), (0.0705, 100.0, (3.06e-4 + 0.282e-4) * 100.0**2)
    armature = OWN["rotor_inertia"] * OWN["gear_ratio"] ** 2
    for number, mass in enumerate(WEIGHTS):
        motion = swing(time, 0.5 + 0.4 * number, 2.0, rng.uniform(0.0, 6.0))
        columns = bench_log(motion, mass, KNEE, rng, noise=QUIET)
        for name in ("measured_current_A", "target_current_A"):
            torque = columns[name] * knee[0] * knee[1] + (armature - knee[2]) * motion[2]
            columns[name] = torque / (OWN["torque_constant"] * OWN["gear_ratio"])
        write_log(folder / f"own_{mass}kg_{number}.log", columns)
    return folder


@pytest.mark.parametrize("joint", [(), ("--joint", "hip")])
def test_friction_is_right_with_the_users_motor(own_motor_logs, tmp_path, joint):
    rest = ("--model", "rotational", "--no-pictures", "--angles-as-logged", "--out", tmp_path / "out")
    assert call(own_motor_logs, *joint, *FLAGS, *rest) == 0
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    found = document["models"][0]["parameters"]
    assert found["viscous_friction_Nms_per_rad"] == pytest.approx(KNEE[3], rel=2e-3)
    assert found["coulomb_friction_Nm"] == pytest.approx(KNEE[1], rel=2e-3)
    assert document["warnings"] == []
    actuator = document["method"]["bench"]["actuator"]
    assert actuator["gear_inertia_kgm2"] == 0.0 and actuator["rotor_inertia_kgm2"] == 4e-4


def test_the_warning_of_a_wrong_current_names_the_motor(own_motor_logs, tmp_path, capsys):
    rest = ("--model", "rotational", "--no-pictures", "--angles-as-logged", "--out", tmp_path / "out")
    assert call(own_motor_logs, "--joint", "knee", *rest) == 0
    printed = capsys.readouterr().out
    gain = re.search(r"the weight's torque is ([\d.]+) times", printed)
    # The current is larger by 0.0705 · 100 / (0.03 · 50); the wrong armature changes the rest.
    assert float(gain[1]) == pytest.approx(4.7, rel=0.2)
    assert all(flag in printed for flag in ("--torque-constant", "--gear-ratio", "--rotor-inertia"))


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (("--gear-ratio", "50"), ("--joint", "--torque-constant", "--rotor-inertia")),
        (("--joint", "knee", "--torque-constant", "-1"), ("torque_constant", "0")),
        (
            ("--joint", "knee", "--current-delay-ms", "80"),
            ("current_delay", "-0.05", "0.05"),
        ),
    ],
)
def test_an_impossible_motor_is_refused_in_one_line(own_motor_logs, tmp_path, extra, message):
    with raises(ParameterError, *message) as error:
        call(own_motor_logs, *extra, "--out", tmp_path / "out")
    assert "\n" not in str(error.value) and not (tmp_path / "out").exists()


# ---------------------------------------------------------------------- bristles


@pytest.mark.parametrize("name", ["lugre", "lugre_asymmetric"])
def test_the_damping_of_bristles_is_never_negative(name):
    """The torque lags behind that of the law, which a negative damping would describe."""
    rng = np.random.default_rng(0)
    time = np.arange(1500) / 100.0
    velocity = np.sin(1.1 * time) + 0.3 * np.sin(3.1 * time)
    late = np.interp(time - 0.02, time, rotational(velocity, KNEE)) + 0.02 * rng.normal(size=len(time))
    samples = join_tests([FrictionTest("", velocity, late, np.ones(len(time), dtype=bool), time=time)])
    model = MODELS[name]
    fit = fit_model(model, samples, FitOptions())
    assert model.parameters(fit.x)["bristle_damping_Nms_per_rad"] >= 0.0
