"""What the frames of the thesis's board monitor (2.4) ask of the controls of a live session."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import NamedTuple

from twin_gait.core.can_codec import unpack_frame
from twin_gait.live.controls import QUANTITIES
from twin_gait.live.protocol import Control, MessageRefused, Value
from twin_gait.network.dbc import Message
from twin_gait.network.messages import ON_DEMAND

MODE = "mode"


class Wish(NamedTuple):
    """What a frame asks of a control."""

    value: Value  # in the unit of the control
    # half a step of the signal in that unit: numbers that close are the same on the bus
    tolerance: float = 0.0


Wishes = dict[str, Wish]


def commands_of(messages: Mapping[str, Message]) -> dict[int, Message]:
    """The messages that a monitor sends, by identifier."""
    return {item.identifier: item for item in messages.values() if item.name.endswith(ON_DEMAND)}


def wishes_of(message: Message, data: bytes) -> Wishes:
    """Read a command.

    Returns what it asks for by the name of the control; a signal that says that there is no number asks
    nothing. Raises MessageRefused if the frame has another length.
    """
    if len(data) != message.length:
        raise MessageRefused(f"{message.name}: expected {message.length} bytes, got {len(data)}")
    values = [math.nan] * len(message.signals)
    unpack_frame(message.layout, struct.unpack("<2I", data.ljust(8, b"\0")), values)
    said = dict(zip(message.signals, values, strict=True))
    side, _, joint = message.name.removesuffix(ON_DEMAND).partition("_")
    wishes = {}
    for quantity, shown in QUANTITIES.items():
        if not math.isnan(said[quantity]):
            tolerance = 0.5 * message.signals[quantity].scale / shown.scale
            wishes[f"monitor.{side}.{joint}.{quantity}"] = Wish(said[quantity] / shown.scale, tolerance)
    names = {code: name for name, code in message.codes["control"].items()}
    return {**wishes, MODE: Wish(names[int(said["control"])])}


def change_of(wish: Wish, control: Control) -> Value | None:
    """Value that a control is to be set to, or None if it has it.

    An end of its range that the bus can only come near to is meant as that end.
    """
    if not isinstance(wish.value, float):
        return None if wish.value == control.value else wish.value
    near = 1.000001 * wish.tolerance
    if abs(wish.value - float(control.value)) <= near:
        return None
    ends = [end for end in (control.least, control.largest) if end is not None]
    return next((end for end in ends if abs(wish.value - end) <= near), wish.value)
