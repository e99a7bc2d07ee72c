"""The compiled engine against a loop that shares none of its steps, records or laws with it."""

from __future__ import annotations

import numpy as np
import oracle
import pytest

from twin_gait import load_experiment
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.simulation_setup import build_setup

EULER, RK4 = "semi_implicit_euler", "rk4"
LOSSY = ("plant.actuators.hip.gear_efficiency=0.85", "plant.actuators.knee.gear_efficiency=0.7")
ELECTRONICS = (
    "plant.electronics="
    "{inverter_resistance_Ohm: 0.05, inverter_power_W: 1, constant_power_W: 8, regeneration: 0.3}"
)
FOREFEET = (
    "scenario.contact.forefoot_stiffness_N_per_m1p5=6e5",
    "scenario.contact.forefoot_dissipation_s_per_m=0.8",
)
# Cases that repeat the proof of another one with the other integrator, of the same device or world.
SLOW = {
    "treadmill, Euler",
    "bench leg, Euler",
    "overground, four-point gait with rods",
    "hip exoskeleton, knees moved by the wearer",
    "prosthesis of one leg",
    "aligned prosthesis of one leg",
}
CASES = {
    "bench leg, Euler": ("bench_leg", EULER, 1.0, 2000),
    "bench leg, RK4": ("bench_leg", RK4, 1.0, 2000),
    "bench leg, gears that lose under load": ("bench_leg", EULER, 1.0, 2000, *LOSSY),
    "bench leg, electronics": ("bench_leg", EULER, 1.0, 2000, ELECTRONICS),
    "treadmill, Euler": ("treadmill_guided", EULER, 0.25, 1500),
    "treadmill, RK4, forefeet that are unlike heels": ("treadmill_guided", RK4, 0.25, 500, *FOREFEET),
    "treadmill, trunk in straps": (
        "treadmill_guided",
        RK4,
        0.25,
        150,
        "scenario.support={pitch: soft, strap_lever_m: 0.04, strap_stiffness_N_per_m: 1e5}",
        "scenario.support.strap_lean_deg=2",
        "scenario.lean_deg=4",
    ),
    "overground, crutches that are lifted": (
        "overground",
        EULER,
        0.25,
        400,
        "scenario.arms={planted_s: 0.05, lift_ahead_m: 0.5, swing_s: 0.1, reach_deg: 12}",
        "scenario.harness={share: 0.3, damping_Ns_per_m: 90}",
        "scenario.leading_phase=early_stance",
        "scenario.trailing_phase=late_stance",
    ),
    "overground, four-point gait with rods": (
        "overground",
        EULER,
        0.25,
        1000,
        "scenario.arms={pattern: four_point, delay_ms: 20, planted_s: 0.05, swing_s: 0.1, reach_deg: 12, "
        "announce_load_N: 5, min_axial_force: 0.03, touch_N: 4, lowering_m_per_s: 1}",
        "scenario.crutches={centre_of_mass_m: 0.55, inertia_kgm2: 0.3, tension_limit_N: 30}",
        "scenario.harness={share: 0.3, damping_Ns_per_m: 90}",
        "scenario.leading_phase=early_stance",
        "scenario.trailing_phase=late_stance",
    ),
    "treadmill, gears that lose under load": ("treadmill_guided", EULER, 0.25, 500, *LOSSY),
    "hip exoskeleton, knees moved by the wearer": ("hip_exoskeleton", EULER, 0.25, 1500),
    "prosthesis of one leg": ("osl_prosthesis", EULER, 0.25, 1000),
    "aligned prosthesis of one leg": ("sup_prosthesis", EULER, 0.25, 800),
}


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=name, marks=[pytest.mark.slow] * (name in SLOW)) for name, case in CASES.items()],
)
def test_the_compiled_engine_moves_the_leg_as_the_second_loop_does(case):
    preset, method, step, ticks, *changes = case
    stepping = f"integration={{method: {method}, step_ms: {step}}}"
    settings = ["sensors.ideal=true", f"duration_s={ticks / 1000}", stepping, *changes]
    problem = build_setup(load_experiment(preset, settings).experiment)
    ours, theirs = CompiledEngine(problem).run(), oracle.motion(problem, ticks)
    assert ours.status == "completed"
    assert ours.trip is None  # the second loop has no safety monitor

    angles, _ = state_columns(problem.world.model)
    for side in problem.sides[: len(problem.world.arms)]:
        angles += [f"{side}_crutch_forward_m", f"{side}_crutch_height_m"]
    joints = [f"{item.side}_{item.joint}_motor_torque_Nm" for item in problem.joints]
    coordinates = [item.coordinate for item in problem.joints]
    phases = np.transpose([ours.log[f"{side}_phase"].cat.codes for side in problem.sides])
    np.testing.assert_array_equal(phases, theirs.phases)
    np.testing.assert_allclose(ours.log[angles], theirs.q, atol=1e-12, rtol=0.0)
    np.testing.assert_allclose(ours.log[joints], theirs.motor[:, coordinates], atol=1e-10, rtol=0.0)
    assert ours.switches  # it is a step, not a rest
