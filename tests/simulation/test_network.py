"""Tests of boards and gait controller over a CAN bus: received values, their age, silence."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from log_rows import log_matrix, run_result

from twin_gait import load_experiment, simulate
from twin_gait.checking.check import build_case, check
from twin_gait.cli.simulate import report
from twin_gait.control.safety import TripCause
from twin_gait.core.can_bus import NEVER
from twin_gait.core.safety import hold_weight_share
from twin_gait.files import shipped_file
from twin_gait.network.dbc import load_messages
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.compiled_engine import CompiledEngine, assemble, kernel_names
from twin_gait.simulation.lane_engine import LaneEngine, block_key
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
CYCLE = 2  # [ticks]
SILENCE = 20  # [ticks], both silences by default
WORST = (
    "loss: 0.1, jitter_us: 700, delay_ms: 3, error_share: 0.05, clock_drift_ppm: {left_hip: 3000}, "
    "phase_us: {right_knee: 1500}, outages: ['silence:left_knee@0.2s=5ms', 'bus_off:right_hip@0.3s', "
    "'reboot:right_knee@0.45s=0.1s']"
)
AT_ONCE = "table.blending.duration_ms=0"


def problem_of(network: str, *settings: str) -> SimulationSetup:
    return build_setup(load_experiment("treadmill_guided", [f"network={network}", *settings]).experiment)


def walk(network: str, *settings: str) -> Run:
    return simulate(load_experiment("treadmill_guided", [f"network={network}", *settings]).experiment)


def columns(run: Run, name: str) -> np.ndarray:
    return np.array([run.log[f"{joint}_{name}"].to_numpy() for joint in JOINTS])


def hold_tick(run: Run) -> int:
    """Return the first tick in which every joint is braked and no spring acts."""
    damping = run.experiment.control.safety.hold_damping
    held = columns(run, "damping_Nms_per_rad") == damping
    held &= columns(run, "stiffness_Nm_per_rad") == 0.0
    return int(np.flatnonzero(held.all(axis=0))[0])


def frames_of(run: Run) -> list[dict[str, float]]:
    assert run.traffic is not None
    return list(run.traffic["frames"].values())


# ------------------------------------------------------------------ one law, many engines


@pytest.mark.slow
@pytest.mark.parametrize("impedance", ["board", "ccu"])
def test_plain_python_machine_code_and_pinocchio_agree_on_a_bus_with_every_fault(impedance):
    problem = problem_of(f"{{impedance: {impedance}, {WORST}}}", "duration_s=0.6")
    compiled = CompiledEngine(problem).run()
    plain = ReferenceEngine(problem, kernel=kernel_names(assemble(problem)[0])).run()
    reference = ReferenceEngine(problem).run()
    assert log_matrix(compiled).tobytes() == log_matrix(plain).tobytes()
    assert run_result(compiled) == run_result(plain) == run_result(reference)
    assert compiled.trip is not None
    assert all(frame["lost"] > 0 and frame["destroyed"] > 0 for frame in frames_of(compiled))
    np.testing.assert_allclose(log_matrix(compiled), log_matrix(reference), rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_lanes_equal_their_single_runs():
    def problem(number: int) -> SimulationSetup:
        draw = np.random.default_rng(number)
        outage = ("silence@0.3s", "bus_off:right_hip@0.4s", "reboot:right_knee@0.6s=0.1s")[number % 3]
        network = (
            f"{{loss: {draw.uniform(0.0, 0.3):.2f}, jitter_us: {draw.integers(0, 900)}, error_share: 0.05, "
            f"delay_ms: {draw.integers(0, 20)}, outages: ['{outage}']}}"
        )
        return problem_of(network, f"duration_s={draw.uniform(0.7, 1.2):.3f}", f"seed={number}")

    problems = [problem(number) for number in range(16)]
    engines = [CompiledEngine(item) for item in problems]
    assert len({block_key(engine) for engine in engines}) == 1
    results = LaneEngine(engines).run()
    for item, result in zip(problems, results, strict=True):
        alone = CompiledEngine(item).run()
        assert log_matrix(alone).tobytes() == log_matrix(result).tobytes()
        assert run_result(alone) == run_result(result)
    assert len({result.trip for result in results}) > 5


# ------------------------------------------------------------------ how old things are


@pytest.mark.parametrize("delay", [0, 5])
def test_a_board_follows_a_switch_with_the_delay_of_its_frame(delay):
    """Setpoints are written in even ticks and received one tick and the delay later."""
    run = walk(f"{{delay_ms: {delay}}}", "duration_s=6", AT_ONCE)
    assert len(run.switches) > 20
    before = {"left": -100, "right": -100}
    for switch in run.switches:
        apart, before[switch.side] = switch.tick - before[switch.side], switch.tick
        if apart <= CYCLE + delay:
            continue  # the board has not received the previous one
        received = 2 * math.ceil(switch.tick / CYCLE) + 1 + delay
        stiffness = run.log[f"{switch.side}_knee_stiffness_Nm_per_rad"].to_numpy()
        moved = np.flatnonzero(np.diff(stiffness[switch.tick - 1 :]) != 0.0)
        if received < len(run.log):
            assert switch.tick + moved[0] == received


@pytest.mark.parametrize("delay", [0, 3])
def test_the_gait_controller_uses_measurements_of_the_stated_age(delay):
    """The torque of the springs reveals the measurement that was used, by arithmetic on the log."""
    problem = problem_of(f"{{impedance: ccu, delay_ms: {delay}}}", "duration_s=4", AT_ONCE)
    run = simulate(problem.experiment)
    layouts = load_messages()
    step = layouts["left_knee_setpoint"].signals["torque"].scale
    ticks = np.arange(100, len(run.log))
    answered = ticks - 1 - delay - (ticks - 1 - delay) % CYCLE  # tick in which the received value was written
    measured = answered - 1 - delay - (answered - 1 - delay) % CYCLE
    checked = 0
    for number, name in enumerate(JOINTS):
        side, _, _ = name.partition("_")
        signals = layouts[f"{name}_measurement"].signals
        angle, velocity = (
            np.round(run.log[f"{name}_{column}"].to_numpy()[measured] / signals[signal].scale)
            * signals[signal].scale
            for column, signal in (("measured_angle_rad", "angle"), ("velocity_fast_rad_per_s", "velocity"))
        )
        phases = run.log[f"{side}_phase"].to_numpy()[answered]
        rows = [problem.table.phase_names.index(phase) for phase in phases]
        leg, joint = divmod(number, 2)
        k, b, rest, _ = problem.phase_rows[leg][rows][:, 4 * joint : 4 * joint + 4].T
        fed = run.log[f"{name}_target_torque_Nm"].to_numpy()[ticks]
        unloaded = problem.phase_rows[leg][rows][:, -1] == 0.0  # no gravity compensation in it
        expected = -(k * (angle - rest) + b * velocity)
        within = unloaded & (np.abs(expected) < 100.0)
        # Half a step of the torque, and of the angle, whose zero is no whole number of steps.
        tolerance = 0.5 * step + k * signals["angle"].scale
        assert (np.abs(fed - expected) <= tolerance)[within].all()
        checked += int(within.sum())
    assert checked > 4000
    for frame in frames_of(run):
        assert frame["mean_age_s"] == pytest.approx(1e-3 * (1.5 + delay), abs=1e-5)
        assert frame["max_age_s"] == pytest.approx(1e-3 * (2 + delay))


def test_lost_frames_increase_the_age_of_measurements_as_a_geometric_series():
    """With a share p lost in every cycle T the mean age grows by T p / (1 - p)."""
    run = walk("{loss: 0.2}", "duration_s=20")
    assert run.traffic is not None
    mean = np.mean([frame["mean_age_s"] for frame in frames_of(run)])
    assert mean == pytest.approx(1e-3 * (1.5 + CYCLE * 0.2 / 0.8), rel=0.02)
    lost = run.traffic["lost"] / run.traffic["sent"]
    assert lost == pytest.approx(0.2, abs=5.0 * math.sqrt(0.16 / 80_000))


@pytest.mark.parametrize("delay", [2, 5, 20])
def test_missing_frames_before_the_first_cycle_cause_no_trip(delay):
    """At 20 ms the first frame arrives after the timeout of silence."""
    run = walk(f"{{delay_ms: {delay}}}", "duration_s=1")
    damping = columns(run, "damping_Nms_per_rad")
    assert (damping[:, : 1 + delay] == 0.0).all() and (damping[:, 1 + delay :] > 0.0).all()
    assert run.trip is None


# ------------------------------------------------------------------ the walk


@lru_cache
def ideal() -> Run:
    return simulate(load_experiment("treadmill_guided", ["duration_s=15"]).experiment)


@pytest.mark.parametrize("impedance", ["board", "ccu"])
def test_a_healthy_bus_hardly_changes_the_walk(impedance):
    run = walk(f"{{impedance: {impedance}}}", "duration_s=15")
    assert abs(len(run.switches) - len(ideal().switches)) <= 1
    ours, theirs = (summarise_run(item)["sides"] for item in (run, ideal()))
    for side in ("left", "right"):
        assert ours[side]["stride_time_mean_s"] == pytest.approx(theirs[side]["stride_time_mean_s"], rel=0.02)
        for joint in ("hip", "knee"):
            key = f"rmse_{joint}_by_contact_deg"
            assert ours[side][key] == pytest.approx(theirs[side][key], abs=0.5)


def test_rounding_error_depends_on_the_resolution_of_the_frames(tmp_path):
    """Steps four and sixteen times as coarse change a second of walking increasingly."""
    text = shipped_file("twin.dbc").read_text(encoding="ascii")
    equilibrium = "SG_ equilibrium : 0|14@1+ (0.0002,-0.8) [-0.8|2.4764]"
    angle = "SG_ angle : 0|19@1+ (0.000006,-0.8) [-0.8|2.345716]"
    assert equilibrium in text and angle in text
    runs = []
    for factor in (1, 4, 16):
        bits = {1: (14, 19), 4: (12, 17), 16: (10, 15)}[factor]
        path = tmp_path / f"coarse_{factor}.dbc"
        ours = f"SG_ equilibrium : 0|{bits[0]}@1+ ({0.0002 * factor:.4f},-0.8) [-0.8|2.4]"
        theirs = f"SG_ angle : 0|{bits[1]}@1+ ({0.000006 * factor:.6f},-0.8) [-0.8|2.34]"
        path.write_text(text.replace(equilibrium, ours).replace(angle, theirs), encoding="ascii")
        runs.append(walk(f"{{dbc: '{path}'}}", "duration_s=1"))
    angles = [columns(run, "angle_rad") for run in runs]
    fine, coarse = (float(np.abs(item - angles[0]).max()) for item in angles[1:])
    assert 0.0 < fine < coarse < math.radians(1.0)


def test_the_springs_on_the_gait_controller_leave_friction_compensation_on_the_boards():
    run = walk("{impedance: ccu}", "duration_s=2")
    assert (columns(run, "stiffness_Nm_per_rad") == 0.0).all()
    assert (columns(run, "impedance_torque_Nm") == 0.0).all()
    assert np.abs(columns(run, "friction_compensation_torque_Nm")).max() > 1.0
    assert np.abs(columns(run, "target_torque_Nm")).max() > 10.0


# ------------------------------------------------------------------ silence, reboots, bus-off


@pytest.mark.parametrize("count", [60, pytest.param(1_000, marks=pytest.mark.slow)])
def test_a_bus_that_goes_silent_leads_to_the_hold_within_the_stated_time(count):
    """Timeout plus a cycle: 22 ms after the start of the silence at any time."""
    problem = problem_of("{outages: ['silence@1s']}", "duration_s=2.5")
    engine = CompiledEngine(problem)
    hold, draw = problem.experiment.control.safety.hold_damping, np.random.default_rng(20)
    names = [*(f"{joint}_damping_Nms_per_rad" for joint in JOINTS), "safety_state"]
    columns = [engine.layout.names.index(name) for name in names]
    target, worst = np.array([hold] * len(JOINTS) + [1.0]), 0.0
    for moment in draw.uniform(0.05, 2.45, count):
        engine = CompiledEngine(problem)
        outage = engine.episode["network"]["bus"]["outages"][0]
        outage["start"], outage["end"] = round(moment * 1e12), NEVER
        rows = log_matrix(engine.run(columns=columns))
        held = np.flatnonzero((rows == target).all(axis=1))
        assert len(held) == len(rows) - held[0]  # and for good
        worst = max(worst, 1e-3 * held[0] - moment)
    print(f"{count} of {count} held, the last one {1e3 * worst:.3f} ms after the silence began")
    assert worst <= 1e-3 * (SILENCE + CYCLE)


def test_a_disconnected_board_holds_and_lowers_its_joint_and_the_others_follow():
    run = walk("{outages: ['silence:left_knee@0.34s']}", "duration_s=4")
    assert run.trip is not None
    assert (run.trip.cause, run.trip.location) == (TripCause.BUS, "left knee")
    fed = run.log["left_knee_gravity_compensation_torque_Nm"].to_numpy()
    alone = hold_tick(run)
    limits = build_setup(run.experiment).experiment.control.safety
    lowering = round(limits.lowering_time / 1e-3)
    board = int(np.flatnonzero(run.log["left_knee_damping_Nms_per_rad"].to_numpy() == limits.hold_damping)[0])
    assert 340 <= board <= 340 + SILENCE + CYCLE and board <= alone
    carried = fed[board - 1]
    expected = [hold_weight_share(tick, lowering) * carried for tick in range(len(fed) - board)]
    np.testing.assert_array_equal(fed[board:], expected)
    assert run.verdict.outcome == "held"


def test_a_board_in_the_hold_reports_it_and_all_legs_hold():
    """The gait controller is off the bus for longer than the timeout of boards but shorter than its own."""
    network = "{board_timeout_ms: 5, ccu_timeout_ms: 100, outages: ['silence:ccu@1s=12ms']}"
    run = walk(network, "duration_s=1.5")
    damping = columns(run, "damping_Nms_per_rad")
    hold = run.experiment.control.safety.hold_damping
    assert (damping[:, 1_008] == hold).all()
    assert run.trip is not None
    assert run.trip.cause is TripCause.BUS and 1_012 <= run.trip.tick <= 1_016


@pytest.mark.parametrize(
    ("length", "cause", "latest"), [("4ms", TripCause.DRIVE, 1_008), ("300ms", TripCause.BUS, 1_022)]
)
def test_a_board_that_reboots_gives_no_torque_meanwhile_and_holds_then(length, cause, latest):
    """The gait controller detects a short reboot by a message of the board, and a long one by the silence."""
    run = walk(f"{{outages: ['reboot:left_knee@1.0004s={length}']}}", "duration_s=1.6")
    back = 1_001 + math.ceil(float(length[:-2]) - 0.6)
    off = slice(1_001, back)
    for column in ("motor_torque_Nm", "target_current_A", "measured_current_A"):
        assert (run.log[f"left_knee_{column}"].to_numpy()[off] == 0.0).all()
    braked = run.log["left_knee_motor_torque_Nm"].to_numpy()[back : back + 20]
    assert np.abs(braked).max() > 0.0
    assert run.trip is not None
    assert (run.trip.cause, run.trip.location) == (cause, "left knee") and run.trip.tick <= latest


def test_a_reboot_within_a_tick_is_detected():
    run = walk("{outages: ['reboot:left_knee@1.0002s=0.1ms']}", "duration_s=1.2")
    assert run.trip is not None and run.trip.location == "left knee" and run.trip.tick <= 1_008


def test_a_gait_controller_that_reboots_stays_in_the_hold():
    run = walk("{outages: ['reboot:ccu@1s=5ms']}", "duration_s=1.5")
    assert run.trip is not None
    assert (run.trip.cause, run.trip.location, run.trip.tick) == (TripCause.BUS, "gait controller", 1_001)


@pytest.mark.parametrize("node", ["ccu", "right_hip"])
def test_bus_off_is_bridged_with_recovery_and_leads_to_a_hold_without(node):
    """128 runs of 11 recessive bits are 1.4 ms of an idle bus, and a few cycles of one half in use."""
    outages = f"outages: ['bus_off:{node}@1s']"
    well, ill = (walk(f"{{bus_off_recovery: {on}, {outages}}}", "duration_s=2") for on in ("true", "false"))
    assert well.trip is None and well.traffic is not None
    assert well.traffic["bus_offs"][node] == 1 and sum(well.traffic["bus_offs"].values()) == 1
    oldest = max(frame["max_age_s"] for frame in frames_of(well))
    assert 0.003 <= oldest <= 0.02
    assert ill.trip is not None and ill.trip.cause is TripCause.BUS and 1_000 < ill.trip.tick <= 1_022


def test_without_a_monitor_silence_causes_no_trip():
    run = walk("{outages: ['silence@0.5s']}", "duration_s=0.7", "control.safety.enabled=false")
    assert run.trip is None
    assert (columns(run, "stiffness_Nm_per_rad")[:, 530:] > 0.0).any()


@pytest.mark.slow
def test_an_invalid_command_is_rejected_by_its_board_at_once_and_reported():
    """A torque that runs away at 20 000 N·m a second passes what is plausible within ticks."""
    run = walk(
        "can",
        "engine=pinocchio",
        "duration_s=0.6",
        "faults=['controller_runaway:right_knee@0.4s=20000Nm/s']",
        "control.safety.command_deviation_Nm=1e3",  # so that the plausible command is passed first
    )
    highest = run.experiment.control.safety.highest_command
    torque = run.log["right_knee_motor_command_torque_Nm"].to_numpy()
    damping = run.log["right_knee_damping_Nms_per_rad"].to_numpy()
    hold = int(np.flatnonzero(damping == run.experiment.control.safety.hold_damping)[0])
    assert np.abs(torque).max() <= highest
    assert run.trip is not None
    assert (run.trip.cause, run.trip.location) == (TripCause.COMMAND, "right knee")
    assert 400 < hold < run.trip.tick <= hold + CYCLE


# ------------------------------------------------------------------ what a user reads


def test_the_summary_has_the_traffic_of_the_bus():
    run = walk("{loss: 0.1}", "duration_s=2")
    network = summarise_run(run)["network"]
    frames = frames_of(run)
    assert network["lost"] == sum(frame["lost"] for frame in frames) > 0
    assert network["sent"] == 8 * 1000
    # 8 frames of 111 bits and their stuff bits in a cycle, 24 of them at most.
    assert 8 * 111 / 2000 < network["bus_load"] < 8 * 135 / 2000
    (bus_line,) = (line for line in report(summarise_run(run)) if "bus:" in line)
    assert bus_line.endswith(f"{network['lost']} of 8000 frames lost")
    assert "network" not in summarise_run(ideal())


@pytest.mark.parametrize(
    ("setting", "rule"),
    [
        ("network={bit_rate_kbit_per_s: 500}", "bus_traffic"),
        ("control.target_torque_Nm.hip=110", "bus_value_range"),
    ],
)
def test_check_refuses_values_outside_the_ranges_of_the_bus(setting, rule):
    experiment = load_experiment("treadmill_guided", ["network=can", setting]).experiment
    errors = [
        item.rule for item in check(build_case(experiment.table, experiment)) if item.severity == "error"
    ]
    assert errors == [rule]
