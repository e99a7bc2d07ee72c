"""A live session is simulated again, bit for bit, from the events in the run folder that it leaves behind."""

from __future__ import annotations

import json
import os
import signal
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from errors import raises, states
from test_live_loop import Rig, say, wait_for

from twin_gait import load_experiment, load_run, simulate
from twin_gait.configuration.events import changed_keys
from twin_gait.configuration.experiments import LoadedExperiment, experiment_from_mapping
from twin_gait.exceptions import ParameterError
from twin_gait.live import loop
from twin_gait.live.controls import ControlPanel
from twin_gait.live.journal import LogChunk, walked_document
from twin_gait.live.session import LiveSession
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.run import log_table
from twin_gait.simulation.settings import loop_numbers
from twin_gait.simulation.simulation_setup import build_setup


class SentCommands:
    """Commands that a session sends to the loop, without its threads."""

    def __init__(self, loaded: LoadedExperiment) -> None:
        self.panel, self.script = ControlPanel(loaded.experiment), list[tuple[float, dict[str, object]]]()
        self.settings = self.panel.preset

    def send(self, time: float, command: str, **values: object) -> None:
        self.script.append((time, {"serial": len(self.script), "command": command, "user": "Ann", **values}))

    def turn(self, time: float, control: str, value: object) -> None:
        before = self.settings
        if value is None:
            self.settings = self.panel.revert(before, control)
        else:
            self.settings = self.panel.set(before, control, value)
        sent = {"set": changed_keys(before, self.settings), "numbers": loop_numbers(self.settings)}
        whole = changed_keys(self.panel.preset, self.settings)
        self.send(time, "settings", **json.loads(json.dumps({**sent, "whole": whole})))


def assert_walks_again(walk: LogChunk, loaded: LoadedExperiment) -> None:
    """Check that the rerun of a walk from its YAML document has the same log in every column."""
    document = json.loads(json.dumps(walked_document(walk, loaded.document)))
    experiment = experiment_from_mapping(document, "experiment", Path())
    again = simulate(experiment)
    layout = log_layout(build_setup(loaded.experiment))
    log = log_table(walk.rows, layout, again.table)
    pd.testing.assert_frame_equal(log, again.log, check_exact=True)
    assert pd.util.hash_pandas_object(log).equals(pd.util.hash_pandas_object(again.log))
    assert (again.switches, again.trip) == (walk.switches, walk.trip)


@pytest.fixture(scope="module")
def bench() -> LoadedExperiment:
    return load_experiment("bench_leg", ["duration_s=60"])


def test_fades_that_overlap_pushes_faults_a_stop_and_a_restart_are_walked_again(bench: LoadedExperiment):
    desk = SentCommands(bench)
    desk.turn(0.05, "late_stance.hip.stiffness", 2.4)
    desk.turn(0.20, "swing_flexion.knee.equilibrium", 57.3)
    desk.turn(0.31, "early_stance.hip.damping", 31.7)  # a damping for a damping ratio, in the fade
    desk.send(0.40, "push", joint="right_knee", torque=-6.3, duration=0.333)
    desk.send(0.55, "push", joint="right_knee", torque=2.1, duration=0.021)
    desk.turn(0.60, "early_stance.hip.damping", None)
    desk.send(0.90, "fault", fault="encoder_offset:right_hip@0s=0.7deg")
    desk.send(1.30, "stop")
    desk.turn(1.40, "late_stance.hip.stiffness", 2.2)
    desk.send(2.00, "restart")
    desk.turn(2.70, "all", None)
    rig = Rig(desk.panel.simulation_setup, desk.script, longest=2600)
    rig.loop.walk()
    first, second = rig.takes
    assert first.trip is not None and len(first.rows) == pytest.approx(2000, abs=450)
    kinds = [next(iter(item.keys() - {"time_s", "by", "fade_ms"})) for item in first.events]
    assert kinds == ["set"] * 3 + ["push"] * 2 + ["set", "fault", "stop", "set"]
    assert {item["by"] for item in first.events} == {"Ann"}
    whole = {"set", "fade_ms", "time_s", "by"}
    assert set(second.events[0]) == whole and second.events[0]["time_s"] == second.events[0]["fade_ms"] == 0
    for walk in (first, second):
        assert_walks_again(walk, bench)


def test_steps_by_hand_and_the_controls_of_the_monitor_are_walked_again(bench: LoadedExperiment):
    desk = SentCommands(bench)
    desk.turn(0.0, "manual", True)
    desk.send(4.003, "step")
    desk.send(
        5.0, "push", joint="right_hip", torque=3.0, duration=0.017
    )  # ends between two looks at the legs
    desk.turn(6.5, "manual", False)
    desk.turn(7.0, "monitor.right.knee.stiffness", 1.1)
    desk.turn(7.1, "mode", "impedance_control")
    desk.turn(7.2, "monitor.right.hip.torque", 3.3)
    desk.turn(7.3, "mode", "torque_control")
    desk.turn(7.8, "mode", "walk")
    rig = Rig(desk.panel.simulation_setup, desk.script, longest=9000)
    rig.loop.walk()
    assert not any(item["refused"] for item in rig.answers().values())
    (walk,) = rig.takes
    assert [item for item in walk.switches if item.source == "late_stance"]
    assert_walks_again(walk, bench)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_every_change_of_a_walk_is_reproduced(seed: int):
    loaded = load_experiment("treadmill_guided", ["duration_s=60"])
    desk, generator = SentCommands(loaded), np.random.default_rng(seed)
    shown = {item.name: item for item in desk.panel.controls(desk.panel.preset) if item.group != "monitor"}
    for time in np.sort(generator.uniform(0.0, 9.0, 25)).tolist():
        name, kind = generator.choice(list(shown)), generator.random()
        control = shown[str(name)]
        if kind < 0.1:
            desk.send(time, "push", joint="left_knee", torque=generator.uniform(-9, 9), duration=0.15)
        elif kind < 0.2:
            desk.send(time, "step")
        elif kind < 0.3:
            desk.turn(time, "manual", bool(generator.random() < 0.5))
        elif kind < 0.35:
            desk.send(time, "restart")
        elif kind < 0.4:
            desk.turn(time, "all", None)
        elif control.kind == "number":
            wanted = control.value * generator.uniform(0.95, 1.05)
            desk.turn(time, control.name, float(np.clip(wanted, control.minimum, control.maximum)))
    desk.send(10.0, "end")  # of a walk that has fallen the time stands still
    rig = Rig(desk.panel.simulation_setup, desk.script, longest=9000)
    rig.loop.walk()
    assert rig.takes and sum(len(walk.events) for walk in rig.takes) > 8
    for walk in rig.takes:
        assert_walks_again(walk, loaded)


@pytest.mark.slow
def test_requests_of_the_modes_are_reproduced_including_rejected_ones():
    loaded = load_experiment("overground", ["modes=walking", "duration_s=30"])
    desk = SentCommands(loaded)
    requests = loaded.experiment.modes.requests * 2
    for number, name in enumerate(requests):
        desk.send(0.503 + 0.4 * number, "request", request=name)
    desk.turn(1.0, "early_stance.knee.stiffness", 3.0)
    desk.send(7.0, "end")
    rig = Rig(desk.panel.simulation_setup, desk.script, longest=6000)
    rig.loop.walk()
    (walk,) = rig.takes
    requested = [item["request"] for item in walk.events if "request" in item]
    assert requested == list(requests) and any(item["refused"] for item in rig.answers().values())
    assert_walks_again(walk, loaded)


def test_a_walk_with_too_many_events_takes_no_more_but_is_stopped(bench: LoadedExperiment, monkeypatch):
    monkeypatch.setattr(loop, "LONGEST_SCRIPT", 150)
    desk = SentCommands(bench)
    for time in (0.1, 0.2, 0.3):
        desk.turn(time, "late_stance.hip.stiffness", 2.0 + time)
    desk.send(0.4, "stop")
    rig = Rig(desk.panel.simulation_setup, desk.script)
    rig.loop.walk()
    refused = {serial: item["refused"] for serial, item in rig.answers().items()}
    assert refused[1] == refused[3] == "" and states(refused[2], "settings", "restart")
    assert_walks_again(rig.takes[0], bench)


@pytest.mark.slow
def test_completed_and_killed_sessions_leave_folders_that_reproduce_the_walk(
    bench: LoadedExperiment, tmp_path: Path
):
    session = LiveSession(loaded=bench, folder=tmp_path / "run", user="Ann", pictures=False)
    with closing(session):
        session.start()
        say(session, kind="set", control="late_stance.hip.stiffness", value=2.4)
        say(session, kind="do", action="fault", values={"kind": "encoder_jump", "place": "right_knee"})
        say(session, kind="set", control="swing_flexion.knee.equilibrium", value=57.0)
        say(session, kind="do", action="restart")
        pushed = say(session, kind="do", action="push", values={"joint": "right_knee", "torque": -6})
        wait_for(lambda: session.walk.frame["tick"] > pushed.tick + 1500)
        os.kill(session.walk.process.pid, signal.SIGKILL)
        wait_for(lambda: not session.walk.alive)
    folders = list(session.summaries)
    assert folders == [tmp_path / "run", tmp_path / "run-2"]
    for folder in folders:
        stored = load_run(folder)
        assert simulate(stored.experiment).log.equals(stored.log)
    assert load_run(folders[0]).experiment.faults and not load_run(folders[1]).experiment.faults
    changes = load_run(folders[1]).experiment.events
    assert [type(item).__name__ for item in changes] == ["Change", "Push"] and changes[0].by == "Ann"


def test_live_takes_no_experiment_with_events(tmp_path: Path):
    loaded = load_experiment("bench_leg", ["events=[{time_s: 1, stop: true}]"])
    session = LiveSession(loaded=loaded, folder=tmp_path / "run")
    with closing(session), raises(ParameterError, "--set events=[]"):
        session.start()
