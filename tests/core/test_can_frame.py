"""CRC, stuff bits and length of CAN frames against the specification carried out bit by bit."""

from __future__ import annotations

import numpy as np
import pytest

from twin_gait.core.can_frame import (
    Header,
    frame_bits,
    frame_crc,
    max_frame_bits,
    max_stuff_bits,
    new_header,
)

FRAMES = 100_000


def big_endian(numbers: np.ndarray, count: int) -> np.ndarray:
    """Bits of numbers, the most significant one first, shape ``(count, n)``."""
    return (numbers >> np.arange(count - 1, -1, -1)[:, None]) & 1


def crc_of(bits: np.ndarray) -> np.ndarray:
    """The shift register of the specification (3.1.1), over many frames at once."""
    register = np.zeros(bits.shape[1], np.int64)
    for bit in bits:
        feedback = bit ^ (register >> 14 & 1)
        register = (register << 1) & 0x7FFF
        register[feedback == 1] ^= 0x4599
    return register


def stuff_bits_in(bits: np.ndarray) -> np.ndarray:
    """How many bits a transmitter inserts: one after each five equal ones, inserted ones included."""
    last, run, found = np.full(bits.shape[1], -1), np.zeros(bits.shape[1], int), np.zeros(bits.shape[1], int)
    for bit in bits:
        run = np.where(bit == last, run + 1, 1)
        full = run == 5
        last, run = np.where(full, 1 - bit, bit), np.where(full, 1, run)
        found += full
    return found


def random_halves(length: int, count: int) -> np.ndarray:
    """Halves of random frames; a third each of any bits, of mostly zeros and of mostly ones."""
    random = np.random.default_rng(20 + length)
    words = random.integers(0, 1 << 32, (3, count, 2))
    few, many = words[0] & words[1] & words[2], words[0] | words[1] | words[2]
    return np.where((np.arange(count) % 3 == 0)[:, None], words[0], np.where(words[1] % 2, few, many))


@pytest.mark.parametrize("length", range(9))
def test_crc_and_stuff_bits_equal_the_specification(length: int) -> None:
    count = FRAMES // 9 + 1
    halves = random_halves(length, count)
    identifiers = np.random.default_rng(length).integers(0, 2048, count)
    data = [halves[:, byte // 4] >> (8 * (byte % 4)) & 0xFF for byte in range(length)]
    before = np.vstack(
        [
            np.zeros((1, count), int),
            big_endian(identifiers, 11),
            np.zeros((3, count), int),
            big_endian(np.full(count, length), 4),
            *(big_endian(byte, 8) for byte in data),
        ]
    )
    crc = crc_of(before)
    whole = np.vstack([before, big_endian(crc, 15)])
    assert len(whole) == 34 + 8 * length
    expected = np.column_stack([crc, len(whole) + stuff_bits_in(whole) + 13])

    def found(identifier: int, pair: list[int]) -> tuple[int, int]:
        header = new_header(identifier, length)
        return frame_crc(header, pair), frame_bits(header, pair)

    pairs = zip(identifiers.tolist(), halves.tolist(), strict=True)
    np.testing.assert_array_equal([found(*pair) for pair in pairs], expected)
    assert expected[:, 1].max() <= max_frame_bits(length)
    assert expected[:, 1].min() >= 8 * length + 47


def test_crc_of_the_catalogue() -> None:
    # CRC-15/CAN in the catalogue of parametrised CRC algorithms (reveng): "123456789" gives 0x059E.
    text = b"123456789"
    bits = big_endian(np.frombuffer(text, np.uint8).astype(int), 8).T.reshape(-1, 1)
    after_first = int(crc_of(bits[:8])[0])
    halves = [int.from_bytes(text[start : start + 4], "little") for start in (1, 5)]
    assert frame_crc(Header(8, after_first, 0, 0), halves) == 0x059E
    assert int(crc_of(bits)[0]) == 0x059E


def test_longest_frames_equal_davis_and_others() -> None:
    # Equation (1) of Davis et al. (2007): 8 n + 47 + floor((34 + 8 n - 1) / 4); 135 bits with 8 bytes.
    assert [max_frame_bits(length) for length in (7, 8)] == [125, 135]
    for length in range(9):
        assert max_frame_bits(length) == 8 * length + 47 + (34 + 8 * length - 1) // 4


def test_consecutive_runs_need_the_maximum_number_of_stuff_bits() -> None:
    # 00000 1111 0000 1111 …: every stuff bit begins the next run.
    for length in range(9):
        bits = [0, *(1 - index // 4 % 2 if index >= 0 else 0 for index in range(-4, 29 + 8 * length))]
        assert len(bits) == 34 + 8 * length
        assert stuff_bits_in(np.array(bits)[:, None])[0] == max_stuff_bits(length)
