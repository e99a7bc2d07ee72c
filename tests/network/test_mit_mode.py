"""Frames of MIT mode against an emulated drive with its own decoding of the bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from emulated_drives import ENTER, EXIT, PUBLISHED, AkDrive
from errors import raises, states

from twin_gait.configuration.device_file import list_devices, load_device
from twin_gait.exceptions import ParameterError
from twin_gait.network.drives import DriveSettings, MotorFrame, MotorSetpoint
from twin_gait.network.mit_mode import MOTOR_FRAMES, MitDrive, packed_numbers
from twin_gait.parameters.motor_bus import DriveModel

STILL = MotorSetpoint(stiffness=40.0, damping=2.0, equilibrium=0.3, torque=4.0, angle=0.2, velocity=0.0)


def settings(torque_limit: float = 12.0, node: int = 3) -> DriveSettings:
    return DriveSettings(
        board="right_hip", node=node, angles=(-0.5, 2.0), torque_limit=torque_limit, gear_ratio=9.0,
        start_cycles=20, silent_cycles=10, silence_ms=20,
    )  # fmt: skip


def pair(model: str = "AK80-9") -> tuple[MitDrive, AkDrive]:
    """Return a drive of the link that is ready, and the emulated one."""
    drive, emulated = MitDrive(settings(), DriveModel(model)), AkDrive(3, model)
    exchange(drive, emulated)
    assert drive.ready and emulated.on and emulated.commands == []
    return drive, emulated


def exchange(drive: MitDrive, emulated: AkDrive, setpoint: MotorSetpoint = STILL) -> None:
    """Run a cycle: the frames of the link, and the answers of the drive."""
    for frame in drive.cycle(setpoint):
        for answer in emulated.receive(*frame):
            drive.receive(MotorFrame(*answer))


def test_every_shipped_device_states_the_protocol_of_its_drives():
    devices = [load_device(name) for name in list_devices() if name != "ideal"]
    found = {item.name: item.sections["plant"]["motor_bus"]["protocol"] for item in devices}
    assert {name for name, protocol in found.items() if protocol == "mit"} == {"ak80_9_hip", "knee_orthosis"}
    assert set(found.values()) == {"mit", "twin"}


def test_the_models_are_those_of_another_program():
    stated = {name: (row["velocity"], row["torque"]) for name, row in MOTOR_FRAMES["mit"]["models"].items()}
    assert stated == PUBLISHED and set(stated) == set(DriveModel)


@pytest.mark.parametrize("model", DriveModel)
def test_the_emulated_drive_decodes_the_setpoint_and_its_torque(model):
    """The impedance of the drive and the feed-forward torque add up to the torque of the command."""
    drive, emulated = pair(model)
    draw = np.random.default_rng(1)
    step = {
        item.name: (item.high - item.low) / (2**item.bits - 1) for item in packed_numbers("command", model)
    }
    for _ in range(300):
        setpoint = MotorSetpoint(
            stiffness=draw.uniform(0.0, 30.0),
            damping=draw.uniform(0.0, 8.0),
            equilibrium=draw.uniform(-0.5, 1.5),
            torque=draw.uniform(-3.0, 3.0),
            angle=(angle := draw.uniform(-0.5, 1.5)),
            velocity=draw.uniform(-1.0, 1.0),
        )
        exchange(drive, emulated, setpoint)
        position, velocity, kp, kd, torque = emulated.commands[-1]
        if kp == 0.0:  # the rest was beyond the range of the feed-forward torque
            rest = setpoint.torque - setpoint.stiffness * (setpoint.equilibrium - angle)
            assert abs(rest) > PUBLISHED[model][1] - 5.0 and kd == 0.0
        else:
            assert abs(position - setpoint.equilibrium) <= 0.51 * step["position"]
            assert abs(kp - setpoint.stiffness) <= 0.51 * step["stiffness"]
            assert abs(kd - min(setpoint.damping, 5.0)) <= 0.51 * step["damping"]
        total = kp * (position - angle) + kd * (velocity - setpoint.velocity) + torque
        rounding = (
            0.51 * step["torque"]
            + 2.0 * 0.51 * step["stiffness"]
            + 30.1 * 0.51 * step["position"]
            + 0.51 * step["damping"]
            + 5.0 * 0.51 * step["velocity"]
        )
        assert abs(total - setpoint.torque) <= rounding
    assert sum(command[2] > 0.0 for command in emulated.commands) > 100


def test_the_codes_are_within_one_of_the_formula_of_the_manual():
    """Page 51 multiplies by 2^n, and cuts off: its highest number has no code."""
    for number in packed_numbers("command", DriveModel.AK80_9):
        for share in np.linspace(0.0, 0.999, 101):
            value = number.low + share * (number.high - number.low)
            manual = int((value - number.low) * (2**number.bits / (number.high - number.low)))
            assert abs(number.encode(value) - manual) <= 1
        assert (number.encode(number.low - 1), number.encode(number.high + 1)) == (0, 2**number.bits - 1)


def test_more_than_a_number_can_hold_is_sent_as_torque_alone():
    drive, emulated = pair()
    hard = MotorSetpoint(stiffness=519.0, damping=2.0, equilibrium=0.3, torque=7.5, angle=0.2, velocity=0.0)
    saturated = MotorSetpoint(
        stiffness=97.7, damping=6.8, equilibrium=0.3, torque=-12.0, angle=-0.4, velocity=0.0
    )
    for setpoint in (hard, saturated):
        exchange(drive, emulated, setpoint)
        *_, kp, kd, torque = emulated.commands[-1]
        assert (kp, kd) == (0.0, 0.0) and abs(torque - setpoint.torque) <= 0.51 * 36.0 / 4095
    assert drive.fault == ""


def test_a_drive_is_switched_on_reports_and_is_switched_off():
    drive, emulated = MitDrive(settings(), DriveModel.AK80_9), AkDrive(3, "AK80-9", velocity=-2.0, torque=5.0)
    assert drive.cycle(STILL) == [(3, ENTER)] and not drive.ready
    assert drive.cycle(STILL) == [(3, ENTER)]  # until it answers
    exchange(drive, emulated)
    assert drive.report == pytest.approx((0.2, -2.0, 5.0), abs=0.02)
    (off,) = drive.stop()
    assert off == (3, EXIT)
    for answer in emulated.receive(*off):
        drive.receive(MotorFrame(*answer))  # the answer to the frame that switches it off
    assert not emulated.on and drive.cycle(STILL) == [(3, ENTER)] and drive.fault == ""


def test_frames_of_others_are_ignored():
    drive = MitDrive(settings(), DriveModel.AK80_9)
    drive.cycle(STILL)
    (answer,) = AkDrive(4, "AK80-9").receive(4, ENTER)
    drive.receive(MotorFrame(*answer))
    drive.receive(MotorFrame(3, bytes([3, 0])))
    drive.receive(MotorFrame(0x181, bytes([3, 0, 0, 0, 0, 0, 0, 9])))
    assert drive.report is None and not drive.ready and drive.fault == ""


@pytest.mark.parametrize(("error", "word"), [(1, "over-temperature"), (5, "encoder"), (77, "77")])
def test_an_error_code_is_a_fault_in_words(error, word):
    drive, emulated = pair()
    emulated.error = error
    exchange(drive, emulated)
    assert states(drive.fault, "3", "right_hip", word)
    emulated.error = 0
    exchange(drive, emulated)
    assert states(drive.fault, word)  # the first fault stays


def test_a_silent_drive_is_a_fault_after_the_timeout_and_not_before():
    drive, emulated = pair()
    for _ in range(3):
        exchange(drive, emulated)
    emulated.silent = True
    for _ in range(10):
        exchange(drive, emulated)
    assert drive.fault == ""
    exchange(drive, emulated)
    assert states(drive.fault, "right_hip", "20 ms")


def test_a_drive_that_never_answers_is_a_fault():
    drive = MitDrive(settings(), DriveModel.AK80_9)
    for cycle in range(21):
        assert drive.fault == "", cycle
        drive.cycle(STILL)
    assert states(drive.fault, "right_hip", "ready")


def test_a_faulty_drive_is_never_switched_on():
    drive, emulated = MitDrive(settings(), DriveModel.AK80_9), AkDrive(3, "AK80-9", silent=True)
    for _ in range(21):
        exchange(drive, emulated)
    emulated.silent = False  # it answers too late
    for _ in range(5):
        exchange(drive, emulated)
    assert states(drive.fault, "ready") and not drive.ready and not emulated.on and emulated.entered == 0
    other, late = pair()
    late.error = 1
    exchange(other, late)
    late.receive(*other.stop()[0])
    exchange(other, late)
    assert not late.on and late.entered == 1


@pytest.mark.parametrize("torque", [np.nan, np.inf])
def test_a_torque_that_is_no_number_is_a_fault_and_sent_as_zero(torque):
    drive, emulated = pair()
    exchange(drive, emulated, replace(STILL, torque=torque, angle=np.nan))
    assert states(drive.fault, "right_hip", "finite")
    *_, kp, kd, sent = emulated.commands[-1]
    assert (kp, kd) == (0.0, 0.0) and abs(sent) <= 0.51 * 36.0 / 4095


def test_an_angle_outside_its_range_is_a_fault():
    drive, emulated = pair()
    emulated.angle = 2.3
    exchange(drive, emulated)
    assert states(drive.fault, "right_hip", "2.3", "-0.5", "2")


def test_a_torque_limit_beyond_the_range_of_the_model_is_refused():
    with raises(ParameterError, "control.limits.hip.torque_Nm", "18", "19", "AK80-9"):
        MitDrive(settings(torque_limit=19.0), DriveModel.AK80_9)
