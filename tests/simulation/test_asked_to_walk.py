"""Only the time in modes that walk counts for the outcome and for strides."""

from __future__ import annotations

import pytest
from errors import states

from twin_gait import load_experiment, simulate
from twin_gait.vocabulary import Outcome


def run_of(*requests: str, duration: float = 20.0):
    settings = [
        f"duration_s={duration}",
        "modes=twin",
        "initial_mode=standing",
        f"requests=[{', '.join(requests)}]",
    ]
    return simulate(load_experiment("overground", settings).experiment)


def test_without_a_walk_command_there_is_no_stall():
    run = run_of(duration=6.0)
    assert run.verdict.outcome is None
    assert states(run.verdict.reason, "walk")
    assert all(len(leg.strides(skip=0)) == 0 for leg in run.leg_records())


def test_strides_count_from_the_request_on_and_standing_before_it_does_not_stall():
    request_time = 7.0  # longer than the longest stride of a walk
    run = run_of(f"walk_automatic@{request_time:g}s")
    ((first, last),) = run.steady_spans
    assert first == pytest.approx(request_time, abs=2e-3) and last == pytest.approx(run.duration, abs=2e-3)
    assert run.verdict.outcome is Outcome.WALKED
    assert all(len(leg.strides(skip=0)) > 2 for leg in run.leg_records())


def test_a_walk_by_steps_of_the_therapist_does_not_stall_while_they_are_waited_for():
    run = run_of("walk@1s", *(f"step@{time}s" for time in (2, 4, 6, 13, 15, 17)), "stop@19s", duration=20.0)
    assert run.verdict == (Outcome.WALKED, "")
    assert len(run.steady_spans) == 1 and all(len(leg.strides(skip=0)) > 1 for leg in run.leg_records())


def test_without_step_requests_of_the_therapist_there_is_no_walk():
    assert run_of("walk@1s", duration=8.0).verdict.outcome is None
