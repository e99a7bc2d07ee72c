"""Tests of the generated layout of the bus: TWIN's file, other joints, and ranges that follow the limits."""

import json
import math
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from errors import raises, states
from own_devices import write_device, write_experiment

from twin_gait import load_experiment, simulate
from twin_gait.cli.program import main
from twin_gait.configuration.device_file import load_device
from twin_gait.configuration.validation import packaged
from twin_gait.control.safety import TripCause
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment.bus import bus_messages, device_messages
from twin_gait.export.can import bus_frames, network_messages, run_frames
from twin_gait.files import shipped_file
from twin_gait.network.dbc import PACKAGED_DBC, load_messages
from twin_gait.network.layout import cover, design_messages, widened_signals, write_dbc
from twin_gait.network.messages import MEASUREMENT, SETPOINT, message_designs, phase_codes
from twin_gait.parameters.network import BOARDS, NetworkParameters

SHIPPED = cantools.database.load_file(shipped_file(PACKAGED_DBC))


def sections(name: str) -> tuple[Any, Any, Any]:
    found = load_device(name).parameters()
    return found["leg"], found["plant"], found["control"]


def database(text: str) -> Any:
    return cantools.database.load_string(text, database_format="dbc")


def described(message: Any) -> tuple[Any, ...]:
    """Return everything that a node needs to know of a message."""
    signals = [
        (
            item.name, item.start, item.length, item.is_signed, item.scale, item.offset, item.minimum,
            item.maximum, item.unit, item.receivers, item.choices,
        )
        for item in message.signals
    ]  # fmt: skip
    return message.name, message.frame_id, message.length, message.cycle_time, message.senders, signals


def test_generated_layout_of_twin_is_the_shipped_file() -> None:
    text = write_dbc("twin", device_messages(*sections("twin")))
    generated = database(text)
    assert [item.name for item in generated.messages] == [item.name for item in SHIPPED.messages]
    for ours, theirs in zip(generated.messages, SHIPPED.messages, strict=True):
        assert described(ours) == described(theirs)
    path = shipped_file(PACKAGED_DBC)
    assert path is not None and path.read_text(encoding="ascii") == text
    assert widened_signals(device_messages(*sections("twin"))) == {}


def test_layout_of_twin_has_the_bits_and_steps_of_the_first_release() -> None:
    """Boards that are in the field have these numbers, which must not change with the generator."""
    signals = {
        f"{kind}.{name}": (item.bit, item.bits, item.signed, float(item.step), float(item.offset))
        for kind, entries in (("setpoint", SETPOINT), ("measurement", MEASUREMENT))
        for name, item in entries.items()
    }
    assert signals == {
        "setpoint.stiffness": (32, 13, False, 0.125, 0.0),
        "setpoint.damping": (45, 11, False, 0.1, 0.0),
        "setpoint.equilibrium": (0, 14, False, 0.0002, -0.8),
        "setpoint.gain": (56, 7, False, 0.01, 0.0),
        "setpoint.torque": (14, 13, True, 0.025, 0.0),
        "setpoint.state": (27, 2, False, 1.0, 0.0),
        "setpoint.counter": (29, 2, False, 1.0, 0.0),
        "measurement.angle": (0, 19, False, 6e-6, -0.8),
        "measurement.velocity": (32, 13, True, 0.002, 0.0),
        "measurement.current": (45, 11, True, 0.02, 0.0),
        "measurement.foot_load": (19, 12, False, 0.0005, 0.0),
        "measurement.trip_cause": (56, 5, False, 1.0, 0.0),
        "measurement.counter": (61, 2, False, 1.0, 0.0),
    }
    identifiers = {name: item.identifier for name, item in message_designs(BOARDS[:4]).items()}
    assert identifiers["left_hip_setpoint"] == 0x101 and identifiers["right_knee_measurement"] == 0x184
    assert identifiers["left_knee_command"] == 0x302


def test_a_board_has_the_same_identifiers_in_every_device() -> None:
    every = message_designs(BOARDS)
    for boards in (["right_knee"], ["left_hip", "right_hip"], ["right_hip", "right_knee", "right_ankle"]):
        some = message_designs(boards)
        assert {name: item.identifier for name, item in some.items()} == {
            name: every[name].identifier for name in some
        }
        assert {name.rpartition("_")[0] for name in some if name.endswith("setpoint")} == set(boards)
    assert len({item.identifier for item in every.values()}) == len(every) == 21


def test_causes_of_a_trip_have_the_codes_of_the_program() -> None:
    names = MEASUREMENT["trip_cause"].names
    assert names == {item.code: str(item) for item in TripCause}


@pytest.mark.parametrize(
    ("low", "high", "step", "offset"),
    [
        (-60.0, 60.0, "0.025", "0"),
        (-102.375, 102.375, "0.025", "0"),
        (-102.4, 10.0, "0.05", "0"),
        (0.0, 300.0, "0.125", "0"),
        (-math.inf, math.inf, "0.025", "0"),
    ],
)
def test_a_step_is_the_smallest_of_its_series_that_covers_the_range(
    low: float, high: float, step: str, offset: str
) -> None:
    found = cover(SETPOINT["torque"], low, high)
    assert (found.step, found.offset, found.bits) == (Decimal(step), Decimal(offset), 13)
    if found.step > Decimal("0.025"):
        finer = replace(found, step=found.step / {"0.05": 2, "0.125": Decimal("2.5")}[step])
        assert not (finer.bounds[0] <= Decimal(low) and Decimal(high) <= finer.bounds[1])


def test_an_angle_below_the_usual_range_moves_the_offset() -> None:
    found = cover(MEASUREMENT["angle"], -1.234, 1.0)
    assert (found.offset, found.step) == (Decimal("-1.3"), Decimal("0.000006"))
    wide = cover(MEASUREMENT["angle"], -1.234, 2.5)
    assert (wide.offset, wide.step) == (Decimal("-1.3"), Decimal("0.000012"))
    assert wide.bounds[1] >= Decimal("2.5")


def test_ranges_follow_the_limits_of_a_device(tmp_path: Path) -> None:
    """Only what saturates is widened: 30 A times 1.2 needs 36 A, 90 N·m fit, 104 N·m do not."""
    path = write_device(tmp_path, ["hip", "knee"], torque_Nm=90.0)
    leg, plant, control = sections(str(path))
    text = write_dbc("device", device_messages(leg, plant, control))
    generated = database(text)
    assert set(widened_signals(device_messages(leg, plant, control))) == {
        "right_hip_measurement.current",
        "right_knee_measurement.current",
        "battery.power",  # 2 drives, 30 A, 48 V
    }
    current = generated.get_message_by_name("right_hip_measurement").get_signal_by_name("current")
    assert (current.scale, current.maximum) == (0.04, 40.92)
    assert generated.get_message_by_name("right_hip_setpoint").get_signal_by_name("torque").scale == 0.025
    wide = {"right_hip": {"torque": (-104.0, 104.0)}, "right_knee": {}}
    designs = design_messages(wide)
    assert designs["right_hip_setpoint"].signals["torque"].step == Decimal("0.05")
    assert designs["right_hip_command"].signals["torque"].step == Decimal("0.05")
    assert designs["right_knee_setpoint"].signals["torque"].step == Decimal("0.025")


def test_command_writes_the_layout_which_cantools_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    device, target = write_device(tmp_path, ["hip", "knee", "ankle"]), tmp_path / "own.dbc"
    assert main(["device", str(device), "--dbc", str(target)]) == 0
    assert "right_ankle_measurement.velocity" in capsys.readouterr().out
    found = cantools.database.load_file(target)
    assert found.nodes[0].name == "ccu"
    boards = ["right_hip", "right_knee", "right_ankle"]
    assert [node.name for node in found.nodes][1:4] == boards
    assert {item.name for item in found.messages} == {
        *(f"{board}_{kind}" for board in boards for kind in ("setpoint", "measurement", "command")),
        "battery",
        "imu",
        "gait_state",
    }
    assert load_messages(target).keys() == message_designs(boards).keys()
    assert main(["device", str(device), "--dbc", str(target)]) == 2
    assert "own.dbc" in capsys.readouterr().err
    assert main(["device", str(device), "--dbc", str(target), "--force", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["messages"]) == 12 and document["widened"][0]["unit"] == "A"


USUAL = [
    "early_stance", "middle_stance", "late_stance", "swing_flexion", "swing_extension", "pre_swing", "stand",
    "first_swing", "closing_swing_flexion", "closing_swing_extension", "sit", "lean", "rise",
]  # fmt: skip


def test_own_phases_have_the_codes_of_phases_that_the_table_lacks() -> None:
    usual = {code: name for code, name in enumerate(USUAL)} | {14: "hold", 15: "other"}
    assert phase_codes(()) == phase_codes(["stand", "early_stance"]) == usual
    codes = phase_codes(["Standphase", "early_stance", "Schwungphase"])
    assert codes == {0: "early_stance", 1: "Standphase", 2: "Schwungphase", 14: "hold", 15: "other"}
    many = [f"phase_{number}" for number in range(16)]
    assert list(phase_codes(many).values()) == [*many[:14], "hold", "other"]


def test_command_names_the_phases_of_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A name with an umlaut is read by cantools as it is written."""
    shipped = (packaged("tables")["osl_walking"]).read_text(encoding="utf-8")
    table = tmp_path / "own.yaml"
    table.write_text(shipped.replace("early_swing", "schwung_früh"), encoding="utf-8")
    target, own = tmp_path / "own.dbc", ["--table", str(table)]
    assert main(["device", "osl", "--dbc", str(target), *own]) == 0
    assert "widened" not in capsys.readouterr().out.partition("gait_state")[2]
    choices = cantools.database.load_file(target).get_message_by_name("gait_state")
    named = {str(name): code for code, name in choices.get_signal_by_name("left_phase").choices.items()}
    assert named == {
        "early_stance": 0, "schwung_früh": 1, "late_stance": 2, "late_swing": 3, "hold": 14, "other": 15
    }  # fmt: skip
    assert load_messages(target)["gait_state"].codes["left_phase"] == named
    assert main(["device", "osl", *own]) == 2
    assert states(capsys.readouterr().err, "--table", "--dbc")


def test_frames_of_a_run_have_the_own_phases_of_its_table() -> None:
    experiment = load_experiment("osl_prosthesis").experiment
    messages = bus_messages(experiment)
    codes = messages["gait_state"].codes["left_phase"]
    assert codes.keys() >= {*experiment.table.phase_names}
    rows = {"safety_state": np.zeros(40), "trip_cause": np.zeros(40)}
    rows["left_phase"] = np.repeat(experiment.table.phase_names, 10)
    state = {"gait_state": messages["gait_state"]}
    found = [frame.data[0] for frame in bus_frames(rows, state, first=0, body_weight=1.0)]
    assert found == [codes[name] + 16 * codes["other"] for name in experiment.table.phase_names]


def test_a_device_without_drives_has_no_bus(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bare.yaml"
    actuators = "{hip: null, knee: null}"
    path.write_text(
        f"schema_version: 2\nextends: twin_leg\nplant: {{actuators: {actuators}}}\n", encoding="utf-8"
    )
    assert main(["device", str(path), "--dbc", str(tmp_path / "bare.dbc")]) == 2
    error = capsys.readouterr().err
    assert "bare.yaml" in error and "plant.actuators" in error and error.count("\n") == 1
    assert not (tmp_path / "bare.dbc").exists()


@pytest.mark.parametrize("joints", [("hip",), ("hip", "knee", "ankle")])
def test_another_device_runs_over_its_bus(tmp_path: Path, joints: tuple[str, ...]) -> None:
    path = write_experiment(tmp_path, joints)
    settings = ["network=can", "engine=pinocchio", "duration_s=0.4"]
    experiment = load_experiment(path, settings).experiment
    run = simulate(experiment)
    assert run.traffic is not None
    boards = [f"right_{joint}" for joint in joints]
    assert list(run.traffic["bus_offs"]) == ["ccu", *boards]
    assert {name.rpartition("_")[0] for name in run.traffic["frames"]} == set(boards)
    assert run.traffic["sent"] == 2 * len(boards) * 200 and run.traffic["lost"] == 0
    designs = device_messages(experiment.leg, experiment.plant, experiment.control)
    generated = database(write_dbc("device", designs))
    angles = {board: list[float]() for board in boards}
    for frame in run_frames(run, network_messages(experiment)):
        message = generated.get_message_by_frame_id(frame.identifier)
        if message.name.endswith("measurement"):
            angles[message.name.removesuffix("_measurement")].append(message.decode(frame.data)["angle"])
    for board, values in angles.items():
        logged = run.log[f"{board}_measured_angle_rad"].to_numpy()[::2]
        np.testing.assert_allclose(values, logged, atol=0.5 * 6e-6 + 1e-12)


def test_own_file_must_have_the_boards_of_the_device(tmp_path: Path) -> None:
    path = write_experiment(tmp_path, ["hip", "knee", "ankle"])
    experiment = load_experiment(path, [f"network={{dbc: {PACKAGED_DBC}}}"]).experiment
    with raises(ParameterFileError, PACKAGED_DBC, "right_ankle_setpoint", "network.dbc"):
        bus_messages(experiment)
    leg = load_experiment("bench_leg", [f"network={{dbc: {PACKAGED_DBC}}}"]).experiment
    generated = bus_messages(replace(leg, network=NetworkParameters()))
    assert bus_messages(leg) == generated  # two of the four boards
