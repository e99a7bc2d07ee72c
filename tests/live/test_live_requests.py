"""Tests of requests in a live session: executed in the next tick or rejected with a reason."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from errors import raises, states

from twin_gait import load_experiment, simulate
from twin_gait.live.controls import ControlPanel, action_specs, action_values
from twin_gait.live.loop import LiveLoop
from twin_gait.live.protocol import DoAction, MessageRejected, read_message
from twin_gait.simulation.run import log_table
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun

TABLE = Path(__file__).parents[1] / "tables" / "treadmill_modes.yaml"
NAMES = ("walk", "walk")


def problem_of(*settings: str):
    return build_setup(load_experiment("overground", ["modes=walking", "duration_s=3", *settings]).experiment)


@pytest.fixture(scope="module")
def run() -> SteppedRun:
    return SteppedRun(problem_of())


def request(name: str) -> DoAction:
    return read_message(
        json.dumps({"kind": "do", "id": "1", "action": "request", "values": {"request": name}})
    )


def test_the_panel_offers_the_requests_of_the_modes_and_no_manual_steps():
    twin = ["modes=twin", f"table={TABLE}"]
    for preset, settings in (("overground", ["modes=walking"]), ("treadmill_start_stop", twin)):
        experiment = load_experiment(preset, settings).experiment
        panel = ControlPanel(experiment)
        specs = {item.action: item for item in action_specs(panel.simulation_setup)}
        (field,) = specs["request"].fields
        assert field.choices == experiment.modes.requests
        assert "step" not in specs
        assert "manual" not in [item.name for item in panel.controls(panel.preset)]
    bare = tuple(action_specs(build_setup(load_experiment("treadmill_guided").experiment)))
    assert "request" not in {item.action for item in bare}
    with raises(MessageRejected, "request"):
        action_values(bare, request("walk"))


def test_an_unknown_request_is_one_line():
    specs = tuple(action_specs(problem_of()))
    assert action_values(specs, request("stop")) == {"request": "stop"}
    with raises(MessageRejected, "step", "stop", "fly") as error:
        action_values(specs, request("fly"))
    assert "\n" not in str(error.value)


@pytest.mark.slow  # compiles a loop
def test_a_request_is_executed_in_the_next_tick_like_a_scheduled_one(run):
    run.restart()
    results = []
    for ticks, name in ((500, "walk"), (101, "walk"), (200, "step"), (300, "stop")):
        run.advance(ticks)
        results.append(run.request(name))
        assert results[-1].tick == run.tick - 1
    run.advance(3000 - run.tick)
    schedule = ", ".join(f"{item.request}@{item.time:.3f}s" for item in results)
    scheduled = simulate(problem_of(f"requests=[{schedule}]").experiment)
    assert tuple(results) == scheduled.request_results
    assert log_table(run.rows(), run.layout, run.setup.table).equals(scheduled.log)
    assert [item.mode_after for item in results] == ["walk_manual", "walk_manual", "manual_step", "stopping"]
    assert states(results[1].rejection, "walk_manual", "walk", "step", "stop")


@pytest.mark.slow
def test_the_loop_answers_a_page_at_once_and_the_block_is_the_rest_of_ten_ticks(run):
    run.restart()
    sent, clock = [], iter(np.arange(0.0, 100.0, 0.005).tolist())
    commands = [*({"command": "request", "request": name} for name in NAMES), {"command": "end"}]
    loop = LiveLoop(
        run=run,
        now=lambda: next(clock),
        sleep=lambda seconds: None,
        commands=lambda: commands.pop(0) if len(commands) > 1 or (commands and run.tick >= 100) else None,
        send=sent.append,
        store_chunk=lambda piece: None,
    )
    loop.walk()
    answers = [item for item in sent if item["kind"] == "answer"]
    assert answers[0]["tick"] == 0
    assert [item["tick"] for item in sent if item["kind"] == "telemetry"][:2] == [10, 20]
    assert answers[0]["text"] == "walk: standing → walk_manual" and not answers[0]["refused"]
    assert states(answers[1]["refused"], "walk_manual", "walk", "step", "stop")
