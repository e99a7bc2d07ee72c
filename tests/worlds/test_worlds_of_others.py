"""Worlds that other packages bring, each as it is installed: a folder with its entry points on the path."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from errors import raises

from twin_gait import load_experiment, presets, simulate
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.vocabulary import Outcome, Side
from twin_gait.worlds.registry import find_world, world_kinds

PLUGINS = Path(__file__).parents[1] / "plugins"
FRAME_WALK = """
[twin_gait.worlds]
frame_walk = frame_walk.world:FrameWalk
[twin_gait.presets]
frame_walk = frame_walk
"""
SHIPPED = world_kinds()


def install(folder: Path, name: str, entry_points: str) -> None:
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(entry_points)


@pytest.fixture
def frame_walk(tmp_path, monkeypatch):
    install(tmp_path, "lab", FRAME_WALK)
    monkeypatch.syspath_prepend(str(PLUGINS))
    monkeypatch.syspath_prepend(str(tmp_path))


def broken(folder: Path, monkeypatch: pytest.MonkeyPatch, source: str, entry_points: str) -> None:
    """A package that is installed, but does not do what its entry points say."""
    install(folder, "lab", entry_points)
    (folder / "moon_world.py").write_text(source)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "moon_world", raising=False)


# ---------------------------------------------------------------------- one that works


@pytest.mark.slow
def test_commands_take_a_world_that_a_package_registers_by_an_entry_point(tmp_path):
    install(tmp_path, "lab", FRAME_WALK)
    paths = (str(tmp_path), str(PLUGINS), os.environ.get("PYTHONPATH", ""))
    surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}

    def told(*arguments: str) -> str:
        command = [sys.executable, "-m", "twin_gait", *arguments]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=120, check=False, env=surroundings, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert re.search(r"frame_walk +Both legs without a wearer in a frame", told("presets"))
    assert "resistance_Nms_per_rad: 0.0" in told("presets", "frame_walk")
    assert "frame_walk, against frame_walk: 0 errors" in told("check", "--experiment", "frame_walk")
    asked = ("--duration", "0.5", "--set", "engine=pinocchio", "--no-pictures", "--out", "in_frame")
    told("simulate", "frame_walk", *asked)
    told("view", "in_frame", "--out", "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "in_frame" in page and "late_stance" in page


def test_its_presets_follow_those_that_ship(frame_walk):
    names = list(presets())
    assert names[-1] == "frame_walk" and "treadmill" in names[:-1]
    assert world_kinds() == (*SHIPPED, "frame_walk")


def test_its_files_are_written_and_read(frame_walk, tmp_path):
    experiment = load_experiment("frame_walk", ["scenario.resistance_Nms_per_rad=5"]).experiment
    assert type(experiment.scenario) is find_world("frame_walk") and experiment.scenario.resistance == 5.0
    again = experiment_from_mapping(experiment_document(experiment), "again", tmp_path)
    assert again == experiment
    with raises(TwinGaitError, "scenario.resistnce", "resistance_Nms_per_rad"):
        load_experiment("frame_walk", ["scenario.resistnce=5"])


def test_its_legs_start_as_it_says_and_meet_no_ground(frame_walk):
    run = simulate(load_experiment("frame_walk", ["duration_s=0.01", "engine=pinocchio"]).experiment)
    assert set(run.log["right_phase"]) == {"late_stance", "swing_flexion"}
    assert run.log["left_hip_angle_rad"].iloc[0] == pytest.approx(np.radians(20.0))
    assert run.walkway is None and "left_foot_normal_force_N" not in run.log
    with raises(TwinGaitError, "fault", "foot_load_stuck:left_foot@1.0s"):
        load_experiment("frame_walk", ["faults=['foot_load_stuck:left_foot@1s']"])


@pytest.mark.slow
@pytest.mark.compile
def test_it_steps_with_both_legs_in_turn_and_slower_against_resistance(frame_walk):
    experiment = load_experiment("frame_walk").experiment
    free = simulate(experiment)
    damped = simulate(replace(experiment, scenario=replace(experiment.scenario, resistance=20.0)))
    assert free.verdict.outcome is Outcome.WALKED
    steps = [item.side for item in free.switches if item.target == "swing_flexion"]
    assert len(steps) >= 8 and all(a is not b for a, b in pairwise(steps))
    assert {*steps} == {Side.LEFT, Side.RIGHT}
    assert len(damped.switches) < len(free.switches)


# ---------------------------------------------------------------------- those that do not


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("import nothing_of_the_kind", "cannot be loaded (ModuleNotFoundError: No module named"),
        ("1 / 0", "cannot be loaded (ZeroDivisionError: division by zero); repair or uninstall it"),
        ("Earth = 1", "cannot be loaded (AttributeError: module 'moon_world' has no attribute 'Moon')"),
        ("Moon = int", "expected a Scenario with the kind moon"),
        ("from twin_gait.worlds.bench_leg import BenchLeg as Moon", "expected a Scenario with the kind moon"),
    ],
)
def test_a_broken_world_is_named_in_one_line(source, message, tmp_path, monkeypatch):
    broken(tmp_path, monkeypatch, source, "[twin_gait.worlds]\nmoon = moon_world:Moon\n")
    with pytest.raises(TwinGaitError) as caught:
        load_experiment("treadmill", ["scenario.kind=moon"])
    text = str(caught.value)
    assert "\n" not in text
    assert "scenario.kind: plug-in moon_world:Moon of the package lab" in text and message in text


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        (
            "model.total_mass",
            "modle.total_mass",
            ("NameError", "modle", "moon_world.py", "line 63"),
        ),
        ("start_v=", "velocity=", ("TypeError",)),
        ("return World(", "World(", ("build", "World", "None")),
        (
            "np.zeros(model.nv)",
            "np.zeros(3)",
            ("build", "start_q", "start_v", "plant"),
        ),
        ("np.zeros(model.nv)", "[0.0] * model.nv", ("build", "start_q", "start_v", "plant")),
        (", rear: self.rear_phase", "", ("initial_phases", "left, right", "left")),
        ("return PelvisGuide.FIXED", "return 'held'", ("pelvis", "PelvisGuide", "held")),
    ],
)
def test_a_world_with_a_mistake_is_told_in_one_line(right, wrong, message, tmp_path, monkeypatch):
    source = (PLUGINS / "frame_walk" / "world.py").read_text().replace('"frame_walk"', '"moon"')
    assert source.count(right) == 1
    broken(
        tmp_path,
        monkeypatch,
        source.replace(right, wrong),
        "[twin_gait.worlds]\nmoon = moon_world:FrameWalk\n",
    )
    (tmp_path / "moon.yaml").write_text(
        (PLUGINS / "frame_walk" / "frame_walk.yaml").read_text().replace("kind: frame_walk", "kind: moon")
    )
    experiment = load_experiment(tmp_path / "moon.yaml").experiment
    with raises(ParameterError, "moon", *message):
        experiment.build_world()


@pytest.mark.parametrize(
    ("source", "message"),
    [("1 / 0", ("ZeroDivisionError",)), ("", ("presets",))],
)
def test_a_broken_package_of_presets_is_named_and_those_that_ship_do_without(
    source, message, tmp_path, monkeypatch
):
    broken(tmp_path, monkeypatch, source, "[twin_gait.presets]\nmoon = moon_world\n")
    for ask in (presets, lambda: load_experiment("moon")):
        with raises(ParameterError, *message) as caught:
            ask()
        assert str(caught.value).startswith("plug-in moon_world of the package lab")
    assert load_experiment("bench_leg").experiment.name == "bench_leg"


@pytest.mark.parametrize("kind", ["moon", "null", "5", "[treadmill]"])
def test_an_unknown_world_is_told_which_there_are(kind):
    with raises(TwinGaitError, "scenario.kind", *SHIPPED):
        load_experiment("treadmill", [f"scenario.kind={kind}"])
