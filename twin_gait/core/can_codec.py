"""Signals of a CAN frame: conversion of numbers to bits and back.

The eight bytes of a frame are two halves, bytes 0 to 3 and 4 to 7, each an integer in Intel's byte order. No
signal crosses from one half to the other and the highest bit of a half stays 0, so that a half is a
non-negative number of 32 bits in Python, in machine code and in C.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

HALF_BITS = 31  # Number of bits of a half that signals may use.


@dataclass(slots=True)
class SignalLayout:
    """Position of a signal in its frame, and scaling of its code."""

    half: int  # 0 for bytes 0 to 3 of the frame, 1 for bytes 4 to 7.
    start: int  # Position of the lowest bit in the half.
    mask: int  # Mask of all bits of the signal, as if it started at bit 0.
    sign: int  # Highest bit if the signal is signed, in two's complement; otherwise 0.
    missing: int  # Code of a missing number.
    scale: float  # Step of the code in the unit of the signal.
    offset: float  # Value of code 0 in the unit of the signal.
    lowest: float  # Smallest code of a number, a whole number.
    highest: float  # Largest code of a number, a whole number.


def encode_signal(signal: SignalLayout, value: float) -> int:
    r"""Encode a number as the nearest code within the range of the signal.

    :math:`c = \left\lfloor \frac{x - x_0}{s} + \frac{1}{2} \right\rfloor`

    ``value``: x in the unit of the signal; NaN for a missing number. Returns c, negative only if the signal
    is signed.
    """
    steps = (value - signal.offset) / signal.scale
    if steps != steps:
        return signal.missing
    if steps < signal.lowest:
        steps = signal.lowest
    elif steps > signal.highest:
        steps = signal.highest
    return int(math.floor(steps + 0.5))  # noqa: RUF046  # In C the result of floor is not an integer.


def decode_signal(signal: SignalLayout, code: int) -> float:
    """Decode a code to the number :math:`x = s c + x_0`.

    Returns x in the unit of the signal; NaN for a code outside its range.
    """
    if code < signal.lowest or code > signal.highest:
        return math.nan
    return code * signal.scale + signal.offset


def pack_frame(signals: Sequence[SignalLayout], values: Sequence[float], halves: list[int]) -> None:
    """Write numbers into the bits of a frame; bits that belong to no signal become 0.

    ``values``: one for each signal, in its unit. ``halves``: the two halves of the frame; changed in place.
    """
    halves[0] = 0
    halves[1] = 0
    for index, signal in enumerate(signals):
        halves[signal.half] += (encode_signal(signal, values[index]) & signal.mask) << signal.start


def unpack_frame(signals: Sequence[SignalLayout], halves: Sequence[int], values: list[float]) -> None:
    """Read numbers from the bits of a frame.

    ``halves``: the two halves of the frame. ``values``: one for each signal, in its unit; changed in place.
    """
    for index, signal in enumerate(signals):
        bits = (halves[signal.half] >> signal.start) & signal.mask
        values[index] = decode_signal(signal, (bits ^ signal.sign) - signal.sign)
