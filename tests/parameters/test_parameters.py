"""Parameters are checked when they are made, and the shipped ones are those of their sources."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from twin_device import KNEE_ACTUATOR, PLANT, SENSORS

from twin_gait.exceptions import MissingOptionalDependency, ParameterError, ParameterFileError, TwinGaitError
from twin_gait.gait.table import Transition
from twin_gait.identification.processing import BenchSetup
from twin_gait.parameters.drives import (
    ActuatorParameters,
    BatteryParameters,
    ElectronicsParameters,
    LimitParameters,
    SensorParameters,
)
from twin_gait.parameters.environment import (
    AnkleParameters,
    ContactParameters,
    StopParameters,
    SupportParameters,
)
from twin_gait.parameters.wearer import Patient
from twin_gait.studies.campaign import Campaign
from twin_gait.worlds.bench_control import CosinePath, DutyControl, OldFrictionModel
from twin_gait.worlds.bench_joint import CatalogueEfficiency, DriveParameters, LinkParameters, Torsion

# Every parameter with a value just outside its range.
OUT_OF_RANGE: list[tuple[Callable[..., Any], str, float]] = [
    (ActuatorParameters, "torque_constant", 0.0),
    (ActuatorParameters, "resistance", -0.1),
    (ActuatorParameters, "rotor_inertia", -1e-6),
    (ActuatorParameters, "gear_ratio", 0.0),
    (ActuatorParameters, "gear_inertia", -1e-6),
    (ActuatorParameters, "gear_efficiency", 0.49),
    (ActuatorParameters, "gear_efficiency", 1.01),
    (ActuatorParameters, "continuous_torque", 0.0),
    (BatteryParameters, "voltage", 0.0),
    (BatteryParameters, "internal_resistance", -0.1),
    (BatteryParameters, "continuous_power", 0.0),
    (BatteryParameters, "energy", 0.0),
    (ElectronicsParameters, "inverter_resistance", -1e-3),
    (ElectronicsParameters, "inverter_power", -0.1),
    (ElectronicsParameters, "constant_power", -1.0),
    (ElectronicsParameters, "regeneration", -0.1),
    (ElectronicsParameters, "regeneration", 1.1),
    (LimitParameters, "torque", 0.0),
    (LimitParameters, "current", 0.0),
    (SensorParameters, "encoder_counts", 0),
    (SensorParameters, "angle_noise", -1e-6),
    (SensorParameters, "fast_time_constant", -1e-6),
    (SensorParameters, "decimation", 0),
    (SensorParameters, "window", 0),
    (ContactParameters, "stiffness", 0.0),
    (ContactParameters, "dissipation", -0.1),
    (ContactParameters, "forefoot_stiffness", 0.0),
    (ContactParameters, "forefoot_dissipation", -0.1),
    (ContactParameters, "friction_coefficient", -0.1),
    (ContactParameters, "transition_velocity", 0.0),
    (StopParameters, "stiffness", -1.0),
    (StopParameters, "dissipation", -0.1),
    (AnkleParameters, "stiffness", -1.0),
    (AnkleParameters, "damping", -1.0),
    (AnkleParameters, "rest", 0.53),
    (AnkleParameters, "rest", -0.53),
    (AnkleParameters, "rest", math.nan),
    (SupportParameters, "share", 1.01),
    (SupportParameters, "share", -0.01),
    (SupportParameters, "damping", -1.0),
    (Patient, "mass", 9.9),
    (Patient, "mass", 160.1),
    (Patient, "height", 0.69),
    (Patient, "height", 2.21),
    (DutyControl, "duty_limit", 1.1),
    (OldFrictionModel, "steepness", 0.0),
    (CosinePath, "start_angle", math.nan),
    (LinkParameters, "lever", 0.0),
    (DriveParameters, "rate", 0.0),
    (DriveParameters, "delay", 101),
    (DriveParameters, "counts", -1),
    (CatalogueEfficiency, "temperature", 40.1),
    (Torsion, "stiffness", 0.0),
    (BenchSetup, "mass", -0.1),
    (Campaign, "cycles", 0),
    (Transition, "debounce_ticks", 0),
    (Transition, "timeout_ticks", 0),
]
REQUIRED: dict[Any, dict[str, Any]] = {
    ActuatorParameters: vars(KNEE_ACTUATOR),
    BatteryParameters: vars(PLANT.battery),
    ElectronicsParameters: vars(PLANT.electronics),
    StopParameters: vars(PLANT.stops),
    AnkleParameters: vars(PLANT.ankle),
    SensorParameters: vars(SENSORS),
    LimitParameters: {"torque": 60.0, "current": 15.0},
    CosinePath: {"start_angle": 0.0, "amplitude": 0.1, "frequency": 1.0},
    DriveParameters: {"inductance": 1e-3},
    BenchSetup: {"actuator": KNEE_ACTUATOR},
    Campaign: {"joint": "knee"},
    Transition: {
        "source": "late_stance",
        "target": "swing_flexion",
        "cause": "timeout",
        "timeout_ticks": 9,
    },
}


@pytest.mark.parametrize(
    ("kind", "name", "value"), OUT_OF_RANGE, ids=lambda item: getattr(item, "__name__", item)
)
def test_value_out_of_range_is_refused_by_name(kind: Callable[..., Any], name: str, value: float) -> None:
    with pytest.raises(ParameterError) as caught:
        kind(**{**REQUIRED.get(kind, {}), name: value})  # type: ignore[call-overload]
    message = str(caught.value)
    assert name.split("_")[0] in message
    assert repr(value) in message
    assert "expected" in message
    assert len(message.splitlines()) == 1


FLOATS = sorted({(kind, name) for kind, name, _ in OUT_OF_RANGE}, key=str)


@pytest.mark.parametrize(("kind", "name"), FLOATS, ids=lambda item: getattr(item, "__name__", item))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_parameter_may_be_infinite_or_undefined(kind: Callable[..., Any], name: str, value: float) -> None:
    with pytest.raises(ParameterError):
        kind(**{**REQUIRED.get(kind, {}), name: value})  # type: ignore[call-overload]


@pytest.mark.parametrize("name", ["encoder_counts", "decimation", "window"])
def test_counts_are_whole_numbers(name: str) -> None:
    with pytest.raises(ParameterError):
        dataclasses.replace(SENSORS, **{name: 2.5})


def test_errors_are_caught_by_the_base_class_and_as_value_errors() -> None:
    assert issubclass(ParameterError, TwinGaitError)
    assert issubclass(ParameterError, ValueError)
    assert issubclass(MissingOptionalDependency, ImportError)


def test_error_in_a_file_keeps_file_and_key() -> None:
    error = ParameterFileError("run.yaml", "patient.mass_kg", "expected 30 to 110, got 200")
    assert (error.file, error.key) == ("run.yaml", "patient.mass_kg")
    assert str(error) == "run.yaml: patient.mass_kg: expected 30 to 110, got 200"
    assert str(ParameterFileError("run.yaml", "", "is empty")) == "run.yaml: is empty"


@given(key=st.text(max_size=8), problem=st.text(max_size=8))
def test_error_in_a_file_is_one_line_for_any_content(key: str, problem: str) -> None:
    assert len(f"{ParameterFileError('run.yaml', key, problem)}.".splitlines()) == 1


def test_missing_extra_names_the_install_command() -> None:
    error = MissingOptionalDependency("example-robot-data", "robots", "the human model")
    assert "pip install 'twin-gait[robots]'" in str(error)


def test_parameters_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        KNEE_ACTUATOR.gear_ratio = 50.0  # type: ignore[misc]


def test_battery_is_the_pack_of_the_thesis() -> None:
    """28.8 V, 92.2 Wh, 15 A (thesis 2.2.1)."""
    battery = PLANT.battery
    assert battery.voltage == 28.8
    assert_allclose(battery.energy, 331_920.0, rtol=1e-12)


def test_mass_of_the_wearer_is_limited_by_the_device() -> None:
    assert Patient(mass=110.0).mass == 110.0


def test_noise_on_ideal_encoders_is_refused() -> None:
    with raises(ParameterError, "angle_noise", "0", "ideal: false"):
        dataclasses.replace(SENSORS, angle_noise=1e-5)
    assert dataclasses.replace(SENSORS, ideal=False, angle_noise=1e-5).angle_noise == 1e-5


def test_armature_grows_with_the_square_of_the_gear_ratio() -> None:
    slow, fast = (dataclasses.replace(KNEE_ACTUATOR, gear_ratio=ratio) for ratio in (50.0, 100.0))
    assert_allclose(fast.armature, 4.0 * slow.armature, rtol=1e-12)
