"""A run that is advanced piece by piece and changed in between."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises

from twin_gait.configuration.experiments import load_experiment
from twin_gait.control.safety import TripCause
from twin_gait.exceptions import ParameterError
from twin_gait.simulation import stepping
from twin_gait.simulation.run import RunStatus, log_table
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.simulator import simulate
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.worlds.faults import parse_fault

LATE_STANCE, SWING_FLEXION = "late_stance", "swing_flexion"


@pytest.fixture(scope="module")
def bench():
    return build_setup(load_experiment("bench_leg", ["duration_s=6"]).experiment)


@pytest.fixture(scope="module")
def treadmill():
    return build_setup(load_experiment("treadmill_guided", ["duration_s=4"]).experiment)


def column(run, name, first=0):
    return run.rows(first)[:, run.layout.names.index(name)]


def change(run, fade_ticks=stepping.FADE_TICKS, **numbers):
    """Set some of the numbers of a run, and leave the others."""
    run.set({**run.numbers, **numbers}, fade_ticks=fade_ticks)


def minimum_jerk(s):
    """Flash and Hogan (1985), written out anew."""
    s = np.clip(s, 0.0, 1.0)
    return 10 * s**3 - 15 * s**4 + 6 * s**5


def phase_codes(run, side):
    return column(run, f"{side}_phase").astype(int)


# ---------------------------------------------------------------------- nothing changed


def test_a_walk_in_chunks_equals_the_single_run_bit_for_bit(treadmill):
    run, generator = SteppedRun(treadmill), np.random.default_rng(0)
    while run.tick < 4000:
        before = run.tick
        rows = run.advance(int(min(generator.integers(1, 300), 4000 - run.tick)))
        assert len(rows) == run.tick - before
    whole = simulate(treadmill.experiment)
    assert log_table(run.rows(), run.layout, treadmill.table).equals(whole.log)
    assert run.switches() == whole.switches


def test_noise_equals_the_noise_of_the_whole_run():
    experiment = load_experiment(
        "bench_leg", ["duration_s=2", "sensors.ideal=false", "sensors.angle_noise_rad=1e-4", "seed=5"]
    ).experiment
    problem = build_setup(experiment)
    run = SteppedRun(problem)
    for _ in range(200):
        run.advance(10)
    assert log_table(run.rows(), run.layout, problem.table).equals(simulate(experiment).log)


def test_a_restarted_walk_is_the_same_walk(bench):
    run = SteppedRun(bench)
    first = run.advance(1500).copy()
    run.push(1, 30.0, 5000)
    run.inject(parse_fault("encoder_jump:right_knee@0s"))
    run.advance(500)
    assert run.trip is not None
    run.restart()
    assert (run.tick, run.trip) == (0, None)
    np.testing.assert_array_equal(run.advance(1500), first)


def test_rows_are_kept_until_they_are_dropped(bench):
    run = SteppedRun(bench)
    pieces = [run.advance(ticks).copy() for ticks in (300, 1, 0, 250)]
    np.testing.assert_array_equal(run.rows(), np.concatenate(pieces))
    np.testing.assert_array_equal(run.rows(299), np.concatenate(pieces)[299:])
    assert run.rows(551).shape == (0, len(run.layout.names))
    run.discard_rows(300)
    np.testing.assert_array_equal(run.rows(), np.concatenate(pieces)[300:])


# ---------------------------------------------------------------------- parameters


def test_new_parameters_fade_in_by_the_minimum_jerk_law_tick_by_tick(bench):
    run = SteppedRun(bench)
    # A phase that lasts longer than its own fade, which would not look at the table again.
    while run.tick < 3000 and not lasts(run, 80):
        run.advance(10)
    changed = bench.phase_rows.copy()
    changed[:, :, :8] *= 1.25
    first, phase = run.tick, phase_codes(run, "right")[-1]
    change(run, 40, phase_rows=changed.tolist())
    run.advance(60)
    same = phase_codes(run, "right")[first:] == phase
    shares = minimum_jerk(np.arange(1, 61) / 40)
    for parameter_column, name in ((4, "knee_stiffness_Nm_per_rad"), (6, "knee_equilibrium_rad")):
        old, new = bench.phase_rows[0, phase, parameter_column], changed[0, phase, parameter_column]
        seen = column(run, f"right_{name}", first)
        np.testing.assert_allclose(seen[same], (old + shares * (new - old))[same], rtol=1e-12)
    assert same[:40].all()  # else the test would have looked at nothing


def lasts(run, ticks):
    codes = phase_codes(run, "right") if run.tick else np.zeros(0)
    return len(codes) > ticks and len(set(codes[-ticks:].tolist())) == 1


def test_new_parameters_reach_phases_that_come_later_and_change_the_walk(bench):
    changed = bench.phase_rows.copy()
    changed[:, :, 4] *= 1.1
    plain, run = SteppedRun(bench), SteppedRun(bench)
    change(run, 0, phase_rows=changed.tolist())
    plain.advance(4000)
    run.advance(4000)
    assert run.trip is None
    codes, stiffness = phase_codes(run, "right"), column(run, "right_knee_stiffness_Nm_per_rad")
    steady = [np.flatnonzero(codes == code)[-1] for code in set(codes.tolist())]
    steady = [tick for tick in steady if len(set(codes[tick - 70 : tick + 1].tolist())) == 1]
    assert len(steady) >= 3
    np.testing.assert_allclose(stiffness[steady], changed[0, codes[steady], 4], rtol=1e-12)
    assert np.abs(run.rows()[-1] - plain.rows()[-1]).max() > 1e-3


def test_a_table_set_at_the_start_walks_as_an_experiment_with_that_table():
    small = load_experiment(
        "bench_leg", ["duration_s=3", "table.phases.swing_flexion.knee.equilibrium_deg=55"]
    )
    theirs = build_setup(small.experiment)
    run = SteppedRun(build_setup(load_experiment("bench_leg", ["duration_s=3"]).experiment))
    change(run, 0, phase_rows=theirs.phase_rows.tolist())
    run.restart()
    run.advance(3000)
    assert log_table(run.rows(), run.layout, theirs.table).equals(simulate(small.experiment).log)


def test_higher_thresholds_delay_a_leg_and_do_not_change_other_runs_of_the_setup(bench):
    late, plain = SteppedRun(bench), SteppedRun(bench)
    later = [{**item, "threshold": item["threshold"] + 0.02} for item in late.numbers["comparisons"]]
    change(late, comparisons=later)
    for run in (late, plain, after := SteppedRun(bench)):
        run.advance(1500)
    assert late.switches()[0].tick > plain.switches()[0].tick
    np.testing.assert_array_equal(after.rows(), plain.rows())


def test_target_torque_is_added_to_the_command(bench):
    run = SteppedRun(bench)
    run.advance(200)
    change(run, 100, target_torque=[0.0, -3.0])
    run.advance(150)
    seen = column(run, "right_knee_target_torque_Nm", 200)
    np.testing.assert_allclose(seen, -3.0 * minimum_jerk(np.arange(1, 151) / 100), atol=1e-12)
    parts = ("impedance", "friction_compensation", "gravity_compensation", "inertia_compensation", "target")
    total = sum(column(run, f"right_knee_{part}_torque_Nm") for part in parts)
    np.testing.assert_allclose(column(run, "right_knee_motor_command_torque_Nm"), total, atol=1e-12)


# ---------------------------------------------------------------------- world


def test_a_push_is_in_the_log_for_just_its_ticks_and_moves_the_joint(bench):
    plain, run = SteppedRun(bench), SteppedRun(bench)
    for each in (plain, run):
        each.advance(305)
    run.push(1, 7.5, 123)
    for each in (plain, run):
        each.advance(400)
    pushed = column(run, "right_knee_external_torque_Nm")
    assert np.flatnonzero(pushed).tolist() == list(range(305, 428))
    assert set(pushed[305:428].tolist()) == {7.5}
    assert column(run, "right_knee_disturbance_torque_Nm").tolist() == pushed.tolist()
    assert not column(run, "right_knee_voluntary_torque_Nm").any()
    # The tick after the first with the push: the torque over the inertia, by the leg's own mass matrix.
    model = bench.world.model
    index = bench.joints[1].coordinate
    q = np.zeros(model.nv)
    for joint in bench.joints:
        q[joint.coordinate] = column(run, f"{joint.side}_{joint.joint}_angle_rad")[305]
    gained = (
        column(run, "right_knee_velocity_rad_per_s")[306]
        - column(plain, "right_knee_velocity_rad_per_s")[306]
    )
    expected = 7.5e-3 * np.linalg.inv(model.mass_matrix(q))[index, index]
    assert gained == pytest.approx(expected, rel=0.02)  # friction grows with the velocity that is gained


def test_the_work_of_a_push_is_counted(bench):
    run = SteppedRun(bench)
    run.advance(100)
    run.push(0, 12.0, 200)
    run.advance(400)
    velocity = column(run, "right_hip_velocity_rad_per_s")
    work = 12.0 * np.trapezoid(velocity[100:301], dx=1e-3)
    assert column(run, "external_work_J")[-1] == pytest.approx(work, rel=1e-4)


def test_belt_and_support_change_the_forces_on_the_feet(treadmill):
    run = SteppedRun(treadmill)
    run.advance(300)
    force = column(run, "support_force_N")
    change(run, 50, support_force=0.5 * treadmill.world.support_force)
    run.advance(200)
    spring = column(run, "support_force_N")[-1] + 90.0 * column(run, "pelvis_velocity_m_per_s")[-1]
    assert spring == pytest.approx(0.5 * treadmill.world.support_force, rel=1e-9)
    assert force[0] == pytest.approx(treadmill.world.support_force)
    change(run, 100, belt_speed=0.0)
    run.advance(1500)
    hips = (
        column(run, "left_hip_angle_rad", run.tick - 300),
        column(run, "right_hip_angle_rad", run.tick - 300),
    )
    stance = [np.ptp(hip) for hip in hips]
    assert min(stance) < math.radians(1.0)  # a foot on a belt that stands keeps its hip where it is


@pytest.mark.parametrize("kind", ["motor_dead:right_knee", "encoder_offset:right_hip", "supply_dip"])
def test_a_fault_that_is_injected_is_the_fault_of_an_experiment(kind):
    experiment = load_experiment("bench_leg", ["duration_s=1.5"]).experiment
    run = SteppedRun(build_setup(experiment))
    run.advance(730)
    run.inject(parse_fault(f"{kind}@0s"))
    run.advance(770)
    faulty = simulate(replace(experiment, faults=(parse_fault(f"{kind}@0.73s"),)))
    assert log_table(run.rows(), run.layout, run.setup.table).equals(faulty.log)
    assert run.trip == faulty.trip


def test_a_fault_that_does_not_fit_and_one_too_many_are_refused(bench):
    run = SteppedRun(bench)
    with raises(ParameterError, "right_hip", "right_knee", "left_knee"):
        run.inject(parse_fault("motor_dead:left_knee@0s"))
    with raises(ParameterError, stepping.MOST_FAULTS):
        for _ in range(stepping.MOST_FAULTS + 1):
            run.inject(parse_fault("supply_dip@0s=0.1V"))


# ---------------------------------------------------------------------- steps by hand, stop


def test_a_held_leg_waits_for_its_release_and_waits_again_after_that_step(bench):
    held = bench.table.phase_index(LATE_STANCE)
    run = SteppedRun(bench)
    change(run, held_phase=held)
    while not run.waiting_legs() and run.tick < 4000:
        run.advance(10)
    assert run.waiting_legs() == (0,)
    run.advance(6000)  # longer than the monitor lets a leg stay in a phase
    assert (phase_codes(run, "right")[-1], run.trip) == (held, None)
    let_go = run.tick
    run.release()
    run.advance(20)
    assert bench.table.phase_names[phase_codes(run, "right")[-1]] == SWING_FLEXION
    run.advance(5000)
    assert run.waiting_legs() == (0,)
    left = [item.tick for item in run.switches() if item.source == LATE_STANCE]
    assert len(left) == 1 and let_go <= left[0] < let_go + 20
    change(run, held_phase=None)
    run.advance(500)
    assert phase_codes(run, "right")[-1] != held


def test_a_stop_holds_the_joints_from_the_next_tick_on_and_is_not_taken_back(bench):
    run = SteppedRun(bench)
    run.advance(905)
    run.stop()
    run.advance(1000)
    run.stop()
    assert (run.trip.tick, run.trip.cause, run.trip.location) == (905, TripCause.OPERATOR, "operator")
    assert np.flatnonzero(column(run, "safety_state")).tolist() == list(range(905, 1905))
    for joint in ("hip", "knee"):
        hold = column(run, f"right_{joint}_impedance_torque_Nm")[906:]
        velocity = column(run, f"right_{joint}_velocity_rad_per_s")[905:-1]
        damping = bench.experiment.control.safety.hold_damping
        # The drive infers the speed from the tick before.
        np.testing.assert_allclose(hold, -damping * velocity, atol=1e-9)
    assert run.status is RunStatus.COMPLETED


def test_a_fallen_walk_does_not_continue():
    # The monitor would trip, and the harness catch the wearer.
    unwatched = ["duration_s=4", "control.safety.enabled=false"]
    run = SteppedRun(build_setup(load_experiment("treadmill_guided", unwatched).experiment))
    rows = run.setup.phase_rows.copy()
    rows[:, :, [0, 1, 4, 5]] = 0.0  # legs without springs and dampers
    change(run, 0, phase_rows=rows.tolist())
    run.advance(5000)
    fell = run.tick
    assert run.status is RunStatus.FELL and fell < 5000
    assert len(run.advance(10)) == 0 and run.tick == fell
    assert "fell below" in run.reason


# ---------------------------------------------------------------------- moments


def test_another_run_continues_from_a_snapshot_bit_for_bit_without_changing_the_first(treadmill):
    undisturbed, run, other = SteppedRun(treadmill), SteppedRun(treadmill), SteppedRun(treadmill)
    changed = treadmill.phase_rows * 1.02
    for one in (undisturbed, run):
        one.advance(1700)
        change(one, phase_rows=changed.tolist(), belt_speed=0.4)
        one.push(1, 5.0, 150)
        one.advance(100)  # in the middle of the fades and of the push
    other.advance(333)
    other.stop()
    other.restore(json.loads(json.dumps(run.snapshot())))
    rows = run.advance(1500)
    np.testing.assert_array_equal(other.advance(1500), rows)
    np.testing.assert_array_equal(undisturbed.advance(1500), rows)
    later = [item for item in run.switches() if item.tick >= 1800]
    assert list(other.switches()) == later and later and other.trip is None


def test_a_released_manual_step_is_released_in_the_copy(bench):
    run, other = SteppedRun(bench), SteppedRun(bench)
    late = bench.table.phase_index(LATE_STANCE)
    change(run, held_phase=late)
    while not run.waiting_legs():
        run.advance(10)
    run.release()
    other.restore(run.snapshot())
    np.testing.assert_array_equal(run.advance(4000), other.advance(4000))
    assert run.waiting_legs() == other.waiting_legs() == (0,)
