"""Tests that after a trip or the Stop of the operator the belt stops and the harness locks without a fall."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from numpy.testing import assert_allclose

from twin_gait import load_experiment, simulate
from twin_gait.configuration.documents import experiment_document
from twin_gait.control.safety import TripCause
from twin_gait.core.belt import Belt, treadmill_speed
from twin_gait.exceptions import TwinGaitError
from twin_gait.gait.table import TICK
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.simulation.log import state_columns
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.viewer.animation import _belt_track
from twin_gait.viewer.environment import BELT_MARK_SPACING
from twin_gait.worlds.faults import SUPPLY_FAULTS, FaultKind, parse_fault

BELT = Belt(cruise=0.42, start=2.0, stop=10.0, ramp=1.0, delay=0.2, stop_ramp=0.5)
EVEN = Belt(cruise=0.42, stop_ramp=0.5)
STOPS, STRIDE = 40, 2100  # ticks of a stride of the guided walk
SETTLED = 1000  # ticks after which a loaded foot rests
RUNS_ON = ("scenario.stop_ramp_s=null", "scenario.support.lock_stiffness_N_per_m=0")


# ---------------------------------------------------------------------- the belt


@pytest.mark.parametrize("belt", [BELT, EVEN])
@pytest.mark.parametrize("trip_time", [1.0, 2.6, 5.0, 10.9, math.inf])
def test_a_trip_brings_a_belt_to_rest(belt, trip_time):
    times = np.arange(14001) * TICK
    speeds = np.array([treadmill_speed(belt, time, trip_time) for time in times])
    free = [treadmill_speed(belt, time, math.inf) for time in times]
    assert (speeds == free)[times <= trip_time].all()
    if math.isfinite(trip_time):
        assert not speeds[times > trip_time + 0.5 + TICK].any()
        assert (np.diff(speeds[times > trip_time]) <= 0.0).all()


def test_a_belt_without_a_stop_ramp_keeps_running_after_a_trip():
    on = replace(EVEN, stop_ramp=math.inf)
    assert treadmill_speed(on, 9.0, 1.0) == on.cruise


def test_pictures_of_a_held_walk_show_a_belt_at_rest():
    run = simulate(
        load_experiment("treadmill_guided", ["duration_s=3", "faults=['motor_dead:left_hip@1s']"]).experiment
    )
    track, speed = _belt_track(run.log["belt_speed_m_per_s"].to_numpy()), run.experiment.scenario.belt_speed
    # The minimum-jerk ramp is symmetric: it goes half as far as the belt would have gone.
    behind = -track.values[track.times >= 2.0, 0]
    assert behind == pytest.approx(speed * (run.trip.time + 0.25) % BELT_MARK_SPACING, abs=1e-3)


# ---------------------------------------------------------------------- stops and faults


@pytest.fixture(scope="module")
def walk():
    return SteppedRun(build_setup(load_experiment("treadmill_guided", ["duration_s=20"]).experiment))


def column(run, name, first=0):
    return run.rows(first)[:, run.layout.names.index(name)]


def feet(run, tick):
    """Return load [N] and speed [m/s] of each foot: the faster of heel and toe that touch the belt."""
    model, layout, rows = run.setup.world.model, run.layout, run.rows(tick - 1)
    postures = rows[:2, [layout.names.index(name) for name in state_columns(model)[0]]]
    found = []
    for side, leg in model.legs.items():
        ways = [[model.frame_position(q, name) for q in postures] for name in leg.contact_frames]
        speeds = [abs(after[0] - before[0]) / TICK for before, after in ways if after[2] < 0.0]
        found.append((rows[1, layout.names.index(f"{side}_foot_normal_force_N")], max(speeds, default=0.0)))
    return found


@pytest.mark.slow
def test_forty_stops_spread_over_the_stride_end_in_no_fall(walk):
    for moment in range(3000, 3000 + STRIDE, STRIDE // STOPS):
        walk.restart()
        walk.advance(moment)
        assert walk.status is RunStatus.COMPLETED and walk.trip is None
        walk.stop()
        walk.advance(3000)  # with a belt that runs on the falls came within 2.6 s
        assert walk.status is RunStatus.COMPLETED, (moment, walk.reason)
        for load, speed in feet(walk, moment + SETTLED):
            assert load < CONTACT_FORCE or speed < 0.02, (moment, load, speed)


TARGETS = {FaultKind.FOOT_LOAD_STUCK: ":left_foot", **dict.fromkeys(SUPPLY_FAULTS, "")}


MOMENTS = (3000, 3500, 4200, 4800)


@pytest.mark.parametrize("kind", [kind for kind in FaultKind if kind is not FaultKind.CONTROLLER_RUNAWAY])
def test_no_other_fault_makes_the_wearer_fall(walk, kind):
    for moment in MOMENTS:
        walk.restart()
        walk.advance(moment)
        walk.inject(parse_fault(f"{kind}{TARGETS.get(kind, ':left_knee')}@0s"))
        walk.advance(5000)
        assert walk.status is RunStatus.COMPLETED, (moment, walk.reason)
        trip = walk.trip
        if trip is not None and trip.tick + SETTLED < walk.tick:
            assert max(feet(walk, trip.tick + SETTLED))[1] < 0.02, moment


def test_a_controller_that_runs_away_with_a_knee_is_held_before_the_wearer_falls(walk):
    """The monitor detects a command that leaves its setpoint (page faults); without it one case fell."""
    for moment in MOMENTS:
        walk.restart()
        walk.advance(moment)
        walk.inject(parse_fault(f"{FaultKind.CONTROLLER_RUNAWAY}:left_knee@0s"))
        walk.advance(5000)
        assert walk.status is RunStatus.COMPLETED, moment
        assert walk.trip is not None and walk.trip.cause is TripCause.SETPOINT, moment
        assert max(feet(walk, walk.trip.tick + 2 * SETTLED))[1] < 0.02, moment


def test_without_belt_and_harness_a_stop_is_a_fall():
    run = SteppedRun(build_setup(load_experiment("treadmill_guided", ["duration_s=20", *RUNS_ON]).experiment))
    run.advance(3000)
    run.stop()
    run.advance(3000)
    assert run.status is RunStatus.FELL


# ---------------------------------------------------------------------- the harness


@pytest.mark.parametrize("engine", ["compiled", pytest.param("pinocchio", marks=pytest.mark.slow)])
def test_the_harness_is_a_spring_that_only_pulls_up_and_the_energy_is_accounted_for(engine):
    # So little support, and so long, that the wearer sinks into the harness from whichever phase.
    settings = [
        "scenario.support.share=0.3",
        "duration_s=2.5",
        "faults=['encoder_missing:left_knee@0.5s']",
        f"engine={engine}",
    ]
    settings += ["integration={method: rk4, step_ms: 0.1}"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    log, trip, support = run.log, run.trip.tick, run.experiment.scenario.support
    height, velocity = log["pelvis_height_m"].to_numpy(), log["pelvis_velocity_m_per_s"].to_numpy()
    depth = np.where(np.arange(len(log)) >= trip, height[trip] - height, 0.0).clip(0.0)
    caught = support.lock_stiffness * depth * (1.0 - support.lock_dissipation * velocity).clip(0.0)
    carried = support.share * run.body_weight - support.damping * velocity
    assert_allclose(log["support_force_N"], carried + caught, atol=1e-9)
    assert caught.max() > 0.05 * run.body_weight and caught.min() == 0.0
    energy = (log["kinetic_energy_J"] + log["potential_energy_J"]).to_numpy()
    works = log.filter(regex="_work_J$").sum(axis=1).to_numpy()
    assert np.abs(energy - energy[0] - works).max() < 1e-4


def test_a_start_after_a_stop_is_the_first_walk_again_bit_for_bit(walk):
    walk.restart()
    first = walk.advance(4000).copy()
    walk.stop()
    walk.advance(500)
    walk.restart()
    assert np.array_equal(walk.advance(4000), first)


# ---------------------------------------------------------------------- parameters


def test_parameters_are_read_checked_and_written():
    settings = ["scenario.stop_ramp_s=0.8", "scenario.support.lock_stiffness_N_per_m=5000"]
    experiment = load_experiment("treadmill_guided", settings).experiment
    assert experiment.scenario.stop_ramp == 0.8 and experiment.scenario.support.lock_stiffness == 5000.0
    on = replace(experiment, scenario=replace(experiment.scenario, stop_ramp=math.inf))
    for item, expected in ((experiment, 0.8), (on, None)):
        assert experiment_document(item)["scenario"]["stop_ramp_s"] == expected


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("stop_ramp_s=0", ("scenario.stop_ramp_s", "0", "3600")),
        (
            "support.lock_stiffness_N_per_m=-1",
            ("scenario.support.lock_stiffness_N_per_m", "0", "-1"),
        ),
        (
            "support.lock_dissipation_s_per_m=-1",
            ("scenario.support.lock_dissipation_s_per_m", "0", "-1"),
        ),
    ],
)
def test_parameters_out_of_range_are_refused_in_one_line(setting, message):
    with raises(TwinGaitError, *message) as caught:
        load_experiment("treadmill_guided", [f"scenario.{setting}"])
    assert "\n" not in str(caught.value)
