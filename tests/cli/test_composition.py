"""Composition of an experiment: world, wearer, device, gait table and controller, each by one option."""

from pathlib import Path

import pytest
import yaml
from errors import raises

from twin_gait import load_experiment, presets, simulate
from twin_gait.cli import options
from twin_gait.cli.program import build_parser, main
from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.studies.batch import override_experiment
from twin_gait.studies.sweep.spec import sweep_from_mapping
from twin_gait.vocabulary import JointName

CONTROLLER = '''
from dataclasses import dataclass

from twin_gait.control.controller import Controller


@dataclass(slots=True)
class Share:
    value: float


class Softer(Controller):
    """Controller with springs of nine tenths."""

    def initial_memory(self, plan):
        return Share(0.9)

    @staticmethod
    def tick(memory, device, tick, period):
        for index in range(len(device.joints)):
            device.joints[index].setpoint.stiffness *= memory.value
'''


def loaded(*words: str) -> LoadedExperiment:
    """Return the experiment of a command line of ``simulate``."""
    return options.load_experiment(build_parser().parse_args(["simulate", *words]))


def test_each_part_is_exchanged_by_one_option() -> None:
    found = loaded(
        "treadmill_guided", "--world", "treadmill_40", "--patient", "stroke_left",
        "--device", "twin_stiff_orthosis", "--table", "treadmill_pre_swing",
        "--controller", "position", "--unchecked",
    ).experiment  # fmt: skip
    assert found.scenario == load_experiment("treadmill_40").experiment.scenario
    assert found.patient is not None and found.patient.name == "stroke_left"
    assert (found.device.name, found.table.name) == ("twin_stiff_orthosis", "treadmill_pre_swing")
    assert str(found.control.mode) == "position" and found.controller is None
    plain = load_experiment("treadmill_guided").experiment
    assert plain.scenario != found.scenario and plain.device.name == "twin"


def test_world_of_another_kind_leaves_no_key_of_the_former_one(tmp_path: Path) -> None:
    found = loaded(
        "treadmill_guided", "--world", "overground", "--table", "overground", "--device", "twin_crutches"
    )
    assert found.experiment.scenario == load_experiment("overground").experiment.scenario
    path = tmp_path / "walk.yaml"
    path.write_text(
        yaml.safe_dump({"preset": "treadmill_guided", "scenario": "treadmill_40"}), encoding="utf-8"
    )
    assert load_experiment(path).experiment.scenario == load_experiment("treadmill_40").experiment.scenario
    with raises(ParameterFileError, "scenario", "moon", "treadmill_40"):
        loaded("treadmill_guided", "--world", "moon")


def test_controller_of_a_python_file_acts_and_is_recorded(tmp_path: Path) -> None:
    path = tmp_path / "softer_springs.py"
    path.write_text(CONTROLLER, encoding="utf-8")
    found = loaded("bench_leg", "--duration", "0.2", "--controller", str(path))
    assert found.experiment.controller is not None and found.experiment.controller.class_name == "Softer"
    assert found.document["controller"]["module"] == "softer_springs"
    log = simulate(found.experiment).log
    usual = simulate(load_experiment("bench_leg", ["duration_s=0.2"]).experiment).log
    ratio = log["right_hip_stiffness_Nm_per_rad"] / usual["right_hip_stiffness_Nm_per_rad"]
    assert ratio.to_numpy()[:50] == pytest.approx(0.9)
    with raises(ParameterError, "softer_springs.py", "Softer", "CLASS"):
        loaded("bench_leg", "--controller", f"{path}:Harder")


@pytest.mark.parametrize("given", ["relaxed", "no_such_file.py"])
def test_unknown_controller_is_refused_in_one_line(given: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "bench_leg", "--controller", given]) == 2
    error = capsys.readouterr().err
    assert given in error and "expected" in error and len(error.splitlines()) == 1


def test_presets_list_the_devices(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets"]) == 0
    text = capsys.readouterr().out
    assert "devices (--device NAME)" in text and "twin_crutches" in text and set(presets())


def test_device_is_an_override_of_a_batch_and_a_sweep(tmp_path: Path) -> None:
    base = load_experiment(
        "treadmill_guided", ["control.limits.torque_Nm=50", "control.mode=position"]
    ).experiment
    found = override_experiment(base, {"device": "twin_crutches", "control.limits.hip.torque_Nm": 70})
    assert found.device.name == "twin_crutches" and str(found.control.mode) == "position"
    limits = found.control.limits
    assert (limits[JointName.HIP].torque, limits[JointName.KNEE].torque) == (70.0, 80.0)
    assert found.plant == load_experiment("overground").experiment.plant
    own = tmp_path / "own.yaml"
    own.write_text("schema_version: 2\nextends: twin\nplant: {battery: {voltage_V: 24}}\n", encoding="utf-8")
    spec = {"method": "grid", "parameters": {"device": ["twin", "own.yaml"], "patient.mass_kg": [60, 80]}}
    sweep = sweep_from_mapping(spec, str(tmp_path / "sweep.yaml"), tmp_path)
    make = sweep.maker()
    own.unlink()  # the specification contains the values
    made = [make((number, override)) for number, override in enumerate(sweep.overrides)]
    assert [item.device.name for item in made] == ["twin", "twin", "own", "own"]
    assert [item.plant.battery.voltage for item in made] == [28.8, 28.8, 24.0, 24.0]
    assert [item.patient.mass for item in made if item.patient] == [60.0, 80.0] * 2
    with raises(ParameterFileError, "device", "twin_crutches"):
        override_experiment(base, {"device": "unknown"})
