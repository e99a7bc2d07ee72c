"""From standing to walking and back: the belt, the command, and the table that follows them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from numpy.testing import assert_allclose

from twin_gait import RunStatus, load_experiment, simulate
from twin_gait.core.belt import belt_speed, walk_command
from twin_gait.exceptions import MeasurementError, ParameterFileError
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.table import TICK, Scaling
from twin_gait.measures.leg_record import leg_record
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.run import log_table
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.viewer.animation import _belt_track
from twin_gait.viewer.environment import BELT_MARK_SPACING
from twin_gait.vocabulary import FIRST_SWING, STAND, Side

START, STOP, RAMP = 2.0, 9.0, 1.5  # [s]
CRUISE = 0.42  # [m/s]
LEAST_LOAD = 0.1  # of the weight of wearer and device that either foot carries who stands on both
AT_EASE = 2.0  # [s] after the last step


def walk(*settings, source="treadmill_start_stop"):
    return simulate(load_experiment(source, settings).experiment)


def commands(start, stop, duration):
    return (f"scenario.belt.start_s={start}", f"scenario.belt.stop_s={stop}", f"duration_s={duration}")


def targets(run, cause):
    return [switch for switch in run.switches if switch.cause == cause]


def foot_positions(run, first, last):
    """Forward place of heels and toes in [m] at two ticks, shape ``(2, 4)``."""
    model = run.experiment.build_world().model
    frames = [name for leg in model.legs.values() for name in leg.contact_frames]
    rows = []
    for tick in (first, last):
        q = np.zeros(model.nv)
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                q[model.index(side, joint)] = run.log[f"{side}_{joint}_angle_rad"].iloc[tick]
        rows.append([model.frame_position(q, name)[0] for name in frames])
    return np.array(rows)


# ---------------------------------------------------------------------- the belt


def test_belt_rests_before_and_after_and_runs_evenly_in_between():
    def speed(time):
        return belt_speed(time, CRUISE, START, STOP, RAMP)

    assert {speed(time) for time in (0.0, START, STOP + RAMP, 20.0)} == {0.0}
    assert {speed(time) for time in (START + RAMP, 5.0, STOP)} == {CRUISE}
    # Both ramps are symmetric, so together they go as far as one of them at full speed.
    assert sum(map(speed, np.arange(14000) * TICK)) * TICK == pytest.approx(CRUISE * (STOP - START))
    assert speed(START + 0.5 * RAMP) == pytest.approx(0.5 * CRUISE)
    assert belt_speed(1e6, CRUISE, START, math.inf, RAMP) == CRUISE
    steps = np.diff([speed(tick * TICK) for tick in range(12000)])
    # Steepest slope of a minimum-jerk ramp: 15 / 8 of its mean.
    assert np.abs(steps).max() <= 15.0 / 8.0 * CRUISE / RAMP * TICK * (1.0 + 1e-9)


def test_walk_command_is_on_from_start_to_stop():
    commands = [
        walk_command(time, START, STOP) for time in (0.0, START - TICK, START, STOP - TICK, STOP, 99.0)
    ]
    assert commands == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


def test_log_has_the_speed_of_the_belt_and_marks_in_the_page_go_its_way():
    run = walk()
    scenario, speed = run.experiment.scenario, run.log["belt_speed_m_per_s"].to_numpy()
    belt = scenario.belt
    wanted = [
        belt_speed(tick * TICK - belt.delay, scenario.belt_speed, belt.start, belt.stop, belt.ramp)
        for tick in range(len(speed))
    ]
    assert speed.tolist() == wanted
    assert replace(scenario, belt=None).steady == (0.0, math.inf)
    track, way = _belt_track(speed), np.cumsum(speed) * TICK
    times, positions = track.times, track.values[:, 0]
    assert (np.diff(times) > 0.0).all()
    for time in (1.0, 5.0, 9.3, 19.0):
        assert -np.interp(time, times, positions) == pytest.approx(
            way[round(time / TICK)] % BELT_MARK_SPACING, abs=1e-3
        )


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("scenario.belt.stop_s=2.5", ("scenario.belt", "stop", "start")),
        ("scenario.belt.ramp_s=0", ("scenario.belt.ramp_s", "0")),
        ("scenario.belt.delay_s=-1", ("scenario.belt.delay_s", "-1")),
        ("scenario.belt.end_s=9", ("scenario.belt.end_s", "delay_s")),
    ],
)
def test_an_impossible_belt_is_refused_in_one_line(setting, words):
    with raises(ParameterFileError, *words) as caught:
        load_experiment("treadmill_start_stop", [setting])
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------------- the command


def test_a_leg_without_a_walk_command_walks():
    """The table of stand on a belt without a profile moves the legs as its five walking phases do."""
    ankle = "plant.ankle={stiffness_Nm_per_rad: 200, rest_deg: 0}"  # as the table was found
    settings = ["duration_s=3", "table=treadmill_start_stop", "scenario.support.guide=vertical", ankle]
    experiment = load_experiment("treadmill_guided", [*settings, "engine=pinocchio"]).experiment
    cycle = experiment.table.cycles[0]
    assert len(cycle) == 5 and STAND not in cycle
    walking = replace(
        experiment.table,
        phases={name: experiment.table.phases[name] for name in cycle},
        transitions=tuple(
            item
            for item in experiment.table.transitions
            if {item.source, item.target} <= set(cycle) and "walk" not in str(item.guard)
        ),
        scaling=replace(experiment.table.scaling, stance_phases=cycle[:3]),
        cycles=(cycle,),
        waivers=(),
    )
    plain, table = simulate(replace(experiment, table=walking)), simulate(experiment)
    assert len(plain.switches) > len(cycle)
    assert [item[:4] for item in table.switches] == [item[:4] for item in plain.switches]
    numbers = plain.log.select_dtypes("number").columns
    assert table.log[numbers].equals(plain.log[numbers])


def test_a_nan_command_is_refused():
    machine = GaitStateMachine(load_experiment("treadmill_start_stop").experiment.table, Side.LEFT)
    still = dict.fromkeys(machine.table.signals, 0.0)
    with raises(MeasurementError, "left", "walk", "nan"):
        machine.step(1, {**still, "walk": math.nan}, STAND)


def test_standing_still_neither_creeps_nor_steps_without_the_command():
    run = walk("scenario.belt.start_s=20", "scenario.belt.stop_s=30", "duration_s=8")
    assert run.status is RunStatus.COMPLETED and run.trip is None  # though 8 s is long for a phase
    assert [item.target for item in run.switches] == [STAND]  # the second leg joins the first at once
    moved = np.abs(np.diff(foot_positions(run, 4000, 7999), axis=0))
    assert moved.max() < 2e-3  # [m] in 4 s; the regularised friction of the soles lets them creep a little


# ---------------------------------------------------------------------- start, walk, stop


def assert_stands_on_both_feet(run):
    assert run.status is RunStatus.COMPLETED and run.trip is None
    last, weight = run.log.iloc[-1], run.experiment.build_world().body_weight
    for side in run.sides:
        assert last[f"{side}_phase"] == STAND
        assert last[f"{side}_foot_normal_force_N"] > LEAST_LOAD * weight
    assert last["belt_speed_m_per_s"] == 0.0
    assert run.switches[-1].time < run.duration - AT_EASE


PEOPLE = {
    "the default wearer": (),
    "the other leg first": ("scenario.leading=right",),
    "light and tall": ("patient.mass_kg=55", "patient.height_m=1.9"),
    "heavy and short": ("patient.mass_kg=95", "patient.height_m=1.6"),
}


@pytest.mark.parametrize(
    "settings",
    [
        *(pytest.param(settings, id=name) for name, settings in PEOPLE.items()),
        pytest.param(("patient=healthy",), marks=pytest.mark.slow, id="with an own effort"),
    ],
)
@pytest.mark.parametrize("stop", [6.0, 6.7])
def test_wearer_starts_walks_and_stands_again_without_a_fall(settings, stop):
    run = walk(*commands(1.0, stop, stop + 5.0), *settings)
    assert_stands_on_both_feet(run)
    leading = run.experiment.scenario.leading
    assert [item.side for item in targets(run, "first_step")] == [leading]
    assert len(targets(run, "closing_step")) <= 2
    assert not [item for item in run.switches if item.time < 1.0 and item.target != STAND]


def test_no_phase_ends_by_its_timeout():
    run = walk(*commands(1.0, 7.0, 11.0))
    assert not targets(run, "timeout")


def test_strides_are_counted_while_the_belt_runs_evenly():
    run = walk(*commands(1.0, 8.5, 12.0))
    ((first, last),) = run.steady_spans
    for side in run.sides:
        record = leg_record(run.log, side, run.table.phase_names, TICK, steady=run.steady_spans)
        strides = record.strides(skip=0)
        assert len(strides) < len(record.contacts.heel_strikes) - 1  # there were more
        assert strides[0, 0] * TICK >= first and strides[-1, 1] * TICK <= last
        values = summarise_run(run)["sides"][side]
        assert values["strides"] == len(strides)
        assert values["phases_in_order"] is True


def test_engines_agree_from_standing_to_standing():
    settings = (
        "sensors.ideal=true",
        "integration.method=rk4",
        "integration.step_s=0.0005",
        "scenario.belt.ramp_s=0.6",
        "scenario.belt.delay_s=0",
        *commands(0.1, 1.2, 3.0),
    )
    compiled, python = (walk(*settings, f"engine={name}") for name in ("compiled", "pinocchio"))
    assert compiled.switches == python.switches
    assert {FIRST_SWING, STAND} < {item.target for item in compiled.switches}
    for side in compiled.sides:
        for joint in ("hip", "knee", "ankle"):
            column = f"{side}_{joint}_angle_rad"
            assert_allclose(compiled.log[column], python.log[column], rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_a_walk_in_chunks_follows_the_belt():
    problem = build_setup(load_experiment("treadmill_start_stop", commands(0.5, 3.0, 4)).experiment)
    run = SteppedRun(problem)
    while run.tick < 4000:
        run.advance(min(370, 4000 - run.tick))
    whole = simulate(problem.experiment)
    assert log_table(run.rows(), run.layout, problem.table).equals(whole.log)


@pytest.mark.slow
def test_another_speed_in_a_walk_in_chunks_keeps_the_ramps():
    experiment = load_experiment("treadmill_start_stop", commands(0.5, 9.0, 3)).experiment
    # Without scaling the table is the same at both speeds.
    experiment = replace(experiment, table=replace(experiment.table, scaling=Scaling()))
    slower = 0.8 * experiment.scenario.belt_speed
    run = SteppedRun(build_setup(experiment))
    run.set({**run.numbers, "belt_speed": slower}, fade_ticks=0)
    run.advance(3000)
    whole = simulate(replace(experiment, scenario=replace(experiment.scenario, belt_speed=slower)))
    assert log_table(run.rows(), run.layout, experiment.table).equals(whole.log)
