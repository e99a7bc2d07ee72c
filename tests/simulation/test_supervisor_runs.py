"""Tests of the operating modes in the engines: requests, motion of the legs, and the hold after a trip."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from errors import raises, states
from log_rows import log_matrix

from twin_gait import load_experiment, simulate
from twin_gait.cli.simulate import report
from twin_gait.exceptions import TwinGaitError
from twin_gait.experiment.experiment import Engine, Experiment
from twin_gait.gait.machine import POSTURE
from twin_gait.kernels.pinocchio_kernel import PinocchioKernel
from twin_gait.runs.record import read_stored_run
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, LaneEngine
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup

TABLE = Path(__file__).parents[1] / "tables" / "treadmill_modes.yaml"
EULER = "integration={method: semi_implicit_euler, step_ms: 0.25}"
STAYING = "scenario.belt.start_s=30", "scenario.belt.stop_s=40"  # a belt at rest


def experiment(*settings: str, requests: str = "", seconds: float = 5.0) -> Experiment:
    return load_experiment(
        "treadmill_start_stop",
        [
            f"table={TABLE}",
            "modes=twin",
            "initial_mode=standing",
            f"requests=[{requests}]",
            f"duration_s={seconds}",
            *settings,
        ],
    ).experiment


@cache
def run(*settings: str, requests: str = "", seconds: float = 5.0) -> Run:
    return simulate(experiment(*settings, requests=requests, seconds=seconds))


def visited(done: Run) -> list[tuple[int, str]]:
    """Modes with the ticks in which they were entered; the first one is that of tick 0."""
    codes = done.log["mode"].to_numpy().astype(int)
    ticks = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist()]
    assert done.experiment.modes is not None
    return [(tick, done.experiment.modes.phase_names[codes[tick]]) for tick in ticks]


WALK = "walk@0.5s, sit@1s, stop@1.4s, twin_care@2.2s, sit@3s, stop@14s, sit@16s, sit@19.5s"


def test_the_device_stands_walks_and_stands_on_request():
    done = run(requests=WALK, seconds=20.0)
    assert done.trip is None and done.verdict.outcome == "walked"
    modes = visited(done)
    assert [name for _, name in modes] == [
        *("standing", "walk_manual", "stopping", "standing", "twin_care", "stopping", "standing"),
        "sit_down",
    ]
    assert [tick for tick, _ in modes[:5]] == [0, 500, 1400, 1900, 2200]
    first = next(item for item in done.switches if item.target == "first_swing")
    assert first.tick == 2200  # commands to walk and to step in the same tick
    last = max(item.tick for item in done.switches if "swing" in item.source)
    assert modes[6][0] > last and modes[6][0] >= 14_500  # stands once no leg has been in the air for 0.5 s


def test_rejected_requests_state_the_reason():
    done = run(requests=WALK, seconds=20.0)
    expected: list[tuple[str, str, str, tuple[str, ...]]] = [
        ("walk", "standing", "walk_manual", ()),
        ("sit", "walk_manual", "walk_manual", ("walk_manual", "sit", "stand", "step", "stop")),
        ("stop", "walk_manual", "stopping", ()),
        ("twin_care", "standing", "twin_care", ()),
        ("sit", "twin_care", "twin_care", ("twin_care", "sit", "stand", "stop")),
        ("stop", "twin_care", "stopping", ()),
        ("sit", "standing", "standing", ("standing", "0.807 s", "3 s")),
        ("sit", "standing", "sit_down", ()),
    ]
    for item, (request, before, after, facts) in zip(done.request_results, expected, strict=True):
        assert (item.request, item.mode_before, item.mode_after) == (request, before, after)
        assert bool(item.rejection) == bool(facts) and states(item.rejection, *facts), item


def test_an_early_request_to_sit_states_the_time_of_standing():
    done = run(*STAYING, requests="sit@2.999s, sit@3s", seconds=3.5)
    early, late = done.request_results
    assert states(early.rejection, "standing", "2.999 s", "3 s")
    expected = f"sit at 2.999 s: {early.rejection}"
    assert summarise_run(done)["requests_rejected"] == expected
    assert f"  rejected: {expected}" in report(summarise_run(done))
    assert late.mode_after == "sit_down" and late.time == 3.0


def test_both_legs_enter_a_posture_in_the_tick_in_which_the_mode_begins():
    done = run(*STAYING, requests="gravity@1s", seconds=1.5)
    sent = [item for item in done.switches if item.cause == POSTURE]
    assert {(item.tick, item.side, item.target) for item in sent} == {
        (1000, side, "gravity") for side in done.sides
    }
    for side in done.sides:
        stiffness = done.log[f"{side}_knee_stiffness_Nm_per_rad"].to_numpy()
        assert stiffness[1000] == stiffness[999] > 0.0 == stiffness[1200]  # faded, not cut


def test_a_requested_step_is_taken_once():
    done = run(*STAYING, requests="walk@0.5s, step@1s, step@1.1s, step@3.3s, stop@5s", seconds=7.0)
    lifted = [item.tick for item in done.switches if item.target == "first_swing"]
    assert lifted[0] == 1000
    modes = visited(done)
    assert modes[2:4] == [(1000, "manual_step"), (1001, "walk_manual")]
    assert states(done.request_results[2].rejection, "legs_in_swing < 0.5", "1")
    walking = [item for item in done.switches if 1001 < item.tick < 3300]
    assert not [item for item in walking if item.source == "stand" and "swing" in item.target]


def test_waiting_for_a_step_does_not_time_out_a_phase():
    limit = "control.safety.phase_timeout_s=1"
    assert run(*STAYING, limit, requests="walk@0.1s", seconds=2.5).trip is None


@pytest.mark.parametrize("request_", ["walk@0.5s", "gravity@0.5s", "twin_care@0.5s", "walk_automatic@0.5s"])
def test_a_trip_leads_to_the_hold_which_has_no_exit(request_):
    fault = "faults=[encoder_missing:left_knee@0.8s]"
    done = run(*STAYING, fault, requests=f"{request_}, stop@1s, stand@1.2s", seconds=1.5)
    assert done.trip is not None
    assert visited(done)[-1] == (done.trip.tick, "hold")
    for item, name in zip(done.request_results[1:], ("stop", "stand"), strict=True):
        assert states(item.rejection, "hold", name)


@pytest.mark.parametrize(
    ("requests", "sent"),
    [("walk@0.1s, step@0.15s, sit@0.2s, stop@0.25s", 0), ("gravity@0.1s, stand@0.2s", 4)],
)
def test_the_reference_engine_does_the_same(requests, sent):
    given = experiment(*STAYING, EULER, requests=requests, seconds=0.3)
    plain = simulate(dataclasses.replace(given, engine=Engine.PINOCCHIO))
    compiled = simulate(given)
    assert len([item for item in plain.switches if item.cause == POSTURE]) == sent
    assert plain.switches == compiled.switches and len(plain.request_results) == requests.count("@")
    assert plain.request_results == compiled.request_results
    names = [name for name in plain.log if plain.log[name].dtype == float]
    np.testing.assert_allclose(plain.log[names], compiled.log[names], rtol=1e-9, atol=1e-9)


def test_a_run_with_modes_is_kept_and_read_back(tmp_path):
    done = run(*STAYING, requests="gravity@1s", seconds=1.5)
    kept = read_stored_run(done.save(tmp_path / "run")).run
    assert kept.switches == done.switches and kept.request_results == done.request_results
    names = ["mode", "request", "rejected"]
    np.testing.assert_array_equal(kept.log[names], done.log[names])


@pytest.mark.slow  # compiles the loop of the lanes
def test_in_lockstep_each_lane_has_its_own_mode():
    schedules = ["walk@0.1s, step@0.15s, stop@0.4s", "gravity@0.2s", "twin_care@0.1s", "sit@0.3s"]
    given = [
        experiment(*STAYING, requests=schedules[number % 4], seconds=0.6) for number in range(MIN_BLOCK_SIZE)
    ]
    alone = [CompiledEngine(build_setup(item)).run() for item in given]
    lanes = LaneEngine([CompiledEngine(build_setup(item)) for item in given]).run()
    for one, other in zip(alone, lanes, strict=True):
        assert one.switches == other.switches
        np.testing.assert_array_equal(log_matrix(one), log_matrix(other))


def test_a_lean_that_is_held_makes_a_step_and_no_shorter_one():
    """With the pitch of the trunk in the place of what the guided pelvis has."""
    problem = build_setup(experiment(*STAYING, requests="walk_automatic@0.01s", seconds=0.75))

    def pitch(one):
        tick = len(ticks)
        ticks.append(tick)
        return math.radians(10.0) if 50 <= tick < 249 or tick >= 300 else math.radians(9.0)

    ticks: list[int] = []
    kernel = {**PinocchioKernel(problem.world, problem.control_model).functions, "trunk_pitch": pitch}
    engine = ReferenceEngine(problem, kernel=kernel)
    result = engine.run()
    codes = result.log["mode"].to_numpy(dtype=int)
    names = problem.experiment.modes.phase_names
    entered = [(tick, names[codes[tick]]) for tick in (np.flatnonzero(np.diff(codes)) + 1).tolist()]
    # 199 ticks are not enough; of the second lean the 200th tick is 499.
    assert entered[:3] == [(10, "walk_automatic"), (499, "automatic_step"), (500, "walk_automatic")]
    assert [item.tick for item in result.switches if item.target == "first_swing"] == [499]


# ------------------------------------------------------------------ what an experiment refuses


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["table=treadmill_start_stop"], ("posture", "sitting", "twin", "none", "sit")),
        (["modes=null"], ("walk@1s", "modes", "twin")),
        (["requests=[run@1s]"], ("run@1s", "stand", "sit")),
        (["requests=[walk at 1]"], ("REQUEST@TIMEs",)),
        (["requests=[walk@1s, stop@1s]"], ("walk@1s",)),
        (["initial_mode=flying"], ("initial_mode", "sitting", "sit_up", "flying")),
    ],
)
def test_inconsistent_modes_are_refused(settings, message):
    with raises(TwinGaitError, *message):
        experiment(*settings, requests="walk@1s")
