"""Events of a run: the same events from a run in memory and from its directory."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin_gait import load_experiment, simulate
from twin_gait.configuration.experiments import experiment_from_mapping
from twin_gait.control.safety import Trip, TripCause
from twin_gait.live.journal import LogChunk, walked_document, walked_run
from twin_gait.measures.outcome import EventKind, trip_time
from twin_gait.runs.record import read_stored_run, write_run
from twin_gait.simulation.run import RunStatus, run_events
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.worlds.faults import parse_fault

INJECTED, NEVER = "encoder_freeze:right_knee@0.7s", "supply_dip@1.4s"


@pytest.fixture(scope="module")
def tripped():
    settings = [f"faults=[{INJECTED!r}, {NEVER!r}]", "duration_s=1.5"]
    run = simulate(load_experiment("bench_leg", settings).experiment)
    assert run.trip is not None
    return run


def test_fault_and_trip_are_events_at_their_times(tripped):
    fault, trip, dip = tripped.events
    assert (fault.kind, fault.time, fault.cause, fault.location) == (
        "fault",
        0.7,
        "encoder freeze",
        "right knee",
    )
    assert trip.time == tripped.trip.time > fault.time
    assert trip.text == "trip: encoder frozen, right knee"
    assert dip.text == "fault: supply dip"  # it has no place
    stop = Trip(1, TripCause.OPERATOR, None, None)
    (event,) = run_events((), stop, RunStatus.COMPLETED, 1.0)
    assert event.text == "trip: operator"  # who is the place as well
    assert trip_time(tripped.events) == trip.time


def test_the_trip_is_the_first_tick_of_the_hold_in_the_log(tripped):
    held = tripped.log["time_s"][tripped.log["safety_state"] > 0]
    assert held.iloc[0] == pytest.approx(trip_time(tripped.events), abs=1e-9)


def test_a_run_directory_has_the_same_events(tripped, tmp_path):
    write_run(tripped, tmp_path, pictures=False)
    stored = read_stored_run(tmp_path)
    assert stored.run.trip == tripped.trip
    assert stored.run.events == tripped.events


def test_a_fault_after_the_end_did_not_strike(tripped):
    assert len(run_events(tripped.experiment.faults, None, RunStatus.FELL, 1.0)) == 2
    fault, fall = run_events(tripped.experiment.faults, None, RunStatus.FELL, 1.0)
    assert fault.kind is EventKind.FAULT and fall == (EventKind.FALL, 1.0, "", "")


@pytest.mark.parametrize(
    ("status", "kinds"), [("completed", []), ("interrupted", []), ("diverged", ["divergence"])]
)
def test_a_run_that_went_well_has_no_events(status, kinds):
    events = run_events((), None, RunStatus(status), 2.0)
    assert [event.kind for event in events] == kinds
    assert trip_time(events) is None


@pytest.mark.slow
def test_a_fault_injected_in_a_live_walk_is_one_of_its_events(tmp_path):
    given = "faults=['supply_dip@1.4s']"  # later than the end of the walk
    loaded = load_experiment("bench_leg", [given, "duration_s=1.5"])
    problem = build_setup(loaded.experiment)
    run = SteppedRun(problem)
    run.advance(730)
    run.inject(parse_fault("encoder_offset:right_hip@0s=-8deg"))
    run.advance(300)
    struck = {"time_s": 0.73, "fault": "encoder_offset:right_hip=-8deg"}
    piece = LogChunk(
        rows=run.rows(), switches=run.switches(), events=(struck,), status=run.status,
        reason=run.reason, trip=run.trip,
    )  # fmt: skip
    document = walked_document(piece, loaded.document)
    kept = walked_run(piece, problem, experiment_from_mapping(document, "experiment", Path()))
    fault, trip = kept.events
    assert (fault.kind, fault.time, fault.text) == ("fault", 0.73, "fault: encoder offset, right hip")
    assert trip.time == kept.trip.time >= 0.73
    write_run(kept, tmp_path, document=document, pictures=False)
    stored = read_stored_run(tmp_path).run
    assert stored.events == kept.events
    written = (tmp_path / "experiment.yaml").read_text()
    assert written.count("encoder_offset") == 1  # it stands among the events, and not among the faults too
