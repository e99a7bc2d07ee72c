"""The machine over recorded walks: closed forms, our own runs, healthy walking."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from errors import raises
from table_builder import phase, transition, two_phase_table

from twin_gait import load_experiment, save_run, simulate
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.exceptions import GaitTableError, ParameterError
from twin_gait.gait.scaling import scale_table
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.reference import CYCLE, WINTER_CYCLE_TIME, reference_curve, reference_cycle_time
from twin_gait.parameters.wearer import Patient
from twin_gait.replay.machine import Replay, replay, replay_log
from twin_gait.replay.recording import normative_walk
from twin_gait.replay.samples import Recording, resample_to_ticks
from twin_gait.replay.writing import allowed_cycles, stride_phases, summarise_replay
from twin_gait.report.pages import render
from twin_gait.vocabulary import JointName, Side

HIP, KNEE = JointName.HIP, JointName.KNEE
THRESHOLD, AMPLITUDE, PERIOD = math.radians(10.0), math.radians(30.0), 1.6


def one_leg(hip: np.ndarray, **changes) -> Recording:
    angles = {(Side.LEFT, HIP): hip, (Side.LEFT, KNEE): np.zeros_like(hip)}
    return Recording(**{"source": "log", "start": 0.0, "angles": angles, "loads": {}, "phases": {}} | changes)


def two_way_table() -> GaitTable:
    """Stance while the hip is below 10 degrees, swing above."""
    return GaitTable(
        name="two_ways",
        joints=("hip", "knee"),
        phases={"stance": phase(), "swing": phase()},
        transitions=(
            transition("stance", "swing", "hip.angle_deg > 10"),
            transition("swing", "stance", "hip.angle_deg < 10"),
        ),
    )


def crossings(duration: float) -> list[float]:
    """Instants at which a sine of the hip passes 10 degrees, from its inverse."""
    first = math.asin(THRESHOLD / AMPLITUDE) / (2.0 * math.pi) * PERIOD
    instants = [first + n * PERIOD for n in range(9)] + [0.5 * PERIOD - first + n * PERIOD for n in range(9)]
    return sorted(instant for instant in instants if instant < duration)


def sine(time: np.ndarray) -> np.ndarray:
    return AMPLITUDE * np.sin(2.0 * np.pi * time / PERIOD)


def test_switches_come_at_the_first_tick_after_the_crossing():
    result = replay(one_leg(sine(np.arange(4000) * TICK)), two_way_table())
    expected = [math.floor(instant / TICK) + 1 for instant in crossings(4.0)]
    assert [switch.tick for switch in result.switches] == expected
    assert [switch.target for switch in result.switches[:2]] == ["swing", "stance"]
    assert np.flatnonzero(np.diff(result.phases[Side.LEFT])).tolist() == [tick - 1 for tick in expected]


@pytest.mark.parametrize("rate", [50.0, 128.0, 4000.0])
def test_a_log_of_another_rate_switches_at_the_same_instants(rate):
    time = np.arange(round(4.0 * rate) + 1) / rate
    recording = resample_to_ticks(
        Recording("log", 0.0, {(Side.LEFT, HIP): sine(time), (Side.LEFT, KNEE): 0.0 * time}, {}, {}), time
    )
    assert recording.n_ticks == 4001
    result = replay(recording, two_way_table())
    found = [switch.time for switch in result.switches]
    # Up to a tick until the crossing is seen; on this sine PCHIP is off by 0.007 degrees at 50 Hz, which at
    # 111 degrees/s is another 0.06 ms.
    np.testing.assert_allclose(found, crossings(4.0), atol=1.07 * TICK)


def test_the_velocity_equals_the_filter_of_the_firmware():
    speed = math.radians(40.0)
    recording = one_leg(speed * np.arange(50) * TICK, fast_time_constant=0.005)
    result = replay(recording, two_way_table())
    # Step response of a first-order filter, exact at the samples.
    expected = speed * (1.0 - np.exp(-np.arange(50) * TICK / 0.005))
    np.testing.assert_allclose(result.velocities[Side.LEFT, HIP], expected, rtol=1e-10)


def test_samples_on_the_ticks_are_kept_bit_for_bit():
    time = 17.3 + np.arange(200) * TICK
    hip = np.random.default_rng(3).uniform(-1.0, 1.0, size=200)
    recording = resample_to_ticks(Recording("log", 0.0, {(Side.LEFT, HIP): hip}, {}, {}), time)
    assert (recording.angles[Side.LEFT, HIP] == hip).all()
    np.testing.assert_allclose(recording.time, time, atol=1e-9)


def test_interpolation_meets_every_sample_and_overshoots_none():
    time = np.arange(21) * 0.01
    hip = np.where(time < 0.1, 0.0, 0.5)  # a step, where a cubic spline would overshoot
    names = np.array(["stance" if instant < 0.1 else "swing" for instant in time], dtype=object)
    recording = resample_to_ticks(
        Recording("log", 0.0, {(Side.LEFT, HIP): hip}, {}, {Side.LEFT: names}), time
    )
    values = recording.angles[Side.LEFT, HIP]
    np.testing.assert_allclose(values[::10], hip, atol=1e-12)
    assert values.min() >= 0.0 and values.max() <= 0.5
    phases = recording.phases[Side.LEFT]
    assert phases[99] == "stance" and phases[100] == "swing"


# ---------------------------------------------------------------------- our own runs


@pytest.fixture(scope="module", params=["ideal", "encoder and noise"])
def walk(request):
    settings = ["duration_s=5"]
    if request.param != "ideal":
        settings += ["sensors.ideal=false", "sensors.angle_noise_rad=0.0002"]
    return simulate(load_experiment("treadmill_guided", settings).experiment)


def recorded(run) -> Recording:
    angles = {
        (side, joint): run.log[f"{side}_{joint}_measured_angle_rad"].to_numpy()
        for side in run.sides
        for joint in run.table.joints
    }
    phases = {side: run.log[f"{side}_phase"].to_numpy(dtype=object) for side in run.sides}
    starts = dict(run.experiment.build_world().initial_phases)
    constant = run.experiment.sensors.fast_time_constant
    return Recording("run", 0.0, angles, {}, phases, starts=starts, fast_time_constant=constant)


def test_a_run_gives_the_same_switches_again(walk):
    result = replay(recorded(walk), walk.table)
    assert len(walk.switches) > 10
    assert result.switches == walk.switches
    for side, numbers in summarise_replay(result)["sides"].items():
        assert numbers["equal_share"] == 1.0
        for joint in walk.table.joints:
            logged = walk.log[f"{side}_{joint}_velocity_fast_rad_per_s"].to_numpy()
            assert (result.velocities[side, joint] == logged).all()


def test_the_directory_of_a_run_has_its_table_scaled_to_the_wearer(tmp_path):
    settings = ["duration_s=5", "patient.height_m=1.6", "scenario.belt_speed_km_per_h=1.3"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    save_run(run, tmp_path / "run", pictures=False)
    for table in (None, "treadmill_guided"):
        assert replay_log(str(tmp_path / "run"), table=table).switches == run.switches


def test_a_run_whose_legs_were_held_is_replayed_up_to_the_trip(tmp_path):
    settings = ["duration_s=5", "faults=[encoder_missing:left_knee@3.2s]"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    save_run(run, tmp_path / "run", pictures=False)
    result = replay_log(str(tmp_path / "run"))
    assert run.trip is not None and result.recording.n_ticks == run.trip.tick == 3200
    assert result.switches == run.switches
    assert {numbers["equal_share"] for numbers in summarise_replay(result)["sides"].values()} == {1.0}


@pytest.mark.parametrize(
    ("preset", "settings", "trips"),
    [
        ("treadmill_start_stop", ["duration_s=12", "scenario.belt.stop_s=7"], False),
        pytest.param("sit_to_stand", ["duration_s=10"], False, marks=pytest.mark.slow),
        pytest.param("sit_to_stand", ["faults=[encoder_missing:left_knee@8s]"], True, marks=pytest.mark.slow),
    ],
)
def test_a_run_is_replayed_with_the_commands_of_belt_and_modes(tmp_path, preset, settings, trips):
    run = simulate(load_experiment(preset, settings).experiment)
    save_run(run, tmp_path / "run", pictures=False)
    result = replay_log(str(tmp_path / "run"))
    assert len(run.switches) > 7 and (run.trip is not None) == trips
    assert result.switches == run.switches
    text = render("replay.txt", summarise_replay(result))
    assert "taken as" not in text and text.count("100.0 % of the ticks equal") == 2
    assert ("1 × sit → lean (posture)" in text) == (preset == "sit_to_stand")


def test_a_table_without_the_postures_of_a_run_is_refused(tmp_path):
    run = simulate(load_experiment("sit_to_stand", ["duration_s=1"]).experiment)
    save_run(run, tmp_path / "run", pictures=False)
    with raises(ParameterError, "treadmill_guided", "postures", "none"):
        replay_log(str(tmp_path / "run"), table="treadmill_guided")


def test_another_threshold_moves_the_switches_and_lowers_the_share_of_equal_ticks(walk):
    leave = next(item for item in walk.table.transitions if item.cause == "clearance")
    hip, *others = leave.guard.guards
    later = replace(leave, guard=replace(leave.guard, guards=(_raised(hip), *others)))
    transitions = tuple(later if item is leave else item for item in walk.table.transitions)
    result = replay(recorded(walk), replace(walk.table, transitions=transitions))
    assert 0.9 < summarise_replay(result)["sides"]["left"]["equal_share"] < 1.0


def _raised(comparison):
    return replace(comparison, threshold=comparison.threshold + 1.0)


def test_a_one_legged_run_gives_the_same_switches_again():
    run = simulate(load_experiment("bench_leg", ["duration_s=4"]).experiment)
    result = replay(recorded(run), run.table)
    assert len(run.switches) > 5
    assert result.switches == run.switches


def test_a_run_of_a_device_of_one_leg_is_replayed_on_this_leg(tmp_path):
    """The wearer's own gait moves the other leg, whose angles the log has, too."""
    run = simulate(load_experiment("knee_orthosis", ["duration_s=3"]).experiment)
    assert "right_knee_angle_rad" in run.log
    save_run(run, tmp_path / "run", pictures=False)
    result = replay_log(str(tmp_path / "run"))
    assert [*result.phases] == [*summarise_replay(result)["sides"]] == [Side.LEFT]
    assert len(run.switches) > 5
    assert result.switches == run.switches


# ---------------------------------------------------------------------- healthy walking


def cycle_time_at(speed: float) -> float:
    """Of the regression, at a speed in km/h."""
    return reference_cycle_time(speed / 3.6, Patient().height)


def assert_walks(result: Replay, cycle_time: float) -> None:
    """Every stride has all five phases, by its thresholds rather than by timeouts, in the walk's time."""
    for side in result.recording.sides:
        strides = stride_phases(result.phases[side])
        assert len(strides) >= 2
        assert {phases for _, _, phases in strides} == {(0, 1, 2, 3, 4)}
        times = [(end - start) * TICK for start, end, _ in strides]
        np.testing.assert_allclose(times, cycle_time, atol=2.0 * TICK)
    assert not any(result.table.transitions[switch.transition].is_timeout for switch in result.switches)


@pytest.mark.parametrize("speed", [0.75, 1.0, 1.5, 3.0, 5.0])
def test_healthy_walking_passes_through_all_five_phases_of_the_treadmill_table(speed):
    walk = normative_walk(f"koopman@{speed}", strides=4)
    assert_walks(replay(walk, load_gait_table("treadmill_guided")), cycle_time_at(speed))


def test_healthy_walking_at_1_5_km_per_h_changes_phase_as_documented():
    walk = normative_walk("koopman@1.5", strides=3)
    switches = replay(walk, load_gait_table("treadmill_guided")).switches
    entries = {item.target: item.time for item in switches if item.side is Side.LEFT}  # the last of each
    share = {name: 100.0 * (instant / cycle_time_at(1.5) % 1.0) for name, instant in entries.items()}
    # Heel contact is at 0 %.
    assert {name: round(percent) for name, percent in share.items()} == {
        "middle_stance": 10,
        "late_stance": 55,
        "swing_flexion": 60,
        "swing_extension": 82,
        "early_stance": 95,
    }


def test_slower_walking_needs_a_table_whose_steps_shorten_with_the_speed():
    walk = normative_walk("koopman@0.5", strides=4)
    written = load_gait_table("treadmill_guided")
    shortening = replace(written, scaling=replace(written.scaling, speed_exponent=0.12))
    scaled = scale_table(shortening, carried_mass=None, speed=0.5 / 3.6)
    assert_walks(replay(walk, scaled), cycle_time_at(0.5))
    # As it is written no swing begins; with the law that it states swings end by their timeout.
    assert not any(switch.cause == "trailing_limb" for switch in replay(walk, written).switches)
    stated = scale_table(written, carried_mass=None, speed=0.5 / 3.6)
    assert any(switch.cause == "timeout" for switch in replay(walk, stated).switches)


def test_faster_walking_passes_through_the_table_of_the_bench_too():
    walk = normative_walk("koopman@4", strides=4)
    assert_walks(replay(walk, load_gait_table("bench_leg")), cycle_time_at(4.0))


def test_the_walk_of_winter_passes_as_it_is():
    walk = normative_walk("winter", strides=4)
    assert_walks(replay(walk, load_gait_table("treadmill_guided")), WINTER_CYCLE_TIME)


def test_the_normative_walk_is_the_regression_with_the_legs_half_a_stride_apart():
    walk = normative_walk("koopman@1.5", strides=2)
    ticks = np.array([0, 321, 900])
    percent = np.mod(ticks * TICK / cycle_time_at(1.5), 1.0) * CYCLE
    for side, lead in ((Side.LEFT, 0.0), (Side.RIGHT, 50.0)):
        expected = reference_curve(KNEE, percent + lead, speed=1.5 / 3.6, height=Patient().height)
        np.testing.assert_allclose(walk.angles[side, KNEE][ticks], expected, atol=1e-12)


def test_the_walk_of_winter_meets_the_table_and_closes_its_cycle():
    walk = normative_walk("winter", strides=3)
    knee = np.degrees(walk.angles[Side.LEFT, KNEE])
    mid_swing = round(0.72 * WINTER_CYCLE_TIME / TICK)
    assert knee[mid_swing] == pytest.approx(64.86, abs=0.02)  # printed at 72 %
    assert np.abs(np.diff(knee)).max() < 0.4  # [deg] a tick: no step at heel contact
    assert len(knee) == pytest.approx(3 * WINTER_CYCLE_TIME / TICK, abs=1.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("koopman@fast", ("koopman@", "km/h")),
        ("koopman@nan", ("koopman@", "km/h")),
        ("koopman@", ("koopman@", "km/h")),
        ("koopman@9", ("speed", "0.14", "1.39 m/s")),
        ("koopman@-1", ("speed", "0.14", "1.39 m/s")),
    ],
)
def test_a_walk_that_the_literature_has_not_is_refused(name, message):
    with raises(ParameterError, *message):
        normative_walk(name)


# ---------------------------------------------------------------------- what a table needs


@pytest.mark.parametrize(
    ("condition", "changes", "message"),
    [
        ("other.hip.angle_deg > 3", {}, ("other.hip.angle_deg", "stance", "swing", "why")),
        ("other.phase in [swing]", {}, ("other.phase", "stance", "swing", "why")),
        (
            "knee.angle_deg > 3",
            {"angles": {(Side.LEFT, HIP): np.zeros(5)}},
            ("knee.angle_deg", "left"),
        ),
        ("foot.load_bw > 0.1", {}, ("foot.load_bw", "--columns")),
        (
            "trunk.pitch_deg > 3",
            {},
            ("trunk.pitch_deg", "--columns"),
        ),
        ("foot.load_bw > 0.1", {"loads": {Side.LEFT: np.zeros(5)}}, ("foot.load_bw", "--total-mass")),
    ],
)
def test_a_signal_that_the_log_lacks_is_named_with_its_transitions(condition, changes, message):
    table = two_phase_table(transition("stance", "swing", condition, cause="why"))
    with raises(GaitTableError, *message):
        replay(one_leg(np.zeros(5), **changes), table)


def test_values_assumed_for_unrecorded_signals_are_reported():
    table = two_phase_table(
        transition("stance", "swing", "walk > 0.5", cause="told"),
        transition("stance", "swing", "trunk.pitch_deg > 5", cause="lean"),
    )
    recording = one_leg(np.zeros(100), device={"trunk.pitch_deg": np.zeros(100)})
    result = replay(recording, table)
    assert result.assumed == {"walk": 1.0}
    text = render("replay.txt", summarise_replay(result))
    assert "not in the log, assumed: walk 1\n" in text


def test_a_recorded_trunk_opens_guards():
    table = two_phase_table(transition("stance", "swing", "trunk.pitch_deg > 5"))
    pitch = np.radians(np.linspace(0.0, 10.0, 101))
    recording = one_leg(np.zeros(101), device={"trunk.pitch_deg": pitch})
    (switch,) = replay(recording, table).switches
    assert switch.tick == np.flatnonzero(pitch > math.radians(5.0))[0]


def test_a_joint_that_no_guard_reads_may_be_missing():
    recording = one_leg(sine(np.arange(2000) * TICK), angles={(Side.LEFT, HIP): sine(np.arange(2000) * TICK)})
    assert len(replay(recording, two_way_table()).switches) == len(crossings(2.0))


def test_the_load_of_the_foot_counts_in_body_weights():
    load = np.where(np.arange(100) < 40, 500.0, 60.0)
    table = two_phase_table(transition("stance", "swing", "foot.load_bw < 0.1", cause="unloaded"))
    recording = one_leg(np.zeros(100), loads={Side.LEFT: load})
    assert [item.tick for item in replay(replace(recording, body_weight=700.0), table).switches] == [40]
    lighter = replace(recording, body_weight=500.0)  # 60 N is more than a tenth then
    assert replay(lighter, table).switches == ()


def test_the_start_phase_is_the_requested_one_then_the_recorded_one_then_the_first():
    hip = np.full(5, -0.1)
    swinging = np.array(["swing"] * 5, dtype=object)
    table = two_phase_table(transition("stance", "swing", "hip.angle_deg > 10"))

    def first(recording: Recording) -> int:
        return int(replay(recording, table).phases[Side.LEFT][0])

    assert first(one_leg(hip)) == 0
    assert first(one_leg(hip, phases={Side.LEFT: swinging})) == 1
    assert first(one_leg(hip, phases={Side.LEFT: swinging}, starts={Side.LEFT: "stance"})) == 0
    unknown = np.array(["ES"] * 5, dtype=object)
    assert first(one_leg(hip, phases={Side.LEFT: unknown})) == 0


# ---------------------------------------------------------------------- agreement and strides


def test_equal_ticks_are_counted():
    hip = np.where((np.arange(100) >= 40) & (np.arange(100) < 80), 0.5, 0.0)  # swing from 40 to 80
    names = np.array(["stance"] * 30 + ["swing"] * 55 + ["flight"] * 5 + ["stance"] * 10, dtype=object)
    result = replay(one_leg(hip, phases={Side.LEFT: names}), two_way_table())
    assert summarise_replay(result)["sides"]["left"]["equal_share"] == 0.8


def test_strides_begin_where_the_first_phase_is_entered():
    phases = np.array([0, 0, 1, 2, 0, 1, 2, 2, 0, 1, 0, 1])
    strides = stride_phases(phases)
    assert strides == [(4, 8, (0, 1, 2)), (8, 10, (0, 1))]
    assert stride_phases(np.zeros(9, dtype=int)) == []


def test_stated_cycles_of_a_table_are_used():
    table = two_way_table()
    assert allowed_cycles(table) == {(0, 1)}
    assert allowed_cycles(replace(table, cycles=(("swing", "stance"),))) == {(0, 1)}
