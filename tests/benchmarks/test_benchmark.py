"""Tests of the benchmark: equal motion of all implementations, rating of ratios; nothing is timed."""

from __future__ import annotations

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from peers.engines import ALL_CORES, ENGINES, BatchSession
from peers.measuring import ERROR, GOALS, Extent, batch_rows, goal_rows, measure
from peers.scenarios import cases
from peers.timing import (
    Implementation,
    Timing,
    instruction_set,
    significant,
    speed_ratio,
    time_in_turn,
    without_avx512,
)

from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE

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


@pytest.mark.parametrize("name", ["MuJoCo rollout", "MuJoCo batch"])
@pytest.mark.parametrize(
    ("scenario", "step"), [("bench_leg", "RK4 1 ms"), ("treadmill", "Euler 0.25 ms")], ids=lambda value: value
)
def test_many_episodes_of_mujoco_end_where_the_bare_step_ends(name, scenario, step):
    """A rollout clears applied forces: the forces of the support must be set again."""
    case = CASES[scenario, step]
    bare, many = (implementation(name).open(case, 50) for name in ("MuJoCo, bare", name))
    bare.run()
    for _ in range(2):
        many.reset()
        many.run()
        np.testing.assert_array_equal(many.last_position(), bare.data.qpos)


@pytest.mark.slow
def test_an_option_that_changes_the_motion_is_marked(monkeypatch):
    pytest.importorskip("mujoco")
    from peers import options

    names = "contacts without friction", "no refsafe, autoreset, filterparent, nativeccd, multiccd"
    monkeypatch.setattr(options, "OPTIONS", {name: options.OPTIONS[name] for name in names})
    found = options.option_rows([CASES["treadmill", "Euler 0.25 ms"]], 400, 1)
    rows = {row.pop("option"): row for row in found}
    [frictionless], [checks] = (rows[name].values() for name in names)
    assert frictionless.endswith(" rad)") and "rad" not in checks
    assert {len(row) for row in rows.values()} == {1}


# ---------------------------------------------------------------------- the batch


@pytest.mark.slow
@pytest.mark.compile
def test_episodes_of_a_batch_differ_and_end_where_each_ends_alone():
    session = BatchSession(CASES["bench_leg", "Euler 1 ms"], 900, episodes=WIDTH + MIN_BLOCK_SIZE, threads=2)
    ends = []
    for _ in range(2):  # from the start again, not on from where the first run ended
        session.reset()
        session.run()
        ends.append([engine.episode["q"].tolist() for engine in session.engines])
    alone = [CompiledEngine(engine.setup) for engine in session.engines]
    for engine in alone:
        engine.episode["recording"]["on"] = False
        engine.run()
    assert ends == [[engine.episode["q"].tolist() for engine in alone]] * 2
    assert len({tuple(switch.tick for switch in engine.phase_switches()) for engine in alone}) > WIDTH


@pytest.mark.slow
@pytest.mark.compile
def test_an_episode_that_trips_is_not_a_measurement():
    case = CASES["bench_leg", "Euler 1 ms"]
    control = case.experiment.control
    strict = replace(control, safety=replace(control.safety, speed_share=0.01))
    session = BatchSession(
        replace(case, experiment=replace(case.experiment, control=strict)), 500, episodes=1
    )
    session.reset()
    with raises(AssertionError, "fell", "tripped"):
        session.run()


# ---------------------------------------------------------------------- timing


class RecordedSession:
    """Session that records its calls."""

    def __init__(self, name: str, notes: list[str]) -> None:
        self.name, self.notes = name, notes

    def reset(self) -> None:
        self.notes.append(f"reset {self.name}")

    def run(self) -> None:
        self.notes.append(f"run {self.name}")

    def angles(self) -> None:
        return None


@pytest.mark.slow
def test_sessions_run_in_turn_and_the_first_round_counts_for_nothing():
    notes: list[str] = []
    times = time_in_turn({name: (RecordedSession(name, notes), 10) for name in "ab"}, 3)
    assert notes == ["reset a", "run a", "reset b", "run b"] * 4
    assert {name: len(timing.clock) for name, timing in times.items()} == {"a": 3, "b": 3}


def test_a_ratio_is_of_minima():
    slow, fast = Timing((60.0, 30.0, 33.0), (30.0,) * 3), Timing((10.0, 20.0, 11.0), (10.0,) * 3)
    assert speed_ratio(slow, fast) == 3.0
    assert (slow.least, slow.median) == (30.0, 33.0)


def test_a_ratio_is_not_flattered_by_a_busy_machine():
    # The slow one had a quarter of a processor: by the clock 12, by processor time 3.
    waiting, undisturbed = Timing((120.0,) * 3, (30.0,) * 3), Timing((10.0,) * 3, (10.0,) * 3)
    assert speed_ratio(waiting, undisturbed) == 3.0
    # Two threads that hold each other up use less processor and gain no time.
    peer, held_up = Timing((40.0,) * 3, (80.0,) * 3), Timing((10.0,) * 3, (10.0,) * 3)
    assert speed_ratio(peer, held_up) == 4.0


def test_avx512_can_be_switched_off(monkeypatch):
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "+avx2,+avx512f,+avx512vl,+fma")
    assert instruction_set() == "AVX-512"
    monkeypatch.setenv("NUMBA_CPU_FEATURES", without_avx512()["NUMBA_CPU_FEATURES"])
    assert os.environ["NUMBA_CPU_FEATURES"] == "+avx2,-avx512f,-avx512vl,+fma"
    assert instruction_set() == "AVX2"
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "+neon")
    assert instruction_set() == "no AVX2"


def test_numbers_of_tables_are_rounded():
    assert [significant(value) for value in (1234.56, 99.96, 0.012345, 0.0)] == [1235, 100.0, 0.0123, 0.0]


@pytest.mark.parametrize("extent", [Extent(), Extent.quick()])
@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: f"{case.scenario}-{case.step}")
def test_native_code_runs_as_long_as_its_angles_are_compared(case, extent):
    alone = extent.ticks(case, OURS["compiled"])
    assert case.compared_ticks <= alone
    for name in ("batch", "plain Python"):
        assert 1 <= extent.ticks(case, OURS[name]) <= alone


# ---------------------------------------------------------------------- ratios


PEERS = ("MuJoCo, bare", "plain Python", "MuJoCo rollout")


def made_up(ratio: float, peers: tuple[str, ...] = PEERS) -> list:
    """Return cases in which every peer takes a multiple of the time."""
    ratios = dict.fromkeys(peers, ratio)
    return [{"scenario": scenario, "step": step, "ratios": ratios} for scenario, step in CASES]


def met(rows: list[dict]) -> list[bool]:
    return [row["met"] == "yes" for row in rows]


@pytest.mark.parametrize("vectors", ["AVX-512", "AVX2", "no AVX2"])
def test_goals_cover_every_case(vectors):
    rows = goal_rows(made_up(1.0), vectors)
    assert len(rows) == 18 and not any(met(rows))
    assert all(met(goal_rows(made_up(150.0), vectors)))


def test_each_ratio_is_judged_by_its_own_goal():
    rows = goal_rows(made_up(14.0), "AVX-512")
    found = {(row["scenario"], row["step"]): row["met"] for row in rows if "bare" in row["what"]}
    assert list(found.values()) == ["yes", "yes", "yes", "yes", "**no**", "**no**"]
    assert list(found) == list(CASES)
    # A part of the cases is judged by its own goals too.
    assert goal_rows(made_up(14.0)[4:], "AVX-512")[:2] == rows[4:6]


def test_a_peer_that_was_not_timed_is_a_goal_missed():
    rows = goal_rows(made_up(1e3, ("plain Python",)), "AVX-512")
    assert {row["measured"] for row in rows if "MuJoCo" in row["what"]} == {"not timed"}
    assert [row["met"] for row in rows] == ["**no**" if "MuJoCo" in row["what"] else "yes" for row in rows]


def test_compared_implementations_exist():
    """Goals and ratios name existing implementations; both sides of a ratio use the same number of cores."""
    pytest.importorskip("mujoco")
    from peers.mujoco_peers import MUJOCO_PEERS

    items = {item.name: item for item in (*ENGINES, *MUJOCO_PEERS)}
    assert {name for pair in GOALS for name in pair} <= set(items)
    for item in items.values():
        assert items[item.beside].episodes == item.episodes
        assert (item.beside == ALL_CORES) == item.name.endswith("all cores")


# ---------------------------------------------------------------------- a case


@pytest.mark.slow
@pytest.mark.compile
def test_a_case_states_speed_and_accuracy():
    chosen = [OURS[name] for name in ("compiled", "compiled, log", "batch", "batch, log", "plain Python")]
    extent = Extent(rounds=1, evaluations=200, python_evaluations=40)
    errors = {}
    for step in ("Euler 1 ms", "RK4 1 ms"):
        document = measure(replace(CASES["bench_leg", step], compared_ticks=200), chosen, extent)
        assert json.loads(json.dumps(document, allow_nan=False)) == document
        rows = {row["implementation"]: row for row in document["rows"]}
        assert rows["batch"][ERROR] is None
        assert document["ratios"]["compiled"] == document["ratios"]["batch"] == 1.0
        [row] = batch_rows([document])
        assert float(row["compiled / batch"]) > 0.0 and float(row["with log / without"]) > 0.0
        assert row["rollout / batch, per core"] is None  # not timed
        errors[step] = rows["compiled, log"][ERROR]
        assert rows["plain Python"][ERROR] == errors[step]
    # Fourth order beats first order by far at the same step.
    assert errors["RK4 1 ms"] < 1e-4 * errors["Euler 1 ms"]
