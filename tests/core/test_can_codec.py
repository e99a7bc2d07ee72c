"""Bits of a frame against their definition, in Python and in machine code."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_gait.core.can_codec import SignalLayout, decode_signal, encode_signal, pack_frame, unpack_frame
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiling import BIT_FUNCTIONS, jit
from twin_gait.simulation.record import to_array

# Torque from bit 14 on in 13 bits, an angle before it in 14, and 31 bits in the other half.
TORQUE = SignalLayout(0, 14, 8191, 4096, -4096, 0.025, 0.0, -4095.0, 4095.0)
ANGLE = SignalLayout(0, 0, 16383, 0, 16383, 0.0002, -0.8, 0.0, 16382.0)
TIME = SignalLayout(1, 0, 2**31 - 1, 0, 2**31 - 1, 0.001, 0.0, 0.0, 2.0**31 - 2.0)
SIGNALS = [TORQUE, ANGLE, TIME]


@dataclass(slots=True)
class Frame:
    signals: list[SignalLayout]
    halves: list[int]
    values: list[float]


@pytest.mark.parametrize(
    ("signal", "value", "code"),
    [
        (TORQUE, 0.05, 2),
        (TORQUE, -0.05, -2),
        (TORQUE, 0.0374, 1),
        (TORQUE, 500.0, 4095),
        (TORQUE, -math.inf, -4095),
        (TORQUE, math.nan, -4096),
        (ANGLE, -0.8, 0),
        (ANGLE, 0.0, 4000),
        (ANGLE, math.inf, 16382),
        (ANGLE, math.nan, 16383),
    ],
)
def test_a_number_has_the_nearest_code_of_its_range(signal, value, code):
    assert encode_signal(signal, value) == code


def test_a_code_outside_the_range_is_nan():
    assert math.isnan(decode_signal(TORQUE, -4096))
    assert math.isnan(decode_signal(ANGLE, 16383))
    assert decode_signal(TORQUE, -4095) == -4095 * 0.025


def test_signals_have_the_bit_positions_of_their_layout():
    halves = [-1, -1]
    pack_frame(SIGNALS, [-0.025, -0.8 + 0.0002 * 5, 0.007], halves)
    assert halves == [8191 << 14 | 5, 7]


@given(st.tuples(st.floats(-102.375, 102.375), st.floats(-0.8, 2.4764), st.floats(0.0, 2e6)))
def test_a_received_value_is_within_half_a_step_of_the_sent_value(values):
    halves, found = [0, 0], [0.0, 0.0, 0.0]
    pack_frame(SIGNALS, values, halves)
    unpack_frame(SIGNALS, halves, found)
    assert all(0 <= half < 2**31 for half in halves)
    for signal, sent, arrived in zip(SIGNALS, values, found, strict=True):
        assert abs(arrived - sent) <= 0.5 * signal.scale * (1.0 + 1e-6)


@given(st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 2**31 - 1)))
def test_bits_survive_decoding_and_encoding_except_codes_for_missing_values(bits):
    found, halves = [0.0, 0.0, 0.0], [0, 0]
    unpack_frame(SIGNALS, bits, found)
    pack_frame(SIGNALS, found, halves)
    assert halves == [bits[0] & 0x7FFFFFF, bits[1]]


def test_machine_code_gives_the_bits_of_python():
    draw = np.random.default_rng(0)
    values = draw.uniform(-200.0, 200.0, (20_000, 3))
    values[:100] = draw.choice([math.nan, math.inf, -math.inf, -0.0], (100, 3))
    frame = to_array(Frame(SIGNALS, [0, 0], [0.0, 0.0, 0.0]))[0]
    pack, unpack = (specialize(function, BIT_FUNCTIONS, jit) for function in (pack_frame, unpack_frame))

    @numba.njit
    def there_and_back(one, values, halves, found):
        for row in range(len(values)):
            pack(one.signals, values[row], halves[row])
            unpack(one.signals, halves[row], found[row])

    halves, found = np.zeros((len(values), 2), np.int64), np.zeros_like(values)
    there_and_back(frame, values, halves, found)
    expected, back = [0, 0], [0.0, 0.0, 0.0]
    for row, sent in enumerate(values.tolist()):
        pack_frame(SIGNALS, sent, expected)
        unpack_frame(SIGNALS, expected, back)
        assert halves[row].tolist() == expected
        np.testing.assert_array_equal(found[row], back)
