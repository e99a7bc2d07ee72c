"""The codec of the CAN frames as C: the bits of Python, and in float every frame back as it came."""

from __future__ import annotations

import ctypes
import struct
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from firmware_tools import require_tools

from twin_gait.core.can_codec import SignalLayout, pack_frame, unpack_frame
from twin_gait.firmware import Library, TranslationUnit, print_units
from twin_gait.network.dbc import load_messages

MESSAGES = load_messages()
STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


@dataclass(slots=True)
class Frame:
    """The signals of a frame, as a record that the printer takes."""

    signals: list[SignalLayout]


def pack(frame: Frame, values: list[float], halves: list[int]) -> None:
    """Numbers to bits."""
    pack_frame(frame.signals, values, halves)


def unpack(frame: Frame, halves: list[int], values: list[float]) -> None:
    """Bits to numbers."""
    unpack_frame(frame.signals, halves, values)


@cache
def built(name, double):
    require_tools("gcc")
    sample = {"frame": Frame(MESSAGES[name].layout)}
    program = print_units([TranslationUnit("codec", [pack, unpack], sample)])
    return Library(program, double=double, flags=STRICT)


class Printed:
    """The C codec of a message, on arrays that are made once."""

    def __init__(self, name, *, double):
        self._library = built(name, double)
        self._frame = self._library.structure(Frame(MESSAGES[name].layout))
        number = ctypes.c_double if double else ctypes.c_float
        self._values, self._halves = (number * len(MESSAGES[name].signals))(), (ctypes.c_int32 * 2)()

    def unpack(self, halves):
        self._halves[:] = halves
        self._library.handle.unpack(ctypes.byref(self._frame), self._halves, self._values)
        return list(self._values)

    def pack(self, values):
        self._values[:] = values
        self._library.handle.pack(ctypes.byref(self._frame), self._values, self._halves)
        return list(self._halves)


def random_frames(name, count):
    """Halves that a bus may bring; their highest bits are of no signal."""
    draw = np.random.default_rng(MESSAGES[name].identifier)
    return draw.integers(0, 2**31, (count, 2)).tolist()


def bits(values):
    return ["nan" if item != item else struct.pack("d", item) for item in values]


@pytest.mark.parametrize("count", [1_000, pytest.param(70_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", MESSAGES)
def test_c_reads_and_writes_the_frames_of_python(name, count):
    """15 messages of 70 000 random frames: 1.05 million, as against cantools."""
    printed, layout = Printed(name, double=True), MESSAGES[name].layout
    values, halves = [0.0] * len(layout), [0, 0]
    for frame in random_frames(name, count):
        unpack_frame(layout, frame, values)
        assert bits(printed.unpack(frame)) == bits(values)
        pack_frame(layout, values, halves)
        assert printed.pack(values) == halves


@pytest.mark.parametrize("name", ["left_knee_setpoint", "left_knee_measurement"])
def test_numbers_of_any_kind_get_the_code_of_python(name):
    printed, layout = Printed(name, double=True), MESSAGES[name].layout
    draw, halves = np.random.default_rng(3), [0, 0]
    odd = [0.0, -0.0, 1e308, -1e308, np.inf, -np.inf, np.nan, 5e-324]
    for _ in range(5_000):
        spread = 10.0 ** draw.uniform(-4.0, 6.0, len(layout))
        values = (spread * draw.uniform(-1.0, 1.0, len(layout))).tolist()
        values = [float(draw.choice(odd)) if draw.random() < 0.1 else item for item in values]
        pack_frame(layout, values, halves)
        assert printed.pack(values) == halves, values


@pytest.mark.parametrize("name", ["left_knee_setpoint", "left_knee_measurement"])
def test_in_float_a_board_gives_every_code_back_as_it_came(name):
    """A float has 24 bits, the widest of these signals 19."""
    single, layout = Printed(name, double=False), MESSAGES[name].layout
    values, halves = [0.0] * len(layout), [0, 0]
    for frame in random_frames(name, 20_000):
        unpack_frame(layout, frame, values)
        pack_frame(layout, values, halves)
        read = single.unpack(frame)
        np.testing.assert_allclose(read, values, rtol=1e-6, atol=1e-6)
        assert single.pack(read) == halves
