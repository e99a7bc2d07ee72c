"""A pelvis that pitches in the straps of the harness: closed forms, potential, energy, braces, limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from errors import raises
from log_rows import log_matrix
from scipy.integrate import solve_ivp

from twin_gait import load_experiment, simulate
from twin_gait.core.plant import Harness, strap_moment
from twin_gait.exceptions import TwinGaitError
from twin_gait.measures.effort import energy_balance
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.log import work_sources
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.studies.tune.objective import NEEDED_CLEARANCE, term_values
from twin_gait.worlds.bracing import _linear

FORCE, HEIGHT, LEVER, STIFFNESS = 500.0, 0.4, 0.1, 10e3
SLACK = math.asin(FORCE / (2.0 * STIFFNESS * LEVER))  # pitch at which a strap becomes slack


def moment_of(pitch, rate=0.0, *, lever=LEVER, damping=0.0, lean=0.0):
    """Return the moment of rope and straps about the hips."""
    harness = Harness(HEIGHT, FORCE, 0.0, pull=FORCE, lever=lever, strap_stiffness=STIFFNESS)
    harness.strap_damping, harness.strap_sine = damping, math.sin(lean)
    sine, cosine = math.sin(pitch), math.cos(pitch)
    return -FORCE * HEIGHT * sine + strap_moment(harness, sine, cosine, rate)


def potential(pitch, lean=0.0):
    """Return the energy of the two straps under a constant force, from the lengths of the straps."""
    ends = HEIGHT * math.cos(pitch) + np.array([-1.0, 1.0]) * LEVER * (math.sin(pitch) - math.sin(lean))
    # Height of the bar at which the tensions add up to the force, with two taut straps or one.
    bar = min(ends.mean() + 0.5 * FORCE / STIFFNESS, ends.min() + FORCE / STIFFNESS)
    stretch = np.maximum(bar - ends, 0.0)
    assert STIFFNESS * stretch.sum() == pytest.approx(FORCE)
    return 0.5 * STIFFNESS * float((stretch**2).sum()) - FORCE * bar


def test_moment_is_the_derivative_of_the_potential():
    assert 0.2 < SLACK < 0.3
    for lean in (0.0, 0.08, -0.1):
        for pitch in (-1.0, -0.9 * SLACK, -0.05, 0.0, 0.1, 0.95 * SLACK, 1.1 * SLACK, 0.7):
            slope = (potential(pitch + 1e-5, lean) - potential(pitch - 1e-5, lean)) / 2e-5
            assert moment_of(pitch, lean=lean) == pytest.approx(-slope, abs=1e-5)


def test_a_strap_that_is_slack_leaves_the_force_at_the_lever():
    for pitch in (SLACK, 1.3 * SLACK, -0.8):
        arm = math.copysign(LEVER * math.cos(pitch), pitch)
        assert moment_of(pitch) == pytest.approx(-FORCE * (HEIGHT * math.sin(pitch) + arm), rel=1e-12)
    assert abs(moment_of(0.99 * SLACK)) < abs(moment_of(SLACK))
    assert moment_of(0.3, 5.0, lever=0.0, damping=500.0) == pytest.approx(-FORCE * HEIGHT * math.sin(0.3))
    assert moment_of(0.0, 1.0, damping=50.0) == pytest.approx(-2.0 * 50.0 * LEVER**2)


def test_a_trunk_swings_in_the_straps_at_its_closed_frequency():
    inertia, weight, centre = 6.8, 42.2 * 9.81, 0.3155  # upper body of 70 kg about the hips
    stiffness = FORCE * HEIGHT + 2.0 * STIFFNESS * LEVER**2 - weight * centre
    frequency = math.sqrt(stiffness / inertia)

    def fall(time, state):
        return state[1], (weight * centre * math.sin(state[0]) + moment_of(state[0])) / inertia

    def cross(time, state):
        return state[0]

    found = solve_ivp(fall, (0.0, 3.0), (1e-3, 0.0), events=cross, rtol=1e-10, atol=1e-13).t_events[0]
    assert np.diff(found) == pytest.approx(math.pi / frequency, rel=1e-5)
    # Static equilibrium under an external moment, to first order and exactly.
    lean = 2.0 / stiffness
    assert moment_of(lean) + weight * centre * math.sin(lean) == pytest.approx(-2.0, rel=1e-3)


def walk_of(*changes: str):
    settings = ["duration_s=3", "scenario.support.pitch=soft", *changes]
    return simulate(load_experiment("treadmill_guided", settings).experiment)


@pytest.fixture(scope="module")
def walk():
    return walk_of("scenario.lean_deg=2", "scenario.support.strap_lean_deg=3")


def harness_moment(run, prefix: str = "") -> np.ndarray:
    """Return the moment of the straps from pitch and height in a log, by forces at two points."""
    log, support = run.log, run.experiment.scenario.support
    pitch, rate = (log[f"{prefix}trunk_pitch{end}"] for end in ("_rad", "_velocity_rad_per_s"))
    above = support.height * run.experiment.patient.height
    force = support.share * run.body_weight
    force = force - support.damping * (log[f"{prefix}pelvis_velocity_m_per_s"] - above * np.sin(pitch) * rate)
    np.testing.assert_allclose(log["support_force_N"], force, rtol=1e-9)
    lever = support.strap_lever
    lower = lever * (np.sin(pitch) - math.sin(support.strap_lean))  # of the attachment in front
    sinking = lever * np.cos(pitch) * rate
    front = 0.5 * force + support.strap_stiffness * lower + support.strap_damping * sinking
    front = np.clip(front, 0.0, force)
    at_front, at_rear = (above * np.sin(pitch) + side * lever * np.cos(pitch) for side in (1.0, -1.0))
    return np.asarray(-at_front * front - at_rear * (force - front))


def residual(run) -> float:
    log = run.log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    works = np.array([log[f"{source}_work_J"].to_numpy() for source in work_sources(log)])
    return float(energy_balance(energy, works)["energy_residual_share"])


def test_the_log_has_the_moment_of_the_straps(walk):
    """The column is found by inverse dynamics; it equals the moment of the forces of both straps."""
    assert walk.status == "completed"
    np.testing.assert_allclose(walk.log["guide_moment_Nm"], harness_moment(walk), atol=1e-8)
    pitch = np.degrees(walk.log["trunk_pitch_rad"])
    assert pitch.iloc[0] == pytest.approx(2.0, abs=1e-12)
    found = summarise_run(walk)["guide"]
    assert found["pitch_lowest_deg"] == pytest.approx(pitch.min())
    assert found["moment_rms_Nm"] == pytest.approx(np.sqrt((walk.log["guide_moment_Nm"] ** 2).mean()))
    assert "free_trunk" not in summarise_run(walk)


def test_energy_closes(walk):
    assert residual(walk) < 1e-8
    assert walk.log["spring_work_J"].abs().max() > 1.0


def test_the_support_of_a_running_walk_acts_on_the_rope(walk):
    run = SteppedRun(build_setup(walk.experiment))
    half = 0.5 * run.setup.world.support_force
    run.set({**run.numbers, "support_force": half}, fade_ticks=0)
    row = dict(zip(run.layout.names, run.advance(1)[0], strict=True))
    assert row["support_force_N"] == pytest.approx(half)


def test_a_trunk_that_leans_too_far_has_fallen():
    fallen = walk_of("scenario.lean_deg=2", "scenario.fall_lean_deg=1", "duration_s=0.1")
    assert fallen.status == "fell" and "lean" in fallen.reason


def test_mujoco_dynamics_give_the_log_of_the_compiled_engine():
    pytest.importorskip("mujoco")
    from mujoco_kernel import MujocoKernel  # needs MuJoCo

    settings = ["duration_s=0.15", "scenario.support.pitch=soft", "scenario.lean_deg=5"]
    setup = build_setup(load_experiment("treadmill_guided", settings).experiment)
    runs = CompiledEngine(setup).run(), ReferenceEngine(setup, kernel=MujocoKernel(setup).functions).run()
    ours, theirs = map(log_matrix, runs)
    assert np.ptp(runs[0].log["trunk_pitch_rad"]) > 0.01
    np.testing.assert_allclose(ours, theirs, atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (("scenario.support.guide=vertical",), ("pitch", "harness", "soft")),
        (("scenario.support.pitch=locked", "scenario.lean_deg=3"), ("lean", "locked")),
    ],
)
def test_a_pitch_that_cannot_be_is_rejected(changes, words):
    with raises(TwinGaitError, *words):
        load_experiment("treadmill_guided", ["scenario.support.pitch=soft", *changes])


# ------------------------------------------------------------------ braces


@pytest.fixture(scope="module")
def braced():
    stepping = "integration={method: rk4, step_ms: 0.1}"
    return walk_of("interface=brace", "engine=pinocchio", "duration_s=0.15", "scenario.lean_deg=2", stepping)


def test_braces_transmit_the_pitch(braced):
    """The forces between device and wearer cancel: the world holds both by the straps of the wearer only."""
    log, interface = braced.log, braced.experiment.interface
    np.testing.assert_allclose(log["guide_moment_Nm"], harness_moment(braced, "wearer_"), atol=1e-7)
    apart = log["trunk_pitch_rad"] - log["wearer_trunk_pitch_rad"]
    speed = log["trunk_pitch_velocity_rad_per_s"] - log["wearer_trunk_pitch_velocity_rad_per_s"]
    belt = interface.trunk.stiffness * apart + interface.trunk.damping * speed
    np.testing.assert_allclose(log["trunk_brace_torque_Nm"], belt, atol=1e-9)
    assert apart.abs().max() > math.radians(0.05)
    for side in ("left", "right"):
        turned = log[f"{side}_hip_angle_rad"] - log[f"{side}_hip_wearer_angle_rad"] - apart
        rate = log[f"{side}_hip_velocity_rad_per_s"] - log[f"{side}_hip_wearer_velocity_rad_per_s"] - speed
        cuff = interface.hip.stiffness * turned + interface.hip.damping * rate
        np.testing.assert_allclose(log[f"{side}_hip_brace_torque_Nm"], cuff, atol=1e-9)
    assert residual(braced) < 1e-4
    assert summarise_run(braced)["interaction"]["trunk"]["motion_peak_deg"] == pytest.approx(
        math.degrees(apart.abs().max())
    )


def test_the_stable_step_regards_cuffs_on_elevations(braced):
    """A waist that pitches while all legs keep their elevation loads only the belt of the trunk."""
    world = braced.experiment.build_world()
    model = world.model
    q = world.start_q[: model.nv]
    turned = np.zeros(2 * model.nv)
    turned[[model.pitch_index, *(model.index(side, "hip") for side in model.sides)]] = 1.0
    pushed = _linear(world, q)[len(turned) :, : len(turned)] @ turned
    force = np.zeros(2 * model.nv)
    stiffness = braced.experiment.interface.trunk.stiffness
    force[[model.pitch_index, model.nv + model.pitch_index]] = -stiffness, stiffness
    expected = np.concatenate(
        [
            np.linalg.solve(chain.mass_matrix(q), part)
            for chain, part in zip(world.chains, np.split(force, 2), strict=True)
        ]
    )
    np.testing.assert_allclose(pushed, expected, atol=1e-8 * np.abs(expected).max())


def test_the_default_walk_meets_the_goals_of_its_page():
    run = simulate(load_experiment().experiment)
    summary, sides = summarise_run(run), list(run.walk_measures().values())
    assert run.verdict.outcome == "walked"
    values = term_values(run)
    assert values["hip_error_deg"] < 3.5 and values["knee_error_deg"] < 4.5
    assert values["saturated_pct"] < 5.0 and values["belt_power_W"] < 1.0
    assert values["clearance_lack_mm"] < NEEDED_CLEARANCE - 10.0
    assert min(side["braking_peak"] for side in sides) > -0.12
    assert max(side["load_peak"] for side in sides) < 1.15
    assert min(side["knee_yield_deg"] for side in sides) > 4.0
    assert summary["step_stable"] and summary["energy_residual_share"] < 1e-8
