"""Live walks with drives of other makers on a virtual bus, which emulated drives answer."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from types import SimpleNamespace

import can
import canopen
import numpy as np
import pytest
from emulated_canopen import CanopenDrive
from emulated_drives import EXIT, AkDrive
from errors import raises, states

from twin_gait import load_experiment, simulate
from twin_gait.core.safety import OPERATOR_TRIP
from twin_gait.exceptions import ParameterError
from twin_gait.live.can_link import CanLink
from twin_gait.live.motor_link import MotorLink
from twin_gait.live.protocol import DoAction
from twin_gait.live.session import LiveSession
from twin_gait.live.telemetry import Block, EventLog
from twin_gait.network.drives import MotorFrame
from twin_gait.parameters.network import BOARDS
from twin_gait.runs.record import read_stored_run

# The timeout is as long as a busy machine may take.
MIT = ["plant.motor_bus={protocol: mit, timeout_ms: 5000, models: {hip: AK80-64, knee: AK80-64}}"]
NODES = {board: 1 + BOARDS.index(board) for board in ("right_hip", "right_knee")}


@pytest.fixture(scope="module")
def bench() -> SimpleNamespace:
    """Return a bench leg with AK drives, and the columns of its walk."""
    experiment = load_experiment("bench_leg", [*MIT, "duration_s=0.4"]).experiment
    log = simulate(experiment).log
    return SimpleNamespace(experiment=experiment, columns={name: log[name].to_numpy() for name in log})


def block(columns: dict[str, np.ndarray], first: int, end: int) -> Block:
    return Block(first, end, {name: column[first:end] for name, column in columns.items()}, "")


class Drives:
    """Emulated drives of a bench leg in a thread on a virtual bus."""

    def __init__(self, name: str) -> None:
        self.drives = {board: AkDrive(node, "AK80-64") for board, node in NODES.items()}
        self.frames: list[tuple[int, bytes]] = []
        self._bus, self._done = can.Bus(name, "virtual"), threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.is_set():
            if (message := self._bus.recv(0.05)) is None:
                continue
            self.frames.append((message.arbitration_id, bytes(message.data)))
            for drive in self.drives.values():
                for node, data in drive.receive(*self.frames[-1]):
                    self._bus.send(can.Message(arbitration_id=node, data=data, is_extended_id=False))

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self._bus.shutdown()


def wait_for(found, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not found():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


# ------------------------------------------------------------------------------- without a bus


def test_the_drives_receive_the_torques_of_the_walk_at_its_cycle(bench) -> None:
    faults: list[str] = []
    link = MotorLink(bench.experiment, faults.append)
    emulated = {board: AkDrive(node, "AK80-64") for board, node in NODES.items()}
    ticks = []
    for first in range(0, 400, 10):
        for when, frames in link.schedule(block(bench.columns, first, first + 10)):
            ticks.append(round(1e3 * when))
            for frame in frames():
                for drive in emulated.values():
                    for answer in drive.receive(*frame):
                        link.receive(MotorFrame(*answer))
    assert ticks == list(range(0, 400, 2)) and faults == []
    for board, drive in emulated.items():
        assert drive.entered == 1 and len(drive.commands) == len(ticks) - 1
        sampled = {
            name: bench.columns[f"{board}_{end}"][2::2]
            for name, end in (
                ("torque", "motor_command_torque_Nm"), ("angle", "measured_angle_rad"),
                ("velocity", "velocity_fast_rad_per_s"), ("stiffness", "stiffness_Nm_per_rad"),
            )
        }  # fmt: skip
        position, velocity, kp, kd, feed_forward = np.array(drive.commands).T
        total = kp * (position - sampled["angle"]) + kd * (velocity - sampled["velocity"]) + feed_forward
        assert np.abs(total - np.clip(sampled["torque"], -60.0, 60.0)).max() < 0.15  # steps of the frame
        assert np.abs(kp - sampled["stiffness"]).max() <= 0.51 * 500.0 / 4095
        assert np.ptp(sampled["torque"]) > 5.0


def test_a_restart_of_the_walk_forgets_faults_and_reports_the_next_one(bench) -> None:
    faults: list[str] = []
    link = MotorLink(bench.experiment, faults.append)

    def walk() -> None:
        for first in range(0, 40, 10):
            for _, frames in link.schedule(block(bench.columns, first, first + 10)):
                for identifier, _data in frames():
                    reply = [identifier, 0x80, 0, 0x80, 0x08, 0, 30, 6]
                    link.receive(MotorFrame(0, bytes(reply)))

    walk()
    assert len(faults) == 2 and all(states(fault, "unbalanced") for fault in faults)
    assert {board for board in NODES for fault in faults if board in fault} == set(NODES)
    walk()
    assert len(faults) == 4


def test_a_missing_model_and_a_torque_beyond_its_range_are_refused_in_one_line(bench) -> None:
    missing = load_experiment("bench_leg", [MIT[0].replace(", knee: AK80-64", "")])
    with raises(ParameterError, "plant.motor_bus.models.knee"):
        MotorLink(missing.experiment, print)
    weak = load_experiment("bench_leg", [*MIT, "plant.motor_bus.models.knee=AK80-9"])
    with raises(ParameterError, "control.limits.knee.torque_Nm", "18", "60"):
        MotorLink(weak.experiment, print)


# ------------------------------------------------------------------------------- on a bus


def test_a_pause_and_the_end_switch_the_drives_off(bench) -> None:
    setup = SimpleNamespace(experiment=bench.experiment, world=SimpleNamespace(body_weight=1.0))
    with closing(Drives("pause")) as drives:
        with closing(CanLink("virtual:pause", setup, EventLog(), print)) as link:
            link.add_block(block(bench.columns, 0, 300))
            wait_for(lambda: (NODES["right_hip"], EXIT) in drives.frames)
            wait_for(lambda: not any(drive.on for drive in drives.drives.values()))
            assert len(drives.drives["right_hip"].commands) > 5
            link.add_block(block(bench.columns, 300, 400))
            wait_for(lambda: all(drive.on for drive in drives.drives.values()))
        wait_for(lambda: not any(drive.on for drive in drives.drives.values()))


def test_a_fault_of_a_drive_is_noted_and_stops_the_walk(bench) -> None:
    setup = SimpleNamespace(experiment=bench.experiment, world=SimpleNamespace(body_weight=1.0))
    sent, event_log = [], EventLog()
    with (
        closing(Drives("fault")) as drives,
        closing(CanLink("virtual:fault", setup, event_log, sent.append)) as link,
    ):
        drives.drives["right_knee"].error = 1
        link.add_block(block(bench.columns, 0, 100))
        wait_for(lambda: sent)
        link.add_block(block(bench.columns, 0, 100))  # a restart of the walk with the same fault
        wait_for(lambda: len(sent) == 2)
    assert sent == 2 * [DoAction(id="CAN", user="CAN", action="stop")]
    notes = [event.text for event in event_log.after(0) if "right_knee" in event.text]
    assert len(notes) == 2 and all(states(note, "over-temperature", "held") for note in notes)


def test_a_canopen_drive_on_the_bus_is_switched_on_and_follows_the_torque(bench) -> None:
    torque = bench.columns["right_knee_motor_command_torque_Nm"]
    experiment = load_experiment("bench_leg", [*MIT, "plant.motor_bus.protocol=cia402"]).experiment
    setup = SimpleNamespace(experiment=experiment, world=SimpleNamespace(body_weight=1.0))
    event_log, network = EventLog(), canopen.Network(can.Bus("canopen", "virtual"))
    network.connect()
    drives = {board: CanopenDrive(node, network, rated_mNm=430) for board, node in NODES.items()}
    with closing(CanLink("virtual:canopen", setup, event_log, print)) as link:
        link.add_block(block({name: np.tile(column, 20) for name, column in bench.columns.items()}, 0, 8000))
        wait_for(lambda: all(len(drive.torques) > 50 for drive in drives.values()))
    wait_for(lambda: all(drive.state == "quick stop active" for drive in drives.values()))
    network.disconnect()
    assert event_log.serial == 0
    gear = experiment.plant.actuators["knee"].gear_ratio
    exact = np.clip(torque[::2], -60.0, 60.0) / (0.430 * gear) * 1000
    received = drives["right_knee"].torques
    while received[0] == 0:  # until the link has the report that operation is enabled
        received.pop(0)
    cycles = iter(np.tile(exact, 20))  # a late link leaves cycles out
    assert all(any(abs(wanted - found) <= 0.5 for wanted in cycles) for found in received)
    assert len(set(received)) > 3


@pytest.mark.slow
def test_a_live_walk_is_held_when_a_drive_fails_and_replays_so(tmp_path) -> None:
    loaded = load_experiment("bench_leg", [*MIT, "duration_s=60"])
    folder = tmp_path / "run"
    with closing(Drives("session")) as drives:
        session = LiveSession(loaded=loaded, folder=folder, pictures=False, can="virtual:session")
        with closing(session):
            session.start()
            wait_for(lambda: len(drives.drives["right_hip"].commands) > 200)
            drives.drives["right_hip"].error = 2
            wait_for(lambda: session.walk.status == "held")
            time.sleep(0.3)
        held = drives.drives["right_knee"].commands[-1]
    run = read_stored_run(folder).run
    assert run.trip is not None and run.trip.cause.code == OPERATOR_TRIP
    assert held[2] == 0.0 and held[3] == 5.0  # no spring, as much damping as the drive has
    assert simulate(run.experiment).log.equals(run.log)
    texts = [event.text for event in session.event_log.after(0)]
    assert any(states(text, "right_hip", "over-current") for text in texts)
