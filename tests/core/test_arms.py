"""Tests of arms with crutches: force against virtual work, limits, and the policy."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from twin_gait.core.arms import Arm, Grip, arm_force, crutch_acceleration, set_grip_angle
from twin_gait.core.estimation import delayed_sample, new_delay_line
from twin_gait.core.plant import Harness, MechanicalStop, harness_pull, pitching_moment
from twin_gait.parameters.crutches import ArmParameters
from twin_gait.worlds.arm_policy import (
    LEANING,
    LOWERING,
    PLANTED,
    PLANTED_BEHIND,
    REACHING_BACK,
    RISING,
    SITTING,
    SITTING_DOWN,
    SWINGING,
    Perception,
    move_arm,
    new_perception,
    new_policy,
    plant_crutch,
)

SHOULDER = 0.5  # [m] above the hips
WEIGHT = 1000.0  # [N]
ARMS = ArmParameters(
    lean=0.1,
    axial_force=0.08,
    axial_force_per_lean=0.6,
    axial_force_per_lean_rate=0.15,
    yielding=0.1,
    reach=0.35,
    chair_tilt=0.3,
    stand_reach=0.4,
    stand_slack=0.3,
    chair_axial_force=0.02,
    chair_shoulder_moment=30.0,
    risen_length=1.5 / 1.43,
    seated_length=0.8 / 1.43,
)
HABIT = replace(
    new_policy(ARMS, WEIGHT, 1.43), yielding=0.01, swing_ticks=40, planted_ticks=20, stand_ahead=0.55
)


def arm_of(delay: int = 0, **limits: float) -> Arm:
    grip = Grip(80.0, -5.0, 1.4, 0.0, 4000.0, 400.0, 60.0, 12.0)
    set_grip_angle(grip, 0.3)
    wide = {"push_limit": 1e6, "pull_limit": 1e6, "moment_limit": 1e6, **limits}
    return Arm(
        9, 0.5, grip=grip, distance_delay=new_delay_line(delay), load_delay=new_delay_line(delay), **wide
    )


def strut(state: np.ndarray) -> np.ndarray:
    """Length of the strut, and angle against the trunk, of (x, z, θ) of the hips and (x, z) of the tip."""
    x, z, pitch, tip_x, tip_z = state
    away = complex(tip_x - x - SHOULDER * math.sin(pitch), tip_z - z - SHOULDER * math.cos(pitch))
    # In polar coordinates that begin below, forwards positive; the trunk leans against them.
    return np.array([abs(away), np.angle(away * 1j) + pitch])


def jacobian(state: np.ndarray) -> np.ndarray:
    """By central differences, shape ``(2, 5)``."""
    steps = 1e-6 * np.eye(5)
    return np.array([(strut(state + step) - strut(state - step)) / 2e-6 for step in steps]).T


def forces(arm: Arm, state: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Return the generalised forces of the arm on five coordinates, as in the stage of the upper body."""
    (x, z, pitch, tip_x, tip_z), (vx, vz, turning, ux, uz) = state, rates
    sine, cosine, ahead, up = math.sin(pitch), math.cos(pitch), tip_x - x, tip_z - z
    seen = ux - vx - up * turning, uz - vz + ahead * turning
    fx, fz = arm_force(arm, sine, cosine, ahead - SHOULDER * sine, up - SHOULDER * cosine, *seen)
    return np.array([-fx, -fz, -pitching_moment(ahead, up, fx, fz), fx, fz])


states = st.tuples(
    st.floats(-0.5, 0.5), st.floats(0.7, 1.1), st.floats(-0.5, 0.9), st.floats(-0.4, 1.0), st.floats(0.0, 0.2)
).map(np.array)
speeds = st.tuples(*[st.floats(-2.0, 2.0)] * 5).map(np.array)


@given(state=states, rates=speeds)
def test_an_arm_does_the_work_of_its_push_and_its_moment(state: np.ndarray, rates: np.ndarray) -> None:
    """Virtual work: Q = P ∂ℓ/∂q + M ∂φ/∂q, with the law of P and M in ℓ, φ and their rates."""
    arm = arm_of()
    found, grip = forces(arm, state, rates), arm.grip
    (length, angle), turned = strut(state), jacobian(state)
    lengthening, turning = turned @ rates
    push = 80.0 + 4000.0 * (1.4 - length) - 400.0 * lengthening
    away = 0.3 - angle
    moment = -5.0 + length * (60.0 * 1.4 * math.sin(away) - 12.0 * length * turning)
    assert_allclose([arm.axial_force, arm.moment, arm.length], [push, moment, length], rtol=1e-7, atol=1e-5)
    assert_allclose(arm.transverse_deflection, 1.4 * math.sin(grip.angle - angle), atol=1e-9)
    assert_allclose(found, push * turned[0] + moment * turned[1], rtol=1e-7, atol=1e-4)


@given(state=states, rates=speeds)
def test_no_arm_pushes_or_turns_beyond_its_limits(state: np.ndarray, rates: np.ndarray) -> None:
    arm = arm_of(push_limit=300.0, pull_limit=50.0, moment_limit=20.0)
    free = arm_of()
    fx, fz = forces(arm, state, rates)[3:]
    forces(free, state, rates)
    assert arm.axial_force == min(max(free.axial_force, -50.0), 300.0)
    assert arm.moment == min(max(free.moment, -20.0), 20.0)
    assert_allclose(math.hypot(fx, fz), math.hypot(arm.axial_force, arm.moment / arm.length), rtol=1e-12)


@given(state=states, rates=speeds)
def test_a_straight_arm_acts_as_a_rope_for_any_muscle_force(state: np.ndarray, rates: np.ndarray) -> None:
    arm, free = arm_of(pull_limit=50.0), arm_of(pull_limit=50.0)
    arm.max_length, arm.straight_stiffness = 1.2, 5000.0
    forces(arm, state, rates)
    forces(free, state, rates)
    assert arm.axial_force == free.axial_force - 5000.0 * max(free.length - 1.2, 0.0)


def test_an_arm_that_hangs_pushes_down_and_its_moment_forwards() -> None:
    arm = arm_of()
    arm.grip.shoulder_moment, arm.grip.stiffness, arm.grip.transverse_stiffness = 7.0, 0.0, 0.0
    assert_allclose(arm_force(arm, 0.0, 1.0, 0.0, -1.4, 0.0, 0.0), (5.0, -80.0), atol=1e-12)


@given(state=states, rates=speeds)
def test_a_rigid_rotation_of_trunk_and_crutch_has_no_damping(state: np.ndarray, rates: np.ndarray) -> None:
    x, z, _, tip_x, tip_z = state
    vx, vz, turning = rates[:3]
    along = np.array([vx, vz, turning, vx + (tip_z - z) * turning, vz - (tip_x - x) * turning])
    still, turned = arm_of(), arm_of()
    assert_allclose(forces(turned, state, along), forces(still, state, np.zeros(5)), atol=1e-9)


# ------------------------------------------------------------------ the harness


@given(pitch=st.floats(-0.5, 1.0), fx=st.floats(-100.0, 100.0), fz=st.floats(-100.0, 100.0))
def test_the_pitching_moment_equals_virtual_work(pitch: float, fx: float, fz: float) -> None:
    def position(angle: float) -> np.ndarray:
        return SHOULDER * np.array([math.sin(angle), math.cos(angle)])

    way = (position(pitch + 1e-6) - position(pitch - 1e-6)) / 2e-6
    assert_allclose(pitching_moment(*position(pitch), fx, fz), way @ [fx, fz], atol=1e-6)


def test_the_harness_pulls_with_its_share_and_locks_from_below_only() -> None:
    harness = Harness(0.4, 300.0, 90.0, MechanicalStop(0.0, 0.0, 0.0, 0.0))
    assert harness_pull(harness, 1.2, -0.5) == 300.0 + 45.0
    harness.stop = MechanicalStop(1.3, math.inf, 1e4, 2.0)
    assert_allclose(harness_pull(harness, 1.2, -0.5), 345.0 + 1e4 * 0.1 * (1.0 + 2.0 * 0.5))
    assert harness_pull(harness, 1.4, -0.5) == 345.0 == harness.pull


# ------------------------------------------------------------------ the policy


def planted(delay: int = 0, ticks: int = 0) -> Arm:
    arm = arm_of(delay)
    arm.length = 1.4
    plant_crutch(HABIT, arm)
    arm.phase_ticks = ticks
    return arm


def sense_of(lean: float = 0.1, rate: float = 0.0, stepping: float = 0.0) -> Perception:
    sense = new_perception(0, lean)
    sense.lean, sense.lean_rate, sense.stepping = lean, rate, stepping
    return sense


NEAR, FAR = 0.1, 0.3


@pytest.mark.parametrize("lean", [-0.1, 0.1, 0.2, 5.0])
def test_a_planted_crutch_is_pushed_more_the_more_the_trunk_leans(lean: float) -> None:
    arm, other = planted(), planted()
    arm.push_limit = 400.0
    move_arm(HABIT, sense_of(lean, 0.2), arm, other, FAR, 80.0)
    assert_allclose(arm.grip.axial_force, min(max(80.0 + 600.0 * (lean - 0.1) + 150.0 * 0.2, 0.0), 400.0))
    assert arm.grip.shoulder_moment == -5.0


def test_loaded_muscles_yield_with_their_time_constant() -> None:
    """A strut with another target: (1 - α)^n of the distance remains."""
    arm, other = planted(), planted()
    set_grip_angle(arm.grip, 0.3)
    for _ in range(50):
        arm.length, arm.transverse_deflection = 1.3, arm.grip.length * math.sin(arm.grip.angle - 0.28)
        move_arm(HABIT, sense_of(), arm, other, FAR, 80.0)
    left = 0.99**50
    assert_allclose(arm.grip.length - 1.3, 0.1 * left, rtol=1e-12)
    assert_allclose(arm.grip.angle - 0.28, 0.02 * left, rtol=0.05)  # aside over length is no arc
    assert (arm.grip.sine, arm.grip.cosine) == pytest.approx(
        (math.sin(arm.grip.angle), math.cos(arm.grip.angle))
    )


@pytest.mark.parametrize(
    ("ticks", "others_ticks", "others", "stepping", "ahead", "lifts"),
    [
        (20, 30, PLANTED, 0.0, NEAR, True),
        (19, 30, PLANTED, 0.0, NEAR, False),
        (20, 20, PLANTED, 0.0, NEAR, False),
        (20, 30, SWINGING, 0.0, NEAR, False),
        (20, 30, LOWERING, 0.0, NEAR, False),
        (20, 30, PLANTED, 1.0, NEAR, False),
        (20, 30, PLANTED, 0.0, FAR, False),
    ],
)
def test_a_crutch_is_lifted_when_it_is_near_and_nothing_else_is_in_the_air(
    ticks: int, others_ticks: int, others: int, stepping: float, ahead: float, lifts: bool
) -> None:
    arm, other = planted(ticks=ticks), planted(ticks=others_ticks)
    other.phase = others
    move_arm(HABIT, sense_of(stepping=stepping), arm, other, ahead, 80.0)
    assert arm.phase == (SWINGING if lifts else PLANTED)
    assert other.phase == others
    if lifts:
        assert_allclose(arm.grip.length, 1.4 - 0.06)
        assert arm.grip.axial_force == arm.grip.shoulder_moment == 0.0


def test_a_swing_follows_minimum_jerk_to_the_reach_for_any_trunk_motion() -> None:
    arm, other = planted(ticks=20), planted(ticks=30)
    move_arm(HABIT, sense_of(0.1), arm, other, NEAR, 80.0)
    start = arm.grip.angle - 0.1
    for tick in range(1, 41):
        lean = 0.1 + 0.01 * tick
        move_arm(HABIT, sense_of(lean), arm, other, NEAR, 0.0)
        s = tick / 40.0
        share = 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5
        assert_allclose(arm.grip.angle - lean, start + share * (0.35 - start), atol=1e-12)
        assert arm.phase == (SWINGING if tick < 40 else LOWERING)


def test_a_crutch_is_lowered_at_its_speed_and_planted_as_it_is_when_it_carries() -> None:
    arm, other = planted(), planted(ticks=99)
    arm.phase, arm.grip.length = LOWERING, 1.3
    for tick in range(1, 30):
        move_arm(HABIT, sense_of(), arm, other, FAR, 14.9)
        assert_allclose(arm.grip.length, 1.3 + 0.00025 * tick)
    arm.length, arm.transverse_deflection = 1.31, arm.grip.length * math.sin(0.01)
    angle = arm.grip.angle - 0.01
    move_arm(HABIT, sense_of(), arm, other, FAR, 15.1)
    assert (arm.phase, arm.phase_ticks, arm.grip.length) == (PLANTED, 0, 1.31)
    assert_allclose(arm.grip.angle, angle, atol=1e-4)
    assert (arm.grip.stiffness, arm.grip.transverse_damping) == (4000.0, 12.0)


@pytest.mark.parametrize("reach", [0.4, -0.3])
def test_a_crutch_that_does_not_reach_the_ground_is_drawn_nearer(reach: float) -> None:
    """The tip moves towards the vertical with the lowering speed, from the front or from behind."""
    arm, other = planted(), planted()
    arm.phase, arm.grip.length, arm.reach = LOWERING, 1.4299, reach
    before = arm.grip.angle
    for _ in range(6):
        move_arm(HABIT, sense_of(), arm, other, FAR, 0.0)
    assert arm.grip.length == 1.43
    assert_allclose(arm.grip.angle, before - math.copysign(5 * 0.00025 / 1.43, reach), rtol=1e-12)


@pytest.mark.parametrize(
    ("ahead", "still", "brought"), [(0.2, 1001, True), (0.3, 1001, False), (0.2, 1000, False)]
)
def test_a_standing_wearer_has_the_crutches_at_the_preferred_position(
    ahead: float, still: int, brought: bool
) -> None:
    """0.3 m about a place 0.55 m in front of the shoulder, after a second without a step."""
    arm, other, sense = planted(ticks=2000), planted(ticks=2000), sense_of()
    sense.ticks_since_swing = still
    move_arm(HABIT, sense, arm, other, ahead, 80.0)
    assert arm.phase == (SWINGING if brought else PLANTED)
    assert not brought or arm.reach == ARMS.stand_reach


def test_one_of_two_front_crutches_is_moved_behind_to_sit_down() -> None:
    arm, other, sense = planted(ticks=30), planted(ticks=30), on_chair(REACHING_BACK)
    other.phase = PLANTED_BEHIND
    move_arm(HABIT, sense, arm, other, 0.3, 80.0)
    assert arm.phase == PLANTED


def test_never_are_both_crutches_in_the_air(rng: np.random.Generator) -> None:
    """This holds for any perception; each crutch is lifted many times."""
    arms, lifted = [planted(ticks=20), planted(ticks=30)], [0, 0]
    policy = replace(HABIT, swing_ticks=5, planted_ticks=3)
    for _ in range(3000):
        sense = sense_of(*rng.uniform(-0.2, 0.4, 2), stepping=float(rng.random() < 0.2))
        for number, arm in enumerate(arms):
            before = arm.phase
            move_arm(policy, sense, arm, arms[1 - number], rng.uniform(0.0, 0.4), rng.uniform(0.0, 30.0))
            lifted[number] += before == PLANTED != arm.phase
        assert PLANTED in (arms[0].phase, arms[1].phase)
    assert min(lifted) > 50


def on_chair(chair_state: float) -> Perception:
    sense = sense_of()
    sense.chair_state = chair_state
    return sense


@pytest.mark.parametrize(("chair_state", "end"), [(RISING, 1.5), (SITTING_DOWN, 0.8)])
def test_arms_go_with_the_legs_by_minimum_jerk_and_only_push(chair_state: float, end: float) -> None:
    """10 s³ - 15 s⁴ + 6 s⁵ of the distance from the initial length; no force if it is already exceeded."""
    arm, other, sense = planted(), planted(), on_chair(chair_state)
    arm.length = 0.7 if chair_state == RISING else 1.4
    start = arm.length
    for tick in range(2500):
        move_arm(HABIT, sense, arm, other, -0.2, 80.0)
        share = min(tick / 2000.0, 1.0)
        wanted = start + (end - start) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        assert_allclose(arm.grip.length, max(wanted, arm.length), rtol=1e-12)
        arm.length = wanted - 0.01 if tick < 1200 else wanted + 0.02
    assert (arm.grip.axial_force, arm.grip.shoulder_moment, arm.phase) == (20.0, -30.0, PLANTED_BEHIND)


def test_hands_of_a_sitting_wearer_are_idle() -> None:
    arm = planted()
    move_arm(HABIT, on_chair(SITTING), arm, planted(), -0.2, 80.0)
    assert arm.grip.axial_force == arm.grip.shoulder_moment == arm.grip.stiffness == 0.0


@pytest.mark.parametrize(("load", "lifts"), [(14.9, True), (15.0, False)])
def test_after_rising_an_unloaded_crutch_is_moved_forwards(load: float, lifts: bool) -> None:
    arm, other = planted(), planted(ticks=30)
    move_arm(HABIT, on_chair(RISING), arm, other, -0.2, 80.0)
    for _ in range(21):
        move_arm(HABIT, on_chair(0.0), arm, other, -0.2, 80.0)
        assert arm.phase == PLANTED_BEHIND
    move_arm(HABIT, on_chair(0.0), arm, other, -0.2, load)
    assert arm.phase == (SWINGING if lifts else PLANTED_BEHIND)
    assert not lifts or arm.reach == ARMS.stand_reach


@pytest.mark.parametrize("rate", [-0.3, 0.0, 0.4])
def test_rear_crutches_extend_until_a_hand_is_unloaded_and_stop_a_backward_fall(rate: float) -> None:
    """Longer by 0.05 m/s; 150 N s/rad against a trunk that tips backwards, nothing against one that leans."""
    arm, other, sense = planted(), planted(ticks=30), on_chair(0.0)
    arm.phase, arm.grip.length, sense.lean_rate = PLANTED_BEHIND, 1.45, rate
    for _ in range(50):
        move_arm(HABIT, sense, arm, other, -0.2, 15.0)
    assert_allclose(arm.grip.axial_force, max(-150.0 * rate, 0.0), rtol=1e-12)
    assert_allclose(arm.grip.length, 1.45 + 50 * 0.00005, rtol=1e-12)
    other.phase, other.phase_ticks = SWINGING, 0
    move_arm(HABIT, sense, arm, other, -0.2, 14.0)
    assert_allclose(arm.grip.length, 1.45 + 50 * 0.00005, rtol=1e-12)
    arm.length = 1.5
    move_arm(HABIT, sense, arm, other, -0.2, 14.0)
    assert arm.grip.length == 1.5  # who is beyond it already does not lift the tip


def test_a_crutch_in_front_has_no_push_of_its_own_while_the_other_is_behind() -> None:
    """Only K (lean - 0.1) + D rate: a larger moment would push the trunk back onto the rear crutch."""
    arm, other, sense = planted(), planted(), sense_of(0.15, 0.1)
    other.phase = PLANTED_BEHIND
    move_arm(HABIT, sense, arm, other, 0.3, 80.0)
    assert_allclose(arm.grip.axial_force, 600.0 * 0.05 + 150.0 * 0.1, rtol=1e-12)


@pytest.mark.parametrize("chair_state", [LEANING, REACHING_BACK])
@pytest.mark.parametrize("ahead", [-0.01, 0.01])
def test_crutches_in_front_are_swung_behind_for_a_chair(chair_state: float, ahead: float) -> None:
    arm, other = planted(ticks=30), planted(ticks=30)
    move_arm(HABIT, on_chair(chair_state), arm, other, ahead, 80.0)
    assert arm.phase == (SWINGING if ahead > 0.0 else PLANTED_BEHIND)
    if ahead > 0.0:
        assert arm.reach == -0.3
        move_arm(HABIT, on_chair(chair_state), other, arm, ahead, 80.0)
        assert other.phase == (PLANTED if chair_state == REACHING_BACK else PLANTED_BEHIND)  # one at a time


def test_both_crutches_are_never_in_the_air_during_chair_motions(rng: np.random.Generator) -> None:
    arms, lifted = [planted(ticks=20), planted(ticks=30)], [0, 0]
    policy = replace(HABIT, swing_ticks=5, planted_ticks=3)
    for tick in range(6000):
        if tick % 40 == 0:
            sense = on_chair(float(rng.integers(0, 6)))
        for number, arm in enumerate(arms):
            standing = arm.phase in (PLANTED, PLANTED_BEHIND)
            move_arm(policy, sense, arm, arms[1 - number], rng.uniform(-0.4, 0.4), rng.uniform(0.0, 30.0))
            lifted[number] += standing and arm.phase == SWINGING
        assert not all(arm.phase in (SWINGING, LOWERING) for arm in arms)
    assert min(lifted) > 50


@pytest.mark.parametrize("delay", [0, 1, 25])
def test_nothing_is_felt_before_the_delay_has_passed(delay: int) -> None:
    """A step of all perceived quantities changes the action of the person after the delay, not before."""

    def course(step: float) -> list[tuple[float, ...]]:
        arm, other, sense = planted(delay, 99), planted(delay, 99), new_perception(delay, 0.1)
        arm.distance_delay = new_delay_line(delay, FAR)
        found = []
        for tick in range(60):
            changed = step if tick >= 10 else 0.0
            sense.lean = delayed_sample(sense.lean_delay, tick, 0.1 + changed)
            sense.lean_rate = delayed_sample(sense.lean_rate_delay, tick, changed)
            ahead = delayed_sample(arm.distance_delay, tick, FAR - 3.0 * changed)
            load = delayed_sample(arm.load_delay, tick, 80.0)
            move_arm(HABIT, sense, arm, other, ahead, load)
            found.append((arm.phase, arm.phase_ticks, *astuple(arm.grip)))
        return found

    quiet, stepped = course(0.0), course(0.1)
    first = next(tick for tick in range(60) if quiet[tick] != stepped[tick])
    assert first == 10 + delay
    assert {doing for doing, *_ in quiet} == {PLANTED} != {doing for doing, *_ in stepped}


def test_an_initial_lean_is_in_the_delay_lines_from_the_start() -> None:
    sense = new_perception(20, 0.14)
    assert [delayed_sample(sense.lean_delay, tick, 9.0) for tick in range(22)] == [0.14] * 20 + [9.0] * 2
    assert [delayed_sample(sense.lean_rate_delay, tick, 9.0) for tick in range(22)] == [0.0] * 20 + [9.0] * 2


# ------------------------------------------------------------------ tension and inertia


@given(state=states, rates=speeds)
def test_a_hand_yields_to_the_tension_that_a_straight_arm_adds(state: np.ndarray, rates: np.ndarray) -> None:
    arm, free = arm_of(pull_limit=50.0), arm_of(pull_limit=50.0)
    for item in (arm, free):
        item.max_length, item.straight_stiffness = 1.2, 5000.0
    arm.tension_limit = 100.0
    forces(arm, state, rates)
    forces(free, state, rates)
    assert arm.axial_force == max(free.axial_force, -100.0)


def rod(mass: float = 0.5, centre: float = 0.55, inertia: float = 0.05) -> Arm:
    arm = arm_of()
    arm.mass, arm.centre_of_mass, arm.inertia = mass, centre, inertia
    return arm


def kinetic_energy(arm: Arm, place: np.ndarray, speed: np.ndarray) -> float:
    """Energy of a rod, from its own definition, for shoulder (x, z) and tip (x, z)."""
    away = complex(*(place[2:] - place[:2]))
    change = complex(*(speed[2:] - speed[:2])) / away
    centre = complex(*speed[2:]) - 1j * arm.centre_of_mass * away / abs(away) * change.imag
    return 0.5 * arm.mass * abs(centre) ** 2 + 0.5 * arm.inertia * change.imag**2


places = st.tuples(*[st.floats(-0.5, 0.5)] * 3, st.floats(-1.6, -1.0)).map(np.array)
fourfold = st.tuples(*[st.floats(-2.0, 2.0)] * 4).map(np.array)


@given(place=places, speed=fourfold, pushed=fourfold, shoulder=st.tuples(*[st.floats(-20.0, 20.0)] * 2))
def test_a_crutch_moves_by_the_equations_of_lagrange(
    place: np.ndarray, speed: np.ndarray, pushed: np.ndarray, shoulder: tuple[float, float]
) -> None:
    """The derivatives of the energies are numerical, and the velocity of the strut is that of the points."""
    arm, gravity, basis = rod(), 9.81, np.eye(4)
    away, along = place[2:] - place[:2], speed[2:] - speed[:2]
    arm.length = math.hypot(*away)
    arm.direction_x, arm.direction_z = away / arm.length
    arm.along_speed = float(away @ along) / arm.length
    turning = float(away[0] * along[1] - away[1] * along[0]) / arm.length**2
    x, z, reaction = crutch_acceleration(arm, turning, pushed[0], pushed[1], gravity, *shoulder)

    def momentum(at: np.ndarray) -> np.ndarray:
        """Gradient of a quadratic form of the velocities, which a central difference gives exactly."""
        energies = [
            kinetic_energy(arm, at, speed + one) - kinetic_energy(arm, at, speed - one) for one in basis
        ]
        return 0.5 * np.array(energies)

    def mass_times(acceleration: np.ndarray) -> np.ndarray:
        energies = [
            kinetic_energy(arm, place, acceleration + one) - kinetic_energy(arm, place, acceleration - one)
            for one in basis
        ]
        return 0.5 * np.array(energies)

    def potential(at: np.ndarray) -> float:
        span = at[2:] - at[:2]
        return arm.mass * gravity * float(at[3] - arm.centre_of_mass * span[1] / math.hypot(*span))

    small = 1e-6
    drift = (momentum(place + small * speed) - momentum(place - small * speed)) / (2.0 * small)
    gradient = [
        kinetic_energy(arm, place + small * one, speed)
        - kinetic_energy(arm, place - small * one, speed)
        - potential(place + small * one)
        + potential(place - small * one)
        for one in basis
    ]
    total = mass_times(np.array([*shoulder, x, z])) + drift - np.array(gradient) / (2.0 * small)
    across = np.array([-arm.direction_z, arm.direction_x])
    assert_allclose(total[2:], pushed[:2], atol=1e-6)
    assert_allclose(-total[:2], reaction * across, atol=1e-6)


def test_a_hanging_crutch_swings_with_the_period_of_a_physical_pendulum() -> None:
    """T = 2π √((m d² + J) / (m g d)) about a shoulder at rest, d from its centre of mass."""
    arm, length, step = rod(), 1.43, 1e-4
    x, z, vx, vz, crossings = length * math.sin(0.02), -length * math.cos(0.02), 0.0, 0.0, list[float]()
    for tick in range(60_000):
        arm.length = math.hypot(x, z)
        arm.direction_x, arm.direction_z = x / arm.length, z / arm.length
        arm.along_speed = (x * vx + z * vz) / arm.length
        held = 2e4 * (length - arm.length) - 60.0 * arm.along_speed
        turning = (x * vz - z * vx) / arm.length**2
        pushed = (held * arm.direction_x, held * arm.direction_z)
        ax, az, _ = crutch_acceleration(arm, turning, *pushed, 9.81, 0.0, 0.0)
        vx, vz, before = vx + step * ax, vz + step * az, x
        x, z = x + step * vx, z + step * vz
        if before > 0.0 >= x:
            crossings.append((tick + before / (before - x)) * step)
    distance = length - arm.centre_of_mass
    swung = arm.mass * distance**2 + arm.inertia
    assert_allclose(
        np.diff(crossings), 2.0 * math.pi * math.sqrt(swung / (arm.mass * 9.81 * distance)), rtol=1e-3
    )
    assert len(crossings) == 3


def test_a_point_mass_at_the_tip_has_no_reaction() -> None:
    arm = rod(centre=0.0, inertia=0.0)
    forces(arm, np.array([0.0, 0.9, 0.1, 0.3, 0.05]), np.ones(5))
    found = crutch_acceleration(arm, 1.0, 3.0, 4.0, 9.81, 5.0, -6.0)
    assert found == (3.0 / 0.5, 4.0 / 0.5 - 9.81, 0.0)
