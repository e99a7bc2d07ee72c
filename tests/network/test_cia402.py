"""Drives of CiA 402 against one that canopen emulates, cycle by cycle and without a bus."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from canopen.profiles.p402 import OperationMode, State402
from emulated_canopen import CanopenDrive, Wire
from errors import states

from twin_gait.network.cia402 import CIA402, CONTROLWORDS, Cia402Drive, shared_frames, state_of
from twin_gait.network.drives import DriveSettings, MotorFrame, MotorSetpoint

NODE, GEAR, RATED_mNm, COUNTS = 5, 50.0, 800, 4096
SETTINGS = DriveSettings(
    board="left_ankle", node=NODE, angles=(-0.7, 0.7), torque_limit=60.0, gear_ratio=GEAR,
    start_cycles=200, silent_cycles=10, silence_ms=20,
)  # fmt: skip
START = ["switch on disabled", "ready to switch on", "switched on", "operation enabled"]
STILL = MotorSetpoint(stiffness=40.0, damping=2.0, equilibrium=0.3, torque=12.0, angle=0.2, velocity=0.0)


class Bus:
    """A drive of the package, and the emulated one, which exchange the frames of cycles."""

    def __init__(self, settings: DriveSettings = SETTINGS) -> None:
        self.wire, self.drive = Wire(), Cia402Drive(settings)
        self.emulated = CanopenDrive(settings.node, self.wire, rated_mNm=RATED_mNm, counts=COUNTS)
        self.lost = 0  # frames that do not arrive at the drive

    def send(self, frames: list[MotorFrame]) -> None:
        for identifier, data in frames:
            if self.lost:
                self.lost -= 1
            else:
                self.wire.notify(identifier, bytearray(data), 0.0)
        for frame in self.wire.sent:
            self.drive.receive(MotorFrame(*frame))
        self.wire.sent.clear()

    def cycle(self, setpoint: MotorSetpoint = STILL, count: int = 1) -> None:
        for _ in range(count):
            self.send([*self.drive.cycle(setpoint), *shared_frames()])

    def started(self) -> Bus:
        for _ in range(60):
            self.cycle()
            if self.drive.ready:
                return self
        raise AssertionError(f"not ready: {self.drive.fault} {self.emulated.states}")

    def fails(self, state: str) -> None:
        """Put the emulated drive into a state."""
        self.emulated.states.append(state)


@pytest.fixture
def bus() -> Bus:
    return Bus().started()


# ------------------------------------------------------------------------------- the profile


def test_every_statusword_has_the_state_of_canopen():
    def theirs(word: int) -> str:
        found = (name for name, (mask, value) in State402.SW_MASK.items() if word & mask == value)
        return next(found, "").lower().replace(" ", "_")

    assert all(state_of(word) == theirs(word) for word in range(1 << 16))


def test_the_controlwords_and_the_mode_are_those_of_canopen():
    path = [name.upper() for name in START]
    words = [CONTROLWORDS[CIA402["states"][name.replace(" ", "_")]["command"]] for name in START]
    assert words[:3] == [State402.TRANSITIONTABLE[pair] for pair in pairwise(path)]
    assert words[3] == State402.CW_OPERATION_ENABLED
    assert CONTROLWORDS["quick_stop"] == State402.TRANSITIONTABLE["OPERATION ENABLED", "QUICK STOP ACTIVE"]
    assert CONTROLWORDS["fault_reset"] == State402.TRANSITIONTABLE["FAULT", "SWITCH ON DISABLED"]
    assert CIA402["cyclic_synchronous_torque"] == OperationMode.CYCLIC_SYNCHRONOUS_TORQUE


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("switch on disabled", "ready to switch on"),
        ("ready to switch on", "switched on"),
        ("switched on", "operation enabled"),
        ("operation enabled", "operation enabled"),
        ("quick stop active", "switch on disabled"),
        ("fault", "fault"),
        ("fault reaction active", "fault reaction active"),
    ],
)
def test_each_state_receives_the_command_of_its_transition(before, after):
    bus = Bus()
    bus.emulated.states = [before]
    command = CIA402["states"][before.replace(" ", "_")]["command"]
    bus.emulated.control(CONTROLWORDS[command], 0)
    assert bus.emulated.state == after


# ------------------------------------------------------------------------------- start


def test_the_drive_is_configured_then_switched_on_state_by_state(bus):
    assert bus.emulated.states == START and bus.drive.fault == ""
    assert bus.emulated.node.nmt.state == "OPERATIONAL"
    assert bus.emulated.read(0x6060) == 10 and bus.emulated.read(0x1017) == 20
    assert bus.emulated.read(0x1016, 1) == 127 << 16 | 20
    assert bus.emulated.read(0x6072) == math.ceil(60.0 / (RATED_mNm * 1e-3 * GEAR) * 1000)
    assert [item.name for item in bus.emulated.node.rpdo[1]] == ["6040:0", "6071:0"]
    for pdo, identifier in ((bus.emulated.node.rpdo[1], 0x205), (bus.emulated.node.tpdo[2], 0x285)):
        assert (pdo.cob_id, pdo.enabled, pdo.trans_type) == (identifier, True, 1)


def test_no_torque_is_commanded_before_operation_is_enabled():
    bus, seen = Bus(), []
    bus.emulated.target = 0
    while not bus.drive.ready:
        bus.cycle()
        seen.append((bus.emulated.state, bus.emulated.target))
    assert {target for state, target in seen if state != "operation enabled"} == {0}


def test_the_torque_is_in_thousandths_of_the_rated_torque_at_the_joint(bus):
    for torque in (12.0, -60.0, 0.01):
        bus.cycle(replace(STILL, torque=torque))
        exact = 1000.0 * torque / GEAR / (RATED_mNm * 1e-3)
        assert abs(bus.emulated.torques[-1] - exact) <= 0.5


def test_the_reports_are_at_the_joint(bus):
    turns = 0.05  # of the joint
    bus.emulated.position = -round(turns * GEAR * COUNTS)
    bus.emulated.velocity = round(0.5 * GEAR * COUNTS)
    bus.emulated.torque = -250
    bus.cycle(count=2)
    assert bus.drive.report == pytest.approx((-turns * 2 * math.pi, math.pi, -0.25 * 40.0), abs=1e-4)


def test_a_request_without_an_answer_is_repeated():
    bus = Bus()
    bus.cycle()
    bus.lost = 1
    bus.cycle()
    assert bus.started().drive.fault == ""


def test_a_fault_before_the_start_is_reset_once():
    bus = Bus()
    bus.emulated.states = ["fault"]
    bus.started()
    assert bus.emulated.states == ["fault", *START]
    again = Bus()
    again.emulated.states = ["fault"]
    for _ in range(220):
        again.cycle()
        if again.emulated.state != "fault":
            again.fails("fault")  # it cannot be repaired from here
    assert states(again.drive.fault, "left_ankle", "ready") and again.emulated.states.count("fault") == 2


@pytest.mark.parametrize("spoil", [{"index": 0x6076, "value": 0}, {"index": 0x608F, "value": 0, "sub": 1}])
def test_an_implausible_number_of_the_drive_is_a_fault(spoil):
    bus = Bus()
    bus.emulated.write(**spoil)
    bus.cycle(count=60)
    assert not bus.drive.ready and states(bus.drive.fault, "left_ankle", f"0x{spoil['index']:04X}")
    assert bus.emulated.states == START[:1]


def test_a_rated_torque_too_small_for_the_limit_is_a_fault():
    bus = Bus()
    bus.emulated.write(index=0x6076, value=36)  # 60 N·m are 33 times the 1.8 N·m at the joint
    bus.cycle(count=60)
    assert not bus.drive.ready and states(bus.drive.fault, "left_ankle", "1.8 N·m", "60 N·m")
    assert bus.emulated.states == START[:1]


def test_an_object_that_the_drive_rejects_is_a_fault():
    bus = Bus()
    del bus.emulated.node.object_dictionary[0x6060]
    bus.cycle(count=60)
    assert states(bus.drive.fault, "0x6060", "0x06020000") and not bus.drive.ready


# ------------------------------------------------------------------------------- faults


@pytest.mark.parametrize("state", ["fault", "fault reaction active", "switched on", "quick stop active"])
def test_a_drive_that_leaves_operation_is_a_fault_and_stays_off(bus, state):
    bus.send(bus.drive.cycle(STILL))
    bus.fails(state)
    bus.send(shared_frames())  # the drive reports its state
    bus.cycle(count=20)
    assert states(bus.drive.fault, "left_ankle", state)
    assert bus.emulated.state in (state, "switch on disabled")


def test_a_drive_that_has_failed_is_neither_reset_nor_switched_on_after_a_pause(bus):
    bus.send(bus.drive.cycle(STILL))
    bus.fails("fault")
    bus.send(shared_frames())
    bus.cycle()
    assert states(bus.drive.fault, "left_ankle", "fault")
    bus.send(bus.drive.stop())
    bus.fails("fault")
    bus.cycle(count=60)
    assert bus.emulated.state == "fault" and not bus.drive.ready


def test_a_statusword_of_no_state_is_a_fault(bus):
    bus.drive.receive(MotorFrame(0x185, bytes.fromhex("02 00 00 00 00 00 00 00")))
    assert states(bus.drive.fault, "left_ankle", "0x0002")


def test_a_torque_that_is_no_number_is_a_fault_and_sent_as_zero(bus):
    bus.cycle(replace(STILL, torque=math.nan))
    assert states(bus.drive.fault, "left_ankle", "finite") and bus.emulated.torques[-1] == 0


def test_an_emergency_and_the_end_of_the_operation_of_the_bus_are_faults(bus):
    other = Bus().started()
    bus.drive.receive(MotorFrame(0x085, bytes.fromhex("10 23 01 00 00 00 00 00")))
    assert states(bus.drive.fault, "0x2310")
    other.drive.receive(MotorFrame(0x705, bytes([0x7F])))
    assert states(other.drive.fault, "operational")
    for identifier in (0x086, 0x706):  # another node
        quiet = Bus().started()
        quiet.drive.receive(MotorFrame(identifier, bytes([0x7F])))
        assert quiet.drive.fault == ""


def test_a_silent_drive_is_a_fault_after_the_timeout_and_not_before(bus):
    bus.cycle(count=3)
    bus.emulated.muted = True
    bus.cycle(count=10)
    assert bus.drive.fault == ""
    bus.cycle()
    assert states(bus.drive.fault, "left_ankle", "20 ms")


def test_a_drive_that_is_not_there_is_a_fault():
    drive = Cia402Drive(SETTINGS)
    for _ in range(200):
        drive.cycle(STILL)
    assert drive.fault == ""
    drive.cycle(STILL)
    assert states(drive.fault, "left_ankle", "ready")


def test_an_angle_outside_its_range_is_a_fault(bus):
    bus.emulated.position = round(0.8 / (2 * math.pi) * GEAR * COUNTS)
    bus.cycle()
    assert states(bus.drive.fault, "left_ankle", "0.8", "-0.7", "0.7")
    bus.cycle()
    assert bus.emulated.state == "operation enabled"  # so that the hold of the walk can brake it


def test_the_stop_is_a_quick_stop_and_the_next_cycle_starts_anew(bus):
    bus.send(bus.drive.stop())
    assert bus.emulated.state == "quick stop active" and bus.emulated.target == 0
    bus.started()
    assert bus.emulated.states == [*START, "quick stop active", *START]
    assert Cia402Drive(SETTINGS).stop() == []
