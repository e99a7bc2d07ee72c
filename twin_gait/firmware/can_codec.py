"""Frames of the CAN network as the firmware packs and unpacks them; these functions are printed as C."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin_gait.core.can_codec import SignalLayout, pack_frame, unpack_frame
from twin_gait.network.dbc import Message

_NOTHING = SignalLayout(0, 0, 0, 0, 0, 1.0, 0.0, 0.0, 0.0)  # a signal without bits, which is 0


@dataclass(slots=True)
class CanMessage:
    """A message of the DBC file."""

    identifier: int  # Of 11 bits.
    length: int  # In bytes.
    # In the order of the README; behind them some without bits, so that all have as many.
    signals: list[SignalLayout]


@dataclass(slots=True)
class CanFrame:
    """A frame on the bus."""

    identifier: int = 0  # Of 11 bits.
    length: int = 0  # In bytes.
    # Bytes 0 to 3 and bytes 4 to 7, each as one number with the first byte lowest.
    halves: list[int] = field(default_factory=lambda: [0, 0])


def can_pack(message: CanMessage, values: list[float], frame: CanFrame) -> None:
    """Write numbers into a frame.

    One for each signal of the message in its unit, NaN for none.
    """
    frame.identifier = message.identifier
    frame.length = message.length
    pack_frame(message.signals, values, frame.halves)


def can_unpack(message: CanMessage, frame: CanFrame, values: list[float]) -> bool:
    """Read numbers from a frame, if it is one of a message.

    One for each signal, NaN for none. Returns whether it is.
    """
    if frame.identifier != message.identifier or frame.length != message.length:
        return False
    unpack_frame(message.signals, frame.halves, values)
    return True


@dataclass(slots=True)
class CanCodec:
    """The codec as a unit that the test runs; :file:`include/can_codec_step.h` is the same in C."""

    messages: list[CanMessage]  # In the order of the DBC file.


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
    known: bool  # Whether the frame of the inputs is one of the message.
    values: list[float]  # Of that frame; the numbers before it if it is not one.


def can_codec_step(unit: CanCodec, inputs: CanCodecInputs, outputs: CanCodecOutputs) -> None:
    """Pack numbers into a frame, and unpack another frame."""
    message = unit.messages[inputs.message]
    can_pack(message, inputs.values, outputs.frame)
    outputs.known = can_unpack(message, inputs.frame, outputs.values)


def can_messages(messages: Mapping[str, Message]) -> dict[str, CanMessage]:
    """Messages of a DBC file as the firmware has them, by their names in C."""
    width = max(len(message.signals) for message in messages.values())
    return {
        f"message_{name}": CanMessage(
            item.identifier, item.length, item.layout + [_NOTHING] * (width - len(item.signals))
        )
        for name, item in messages.items()
    }
