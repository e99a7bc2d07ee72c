"""The benchmark's harness: contestants step the same motion, ratios are judged; no test times anything."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from twin_gait.cli import benchmark as command
from twin_gait.cli.terminal import DONE, FAILED
from twin_gait.exceptions import MissingOptionalDependency, ParameterError, RunDirectoryError
from twin_gait.studies.benchmark import benchmark as study
from twin_gait.studies.benchmark import page as benchmark_page
from twin_gait.studies.benchmark.engines import BatchSession
from twin_gait.studies.benchmark.measurement import Entry, Timing, speed_ratio, time_in_turn
from twin_gait.studies.benchmark.ratios import GOALS, WALK_LIMIT, all_met, judge
from twin_gait.studies.benchmark.scaling import CHAINS
from twin_gait.studies.benchmark.subjects import SUBJECTS, cases_of
from twin_gait.studies.benchmark.table import draw_benchmark

TICKS = 900
# Rounding of 1e-16 rad in other orders of additions; a switch one tick late would move an angle by 1e-4.
SAME_MOTION = 1e-10  # [rad]

CONTESTANTS = {item.name: item for item in study.CONTESTANTS}
CASES = {(case.subject, case.stepping): case for case in cases_of()}


def angles_of(name: str, case, ticks: int) -> np.ndarray:
    session = CONTESTANTS[name].open(case, ticks)
    session.run()
    angles = session.angles()
    assert angles is not None and angles.shape[0] == ticks
    return angles


# ---------------------------------------------------------------------- the same motion


@pytest.fixture(scope="module")
def compiled_angles() -> dict[str, np.ndarray]:
    steppings = ("Euler 1 ms", "RK4 1 ms")
    return {item: angles_of("compiled_log", CASES["bench_leg", item], TICKS) for item in steppings}


@pytest.mark.parametrize(
    ("name", "stepping"),
    [
        ("pinocchio", "Euler 1 ms"),
        ("plain_python", "Euler 1 ms"),
        ("plain_python", "RK4 1 ms"),
        ("mujoco_python", "Euler 1 ms"),
        ("mujoco_python", "RK4 1 ms"),
        # Compiles for seconds; Runge-Kutta is the harder one, because it calls back at every stage.
        ("mujoco_native", "RK4 1 ms"),
    ],
)
def test_contestant_moves_the_bench_leg_like_the_compiled_engine(compiled_angles, name, stepping):
    if name.startswith("mujoco"):
        pytest.importorskip("mujoco")
    found = angles_of(name, CASES["bench_leg", stepping], TICKS)
    # It is a step, not a rest: the hip has moved by more than ten degrees.
    assert np.ptp(found, axis=0).max() > 0.17
    np.testing.assert_allclose(found, compiled_angles[stepping], atol=SAME_MOTION, rtol=0.0)


@pytest.mark.parametrize(
    ("subject", "stepping", "ticks"),
    [("contact_free_biped", "Euler 1 ms", 500), ("treadmill", "Euler 0.25 ms", 150)],
)
def test_plain_script_moves_both_legs_like_the_pinocchio_engine(subject, stepping, ticks):
    case = CASES[subject, stepping]
    np.testing.assert_allclose(
        angles_of("plain_python", case, ticks),
        angles_of("pinocchio", case, ticks),
        atol=SAME_MOTION,
        rtol=0.0,
    )


def test_mujoco_moves_the_contact_free_biped_like_the_plain_script():
    pytest.importorskip("mujoco")
    case = CASES["contact_free_biped", "Euler 1 ms"]
    np.testing.assert_allclose(
        angles_of("mujoco_python", case, 300), angles_of("plain_python", case, 300), atol=SAME_MOTION
    )


def test_contact_free_biped_has_no_ground():
    world = CASES["contact_free_biped", "RK4 1 ms"].experiment.build_world()
    assert world.contact is None and not world.contact_frames
    assert len(world.model.legs) == 2
    # The support carries all of it, so that nothing falls.
    assert world.support_force == pytest.approx(world.body_weight, rel=1e-12)


# ---------------------------------------------------------------------- MuJoCo


def test_mujoco_stands_on_its_own_contacts_with_the_same_mass():
    pytest.importorskip("mujoco")
    case = CASES["treadmill", "Euler 0.25 ms"]
    session = CONTESTANTS["mujoco_bare"].open(case, 1000)
    world = session.problem.world
    assert session.model.body_mass.sum() == pytest.approx(world.model.total_mass, rel=1e-9)
    session.run()
    assert 2 <= session.data.ncon <= 4
    pelvis = session.order[world.model.pelvis_index]
    # Springs and ground hold the wearer: the pelvis has sunk by centimetres, not to the floor.
    assert abs(session.data.qpos[pelvis] - world.start_q[world.model.pelvis_index]) < 0.05


def test_belt_of_mujoco_keeps_its_speed_under_the_feet():
    pytest.importorskip("mujoco")
    case = CASES["treadmill", "Euler 0.25 ms"]
    session = CONTESTANTS["mujoco_python"].open(case, 100)
    session.run()
    assert session.data.ncon >= 1
    speed = session.data.joint("belt").qvel[0]
    assert speed == pytest.approx(-case.experiment.scenario.belt_speed, rel=1e-4)
    assert session.angles() is None  # other contacts, another motion: not to be compared


def test_rollout_ends_where_the_bare_step_ends():
    pytest.importorskip("mujoco")
    case = CASES["bench_leg", "RK4 1 ms"]
    bare, rollout = (CONTESTANTS[name].open(case, 50) for name in ("mujoco_bare", "mujoco_rollout"))
    bare.run()
    rollout.run()
    last = rollout._states[:, -1]
    # A state is time, positions, velocities.
    expected = np.concatenate([[bare.data.time], bare.data.qpos, bare.data.qvel])
    np.testing.assert_array_equal(last[:, : len(expected)], np.tile(expected, (len(last), 1)))


def test_every_episode_of_a_batch_ends_where_a_single_run_ends():
    case = CASES["bench_leg", "RK4 1 ms"]
    alone = angles_of("compiled_log", case, 200)[-1]
    session = BatchSession(case, 199, episodes=3, threads=2)
    for _ in range(2):  # from the start again, not on from where the first run ended
        session.reset()
        session.run()
        for engine in session._engines:
            np.testing.assert_array_equal(engine.episode.state.q, alone)


def test_chains_of_all_kinds_have_the_same_accelerations():
    joints = 3
    sessions = {name: make(joints) for name, make in CHAINS.items() if not name.startswith("mujoco")}
    for session in sessions.values():
        session.run()
    expected = sessions["pin_aba"].acceleration
    # The loop of the kernel nudges its state by 1e-300 only.
    np.testing.assert_allclose(sessions["kernel"].acceleration, expected, rtol=1e-9, atol=1e-9)
    pytest.importorskip("mujoco")
    np.testing.assert_allclose(CHAINS["mujoco_step"](joints).acceleration, expected, rtol=1e-9, atol=1e-9)


# ---------------------------------------------------------------------- measurement


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


def test_contestants_run_in_turn_and_the_first_round_counts_for_nothing():
    notes: list[str] = []
    entries = [Entry(name, Noted(name, notes), 10) for name in "ab"]
    times = time_in_turn(entries, 3)
    assert notes == ["reset a", "run a", "reset b", "run b"] * 4
    assert {name: len(timing.rounds) for name, timing in times.items()} == {"a": 3, "b": 3}


def test_ratio_pairs_the_rounds():
    # A disturbance that doubles both times of one round leaves the ratio alone.
    slow, fast = Timing((30.0, 60.0, 33.0), (1.0,) * 3), Timing((10.0, 20.0, 10.0), (1.0,) * 3)
    assert speed_ratio(slow, fast) == 3.0
    assert slow.median == 33.0
    assert slow.quartiles == (31.5, 46.5)


def test_ratio_is_not_flattered_by_a_busy_machine():
    # The slow one had a quarter of a processor: by the clock 12, by processor time 3.
    waiting, undisturbed = Timing((120.0,) * 3, (0.25,) * 3), Timing((10.0,) * 3, (1.0,) * 3)
    assert speed_ratio(waiting, undisturbed) == 3.0
    # Two threads that hold each other up use less processor and gain no time.
    peer, held_up = Timing((40.0,) * 3, (2.0,) * 3), Timing((10.0,) * 3, (1.0,) * 3)
    assert speed_ratio(peer, held_up) == 4.0


def test_native_code_runs_as_long_as_its_angles_are_compared():
    for case in cases_of():
        for name in ("compiled", "compiled_log", "mujoco_native"):
            assert study.ticks_of(case, CONTESTANTS[name], study.QUICK) >= case.compared_ticks


# ---------------------------------------------------------------------- ratios


def made_up(ratio: float, wall: float = WALK_LIMIT / 2.0) -> dict:
    """A document of a benchmark in which every peer takes so many times as long."""
    rows = [
        {
            "contestant": name,
            "label": name,
            "ticks": 1000,
            "episodes": CONTESTANTS[name].episodes,
            "ns_per_tick": 100.0,
            "ns_per_tick_quartiles": [90.0, 120.0],
            "processor_share": 1.0,
            "processor_ns_per_tick": 100.0,
            "realtime_factor": 1e4,
            "ratio_to": {judged: ratio for judged in study.JUDGED if judged != name},
            "largest_angle_error_rad": 1e-6 if name == "compiled_log" else None,
        }
        for name in CONTESTANTS
    ]
    steppings = [(case.subject, case) for case in cases_of()]
    return {
        "schema_version": study.SCHEMA_VERSION,
        "rounds": 3,
        "machine_before": {"processor": "paper", "cores": 2, "load_average": [0.0, 0.0, 0.0]},
        "load_average_after": [0.0, 0.0, 0.0],
        "left_out": [],
        "cases": [
            {
                "subject": subject,
                "stepping": case.stepping,
                "method": str(case.integration.method),
                "rows": rows,
            }
            for subject, case in steppings
        ],
        "walk": {
            "stepping": "RK4 0.1 ms",
            "duration_s": 20.0,
            "status": "completed",
            "wall_s": wall,
            "loop_wall_s": wall,
        },
        "scaling": {
            "joints": [{"joints": n, "ns_per_evaluation": {"kernel": {"median": 10.0 * n}}} for n in (2, 4)],
            "batch": [
                {"episodes": n, "workers": w, "ns_per_tick": {"batch": {"median": 50.0 / w}}}
                for n in (1, 10)
                for w in (1, 2)
            ],
        },
        "verdicts": [],
    }


def test_goals_cover_every_subject():
    assert {goal.subject for goal in GOALS} == set(SUBJECTS)


def test_ratios_above_all_goals_are_met_and_a_slow_walk_is_not():
    enough = max(goal.least for goal in GOALS)
    assert all_met(judge(made_up(enough)))
    verdicts = judge(made_up(enough, wall=WALK_LIMIT))
    assert [item.passed for item in verdicts].count(False) == 1
    assert not verdicts[-1].passed and verdicts[-1].unit == "s"


def test_each_ratio_is_judged_by_its_own_goal():
    verdicts = judge(made_up(14.0))
    bench = {(item.stepping, item.what): item.passed for item in verdicts if item.subject == "bench_leg"}
    assert bench["Euler 1 ms", "mujoco_bare / compiled"]
    assert not bench["RK4 1 ms", "mujoco_bare / compiled"]
    assert not bench["Euler 1 ms", "plain_python / compiled"]


def test_a_peer_that_was_not_timed_is_a_goal_missed():
    document = made_up(1e3)
    for case in document["cases"]:
        case["rows"] = [row for row in case["rows"] if not row["contestant"].startswith("mujoco")]
    verdicts = judge(document)
    assert not all_met(verdicts)
    assert {item.figure for item in verdicts if "mujoco" in item.what} == {None}
    assert not all_met([])


# ---------------------------------------------------------------------- the whole


@pytest.fixture
def small(monkeypatch) -> study.Extent:
    """A benchmark that takes a moment: five contestants, one round."""
    names = ("compiled", "compiled_log", "batch", "plain_python", "mujoco_bare")
    monkeypatch.setattr(study, "CONTESTANTS", tuple(CONTESTANTS[name] for name in names))
    shorter = [replace(case, compared_ticks=200) for case in CASES.values() if case.subject == "bench_leg"]
    monkeypatch.setattr(study, "cases_of", lambda only=None: cases_of(only) and shorter)
    return study.Extent(rounds=1, evaluations=200, python_evaluations=40)


def test_document_tells_speed_and_accuracy(small):
    pytest.importorskip("mujoco")
    calls: list[tuple[int, int]] = []
    document = study.benchmark("bench_leg", small, progress=lambda *call: calls.append(call))
    assert calls[-1] == (20, 20)
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    euler, rk4 = ({row["contestant"]: row for row in case["rows"]} for case in document["cases"])
    for rows in (euler, rk4):
        assert rows["mujoco_bare"]["largest_angle_error_rad"] is None
        ours, plain = (rows[name]["largest_angle_error_rad"] for name in ("compiled_log", "plain_python"))
        assert abs(ours - plain) < SAME_MOTION
        row = rows["compiled"]
        assert row["realtime_factor"] == pytest.approx(1e6 / row["ns_per_tick"])
    # Fourth order beats first order by far at the same step.
    assert (
        rk4["compiled_log"]["largest_angle_error_rad"]
        < 1e-4 * (euler["compiled_log"]["largest_angle_error_rad"])
    )
    assert "walk" not in document and "scaling" not in document
    assert "bench_leg, Euler 1 ms" in draw_benchmark(document)


def test_without_mujoco_its_rows_are_left_out_and_said(small, monkeypatch):
    def missing():
        raise MissingOptionalDependency("mujoco", "test", "the comparison with MuJoCo")

    monkeypatch.setattr(study, "import_mujoco", missing)
    document = study.benchmark("bench_leg", small)
    assert all(row["contestant"] != "mujoco_bare" for case in document["cases"] for row in case["rows"])
    assert not all_met(judge(document))
    text = draw_benchmark(document)
    assert "left out: MuJoCo: " in text and "pip install 'twin-gait[test]'" in text
    assert "not timed" in text


def test_unknown_subject_is_told_with_those_that_there_are():
    with pytest.raises(ParameterError, match=r"no subject 'trot'; there are bench_leg, contact_free_biped"):
        cases_of("trot")


# ---------------------------------------------------------------------- the command


def run_command(*words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["benchmark", *words])
    return int(arguments.run(arguments))


@pytest.fixture
def measured(monkeypatch):
    """What the command is told that was measured."""
    result = SimpleNamespace(document=made_up(1e3), asked=[])

    def benchmark(only, extent, *, progress):
        result.asked.append((only, extent))
        return result.document

    monkeypatch.setattr(study, "benchmark", benchmark)
    return result


def test_check_ends_with_one_below_a_ratio_only(measured, capsys):
    assert run_command("--check") == DONE
    measured.document = made_up(1.0)
    measured.document["verdicts"] = study.verdict_rows(judge(measured.document))
    assert run_command() == DONE
    assert run_command("--check", "--quick", "--only", "treadmill") == FAILED
    assert measured.asked[-1] == ("treadmill", study.QUICK)
    assert "MISSED" in capsys.readouterr().out


def test_out_writes_document_and_picture(measured, tmp_path):
    measured.document["cases"] = measured.document["cases"][:2]  # six panels take their time to draw
    folder = tmp_path / "new" / "folder"
    assert run_command("--out", str(folder)) == DONE
    assert json.loads((folder / "benchmark.json").read_text()) == measured.document
    assert (folder / "benchmark.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(RunDirectoryError, match=r"benchmark\.json: exists"):
        run_command("--out", str(folder))
    assert len(measured.asked) == 1


def test_force_replaces_what_is_there(measured, tmp_path, monkeypatch):
    monkeypatch.setattr(
        command, "_write", lambda document, folder: (folder / "benchmark.json").write_text("")
    )
    (tmp_path / "benchmark.json").write_text("old")
    assert run_command("--out", str(tmp_path), "--force") == DONE
    assert (tmp_path / "benchmark.json").read_text() == ""


def test_out_that_is_a_file_is_refused_before_anything_is_timed(measured, tmp_path):
    path = tmp_path / "file"
    path.write_text("")
    with pytest.raises(RunDirectoryError, match=r"is a file"):
        run_command("--out", str(path))
    assert not measured.asked


# ---------------------------------------------------------------------- the page


def test_the_page_shows_every_verdict_and_says_what_is_in_the_way_of_what_is_missed(tmp_path):
    document = made_up(14.0)
    (tmp_path / "measured").mkdir()
    (tmp_path / "measured" / benchmark_page.DOCUMENT).write_text(json.dumps(document))
    benchmark_page.main([str(tmp_path / "measured"), str(tmp_path)])
    text = (tmp_path / benchmark_page.PAGE).read_text()
    verdicts = judge(document)
    missed = sum(not item.passed for item in verdicts)
    assert f"{missed} of {len(verdicts)} are missed" in text
    assert text.count("**missed**") == missed
    assert "| bench_leg | RK4 1 ms | mujoco_bare / compiled | 14× | at least 15× | **missed** |" in text
    assert (tmp_path / benchmark_page.PICTURE).read_bytes().startswith(b"\x89PNG")
    assert "All are met." in benchmark_page.page_text(made_up(1e3))


@pytest.mark.parametrize("contestant", ["batch", "mujoco_rollout"])
def test_an_episode_of_a_batch_is_as_long_as_a_single_one(contestant):
    for case in cases_of():
        alone = study.ticks_of(case, CONTESTANTS["compiled"], study.QUICK)
        assert study.ticks_of(case, CONTESTANTS[contestant], study.QUICK) == alone
