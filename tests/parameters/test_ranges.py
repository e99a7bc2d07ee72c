"""Every quantity that a user can set has a finite range with its reason; no value inside crashes a run."""

from __future__ import annotations

import dataclasses
import importlib
import math
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import pytest
from errors import raises
from hypothesis import given, settings
from hypothesis import strategies as st
from twin_device import SENSORS

import twin_gait
from twin_gait import load_experiment, simulate
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.parameters.quantities import (
    Declaration,
    Parameters,
    QuantityUnits,
    declarations,
    symmetric_range,
)
from twin_gait.parameters.ranges import NON_NEGATIVE_OR_INFINITE, NOT_NEGATIVE, POSITIVE, SHARE, Range
from twin_gait.worlds.faults import parse_fault

# Packages whose import starts nothing; none of them is left out that declares parameters.
LEFT_OUT = ("twin_gait.cli", "twin_gait.live", "twin_gait.viewer", "twin_gait.testing", "twin_gait.__main__")


def all_parameters() -> Iterator[type[Any]]:
    """Every dataclass of parameters in the package."""
    for module in pkgutil.walk_packages(twin_gait.__path__, "twin_gait."):
        if not module.name.startswith(LEFT_OUT):
            importlib.import_module(module.name)
    found, waiting = set(), [Parameters]
    while waiting:
        kinds = waiting.pop().__subclasses__()
        waiting += kinds
        found |= {kind for kind in kinds if kind.__module__.startswith("twin_gait.")}
    return (kind for kind in found if dataclasses.is_dataclass(kind))


def test_every_declared_number_has_a_finite_range() -> None:
    numbers = [
        (f"{kind.__name__}.{item.name}", item.range)
        for kind in all_parameters()
        for item in declarations(kind)
        if item.range is not None
    ]
    assert len(numbers) > 250
    open_ended = [name for name, bounds in numbers if not math.isfinite(bounds.maximum - bounds.minimum)]
    assert open_ended == []


def test_every_range_states_a_reason_for_its_limits() -> None:
    """The reason or the description states it; the limit 1 of a share needs none."""
    silent = [
        f"{kind.__name__}.{item.name}"
        for kind in all_parameters()
        for item in declarations(kind)
        if item.range is not None and not (item.range.reason or item.range.words)
        if (item.range.minimum, item.range.maximum) != (0.0, 1.0)
    ]
    known = {  # whose reason stands in the meaning of the field, or in the name of the range
        "CrutchParameters.length", "ChairParameters.height", "HarnessParameters.height",
        "Overground.fall_lean", "ArmParameters.reach", "ArmParameters.risen_length",
        "ArmParameters.seated_length", "Scaling.speed_exponent", "Scaling.height_exponent",
        "Scaling.carried_mass_exponent",
    }  # fmt: skip
    assert set(silent) <= known


NONSENSE = {
    "equilibrium": "table.phases.late_stance.hip.equilibrium_deg=300",
    "damping ratio": "table.phases.late_stance.hip.damping_ratio=0",
    "start": "scenario.leading_start.hip_deg=18000",
    "share of the voltage": "control.safety.min_voltage_share=600",
    "current": "control.limits.current_A=1e9",
    "voltage": "plant.battery.voltage_V=1e9",
    "fade": "table.blending.duration_ms=1000000000",
    "timeout": "control.safety.phase_timeout_s=1e9",
    "step of an angle": "control.safety.angle_step_rad=1e9",
    "deviation": "control.safety.model_deviation_rad=1e9",
    "command": "control.safety.highest_command_Nm=1e9",
    "speed": "control.safety.speed_share=1e9",
    "unit below the hips": "sensors.trunk.height_m=-1",
    "window": "sensors.window=1000000000",
    "smaller window": "sensors.window=100000000",
    "decimation": "sensors.decimation=1000000000",
    "seed": "seed=18446744073709551616",
}


@pytest.mark.parametrize("setting", NONSENSE.values(), ids=list(NONSENSE))
def test_out_of_range_values_are_refused_with_the_range(setting: str) -> None:
    key, _, value = setting.partition("=")
    with pytest.raises(TwinGaitError) as caught:
        load_experiment("treadmill_guided", [setting])
    message = str(caught.value)
    assert key.rpartition(".")[2] in message and "expected" in message and "\n" not in message
    assert f"{float(value):g}" in message or value in message


def test_a_window_and_its_decimation_span_two_seconds_at_most() -> None:
    assert replace(SENSORS, window=200, decimation=10).window == 200
    with raises(ParameterError, "window", "2000", "11", "200"):
        replace(SENSORS, window=200, decimation=11)


@pytest.mark.parametrize(
    "text", ["supply_dip@1s=1e9V", "encoder_jump:left_hip@1s=200deg", "motor_stuck:left_hip@1s=-1e4Nm"]
)
def test_a_fault_beyond_physics_is_refused(text: str) -> None:
    with raises(ParameterError, text, "magnitude"):
        parse_fault(text)


def test_open_ends_of_a_range_are_the_limits_of_the_quantity() -> None:
    general = symmetric_range(5.0, "a reason")
    assert NOT_NEGATIVE.fill_limits(general) == Range(0.0, 5.0, reason="a reason")
    assert POSITIVE.fill_limits(general).expected == "a number above 0 and at most 5 (a reason)"
    assert SHARE.fill_limits(general) is SHARE
    own = Range(-9.0, 9.0, reason="its own")
    assert own.fill_limits(general) is own
    later = NON_NEGATIVE_OR_INFINITE.fill_limits(general)
    assert (
        later.contains(math.inf)
        and later.contains(5.0)
        and not later.contains(5.1)
        and not later.contains(math.nan)
    )
    assert QuantityUnits("m").plausible_range is None


Numbers = dict[str, Declaration]


def numbers_of(parameters: Any, path: str) -> Numbers:
    """Numbers with a range that lie below some parameters, by the keys of a setting."""
    found: Numbers = {}
    for item in declarations(type(parameters)):
        value, key = getattr(parameters, item.name), f"{path}{next(iter(item.keys))}"
        inside = value if isinstance(value, Mapping) else {}
        if isinstance(value, Parameters):
            found |= numbers_of(value, f"{key}.")
        elif item.range is not None and isinstance(value, int | float):
            found[key] = item
        for name, one in inside.items():
            if isinstance(one, Parameters):
                found |= numbers_of(one, f"{key}.{name}.")
    return found


LEG = load_experiment("bench_leg").experiment
SETTABLE = {
    key: item.range
    for part in ("control", "plant", "sensors", "scenario")
    for key, item in numbers_of(getattr(LEG, part), f"{part}.").items()
    if item.range is not None
}


def values_in(bounds: Range) -> st.SearchStrategy[float]:
    ends = [bounds.maximum, *([] if bounds.exclusive_minimum else [bounds.minimum])]
    inside = st.floats(
        bounds.minimum, bounds.maximum, exclude_min=bounds.exclusive_minimum, allow_infinity=False
    )
    return inside | st.sampled_from(ends)


@settings(max_examples=30)
@given(st.data())
def test_values_inside_of_their_ranges_run_or_are_refused_in_one_line(data: st.DataObject) -> None:
    assert len(SETTABLE) > 60
    keys = data.draw(st.lists(st.sampled_from(sorted(SETTABLE)), min_size=1, max_size=4, unique=True))
    values = {key: data.draw(values_in(SETTABLE[key]), key) for key in keys}
    changes = [
        f"{key}={int(value) if 'whole' in SETTABLE[key].expected else repr(value)}"
        for key, value in values.items()
    ]
    try:
        run = simulate(
            load_experiment("bench_leg", ["duration_s=0.03", "engine=pinocchio", *changes]).experiment
        )
    except TwinGaitError as error:
        assert "\n" not in str(error)
    else:
        assert run.status in ("completed", "diverged") and len(run.log) >= 1
