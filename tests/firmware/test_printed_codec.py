"""Tests of the printed codec against the Python codec, which tests/network compares with cantools."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pytest
from firmware_tools import require_tools
from printed_library import CLibrary

from twin_gait.core.can_codec import pack_frame, unpack_frame
from twin_gait.firmware.can_codec import CanFrame, can_messages, can_pack, can_unpack
from twin_gait.firmware.printer import TranslationUnit, print_units
from twin_gait.network.dbc import load_messages

MESSAGES = load_messages()
PRINTED = can_messages(MESSAGES)
WIDTH = len(next(iter(PRINTED.values())).signals)


def library_of(*, double: bool) -> CLibrary:
    require_tools("gcc")
    unit = TranslationUnit("can_codec", [can_pack, can_unpack], PRINTED)
    return CLibrary(print_units([unit], shapes=[CanFrame()]), double=double, flags=["-Werror"])


@pytest.fixture(scope="module")
def double() -> CLibrary:
    return library_of(double=True)


@pytest.fixture(scope="module")
def single() -> CLibrary:
    return library_of(double=False)


class InC:
    """Message that is packed and unpacked by the compiled library with the printed table."""

    def __init__(self, library: CLibrary, name: str, real: type) -> None:
        self.pack, self.unpack = library.handle.can_pack, library.handle.can_unpack
        self.unpack.restype = ctypes.c_bool
        message = type(library.structure(PRINTED[own := f"message_{name}"])).in_dll(library.handle, own)
        self.frame = library.structure(CanFrame(MESSAGES[name].identifier, MESSAGES[name].length))
        self.values = (real * WIDTH)()
        self.given = (ctypes.byref(message), ctypes.byref(self.frame))

    def unpacked(self, halves: list[int]) -> list[float] | None:
        self.frame.halves[:] = halves
        return list(self.values) if self.unpack(*self.given, self.values) else None

    def packed(self, values: list[float]) -> list[int]:
        self.values[: len(values)] = values
        self.pack(self.given[0], self.values, self.given[1])
        return list(self.frame.halves)


def frames_of(name: str, count: int) -> np.ndarray:
    """Return the frames that tests/network/test_dbc.py passes to cantools."""
    message = MESSAGES[name]
    frames = np.random.default_rng(message.identifier).integers(0, 256, (count, 8), np.uint8)
    frames[:, message.length :] = 0
    return frames.view("<u4")


@pytest.mark.parametrize("count", [1_000, pytest.param(70_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", MESSAGES)
def test_the_printed_codec_gives_the_bits_of_python(double, name, count):
    """15 messages of 70 000 random frames each: 1.05 million."""
    message, ours = MESSAGES[name], InC(double, name, ctypes.c_double)
    layout, expected, halves = message.layout, [0.0] * len(message.signals), [0, 0]
    for frame in frames_of(name, count).tolist():
        unpack_frame(layout, frame, expected)
        found = ours.unpacked(frame)
        assert found is not None and found[len(expected) :] == [0.0] * (WIDTH - len(expected))
        pairs = list(zip(found, expected, strict=False))
        assert all(a == b or (a != a and b != b) for a, b in pairs)
        pack_frame(layout, expected, halves)
        assert ours.packed(expected) == halves


@pytest.mark.parametrize("name", MESSAGES)
def test_in_float_a_code_of_24_bits_comes_back(single, double, name):
    wide, narrow = InC(double, name, ctypes.c_double), InC(single, name, ctypes.c_float)
    fits = [signal.mask < 2**24 for signal in MESSAGES[name].layout]
    assert all(fits) or name == "gait_state"  # whose time has 31 bits
    for frame in frames_of(name, 2_000).tolist():
        values, expected = narrow.unpacked(frame), wide.unpacked(frame)
        for number, exact, fit in zip(values, expected, fits, strict=False):
            assert math.isnan(number) == math.isnan(exact) or not fit
            assert math.isnan(number) or math.isclose(number, exact, rel_tol=1e-6, abs_tol=2e-7)
        sent, back = wide.packed(expected), narrow.packed(values)
        if all(fits):
            assert back == sent


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 1e38, -1e38, 5e-324])
@pytest.mark.parametrize("name", MESSAGES)
def test_unusual_numbers_get_the_code_of_python(double, name, value):
    layout, halves = MESSAGES[name].layout, [0, 0]
    pack_frame(layout, [value] * len(layout), halves)
    assert InC(double, name, ctypes.c_double).packed([value] * len(layout)) == halves


def test_a_frame_of_another_message_is_left_alone(double):
    ours = InC(double, "battery", ctypes.c_double)
    ours.frame.identifier += 1
    assert ours.unpacked([1, 1]) is None and list(ours.values) == [0.0] * WIDTH
