"""Tests of ``twin-gait identify``: files, output and refused input; simulate accepts its files."""

from __future__ import annotations

import argparse
import json
import math

import numpy as np
import pytest
from errors import raises, states
from friction_bench import KNEE, campaign, rotational, write_log
from own_devices import FRICTION, write_device
from twin_device import HIP_FRICTION, KNEE_FRICTION

from twin_gait import RunStatus, load_experiment, simulate
from twin_gait.cli import friction
from twin_gait.cli.terminal import DONE
from twin_gait.configuration.device_file import load_device
from twin_gait.exceptions import ParameterError, ParameterFileError, RunDirectoryError
from twin_gait.identification.laws import MODELS
from twin_gait.parameters.friction import LuGreFriction
from twin_gait.vocabulary import JointName


def call(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    friction.add_parser(parser.add_subparsers())
    parsed = parser.parse_args(["identify", *map(str, arguments)])
    return parsed.run(parsed)


def bench_leg(device, *settings: str):
    """Load the leg on its stand with a device."""
    return load_experiment("bench_leg", [f"device={device}", *settings]).experiment


def write_series(path, seed: int, speed: float = 1.5):
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(400)
    velocity = speed * np.sin(2 * np.pi * (0.4 + 0.1 * seed) * time)
    torque = rotational(velocity, KNEE) + 0.1 * rng.normal(size=400)
    return write_log(path, {"t": time, "dq2": velocity, "tau2": torque})


COLUMNS = ("--columns", "time=t,velocity=dq2,friction_torque=tau2")


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identified")
    logs = [write_series(folder / f"arm_{seed}.csv", seed) for seed in range(3)]
    out = folder / "out"
    status = call(*logs, *COLUMNS, "--joint", "knee", "--out", out)
    return status, out


def test_a_folder_with_document_parameters_and_figures_is_written(identified):
    status, out = identified
    assert status == DONE
    assert sorted(item.name for item in out.iterdir()) == [
        "compensator.yaml",
        "figures",
        "identification.json",
        "plant.yaml",
    ]
    assert sorted(item.name for item in (out / "figures").iterdir()) == ["fits.png", "residuals.png"]


def test_the_document_lists_models_best_first_with_all_that_is_known(identified):
    document = json.loads((identified[1] / "identification.json").read_text())
    models = document["models"]
    assert {item["name"] for item in models} | set(document["skipped"]) == set(MODELS)
    errors = [item["cross_validation"][0]["rmse"] for item in models]
    assert errors[1:] == sorted(errors[1:]) and errors[0] <= 1.003 * errors[1]
    best = models[0]
    assert best["name"] == "rotational"
    assert set(best["parameters"]) == set(best["intervals_95"])
    for key in ("sse", "r_squared", "adjusted_r_squared", "rmse", "aic", "bic", "warnings", "formula"):
        assert key in best
    assert best["samples"] == sum(test["samples"]["used"] for test in document["tests"]) == 1200
    assert document["method"]["loss"] == "auto" and best["loss"] == "linear"


def test_the_parameter_files_are_devices_with_the_identified_law(identified):
    document = json.loads((identified[1] / "identification.json").read_text())
    best = document["models"][0]["parameters"]
    assert document["device"] == "twin_leg"
    plant = bench_leg(identified[1] / "plant.yaml")
    law = plant.plant.friction[JointName.KNEE]
    assert math.isclose(law.coulomb_friction, best["coulomb_friction_Nm"], rel_tol=1e-8)
    assert math.isclose(law.breakaway_velocity, best["breakaway_velocity_rad_per_s"], rel_tol=1e-8)
    assert plant.plant.friction_ratio[JointName.KNEE] == 1.0
    assert plant.plant.friction[JointName.HIP] == HIP_FRICTION
    device = load_device(str(identified[1] / "plant.yaml"))
    assert "rotational" in device.source_of("plant.friction.knee.coulomb_friction_Nm")
    assert device.stated_by("plant.friction.hip.coulomb_friction_Nm") == "twin"
    model = bench_leg(identified[1] / "compensator.yaml").control.friction_model
    assert model[JointName.KNEE] == law


def test_an_existing_folder_is_refused_before_the_work_and_replaced_when_forced(tmp_path, capsys):
    log, out = write_series(tmp_path / "a.csv", 1), tmp_path / "out"
    fast = ("--model", "coulomb_viscous", "--no-pictures")
    assert call(log, *COLUMNS, *fast, "--out", out) == DONE
    with raises(RunDirectoryError, "out", "--out", "--force"):
        call(tmp_path / "none.csv", *COLUMNS, *fast, "--out", out)
    assert call(log, *COLUMNS, "--model", "dahl", "--no-pictures", "--out", out, "--force") == DONE
    assert json.loads((out / "identification.json").read_text())["models"][0]["name"] == "dahl"
    assert "dahl" in capsys.readouterr().out


def test_force_does_not_replace_a_folder_of_something_else(tmp_path):
    log = write_series(tmp_path / "a.csv", 1)
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("text")
    with raises(RunDirectoryError, "thesis", "--out"):
        call(log, *COLUMNS, "--model", "dahl", "--out", tmp_path / "thesis", "--force")
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "text"


def test_logs_of_the_bench_are_taken_as_a_folder(tmp_path, capsys):
    logs = tmp_path / "campaign"
    logs.mkdir()
    for number, (mass, columns) in enumerate(campaign(1, tests=2, duration=2.0)):
        write_log(logs / f"knee_{mass}kg_{number}.log", columns)
    (logs / "notes.md").write_text("not a log")
    options = ("--model", "rotational,coulomb_viscous", "--no-pictures", "--angles-as-logged")
    assert call(logs, "--joint", "knee", *options, "--out", tmp_path / "out") == DONE
    printed = capsys.readouterr().out
    assert "10 files" in printed and "with weight left out" in printed and "breakaway_torque_Nm" in printed
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert document["method"]["processing"] == "zero_phase"
    assert [test["mass_kg"] for test in document["tests"]] == [1, 1, 1.5, 1.5, 2, 2, 2.5, 2.5, 3, 3]


def test_one_way_drops_are_warned_about(tmp_path, capsys):
    logs = [
        write_log(tmp_path / f"drop_{mass}kg_{number}.log", columns)
        for number, (mass, columns) in enumerate(campaign(1, tests=1, two_way=False, duration=3.0))
    ]
    call(*logs, "--joint", "knee", "--model", "rotational", "--no-pictures", "--out", tmp_path / "out")
    printed = capsys.readouterr().out
    assert "warning: one direction only" in printed and "warning: no fast samples" in printed


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (("--columns", "speed=dq2"), ("--columns", "NAME=VALUE,…", "time")),
        (("--units", "velocity"), ("--units", "NAME=VALUE")),
        (("--model", "gauss"), ("model", "gauss")),
        (("--seed", "-1"), ("--seed", "0")),
        (("--joint", "knee", "--lever-m", "-1"), ("lever", "0")),
        (("--joint", "knee", "--start-angle-deg", "nan"), ("start_angle", "-1000")),
        (("--joint", "ankle"), ("twin_leg.yaml", "plant.actuators.ankle", "hip, knee")),
        (("--joint", "knee", "--device", "none"), ("device", "none", "twin_ankle")),
        (("--device", "twin"), ("--device", "--joint")),
    ],
)
def test_wrong_options_are_one_line_and_leave_no_folder(tmp_path, extra, message):
    log = write_series(tmp_path / "a.csv", 1)
    with raises((ParameterError, ParameterFileError), *message) as error:
        call(log, *extra, "--out", tmp_path / "out")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_wrong_log_leaves_no_folder(tmp_path):
    (tmp_path / "a.csv").write_text("velocity,friction_torque\n1,2\n")
    with raises(ParameterFileError, "a.csv", "1", "20"):
        call(tmp_path / "a.csv", "--out", tmp_path / "out")
    with raises(ParameterError, "empty", ".log"):
        (tmp_path / "empty").mkdir()
        call(tmp_path / "empty", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_series_needs_no_option_but_the_column_names(tmp_path):
    log, out = write_series(tmp_path / "a.csv", 1), tmp_path / "out"
    assert call(log, *COLUMNS, "--model", "coulomb_viscous", "--out", out) == DONE
    assert not (out / "plant.yaml").exists()  # the joint was not given
    document = json.loads((out / "identification.json").read_text())
    assert document["tests"][0]["samples"]["used"] == 400  # plain series keep every sample
    assert document["models"][0]["cross_validation"][0]["left_out"] == "piece"


@pytest.mark.slow
def test_reasons_for_missing_parameter_files_are_printed(tmp_path, capsys):
    log = write_series(tmp_path / "arm.csv", 0)
    assert call(log, *COLUMNS, "--out", tmp_path / "a", "--no-pictures") == DONE
    assert states(capsys.readouterr().out, "plant.yaml", "--joint")
    other = ("--joint", "knee", "--model", "coulomb_viscous")
    assert call(log, *COLUMNS, *other, "--out", tmp_path / "b", "--no-pictures") == DONE
    printed = capsys.readouterr().out
    laws = ("rotational", "asymmetric", "asymmetric_stribeck", "dahl", "lugre")
    assert states(printed, "plant.yaml", "compensator.yaml", *laws)
    assert not (tmp_path / "b" / "plant.yaml").exists()
    assert call(log, *COLUMNS, "--joint", "knee", "--out", tmp_path / "c", "--no-pictures") == DONE
    assert "plant.yaml: rotational\ncompensator.yaml: rotational" in capsys.readouterr().out
    assert (tmp_path / "c" / "plant.yaml").is_file()


def write_bristles(path, seed: int):
    """Write a synthetic log: LuGre joint with directions, slow and fast sine, noise 0.02 N·m."""
    rng = np.random.default_rng(seed)
    time = 0.002 * np.arange(6000)
    angle = 0.3 * np.cos(2.0 * time + seed) + 0.004 * np.sin((21.0 + seed) * time)
    velocity = np.diff(angle, prepend=angle[0]) / 0.002
    torque, z = np.zeros(6000), 0.0
    for i, w in enumerate(velocity.tolist()):
        level = 3.0 + 1.5 * math.exp(-((w / 0.1) ** 2))
        # The deflection by twenty small steps of the differential equation, not by its solution.
        for _ in range(20):
            z += 1e-4 * (w - 1200.0 * abs(w) / level * z)
        viscous = 2.0 * w if w > 0.0 else 1.2 * w
        torque[i] = 0.4 + 1200.0 * z + 8.0 * (w - 1200.0 * abs(w) / level * z) + viscous
    torque += 0.02 * rng.normal(size=6000)
    return write_log(path, {"t": time, "dq2": velocity, "tau2": torque})


def test_bristles_that_fit_best_are_the_friction_of_a_plant_that_runs(tmp_path, capsys):
    """Complete procedure on synthetic data: logs, the best model, its parameter file, a run with it."""
    logs = [write_bristles(tmp_path / f"arm_{seed}.csv", seed) for seed in range(3)]
    models = ("--model", "rotational,asymmetric_stribeck,lugre_asymmetric", "--no-cross-validation")
    assert (
        call(*logs, *COLUMNS, *models, "--joint", "knee", "--no-pictures", "--out", tmp_path / "out") == DONE
    )
    printed = capsys.readouterr().out
    assert "plant.yaml: lugre_asymmetric\ncompensator.yaml: rotational" in printed
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert document["parameter_files"]["plant.yaml"] == document["models"][0]["name"] == "lugre_asymmetric"
    loaded = bench_leg(tmp_path / "out" / "plant.yaml", "duration_s=1")
    law = loaded.plant.friction[JointName.KNEE]
    assert isinstance(law, LuGreFriction)
    assert law.bristle_stiffness == pytest.approx(1200.0, rel=0.05)
    assert law.breakaway_torque == pytest.approx(4.5, rel=0.05)
    assert (law.viscous_friction_forward, law.viscous_friction_backward) == pytest.approx(
        (2.0, 1.2), rel=0.05
    )
    assert law.offset == pytest.approx(0.4, rel=0.05)
    assert loaded.plant.friction[JointName.HIP] == HIP_FRICTION
    run = simulate(loaded)
    assert run.status is RunStatus.COMPLETED
    # At the start the bristles are straight, and what is left at rest is the offset.
    assert run.log["right_knee_friction_torque_Nm"].iloc[0] == pytest.approx(-law.offset, rel=1e-9)
    compensator = bench_leg(tmp_path / "out" / "compensator.yaml")
    assert compensator.plant.friction[JointName.KNEE] == KNEE_FRICTION
    assert compensator.control.friction_model[JointName.KNEE] != KNEE_FRICTION


def test_a_mass_overruled_by_the_files_is_reported(tmp_path, capsys):
    logs = [
        write_log(tmp_path / f"knee_{mass}kg_{number}.log", columns)
        for number, (mass, columns) in enumerate(campaign(1, tests=1, duration=2.0)[:2])
    ]
    fast = ("--model", "coulomb_viscous", "--no-pictures", "--no-cross-validation")
    assert call(*logs, "--joint", "knee", *fast, "--mass", "7", "--out", tmp_path / "out") == DONE
    assert states(capsys.readouterr().out, "warning", "--mass 7", "knee_1.0kg_0.log", "1 kg", "2")


def test_a_law_that_would_drive_the_joint_is_left_out_of_the_parameter_files(tmp_path, capsys):
    time = 0.01 * np.arange(400)
    velocity = 2.0 * np.sin(2.0 * np.pi * 0.4 * time)
    torque = 3.0 * np.tanh(20.0 * velocity) - 0.2 * velocity  # less friction the faster it is
    log = write_log(tmp_path / "arm.csv", {"t": time, "dq2": velocity, "tau2": torque})
    options = ("--joint", "knee", "--model", "asymmetric", "--no-pictures", "--out", tmp_path / "out")
    assert call(log, *COLUMNS, *options) == DONE
    assert states(capsys.readouterr().out, "plant.yaml", "rotational", "asymmetric")
    assert not (tmp_path / "out" / "plant.yaml").exists()


def test_motor_and_gear_of_twin_are_those_of_its_file(tmp_path):
    logs = tmp_path / "campaign"
    logs.mkdir()
    for number, (mass, columns) in enumerate(campaign(1, tests=1, duration=2.0)):
        write_log(logs / f"knee_{mass}kg_{number}.log", columns)
    fast = ("--model", "coulomb_viscous", "--no-pictures", "--no-cross-validation", "--angles-as-logged")
    for joint in ("hip", "knee"):
        out = tmp_path / joint
        assert call(logs, "--joint", joint, *fast, "--out", out) == DONE
        bench = json.loads((out / "identification.json").read_text())["method"]["bench"]
        stated = load_device("twin").sections["plant"]["actuators"][joint]
        for key in ("torque_constant_Nm_per_A", "rotor_inertia_kgm2", "gear_ratio", "gear_inertia_kgm2"):
            assert bench["actuator"][key] == stated[key]


@pytest.mark.slow  # a campaign of its own
def test_friction_of_another_device_is_identified_with_its_drive(tmp_path, capsys):
    """A campaign on the simulated drive of the device, with its friction, gives that friction back."""
    device, logs, out = write_device(tmp_path, ["knee"]), tmp_path / "logs", tmp_path / "out"
    parser = argparse.ArgumentParser()
    friction.add_parser(parser.add_subparsers())
    words = ["bench", "campaign", "--joint", "knee", "--device", device, "--protocol", "two-way"]
    parsed = parser.parse_args([*map(str, words), "--out", str(logs)])
    assert parsed.run(parsed) == DONE
    settings = json.loads((logs / "campaign.json").read_text())["bench"]
    assert (settings["actuator"]["gear_ratio"], settings["battery"]["voltage"]) == (30.0, 48.0)
    assert (settings["limits"]["torque"], settings["limits"]["current"]) == (40.0, 30.0)
    fast = ("--model", "rotational", "--no-pictures", "--no-cross-validation")
    assert call(logs, "--joint", "knee", "--device", device, *fast, "--out", out) == DONE
    document = json.loads((out / "identification.json").read_text())
    assert document["device"] == "device"
    (model,) = document["models"]
    for key, true in FRICTION.items():
        low, high = model["intervals_95"][key]
        assert low - 0.02 * true <= true <= high + 0.02 * true
    law = load_device(str(out / "plant.yaml")).parameters()["plant"].friction[JointName.KNEE]
    assert law.coulomb_friction == pytest.approx(model["parameters"]["coulomb_friction_Nm"])
    # With the motor of TWIN's knee the same logs do not balance.
    capsys.readouterr()
    assert call(logs, "--joint", "knee", *fast, "--out", tmp_path / "wrong") == DONE
    assert "warning: according to the current" in capsys.readouterr().out


def test_a_campaign_on_a_joint_without_drive_is_refused(tmp_path):
    parser = argparse.ArgumentParser()
    friction.add_parser(parser.add_subparsers())
    device = write_device(tmp_path, ["knee"])
    words = ["bench", "campaign", "--joint", "hip", "--device", str(device), "--out", str(tmp_path / "logs")]
    parsed = parser.parse_args(words)
    with raises(ParameterFileError, "device.yaml", "plant.actuators.hip", "knee"):
        parsed.run(parsed)
    assert not (tmp_path / "logs").exists()
