"""Tests of delayed commands: exactly by whole ticks, and their effect on stability.

Plain, in lanes and over another kernel they are among the cases of test_compiled_engine.py and test_lanes.py.
"""

from __future__ import annotations

from itertools import pairwise

import pytest
from errors import raises

from twin_gait import load_experiment, simulate
from twin_gait.checking.hanging_leg import linear_loops
from twin_gait.checking.linear_loop import spectral_radius, transition_matrix
from twin_gait.core.actuator import Motor
from twin_gait.core.control_tick import target_current
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.experiment import Experiment
from twin_gait.parameters.quantities import from_attributes

JOINTS = ("hip", "knee")


def bench_leg(*settings: str) -> Experiment:
    return load_experiment("bench_leg", ["integration.method=semi_implicit_euler", *settings]).experiment


def assert_late(late: Experiment, log, ticks: int) -> None:
    """Check that the drives receive the command of the controller with a delay of some ticks, bit for bit."""
    for joint in JOINTS:
        limits = late.control.limits[joint]
        motor = from_attributes(Motor, late.plant.actuators[joint])
        wanted = log[f"right_{joint}_motor_command_torque_Nm"].tolist()
        requested = [target_current(motor, torque, limits.torque, limits.current) for torque in wanted]
        given = log[f"right_{joint}_target_current_A"].tolist()
        assert given[:ticks] == [0.0] * ticks
        assert given[ticks:] == requested[: len(requested) - ticks]
        assert len(set(given)) > 0.5 * len(given)


@pytest.mark.parametrize("ticks", [0, 1, 3, 10])
def test_drives_receive_the_command_of_the_configured_number_of_ticks_before(ticks):
    late = bench_leg(f"control.delay_ms={ticks}", "duration_s=0.5", "engine=pinocchio")
    assert_late(late, simulate(late).log, ticks)


@pytest.mark.slow
def test_a_hold_has_the_same_delay_as_a_walk():
    settings = ("duration_s=0.6", "control.delay_ms=7", "faults=['encoder_missing:right_knee@0.2s']")
    late = bench_leg(*settings)
    run = simulate(late)
    assert run.trip is not None
    assert_late(late, run.log, 7)


def test_delay_destabilises_a_swinging_leg_as_the_transition_matrix_predicts():
    """With every millisecond the slowest oscillation decays less, and in the end the loop is unstable."""
    late = [
        bench_leg(f"control.delay_ms={ticks}", "table.phases.early_stance.knee.damping_ratio=1")
        for ticks in (0, 4, 8)
    ]
    radii = [max(map(radius, linear_loops(item).values())) for item in late]
    assert all(sooner < later for sooner, later in pairwise(radii))


def radius(loop) -> float:
    return spectral_radius(transition_matrix(loop))


@pytest.mark.parametrize(
    ("setting", "facts"),
    [
        ("delay_ms=11", ("control.delay_ms", "0", "10", "11 ms")),
        ("delay_ms=2.5", ("control", "delay", "0.001 s", "0.01 s", "0.0025")),
        ("delay_s=-0.001", ("control.delay_s", "0.001 s", "0.01 s", "-0.001")),
        ("delay_ms=0.9999", ("control", "delay", "0.001 s", "0.01 s", "0.0009999")),
    ],
)
def test_a_delay_of_fractional_or_too_many_ticks_is_refused_in_one_line(setting, facts):
    with raises(ParameterFileError, *facts) as caught:
        load_experiment("bench_leg", [f"control.{setting}"])
    assert len(str(caught.value).splitlines()) == 1


def test_both_units_give_the_same_ticks():
    for ticks in range(11):
        for setting in (f"delay_ms={ticks}", f"delay_s={ticks / 1000!r}"):
            control = load_experiment("bench_leg", [f"control.{setting}"]).experiment.control
            assert control.delay_ticks == ticks
            assert control.delay == pytest.approx(1e-3 * ticks, abs=1e-15)
