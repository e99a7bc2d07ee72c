"""Compensation on the joint bench: dead zone, reference velocity, inertia by encoder or inertial unit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from idealised import idealised
from numpy.testing import assert_allclose
from plain_bench import plain_rows
from twin_device import ACCELEROMETER_NOISE, GYROSCOPE_NOISE, KNEE_ACTUATOR, KNEE_FRICTION, SENSORS

from twin_gait.configuration.bench_device import bench_joint
from twin_gait.core.actuator import dead_zone
from twin_gait.core.inertial import angular_acceleration, tangential_specific_force
from twin_gait.exceptions import ParameterError
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.vocabulary import JointName
from twin_gait.worlds.bench_control import CosinePath, TorqueControl
from twin_gait.worlds.bench_joint import (
    BenchFriction,
    BenchJoint,
    CurrentLoop,
    DriveParameters,
    InertialSensor,
    InertialUnit,
    LinkParameters,
    Torsion,
)
from twin_gait.worlds.bench_leg import ImposedMotionParameters

# An ideal and quiet current loop.
DRIVE = DriveParameters(
    inductance=KNEE_ACTUATOR.inductance,
    rate=1000.0,
    loop=CurrentLoop.IDEAL,
    noise=0.0,
    ripple=0.0,
    delay=0,
)
numbers = st.floats(-1e3, 1e3)
widths = st.floats(0.0, 10.0)


def controlled(**settings: object) -> TorqueControl:
    return TorqueControl(friction_model=KNEE_FRICTION, **settings)  # type: ignore[arg-type]


def knee(mass: float = 0.0, **changes: object) -> BenchJoint:
    chosen = {"drive": DRIVE, "link": LinkParameters(mass=mass), "rest_at_stop": 0.0, **changes}
    return bench_joint(JointName.KNEE, **chosen)


def table_friction(w: float) -> float:
    a, b, c, d = 1.743, 3.193, 0.2031, 2.06
    return (
        math.sqrt(2 * math.e) * (a - b) * math.exp(-((w / c) ** 2)) * w / c
        + b * math.tanh(10 * w / c)
        + d * w
    )


@given(numbers, widths)
def test_dead_zone_is_odd_and_subtracts_its_half_width(x: float, width: float) -> None:
    assert dead_zone(-x, width) == -dead_zone(x, width)
    assert dead_zone(x, width) == np.sign(x) * max(abs(x) - width, 0.0)


@given(numbers)
def test_dead_zone_of_no_width_changes_nothing(x: float) -> None:
    assert dead_zone(x, 0.0) == x


@given(st.floats(-3.0, 3.0), st.floats(0.05, 1.0))
def test_tangential_specific_force_on_a_free_pendulum_is_zero(angle: float, lever: float) -> None:
    free = 9.81 / lever * math.cos(angle - 1.2)  # point mass at the accelerometer
    assert abs(tangential_specific_force(free, angle, lever, 9.81, 1.2)) < 1e-12


@given(st.floats(-100.0, 100.0), st.floats(-3.0, 3.0), st.floats(0.05, 1.0))
def test_acceleration_comes_back_from_the_specific_force(rate: float, angle: float, lever: float) -> None:
    force = tangential_specific_force(rate, angle, lever, 9.81, 0.7)
    assert_allclose(angular_acceleration(force, angle, lever, 9.81, 0.7), rate, atol=1e-9)


def moved(sensor: InertialSensor | None, **changes: object) -> BenchJoint:
    unit = None if sensor is None else InertialUnit(sensor=sensor, delay=0, time_constant=0.0)
    chosen: dict[str, object] = {
        "mass": 2.0,
        "sensors": replace(SENSORS, ideal=True),
        "control": controlled(friction_compensation_gain=0.0, inertia_compensation=0.5),
        "friction": BenchFriction(law=KNEE_FRICTION),
        "imposed_motion": ImposedMotionParameters(amplitude=-0.7, frequency=0.5),
        "inertial_unit": unit,
        "duration": 1.0,
    }
    return knee(**{**chosen, **changes})  # type: ignore[arg-type]


def estimate(test: BenchJoint, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Acceleration that the firmware used, the true one, and the velocity of the link."""
    run = simulate_bench(test, seed=seed)
    inertia = test.actuator.armature + test.link.total_inertia
    used = run.column("inertia_compensation_torque_Nm") / (0.5 * inertia)
    return used, run.column("motor_acceleration_rad_per_s2"), run.column("link_velocity_rad_per_s")


def test_ideal_accelerometer_gives_the_acceleration_of_the_joint_in_the_same_tick() -> None:
    used, true, _ = estimate(moved(InertialSensor.ACCELEROMETER))
    assert np.abs(true).max() > 1.0
    assert_allclose(used, true, atol=1e-10)


def test_gyroscope_gives_the_difference_of_the_velocity_of_the_link() -> None:
    used, _, velocity = estimate(moved(InertialSensor.GYROSCOPE, torsion=Torsion()))
    assert_allclose(used[1:], np.diff(velocity) / 1e-3, atol=1e-9)
    assert used[0] == 0.0


@pytest.mark.parametrize("delay", [1, 7])
def test_delayed_samples_are_the_set_number_of_ticks_old(delay: int) -> None:
    unit = InertialUnit(sensor=InertialSensor.GYROSCOPE, delay=delay, time_constant=0.0)
    used, _, velocity = estimate(moved(None, inertial_unit=unit))
    assert_allclose(used[delay + 1 :], np.diff(velocity)[:-delay] / 1e-3, atol=1e-9)
    assert (used[: delay + 1] == 0.0).all()


def test_delayed_accelerometer_errs_by_the_gravity_change_since_the_sample() -> None:
    unit = InertialUnit(sensor=InertialSensor.ACCELEROMETER, delay=4, time_constant=0.0, lever=0.2)
    test = moved(None, inertial_unit=unit)
    used, true, _ = estimate(test)
    angle = simulate_bench(test).column("link_angle_rad")
    turned = 9.81 * (np.cos(angle[4:] - math.pi / 2) - np.cos(angle[:-4] - math.pi / 2)) / 0.2
    assert_allclose(used[4:], true[:-4] + turned, atol=1e-9)


def test_filter_behind_the_unit_is_of_the_first_order() -> None:
    unit = InertialUnit(sensor=InertialSensor.ACCELEROMETER, delay=0, time_constant=0.005)
    used, true, _ = estimate(moved(None, inertial_unit=unit))
    gain, value = 1.0 - math.exp(-0.2), 0.0
    for tick in range(200):
        value += gain * (true[tick] - value)
        assert abs(used[tick] - value) < 1e-9


@pytest.mark.parametrize(
    ("sensor", "noise"),
    [(InertialSensor.GYROSCOPE, GYROSCOPE_NOISE), (InertialSensor.ACCELEROMETER, ACCELEROMETER_NOISE)],
)
def test_noise_of_the_unit_has_the_set_size_and_is_seeded(sensor: InertialSensor, noise: float) -> None:
    unit = InertialUnit(sensor=sensor, delay=0, time_constant=0.0, noise=noise, lever=0.3)
    # A heavy joint that does not answer to the torque.
    still = moved(None, inertial_unit=unit, imposed_motion=None, gravity=0.0)
    still = replace(still, link=idealised(still.link, inertia=1e9))
    runs = [estimate(still, seed)[0] for seed in (1, 1, 2)]
    assert (runs[0] == runs[1]).all() and (runs[0] != runs[2]).any()
    one = unit.noise / 0.3 if sensor is InertialSensor.ACCELEROMETER else unit.noise * math.sqrt(2.0) / 1e-3
    assert_allclose(np.std(runs[0][1:]), one, rtol=0.06)


def test_unit_that_is_not_used_changes_nothing_in_the_joint() -> None:
    off = controlled(friction_compensation_gain=0.3)
    plain = simulate_bench(moved(None, control=off)).log.to_numpy()
    fitted = simulate_bench(moved(InertialSensor.GYROSCOPE, control=off)).log.to_numpy()
    assert (plain == fitted).all()


def test_compiled_inertial_unit_equals_plain_python() -> None:
    for sensor in InertialSensor:
        test = moved(sensor, duration=0.05, torsion=Torsion())
        assert (simulate_bench(test, seed=3).log.to_numpy() == plain_rows(test, seed=3)).all()


def test_reference_compensation_uses_the_velocity_of_the_path() -> None:
    path = CosinePath(start_angle=math.pi / 2, amplitude=-0.7, frequency=0.5)
    control = controlled(
        friction_compensation_gain=0.4,
        stiffness=600.0,
        damping=60.0,
        path=path,
        follows_path=True,
    )
    run = simulate_bench(knee(control=control, duration=1.0))
    velocity = -0.35 * math.pi * np.sin(math.pi * run.column("time_s"))
    expected = [0.4 * table_friction(w) for w in velocity]
    assert_allclose(run.column("friction_compensation_torque_Nm"), expected, atol=1e-12)


def test_compensation_behind_a_dead_zone_uses_the_velocity_beyond_it() -> None:
    control = controlled(friction_compensation_gain=0.4, dead_zone=0.05)
    run = simulate_bench(
        knee(control=control, imposed_motion=ImposedMotionParameters(amplitude=-0.7), duration=2.0)
    )
    slow = run.column("velocity_slow_rad_per_s")
    beyond = np.sign(slow) * np.maximum(np.abs(slow) - 0.05, 0.0)
    expected = [0.4 * table_friction(w) for w in beyond]
    assert_allclose(run.column("friction_compensation_torque_Nm"), expected, atol=1e-12)
    assert (np.abs(slow) > 0.1).any() and (np.abs(slow) < 0.05).any()


@pytest.mark.parametrize(
    "wrong", [{"noise": -1.0}, {"delay": -1}, {"delay": 5000}, {"lever": 0.0}, {"time_constant": math.nan}]
)
def test_wrong_unit_is_refused(wrong: dict[str, float]) -> None:
    with raises(ParameterError, *wrong, *wrong.values()):
        InertialUnit(sensor=InertialSensor.GYROSCOPE, **wrong)  # type: ignore[arg-type]


def test_wrong_dead_zone_is_refused() -> None:
    with raises(ParameterError, "dead_zone", "-0.1"):
        controlled(dead_zone=-0.1)
