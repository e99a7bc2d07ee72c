"""Tests of the simulation side of ``twin-gait live``: messages, controls, rules, real time, the process."""

import base64
import json
import math
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from collections import deque
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from errors import raises, states

from twin_gait.configuration.experiments import experiment_from_mapping, load_experiment
from twin_gait.core.control_tick import DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.experiment.events import FADE_TICKS
from twin_gait.live.controls import ControlPanel, action_specs, action_values, fault_text
from twin_gait.live.forecast import find_errors
from twin_gait.live.journal import complete, split_walks, walked_document, walked_run
from twin_gait.live.loop import BLOCK_TICKS, CATCH_UP, PERIOD, BlockClock, LiveLoop
from twin_gait.live.protocol import (
    LARGEST_MESSAGE,
    DeadlineStatistics,
    DoAction,
    Frame,
    MessageRejected,
    RateLimiter,
    SetControl,
    SetControls,
    read_message,
)
from twin_gait.live.session import LiveSession
from twin_gait.live.session_records import list_sessions, read_session
from twin_gait.runs.folders import journal_path
from twin_gait.runs.record import read_stored_run
from twin_gait.simulation import stepping
from twin_gait.simulation.settings import loop_numbers
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.simulator import simulate
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.vocabulary import JointName
from twin_gait.worlds.faults import parse_fault

DEGREE = math.pi / 180.0


@pytest.fixture(scope="module")
def bench_panel():
    return ControlPanel(load_experiment("bench_leg", ["duration_s=60"]).experiment)


@pytest.fixture(scope="module")
def treadmill_panel():
    return ControlPanel(load_experiment("treadmill_guided", ["duration_s=60"]).experiment)


# ---------------------------------------------------------------------- messages


def test_messages_are_read_as_they_were_meant():
    text = '{"kind": "set", "id": "1", "user": "Ann", "control": "belt_speed", "value": 2}'
    assert read_message(text) == SetControl(id="1", user="Ann", control="belt_speed", value=2.0)
    text = b'{"kind": "do", "id": "2", "action": "push", "values": {"torque": 5}}'
    assert read_message(text) == DoAction(id="2", user="", action="push", values={"torque": 5.0})
    text = '{"kind": "try", "id": "3", "changes": {"belt_speed": 2, "mode": "walk", "manual": null}}'
    changes = {"belt_speed": 2.0, "mode": "walk", "manual": None}
    assert read_message(text) == SetControls(kind="try", id="3", changes=changes)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", ("JSON",)),
        ("[" * 3000, ("JSON",)),
        (b"\x81\xa4kind", ("JSON",)),
        ("[]", ("message",)),
        ('"set"', ("message",)),
        ('{"kind": "get", "id": "1"}', ("kind", "set", "try", "get")),
        ('{"kind": "set", "id": "", "control": "a", "value": 1}', ("id", "1", "64")),
        ('{"kind": "set", "id": 1, "control": "a", "value": 1}', ("id",)),
        ('{"kind": "set", "id": "1", "control": "a\\u0000", "value": 1}', ("control",)),
        ('{"kind": "set", "id": "1", "control": "a", "value": NaN}', ("value",)),
        ('{"kind": "set", "id": "1", "control": "a", "value": 1e999}', ("value",)),
        (
            '{"kind": "set", "id": "1", "control": "a", "value": ' + "9" * 400 + "}",
            ("value",),
        ),
        ('{"kind": "set", "id": "1", "control": "a", "value": null}', ("value",)),
        ('{"kind": "set", "id": "1", "control": "a", "value": [1]}', ("value",)),
        ('{"kind": "set", "id": "1", "control": "a", "value": 1, "eval": "x"}', ("eval",)),
        (
            '{"kind": "set", "id": "1", "user": "' + "x" * 65 + '", "control": "a", "value": 1}',
            ("user",),
        ),
        (
            '{"kind": "do", "id": "1", "action": "push", "values": [1]}',
            ("values",),
        ),
        (
            '{"kind": "do", "id": "1", "action": "push", "values": {"torque": {}}}',
            ("torque",),
        ),
        ('{"kind": "set", "id": "1", "x": "' + "y" * LARGEST_MESSAGE + '"}', ("4096",)),
        ('{"kind": "try", "id": "1", "changes": {"a": 1, "b": [2]}}', ("b",)),
        ('{"kind": "try", "id": "1", "changes": [1]}', ("changes",)),
    ],
)
def test_invalid_messages_are_refused_with_the_reason(text, reason):
    with raises(MessageRejected, *reason):
        read_message(text)


LONG = "n" * 3000


@pytest.mark.parametrize(
    "text",
    [
        f'{{"kind": "set", "id": "1", "control": "a", "value": 1, "{LONG}": 1}}',
        f'{{"kind": "do", "id": "1", "action": "push", "values": {{"{LONG}": 1}}}}',
        f'{{"kind": "set", "id": "1", "changes": {{"{LONG}": 1}}}}',
        f'{{"kind": "do", "id": "1", "action": "push", "values": {{"torque": "{LONG}"}}}}',
        f'{{"kind": "{LONG}", "id": "1", "control": "a", "value": 1}}',
    ],
)
def test_long_names_are_shortened_in_the_reason_which_is_all_there(text):
    with pytest.raises(MessageRejected) as caught:
        read_message(text)
    reason = str(caught.value)
    assert len(reason) < 250 and ("…" in reason or "..." in reason)
    assert any(word in reason for word in ("unknown key", "expected", "input should be"))


def test_a_text_of_a_value_is_shortened_in_its_refusal(treadmill_panel):
    specs = tuple(action_specs(treadmill_panel.simulation_setup))
    message = DoAction(id="1", user="", action="push", values={"joint": "j" * 200})
    with raises(MessageRejected, "joint", "left_hip") as caught:
        action_values(specs, message)
    assert len(str(caught.value)) < 200
    with raises(MessageRejected, "control") as caught:
        treadmill_panel.revert(treadmill_panel.preset, "j" * 200)
    assert "jjj" in str(caught.value)
    assert len(str(caught.value)) < 200


def test_a_rate_limit_lets_a_burst_pass_then_a_rate_and_counts_the_rest():
    limit = RateLimiter(10.0, 5)
    assert [limit.allows(100.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert limit.dropped == 2
    assert [limit.allows(100.25) for _ in range(3)] == [True, True, False]
    assert sum(limit.allows(200.0) for _ in range(20)) == 5


def test_frames_become_json_with_null_for_nan():
    statistics = DeadlineStatistics(blocks=3, late=1, worst_ms=math.inf, lost_s=0.0)
    frame = Frame(
        tick=7, time_s=0.007, status="walking", phases={"left": "late_stance", "right": None}, mode=None,
        deadlines=statistics,
    )  # fmt: skip
    read = json.loads(json.dumps(frame.to_dict(), allow_nan=False))
    assert (read["kind"], read["tick"], read["phases"]["right"]) == ("frame", 7, None)
    assert read["deadlines"] == asdict(statistics) | {"worst_ms": None} and read["events"] == []


# ---------------------------------------------------------------------- controls


@pytest.mark.parametrize("name", ["bench_panel", "treadmill_panel"])
def test_every_control_has_all_that_a_page_needs_and_begins_as_the_preset(name, request):
    panel = request.getfixturevalue(name)
    controls = panel.controls(panel.preset)
    assert len({item.name for item in controls}) == len(controls)
    for item in controls:
        assert not item.changed and item.label and item.group in ("walk", "table", "monitor")
        if item.kind == "number":
            assert item.minimum <= item.value <= item.maximum and item.step > 0.0
    table = [item for item in controls if item.group == "table"]
    assert len(table) == 5 * 2 * 4  # phases, joints, quantities


@pytest.mark.parametrize(("name", "many"), [("bench_panel", True), ("treadmill_panel", False)])
def test_every_control_changes_its_own_numbers_and_comes_back(name, many, request):
    panel = request.getfixturevalue(name)
    start = panel.set(panel.preset, "mode", "torque_control")
    # The table's controls are those of the bench, times two sides: a phase of them is enough there.
    chosen = [item for item in panel.controls(panel.preset) if many or item.phase in (None, "late_stance")]
    for control in chosen:
        monitored = control.group == "monitor" and control.name != "mode"
        before = panel.preset
        if monitored:
            before = (
                start
                if control.name.endswith((".torque", ".gain"))
                else panel.set(panel.preset, "mode", "impedance_control")
            )
        after = panel.set(before, control.name, another(control))
        assert loop_numbers(after) != loop_numbers(before), control.name
        shown = {item.name: item.value for item in panel.controls(after)}
        assert same(shown[control.name], another(control))
        assert panel.revert(after, control.name) == before
        assert panel.revert(after, "all") == panel.preset


def same(one, other):
    if isinstance(one, float):
        return math.isclose(one, other, rel_tol=1e-12)
    return one == other


def another(control):
    """Return another value of a control."""
    if control.kind == "switch":
        return not control.value
    if control.kind == "choice":
        return next(item for item in control.choices if item != control.value)
    return control.minimum + 0.37 * (control.maximum - control.minimum)


def test_a_table_control_sets_the_number_of_its_phase_joint_and_quantity_in_si(bench_panel):
    row = bench_panel.simulation_setup.table.phase_index("swing_flexion")
    for quantity, column, value, si in (
        ("stiffness", STIFFNESS, 2.0, 2.0 / DEGREE),
        ("damping", DAMPING, 21.0, 21.0),
        ("equilibrium", EQUILIBRIUM, 50.0, 50.0 * DEGREE),
        ("gain", GAIN, 0.45, 0.45),
    ):
        settings = bench_panel.set(bench_panel.preset, f"swing_flexion.knee.{quantity}", value)
        rows = np.array(loop_numbers(settings)["phase_rows"])
        assert rows[0, row, 4 + column] == pytest.approx(si, rel=1e-14)
        changed = np.argwhere(rows != bench_panel.simulation_setup.phase_rows).tolist()
        # b follows k by the damping ratio of the table, and θ0 through the inertia of both joints.
        follows = {"stiffness": [4 + DAMPING], "equilibrium": [DAMPING, 4 + DAMPING]}.get(quantity, [])
        assert {tuple(item) for item in changed} <= {(0, row, c) for c in [4 + column, *follows]}


def test_a_damping_that_was_set_stays_when_the_stiffness_changes_and_goes_back_to_the_ratio(bench_panel):
    name = "early_stance.hip"
    settings = bench_panel.set(bench_panel.preset, f"{name}.damping", 50.0)
    settings = bench_panel.set(settings, f"{name}.stiffness", 1.0)
    shown = {item.name: item for item in bench_panel.controls(settings)}
    assert shown[f"{name}.damping"].value == 50.0
    back = {item.name: item for item in bench_panel.controls(bench_panel.revert(settings, f"{name}.damping"))}
    k = bench_panel.preset.table.phases["early_stance"].joints["hip"].stiffness
    begun = {item.name: item for item in bench_panel.controls(bench_panel.preset)}[f"{name}.damping"].value
    # b = 2 ζ √(k I): with the same ζ and I it goes with the root of k.
    assert back[f"{name}.damping"].value == pytest.approx(begun * math.sqrt((1.0 / DEGREE) / k), rel=1e-12)
    assert back[f"{name}.stiffness"].changed


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("late_stance.hip.stiffness", 99.0, ("0", "{most:g} N·m/°", "99")),
        ("late_stance.hip.stiffness", -1.0, ("0", "{most:g} N·m/°", "-1")),
        ("late_stance.hip.stiffness", "stiff", ("0", "{most:g} N·m/°", "stiff")),
        ("late_stance.hip.stiffness", True, ("0", "{most:g} N·m/°")),
        ("late_stance.hip.gain", 1.01, ("0", "1", "1.01")),
        ("swing_flexion.knee.equilibrium", 160.0, ("°", "160")),
        ("belt_speed", 0.0, ("0.75", "2.25 km/h", "0")),
        ("mode", "fly", ("walk", "friction_control")),
        ("manual", 1.0, ("true", "false", "1")),
        ("late_stance.toe.stiffness", 1.0, ("late_stance.toe.stiffness",)),
        ("__class__", 1.0, ("__class__",)),
    ],
)
def test_a_value_out_of_its_range_and_an_unknown_control_are_refused(treadmill_panel, name, value, reason):
    shown = {item.name: item for item in treadmill_panel.controls(treadmill_panel.preset)}
    reason = [fact.format(most=shown["late_stance.hip.stiffness"].maximum) for fact in reason]
    with raises(MessageRejected, *reason):
        treadmill_panel.set(treadmill_panel.preset, name, value)


def test_equilibrium_beyond_the_stops_widens_its_range_and_no_other():
    settings = ["table.phases.middle_stance.hip.equilibrium_deg=-33.3", "duration_s=1"]
    panel = ControlPanel(load_experiment("treadmill_guided", settings).experiment)
    shown = {item.name: item for item in panel.controls(panel.preset)}
    beyond, other = (shown[f"middle_stance.{joint}.equilibrium"] for joint in ("hip", "knee"))
    assert beyond.minimum < beyond.value == pytest.approx(-33.3) and beyond.maximum > 90.0
    begun = ControlPanel(load_experiment("treadmill_guided", settings[1:]).experiment)
    assert other.minimum == begun.control_range("equilibrium", "knee")[0]
    assert beyond.minimum < begun.control_range("equilibrium", "hip")[0]


@pytest.mark.parametrize("preset", ["treadmill_guided", "overground", "bench_leg", "treadmill_ankle"])
def test_every_impedance_can_be_raised_and_every_equilibrium_moved_both_ways(preset):
    panel = ControlPanel(load_experiment(preset, ["duration_s=1"]).experiment)
    limit = panel.preset.experiment.control.limits[JointName.HIP].torque  # that of all joints
    checked = 0
    for control in panel.controls(panel.preset):
        quantity = control.name.rpartition(".")[2]
        if quantity in ("stiffness", "damping"):
            assert control.minimum == 0.0 and control.maximum >= 1.4 * control.value, control.name
            # At the end of the range 5 deg or 0.5 rad/s are enough for the torque limit.
            reach = 5.0 if quantity == "stiffness" else 0.5
            assert control.maximum * reach >= limit, control.name
        elif quantity == "equilibrium":
            low, high = np.degrees(panel._stops[control.joint])
            assert control.minimum < min(low, control.value) and control.maximum > max(high, control.value)
        else:
            continue
        checked += 1
    assert checked >= 3 * 2 * 5


def test_the_range_of_an_own_table_does_not_end_at_its_values():
    key = "table.phases.middle_stance.knee"
    settings = [f"{key}.stiffness_Nm_per_deg=25", f"{key}.damping_Nms_per_rad=300", "duration_s=1"]
    panel = ControlPanel(load_experiment("treadmill_guided", settings).experiment)
    assert panel.control_range("stiffness", "knee")[1] >= 37.5
    assert panel.control_range("damping", "knee")[1] >= 450.0
    panel.set(panel.preset, "middle_stance.knee.stiffness", 30.0)


def test_values_of_actions_are_checked_too(treadmill_panel):
    specs = tuple(action_specs(treadmill_panel.simulation_setup))

    def checked_values(action, **values):
        return action_values(specs, DoAction(id="1", user="", action=action, values=values))

    assert checked_values("push") == {"joint": "left_hip", "torque": 10.0, "duration": 0.2}
    with raises(MessageRejected, "torque", "-60", "60 N·m"):
        checked_values("push", torque=61.0)
    with raises(MessageRejected, "push", "force", "joint", "torque", "duration"):
        checked_values("push", force=1.0)
    with raises(MessageRejected, "stop", "x"):
        checked_values("stop", x=1.0)
    with raises(MessageRejected, "explode"):
        checked_values("explode")
    for kind, target in (("motor_dead", "left_hip"), ("foot_load_stuck", "left_foot"), ("supply_dip", "")):
        assert (
            checked_values("fault", kind=kind)["place"] == target
        )  # the default place fits the kind of fault
    values = checked_values("fault", kind="encoder_drift", place="left_hip", size=" 9 deg/s")
    assert str(parse_fault(fault_text(values))).startswith("encoder_drift:left_hip@")


@pytest.mark.parametrize(
    "wrong", [{"kind": "supply_dip", "place": "right_hip"}, {"place": ""}, {"size": "1; rm -rf /"}]
)
def test_a_fault_that_does_not_fit_is_refused(bench_problem, wrong):
    message = DoAction(id="1", user="", action="fault", values=wrong)
    fault = fault_text(action_values(action_specs(bench_problem), message))
    rig = Rig(bench_problem, [(0.0, {"serial": 1, "command": "fault", "fault": fault})], longest=20)
    rig.loop.walk()
    assert rig.answers()[1]["refused"] and rig.run.injected == ()


# ---------------------------------------------------------------------- rules


def test_an_unstable_gain_is_refused_and_a_stable_one_is_not(bench_panel):
    assert find_errors(bench_panel.preset) == {}
    # Friction compensation beyond the true friction drives the joint; the check names the border.
    unsafe = bench_panel.set(bench_panel.preset, "middle_stance.hip.gain", 0.95)
    (reason,) = find_errors(unsafe).values()
    assert reason.startswith("unstable (middle_stance): ")
    assert find_errors(bench_panel.set(bench_panel.preset, "middle_stance.hip.gain", 0.5)) == {}


def test_a_phase_that_could_not_be_left_any_more_is_refused(bench_panel):
    stuck = bench_panel.set(bench_panel.preset, "swing_flexion.hip.equilibrium", 5.0)
    assert next(iter(find_errors(stuck).values())).startswith("cannot_leave (swing_flexion)")


def test_an_earlier_error_does_not_refuse_a_change_that_removes_it(bench_panel):
    unsafe = bench_panel.set(bench_panel.preset, "middle_stance.hip.gain", 0.95)
    better = bench_panel.set(unsafe, "middle_stance.hip.gain", 0.9)
    assert find_errors(better).keys() == find_errors(unsafe).keys()


def test_the_monitor_is_held_to_the_same_stability(bench_panel):
    free = bench_panel.set(bench_panel.preset, "mode", "friction_control")
    assert find_errors(free) == {}
    driven = bench_panel.set(free, "monitor.right.hip.gain", 0.95)
    assert all(text.startswith("unstable") for text in find_errors(driven).values()) and find_errors(driven)


# ---------------------------------------------------------------------- the clock


def test_blocks_in_time_are_not_late_and_wait_for_their_turn():
    clock, now = BlockClock(), 100.0
    for _ in range(50):
        now += clock.wait(now)
        now += 0.004
        clock.finished(now)
    assert now == pytest.approx(100.0 + 49 * PERIOD + 0.004)
    statistics = clock.statistics
    assert (statistics.blocks, statistics.late, statistics.worst_ms, statistics.lost_s) == (50, 0, 0.0, 0.0)


def test_late_blocks_are_counted_and_caught_up():
    clock, now = BlockClock(), 0.0
    lateness = []
    for number in range(100):
        now += clock.wait(now)
        now += 0.035 if number == 10 else 0.001
        clock.finished(now)
        lateness.append(max(0.0, now - (number + 1) * PERIOD))
    statistics = clock.statistics
    assert now == pytest.approx(99 * PERIOD + 0.001)  # nothing is lost of a short stall
    assert statistics.late == sum(item > PERIOD for item in lateness) == 2
    assert statistics.worst_ms == pytest.approx(25.0) and statistics.lost_s == 0.0


def test_a_long_stall_is_given_up_not_raced_after_and_all_of_it_counts():
    clock, now, starts = BlockClock(), 0.0, []
    for number in range(300):
        now += clock.wait(now)
        starts.append(now)
        now += 1.0 if number == 20 else 0.001
        clock.finished(now)
    statistics = clock.statistics
    within = [sum(begun - PERIOD < item <= begun for item in starts) for begun in starts]
    assert max(within) <= 1 + CATCH_UP / PERIOD  # blocks that begin in the time of one
    assert statistics.lost_s == pytest.approx(1.0 - PERIOD, abs=1e-6)
    assert statistics.blocks == 300 + 99 and statistics.late == 100
    assert statistics.worst_ms == pytest.approx(990.0)


def test_a_pause_does_not_count_as_lost_time():
    clock = BlockClock()
    clock.wait(0.0)
    clock.finished(0.005)
    clock.pause()
    assert clock.wait(60.0) == 0.0
    clock.finished(60.001)
    assert (clock.statistics.late, clock.statistics.lost_s) == (0, 0.0)


# ---------------------------------------------------------------------- the loop


class Rig:
    """Loop with a clock that advances only by sleeping and working, and commands by time."""

    def __init__(self, problem, script, *, longest=1000, working=0.0005):
        self.time, self.sent, self.pieces, self.taken = 0.0, [], [[]], []
        self.longest = longest
        self.script = deque(sorted(script, key=lambda item: item[0]))
        shorter = replace(problem.experiment, duration=longest * 1e-3)
        self.run = SteppedRun(replace(problem, experiment=shorter))
        self._working, advance = working, self.run.advance

        def working_advance(ticks):
            self.time += self._working
            return advance(ticks)

        self.run.advance = working_advance
        self.loop = LiveLoop(
            run=self.run,
            now=lambda: self.time,
            sleep=self.sleep,
            commands=self.next_command,
            send=self.sent.append,
            store_chunk=self.keep,
        )

    def keep(self, piece):
        self.pieces[-1].append(piece)
        if piece.is_last:
            self.pieces.append([])

    @property
    def takes(self):
        """Return the finished walks."""
        return [walk for pieces in self.pieces[:-1] for walk in split_walks(pieces, self.longest)]

    def sleep(self, duration):
        assert duration > 0.0
        self.time += duration

    def next_command(self):
        if self.script and self.script[0][0] <= self.time + 1e-9:
            command = self.script.popleft()[1]
            self.taken.append(command["serial"])
            return {"set": {}, "whole": {}, **command}
        return None

    def news(self):
        return [item for item in self.sent if item["kind"] == "telemetry"]

    def rows(self, item):
        return np.frombuffer(base64.b64decode(item["rows"])).reshape(-1, len(self.run.layout.names))

    def answers(self):
        """Return the responses by the serial numbers of the commands."""
        found = [item for item in self.sent if item["kind"] == "answer"]
        return dict(zip(self.taken, found, strict=True))


@pytest.fixture(scope="module")
def bench_problem(bench_panel):
    return bench_panel.simulation_setup


def test_a_second_of_walking_takes_a_second_and_is_the_walk_of_simulate(bench_problem):
    rig = Rig(bench_problem, [])
    rig.loop.walk()
    assert rig.time == pytest.approx(1.0, abs=PERIOD)
    (take,) = rig.takes
    whole = simulate(replace(bench_problem.experiment, duration=1.0))
    angle = take.rows[:, rig.run.layout.names.index("right_knee_angle_rad")]
    np.testing.assert_array_equal(angle, whole.log["right_knee_angle_rad"])
    assert str(take.status) == "completed" and rig.news()[-1]["status"] == "ended"


def test_every_block_is_published_with_its_rows_despite_pauses_and_restarts(bench_problem):
    script = [
        (0.207, {"serial": 1, "command": "pause"}),
        (0.3, {"serial": 2, "command": "walk"}),
        (0.6, {"serial": 3, "command": "restart"}),
    ]
    rig = Rig(bench_problem, script)
    rig.loop.walk()
    messages = [item for item in rig.news() if item["rows"]]
    assert {len(rig.rows(item)) for item in messages} == {BLOCK_TICKS}
    assert all(item["first"] + BLOCK_TICKS == item["tick"] for item in messages)
    rows = np.concatenate([take.rows for take in rig.takes])
    np.testing.assert_array_equal(np.concatenate([rig.rows(item) for item in messages]), rows)


def test_frames_contain_the_events_of_the_walk_and_a_restart_clears_them(bench_problem):
    fault = {
        "serial": 1,
        "command": "fault",
        "fault": "encoder_freeze:right_knee@0s",
        "user": "Ann",
    }
    rig = Rig(bench_problem, [(0.3, fault), (0.8, {"serial": 2, "command": "restart"})])
    rig.loop.walk()
    assert rig.answers()[1]["refused"] == ""
    events = next(item["events"] for item in rig.news() if item["status"] == "held")
    trip = rig.takes[0].trip
    assert [item["kind"] for item in events] == ["fault", "trip"] and events[1]["time"] == trip.time
    assert events[0]["text"] == "fault: encoder freeze, right knee"
    assert events[1]["text"] == "trip: encoder frozen, right knee"
    assert rig.news()[0]["events"] == rig.news()[-1]["events"] == []
    document = walked_document(rig.takes[0], load_experiment("bench_leg", ["duration_s=60"]).document)
    experiment = experiment_from_mapping(document, "experiment", Path())
    kept = walked_run(rig.takes[0], bench_problem, experiment)
    assert [event.text for event in kept.events] == [item["text"] for item in events]
    assert [event.time for event in kept.events] == [item["time"] for item in events]


def test_a_stop_takes_effect_in_the_next_block_even_in_a_pause_and_ends_every_way_but_one(bench_problem):
    script = [
        (0.203, {"serial": 1, "command": "pause"}),
        (0.5, {"serial": 2, "command": "stop"}),
        (0.6, {"serial": 3, "command": "push", "joint": "right_hip", "torque": 1.0, "duration": 5e-3}),
        (0.7, {"serial": 4, "command": "walk"}),
        (0.8, {"serial": 5, "command": "step"}),
        (1.0, {"serial": 6, "command": "restart"}),
        (1.3, {"serial": 7, "command": "end"}),
    ]
    rig = Rig(bench_problem, script, longest=5000)
    rig.loop.walk()
    stopped, again = rig.takes
    state = stopped.rows[:, rig.run.layout.names.index("safety_state")]
    assert np.flatnonzero(state)[0] == rig.answers()[2]["tick"] == 210
    assert len(state) == pytest.approx(210 + 500, abs=2 * BLOCK_TICKS)  # the hold goes on in the pause
    assert stopped.events == ({"time_s": 0.21, "stop": True},)
    refused = {serial: bool(item["refused"]) for serial, item in rig.answers().items()}
    assert refused == {1: False, 2: False, 3: True, 4: True, 5: True, 6: False, 7: False}
    assert len(again.rows) == pytest.approx(300, abs=2 * BLOCK_TICKS)
    assert not again.rows[:, rig.run.layout.names.index("safety_state")].any()


def test_settings_fade_in_and_are_listed_with_their_tick(bench_panel, bench_problem):
    settings = bench_panel.set(bench_panel.preset, "late_stance.knee.stiffness", 2.0)
    numbers = json.loads(json.dumps(loop_numbers(settings)))
    given = {"table.phases.late_stance.knee.stiffness_Nm_per_rad": 2.0 / DEGREE}
    command = {"command": "settings", "numbers": numbers, "set": given, "user": "Ann"}
    script = [(0.1, {"serial": 1, **command})]
    rig = Rig(bench_problem, script, longest=4000)
    rig.loop.walk()
    (take,) = rig.takes
    assert take.events == ({"time_s": 0.1, "set": given, "fade_ms": FADE_TICKS, "by": "Ann"},)
    names = rig.run.layout.names
    codes = take.rows[:, names.index("right_phase")].astype(int)
    held = take.rows[:, names.index("right_knee_stiffness_Nm_per_rad")]
    late = np.flatnonzero(codes == bench_problem.table.phase_index("late_stance"))
    late = late[late > 1000]
    assert held[late[-1]] == pytest.approx(2.0 / DEGREE)


def test_thresholds_reach_the_guards(bench_panel, bench_problem):
    """With unreachable thresholds, phases end only by their timeouts."""
    numbers = json.loads(json.dumps(loop_numbers(bench_panel.preset)))
    shut = [{**entry, "threshold": 1e9} for entry in numbers["comparisons"]]
    script = [
        (0.0, {"serial": 1, "command": "settings", "numbers": {**numbers, "comparisons": shut}}),
        (6.0, {"serial": 2, "command": "settings", "numbers": numbers}),
    ]
    rig = Rig(bench_problem, script, longest=9000)
    rig.loop.walk()
    switches = rig.takes[0].switches
    assert {item.cause for item in switches if item.tick < 6000} == {"timeout"}
    assert "clearance" in {item.cause for item in switches if item.tick > 6000}


def test_a_step_by_hand_is_waited_for(bench_panel, bench_problem):
    settings = bench_panel.set(bench_panel.preset, "manual", True)
    numbers = loop_numbers(settings)
    script = [
        (0.0, {"serial": 1, "command": "settings", "numbers": numbers}),
        (0.05, {"serial": 2, "command": "step"}),
        (6.0, {"serial": 3, "command": "step"}),
    ]
    rig = Rig(bench_problem, script, longest=6500)
    rig.loop.walk()
    assert [bool(rig.answers()[serial]["refused"]) for serial in (1, 2, 3)] == [False, True, False]
    assert "waiting" in {item["status"] for item in rig.news() if item["tick"] < 6000}
    left = [item.tick for item in rig.takes[0].switches if item.source == "late_stance"]
    assert left and 6000 <= left[0] <= 6000 + 2 * BLOCK_TICKS


@pytest.mark.slow
def test_the_belt_stops_while_a_leg_waits_for_its_step_and_the_walk_continues_afterwards(
    treadmill_panel, monkeypatch
):
    monkeypatch.setattr(stepping, "MOST_FAULTS", 1)  # the loop of other tests' faults
    problem = treadmill_panel.simulation_setup
    numbers = loop_numbers(treadmill_panel.set(treadmill_panel.preset, "manual", True))
    script = [(0.0, {"serial": 1, "command": "settings", "numbers": numbers})]
    script += [(time, {"serial": 2 + k, "command": "step"}) for k, time in enumerate((8.0, 11.0, 14.0, 17.0))]
    rig = Rig(problem, script, longest=20_000)
    rig.loop.walk()
    (take,) = rig.takes
    assert (str(take.status), take.trip) == ("completed", None)
    run = walked_run(take, problem, problem.experiment)
    assert run.log["belt_speed_m_per_s"].eq(0.0).mean() > 0.5 and run.waiting_mask.any()
    assert run.verdict.outcome == "walked"  # though no stride begins for more than four seconds
    hips = take.rows[:, [rig.run.layout.names.index(f"{side}_hip_angle_rad") for side in problem.sides]]
    # 0.4 m/s under a leg of 0.9 m would turn a hip by half a radian in a second.
    assert np.ptp(hips[7000:8000], axis=0).max() < 0.01
    first_step = range(7000, 11_000)
    left = [item for item in take.switches if item.source == "late_stance" and item.tick in first_step]
    assert len(left) == 1 and left[0].tick < 8000 + 2 * BLOCK_TICKS
    side = problem.sides.index(left[0].side)
    assert np.ptp(hips[8000:10_000, side]) > 0.4  # the leg that was let go takes a step
    assert {item["status"] for item in rig.news() if 7000 < item["tick"] < 8000} == {"waiting"}


def test_a_slow_block_shows_in_the_statistics_of_the_next_frame(bench_problem):
    rig = Rig(bench_problem, [], working=0.016)  # ms of work in 10 ms
    rig.loop.walk()
    statistics = rig.news()[-1]["deadlines"]
    assert statistics["late"] > 50 and statistics["lost_s"] > 0.0
    assert rig.time == pytest.approx(1.6, abs=0.02)  # no block is left out


# ---------------------------------------------------------------------- the session


def say(session, **message):
    """Send a message as a page does and wait for the response."""
    say.count += 1
    session.submit(read_message(json.dumps({"id": f"m{say.count}", "user": "Ann", **message})))
    return wait_for(
        lambda: next((item for item in session.event_log.after(0) if item.id == f"m{say.count}"), None)
    )


say.count = 0


def wait_for(found, timeout=60.0):
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        result = found()
        if result:
            return result
        time.sleep(0.01)
    raise AssertionError("waited in vain")


EARLIER = "the table of an earlier session"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return a finished session on the bench with all kinds of messages, their responses and its folder."""
    folder = tmp_path_factory.mktemp("live")
    loaded = load_experiment("bench_leg", ["duration_s=60"])
    database = folder / "sessions"
    responses = {}
    (folder / "run-2").mkdir()  # somebody else's
    (folder / "run-table-1.yaml").write_text(EARLIER)
    with closing(
        LiveSession(loaded=loaded, folder=folder / "run", user="Ann", records=database, pictures=False)
    ) as session:
        session.start()
        responses["k"] = say(session, kind="set", control="late_stance.hip.stiffness", value=2.4)
        responses["zero"] = say(session, kind="set", control="swing_flexion.knee.equilibrium", value=57.0)
        responses["unsafe"] = say(session, kind="set", control="middle_stance.hip.gain", value=0.95)
        responses["range"] = say(session, kind="set", control="middle_stance.hip.gain", value=7)
        responses["push"] = say(
            session, kind="do", action="push", values={"joint": "right_knee", "torque": -6}
        )
        responses["save"] = say(session, kind="do", action="save")
        name = {"patient": "P03"}
        responses["settings"] = say(session, kind="do", action="save_settings", values=name)
        responses["again"] = say(session, kind="do", action="save_settings", values=name)
        responses["path"] = say(session, kind="do", action="save_settings", values={"patient": "../P03"})
        time.sleep(0.5)
        responses["state"] = session.state()
        responses["table"] = session.settings.table
        responses["block"] = wait_for(session.walk.blocks)[-1]
        responses["stop"] = say(session, kind="do", action="stop")
        wait_for(lambda: session.walk.status == "held")
        responses["restart"] = say(session, kind="do", action="restart")
        time.sleep(0.3)
    return session, responses, folder


def test_saving_leaves_the_table_of_an_earlier_session_alone(finished):
    _, responses, folder = finished
    assert (folder / "run-table-1.yaml").read_text() == EARLIER
    assert responses["save"].value == str(folder / "run-table-2.yaml")


def test_saved_settings_are_an_experiment_file_with_the_name_of_the_patient(finished):
    _, responses, folder = finished
    first, second = (Path(responses[name].value) for name in ("settings", "again"))
    assert re.fullmatch(r"P03-\d{4}-\d\d-\d\d\.yaml", first.name) and first.parent == folder
    assert second.name == f"{first.stem}-2.yaml"
    assert states(responses["settings"].text, f"twin-gait live {first}")
    opened = load_experiment(first).experiment
    assert opened.table.phases == responses["table"].phases and opened.name == "P03"
    assert responses["path"].response == "refused" and states(responses["path"].text, "patient", "../P03")
    (entry,) = list_sessions(folder / "sessions")
    assert entry["patient"] == "P03" and entry["id"] == finished[0].number
    assert str(entry["id"]) in finished[0].report_command


def test_changes_are_applied_with_their_tick_and_logged(finished):
    _, responses, folder = finished
    assert [responses[name].response for name in ("k", "zero", "push", "stop", "restart")] == ["applied"] * 5
    log = read_stored_run(folder / "run").run.log
    pushed = np.flatnonzero(log["right_knee_external_torque_Nm"] == -6.0)
    assert pushed[0] == responses["push"].tick and len(pushed) == 200
    assert np.flatnonzero(log["safety_state"])[0] == responses["stop"].tick
    events = read_stored_run(folder / "run").run.experiment.events
    assert [item.tick for item in events] == [responses[name].tick for name in ("k", "zero", "push", "stop")]
    assert {item.by for item in events} == {"Ann"}
    (stiffness,) = events[0].changes.values()
    assert stiffness == pytest.approx(2.4 / DEGREE, rel=1e-14)


def test_unsafe_changes_are_refused_with_the_reason_and_change_nothing(finished):
    _, responses, folder = finished
    assert responses["unsafe"].response is responses["range"].response == "refused"
    assert "unstable (middle_stance)" in responses["unsafe"].text
    assert states(responses["range"].text, "0", "1", "7")
    assert read_stored_run(folder / "run").run.log["right_hip_friction_compensation_gain"].max() < 0.5
    gain = next(item for item in responses["state"].controls if item.name == "middle_stance.hip.gain")
    assert not gain.changed


def test_the_state_shows_what_differs_from_the_preset(finished):
    _, responses, _ = finished
    changed = {item.name for item in responses["state"].controls if item.changed}
    assert changed == {"late_stance.hip.stiffness", "swing_flexion.knee.equilibrium"}
    shown = json.loads(json.dumps(responses["state"].to_dict()))
    assert {item["name"] for item in shown["controls"] if item["changed"]} == changed


def test_every_walk_of_the_session_has_a_complete_run_folder(finished):
    session, _, folder = finished
    assert list(session.summaries) == [folder / "run", folder / "run-3"] and session.failure == ""
    for path in session.summaries:
        stored = read_stored_run(path)
        assert stored.summary["status"] == "interrupted" and len(stored.run.log) > 200
        assert stored.run.experiment.duration == pytest.approx(len(stored.run.log) * 1e-3)
    assert read_stored_run(folder / "run").summary["safety"]["cause"] == "operator"
    assert not list(folder.glob(".*")) and not list((folder / "run-2").iterdir())


def test_the_saved_table_walks_in_simulate_with_the_parameters_of_the_live_episode(finished):
    _, responses, _ = finished
    experiment = load_experiment("bench_leg", [f"table={responses['save'].value}", "duration_s=4"]).experiment
    assert experiment.table.phases == responses["table"].phases
    run = simulate(experiment)
    rows = build_setup(experiment).phase_rows
    for phase, column, name, set_to in (
        ("late_stance", STIFFNESS, "right_hip_stiffness_Nm_per_rad", 2.4 / DEGREE),
        ("swing_flexion", 4 + EQUILIBRIUM, "right_knee_equilibrium_rad", 57.0 * DEGREE),
    ):
        last = run.log[run.log["right_phase"] == phase][name].iloc[-1]
        assert last == rows[0, run.table.phase_index(phase), column] == pytest.approx(set_to)
    assert "--set table=" in responses["save"].text


def test_the_session_is_in_the_record_with_its_changes_tables_and_summary(finished):
    session, responses, folder = finished
    (entry,) = list_sessions(folder / "sessions")
    found = read_session(folder / "sessions", entry["id"])
    kept = [entry[name] for name in ("user", "experiment", "status", "versions")]
    assert kept == ["Ann", "bench_leg", "ended", 2]
    assert entry["folders"] == list(map(str, session.summaries)) and found["summary"] == session.summary
    logged = {item["serial"]: item for item in found["log"]}
    for name in ("k", "unsafe", "range", "push", "stop"):
        item = logged[responses[name].serial]
        assert (item["response"], item["tick"], item["text"]) == (
            responses[name].response,
            responses[name].tick,
            responses[name].text,
        )
    assert [item["tick"] for item in found["tables"]] == [responses["k"].tick, responses["zero"].tick]


def test_blocks_of_the_process_equal_its_log(finished):
    _, responses, folder = finished
    block, rows = (
        responses["block"],
        read_stored_run(folder / "run").run.log.iloc[responses["block"].first :][:BLOCK_TICKS],
    )
    assert block.end == block.first + BLOCK_TICKS
    for name in ("right_phase", "right_knee_angle_rad"):
        assert block.columns[name].tolist() == rows[name].tolist()


# ---------------------------------------------------------------------- the process


def begin(folder):
    """Start the process of the loop with pipes of the test."""
    document = load_experiment("bench_leg", ["duration_s=60"]).document
    setup = {"document": document, "folder": str(folder), "force": False}
    process = subprocess.Popen(
        [sys.executable, "-m", "twin_gait.live.process"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
    )  # fmt: skip
    process.stdin.write(json.dumps(setup) + "\n")
    for line in process.stdout:
        if json.loads(line)["kind"] == "answer":
            break
    return process


def real_time_is_allowed():
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def test_a_missing_reader_does_not_slow_the_loop(tmp_path):
    with begin(tmp_path / "run") as process:
        walking = time.monotonic()
        time.sleep(2.5)  # the pipe is full after a tenth of a second
        asleep = time.monotonic() - walking
        process.stdin.write(json.dumps({"command": "end"}) + "\n")
        process.stdin.flush()
        messages = [json.loads(line) for line in process.stdout]
    frames = [item for item in messages if item["kind"] == "telemetry"]
    ticks = [item["tick"] for item in frames]
    assert np.diff(ticks).max() == BLOCK_TICKS and frames[-1]["status"] == "ended"
    lost = frames[-1]["deadlines"]["lost_s"]
    # Time did not stand still for the reader.
    assert ticks[-1] * 1e-3 + lost == pytest.approx(asleep, abs=0.3)
    assert len([item for item in messages if item["kind"] == "answer"]) == 1
    assert list(complete(journal_path(tmp_path / "run"))) == [tmp_path / "run"]


def test_an_end_of_input_ends_the_process_with_a_complete_journal(tmp_path):
    with begin(tmp_path / "run") as process:
        time.sleep(0.4)
        if sys.platform == "linux":  # the loop goes before others, if this user may have that
            wanted = os.SCHED_RR if real_time_is_allowed() else os.SCHED_OTHER
            assert os.sched_getscheduler(process.pid) == wanted
        process.stdin.close()
        messages = [json.loads(line) for line in process.stdout]
    assert process.returncode == 0
    assert messages[-1]["status"] == "ended"
    complete(journal_path(tmp_path / "run"))
    assert read_stored_run(tmp_path / "run").summary["reason"].startswith("stopped at")


PARENT = """
    import sys, time
    from pathlib import Path
    from twin_gait.configuration.experiments import load_experiment
    from twin_gait.live.session import LiveSession

    loaded, folder = load_experiment("bench_leg", ["duration_s=60"]), Path(sys.argv[1])
    session = LiveSession(loaded=loaded, folder=folder, pictures=False)
    session.start()
    while session.walk.frame.get("tick", 0) < 100:
        time.sleep(0.01)
    print(session.walk.process.pid, flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_parent_that_is_killed_takes_the_loop_with_it_and_leaves_the_run(tmp_path):
    code = textwrap.dedent(PARENT)
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True
    ) as parent:
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    wait_for(lambda: not Path(f"/proc/{child}").exists() if os.path.isdir("/proc") else gone(child))
    complete(journal_path(tmp_path / "run"))
    assert read_stored_run(tmp_path / "run").summary["status"] == "interrupted"


def gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_an_unusable_setup_is_refused_in_one_line(tmp_path):
    loaded = load_experiment("bench_leg", ["duration_s=60"])
    broken = replace(loaded, document={**loaded.document, "duration_s": -1})
    session = LiveSession(loaded=broken, folder=tmp_path / "run", pictures=False)
    with raises(MessageRejected, "duration_s", "0.001", "3600", "-1"):
        session.start()
    session.close()
    assert not (tmp_path / "run").exists()
