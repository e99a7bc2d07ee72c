"""Frames of the CAN network as the firmware packs and unpacks them; these functions are printed as C."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin_gait.core.can_codec import SignalLayout, pack_frame, unpack_frame
from twin_gait.network.dbc import Message

_NOTHING = SignalLayout(0, 0, 0, 0, 0, 1.0, 0.0, 0.0, 0.0)  # a signal without bits, which is 0


@dataclass(slots=True)
class CanMessage:
    """A message of the DBC file."""

    identifier: int  # Identifier of 11 bits.
    length: int  # Length in bytes.
    # Signals in the order of the README, padded by signals without bits to one number for all messages.
    signals: list[SignalLayout]


@dataclass(slots=True)
class CanFrame:
    """A frame on the bus."""

    identifier: int = 0  # Identifier of 11 bits.
    length: int = 0  # Length in bytes.
    # Bytes 0–3 and bytes 4–7, each as one number with the first byte as the lowest.
    halves: list[int] = field(default_factory=lambda: [0, 0])


def can_pack(message: CanMessage, values: list[float], frame: CanFrame) -> None:
    """Write numbers into a frame.

    There is one number for each signal of the message, in its unit, NaN for none.
    """
    frame.identifier = message.identifier
    frame.length = message.length
    pack_frame(message.signals, values, frame.halves)


def can_unpack(message: CanMessage, frame: CanFrame, values: list[float]) -> bool:
    """Read numbers from a frame, if it is a frame of the message.

    There is one number for each signal, in its unit, NaN for none. Returns whether the frame belongs to the
    message.
    """
    if frame.identifier != message.identifier or frame.length != message.length:
        return False
    unpack_frame(message.signals, frame.halves, values)
    return True


@dataclass(slots=True)
class CanCodec:
    """The codec as a unit for the test; :file:`include/can_codec_step.h` is the same in C."""

    messages: list[CanMessage]  # Messages in the order of the DBC file.


@dataclass(slots=True)
class CanCodecInputs:
    """Numbers to be packed, and a frame to be unpacked."""

    message: int  # Number of the message.
    values: list[float]  # One number for each signal, in its unit.
    frame: CanFrame = field(default_factory=CanFrame)


@dataclass(slots=True)
class CanCodecOutputs:
    """The frame with the packed numbers, and the unpacked numbers."""

    frame: CanFrame
    known: bool  # Whether the frame of the inputs belongs to the message.
    values: list[float]  # Numbers of this frame; the previous numbers if it does not belong to the message.


def can_codec_step(unit: CanCodec, inputs: CanCodecInputs, outputs: CanCodecOutputs) -> None:
    """Pack numbers into a frame, and unpack another frame."""
    message = unit.messages[inputs.message]
    can_pack(message, inputs.values, outputs.frame)
    outputs.known = can_unpack(message, inputs.frame, outputs.values)


def can_messages(messages: Mapping[str, Message]) -> dict[str, CanMessage]:
    """Return the messages of a DBC file in the form of the firmware, by their names in C."""
    width = max(len(message.signals) for message in messages.values())
    return {
        f"message_{name}": CanMessage(
            item.identifier, item.length, item.layout + [_NOTHING] * (width - len(item.signals))
        )
        for name, item in messages.items()
    }
