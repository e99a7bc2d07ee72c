"""Devices as files: extension, completeness, exchange in an experiment, and the page of a device."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import yaml
from errors import raises
from twin_device import KNEE_ACTUATOR

from twin_gait import load_experiment, presets
from twin_gait.cli.program import main
from twin_gait.configuration.bench_device import bench_joint
from twin_gait.configuration.device_file import PARTS, Device, list_devices, load_device
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.identity import identify_parts
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.device import ControlParameters, PlantParameters
from twin_gait.parameters.drives import LimitParameters, SensorParameters
from twin_gait.parameters.quantities import Parameters, declarations
from twin_gait.report.device_page import SPEED_SHARES, describe_device, torque_curve
from twin_gait.studies.campaign import Campaign
from twin_gait.vocabulary import JointName

COMPLETE = sorted(set(list_devices()) - {"ideal"})  # a base without legs and drives
DRIVE = {
    "torque_constant_Nm_per_A": 0.1,
    "resistance_Ohm": 0.2,
    "rotor_inertia_kgm2": 1e-5,
    "gear_ratio": 9,
    "gear_inertia_kgm2": 0,
    "gear_efficiency": 0.9,
    "continuous_torque_Nm": 9,
}
FRICTION = {
    "breakaway_torque_Nm": 0.1,
    "coulomb_friction_Nm": 0.2,
    "breakaway_velocity_rad_per_s": 0.1,
    "viscous_friction_Nms_per_rad": 0.05,
}


def write(path: Path, **content: Any) -> Path:
    """Write a file of a device and return its path."""
    path.write_text(yaml.safe_dump({"schema_version": 2, **content}), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", COMPLETE)
def test_shipped_device_states_every_number_with_its_source(name: str) -> None:
    described = describe_device(load_device(name))
    assert described["numbers"]
    assert [row["key"] for row in described["numbers"] if not row["source"]] == []
    assert {row["stated_by"] for row in described["numbers"]} <= {*list_devices()}


@pytest.mark.parametrize("preset", presets())
def test_preset_has_the_numbers_of_its_device(preset: str) -> None:
    # The calibrated feet of this preset are those of the wearer.
    restored = ["leg.heel_to_forefoot=null"] if preset == "treadmill" else []
    experiment = load_experiment(preset, restored).experiment
    document, device = experiment_document(experiment), load_device(experiment.device.name).document()
    for section, parts in PARTS.items():
        assert {part: document[section][part] for part in parts if part in document[section]} == device[
            section
        ]
    assert identify_parts(experiment)["device"].changed is False


def test_device_of_the_user_extends_a_shipped_one_and_removes_a_joint_by_null(tmp_path: Path) -> None:
    path = write(
        tmp_path / "hip_only.yaml",
        extends="twin",
        plant={
            "actuators": {"hip": DRIVE, "knee": None},
            "friction": {"hip": FRICTION, "knee": None},
            "friction_ratio": {"hip": 1, "knee": None},
        },
        control={"friction_model": {"hip": FRICTION, "knee": None}, "limits": {"torque_Nm": 18}},
    )
    device = load_device(str(path))
    plant = device.parameters()["plant"]
    assert [str(joint) for joint in plant.actuators] == ["hip"]
    with raises(ParameterFileError, "plant.actuators.knee", "treadmill_guided"):
        load_experiment("treadmill_guided", [f"device={path}"])  # the gait table controls the knee, too
    assert plant.actuators["hip"].gear_ratio == 9.0
    assert plant.battery.voltage == 28.8
    assert device.stated_by("plant.actuators.hip.gear_ratio") == "hip_only"
    assert device.stated_by("plant.battery.voltage_V") == "twin"


def test_missing_number_is_refused_by_its_name(tmp_path: Path) -> None:
    drive = {key: value for key, value in DRIVE.items() if key != "rotor_inertia_kgm2"}
    path = write(
        tmp_path / "knee.yaml",
        extends="ideal",
        leg={"urdf": "twin_leg.urdf", "right": {"hip": "right_hip", "knee": "right_knee"}},
        plant={"actuators": {"knee": drive}, "friction": {"knee": FRICTION}, "friction_ratio": {"knee": 1}},
        control={"friction_model": {"knee": FRICTION}},
    )
    with raises(ParameterFileError, "knee.yaml", "plant.actuators.knee.rotor_inertia_kgm2") as refused:
        load_device(str(path))
    assert "extends: ideal" not in str(refused.value), "the file has this base"
    complete = yaml.safe_load(path.read_text(encoding="utf-8"))
    complete["plant"]["actuators"]["knee"] = DRIVE
    path = write(tmp_path / "complete.yaml", **complete)
    assert [str(joint) for joint in load_device(str(path)).parameters()["plant"].actuators] == ["knee"]


@pytest.mark.parametrize(
    ("content", "key"),
    [
        ({"patient": {"mass_kg": 70}}, "patient"),
        ({"plant": {"gravity_m_per_s2": 1.6}}, "plant.gravity_m_per_s2"),
        ({"control": {"mode": "position"}}, "control.mode"),
        ({"extends": "unknown"}, "extends"),
        ({"extends": "self.yaml"}, "extends"),
        ({"extends": "twin", "plant": {"battery": {"voltage_V": "high"}}}, "plant.battery.voltage_V"),
    ],
)
def test_mistake_in_a_device_names_file_and_key(tmp_path: Path, content: dict[str, Any], key: str) -> None:
    path = write(tmp_path / "self.yaml", **content)
    with raises(ParameterFileError, "self.yaml", key):
        load_device(str(path))


def test_device_replaces_that_of_a_preset_as_a_whole(tmp_path: Path) -> None:
    path = write(tmp_path / "low_voltage.yaml", extends="twin", plant={"battery": {"voltage_V": 24}})
    experiment = load_experiment("overground", [f"device={path}"]).experiment
    assert experiment.device.name == "low_voltage"
    assert experiment.plant.battery.voltage == 24.0
    assert (
        experiment.control.limits[JointName.HIP].torque == 60.0
    )  # of TWIN, not the 80 N·m of the preset's device
    assert experiment.plant.ankle.relative_stiffness == 0.0
    assert identify_parts(experiment)["device"].label.startswith("low_voltage (")


def test_device_is_found_next_to_the_experiment_that_names_it(tmp_path: Path) -> None:
    write(tmp_path / "own.yaml", extends="twin", control={"limits": {"torque_Nm": 50}})
    write(
        tmp_path / "walk.yaml",
        preset="treadmill_guided",
        device="own.yaml",
        plant={"battery": {"voltage_V": 26}},
    )
    experiment = load_experiment(tmp_path / "walk.yaml").experiment
    assert experiment.control.limits[JointName.HIP].torque == 50.0
    assert experiment.plant.battery.voltage == 26.0  # the experiment overrides its device


def test_experiment_without_device_and_preset_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.yaml", scenario={"kind": "treadmill"}, table="treadmill_guided")
    with raises(ParameterFileError, "walk.yaml", "device", "twin"):
        load_experiment(path)


@pytest.mark.parametrize("value", ["nonsense", "3", "[twin]"])
def test_unknown_device_lists_the_shipped_ones(value: str) -> None:
    with raises(ParameterFileError, "device", "twin_crutches"):
        load_experiment("treadmill_guided", [f"device={value}"])


def test_resolved_document_keeps_its_numbers_and_takes_another_device(tmp_path: Path) -> None:
    loaded = load_experiment("overground")
    path = tmp_path / "experiment.yaml"
    path.write_text(yaml.safe_dump(loaded.document), encoding="utf-8")
    again = load_experiment(path)
    assert again.experiment == loaded.experiment
    assert load_experiment(path, ["device=twin"]).experiment.control.limits[JointName.HIP].torque == 60.0


def test_torque_curve_follows_torque_current_and_voltage() -> None:
    drive = replace(KNEE_ACTUATOR, torque_constant=0.1, resistance=0.5, gear_ratio=10.0)
    voltage, limits = 20.0, LimitParameters(torque=25.0, current=30.0)
    fastest = voltage / (0.1 * 10.0)
    by_hand = [min(25.0, 30.0, (voltage - share * fastest) / 0.5) for share in SPEED_SHARES]
    np.testing.assert_allclose(torque_curve(drive, voltage, limits), by_hand, atol=1e-12)


def test_page_of_a_device_as_text_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["device", "twin_ankle"]) == 0
    text = capsys.readouterr().out
    assert "left_ankle" in text and "(inherited from twin)" in text
    assert main(["device", "twin_ankle", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [row["joint"] for row in document["drives"]] == ["hip", "knee", "ankle"]
    device: Device = load_device("twin_ankle")
    assert document["mass_kg"] == pytest.approx(describe_device(device)["mass_kg"])


def test_source_of_a_number_is_that_of_the_device_that_states_it(tmp_path: Path) -> None:
    limits = {"limits": {"torque_Nm": 15, "hip": {"current_A": 20}}}
    path = write(
        tmp_path / "mine.yaml", extends="ak80_9_hip", control=limits, sources={"control": "our bench"}
    )
    described = describe_device(load_device(str(path)))
    sources = {row["key"]: row["source"] for row in described["numbers"]}
    # The base has more specific sources for its own values of these keys.
    assert sources["control.limits.hip.torque_Nm"] == sources["control.limits.hip.current_A"] == "our bench"
    assert sources["plant.battery.voltage_V"] == load_device("ak80_9_hip").source_of(
        "plant.battery.voltage_V"
    )
    assert not any(key.startswith("control.limits.knee") for key in sources), "the knee has no drive"


def test_range_of_a_joint_without_a_drive_is_that_of_the_urdf(tmp_path: Path) -> None:
    limits = {"limits": {"knee": {"highest_angle_deg": 100}}}
    device = load_device(str(write(tmp_path / "mine.yaml", extends="knee_orthosis", control=limits)))
    upper = {
        row["side"]: math.degrees(row["upper_rad"])
        for row in describe_device(device)["joints"]
        if row["joint"] == "knee"
    }
    assert upper == pytest.approx({"left": 100, "right": 140}, abs=1e-3)


def test_incomplete_base_is_refused_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["device", "ideal"]) == 2
    assert "ideal.yaml" in capsys.readouterr().err


def test_edited_device_is_read_again(tmp_path: Path) -> None:
    for voltage in (24.0, 26.0):
        path = write(tmp_path / "mine.yaml", extends="twin", plant={"battery": {"voltage_V": voltage}})
        assert (
            load_experiment("treadmill_guided", [f"device={path}"]).experiment.plant.battery.voltage
            == voltage
        )


def numbers_with_defaults(kind: Any) -> Iterator[str]:
    """Yield the numbers in the parameters of a device that have a default other than None."""
    for item in declarations(kind):
        hints = (item.kind, *get_args(item.kind))
        inner = [one for one in hints if isinstance(one, type) and issubclass(one, Parameters)]
        for one in inner:
            yield from (f"{item.name}.{name}" for name in numbers_with_defaults(one))
        number = isinstance(item.default, int | float) and not isinstance(item.default, bool)
        if number or (isinstance(item.default, Parameters) and inner):
            yield item.name


def test_no_number_of_a_device_has_a_default_in_python() -> None:
    """Parts of control that are no part of a device, and the gravity of the world, have defaults."""
    found = {
        (kind.__name__, name)
        for kind in (PlantParameters, ControlParameters, SensorParameters)
        for name in numbers_with_defaults(kind)
        if kind is not ControlParameters or name.partition(".")[0] in PARTS["control"]
    }
    assert found == {("PlantParameters", "gravity")}


def test_bench_of_a_joint_has_the_numbers_of_its_device(tmp_path: Path) -> None:
    drive = {**DRIVE, "inductance_H": 1e-4, "peak_torque_Nm": 18}
    path = write(
        tmp_path / "other.yaml",
        extends="twin",
        plant={"actuators": {"knee": drive}, "friction": {"knee": FRICTION}, "battery": {"voltage_V": 48}},
        control={"limits": {"knee": {"torque_Nm": 12}}},
    )
    bench = bench_joint(JointName.KNEE, str(path))
    assert (bench.actuator.gear_ratio, bench.drive.inductance) == (9.0, 1e-4)
    assert (bench.battery.voltage, bench.limits.torque) == (48.0, 12.0)
    assert bench.friction.law.viscous_friction == 0.05 and not bench.sensors.ideal
    assert Campaign(joint=JointName.KNEE, device=str(path)).plain_bench().friction.ripple == 0.3
    with raises(ParameterError, "ankle", "hip, knee"):
        bench_joint(JointName.ANKLE, str(path))
    silent = write(tmp_path / "silent.yaml", extends="twin", plant={"actuators": {"ankle": DRIVE}, "friction":
                   {"ankle": FRICTION}, "friction_ratio": {"ankle": 1}})  # fmt: skip
    with raises(ParameterError, "ankle.inductance_H"):
        bench_joint(JointName.ANKLE, str(silent))
