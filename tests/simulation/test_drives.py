"""Tests of walks with losses of gears, inverters and electronics."""

from __future__ import annotations

import numpy as np
import pytest
from twin_device import HIP_FRICTION, KNEE_ACTUATOR, KNEE_FRICTION

from twin_gait import load_experiment
from twin_gait.cli.simulate import report
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate

JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
LOSSY = ("plant.actuators.hip.gear_efficiency=0.85", "plant.actuators.knee.gear_efficiency=0.7")
EFFICIENCY = {"hip": 0.85, "knee": 0.7}
# No losses, for any preset.
FREE = (
    *(f"plant.actuators.{joint}.gear_efficiency=1" for joint in EFFICIENCY),
    "plant.electronics={inverter_resistance_Ohm: 0, inverter_power_W: 0}",
    "plant.electronics={constant_power_W: 0, regeneration: 1}",
)
ARMATURE = KNEE_ACTUATOR.armature


def walk(*settings: str) -> Run:
    return simulate(load_experiment("treadmill_guided", ["duration_s=8", *FREE, *settings]).experiment)


@pytest.fixture(scope="module")
def free() -> Run:
    return walk()


@pytest.fixture(scope="module")
def lossy() -> Run:
    return walk(*LOSSY)


def table_friction(joint: str, velocity: np.ndarray) -> np.ndarray:
    """Half of equation (3.1), the plant's friction."""
    law = (HIP_FRICTION if joint == "hip" else KNEE_FRICTION).normalised()
    x = velocity / law.breakaway_velocity
    dip = np.sqrt(2.0 * np.e) * (law.breakaway_torque - law.coulomb_friction) * np.exp(-(x**2)) * x
    return 0.5 * (dip + law.coulomb_friction * np.tanh(10.0 * x) + law.viscous_friction * velocity)


@pytest.mark.parametrize("name", JOINTS)
def test_efficiency_reduces_power_in_both_directions(lossy: Run, name: str) -> None:
    """Power behind the gear without no-load friction: η times the motor power, or 1/η if the motor brakes.

    The torque at the gear is the motor torque minus the torque of the rotor, whose acceleration is a
    difference of velocities here.
    """
    joint = name.split("_")[1]
    motor, velocity, friction = (
        lossy.log[f"{name}_{column}"].to_numpy()
        for column in ("motor_torque_Nm", "velocity_rad_per_s", "friction_torque_Nm")
    )
    acceleration = np.gradient(velocity, 1e-3)
    load, lost = motor - ARMATURE * acceleration, -friction - table_friction(joint, velocity)
    # Where all is even: no switch of the torque, contact or reversal in the difference, and tanh 13 or more.
    even = np.abs(np.gradient(acceleration)) < 0.05
    turning = even & (np.abs(velocity) > 0.3) & (np.abs(load) > 3.0)
    drives, brakes = turning & (load * velocity > 0.0), turning & (load * velocity < 0.0)
    for rows, share in ((drives, 1.0 - EFFICIENCY[joint]), (brakes, 1.0 - 1.0 / EFFICIENCY[joint])):
        assert rows.sum() > 200
        assert np.median(lost[rows] / load[rows]) == pytest.approx(share, rel=0.01)
        np.testing.assert_allclose(lost[rows] / load[rows], share, rtol=0.1)


def test_losses_of_the_gear_change_the_walk_and_cost_energy_that_is_accounted_for(
    free: Run, lossy: Run
) -> None:
    gentle, dear = summarise_run(free), summarise_run(lossy)
    for name in JOINTS:
        angle = f"{name}_angle_rad"
        assert np.abs(np.degrees(lossy.log[angle] - free.log[angle])).max() > 1.0
    assert dear["battery_power_mean_W"] > 1.1 * gentle["battery_power_mean_W"]
    assert lossy.log["friction_work_J"].iloc[-1] < 1.5 * free.log["friction_work_J"].iloc[-1] < 0.0
    assert dear["energy_residual_share"] < 1e-9


def test_firmware_does_not_model_the_losses(lossy: Run) -> None:
    """Equation (2.16): the current of the commanded torque, whatever arrives."""
    for name, constant in (("left_hip", 10.9), ("left_knee", 7.05)):
        command = lossy.log[f"{name}_motor_command_torque_Nm"].clip(-60.0, 60.0)
        np.testing.assert_allclose(lossy.log[f"{name}_target_current_A"], command / constant, atol=1e-9)


def test_electronics_draw_the_set_power_and_a_chopper_dissipates_the_rest(free: Run) -> None:
    """Power by power from the currents of the log, with a battery that does not sag."""
    stiff = "plant.battery.internal_resistance_Ohm=0"
    run = walk(
        stiff,
        "plant.electronics={inverter_resistance_Ohm: 0.02, inverter_power_W: 0.5, constant_power_W: 6,"
        " regeneration: 0.7}",
    )
    bus = np.full(len(run.log), 6.0 + 4 * 0.5)
    for name, constant, resistance in zip(JOINTS, (10.9, 7.05) * 2, (0.82, 0.343) * 2, strict=True):
        current = run.log[f"{name}_measured_current_A"].to_numpy()
        back_emf = constant * run.log[f"{name}_velocity_rad_per_s"].to_numpy()
        bus += (resistance + 0.02) * current**2 + back_emf * current
    expected = np.where(bus > 0.0, bus, 0.7 * bus)
    np.testing.assert_allclose(run.log["battery_power_W"], expected, rtol=1e-9, atol=1e-9)
    assert (bus < 0.0).any()
    burnt = walk(stiff, "plant.electronics.regeneration=0")
    assert burnt.log["battery_power_W"].min() == 0.0
    # Without sag, what becomes of braking power moves nothing.
    everything = walk(stiff)
    assert burnt.log["left_knee_angle_rad"].equals(everything.log["left_knee_angle_rad"])
    assert everything.log["battery_power_W"].min() < 0.0


def test_summary_has_the_battery_life(free: Run) -> None:
    summary = summarise_run(free)
    assert summary["battery_capacity_Wh"] == pytest.approx(92.2)
    assert summary["battery_life_h"] == pytest.approx(92.2 / summary["battery_power_mean_W"])
    power, life = summary["battery_power_mean_W"], summary["battery_life_h"]
    assert f"  battery: {power:.1f} W, with which 92 Wh last {life:.1f} h" in report(summary)
    assert "battery: " not in "".join(report({**summary, "battery_life_h": None}))  # motors that feed it
