"""A drive of CiA 402 that tests emulate: bus, objects and mapping by canopen, state machine from the profile.

Controlword and statusword are decoded by their bits, as the tables of the profile name them, and not by
the masks of the package.
"""

from __future__ import annotations

from typing import Any

import canopen
from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable, datatypes

KINDS = {
    8: datatypes.UNSIGNED8, 16: datatypes.UNSIGNED16, 32: datatypes.UNSIGNED32,
    -16: datatypes.INTEGER16, -32: datatypes.INTEGER32, -8: datatypes.INTEGER8,
}  # fmt: skip
# Index and bits of the objects of CiA 402; negative: signed.
OBJECTS = {
    0x6040: 16, 0x6041: 16, 0x6060: -8, 0x6064: -32, 0x606C: -32, 0x6071: -16, 0x6072: 16, 0x6076: 32,
    0x6077: -16, 0x1017: 16,
}  # fmt: skip
REMOTE, TARGET_REACHED = 1 << 9, 1 << 10  # bits of the statusword that do not belong to a state


def dictionary() -> ObjectDictionary:
    """Return the object dictionary of a drive whose cyclic frames are not mapped yet."""
    found = ObjectDictionary()

    def add(parent: Any, index: int, sub: int, bits: int, default: int = 0) -> None:
        variable = ODVariable(f"{index:04X}:{sub}", index, sub)
        variable.data_type, variable.access_type, variable.default = KINDS[bits], "rw", default
        parent.add_member(variable) if parent is not found else found.add_object(variable)

    for index, bits in OBJECTS.items():
        add(found, index, 0, bits)
    for kind, index, sizes in (
        (ODArray, 0x1016, [8, 32]),
        (ODArray, 0x608F, [8, 32, 32]),
        *((ODRecord, 0x1400 + 0x400 * tx + k, [8, 32, 8]) for tx in (0, 1) for k in (0, 1)),
        *((ODArray, 0x1600 + 0x400 * tx + k, [8, *[32] * 8]) for tx in (0, 1) for k in (0, 1)),
    ):
        record = kind(f"{index:04X}", index)
        for sub, bits in enumerate(sizes):
            communication = kind is ODRecord and sub == 1
            add(record, index, sub, bits, 1 << 31 if communication else 0)
        found.add_object(record)
    return found


class Wire(canopen.Network):
    """Network without a bus: frames are collected, and nothing is sent by a thread."""

    def __init__(self) -> None:
        super().__init__()
        self.sent: list[tuple[int, bytes]] = []

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        self.sent.append((can_id, bytes(data)))

    def send_periodic(self, can_id: int, data: Any, period: float, remote: bool = False) -> Any:
        return Heartbeat()


class Heartbeat:
    """Cyclic frame that is never sent."""

    def update(self, data: Any) -> None: ...

    def stop(self) -> None: ...


class CanopenDrive:
    """Drive on a network of canopen.

    Attributes:
        states: States that it has had, in order.
        torques: Target torques in thousandths, of each cycle in which operation was enabled.
    """

    def __init__(
        self, node: int, network: canopen.Network, *, rated_mNm: int = 800, counts: int = 4096
    ) -> None:
        self.node = canopen.LocalNode(node, dictionary())
        network.add_node(self.node)
        self.network, self.states, self.torques = network, ["switch on disabled"], list[int]()
        self.position, self.velocity, self.torque = 0, 0, 0
        self.muted, self._last_control = False, 0
        self.write(0x6076, rated_mNm)
        self.write(0x608F, counts, 1)
        self.write(0x608F, 1, 2)
        self.node.nmt.state = "PRE-OPERATIONAL"
        network.subscribe(0x000, self._on_node_control)
        network.subscribe(0x080, self._on_sync)

    def write(self, index: int, value: int, sub: int = 0) -> None:
        item = self.node.sdo[index] if sub == 0 else self.node.sdo[index][sub]
        item.raw = value

    def read(self, index: int, sub: int = 0) -> int:
        item = self.node.sdo[index]
        return (item if sub == 0 and not hasattr(item, "keys") else item[sub]).raw

    @property
    def state(self) -> str:
        return self.states[-1]

    def _on_node_control(self, identifier: int, data: bytes, timestamp: float) -> None:
        if data[0] == 1 and data[1] in (0, self.node.id):
            for pdos in (self.node.rpdo, self.node.tpdo):
                pdos.read()
            self.node.rpdo[1].callbacks.clear()
            self.node.rpdo[1].add_callback(lambda pdo: self.control(pdo[0].raw, pdo[1].raw))

    def control(self, word: int, target: int) -> None:
        """Execute a controlword (CiA 402, transitions 2 to 16) and a target torque."""
        switch_on, voltage, no_stop, operate = (word >> bit & 1 for bit in range(4))
        reset = word >> 7 & 1 and not self._last_control >> 7 & 1
        self._last_control = word
        now, then = self.state, self.state
        if now == "fault":
            then = "switch on disabled" if reset else now
        elif now == "fault reaction active":
            pass
        elif not voltage:
            then = "switch on disabled"
        elif not no_stop:
            then = {"operation enabled": "quick stop active", "quick stop active": now}.get(
                now, "switch on disabled"
            )
        elif not switch_on:
            then = now if now == "quick stop active" else "ready to switch on"
        elif now == "ready to switch on":
            then = "switched on"
        elif now in ("switched on", "quick stop active") and operate:
            then = "operation enabled"
        elif now == "operation enabled" and not operate:
            then = "switched on"
        if then != now:
            self.states.append(then)
        self.target = target
        if then == "operation enabled" and self.read(0x6060) == 10:
            self.torques.append(target)

    @property
    def statusword(self) -> int:
        """Bits 0 to 6 of CiA 402: ready, on, enabled, fault, voltage, no quick stop, switch on disabled."""
        ready, on, enabled, fault, _voltage, no_stop, disabled = (1 << bit for bit in range(7))
        return (
            REMOTE
            | {
                "not ready to switch on": 0,
                "switch on disabled": disabled,
                "ready to switch on": ready | no_stop,
                "switched on": ready | on | no_stop | _voltage,
                "operation enabled": ready | on | enabled | no_stop | _voltage | TARGET_REACHED,
                "quick stop active": ready | on | enabled | _voltage,
                "fault reaction active": ready | on | enabled | fault,
                "fault": fault,
            }[self.state]
        )

    def _on_sync(self, identifier: int, data: bytes, timestamp: float) -> None:
        if self.muted or self.node.nmt.state != "OPERATIONAL":
            return
        for number, values in ((1, (self.statusword, self.position, self.torque)), (2, (self.velocity,))):
            pdo = self.node.tpdo[number]
            for item, value in zip(pdo, values, strict=True):
                item.raw = value
            pdo.transmit()
