"""CRC, stuff bits and length of a data frame of CAN 2.0A on the wire.

CRC and stuff bits are computed byte by byte with tables that this module builds from their definitions bit by
bit. Bits follow Bosch's CAN specification 2.0 (1991), part A: 0 is dominant, the start of frame is 0, and the
most significant bit of a byte comes first.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

# The polynomial x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1 without its leading term.
_POLYNOMIAL, _CRC_BITS = 0x4599, 15
_LONGEST_RUN = 5  # Number of equal bits after which a complementary bit is stuffed.
_HEADER_BITS = 19  # Start of frame, identifier, RTR, IDE, r0 and length.
_UNSTUFFED_BITS = 13  # CRC delimiter, acknowledge slot and delimiter, end of frame (7), interframe space (3).


@dataclass(slots=True)
class Header:
    """Properties of a frame that determine its length and CRC up to the data."""

    length: int  # Length of the data in bytes, 0 to 8.
    crc: int  # CRC of the bits before the data.
    run: int  # Run of equal bits before the data, numbered as in the tables of this module.
    stuffed: int  # Number of stuff bits before the data.


def _next_crc(crc: int, bit: int) -> int:
    """Update the CRC with one more bit, as the specification defines it."""
    shifted = (crc << 1) & ((1 << _CRC_BITS) - 1)
    return shifted ^ _POLYNOMIAL if bit != crc >> (_CRC_BITS - 1) else shifted


def _next_run(run: int, bit: int) -> tuple[int, int]:
    """Return the run after one more bit, and the number of bits that were stuffed: 0 or 1.

    A run is numbered by its bit and its length from 1 to 4: the fifth equal bit is followed by a stuff bit.
    """
    last, length = run >> 2, (run & 3) + 1
    if bit != last:
        return bit << 2, 0
    if length + 1 < _LONGEST_RUN:
        return (bit << 2) | length, 0
    return (1 - bit) << 2, 1


def _bits(number: int, count: int) -> Iterable[int]:
    return ((number >> bit) & 1 for bit in reversed(range(count)))


def _run_through(run: int, bits: Iterable[int]) -> tuple[int, int]:
    stuffed = 0
    for bit in bits:
        run, more = _next_run(run, bit)
        stuffed += more
    return run, stuffed


def _run_entry(run: int, byte: int) -> int:
    run, stuffed = _run_through(run, _bits(byte, 8))
    return run | stuffed << 3


_CRC = np.array([reduce(_next_crc, _bits(byte, 8), 0) for byte in range(256)], np.int16)
# The next run is in the lowest three bits, the number of stuff bits above; the index is run and byte.
_RUN = np.array([_run_entry(run, byte) for run in range(8) for byte in range(256)], np.int8)


def new_header(identifier: int, length: int) -> Header:
    """Create the header of a data frame with an identifier of 11 bits and a length in bytes, 0 to 8."""
    bits = (0, *_bits(identifier, 11), 0, 0, 0, *_bits(length, 4))
    run, stuffed = _run_through(0, bits[1:])  # The start of frame is the first dominant bit.
    return Header(length, reduce(_next_crc, bits, 0), run, stuffed)


def frame_crc(header: Header, halves: Sequence[int]) -> int:
    """Compute the CRC of a frame, 15 bits.

    ``halves``: bytes 0 to 3 of its data and bytes 4 to 7, the first byte of a half in the lowest bits.
    """
    crc = header.crc
    for number in range(header.length):
        crc = ((crc << 8) & 0x7FFF) ^ int(_CRC[(crc >> 7) ^ _byte(halves, number)])
    return crc


def _byte(halves: Sequence[int], number: int) -> int:
    return (halves[number >> 2] >> 8 * (number & 3)) & 0xFF


def frame_bits(header: Header, halves: Sequence[int]) -> int:
    """Count the bits of a frame on the wire, with its stuff bits and the interframe space.

    :math:`8n + 47` and one for each stuff bit, at most :func:`max_stuff_bits` of them. ``halves``: as in
    :func:`frame_crc`.
    """
    crc, run, stuffed = frame_crc(header, halves), header.run, header.stuffed
    for number in range(header.length + 1):
        byte = _byte(halves, number) if number < header.length else crc >> 7
        entry = int(_RUN[(run << 8) | byte])
        run, stuffed = entry & 7, stuffed + (entry >> 3)
    # The last 7 bits, and one more that differs from the last, so that it completes no run.
    stuffed += int(_RUN[(run << 8) | ((crc & 0x7F) << 1) | (~crc & 1)]) >> 3
    return _HEADER_BITS + 8 * header.length + _CRC_BITS + stuffed + _UNSTUFFED_BITS


def max_stuff_bits(length: int) -> int:
    r"""Compute the maximum stuff bits of a frame with n bytes: :math:`\lfloor (34 + 8n - 1) / 4 \rfloor`."""
    return (_HEADER_BITS + _CRC_BITS + 8 * length - 1) // (_LONGEST_RUN - 1)


def max_frame_bits(length: int) -> int:
    """Count the bits of the longest frame with ``length`` bytes of data, interframe space included."""
    return _HEADER_BITS + 8 * length + _CRC_BITS + max_stuff_bits(length) + _UNSTUFFED_BITS
