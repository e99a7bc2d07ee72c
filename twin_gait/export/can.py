"""Frames of a walk on the CAN network, from the rows of its log, and files of them for other tools."""

import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from twin_gait.control.safety import SafetyState, TripCause
from twin_gait.core.can_codec import pack_frame
from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.experiment.bus import bus_messages, device_boards
from twin_gait.experiment.experiment import Experiment
from twin_gait.files import write_atomically
from twin_gait.gait.signals import TRUNK_PITCH
from twin_gait.gait.table import TICK
from twin_gait.network.bus import cyclic_messages
from twin_gait.network.dbc import Message
from twin_gait.network.messages import CODES, COUNTS, MEASUREMENT_SUFFIX, ON_DEMAND, SETPOINT_SUFFIX
from twin_gait.parameters.network import BOARDS
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side

CANDUMP, ASC = "candump", "asc"
CHANNEL = 0  # can0 in a candump file, 1 in an ASC file
_CHUNK = 10_000  # ticks that are converted to frames at once

Rows = Mapping[str, np.ndarray]


class BusFrame(NamedTuple):
    """A frame on the bus."""

    time: float  # time of its tick in [s] since the start of the walk
    identifier: int  # identifier of 11 bits
    data: bytes  # payload


def network_messages(experiment: Experiment) -> dict[str, Message]:
    """Return the messages of the network of an experiment, at its cycle.

    Without a network, these are the messages that are generated for its device.
    """
    network, messages = experiment.network, bus_messages(experiment)
    if network is None:
        return messages
    boards = [f"{side}_{joint}" for side, joint in device_boards(experiment.leg, experiment.plant)]
    cyclic = {item.name: replace(item, cycle=network.cycle) for item in cyclic_messages(messages, boards)}
    return messages | cyclic


def run_frames(run: Run, messages: Mapping[str, Message]) -> Iterator[BusFrame]:
    """Yield all frames of a run of legs, in the order of their times and identifiers."""
    trip = run.trip
    tripped = "" if trip is None or trip.joint is None else f"{trip.side}_{trip.joint}"
    for first in range(0, len(run.log), _CHUNK):
        part = run.log[first : first + _CHUNK]
        rows = {name: part[name].to_numpy() for name in part.columns}
        yield from bus_frames(rows, messages, first=first, body_weight=run.body_weight, tripped=tripped)


def bus_frames(
    rows: Rows, messages: Mapping[str, Message], *, first: int, body_weight: float, tripped: str = ""
) -> list[BusFrame]:
    """Create the frames of some ticks: every message at its own cycle, without delays of the bus.

    A board that the log lacks sends no frames. ``rows``: columns of the log by name, including the names of
    the phases. ``first``: tick of the first row. ``body_weight``: weight of wearer and device in [N].
    ``tripped``: board on which the monitor tripped, such as ``left_knee``; empty for none.
    """
    ticks = first + np.arange(len(rows["safety_state"]))
    found: list[BusFrame] = []
    for message in messages.values():
        values = _signal_values(message, rows, body_weight, tripped)
        if not values:
            continue
        period = max(1, round(message.cycle / TICK))
        values["counter"], values["time"] = ticks // period % COUNTS, ticks * TICK
        due = np.flatnonzero(ticks % period == 0)
        table = np.array([np.broadcast_to(values[name], ticks.shape)[due] for name in message.signals]).T
        for tick, row in zip(ticks[due].tolist(), table.tolist(), strict=True):
            halves = [0, 0]
            pack_frame(message.layout, row, halves)
            data = struct.pack("<2I", *halves)[: message.length]
            found.append(BusFrame(tick * TICK, message.identifier, data))
    return sorted(found, key=lambda frame: frame[:2])


# Signals in the frames of a board, and the endings of the log columns that contain their values.
_SETPOINT = {
    "stiffness": "stiffness_Nm_per_rad",
    "damping": "damping_Nms_per_rad",
    "equilibrium": "equilibrium_rad",
    "gain": "friction_compensation_gain",
}
_FEED_FORWARD_TERMS = ("gravity_compensation", "inertia_compensation", "target")
_MEASUREMENT = {
    "angle": "measured_angle_rad",
    "velocity": "velocity_fast_rad_per_s",
    "current": "measured_current_A",
}


def _signal_values(message: Message, rows: Rows, body_weight: float, tripped: str) -> dict[str, Any]:
    """Return the values of the signals by name, without counter and time; empty if no node sends them."""
    board, _, kind = message.name.rpartition("_")
    if message.name.endswith(ON_DEMAND) or (board in BOARDS and _angle_column(board) not in rows):
        return {}
    if kind == SETPOINT_SUFFIX:
        states = np.array([CODES["state"].index(name) for name in ("run", "hold")])
        return {
            **{name: rows[f"{board}_{column}"] for name, column in _SETPOINT.items()},
            "torque": sum(rows[f"{board}_{name}_torque_Nm"] for name in _FEED_FORWARD_TERMS),
            "state": states[rows["safety_state"].astype(int)],
        }
    if kind == MEASUREMENT_SUFFIX:
        side, _, joint = board.partition("_")
        lowest = [name for name in JointName if _angle_column(f"{side}_{name}") in rows][-1]
        force = rows.get(f"{side}_foot_normal_force_N", 0.0) if joint == lowest else 0.0
        return {
            **{name: rows[f"{board}_{column}"] for name, column in _MEASUREMENT.items()},
            "foot_load": force / body_weight,
            "trip_cause": _trip_causes(message, rows) if board == tripped else 0.0,
        }
    if message.name == "battery":
        return {"voltage": rows["bus_voltage_V"], "power": rows["battery_power_W"]}
    if message.name == "imu":  # with a guide or a harness the trunk does not pitch; the rate is the true one
        rate = rows.get("trunk_pitch_velocity_rad_per_s", 0.0)
        return {"pitch": rows.get(TRUNK_PITCH.column, 0.0), "pitch_rate": rate}
    return _gait_state(message, rows)


def _angle_column(board: str) -> str:
    """Return the column of the log with the angle that a board measures."""
    return f"{board}_measured_angle_rad"


def _gait_state(message: Message, rows: Rows) -> dict[str, Any]:
    held = rows["safety_state"] == SafetyState.HOLD.code
    found: dict[str, Any] = {"safety_state": rows["safety_state"], "trip_cause": _trip_causes(message, rows)}
    for side in Side:
        name = f"{side}_phase"
        codes = message.codes.get(name, {})
        other = codes.get("other", message.signals[name].highest)
        walked = [codes.get(phase, other) for phase in rows.get(name, np.full(held.shape, "other"))]
        found[name] = np.where(held, codes.get("hold", other), walked)
    return found


def _trip_causes(message: Message, rows: Rows) -> np.ndarray:
    codes = message.codes.get("trip_cause", {})
    # A DBC file may lack a code for a cause.
    trip_codes = [codes.get(str(cause), 0) if codes else cause.code for cause in TripCause]
    return np.take(trip_codes, rows["trip_cause"].astype(int))


def export_can(frames: Iterable[BusFrame], path: str | Path, kind: str) -> None:
    """Write frames as ``candump``, the log format of can-utils, or as ``asc``, the format of Vector."""
    try:
        import can
    except ImportError as error:
        raise MissingOptionalDependency("python-can", "can", "files of CAN frames") from error
    usual: dict[str, Any] = {"is_extended_id": False, "channel": CHANNEL}
    with TemporaryDirectory() as folder:
        written = Path(folder) / "frames"
        with can.CanutilsLogWriter(written) if kind == CANDUMP else can.ASCWriter(written) as writer:
            for frame in frames:
                message = can.Message(frame.time, frame.identifier, data=frame.data, **usual)
                writer.on_message_received(message)
        write_atomically(path, written.read_bytes())
