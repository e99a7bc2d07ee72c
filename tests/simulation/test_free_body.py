"""Tests of a free trunk by independent references: the guided walk, energy, a fall."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from errors import raises
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from twin_gait import Run, load_experiment, simulate
from twin_gait.core.contact import ContactState, Ground
from twin_gait.core.plant import MechanicalStop, Plant, Spring
from twin_gait.exceptions import TwinGaitError
from twin_gait.kernels.pinocchio_kernel import PinocchioKernel
from twin_gait.leg_model.joints import PELVIS_JOINT
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.measures.effort import energy_balance
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiled_engine import assemble, kernel_names
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.log import state_columns, work_sources
from twin_gait.simulation.record import deep_copy
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.simulation.stages.motion import integrate
from twin_gait.vocabulary import JointName, Side

GRAVITY = 9.81
NO_CRUTCHES = "scenario.crutches=none"
EULER = "integration={method: semi_implicit_euler, step_ms: 0.25}"


@lru_cache(maxsize=4)
def walk(preset: str, *changes: str) -> Run:
    return simulate(load_experiment(preset, ["sensors.ideal=true", *changes]).experiment)


def problem_of(*changes: str) -> SimulationSetup:
    return build_setup(load_experiment("overground", ["sensors.ideal=true", *changes]).experiment)


# ------------------------------------------------------------------ under the guide's own force


class Recorded(NamedTuple):
    """State of the guided walk with forces and accelerations."""

    q: list[float]
    v: list[float]
    torque: list[float]
    rotors: list[float]
    ground: Ground
    a: list[float]


def recorded(guide: str, ticks: int) -> tuple[list[Recorded], np.ndarray, list[int]]:
    """Record a walk on the treadmill with the dynamics of Pinocchio.

    Returns:
        The state in which every row of the log was written; force and moment of the guide there, shape
        ``(n, 2)``; and where its coordinates stand among those of a free trunk.
    """
    settings = ["sensors.ideal=true", f"scenario.support.guide={guide}", f"duration_s={ticks / 1000}"]
    guided = build_setup(load_experiment("treadmill_guided", ["engine=pinocchio", *settings]).experiment)
    functions = PinocchioKernel(guided.world, guided.control_model).functions
    last: list[Recorded] = []
    seen: list[Recorded] = []

    def dynamics(q, v, torque, rotors, bodies, gravity, ground, a, points):  # type: ignore[no-untyped-def]
        power = functions["dynamics"](q, v, torque, rotors, bodies, gravity, ground, a, points)
        last[:] = [Recorded(list(q), list(v), list(torque), list(rotors), deep_copy(ground), list(a))]
        return power

    def observe(*state: Any) -> Any:
        seen.extend(last)
        return functions["observe"](*state)

    engine = ReferenceEngine(guided, kernel={**functions, "dynamics": dynamics, "observe": observe})
    log = engine.run().log
    columns = [state_columns(item.world.model)[0] for item in (guided, problem_of(NO_CRUTCHES))]
    taken = log[["guide_force_N", "guide_moment_Nm"]].to_numpy()
    return seen, taken, [columns[1].index(name) for name in columns[0]]


@pytest.mark.parametrize("guide", ["vertical", "harness"])
def test_a_free_trunk_under_the_recorded_guide_force_equals_the_guided_one(guide):
    """Compare accelerations and the steps of a tick; the free trunk uses the generated kernel."""
    seen, taken, columns = recorded(guide, 400)
    problem = problem_of(NO_CRUTCHES)
    model, (kernel, episode, _) = problem.world.model, assemble(problem)
    dynamics, points = kernel_names(kernel)["dynamics"], [ContactState() for _ in kernel.points]

    def spread(values: list[float]) -> np.ndarray:
        whole = np.zeros(model.nv)
        whole[columns] = values
        return whole

    for state, (force, moment) in zip(seen, taken, strict=True):
        q, v, torque, expected = map(spread, (state.q, state.v, state.torque, state.a))
        torque[model.pitch_index] += moment
        torque[model.forward_index] += force if guide == "vertical" else 0.0  # else a spring has it already
        a = np.zeros(model.nv)
        dynamics(q, v, torque, spread(state.rotors), episode.bodies, GRAVITY, state.ground, a, points)
        assert_allclose(a, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(taken).max(axis=0).min() > 20.0
    assert len(seen) == 400


def test_integrated_under_that_force_it_stays_with_the_guided_one():
    """Integrate both for half a second in steps of 0.1 ms, with the guide force of the guided walk."""
    guided, model = (
        load_experiment("treadmill_guided").experiment.build_world().model,
        problem_of(NO_CRUTCHES).world.model,
    )
    q, whole = np.zeros(guided.nv), np.zeros(model.nv)
    columns = [state_columns(model)[0].index(name) for name in state_columns(guided)[0]]
    q[:] = np.linspace(-0.2, 0.6, guided.nv)
    whole[columns] = q
    v, whole_v = np.zeros(guided.nv), np.zeros(model.nv)
    for step in range(5000):
        torque = 8.0 * np.sin(0.002 * step + np.arange(guided.nv)) - 4.0 * v
        a = pin.aba(guided.model, guided.data, q, v, torque)
        pin.rnea(guided.model, guided.data, q, v, a)
        wrench = guided.data.f[int(guided.model.getJointId(PELVIS_JOINT))]
        spread = np.zeros(model.nv)
        spread[columns] = torque
        spread[[model.forward_index, model.pitch_index]] = wrench.linear[0], wrench.angular[1]
        whole_v += 1e-4 * pin.aba(model.model, model.data, whole, whole_v, spread)
        whole += 1e-4 * whole_v
        v = v + 1e-4 * a
        q = q + 1e-4 * v
    expected = np.zeros(model.nv)
    expected[columns] = q
    assert_allclose(whole, expected, rtol=0.0, atol=1e-9)
    assert np.abs(v).max() > 1.0


# ------------------------------------------------------------------ energy

HELD = ("scenario.harness={share: 0.3, damping_Ns_per_m: 90}",)


@pytest.mark.slow  # a loop of its own
def test_energy_closes_with_arms_and_harness():
    log = walk("overground", "duration_s=0.9", "scenario.lean_deg=30", *HELD).log
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    works = np.array([log[f"{source}_work_J"].to_numpy() for source in work_sources(log)])
    assert energy_balance(energy, works)["energy_residual_share"] < 1e-4


def test_work_of_the_arms_counts_for_the_patient_and_work_of_the_rope_is_elastic():
    """Powers from forces and differences of positions in the log: P dℓ + M dφ, and F dz."""
    run = walk("overground", "duration_s=0.9", "scenario.lean_deg=30", *HELD)
    log, world = run.log, run.experiment.build_world()
    pitch = log["trunk_pitch_rad"].to_numpy()
    done = np.zeros(len(pitch) - 1)
    for side in ("left", "right"):
        shoulder = world.trunk.shoulder * np.array([np.sin(pitch), np.cos(pitch)])
        hips = np.array([log["pelvis_forward_m"], log["pelvis_height_m"]])
        tip = np.array([log[f"{side}_crutch_forward_m"], log[f"{side}_crutch_height_m"]])
        away = tip - hips - shoulder
        length, angle = np.hypot(*away), np.arctan2(away[0], -away[1]) + pitch
        for effort, way in (("arm_axial_force_N", length), ("shoulder_moment_Nm", angle)):
            force = log[f"{side}_{effort}"].to_numpy()
            done += 0.5 * (force[1:] + force[:-1]) * np.diff(way)
    work = log["external_work_J"].to_numpy()
    done[:20], work = 0.0, work - work[20]  # the first ticks, in which all soles land, are too short for this
    assert_allclose(np.cumsum(done)[20:], work[21:], atol=0.01 * np.abs(np.diff(work)).sum())
    assert np.abs(work).max() > 1.0
    rope = log["pelvis_height_m"].to_numpy() + world.trunk.harness.height * np.cos(pitch)
    pull = log["support_force_N"].to_numpy()
    ankles = sum(
        0.5 * (torque[1:] + torque[:-1]) * np.diff(angle)
        for torque, angle in (
            (log[f"{side}_ankle_orthosis_torque_Nm"].to_numpy(), log[f"{side}_ankle_angle_rad"].to_numpy())
            for side in ("left", "right")
        )
    )
    found = np.cumsum(0.5 * (pull[1:] + pull[:-1]) * np.diff(rope) + ankles)
    spring = log["spring_work_J"].to_numpy()
    assert_allclose(found, spring[1:], atol=0.01 * np.abs(np.diff(spring)).sum())


# ------------------------------------------------------------------ a stiff body

STIFF = MechanicalStop(0.0, 0.0, 0.0, 0.0)


def locked_at(angle: float) -> Plant:
    """Return a joint that hardly moves from its position."""
    stiffness = 4e4
    return Plant(stop=STIFF, spring=Spring(stiffness, 200.0, stiffness * angle))


def stiff_body(lean: float) -> tuple[SimulationSetup, Episode, Callable[[Episode, int], None]]:
    """Return an episode that is straight and stiff above free ankles, leaning over soles on hard ground."""
    problem = problem_of(
        NO_CRUTCHES,
        "integration={method: semi_implicit_euler, step_ms: 0.05}",
        "scenario.contact={stiffness_N_per_m1p5: 1e7, transition_velocity_m_per_s: 0.02}",
        "scenario.contact.friction_coefficient=2",
    )
    kernel, e, structure = assemble(problem)
    e.recording.on = False
    model = problem.world.model
    e.q = [0.0] * model.nv
    e.q[model.pitch_index] = lean
    for side in model.sides:  # soles lie flat
        index = model.index(side, JointName.ANKLE)
        e.q[index] = min(lean, -lean, key=lambda angle: _tilt(model, side, e.q, index, angle))
    soles = [name for leg in model.legs.values() for name in leg.contact_frames]
    e.q[model.pelvis_index] = -min(float(model.frame_position(np.array(e.q), name)[2]) for name in soles)
    free = {model.forward_index, model.pelvis_index, model.pitch_index}
    free |= {model.index(side, JointName.ANKLE) for side in model.sides}
    for index, inertia in enumerate(e.rotors):
        e.plant[index] = Plant() if index in free else locked_at(e.q[index])
        e.plant[index].armature = inertia
    e.a = [0.0] * model.nv
    return problem, e, specialize(integrate, {**structure, **kernel_names(kernel), "FRICTION_INDICES": ()})


def _tilt(model: LegModel, side: Side, q: list[float], ankle: int, angle: float) -> float:
    """Return the difference of the heights of heel and toe."""
    turned = np.array(q)
    turned[ankle] = angle
    heel, toe = (model.frame_position(turned, name)[2] for name in model.legs[side].contact_frames)
    return abs(float(heel - toe))


def above_the_ankles(problem: SimulationSetup, q: list[float]) -> tuple[float, np.ndarray, float]:
    """Return mass, centre of mass and inertia about the ankles of all bodies except the feet."""
    model = problem.world.model
    pin.forwardKinematics(model.model, model.data, np.array(q))
    feet = {int(model.model.getJointId(leg.ankle)) for leg in model.legs.values()}
    whole = pin.Inertia.Zero()
    for joint in set(range(1, model.model.njoints)) - feet:
        whole += model.data.oMi[joint].act(model.model.inertias[joint])
    about = whole.lever - np.mean([model.data.oMi[joint].translation for joint in feet], axis=0)
    centre = about[[0, 2]]
    return float(whole.mass), centre, float(whole.inertia[1, 1] + whole.mass * centre @ centre)


def test_without_arms_a_stiff_body_falls_as_the_pendulum_that_it_is():
    r""":math:`I \ddot\theta = m g l \sin\theta` about the ankles, if feet neither slip nor sink."""
    problem, e, step = stiff_body(0.05)
    mass, centre, inertia = above_the_ankles(problem, e.q)
    lever, start = float(np.hypot(*centre)), float(np.arctan2(*centre))
    for tick in range(700):
        step(e, tick)
    rate = mass * GRAVITY * lever / inertia
    fall = solve_ivp(lambda _, y: [y[1], rate * math.sin(y[0])], (0.0, 0.7), [start, 0.0], rtol=1e-9)
    end = float(fall.y[0, -1])
    _, centre, _ = above_the_ankles(problem, e.q)
    assert end > 4.0 * start
    assert np.arctan2(*centre) == pytest.approx(end, rel=0.02)
    assert rate < 0.95 * GRAVITY / lever  # it is no point mass


# ------------------------------------------------------------------ how it ends


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (("scenario.fall_lean_deg=7",), "the trunk leaned by more than 7 deg at 0.001 s"),
        (
            ("scenario.crutches={slack_m: 0}", "scenario.crutch_ahead={left_m: 0.9, right_m: 0.3}"),
            "a hand lost its crutch, more than 1.43 m from the shoulder at 0.001 s",
        ),
    ],
)
def test_leaning_too_far_or_an_unreachable_crutch_is_a_fall(changes, reason):
    run = ReferenceEngine(problem_of(EULER, "duration_s=0.01", *changes)).run()
    assert (run.status, run.reason, len(run.log)) == ("fell", reason, 1)


def test_at_a_trip_the_rope_locks_where_the_trunk_is():
    """From then on the pull is that of a one-sided spring and damper from the height at the trip."""
    rope = "scenario.harness={share: 0.1, lock_stiffness_N_per_m: 2e4, lock_dissipation_s_per_m: 1}"
    trip = "control.safety.phase_timeout_s=0.06"
    engine = ReferenceEngine(problem_of(EULER, NO_CRUTCHES, "duration_s=0.2", rope, trip))
    run = engine.run()
    log = {name: run.log[name].to_numpy() for name in run.log}
    assert run.trip is not None
    above, tick = 0.25 * 1.75, run.trip.tick
    height = log["pelvis_height_m"] + above * np.cos(log["trunk_pitch_rad"])
    speed = log["trunk_pitch_velocity_rad_per_s"] * -above * np.sin(log["trunk_pitch_rad"])
    speed += log["pelvis_velocity_m_per_s"]
    below = np.maximum(height[tick] - height, 0.0) * (np.arange(len(height)) >= tick)
    pull = 0.1 * engine.setup.world.body_weight + 2e4 * below * np.maximum(1.0 - speed, 0.0)
    assert_allclose(log["support_force_N"], pull, rtol=1e-9)
    assert below.max() > 0.005


# ------------------------------------------------------------------ outcome and messages


def test_crutches_may_be_absent():
    world = problem_of(NO_CRUTCHES).world
    assert world.arms == () and len(world.start_q) == world.model.nv


def test_a_free_trunk_has_no_braces():
    with raises(TwinGaitError, "interface", "rigid"):
        load_experiment("overground", ["interface=brace"])


def test_positions_of_crutches_are_measured_from_the_start():
    """A tip measured at the shoulder until the delay has passed would be lifted at once."""
    world = problem_of("scenario.arms={delay_s: 0.3, planted_s: 0}").world
    shoulder = world.trunk.shoulder * math.sin(world.start_q[world.model.pitch_index])
    for arm in world.arms:
        assert_allclose(arm.distance_delay.samples, world.start_q[arm.index] - shoulder, rtol=1e-12)
