"""Loss of the supply: law of shorted windings, drives and bus after the loss, descent of the wearer."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from injected_faults.descents import TRUNK_HELD
from log_rows import log_matrix

from twin_gait import load_experiment, simulate
from twin_gait.cli.simulate import report
from twin_gait.core.actuator import Motor, shorted_current
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, LaneEngine
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup

# Torque constant times gear ratio in [N·m/A], resistance of winding and inverter in [Ω]: the data sheet.
DATA_SHEET = {"hip": (0.109 * 100, 0.84), "knee": (0.0705 * 100, 0.363)}
KNEE, TURN = Motor(0.0705, 100.0, 0.363), 0.88  # and the inductive time in [s]
HELD = (*TRUNK_HELD, "scenario.fall_height_share=0.1")


@cache
def lost(preset: str, *settings: str, fault: str, seconds: float) -> Run:
    given = [*settings, f"faults=[{fault}]", f"duration_s={seconds}"]
    return simulate(load_experiment(preset, given).experiment)


def descend(fault: str) -> Run:
    return lost("treadmill_start_stop", *HELD, fault=fault, seconds=10.0)


# ------------------------------------------------------------------ the law


def dq_torque(motor: Motor, velocity: float, inductive_time: float, pole_pairs: float = 12.0) -> float:
    """Solve the equations of the shorted machine in rotor coordinates for its torque at the joint in [N·m].

    0 = R i_d − ω_e L i_q,  0 = R i_q + ω_e L i_d + ω_e ψ,  T = 3/2 p ψ i_q, with values of a phase: half of
    those from line to line, and p ψ √3 the amplitude of the back-EMF from line to line over the speed.
    """
    resistance = motor.resistance / 2.0
    inductance = inductive_time * resistance / (pole_pairs * motor.gear_ratio)
    flux = motor.torque_constant / (np.sqrt(3.0) * pole_pairs)
    electrical = pole_pairs * motor.gear_ratio * velocity
    matrix = [[resistance, -electrical * inductance], [electrical * inductance, resistance]]
    _, quadrature = np.linalg.solve(matrix, [0.0, -electrical * flux])
    return float(1.5 * pole_pairs * flux * quadrature * motor.gear_ratio)


@pytest.mark.parametrize("inductive_time", [0.0, TURN, 5.0])
@pytest.mark.parametrize("velocity", [-6.0, -0.3, 1e-3, 1.0, 9.0])
def test_the_torque_of_shorted_windings_is_that_of_the_three_phases(velocity, inductive_time):
    torque = shorted_current(KNEE, velocity, inductive_time) * KNEE.torque_constant * KNEE.gear_ratio
    assert torque == pytest.approx(dq_torque(KNEE, velocity, inductive_time), rel=1e-12)
    assert torque * velocity < 0.0


def test_without_inductance_the_torque_is_a_damping_and_with_it_has_a_maximum():
    constant, resistance = DATA_SHEET["knee"]
    assert shorted_current(KNEE, 2.0, 0.0) * constant == pytest.approx(-(constant**2) / resistance * 2.0)
    assert shorted_current(KNEE, 0.0, TURN) == 0.0
    speeds = np.linspace(0.01, 10.0, 1000)
    torques = [-shorted_current(KNEE, speed, TURN) * constant for speed in speeds]
    assert speeds[np.argmax(torques)] == pytest.approx(1.0 / TURN, abs=0.01)
    assert max(torques) == pytest.approx(constant**2 / resistance / TURN / 2.0, rel=1e-4)


# ------------------------------------------------------------------ drives and bus


@pytest.mark.parametrize("fault", ["supply_loss_shorted@0.4s", "supply_loss_open@0.4s"])
def test_no_command_reaches_a_motor_after_the_loss(fault):
    """The current is the back-EMF over the resistance, or 0, also in a drive that the monitor cut off."""
    dead = "motor_dead:right_knee@0.1s"
    inverter = "plant.electronics.inverter_resistance_Ohm=0.02"
    log = lost("bench_leg", inverter, fault=f"'{dead}', '{fault}'", seconds=1.5).log
    before, after = log[log["time_s"] < 0.399], log[log["time_s"] > 0.3995]
    assert before["right_knee_measured_current_A"].iloc[-1] == 0.0 != before["battery_power_W"].iloc[-1]
    for joint, (constant, resistance) in DATA_SHEET.items():
        speed = after[f"right_{joint}_velocity_rad_per_s"].to_numpy()
        current = after[f"right_{joint}_measured_current_A"].to_numpy()
        expected = -constant * speed / resistance if "shorted" in fault else 0.0 * speed
        np.testing.assert_allclose(current, expected, rtol=1e-12)
        np.testing.assert_allclose(after[f"right_{joint}_motor_torque_Nm"], constant * expected, rtol=1e-12)
        assert np.ptp(speed) > 0.02
    assert (after["battery_power_W"] == 0.0).all()


def test_the_bus_falls_to_nothing_or_to_the_back_emf():
    settings = ("scenario.support.share=0.6",)
    shorted = lost("treadmill_guided", *settings, fault="supply_loss_shorted@3.3s", seconds=4.0).log
    opened = lost("treadmill_guided", *settings, fault="supply_loss_open@3.3s", seconds=4.0).log
    assert (shorted["bus_voltage_V"].iloc[3302:] == 1.0).all()
    emf = np.max(
        [
            constant * np.abs(opened[f"{side}_{joint}_velocity_rad_per_s"])
            for side in ("left", "right")
            for joint, (constant, _) in DATA_SHEET.items()
        ],
        axis=0,
    )
    assert emf[3300:].max() > 5.0
    np.testing.assert_allclose(opened["bus_voltage_V"].iloc[3301:], np.maximum(emf[3300:-1], 1.0))


def test_the_loss_trips_the_monitor_within_the_reaction_time_of_a_low_voltage():
    run = descend("supply_loss_shorted@2s")
    assert run.trip is not None and run.trip.cause == "supply" and 2000 <= run.trip.tick <= 2011


# ------------------------------------------------------------------ the descent


def test_shorted_windings_lower_a_held_trunk_slowly():
    """The numbers are those of docs/reference/faults.md."""
    braked = summarise_run(descend("supply_loss_shorted@2s"))["supply_loss"]
    opened = braked["with_open_windings"]
    assert braked["windings"] == "shorted" and braked["time_s"] == 2.0
    assert (
        round(braked["sinking_peak_m_per_s"], 2) == 0.16 and round(opened["sinking_peak_m_per_s"], 2) == 1.53
    )
    assert braked["pelvis_lowest_m"] < 0.55 and opened["pelvis_lowest_m"] < 0.55
    inductive = summarise_run(descend("supply_loss_shorted@2s=0.88s"))["supply_loss"]
    assert 0.16 < inductive["sinking_peak_m_per_s"] < 0.2


def test_the_energy_of_the_descent_heats_the_windings():
    """The braking power of the data sheet integrates to the work that the motors take from the bodies."""
    run = descend("supply_loss_shorted@2s")
    log = run.log[run.log["time_s"] >= 2.0]
    change = {name: log[name].iloc[-1] - log[name].iloc[0] for name in log if name.endswith("_J")}
    heat = sum(
        np.trapezoid(constant**2 * log[f"{side}_{joint}_velocity_rad_per_s"] ** 2 / resistance, dx=1e-3)
        for side in ("left", "right")
        for joint, (constant, resistance) in DATA_SHEET.items()
    )
    assert -change["motor_work_J"] == pytest.approx(heat, rel=1e-3)
    released = -change["potential_energy_J"] - change["kinetic_energy_J"]
    works = sum(value for name, value in change.items() if name.endswith("_work_J"))
    assert released == pytest.approx(-works, rel=1e-3) and 0.4 * released < heat < 0.8 * released


def test_summary_and_terminal_state_the_descent():
    run = descend("supply_loss_open@2s")
    summary = summarise_run(run)
    assert (
        summary["supply_loss"]["windings"] == "open" and summary["supply_loss"]["with_open_windings"] is None
    )
    (line,) = [line for line in report(summary) if "supply lost" in line]
    assert "2 s" in line and "1.53 m/s" in line and "windings open" in line
    assert "supply_loss" not in summarise_run(lost("bench_leg", fault="supply_loss_open@0.1s", seconds=0.3))


@pytest.mark.slow  # compiles the loop of the floor
def test_standing_on_the_floor_the_braking_delays_the_fall_by_seconds():
    """Shorted windings brake the joints; on the floor nobody keeps the balance of the wearer in the end."""
    runs = {
        windings: lost("overground", "modes=walking", fault=f"supply_loss_{windings}@3s", seconds=15.0)
        for windings in ("shorted", "open")
    }
    sinking = {name: -run.log["pelvis_velocity_m_per_s"].iloc[3000:].min() for name, run in runs.items()}
    assert runs["open"].duration < 4.5 and runs["shorted"].duration > 9.0
    assert sinking["shorted"] < 0.8 < 1.0 < sinking["open"]
    assert -runs["shorted"].log["pelvis_velocity_m_per_s"].iloc[3000:8000].min() < 0.02


@pytest.mark.slow  # compiles the loop of the lanes
def test_in_lockstep_each_lane_loses_its_own_supply():
    kinds = ["supply_loss_shorted", "supply_loss_open", "supply_dip"]
    given = [
        load_experiment(
            "treadmill_guided",
            [f"faults=['{kinds[number % 3]}@{0.1 + 0.01 * number:.2f}s']", "duration_s=0.5"],
        ).experiment
        for number in range(MIN_BLOCK_SIZE)
    ]
    alone = [CompiledEngine(build_setup(item)).run() for item in given]
    lanes = LaneEngine([CompiledEngine(build_setup(item)) for item in given]).run()
    for one, other in zip(alone, lanes, strict=True):
        np.testing.assert_array_equal(log_matrix(one), log_matrix(other))
