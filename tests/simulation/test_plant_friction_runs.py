"""Runs of a leg whose friction has bristles or directions: stiction, break-away, stick and slip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from numpy.testing import assert_allclose, assert_array_equal
from plain_bench import plain_rows
from scipy.integrate import solve_ivp

from twin_gait import Experiment, JointName, Run, RunStatus, load_experiment, simulate
from twin_gait.configuration.bench_device import bench_joint
from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK
from twin_gait.parameters.friction import LuGreFriction
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.simulation.log import WORK_SOURCES
from twin_gait.worlds.bench_joint import BenchFriction
from twin_gait.worlds.bench_leg import ImposedMotionParameters

PHASES = ("early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension")
COULOMB, BREAKAWAY, STRIBECK, VISCOUS, STIFFNESS, DAMPING = 2.0, 5.0, 0.05, 0.1, 1500.0, 100.0
LUGRE = (
    f"{{law: lugre, coulomb_friction_Nm: {COULOMB}, breakaway_torque_Nm: {BREAKAWAY}, "
    f"stribeck_velocity_rad_per_s: {STRIBECK}, viscous_friction_forward_Nm: {VISCOUS}, "
    f"viscous_friction_backward_Nm: {VISCOUS}, "
    f"bristle_stiffness_Nm_per_rad: {STIFFNESS}, bristle_damping_Nms_per_rad: {DAMPING}}}"
)
SKEWED = (
    "{law: asymmetric, coulomb_friction_Nm: 2, breakaway_torque_Nm: 3, stribeck_velocity_rad_per_s: 0.1, "
    "transition_velocity_rad_per_s: 0.02, offset_Nm: 0.4, viscous_friction_forward_Nm: 1.5, "
    "viscous_friction_backward_Nm: 0.8, viscous_exponent: 0.7}"
)
WHOLE = "plant.friction_ratio={hip: 1, knee: 1}"
# Motors that give the target torque and nothing else.
IDLE = (
    "control.mode=transparent",
    "control.safety.enabled=false",
    "plant.gravity_m_per_s2=0",
    "scenario.start={hip_deg: 20, knee_deg: 20}",
    *(f"table.phases.{p}.{j}.friction_compensation_gain=0" for p in PHASES for j in ("hip", "knee")),
)


def friction(hip: str, knee: str) -> tuple[str, ...]:
    return (WHOLE, f"plant.friction.hip={hip}", f"plant.friction.knee={knee}")


def experiment(*settings: str, preset: str = "bench_leg") -> Experiment:
    return load_experiment(preset, settings).experiment


def run(*settings: str) -> Run:
    return simulate(experiment(*settings))


def knee(found: Run) -> np.ndarray:
    return found.log["right_knee_angle_rad"].to_numpy()


# ---------------------------------------------------------------------- stiction and break-away


@pytest.mark.parametrize(("share", "moves"), [(0.97, False), (1.03, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_breaks_away_at_its_breakaway_torque(share: float, moves: bool, sign: float) -> None:
    """A weak spring pulls slowly; below break-away the bristles yield by x = -T_b/σ0 ln(1 - T/T_b)."""
    spring = 10.0
    yields = -BREAKAWAY / STIFFNESS * math.log1p(-0.97)
    amplitude = sign * (share * BREAKAWAY / spring + yields)
    found = run(
        *IDLE,
        *friction(LUGRE, LUGRE),
        f"scenario.imposed_motion={{joint: knee, amplitude_rad: {amplitude}, frequency_Hz: 0.02, "
        f"stiffness_Nm_per_rad: {spring}, damping_Nms_per_rad: 0}}",
        "duration_s=30",
    )
    way = np.abs(knee(found) - knee(found)[0]).max()
    assert way > 0.3 if moves else way == pytest.approx(yields, rel=0.02)


def test_a_joint_that_sticks_does_not_creep_where_a_static_law_does() -> None:
    """Four seconds under half the Coulomb friction, the last two of them looked at."""
    settings = (*IDLE, "control.target_torque_Nm={hip: 0, knee: 1}", "duration_s=4")
    sticking, creeping = run(*settings, *friction(LUGRE, LUGRE)), run(*settings)
    later = round(2.0 / TICK)
    assert np.ptp(knee(sticking)[later:]) < 1e-6
    assert np.ptp(knee(creeping)[later:]) > 1e-3


def test_friction_takes_energy_and_the_balance_closes() -> None:
    log = run("duration_s=3", *friction(LUGRE, LUGRE)).log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    work = log[[f"{name}_work_J" for name in WORK_SOURCES]].to_numpy().sum(axis=1)
    throughput = np.abs(np.diff(log["motor_work_J"])).sum()
    assert np.abs(energy - energy[0] - work).max() < 1e-4 * throughput
    # What the bristles of a joint can store is given back at most.
    stored = 2 * 0.5 * BREAKAWAY**2 / STIFFNESS
    taken = -log["friction_work_J"].to_numpy()
    assert (taken - np.maximum.accumulate(taken)).min() >= -stored
    assert taken[-1] > 1.0


# ---------------------------------------------------------------------- against others


def test_stick_and_slip_equal_mujoco_and_an_adaptive_solver() -> None:
    """A weak spring drags the knee along; law, dynamics and integrator are others, typed a second time."""
    mujoco = pytest.importorskip("mujoco")
    from crosscheck.mujoco_legs import legs_of

    amplitude, frequency, spring, grip = math.radians(60.0), 0.05, 40.0, 0.1
    settings = (
        *IDLE,
        *friction(LUGRE, LUGRE),
        "duration_s=8",
        f"scenario.imposed_motion={{joint: knee, amplitude_rad: {amplitude}, frequency_Hz: {frequency}, "
        f"stiffness_Nm_per_rad: {spring}, damping_Nms_per_rad: {grip}}}",
    )
    world = experiment(*settings).build_world()
    model = legs_of(experiment(*settings), world.model)
    data, start = mujoco.MjData(model), float(world.start_q[1])

    def rates(time: float, state: np.ndarray) -> np.ndarray:
        q, v, z = state[:2], state[2:4], state[4:]
        level = COULOMB + (BREAKAWAY - COULOMB) * np.exp(-((v / STRIBECK) ** 2))
        bending = v - STIFFNESS * np.abs(v) / level * z
        torque = -(STIFFNESS * z + DAMPING * bending + VISCOUS * v)
        turn = 2.0 * math.pi * frequency
        path = start + 0.5 * amplitude * (1.0 - math.cos(turn * time))
        torque[1] += spring * (path - q[1]) + grip * (0.5 * amplitude * turn * math.sin(turn * time) - v[1])
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, torque
        mujoco.mj_forward(model, data)
        return np.concatenate([v, data.qacc, bending])

    time = TICK * np.arange(8000)
    first = [*world.start_q, 0.0, 0.0, 0.0, 0.0]
    theirs = solve_ivp(
        rates, (0.0, time[-1]), first, method="LSODA", rtol=1e-9, atol=1e-11, t_eval=time, max_step=0.01
    ).y
    fast = theirs[3] > 0.1
    assert np.sum(fast[1:] & ~fast[:-1]) >= 3  # it slips three times, and sticks in between
    errors = [
        np.abs(knee(run(*settings, f"integration.step_ms={step}")) - theirs[1]).max() for step in (1.0, 0.25)
    ]
    assert errors[0] < 1e-3  # of 0.98 rad
    assert errors[1] < 0.3 * errors[0]  # of first order in the step


@pytest.mark.parametrize(
    ("preset", "duration", "method"),
    [
        ("bench_leg", 1.0, "rk4"),
        pytest.param("bench_leg", 1.0, "semi_implicit_euler", marks=pytest.mark.slow),
        pytest.param("treadmill_guided", 0.2, "rk4", marks=pytest.mark.slow),
    ],
)
def test_both_engines_have_the_same_friction(preset: str, duration: float, method: str) -> None:
    stepping = (f"integration.method={method}", "integration.step_ms=0.5")
    settings = (f"duration_s={duration}", *stepping, *friction(SKEWED, LUGRE))
    compiled, reference = (
        simulate(experiment(*settings, f"engine={engine}", preset=preset))
        for engine in ("compiled", "pinocchio")
    )
    assert compiled.status is reference.status is RunStatus.COMPLETED
    for column in (
        name for name in compiled.log.columns if name.endswith(("angle_rad", "friction_torque_Nm"))
    ):
        assert_allclose(compiled.log[column], reference.log[column], atol=1e-9, rtol=0.0, err_msg=column)
    alone = simulate(experiment(f"duration_s={duration}", *stepping, preset=preset))
    column = f"{alone.sides[0]}_knee_angle_rad"
    assert np.abs(alone.log[column] - compiled.log[column]).max() > 1e-4


def test_bristles_too_stiff_for_the_step_are_refused_in_one_line() -> None:
    stiff = LUGRE.replace(f"rad: {STIFFNESS}", "rad: 1.0e+8")
    with raises(ParameterError, "plant.friction", "1 ms", "integration.step_ms") as caught:
        run(*friction(LUGRE, stiff))
    assert "\n" not in str(caught.value)
    enough = float(str(caught.value).split("integration.step_ms to ")[1].split()[0])
    found = run(*IDLE, *friction(LUGRE, stiff), f"integration.step_ms={enough}", "duration_s=0.2",
                "control.target_torque_Nm={hip: 0, knee: 1}")  # fmt: skip
    assert found.status is RunStatus.COMPLETED
    assert np.ptp(knee(found)) < 1e-4


# ---------------------------------------------------------------------- the joint bench


DAHL = LuGreFriction(coulomb_friction=3.0, bristle_stiffness=1500.0)


def test_bristles_of_the_joint_bench_bend_by_the_closed_form_of_dahl() -> None:
    """Pushed along from rest: F = T_c (1 - exp(-σ0 x / T_c)), whatever the speed on the way."""
    push = ImposedMotionParameters(amplitude=0.02, frequency=0.5)
    friction = BenchFriction(law=DAHL)
    test = bench_joint(JointName.KNEE, friction=friction, gravity=0.0, imposed_motion=push, duration=0.9)
    found = simulate_bench(test)
    way = found.column("motor_angle_rad") - test.start_angle
    assert (np.diff(way) > 0.0).all()
    assert way[-1] > 3.0 * 3.0 / 1500.0  # it slides in the end
    expected = 3.0 * np.expm1(-1500.0 * way / 3.0)
    assert_allclose(found.column("friction_torque_Nm"), expected, rtol=1e-9, atol=1e-12)


def test_a_joint_that_sticks_on_the_bench_is_the_same_compiled_and_plain() -> None:
    law = replace(DAHL, breakaway_torque=4.5, stribeck_velocity=0.05, bristle_damping=30.0, offset=0.4)
    friction = BenchFriction(law=law, coulomb_per_load=0.1, ripple=0.3)
    test = bench_joint(JointName.KNEE, friction=friction, start_angle=0.5, duration=0.05)
    assert_array_equal(simulate_bench(test).log.to_numpy(), plain_rows(test))
