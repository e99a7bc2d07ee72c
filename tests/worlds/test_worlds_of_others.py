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
from errors import raises, states

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

    def output_of(*arguments: str) -> str:
        command = [sys.executable, "-m", "twin_gait", *arguments]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=120, check=False, env=surroundings, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert re.search(r"frame_walk +Both legs without a wearer in a frame", output_of("presets"))
    assert "resistance_Nms_per_rad: 0.0" in output_of("presets", "frame_walk")
    assert "frame_walk, against frame_walk: 0 errors" in output_of("check", "--experiment", "frame_walk")
    options = ("--duration", "0.5", "--set", "engine=pinocchio", "--no-pictures", "--out", "in_frame")
    output_of("simulate", "frame_walk", *options)
    output_of("view", "in_frame", "--out", "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "in_frame" in page and "late_stance" in page


def test_presets_of_a_package_follow_the_shipped_presets(frame_walk):
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


def test_legs_of_the_world_start_in_its_postures_without_ground(frame_walk):
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
    ("source", "facts"),
    [
        ("import nothing_of_the_kind", ("ModuleNotFoundError", "nothing_of_the_kind")),
        ("1 / 0", ("ZeroDivisionError",)),
        ("Earth = 1", ("AttributeError", "Moon")),
        ("Moon = int", ("Scenario", "moon")),
        ("from twin_gait.worlds.bench_leg import BenchLeg as Moon", ("Scenario", "moon")),
    ],
)
def test_a_broken_world_is_named_in_one_line(source, facts, tmp_path, monkeypatch):
    broken(tmp_path, monkeypatch, source, "[twin_gait.worlds]\nmoon = moon_world:Moon\n")
    with pytest.raises(TwinGaitError) as caught:
        load_experiment("treadmill_guided", ["scenario.kind=moon"])
    text = str(caught.value)
    assert "\n" not in text
    assert states(text, "scenario.kind", "moon_world:Moon", "lab", *facts)


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
def test_a_world_with_a_mistake_is_refused_in_one_line(right, wrong, message, tmp_path, monkeypatch):
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
def test_a_broken_package_of_presets_is_named_and_shipped_presets_still_load(
    source, message, tmp_path, monkeypatch
):
    broken(tmp_path, monkeypatch, source, "[twin_gait.presets]\nmoon = moon_world\n")
    for load in (presets, lambda: load_experiment("moon")):
        with raises(ParameterError, *message) as caught:
            load()
        assert str(caught.value).startswith("plug-in moon_world of the package lab")
    assert load_experiment("bench_leg").experiment.name == "bench_leg"


@pytest.mark.parametrize("kind", ["moon", "null", "5", "[treadmill]"])
def test_an_unknown_world_lists_the_known_worlds(kind):
    with raises(TwinGaitError, "scenario.kind", *SHIPPED):
        load_experiment("treadmill_guided", [f"scenario.kind={kind}"])
