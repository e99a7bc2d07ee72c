"""The initial state of the device's CAN bus."""

import math
from collections.abc import Mapping, Sequence

from twin_gait.core.can_bus import FULL_SCALE, NEVER, NO_INDEX, Bus, Frame, Node, OutageRecord, mix_bits
from twin_gait.core.can_frame import new_header
from twin_gait.network.dbc import Message
from twin_gait.network.messages import MEASUREMENT_SUFFIX, SETPOINT_SUFFIX
from twin_gait.parameters.network import CCU, NetworkParameters, OutageKind
from twin_gait.parameters.network import Outage as OutageParameters

_PICOSECONDS = 1e12  # Number of picoseconds in a second.
_CAPACITY_STEP = 8  # The number of outages in a record is a multiple of this, so that few loops are compiled.


def picoseconds(time: float) -> int:
    """Convert a time in [s] to whole picoseconds; an infinite time becomes ``NEVER``."""
    return round(time * _PICOSECONDS) if math.isfinite(time) else NEVER


def nodes_of(boards: Sequence[str]) -> tuple[str, ...]:
    """Return the nodes of a bus with some boards, in the order of their numbers in a record."""
    return (CCU, *boards)


def cyclic_messages(messages: Mapping[str, Message], boards: Sequence[str]) -> list[Message]:
    """Return the setpoint and measurement frames of some boards, the lowest identifier first."""
    found = [
        messages[f"{board}_{kind}"] for kind in (SETPOINT_SUFFIX, MEASUREMENT_SUFFIX) for board in boards
    ]
    return sorted(found, key=lambda message: message.identifier)


def new_bus(
    network: NetworkParameters, messages: Mapping[str, Message], boards: Sequence[str], seed: int, tick: float
) -> Bus:
    """Create the bus at the start of a run.

    ``network``: parameters of the bus. ``messages``: messages by name, of which the bus carries the cyclic
    ones. ``boards``: boards on the bus. ``seed``: seed of all random numbers. ``tick``: length of a tick in
    [s].
    """
    nodes = nodes_of(boards)
    never = OutageRecord(OutageKind.SILENCE.code, NO_INDEX, NEVER, NEVER)
    outages = sorted((_outage(item, nodes) for item in network.outages), key=lambda item: item.start)
    room = (len(outages) // _CAPACITY_STEP + 1) * _CAPACITY_STEP
    return Bus(
        tick=picoseconds(tick),
        bit=picoseconds(1.0 / network.bit_rate),
        error_share=round(network.error_share * FULL_SCALE),
        loss_share=round(network.loss * FULL_SCALE),
        recovers=network.bus_off_recovery,
        frames=[_frame(network, message, nodes, seed) for message in cyclic_messages(messages, boards)],
        nodes=[Node() for _ in nodes],
        outages=outages + [never] * (room - len(outages)),
    )


def _frame(network: NetworkParameters, message: Message, nodes: Sequence[str], seed: int) -> Frame:
    """Create a frame that a board sends to the central unit, or receives from it."""
    board, _, kind = message.name.rpartition("_")
    sender, receiver = (CCU, board) if kind == SETPOINT_SUFFIX else (board, CCU)
    phase = picoseconds(network.phase.get(sender, 0.0))
    key = mix_bits(mix_bits(seed & 0xFFFFFFFF) ^ (seed >> 32 & 0xFFFFFFFF) ^ mix_bits(message.identifier))
    return Frame(
        header=new_header(message.identifier, message.length),
        sender=nodes.index(sender),
        receiver=nodes.index(receiver),
        period=picoseconds(network.cycle / (1.0 + network.clock_drift.get(sender, 0.0))),
        jitter=picoseconds(network.jitter),
        key=key,
        event=phase,
        release=phase,
    )


def _outage(item: OutageParameters, nodes: Sequence[str]) -> OutageRecord:
    node = NO_INDEX if item.node is None else nodes.index(item.node)
    start = picoseconds(item.time)
    return OutageRecord(item.kind.code, node, start, min(start + picoseconds(item.duration), NEVER))
