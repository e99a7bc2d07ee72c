"""Signals of guards are declared once: names, places and values follow from the declaration."""

from __future__ import annotations

import math
from dataclasses import astuple, fields, replace

import pytest
from errors import raises
from table_builder import JOINTS, transition, two_phase_table

from twin_gait.control.gait_controller import DeviceSignals
from twin_gait.core.guards import evaluate_guard
from twin_gait.exceptions import GaitTableError, MeasurementError
from twin_gait.gait import signals
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import (
    ANGLE,
    DEVICE_SIGNALS,
    JOINT_SIGNALS,
    LEG_SIGNALS,
    LOAD,
    SIGNALS,
    STEP,
    TIME_IN_PHASE,
    TRUNK_PITCH,
    VELOCITY,
    WALK,
    all_signal_names,
    find_signal,
    signal_part,
)
from twin_gait.vocabulary import Side

NAMES = all_signal_names(JOINTS)
STILL = dict.fromkeys(NAMES, 0.0)  # of legs that hang


def test_list_of_signals_is_unchanged():
    """Only this test lists the signals; all others follow the declaration."""
    assert SIGNALS == (ANGLE, VELOCITY, LOAD, TIME_IN_PHASE, TRUNK_PITCH, WALK, STEP)


def test_the_list_is_in_the_order_of_the_declaration():
    leg = (*(JOINT_SIGNALS * len(JOINTS)), *LEG_SIGNALS)
    assert tuple(map(find_signal, NAMES)) == (*leg, *leg, *DEVICE_SIGNALS)
    parts = {"hip.angle_deg": "hip", "other.knee.velocity_deg_per_s": "knee", "foot.load_bw": "foot"}
    parts |= {"time_in_phase_s": "", "trunk.pitch_deg": "trunk", "walk": ""}
    assert set(parts) <= set(NAMES) and {name: signal_part(name) for name in parts} == parts
    assert (
        find_signal("noisy.other.knee.angle_deg") is ANGLE
        and find_signal("entry.time_in_phase_s") is TIME_IN_PHASE
    )


def test_the_record_of_the_device_has_the_declared_signals():
    assert [item.name for item in fields(DeviceSignals)] == [signal.field for signal in DEVICE_SIGNALS]
    assert list(astuple(DeviceSignals())) == [signal.initial_value for signal in DEVICE_SIGNALS]


def test_signals_are_unmeasured_at_the_start():
    first = dict(zip(NAMES, two_phase_table().to_si({}), strict=True))
    assert first["walk"] == first["step"] == 1.0 and first["trunk.pitch_deg"] == 0.0
    unknown = [name for name in NAMES if find_signal(name) in (ANGLE, VELOCITY, LOAD, TIME_IN_PHASE)]
    assert all(math.isnan(first[name]) for name in unknown)


def test_a_signal_name_that_ends_in_another_name_is_separate(monkeypatch):
    """An example is ``shank.angle_deg``, which is not a signal of a joint."""
    shank = replace(LOAD, name="shank.angle_deg")
    monkeypatch.setattr(signals, "SIGNALS", (*SIGNALS, shank))
    find_signal.cache_clear()
    try:
        assert find_signal("other.shank.angle_deg") is shank and find_signal("other.hip.angle_deg") is ANGLE
    finally:
        find_signal.cache_clear()


def test_signals_given_to_a_machine_are_in_list_order_and_others_keep_their_initial_value():
    numbers = {name: index / find_signal(name).unit.factor for index, name in enumerate(NAMES)}
    assert two_phase_table().to_si(numbers) == pytest.approx(list(range(len(NAMES))))
    assert str(two_phase_table().to_si({})) == str([find_signal(name).initial_value for name in NAMES])


@pytest.mark.parametrize("name", ["other.trunk.pitch_deg", "other.walk", "trunk.angle_deg", "pitch_deg"])
def test_undeclared_names_are_not_signals(name):
    with raises(GaitTableError, "trunk.pitch_deg", "walk"):
        two_phase_table(transition("stance", "swing", f"{name} > 1"))


def test_the_pitch_of_the_trunk_opens_a_guard():
    table = two_phase_table(transition("stance", "swing", "trunk.pitch_deg > 5"))
    program, signals = compile_guards(table), table.to_si({})
    held = [GaitStateMachine(table, Side.LEFT) for _ in range(2)]
    for pitch, opens in ((5.0, False), (5.001, True)):
        signals[NAMES.index("trunk.pitch_deg")] = math.radians(pitch)
        assert evaluate_guard(program, 0, 1, signals, -1) is opens
        assert (held[opens].step(1, {**STILL, "trunk.pitch_deg": pitch}) is not None) is opens


def test_trunk_pitch_is_compared_only_with_an_angle():
    two_phase_table(transition("stance", "swing", "trunk.pitch_deg - hip.angle_deg > 5"))
    with raises(GaitTableError, "transitions[0]", "trunk.pitch_deg", "walk", "deg"):
        two_phase_table(transition("stance", "swing", "trunk.pitch_deg - walk > 5"))


@pytest.mark.parametrize("signal", DEVICE_SIGNALS, ids=lambda signal: signal.name)
def test_a_signal_of_the_device_has_to_be_finite(signal):
    with raises(MeasurementError, "left", signal.name, "nan"):
        GaitStateMachine(two_phase_table(), Side.LEFT).step(1, {**STILL, signal.name: math.nan})
