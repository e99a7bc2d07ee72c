"""The benchmark: all implementations step the same motion, and ratios are judged; no test times anything."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from peers.engines import ENGINES, BatchSession
from peers.measuring import ERROR, GOALS, WALK_LIMIT, Extent, goal_rows, measure
from peers.scenarios import cases
from peers.timing import Implementation, Timing, significant, speed_ratio, time_in_turn

# Rounding of 1e-16 rad in other orders of additions; a switch one tick late would move an angle by 1e-4.
SAME_MOTION = 1e-10  # [rad]
TICKS = 900
CASES = {(case.scenario, case.step): case for case in cases()}
OURS = {item.name: item for item in ENGINES}


def implementation(name: str) -> Implementation:
    if name in OURS:
        return OURS[name]
    pytest.importorskip("mujoco")
    from peers.mujoco_peers import MUJOCO_PEERS

    return next(item for item in MUJOCO_PEERS if item.name == name)


def angles_of(name: str, case, ticks: int) -> np.ndarray:
    session = implementation(name).open(case, ticks)
    session.run()
    angles = session.angles()
    assert angles is not None and angles.shape[0] == ticks
    return angles


# ---------------------------------------------------------------------- the same motion


@pytest.fixture(scope="module")
def compiled_angles() -> dict[str, np.ndarray]:
    return {
        step: angles_of("compiled, log", CASES["bench_leg", step], TICKS)
        for step in ("Euler 1 ms", "RK4 1 ms")
    }


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("Pinocchio", "Euler 1 ms"),
        ("plain Python", "Euler 1 ms"),
        ("plain Python", "RK4 1 ms"),
        ("MuJoCo, Python loop", "Euler 1 ms"),
        ("MuJoCo, Python loop", "RK4 1 ms"),
        # Runge-Kutta is the harder one, because it calls back at every stage.
        pytest.param("MuJoCo, native loop", "RK4 1 ms", marks=[pytest.mark.slow, pytest.mark.compile]),
    ],
)
def test_all_move_the_bench_leg_like_the_compiled_engine(compiled_angles, name, step):
    found = angles_of(name, CASES["bench_leg", step], TICKS)
    # It is a step, not a rest: the hip has moved by more than ten degrees.
    assert np.ptp(found, axis=0).max() > 0.17
    np.testing.assert_allclose(found, compiled_angles[step], atol=SAME_MOTION, rtol=0.0)


@pytest.mark.parametrize(
    ("scenario", "step", "ticks"),
    [("contact_free_biped", "Euler 1 ms", 500), ("treadmill", "Euler 0.25 ms", 150)],
)
def test_plain_python_moves_both_legs_like_the_pinocchio_engine(scenario, step, ticks):
    case = CASES[scenario, step]
    found, expected = (angles_of(name, case, ticks) for name in ("plain Python", "Pinocchio"))
    np.testing.assert_allclose(found, expected, atol=SAME_MOTION, rtol=0.0)


def test_mujoco_moves_the_contact_free_biped_like_plain_python():
    case = CASES["contact_free_biped", "Euler 1 ms"]
    found, expected = (angles_of(name, case, 300) for name in ("MuJoCo, Python loop", "plain Python"))
    np.testing.assert_allclose(found, expected, atol=SAME_MOTION)


@pytest.mark.slow
@pytest.mark.compile
def test_the_native_callback_on_the_treadmill_does_what_the_one_in_python_does():
    case, traces = CASES["treadmill", "Euler 0.25 ms"], []
    for name in ("MuJoCo, native loop", "MuJoCo, Python loop"):
        session = implementation(name).open(case, 300)
        for _ in range(2):  # from the start again, not on from where the first run ended
            session.reset()
            session.run()
        traces.append(session.callback.trace)
    assert np.ptp(traces[0], axis=0).max() > 0.17
    np.testing.assert_allclose(*traces, atol=SAME_MOTION, rtol=0.0)


def test_the_contact_free_biped_has_no_ground():
    world = CASES["contact_free_biped", "RK4 1 ms"].experiment.build_world()
    assert world.contact is None and not world.contact_frames
    assert len(world.model.legs) == 2
    # The support carries all of it, so that nothing falls.
    assert world.support_force == pytest.approx(world.body_weight, rel=1e-12)


# ---------------------------------------------------------------------- MuJoCo


def test_mujoco_stands_on_its_own_contacts_with_the_same_mass():
    session = implementation("MuJoCo, bare").open(CASES["treadmill", "Euler 0.25 ms"], 1000)
    world = session.problem.world
    assert session.model.body_mass.sum() == pytest.approx(world.model.total_mass, rel=1e-9)
    session.run()
    assert 2 <= session.data.ncon <= 4
    pelvis = session.order[world.model.pelvis_index]
    # Springs and ground hold the wearer: the pelvis has sunk by centimetres, not to the floor.
    assert abs(session.data.qpos[pelvis] - world.start_q[world.model.pelvis_index]) < 0.05


def test_the_belt_of_mujoco_keeps_its_speed_under_the_feet():
    case = CASES["treadmill", "Euler 0.25 ms"]
    session = implementation("MuJoCo, Python loop").open(case, 100)
    session.run()
    assert session.data.ncon >= 1
    speed = session.data.joint("belt").qvel[0]
    assert speed == pytest.approx(-case.experiment.scenario.belt_speed, rel=1e-4)
    assert session.angles() is None  # other contacts, another motion: not to be compared


def test_a_rollout_ends_where_the_bare_step_ends():
    case = CASES["bench_leg", "RK4 1 ms"]
    bare, rollout = (implementation(name).open(case, 50) for name in ("MuJoCo, bare", "MuJoCo rollout"))
    bare.run()
    rollout.run()
    last = rollout.states[:, -1]
    # A state is time, positions, velocities.
    expected = np.concatenate([[bare.data.time], bare.data.qpos, bare.data.qvel])
    np.testing.assert_array_equal(last[:, : len(expected)], np.tile(expected, (len(last), 1)))


def test_every_episode_of_a_batch_ends_where_a_single_run_ends():
    case = CASES["bench_leg", "RK4 1 ms"]
    alone = angles_of("compiled, log", case, 200)[-1]
    session = BatchSession(case, 199, episodes=3, threads=2)
    for _ in range(2):  # from the start again, not on from where the first run ended
        session.reset()
        session.run()
        for engine in session.engines:
            np.testing.assert_array_equal(engine.episode["q"], alone)


# ---------------------------------------------------------------------- timing


class Noted:
    """A session that writes down what is done with it."""

    def __init__(self, name: str, notes: list[str]) -> None:
        self.name, self.notes = name, notes

    def reset(self) -> None:
        self.notes.append(f"reset {self.name}")

    def run(self) -> None:
        self.notes.append(f"run {self.name}")

    def angles(self) -> None:
        return None


def test_sessions_run_in_turn_and_the_first_round_counts_for_nothing():
    notes: list[str] = []
    times = time_in_turn({name: (Noted(name, notes), 10) for name in "ab"}, 3)
    assert notes == ["reset a", "run a", "reset b", "run b"] * 4
    assert {name: len(timing.rounds) for name, timing in times.items()} == {"a": 3, "b": 3}


def test_a_ratio_pairs_the_rounds():
    # A disturbance that doubles both times of one round leaves the ratio alone.
    slow, fast = Timing((30.0, 60.0, 33.0), (1.0,) * 3), Timing((10.0, 20.0, 10.0), (1.0,) * 3)
    assert speed_ratio(slow, fast) == 3.0
    assert slow.median == 33.0
    assert slow.quartiles == (31.5, 46.5)


def test_a_ratio_is_not_flattered_by_a_busy_machine():
    # The slow one had a quarter of a processor: by the clock 12, by processor time 3.
    waiting, undisturbed = Timing((120.0,) * 3, (0.25,) * 3), Timing((10.0,) * 3, (1.0,) * 3)
    assert speed_ratio(waiting, undisturbed) == 3.0
    # Two threads that hold each other up use less processor and gain no time.
    peer, held_up = Timing((40.0,) * 3, (2.0,) * 3), Timing((10.0,) * 3, (1.0,) * 3)
    assert speed_ratio(peer, held_up) == 4.0


def test_numbers_of_tables_are_rounded():
    assert [significant(value) for value in (1234.56, 99.96, 0.012345, 0.0)] == [1235, 100.0, 0.0123, 0.0]


@pytest.mark.parametrize("extent", [Extent(), Extent.quick()])
@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: f"{case.scenario}-{case.step}")
def test_native_code_runs_as_long_as_its_angles_are_compared(case, extent):
    alone = extent.ticks(case, OURS["compiled"])
    assert alone == extent.ticks(case, OURS["batch"]) >= case.compared_ticks
    assert 1 <= extent.ticks(case, OURS["plain Python"]) <= alone


# ---------------------------------------------------------------------- ratios


def made_up(
    ratio: float, peers: tuple[str, ...] = ("MuJoCo, bare", "plain Python", "MuJoCo rollout")
) -> list:
    """Cases in which every peer takes so many times as long."""
    ratios = dict.fromkeys(peers, ratio)
    return [{"scenario": scenario, "step": step, "ratios": ratios} for scenario, step in CASES]


def walk_of(seconds: float) -> dict:
    return {"step": "RK4 0.1 ms", "duration_s": 20.0, "simulate_s": seconds}


def met(rows: list[dict]) -> list[bool]:
    return [row["met"] == "yes" for row in rows]


def test_goals_cover_every_scenario():
    assert {goal[2] for goal in GOALS} == {scenario for scenario, _ in CASES}
    assert len(goal_rows(made_up(1.0), walk_of(1.0))) == 19


def test_ratios_above_all_goals_are_met_and_a_slow_walk_is_not():
    enough = max(goal[-1] for goal in GOALS)
    assert all(met(goal_rows(made_up(enough), walk_of(0.99 * WALK_LIMIT))))
    assert met(goal_rows(made_up(enough), walk_of(WALK_LIMIT)))[-2:] == [True, False]


def test_each_ratio_is_judged_by_its_own_goal():
    rows = goal_rows(made_up(14.0), walk_of(0.1))
    bench = {(row["step"], row["what"]): row["met"] for row in rows if row["scenario"] == "bench_leg"}
    assert bench["Euler 1 ms", "MuJoCo, bare / compiled"] == "yes"
    assert bench["RK4 1 ms", "MuJoCo, bare / compiled"] == "**no**"
    assert bench["Euler 1 ms", "plain Python / compiled"] == "**no**"


def test_a_peer_that_was_not_timed_is_a_goal_missed():
    rows = goal_rows(made_up(1e3, ("plain Python",)), walk_of(0.1))
    assert {row["measured"] for row in rows if "MuJoCo" in row["what"]} == {"not timed"}
    assert [row["met"] for row in rows] == ["**no**" if "MuJoCo" in row["what"] else "yes" for row in rows]


# ---------------------------------------------------------------------- a case


@pytest.mark.slow
def test_a_case_tells_speed_and_accuracy():
    chosen = [OURS[name] for name in ("compiled", "compiled, log", "batch", "plain Python")]
    extent = Extent(rounds=1, evaluations=200, python_evaluations=40)
    errors = {}
    for step in ("Euler 1 ms", "RK4 1 ms"):
        document = measure(replace(CASES["bench_leg", step], compared_ticks=200), chosen, extent)
        assert json.loads(json.dumps(document, allow_nan=False)) == document
        rows = {row["implementation"]: row for row in document["rows"]}
        assert rows["batch"][ERROR] is None
        assert document["ratios"]["compiled"] == document["ratios"]["batch"] == 1.0
        errors[step] = rows["compiled, log"][ERROR]
        assert rows["plain Python"][ERROR] == errors[step]
    # Fourth order beats first order by far at the same step.
    assert errors["RK4 1 ms"] < 1e-4 * errors["Euler 1 ms"]
