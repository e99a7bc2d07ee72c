"""Drives of the profile CiA 402 on CANopen, in cyclic synchronous torque mode.

Objects, identifiers and states are in ``motor_frames.yaml`` with their sources. It has not been tried on a
drive. After it is configured, a drive receives controlword and torque in each cycle, and answers each SYNC
with statusword, position, torque and velocity.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from twin_gait.network.drives import Drive, DriveReport, DriveSettings, MotorFrame, MotorSetpoint
from twin_gait.network.mit_mode import MOTOR_FRAMES

CIA402: dict[str, Any] = MOTOR_FRAMES["cia402"]
ID: Mapping[str, int] = CIA402["identifiers"]
PDOS: Mapping[str, Any] = CIA402["pdos"]
CONTROLWORDS: Mapping[str, int] = CIA402["controlwords"]
_EXPEDITED = {8: 0x2F, 16: 0x2B, 32: 0x23}  # Command bytes of a download by its bits, CiA 301.
_UPLOAD, _UPLOADED, _ABORT = 0x40, 0x43, 0x80  # Read request, its answer with four bytes, and abort, CiA 301.
_ENABLED = "operation_enabled"
_MOST_TORQUE = 2**15 - 1  # Largest target torque in thousandths of the rated torque, an integer of 16 bits.


def state_of(statusword: int) -> str:
    """Return the state of a drive with a statusword; empty if the profile has no such state."""
    states = CIA402["states"].items()
    return next((name for name, row in states if statusword & row["mask"] == row["value"]), "")


def pack_objects(pdo: str, values: Mapping[str, int]) -> bytes:
    """Pack the objects of a cyclic frame, the lowest byte first."""
    data = b""
    for name in PDOS[pdo]["objects"]:
        item = CIA402["objects"][name]
        data += values[name].to_bytes(item["bits"] // 8, "little", signed=item.get("signed", False))
    return data


def unpack_objects(pdo: str, data: bytes) -> dict[str, int]:
    """Unpack the objects of a cyclic frame."""
    values, start = dict[str, int](), 0
    for name in PDOS[pdo]["objects"]:
        item = CIA402["objects"][name]
        end = start + item["bits"] // 8
        values[name] = int.from_bytes(data[start:end], "little", signed=item.get("signed", False))
        start = end
    return values


@dataclass(frozen=True)
class Transfer:
    """Access of the central unit to an object of a drive (SDO)."""

    index: int  # Index of the object.
    sub: int  # Its subindex.
    bits: int = 32  # Length of the value.
    value: int = 0  # Value to write.
    read_as: str = ""  # Name under which the value is stored, if it is read instead.

    @property
    def request(self) -> bytes:
        """Payload of the request."""
        command = _UPLOAD if self.read_as else _EXPEDITED[self.bits]
        address = self.index.to_bytes(2, "little") + bytes([self.sub])
        return bytes([command]) + address + self.value.to_bytes(4, "little")


def access(name: str, value: int | None = None) -> Transfer:
    """Return the transfer that writes a value to a named object, or reads it."""
    item = CIA402["objects"][name]
    reading = {"read_as": name} if value is None else {"value": value}
    return Transfer(item["index"], item.get("sub", 0), item["bits"], **reading)


def pdo_transfers(pdo: str, node: int) -> list[Transfer]:
    """Return the transfers that lay out a cyclic frame: disable it, map its objects, and enable it."""
    row, identifier = PDOS[pdo], ID[pdo] + node
    objects = [CIA402["objects"][name] for name in row["objects"]]
    mapped = [item["index"] << 16 | item.get("sub", 0) << 8 | item["bits"] for item in objects]
    return [
        Transfer(row["communication"], 1, value=CIA402["pdo_disabled"] | identifier),
        Transfer(row["mapping"], 0, 8, 0),
        *(Transfer(row["mapping"], number, value=value) for number, value in enumerate(mapped, 1)),
        Transfer(row["mapping"], 0, 8, len(mapped)),
        Transfer(row["communication"], 2, 8, CIA402["synchronous"]),
        Transfer(row["communication"], 1, value=identifier),
    ]


def shared_frames() -> list[MotorFrame]:
    """Return the frames of a cycle for all drives: the heartbeat of the central unit, and SYNC."""
    heartbeat = MotorFrame(ID["heartbeat"] + CIA402["ccu_node"], bytes([CIA402["operational"]]))
    return [heartbeat, MotorFrame(ID["sync"], b"")]


class Cia402Drive(Drive):
    """Drive of the profile CiA 402: configuration, state machine, torque.

    Attributes:
        state: State of the last statusword; empty before the first one.
    """

    def __init__(self, settings: DriveSettings) -> None:
        """Begin with a drive that is not configured."""
        super().__init__(settings)
        self._begin()

    def _begin(self) -> None:
        """Prepare the configuration, from the state after power-up."""
        node, silence = self.settings.node, self.settings.silence_ms
        self.state, self.ready = "", False
        self._values: dict[str, int] = {"velocity": 0}
        self._transfers = deque(
            [
                *(item for pdo in PDOS for item in pdo_transfers(pdo, node)),
                access("modes_of_operation", CIA402["cyclic_synchronous_torque"]),
                access("producer_heartbeat", silence),
                access("consumer_heartbeat", CIA402["ccu_node"] << 16 | silence),
                *(access(name) for name in ("rated_torque", "increments", "revolutions")),
            ]
        )
        self._asked = self._cycles = 0
        self._may_reset = True

    def _frames(self, setpoint: MotorSetpoint) -> list[MotorFrame]:
        self._cycles += 1
        if self._transfers:
            frames = []
            if self._cycles == 1:
                frames.append(self._node_control("pre_operational"))
            elif self._asked == 0:
                frames.append(MotorFrame(ID["sdo_request"] + self.settings.node, self._transfers[0].request))
            # A request without an answer is repeated.
            self._asked = 0 if self._cycles == 1 else (self._asked + 1) % self.settings.silent_cycles
            return frames
        if not self.state:
            return [self._node_control("start"), self._command("disable_voltage")]
        enabled = self.state == _ENABLED
        self.ready = self.ready or enabled
        if self.ready and not enabled:
            self.fail(f"is in the state {self.state.replace('_', ' ')}")
        command = "disable_voltage" if self.fault and not enabled else CIA402["states"][self.state]["command"]
        if self.state == "fault" and self._may_reset and not self.ready and not self.fault:
            self._may_reset, command = False, "fault_reset"  # once, before the drive is switched on
        return [self._command(command, setpoint.torque if enabled else 0.0)]

    def _node_control(self, command: str) -> MotorFrame:
        return MotorFrame(ID["nmt"], bytes([CIA402["nmt"][command], self.settings.node]))

    @property
    def _rated(self) -> float:
        """Rated torque at the joint in [N·m]."""
        return 1e-3 * self._values["rated_torque"] * self.settings.gear_ratio

    def _thousandths(self, torque: float) -> int:
        """Return a torque at the joint in thousandths of the rated torque."""
        return math.floor(1e3 * torque / self._rated + 0.5)

    def _command(self, name: str, torque: float = 0.0) -> MotorFrame:
        """Return the cyclic frame with a command and a torque in [N·m]."""
        values = {"controlword": CONTROLWORDS[name], "target_torque": self._thousandths(torque)}
        return MotorFrame(ID["rpdo1"] + self.settings.node, pack_objects("rpdo1", values))

    def _stop_frames(self) -> list[MotorFrame]:
        frames = [] if self._transfers else [self._command("quick_stop")]
        self._begin()
        return frames

    def receive(self, frame: MotorFrame) -> None:
        """Process a frame of the drive."""
        node, data = self.settings.node, frame.data
        if frame.identifier == ID["sdo_reply"] + node and len(data) == 8:
            self._receive_answer(data)
        elif frame.identifier == ID["tpdo1"] + node and len(data) == 8 and not self._transfers:
            self._receive_status(unpack_objects("tpdo1", data))
        elif frame.identifier == ID["tpdo2"] + node and len(data) == 4:
            self._values |= unpack_objects("tpdo2", data)
        elif frame.identifier == ID["emergency"] + node and len(data) == 8 and self.ready:
            if error := int.from_bytes(data[:2], "little"):
                self.fail(f"reports the error 0x{error:04X}")
        elif frame.identifier == ID["heartbeat"] + node and len(data) == 1 and self.ready:
            if data[0] != CIA402["operational"]:
                self.fail("has left the state operational of the bus")

    def _receive_answer(self, data: bytes) -> None:
        """Process the answer to a transfer; then the next one begins."""
        if not self._transfers:
            return
        item = self._transfers[0]
        if data[1:4] != item.request[1:4]:
            return
        value = int.from_bytes(data[4:], "little")
        if data[0] == _ABORT:
            self.fail(f"rejects the object 0x{item.index:04X}:{item.sub} (0x{value:08X})")
            return
        if item.read_as:
            if data[0] != _UPLOADED or value == 0:
                self.fail(
                    f"has no plausible {item.read_as.replace('_', ' ')} (0x{item.index:04X}:{item.sub})"
                )
                return
            self._values[item.read_as] = value
            if (
                item.read_as == "rated_torque"
                and self._thousandths(self.settings.torque_limit) > _MOST_TORQUE
            ):
                limit = f"the torque limit of {self.settings.torque_limit:g} N·m"
                self.fail(f"has a rated torque of {self._rated:.3g} N·m at the joint, too small for {limit}")
                return
        self._transfers.popleft()
        self._asked = 0
        if item.read_as == "rated_torque":  # the drive limits the torque, too
            self._transfers.append(access("max_torque", self._thousandths(self.settings.torque_limit)))

    def _receive_status(self, values: Mapping[str, int]) -> None:
        self._values |= values
        self.state = state_of(values["statusword"])
        if not self.state:
            self.fail(
                f"reports the statusword 0x{values['statusword']:04X}, which is no state of the profile"
            )
        turn = self._values["increments"] / self._values["revolutions"] * self.settings.gear_ratio
        unit = 2.0 * math.pi / turn
        angle, velocity = unit * values["position"], unit * self._values["velocity"]
        self._store(DriveReport(angle, velocity, 1e-3 * values["torque"] * self._rated))
