"""Frames of a run: what cantools and python-can read is what the log has."""

from __future__ import annotations

import sys

import can
import cantools
import numpy as np
import pytest
from errors import raises, states

from twin_gait.cli import main
from twin_gait.configuration.experiments import load_experiment
from twin_gait.control.safety import TripCause
from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.export.can import bus_frames, export_can, network_messages, run_frames
from twin_gait.files import shipped_file
from twin_gait.network.dbc import PACKAGED_DBC, load_messages
from twin_gait.parameters.network import BOARDS as KNOWN_BOARDS
from twin_gait.runs.record import write_run
from twin_gait.simulation.simulator import simulate

MESSAGES = load_messages()
BOARDS = KNOWN_BOARDS[:4]
DATABASE = cantools.database.load_file(shipped_file(PACKAGED_DBC))
READERS = {"candump": can.CanutilsLogReader, "asc": can.ASCReader}
# Signal, column behind the board's name, and what the column is to be divided by.
CARRIED = {
    "setpoint": {
        "stiffness": "stiffness_Nm_per_rad",
        "damping": "damping_Nms_per_rad",
        "equilibrium": "equilibrium_rad",
        "gain": "friction_compensation_gain",
    },
    "measurement": {
        "angle": "measured_angle_rad",
        "velocity": "velocity_fast_rad_per_s",
        "current": "measured_current_A",
    },
}


@pytest.fixture(scope="module")
def tripped():
    """A walk whose left knee freezes."""
    settings = [
        "duration_s=3",
        "faults=[encoder_freeze:left_knee@1.5s]",
        "control.target_torque_Nm.hip=3",
        "sensors.ideal=false",
    ]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    assert run.trip is not None and str(run.trip.cause) == "encoder_frozen"
    return run


@pytest.fixture(scope="module", params=READERS)
def read(request, tripped, tmp_path_factory):
    """All frames of the walk's file, with the numbers that cantools finds in them."""
    path = tmp_path_factory.mktemp("frames") / f"walk.{request.param}"
    written = list(run_frames(tripped, MESSAGES))
    export_can(written, path, request.param)
    with READERS[request.param](path) as reader:
        frames = list(reader)
    assert len(frames) == len(written)
    return [
        (item.timestamp, DATABASE.get_message_by_frame_id(item.arbitration_id).name,
         DATABASE.decode_message(item.arbitration_id, item.data, decode_choices=False))
        for item in frames
    ]  # fmt: skip


def named(read, name):
    ticks = [round(1000 * time) for time, message, _ in read if message == name]
    return ticks, [values for _, message, values in read if message == name]


def test_every_message_comes_at_its_cycle_in_the_order_of_its_priority(read, tripped):
    for message in MESSAGES.values():
        ticks, _ = named(read, message.name)
        cycle = round(1000 * message.cycle)
        assert ticks == (list(range(0, len(tripped.log), cycle)) if cycle else [])
    order = [(time, DATABASE.get_message_by_name(name).frame_id) for time, name, _ in read]
    assert order == sorted(order)


@pytest.mark.parametrize("kind", CARRIED)
def test_decoded_numbers_are_within_half_a_step_of_the_log(read, tripped, kind):
    for board in BOARDS:
        ticks, values = named(read, f"{board}_{kind}")
        for signal, column in CARRIED[kind].items():
            decoded = np.array([item[signal] for item in values])
            logged = tripped.log[f"{board}_{column}"].to_numpy()[ticks]
            step = MESSAGES[f"{board}_{kind}"].signals[signal].scale
            assert np.abs(decoded - logged).max() <= (0.5 + 1e-9) * step, (board, signal)
            assert signal in ("gain", "damping") or np.ptp(decoded) > 10.0 * step


def test_feedforward_terms_are_exported_as_one_torque(read, tripped):
    for board in BOARDS:
        ticks, values = named(read, f"{board}_setpoint")
        rest = ("impedance_torque_Nm", "friction_compensation_torque_Nm")
        logged = tripped.log[f"{board}_motor_command_torque_Nm"] - sum(
            tripped.log[f"{board}_{name}"] for name in rest
        )
        decoded = np.array([item["torque"] for item in values])
        assert np.abs(decoded - logged.to_numpy()[ticks]).max() <= 0.0125 + 1e-9
        assert ("hip" in board) == (decoded[0] == 3.0)


def test_a_sole_reports_through_the_board_of_its_knee(read, tripped):
    for board in BOARDS:
        side, _, joint = board.partition("_")
        ticks, values = named(read, f"{board}_measurement")
        load = tripped.log[f"{side}_foot_normal_force_N"].to_numpy()[ticks] / tripped.body_weight
        decoded = np.array([item["foot_load"] for item in values])
        expected = load if joint == "knee" else 0.0
        half_a_step = 0.5 * MESSAGES[f"{board}_measurement"].signals["foot_load"].scale
        assert np.abs(decoded - expected).max() <= half_a_step + 1e-9
        assert (decoded.max() > 0.3) == (joint == "knee")


def test_a_trip_is_reported_by_its_board_and_every_setpoint_is_a_hold(read, tripped):
    begin = tripped.trip.tick
    for board in BOARDS:
        ticks, values = named(read, f"{board}_setpoint")
        states = [(tick >= begin) + 0 for tick in ticks]
        assert [item["state"] for item in values] == [1 if held else 2 for held in states]
        ticks, values = named(read, f"{board}_measurement")
        cause = TripCause.ENCODER_FROZEN.code if board == "left_knee" else 0
        assert [item["trip_cause"] for item in values] == [cause * (tick >= begin) for tick in ticks]
    ticks, values = named(read, "gait_state")
    names = MESSAGES["gait_state"].codes["left_phase"]
    phases = tripped.log["left_phase"].to_numpy()[ticks]
    assert [item["left_phase"] for item in values] == [
        names["hold"] if tick >= begin else names[phase] for tick, phase in zip(ticks, phases, strict=True)
    ]
    assert [item["safety_state"] for item in values] == [int(tick >= begin) for tick in ticks]
    assert [item["time"] for item in values] == pytest.approx([1e-3 * tick for tick in ticks])


def test_counters_count_every_frame_of_their_message(read):
    for name in ("right_hip_setpoint", "right_hip_measurement"):
        counts = [item["counter"] for item in named(read, name)[1]]
        assert counts == [k % 4 for k in range(len(counts))]


def test_frames_of_log_chunks_equal_the_frames_of_the_whole_log(tripped):
    columns = {name: tripped.log[name].to_numpy()[:100] for name in tripped.log.columns}
    whole = bus_frames(columns, MESSAGES, first=0, body_weight=tripped.body_weight)
    pieces = []
    for first, end in ((0, 7), (7, 10), (10, 100)):
        rows = {name: column[first:end] for name, column in columns.items()}
        pieces += bus_frames(rows, MESSAGES, first=first, body_weight=tripped.body_weight)
    assert pieces == whole


def test_a_bench_leg_has_two_boards_and_no_sole():
    run = simulate(load_experiment("bench_leg", ["duration_s=0.5"]).experiment)
    identifiers = {item.identifier for item in run_frames(run, MESSAGES)}
    names = {message.name for message in MESSAGES.values() if message.identifier in identifiers}
    boards = {f"right_{joint}_{kind}" for joint in ("hip", "knee") for kind in CARRIED}
    assert names == boards | {"battery", "imu", "gait_state"}


@pytest.mark.parametrize("impedance", ["board", "ccu"])
def test_frames_of_a_networked_run_have_its_layout_cycle_and_received_setpoints(impedance):
    """After a walk over the bus the log has numbers in steps of the frames that brought them."""
    settings = ["engine=pinocchio", "duration_s=1", "network.cycle_ms=4", f"network.impedance={impedance}"]
    run = simulate(load_experiment("bench_leg", settings).experiment)
    messages = network_messages(run.experiment)
    frames = [item for item in run_frames(run, messages) if item.identifier == 0x104]
    assert [round(1000 * item.time) for item in frames] == list(range(0, 1000, 4))
    decoded = [DATABASE.decode_message(item.identifier, item.data, decode_choices=False) for item in frames]
    stiffness = np.array([item["stiffness"] for item in decoded])
    torque = np.array([item["torque"] for item in decoded])
    assert (stiffness[10:] > 0.0).all() == (impedance == "board") and stiffness.any() == (
        impedance == "board"
    )
    fed = run.log["right_knee_gravity_compensation_torque_Nm"] + run.log["right_knee_target_torque_Nm"]
    np.testing.assert_allclose(torque, fed.to_numpy()[::4], atol=1e-9)
    assert run.log["right_knee_target_torque_Nm"].any() == (impedance == "ccu")
    logged = run.log["right_knee_stiffness_Nm_per_rad"].to_numpy()[::4]
    np.testing.assert_allclose(stiffness, logged, atol=1e-9)


def test_a_board_without_frames_reports_a_bus_timeout():
    run = simulate(
        load_experiment(
            "bench_leg", ["engine=pinocchio", "duration_s=1", "network.outages=[silence:right_knee@0.5s]"]
        ).experiment
    )
    assert str(run.trip.cause) == "bus_timeout" and str(run.trip.joint) == "knee"
    last = {item.identifier: item.data for item in run_frames(run, MESSAGES)}
    causes = {
        name: DATABASE.decode_message(identifier, last[identifier])["trip_cause"]
        for name, identifier in (("gait_state", 0x281), ("right_knee", 0x184), ("right_hip", 0x183))
    }
    assert causes == {"gait_state": "bus_timeout", "right_knee": "bus_timeout", "right_hip": "none"}


# ------------------------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def stored(tripped, tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    write_run(tripped, folder, pictures=False)
    return folder


@pytest.mark.parametrize(
    ("arguments", "name"),
    [(["--format", "candump"], "can.log"), (["--format", "asc"], "can.asc"), (["--out", "x.log"], "x.log")],
)
def test_the_command_writes_frames(stored, arguments, name, capsys, monkeypatch):
    monkeypatch.chdir(stored)
    assert main(["export", str(stored), *arguments]) == 0
    assert capsys.readouterr().out.endswith(f"{name}\n")
    frames = list((READERS["asc"] if name.endswith("asc") else READERS["candump"])(stored / name))
    assert len(frames) > 10_000


def test_a_convention_is_refused_and_nothing_written(stored, capsys, tmp_path):
    out = tmp_path / "x.asc"
    assert main(["export", str(stored), "--out", str(out), "--convention", "rajagopal"]) == 2
    assert states(capsys.readouterr().err, "--convention", "asc") and not out.exists()


def test_without_python_can_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "can", None)
    with raises(MissingOptionalDependency, "pip install 'twin-gait[can]'"):
        export_can([], tmp_path / "x.log", "candump")
