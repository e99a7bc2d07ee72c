"""Number of Python calls of an episode, of a run and of a slider's move.

The counts do not depend on the speed of the machine. They grow if an object is built that is never read, or
if the same object is built twice. The limits were set 20 % above the counts at that time.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from twin_gait.configuration.experiments import load_experiment
from twin_gait.live.protocol import SetControl
from twin_gait.live.session import LiveSession
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.studies.batch import simulate_batch

EPISODE, RUN, MOVE = 7_210, 55, 78_700


def python_calls(act: Callable[[], Any]) -> int:
    """Return the number of Python functions that an action enters when all caches are filled."""
    act()
    entered = 0

    def count(frame: Any, event: str, argument: Any) -> None:
        nonlocal entered
        entered += event == "call"

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        act()
    finally:
        sys.setprofile(before)
    return entered


def test_an_episode_of_a_batch_is_cheap() -> None:
    experiment = load_experiment("treadmill_guided", ["duration_s=20"]).experiment

    def batch(episodes: int) -> None:
        changes = [
            {
                "patient.mass_kg": 70.0 + number,
                "table.phases.late_stance.hip.stiffness_Nm_per_deg": 1.0 + number,
            }
            for number in range(episodes)
        ]
        simulate_batch(experiment, changes)

    calls = {episodes: python_calls(lambda episodes=episodes: batch(episodes)) for episodes in (1, 3)}
    assert (calls[3] - calls[1]) / 2 < EPISODE, calls


def test_a_run_without_a_log_makes_no_table() -> None:
    problem = build_setup(load_experiment("bench_leg", ["duration_s=1"]).experiment)
    engine = CompiledEngine(problem)
    start = engine.store.copy()

    def run() -> None:
        engine.store[:] = start
        engine.point_at_rows()
        engine.episode["recording"]["on"] = False
        assert len(engine.run().columns) == 0

    assert python_calls(run) < RUN


@pytest.mark.parametrize("kind", ["set", "try"])
def test_a_slider_rebuilds_only_the_changed_parts(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = LiveSession(
        loaded=load_experiment("treadmill_guided", ["duration_s=60"]), folder=tmp_path / "walk"
    )
    session._prepare()
    walk, outcomes = SteppedRun(session.panel.simulation_setup), []
    walk.advance(3000)
    answer = {"snapshot": walk.snapshot(), "tick": walk.tick}
    monkeypatch.setattr(session.walk, "send_command", lambda command: answer)
    monkeypatch.setattr(
        session.event_log, "answer", lambda message, outcome, *more, **about: outcomes.append(outcome)
    )
    values = iter((1.0, 1.1))

    def move() -> None:
        name = "late_stance.hip.stiffness"
        assert session._work(SetControl(id="1", kind=kind, control=name, value=next(values)))

    assert python_calls(move) < MOVE
    assert outcomes == ["applied" if kind == "set" else "forecast"] * 2
