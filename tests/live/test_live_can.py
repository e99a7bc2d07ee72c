"""Tests of ``twin-gait live --can``: cyclic frames on a bus, and commands of a monitor."""

from __future__ import annotations

import math
import sys
import threading
import time
from concurrent.futures import Future
from contextlib import closing
from types import SimpleNamespace

import can
import cantools
import numpy as np
import pytest
from errors import raises, states
from own_devices import write_experiment

from twin_gait.cli import main
from twin_gait.configuration.experiments import load_experiment
from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.export.can import network_messages, run_frames
from twin_gait.files import shipped_file
from twin_gait.live import can_link
from twin_gait.live.can_link import CanLink, decode_commands, leaves_machine, open_bus
from twin_gait.live.controls import ControlPanel
from twin_gait.live.loop import PERIOD
from twin_gait.live.protocol import MessageRejected
from twin_gait.live.session import LiveSession
from twin_gait.live.telemetry import Block, EventLog
from twin_gait.network.dbc import load_messages
from twin_gait.runs.record import read_stored_run
from twin_gait.simulation.simulator import simulate

MESSAGES = load_messages()
DATABASE = cantools.database.load_file(shipped_file("twin.dbc"))
KNEE = {"stiffness": 100.0, "damping": 12.5, "equilibrium": 0.5, "gain": 0.3, "torque": -1.05, "counter": 0}
DEGREE = math.pi / 180.0


def frame_of(board="right_knee", control="walk", **values):
    """Return a command as another tool encodes it."""
    message = DATABASE.get_message_by_name(f"{board}_command")
    data = message.encode({**KNEE, "control": control, **values})
    return can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False)


@pytest.fixture(scope="module")
def panel():
    return ControlPanel(load_experiment("bench_leg", ["duration_s=60"]).experiment)


def controls_of(panel):
    return {item.name: item for item in panel.controls(panel.preset)}


# ------------------------------------------------------------------------------- commands


def test_a_command_sets_the_controls_of_its_joint_in_their_units():
    frame = frame_of(control="torque_control")
    commands = decode_commands(MESSAGES["right_knee_command"], bytes(frame.data))
    values = {name.rpartition(".")[2]: value for name, value in commands.items()}
    assert all(name == "mode" or name.startswith("monitor.right.knee.") for name in commands)
    assert values == pytest.approx(
        {"stiffness": 100.0 * DEGREE, "damping": 12.5, "equilibrium": 0.5 / DEGREE, "gain": 0.3,
         "torque": -1.05, "mode": "torque_control"}
    )  # fmt: skip


def test_every_command_names_a_control_of_the_panel(panel):
    known = controls_of(panel)
    for joint in ("hip", "knee"):
        name = f"right_{joint}_command"
        assert set(decode_commands(MESSAGES[name], bytes(8))) <= set(known)


@pytest.mark.parametrize("joints", [("hip",), ("hip", "knee", "ankle")])
def test_commands_of_another_device_name_the_controls_of_its_joints(tmp_path, joints):
    experiment = load_experiment(write_experiment(tmp_path, joints)).experiment
    known = set(controls_of(ControlPanel(experiment)))
    messages = network_messages(experiment)
    commands = {name: item for name, item in messages.items() if name.endswith("_command")}
    assert list(commands) == [f"right_{joint}_command" for joint in joints]
    for joint, message in zip(joints, commands.values(), strict=True):
        names = set(decode_commands(message, bytes(8)))
        assert f"monitor.right.{joint}.torque" in names and names <= known


def test_a_signal_without_a_number_requests_no_change():
    data = bytearray(frame_of().data)
    data[7] |= 0x7F  # all ones of the gain
    assert "monitor.right.knee.gain" not in decode_commands(MESSAGES["right_knee_command"], bytes(data))


def test_a_frame_of_another_length_is_refused():
    with raises(MessageRejected, "right_knee_command", "8", "3"):
        decode_commands(MESSAGES["right_knee_command"], b"\0\0\0")


# ------------------------------------------------------------------------------- the bus


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("", ("INTERFACE:CHANNEL", "udp_multicast")),
        ("vcan0", ("INTERFACE:CHANNEL", "udp_multicast")),
        ("socketcan:", ("INTERFACE:CHANNEL", "udp_multicast")),
        ("carrier_pigeon:can0", ("carrier_pigeon:can0",)),
        ("udp_multicast:1.2.3.4", ("udp_multicast:1.2.3.4", "INTERFACE:CHANNEL")),
        ("socketcan:no_such_can", ("socketcan:no_such_can", "INTERFACE:CHANNEL")),
    ],
)
def test_a_bus_that_cannot_be_opened_is_refused_in_one_line(name, facts):
    with raises(ParameterError, *facts) as caught:
        open_bus(name)
    assert "\n" not in str(caught.value)


def test_without_python_can_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "can", None)
    with raises(MissingOptionalDependency, "pip install 'twin-gait[can]'"):
        open_bus("virtual:x")


@pytest.mark.parametrize("name", ["nonsense", ""])
def test_the_command_refuses_a_wrong_bus_before_it_makes_a_folder(tmp_path, capsys, name):
    out = tmp_path / "run"
    command = ["live", "bench_leg", "--no-browser", "--no-record", "--port", "0", "--out", str(out)]
    assert main([*command, "--can", name]) == 2
    message = capsys.readouterr().err
    assert states(message, repr(name), "INTERFACE:CHANNEL") and message.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_only_a_bus_that_others_may_hang_on_is_warned_of():
    inside = ("virtual:a", "udp_multicast:239.74.163.2", "socketcan:vcan0")
    assert not any(map(leaves_machine, inside))
    assert leaves_machine("socketcan:can0") and leaves_machine("pcan:PCAN_USBBUS1")
    with open_bus("virtual:ttl") as bus:
        assert bus.protocol is can.CanProtocol.CAN_20


def test_frames_of_multicast_do_not_leave_the_machine():
    import socket

    try:
        bus = open_bus("udp_multicast:239.74.163.2")
    except ParameterError:
        pytest.skip("no multicast here")
    with bus:
        own = socket.socket(fileno=socket.dup(bus.fileno()))
        with own:
            assert own.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0


# ------------------------------------------------------------------------------- the link


class Rig:
    """Link on a virtual bus with a session that responds on demand."""

    def __init__(self, name, panel):
        self.panel, self.event_log, self.sent = panel, EventLog(), []
        self.coming = []
        self.bus = can.Bus(name, "virtual")
        self.link = CanLink(f"virtual:{name}", panel.simulation_setup, self.event_log, self.submit)

    def submit(self, message):
        self.sent.append(message)
        self.coming.append(Future())
        return self.coming[-1]

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.link.close()
        self.bus.shutdown()

    def wait_for(self, found, seconds=10.0):
        end = time.monotonic() + seconds
        while not found():
            assert time.monotonic() < end, "waited in vain"
            time.sleep(0.002)

    def settle(self):
        """Wait until the link has received all sent frames."""
        time.sleep(0.1)

    def answer(self):
        self.sent.clear()
        for coming in self.coming:
            coming.set_result(None)
        self.coming.clear()


@pytest.fixture
def rig(panel, request):
    with Rig(request.node.name, panel) as rig:
        yield rig


def test_changes_of_a_frame_are_requested_once_with_the_mode_last(rig):
    rig.bus.send(frame_of(control="impedance_control"))
    rig.wait_for(lambda: len(rig.sent) == 6)
    assert rig.sent[-1].control == "mode" and rig.sent[-1].value == "impedance_control"
    assert {item.user for item in rig.sent} == {"CAN"} and {item.kind for item in rig.sent} == {"set"}
    rig.answer()
    for _ in range(20):  # cyclic frames with a running counter: they request no change
        rig.bus.send(frame_of(control="impedance_control", counter=2))
    rig.settle()
    assert rig.sent == []


def test_while_a_response_is_pending_only_the_newest_request_is_kept(rig):
    rig.bus.send(frame_of(torque=1.0))
    rig.wait_for(lambda: rig.sent)
    first = len(rig.sent)
    for step in range(1, 30):
        rig.bus.send(frame_of(torque=1.0 + 0.05 * step))
    rig.settle()
    assert len(rig.sent) == first
    rig.answer()
    rig.wait_for(lambda: rig.sent)
    torques = [item.value for item in rig.sent if item.control.endswith("torque")]
    assert torques == pytest.approx([1.0 + 0.05 * 29])


def test_a_bus_that_echoes_own_frames_still_receives_commands(panel, request, monkeypatch):
    monkeypatch.setattr(can_link, "OPTIONS", {"virtual": {"receive_own_messages": True}})
    with Rig(request.node.name, panel) as rig:
        for first in range(0, 200, 10):
            rig.link.add_block(rows_of(panel, first, first + 10))
        rig.bus.send(frame_of())
        rig.wait_for(lambda: rig.sent)
        assert rig.event_log.serial == 0


def test_invalid_frames_are_reported_once_and_ignored(rig):
    for _ in range(3):
        short = frame_of()
        short.data, short.dlc = short.data[:4], 4
        rig.bus.send(short)
        rig.bus.send(can.Message(arbitration_id=0x304, is_remote_frame=True, dlc=8, is_extended_id=False))
        rig.bus.send(can.Message(arbitration_id=0x304, data=bytes(8), is_extended_id=True))
        rig.bus.send(can.Message(arbitration_id=0x123, data=bytes(8), is_extended_id=False))
        rig.bus.send(can.Message(is_error_frame=True))
    rig.settle()
    messages = [event.text for event in rig.event_log.after(0)]
    assert {event.response for event in rig.event_log.after(0)} == {"note"}
    for length in (4, 0):
        assert sum(states(text, "right_knee_command", "8", length) for text in messages) == 1
    assert len(messages) == 2 and rig.sent == []


def test_a_bus_failure_is_reported_once_and_the_link_continues(rig, monkeypatch):
    def fail(*_):
        raise can.CanOperationError("cable cut")

    rows = rows_of(rig.panel, 0, 10)
    with monkeypatch.context() as patch:
        patch.setattr(rig.link._bus, "send", fail)
        rig.link.add_block(rows)
        rig.wait_for(lambda: rig.event_log.serial)
        time.sleep(0.1)
    assert [states(event.text, "CAN", "cable cut") for event in rig.event_log.after(0)] == [True]
    calls = []
    for first in (10, 20):
        rig.link.add_block(rows_of(rig.panel, first, first + 10))
        rig.wait_for(lambda: rig.bus.recv(0.0))
        calls.append(1)
        while rig.bus.recv(0.1):
            calls[-1] += 1
    # Nothing late from before; what has a longer cycle than a block stands in one of them only.
    assert calls[0] <= 1.2 * calls[1]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_unexpected_error_of_a_driver_ends_the_link_with_a_message(rig, monkeypatch):
    def fail(*_):
        raise RuntimeError("a defect of the driver")

    monkeypatch.setattr(rig.link._bus, "recv", fail)
    rig.wait_for(lambda: not rig.link._thread.is_alive())
    assert [states(event.text, "CAN") for event in rig.event_log.after(0)] == [True]


WALKED = {}


def rows_of(panel, first, end):
    """Return the rows of a block of a walk."""
    if not WALKED:
        from twin_gait.simulation.stepping import SteppedRun

        run = SteppedRun(panel.simulation_setup)
        WALKED.update(zip(run.layout.names, run.advance(400).T, strict=True))
        WALKED["right_phase"] = np.array(panel.simulation_setup.table.phase_names)[
            WALKED["right_phase"].astype(int)
        ]
    return Block(first, end, {name: column[first:end] for name, column in WALKED.items()}, "")


def test_frames_go_out_at_their_cycle_in_order_and_find_their_time_again_after_a_pause(rig):
    received = []

    def listen():
        while (message := rig.bus.recv(1.0)) is not None:
            received.append((time.monotonic(), message))

    listener = threading.Thread(target=listen)
    listener.start()
    began = time.monotonic()
    for first in range(0, 200, 10):
        rig.link.add_block(rows_of(rig.panel, first, first + 10))
        time.sleep(max(0.0, began + (first + 10) * 1e-3 - time.monotonic()))
    time.sleep(0.5)  # a pause
    again = time.monotonic()
    for first in range(200, 400, 10):
        rig.link.add_block(rows_of(rig.panel, first, first + 10))
        time.sleep(max(0.0, again + (first - 190) * 1e-3 - time.monotonic()))
    listener.join()
    expected = simulate(load_experiment("bench_leg", ["duration_s=0.4"]).experiment)
    frames = list(run_frames(expected, MESSAGES))
    assert [(item.arbitration_id, bytes(item.data)) for _, item in received] == [
        frame[1:] for frame in frames
    ]
    late = np.array([when for when, _ in received]) - np.array([
        (began if frame.time < 0.2 else again - 0.2) + frame.time + PERIOD for frame in frames
    ])  # fmt: skip
    assert late.min() > -0.012  # none is early; how late they are is the machine's doing


# ------------------------------------------------------------------------------- a whole session


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """Return a session on a bus with a listener that sends commands."""
    folder = tmp_path_factory.mktemp("bus") / "run"
    received, done = [], threading.Event()
    bus = can.Bus("whole session", "virtual")

    def listen():
        while not done.is_set():
            message = bus.recv(0.1)
            if message is not None:
                received.append((message.arbitration_id, bytes(message.data)))

    listener = threading.Thread(target=listen)
    listener.start()
    loaded = load_experiment("bench_leg", ["duration_s=60"])
    with closing(
        LiveSession(loaded=loaded, folder=folder, pictures=False, can="virtual:whole session")
    ) as session:
        session.start()

        def until(name, response):
            end = time.monotonic() + 60.0
            while time.monotonic() < end:
                found = [event for event in session.event_log.after(0) if event.subject == name]
                if found and found[-1].response is response:
                    return found[-1]
                time.sleep(0.01)
            raise AssertionError(f"{name} was not {response}")

        responses = {}
        bus.send(frame_of(control="impedance_control", torque=0.0))
        responses["mode"] = until("mode", "applied")
        bus.send(frame_of(control="impedance_control", torque=90.0))
        responses["range"] = until("monitor.right.knee.torque", "refused")
        bus.send(frame_of(control="impedance_control", torque=0.0, gain=0.95))
        responses["unsafe"] = until("monitor.right.knee.gain", "refused")
        time.sleep(1.5)
        state = {item.name: item.value for item in session.state().controls}
    done.set()
    listener.join()
    bus.shutdown()
    return SimpleNamespace(
        folder=folder, received=received, responses=responses, state=state, run=read_stored_run(folder).run
    )


def test_frames_on_the_bus_equal_the_log_of_the_walk(walked):
    frames = [(frame.identifier, frame.data) for frame in run_frames(walked.run, MESSAGES)]
    assert len(walked.received) > 3000 and walked.received == frames[: len(walked.received)]


def test_can_commands_change_the_walk_like_page_commands(walked):
    assert walked.responses["mode"].user == "CAN" and walked.state["mode"] == "impedance_control"
    assert walked.state["monitor.right.knee.stiffness"] == pytest.approx(100.0 * DEGREE)
    log = walked.run.log
    assert log["right_knee_stiffness_Nm_per_rad"].iloc[-1] == pytest.approx(100.0)
    assert log["right_knee_equilibrium_rad"].iloc[-1] == pytest.approx(0.5)
    events = walked.run.experiment.events
    assert {item.by for item in events} == {"CAN"}
    (mode,) = [item for item in events if "mode" in item.changes]
    assert events.index(mode) == 5 and mode.tick == walked.responses["mode"].tick
    assert simulate(walked.run.experiment).log.equals(log)


def test_changes_refused_for_a_page_are_refused_for_a_monitor(walked):
    assert states(walked.responses["range"].text, "-60", "60 N·m", "90")
    assert walked.responses["unsafe"].text.startswith("unstable")
    assert walked.state["monitor.right.knee.torque"] == 0.0
    assert walked.state["monitor.right.knee.gain"] == pytest.approx(0.3)
