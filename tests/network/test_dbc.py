"""Tests of the packaged DBC file: agreement with cantools, required ranges, and refused files."""

from __future__ import annotations

import math
import struct
import sys

import cantools
import numpy as np
import pytest
from errors import raises, states

from twin_gait.configuration.experiments import load_experiment, presets
from twin_gait.control.safety import SafetyState, TripCause
from twin_gait.core.can_codec import pack_frame, unpack_frame
from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.exceptions import MissingOptionalDependency, ParameterFileError
from twin_gait.files import shipped_file
from twin_gait.network.dbc import PACKAGED_DBC, load_messages
from twin_gait.parameters.network import BOARDS, NetworkParameters
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import GaitPhase

PATH = shipped_file(PACKAGED_DBC)
MESSAGES = load_messages()
TWIN = BOARDS[:4]
DATABASE = cantools.database.load_file(PATH)


def bounds(message: str, signal: str) -> tuple[float, float]:
    return MESSAGES[message].bounds(signal)


# ------------------------------------------------------------------------------- against cantools


@pytest.mark.parametrize("count", [1_000, pytest.param(70_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", MESSAGES)
def test_the_codec_and_cantools_read_and_write_the_same_frames(name, count):
    """15 messages of 70 000 random frames each: 1.05 million."""
    message, other = MESSAGES[name], DATABASE.get_message_by_name(name)
    draw = np.random.default_rng(message.identifier)
    frames = draw.integers(0, 256, (count, 8), np.uint8)
    frames[:, message.length :] = 0
    layout, values, halves = message.layout, [0.0] * len(message.signals), [0, 0]
    for frame in frames:
        data = frame.tobytes()
        unpack_frame(layout, struct.unpack("<2I", data), values)
        theirs = other.decode(data[: message.length], decode_choices=False)
        for signal, number, value in zip(
            message.signals, values, (theirs[k] for k in message.signals), strict=True
        ):
            low, high = bounds(name, signal)
            if math.isnan(number):
                assert not low <= value <= high
                theirs[signal] = low
            else:
                assert number == value  # to the last bit
        pack_frame(layout, [theirs[k] for k in message.signals], halves)
        assert struct.pack("<2I", *halves)[: message.length] == other.encode(theirs, strict=True)


@pytest.mark.parametrize("name", MESSAGES)
def test_random_numbers_have_the_same_bits_as_in_cantools(name):
    message, other = MESSAGES[name], DATABASE.get_message_by_name(name)
    draw = np.random.default_rng(message.identifier)
    halves = [0, 0]
    ranges = [bounds(name, signal) for signal in message.signals]
    for _ in range(1_000):
        values = [
            float(draw.integers(low, high + 1)) if signal.scale == 1.0 else float(draw.uniform(low, high))
            for (low, high), signal in zip(ranges, message.signals.values(), strict=True)
        ]
        pack_frame(message.layout, values, halves)
        theirs = other.encode(dict(zip(message.signals, values, strict=True)))
        assert struct.pack("<2I", *halves)[: message.length] == theirs


# ------------------------------------------------------------------------------- what it has to hold


def test_code_for_a_missing_value_is_outside_the_range_of_its_signal():
    for message in MESSAGES.values():
        for name, signal in message.signals.items():
            plain = signal.scale == 1.0  # counters and codes
            assert plain or not signal.lowest <= signal.missing <= signal.highest, f"{message.name}.{name}"


def test_setpoints_have_priority_over_measurements_and_both_over_other_frames():
    kinds = ("setpoint", "measurement", "battery", "imu", "gait_state", "command")
    order = [
        item.name.rpartition("_")[2] for item in sorted(MESSAGES.values(), key=lambda item: item.identifier)
    ]
    order = ["gait_state" if kind == "state" else kind for kind in order]
    assert list(dict.fromkeys(order)) == list(kinds)
    assert len({item.identifier for item in MESSAGES.values()}) == len(MESSAGES)
    for board in TWIN:
        assert DATABASE.get_message_by_name(f"{board}_setpoint").senders == ["ccu"]
        assert DATABASE.get_message_by_name(f"{board}_measurement").senders == [board]
        assert (
            MESSAGES[f"{board}_setpoint"].cycle
            == MESSAGES[f"{board}_measurement"].cycle
            == NetworkParameters.cycle
        )


def test_a_step_of_the_angle_is_finer_than_a_count_of_the_encoder():
    assert MESSAGES["left_hip_measurement"].signals["angle"].scale < 2.0 * math.pi / 8192 / 100


def test_torque_resolution_divides_the_resolution_of_the_monitor():
    for kind in ("setpoint", "command"):
        ratio = 0.05 / MESSAGES[f"left_knee_{kind}"].signals["torque"].scale
        assert ratio == pytest.approx(round(ratio))


# Phases whose damping the range holds, but not with half of it to spare.
ON_CHAIR = ("lean", "rise", "straighten", "reach_back", "lower")


# The shipped DBC file is that of TWIN; the layout of another device is generated.
OF_TWIN = [name for name in presets() if load_experiment(name).experiment.device.name.startswith("twin")]


@pytest.mark.parametrize("preset", OF_TWIN)
def test_the_ranges_cover_the_shipped_experiments_with_a_margin_of_half(preset):
    experiment = load_experiment(preset).experiment
    problem = build_setup(experiment)
    safety, limits = experiment.control.safety, experiment.control.limits
    every = problem.phase_rows[:, :, :-1]
    steps = [number for number, name in enumerate(experiment.table.phases) if name not in ON_CHAIR]
    rows = every[:, steps].reshape(-1, COLUMNS_PER_JOINT)
    assert bounds("left_hip_setpoint", "damping")[1] > every.reshape(-1, COLUMNS_PER_JOINT)[:, 1].max()
    held = {
        "stiffness": 1.5 * rows[:, 0].max(),
        "damping": 1.5 * rows[:, 1].max(),
        "gain": 1.0,
        "torque": 1.25 * max(limits[joint].torque for joint in experiment.joints),
    }
    for name, value in held.items():
        assert bounds("left_hip_setpoint", name)[1] >= value
    low, high = bounds("left_hip_setpoint", "equilibrium")
    assert low <= rows[:, 2].min() - 0.3 and high >= rows[:, 2].max() + 0.3
    assert bounds("left_hip_measurement", "current")[1] > safety.current_share * max(
        limits[joint].current for joint in experiment.joints
    )


def test_the_ranges_cover_the_joints_of_the_device():
    """With ten degrees for an encoder that is calibrated badly, and twice the no-load speed."""
    import xml.etree.ElementTree as ElementTree

    ends = [
        {name: float(item.get(name, "0")) for name in ("lower", "upper", "velocity", "effort")}
        for item in ElementTree.parse(shipped_file("twin.urdf")).getroot().iter("limit")
    ]
    motors = [item for item in ends if item["effort"] > 0.0]
    assert len(motors) == len(TWIN)
    for item in motors:
        low, high = bounds("left_hip_measurement", "angle")
        assert low <= item["lower"] - math.radians(10.0) and high >= item["upper"] + math.radians(10.0)
        assert bounds("left_hip_measurement", "velocity")[1] >= 2.0 * item["velocity"]


def test_codes_equal_the_codes_of_the_program():
    causes = {str(item): item.code for item in TripCause}
    state, bus_causes = (
        MESSAGES["gait_state"].codes,
        {"bus_timeout": 16},
    )  # which no board reports about itself
    assert MESSAGES["left_hip_measurement"].codes["trip_cause"] | bus_causes == causes
    assert state["trip_cause"] == causes
    assert state["safety_state"] == {str(item): item.code for item in SafetyState}
    assert [state["left_phase"][phase] for phase in GaitPhase] == list(range(5))
    tables = {phase for preset in OF_TWIN for phase in load_experiment(preset).experiment.table.phases}
    # Four bits hold no more; these are sent as another one.
    assert tables - set(state["left_phase"]) == {"straighten", "upright", "reach_back", "lower", "gravity"}
    assert state["left_phase"] == state["right_phase"] and state["left_phase"]["other"] == 15


# ------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("old", "new", "facts"),
    [
        ("imu: 4 imu", "gyro: 4 imu", ("imu",)),
        (
            'SG_ pitch : 0|15@1- (0.0002,0) [-3.2766|3.2766] "rad"',
            'SG_ p : 0|15@1- (1,0) [0|0] "rad"',
            ("imu.pitch",),
        ),
        (
            '(0.0002,0) [-3.2766|3.2766] "rad"',
            '(0.0002,0) [-3.2766|3.2766] "deg"',
            ("rad", "deg"),
        ),
        (
            "SG_ power : 13|14@1-",
            "SG_ power : 18|14@1-",
            ("battery.power", "31"),
        ),
        ("SG_ time : 32|31@1+", "SG_ time : 24|31@1+", ("gait_state.time", "31")),
        (
            "SG_ power : 13|14@1-",
            "SG_ power : 23|14@0-",
            ("battery.power", "Intel"),
        ),
        (
            '0 "off" 1 "hold" 2 "run"',
            '0 "run" 1 "hold" 2 "off"',
            ("left_hip_setpoint.state", "0", "off"),
        ),
        ("BO_ 513 battery", "BO_ 2147484161 battery", ("battery", "11")),
        ('BA_ "GenMsgCycleTime" BO_ 514 10;', "", ("imu", "GenMsgCycleTime")),
        ("SG_ voltage : 0|13@1+", "SG_ voltage : 1|13@1+", ("DBC",)),
        ("BU_: ccu", "BU_ ccu", ("DBC",)),
    ],
)
def test_signals_unsupported_by_the_codec_are_refused_in_one_line(tmp_path, old, new, facts):
    text = PATH.read_text(encoding="ascii")
    assert old in text
    path = tmp_path / "other.dbc"
    path.write_text(text.replace(old, new), encoding="ascii")
    with pytest.raises(ParameterFileError) as caught:
        load_messages(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and states(message, *facts) and "\n" not in message


def test_a_missing_file_is_named():
    with raises(ParameterFileError, "none.dbc", "twin.dbc"):
        load_messages("none.dbc")


def test_without_cantools_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "cantools", None)
    with raises(MissingOptionalDependency, "pip install 'twin-gait[can]'"):
        load_messages()
