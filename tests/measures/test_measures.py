"""Gait measures on signals whose measures are known by hand, and the reference against what was published."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pandas as pd
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from twin_gait.exceptions import ParameterError
from twin_gait.measures.effort import (
    battery_use,
    changes_at_switches,
    energy_balance,
    saturation_cases,
    saturation_shares,
)
from twin_gait.measures.foot_contact import (
    FootContacts,
    find_foot_contacts,
    find_scuffs,
    find_swings,
    is_loaded,
    swing_clearances,
)
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.phases import (
    entry_lags,
    phase_durations,
    phase_entries,
    phase_spells,
    phases_in_order,
    usual_phases,
)
from twin_gait.measures.reference import (
    FASTEST,
    SLOWEST,
    key_events,
    normative_angle,
    normative_moment,
    reference_covers,
    reference_curve,
    reference_cycle_time,
)
from twin_gait.measures.strides import (
    PERCENT,
    cadence,
    coefficient_of_variation,
    normalise_strides,
    root_mean_square_error,
    stride_bounds,
    stride_extremes,
    stride_times,
    swing_shares,
    symmetry_index,
)
from twin_gait.parameters.drives import LimitParameters
from twin_gait.vocabulary import JointName, Side

TICK = 1e-3
HEIGHT = 1.75

# ------------------------------------------------------------------ reference curves

# Six harmonics fitted to curves that another program made of the same regression, height 1.75 m:
# speed in km/h, joint, a0, a1, b1, …, a6, b6 in degrees, root mean square and largest residual of the fit.
FOURIER = [
    (0.5, "hip", [9.3518, 11.9989, 2.6445, 2.3046, -2.0298, -1.5848, -0.5717, -0.8059, -0.0205, -0.0401,
                  -0.0636, 0.0805, -0.1056], 0.071, 0.17),
    (0.5, "knee", [12.1848, 7.8281, -10.6290, -5.6538, -7.5120, -5.8402, 0.6999, -1.2532, 2.0699, -0.0438,
                   0.6607, -0.1901, 0.3491], 0.357, 0.98),
    (0.5, "ankle", [1.5522, -4.6713, -3.3013, -0.9388, 0.4089, 0.5275, -2.2187, -0.7208, -1.2928, -0.5945,
                    0.2168, -0.0330, 0.6932], 0.509, 1.47),
    (1.0, "hip", [10.1765, 13.2876, 2.0052, 1.2266, -2.5066, -1.9318, 0.0830, -0.4577, 0.1947, 0.0099,
                  -0.2537, -0.0186, -0.1542], 0.053, 0.20),
    (1.0, "knee", [13.9605, 7.1073, -13.0660, -8.5613, -6.6687, -5.7837, 1.9141, -0.7973, 1.7491, -0.2268,
                   0.2534, -0.3792, 0.2561], 0.352, 1.11),
    (1.5, "hip", [10.9437, 14.4760, 1.3616, 0.1477, -2.6810, -1.9668, 0.7096, -0.1448, 0.1348, -0.1172,
                  -0.3989, -0.0837, -0.1008], 0.044, 0.18),
    (1.5, "knee", [15.6074, 6.1765, -15.1677, -10.9969, -5.4186, -5.3686, 2.7495, -0.5947, 1.2281, -0.5115,
                   0.0048, -0.4908, 0.2404], 0.337, 1.17),
    (1.5, "ankle", [1.0815, -4.9468, -1.3628, 0.9958, -0.2768, -0.2907, -3.6040, -1.4225, -0.3364, 0.1062,
                    0.8101, 0.4659, 0.2998], 0.204, 0.66),
    (2.0, "hip", [11.6397, 15.5950, 0.7796, -0.8353, -2.6387, -1.8095, 1.1888, 0.0229, -0.0647, -0.3003,
                  -0.4233, -0.0734, -0.0395], 0.064, 0.18),
    (2.0, "knee", [17.1036, 5.1516, -16.8921, -12.9320, -3.9625, -4.8209, 3.1988, -0.6376, 0.6964, -0.7737,
                   -0.0919, -0.5273, 0.2328], 0.321, 1.18),
    (2.5, "hip", [12.2506, 16.6819, 0.3151, -1.6714, -2.4777, -1.5863, 1.4870, 0.0467, -0.2781, -0.4471,
                  -0.3584, -0.0314, -0.0214], 0.089, 0.23),
    (2.5, "knee", [18.4287, 4.1397, -18.2189, -14.3961, -2.4707, -4.3070, 3.3374, -0.8400, 0.2698, -0.9522,
                   -0.0982, -0.5205, 0.2054], 0.311, 1.17),
]  # fmt: skip


def fourier_series(coefficients: list[float], percent: np.ndarray) -> np.ndarray:
    total = np.full(len(percent), coefficients[0])
    for harmonic in range(1, 7):
        angle = 2.0 * np.pi * harmonic * percent / 100.0
        a, b = coefficients[2 * harmonic - 1 : 2 * harmonic + 1]
        total += a * np.cos(angle) + b * np.sin(angle)
    return total


@pytest.mark.parametrize(("speed", "joint", "coefficients", "rms", "largest"), FOURIER)
def test_reference_agrees_with_fourier_fits_within_their_residual(
    speed: float, joint: str, coefficients: list[float], rms: float, largest: float
) -> None:
    percent = np.arange(100.0)
    curve = np.degrees(reference_curve(JointName(joint), percent, speed=speed / 3.6, height=HEIGHT))
    difference = curve - fourier_series(coefficients, percent)
    # Half a unit of the last printed digit.
    assert np.sqrt(np.mean(difference**2)) == pytest.approx(rms, abs=0.0005)
    assert np.abs(difference).max() <= largest + 0.005


# Samples of the same curves at 1.5 km/h, made by another program, rounded to 0.001 degrees.
@pytest.mark.parametrize(
    ("percent", "hip", "knee", "ankle"),
    [
        (0, 23.255, 3.402, -3.705),
        (9, 22.790, 8.412, -7.273),
        (17, 18.771, 10.510, -1.873),
        (30, 7.514, 6.573, 1.671),
        (46, 0.177, 3.259, 4.325),
        (61, -5.159, 8.902, 9.795),
        (70, 2.143, 29.932, 0.817),
        (80, 17.609, 50.239, -2.535),
        (93, 24.920, 21.159, 0.774),
        (99, 23.390, 3.825, -3.504),
    ],
)
def test_reference_passes_through_published_samples(
    percent: int, hip: float, knee: float, ankle: float
) -> None:
    for joint, angle in zip(JointName, (hip, knee, ankle), strict=True):
        (value,) = np.degrees(reference_curve(joint, np.array([percent]), speed=1.5 / 3.6, height=HEIGHT))
        assert value == pytest.approx(angle, abs=0.00051), joint


def test_events_of_the_regression_worked_out_by_hand() -> None:
    # v = 2 km/h, h = 1.8 m: 48.879 - 3.854*2 + 0.355*4 + 9.891*1.8 = 60.3948 samples and
    # -2.026 - 2.090*2 = -6.206 degrees for the lowest hip angle; sample 1 is 0 %, sample 100 is 100 %.
    lowest_hip = key_events(JointName.HIP, speed=2.0 / 3.6, height=1.8)[3]
    assert lowest_hip[0] == pytest.approx(59.3948 / 0.99)
    assert math.degrees(lowest_hip[1]) == pytest.approx(-6.206)
    # 85.816 - 4.480*2 + 0.519*4 = 78.932 samples, 38.110 + 9.744*2 - 1.105*4 = 53.178 degrees.
    highest_knee = key_events(JointName.KNEE, speed=2.0 / 3.6, height=1.8)[4]
    assert highest_knee[0] == pytest.approx(77.932 / 0.99)
    assert math.degrees(highest_knee[1]) == pytest.approx(53.178)


@pytest.mark.parametrize("joint", list(JointName))
def test_curve_meets_its_events_with_their_slopes_and_curvatures(joint: JointName) -> None:
    step = 1e-3  # [%]
    for percent, angle, velocity, acceleration in key_events(joint, speed=0.5, height=1.7):
        around = percent + step * np.array([-1.0, 0.0, 1.0])
        before, at, after = reference_curve(joint, around, speed=0.5, height=1.7)
        assert at == pytest.approx(angle, abs=1e-12)
        # Central differences: truncation is of the order of step² times the third derivative.
        assert (after - before) / (2.0 * step) == pytest.approx(velocity, abs=1e-6)
        assert (after - 2.0 * at + before) / step**2 == pytest.approx(acceleration, abs=1e-4)


@pytest.mark.parametrize(
    ("speed", "joint", "fastest", "slowest"),
    [
        (1.5, JointName.HIP, 97, -58),
        (1.5, JointName.KNEE, 184, -206),
        (1.0, JointName.KNEE, 152, -165),
        (0.5, JointName.KNEE, 109, -116),
    ],
)
def test_joint_speeds_of_the_reference_walk(
    speed: float, joint: JointName, fastest: int, slowest: int
) -> None:
    # In deg/s, by another program, as central differences of samples 1 % apart; rounded to 1 deg/s.
    time = PERCENT / 100.0 * reference_cycle_time(speed / 3.6, HEIGHT)
    angle = np.degrees(reference_curve(joint, PERCENT, speed=speed / 3.6, height=HEIGHT))
    velocity = np.gradient(angle, time)
    assert velocity.max() == pytest.approx(fastest, abs=0.5)
    assert velocity.min() == pytest.approx(slowest, abs=0.5)


@pytest.mark.parametrize(
    ("speed", "period"), [(0.5, 2.942), (1.0, 2.115), (1.5, 1.754), (2.0, 1.543), (2.5, 1.400)]
)
def test_cycle_time_is_the_published_one(speed: float, period: float) -> None:
    assert reference_cycle_time(speed / 3.6, HEIGHT) == pytest.approx(period, abs=0.0006)


@given(
    speed=st.floats(SLOWEST, FASTEST),
    height=st.floats(1.40, 2.05),
    joint=st.sampled_from(list(JointName)),
)
def test_events_stay_in_order_and_the_curve_in_human_range(
    speed: float, height: float, joint: JointName
) -> None:
    instants = key_events(joint, speed=speed, height=height)[:, 0].tolist()
    assert instants[0] == 0.0 and instants[-1] < 100.0
    assert instants == sorted(instants)
    curve = np.degrees(reference_curve(joint, PERCENT, speed=speed, height=height))
    assert curve.min() > -40.0 and curve.max() < 80.0


def test_reference_repeats_every_cycle() -> None:
    percent = np.array([0.0, 12.5, 99.0])
    curve = reference_curve(JointName.KNEE, percent, speed=0.4, height=HEIGHT)
    for shift in (-100.0, 100.0):
        again = reference_curve(JointName.KNEE, percent + shift, speed=0.4, height=HEIGHT)
        assert_allclose(again, curve, atol=1e-12)


@pytest.mark.parametrize("speed", [0.1, 1.5, math.nan])
def test_reference_rejects_speeds_outside_its_range(speed: float) -> None:
    assert not reference_covers(speed)
    with raises(ParameterError, "0.14", "1.39 m/s"):
        reference_curve(JointName.HIP, PERCENT, speed=speed, height=HEIGHT)


@pytest.mark.parametrize(
    ("curve", "joint", "known"),
    [
        (normative_angle, "ankle", ("hip", "knee")),
        (normative_moment, "elbow", ("hip", "knee")),
        (partial(reference_curve, speed=1.0, height=1.75), "elbow", ("hip", "knee", "ankle")),
    ],
)
def test_a_joint_without_a_curve_is_refused_with_the_joints_that_have_one(curve, joint, known) -> None:
    with raises(ParameterError, "joint", *known, joint):
        curve(joint, np.zeros(1))


def test_strides_of_zero_duration_have_no_cadence() -> None:
    assert math.isnan(cadence(np.zeros(2)))


def test_reference_rejects_a_height_without_a_step_length() -> None:
    with raises(ParameterError, "height", "0.5"):
        reference_cycle_time(0.4, 0.5)


# ------------------------------------------------------------------ foot contact


def square_force(*spells: tuple[int, int], length: int = 5000) -> np.ndarray:
    force = np.zeros(length)
    for start, end in spells:
        force[start:end] = 300.0
    return force


def test_contacts_of_a_square_wave_are_its_edges() -> None:
    contacts = find_foot_contacts(square_force((1000, 1800), (2200, 3000)), TICK)
    assert_array_equal(contacts.heel_strikes, [1000, 2200])
    assert_array_equal(contacts.toe_offs, [1800, 3000])
    assert len(contacts.further_contacts) == 0


def test_leg_that_starts_in_stance_has_not_struck() -> None:
    contacts = find_foot_contacts(square_force((0, 500), (1000, 1800)), TICK)
    assert_array_equal(contacts.heel_strikes, [1000])
    assert_array_equal(contacts.toe_offs, [500, 1800])


def test_bounce_and_scuff_are_distinguished() -> None:
    # Lands at 1000, lifts off for 60 ms at 1100, leaves at 1800; touches for 30 ms at 2100 in swing.
    force = square_force((1000, 1100), (1160, 1800), (2100, 2130), (2500, 3300))
    contacts = find_foot_contacts(force, TICK)
    assert_array_equal(contacts.heel_strikes, [1000, 2500])
    assert_array_equal(contacts.toe_offs, [1800, 3300])
    assert_array_equal(contacts.further_contacts, [1160, 2100])
    assert_array_equal(find_scuffs(contacts), [2100])


def test_force_that_oscillates_about_a_threshold_is_one_contact() -> None:
    force = square_force((1000, 1800))
    force[1000:1100] = np.where(np.arange(100) % 2, 15.0, 25.0)
    force[1800:1900] = np.where(np.arange(100) % 2, 15.0, 25.0)
    assert_array_equal(np.flatnonzero(np.diff(is_loaded(force).astype(int))) + 1, [1000, 1900])
    contacts = find_foot_contacts(force, TICK)
    assert [values.tolist() for values in contacts] == [[1000], [1900], []]
    assert not is_loaded(np.full(3, 15.0)).any()  # never more than between the two
    assert is_loaded(np.zeros(0)).shape == (0,)


@pytest.mark.parametrize("away", [60, 240, 260, 500, 800])
def test_bouncing_heel_strikes_at_its_first_contact(away: int) -> None:
    """The belt takes the leg back meanwhile; a swing of 400 ticks takes it forwards."""
    landed = (1000, 4000)
    touches = ((at, at + 100) for at in landed)
    rests = ((at + 100 + away, at + 2600) for at in landed)
    force = square_force(*touches, *rests, length=7000)
    since = (np.arange(len(force)) - 1000) % 3000
    hip = np.radians(np.where(since < 2600, 20.0 - 30.0 * since / 2600, -10.0 + 30.0 * (since - 2600) / 400))
    contacts = find_foot_contacts(force, TICK, hip)
    assert_array_equal(contacts.heel_strikes, landed)
    assert_array_equal(contacts.toe_offs, [3600, 6600])
    assert_array_equal(contacts.further_contacts, [at + 100 + away for at in landed])
    assert len(find_scuffs(contacts)) == 0
    # By the force alone, a long one is a swing and the second touch is taken for the heel strike.
    late = 100 + away if away > 250 else 0
    assert_array_equal(find_foot_contacts(force, TICK).heel_strikes, [at + late for at in landed])


def test_scuff_before_the_first_strike_counts_after_a_toe_off_only() -> None:
    contacts = FootContacts(np.array([1000]), np.array([400]), np.array([200, 600, 1200]))
    assert_array_equal(find_scuffs(contacts), [600])


@pytest.mark.parametrize("unknown", [slice(1000, 1001), slice(1200, 1201), slice(900, 1500)])
def test_a_gap_in_the_hip_angle_loses_no_stride(unknown) -> None:
    force, hip = square_force((400, 1000), (1400, 2000)), np.zeros(5000)
    hip[1000:1400] = np.linspace(0.0, 0.5, 400)
    hip[unknown] = math.nan
    assert_array_equal(find_foot_contacts(force, 1e-3, hip).heel_strikes, [400, 1400])


def test_clearance_is_the_least_of_the_middle_half() -> None:
    contacts = FootContacts(np.array([1000, 2000]), np.array([1600]), np.array([], dtype=int))
    assert_array_equal(find_swings(contacts), [[1600, 2000]])
    clearance = np.full(2500, 0.04)
    clearance[[1650, 1950]] = 0.001  # in the first and the last quarter of the swing
    clearance[1701] = 0.015
    assert_allclose(swing_clearances(clearance, contacts), [0.015])


def test_swing_cut_off_by_the_record_has_no_clearance() -> None:
    contacts = FootContacts(np.array([1000]), np.array([1600]), np.array([], dtype=int))
    assert find_swings(contacts).shape == (0, 2)
    assert len(swing_clearances(np.zeros(2000), contacts)) == 0


# ------------------------------------------------------------------ strides


def test_strides_lie_between_events() -> None:
    events = np.array([100, 300, 600, 1000])
    assert_array_equal(stride_bounds(events), [[100, 300], [300, 600], [600, 1000]])
    assert_allclose(stride_times(stride_bounds(events), TICK), [0.2, 0.3, 0.4])


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_events_give_no_strides(count: int) -> None:
    bounds = stride_bounds(100 * np.arange(count))
    assert bounds.shape == (0, 2)
    assert normalise_strides(np.zeros(500), bounds).shape == (0, 101)
    assert normalise_strides(np.zeros(0), bounds).shape == (0, 101)
    assert stride_extremes(np.zeros(500), bounds).shape == (0, 2)


def test_ramp_is_normalised_exactly() -> None:
    cycles = normalise_strides(np.arange(100.0), np.array([[10, 60], [60, 93]]))
    assert_allclose(cycles[0], np.linspace(10.0, 60.0, 101), rtol=1e-14)
    assert_allclose(cycles[1], np.linspace(60.0, 93.0, 101), rtol=1e-14)


def test_strides_are_interpolated_like_numpy_to_the_bit() -> None:
    rng = np.random.default_rng(1)
    signal, bounds = rng.normal(size=2000), stride_bounds(np.append(np.sort(rng.choice(1999, 9)), 1999))
    signal[bounds[2, 1] + 1] = math.nan  # next to the end of a stride, which it does not change
    positions = bounds[:, :1] + PERCENT / 100.0 * np.diff(bounds)
    assert_array_equal(
        normalise_strides(signal, bounds), np.interp(positions, np.arange(len(signal)), signal), strict=True
    )


def test_strides_of_different_length_fall_on_one_curve() -> None:
    lengths = [900, 1000, 1250]
    progress = np.concatenate([np.arange(length) / length for length in lengths] + [[0.0]])
    events = np.concatenate(([0], np.cumsum(lengths)))
    cycles = normalise_strides(np.sin(2.0 * np.pi * progress), stride_bounds(events))
    # Linear interpolation errs by less than (2 pi / 900)² / 8.
    assert_allclose(cycles, np.tile(np.sin(2.0 * np.pi * PERCENT / 100.0), (3, 1)), atol=6.1e-6)


@given(amplitude=st.floats(0.01, 2.0), harmonic=st.integers(1, 6), offset=st.floats(-1.0, 1.0))
def test_error_of_a_sinusoid_is_its_closed_form(amplitude: float, harmonic: int, offset: float) -> None:
    cycle = offset + amplitude * np.sin(2.0 * np.pi * harmonic * PERCENT / 100.0)
    expected = math.sqrt(offset**2 + 0.5 * amplitude**2)
    assert root_mean_square_error(np.tile(cycle, (3, 1)), np.zeros(101)) == pytest.approx(expected)


def test_error_is_pooled_over_strides() -> None:
    cycles = np.array([np.full(101, 3.0), np.full(101, -4.0)])
    assert root_mean_square_error(cycles, np.zeros(101)) == pytest.approx(math.sqrt(12.5))
    assert math.isnan(root_mean_square_error(cycles[:0], np.zeros(101)))


def test_extremes_of_a_sinusoid_are_its_amplitude() -> None:
    signal = 0.2 + 0.7 * np.cos(2.0 * np.pi * np.arange(3001) / 1000)
    bounds = np.array([[0, 1000], [1000, 2000], [2000, 3000]])
    assert_allclose(stride_extremes(signal, bounds), np.tile([-0.5, 0.9], (3, 1)), atol=1e-12)


def test_variation_of_one_two_three_is_a_half() -> None:
    assert coefficient_of_variation(np.array([1.0, 2.0, 3.0])) == pytest.approx(0.5)
    assert coefficient_of_variation(np.full(4, 1.2)) == pytest.approx(0.0, abs=1e-15)
    assert math.isnan(coefficient_of_variation(np.array([1.0])))


def test_swing_share_runs_from_the_last_toe_off_to_the_strike() -> None:
    bounds = np.array([[0, 1000], [1000, 2000], [2000, 3000]])
    shares = swing_shares(bounds, np.array([600, 1700, 3200]))
    assert_allclose(shares, [0.4, 0.3, np.nan])


def test_symmetry_index_is_signed_and_relative() -> None:
    assert symmetry_index(1.1, 0.9) == pytest.approx(0.2)
    assert symmetry_index(2.0, 2.0) == 0.0
    assert math.isnan(symmetry_index(1.0, -1.0))


# ------------------------------------------------------------------ phases


def test_spells_entries_and_durations_of_a_short_history() -> None:
    phases = np.array([0, 0, 0, 1, 1, 2, 0, 0, 1, 1, 1, 1, 2])
    assert [tuple(spell) for spell in phase_spells(phases)] == [
        (0, 0, 3), (1, 3, 5), (2, 5, 6), (0, 6, 8), (1, 8, 12), (2, 12, 13),
    ]  # fmt: skip
    assert_array_equal(phase_entries(phases, 0), [0, 6])
    assert_array_equal(phase_entries(phases, 3), [])
    durations = phase_durations(phases, TICK)
    # The first and the last stay are cut off by the record.
    assert_allclose(durations[0], [0.002])
    assert_allclose(durations[1], [0.002, 0.004])
    assert_allclose(durations[2], [0.001])
    assert_allclose(phase_durations(phases, TICK, since=5)[1], [0.004])
    assert phase_spells(phases[:0]) == []


def test_order_of_phases_is_checked_around_the_cycle() -> None:
    assert phases_in_order(np.array([1, 1, 2, 0, 1]), 3)
    assert phases_in_order(np.array([2, 2]), 3)
    assert not phases_in_order(np.array([0, 1, 0]), 3)
    assert not phases_in_order(np.array([0, 2]), 3)


def test_lag_pairs_each_strike_with_its_own_entry() -> None:
    # Entered 200 ms before the foot lands, then 50 ms after, then not at all.
    lags = entry_lags(np.array([0, 2050]), np.array([200, 2000, 4000]), TICK)
    assert_allclose(lags, [0.2, -0.05, np.nan])
    assert_allclose(entry_lags(np.array([], dtype=int), np.array([200]), TICK), [np.nan])
    assert len(entry_lags(np.array([0]), np.array([], dtype=int), TICK)) == 0


def test_usual_phase_changes_at_the_median_boundary() -> None:
    # Three strides of 100 ticks that change phase after 20, 30 and 70.
    phases = np.concatenate([np.repeat([0, 1], [split, 100 - split]) for split in (20, 30, 70)] + [[0]])
    bounds = stride_bounds(np.array([0, 100, 200, 300]))
    usual = usual_phases(phases, bounds, 2)
    assert_array_equal(np.flatnonzero(np.diff(usual)), [29, 99])


def test_leg_record_reads_phases_by_name_and_a_leg_without_ground() -> None:
    log = pd.DataFrame(
        {
            "right_phase": ["swing", "stance", "stance", "swing", "stance"],
            "right_hip_angle_rad": np.arange(5.0),
            "right_hip_motor_torque_Nm": np.zeros(5),
            "right_ankle_angle_rad": np.zeros(5),
        }
    )
    record = leg_record(log, Side.RIGHT, ("stance", "swing"), TICK)
    assert_array_equal(record.phases, [1, 0, 0, 1, 0])
    assert list(record.angles) == [JointName.HIP]
    assert record.contacts is None
    assert_array_equal(record.strides(skip=0), [[1, 4]])


# ------------------------------------------------------------------ effort and energy


def test_saturation_is_counted_per_cause_and_once_together() -> None:
    command = np.array([10.0, 61.0, -70.0, 60.0, 5.0, 5.0, 80.0, 5.0, 0.0, 0.0])
    target = np.array([1.0, 6.0, -6.0, 6.0, 15.0, -15.0, 6.0, 0.5, 0.0, 0.0])
    current = np.array([1.0, 6.0, -6.0, 6.0, 15.0, -15.0, 4.0, 0.2, 0.0, 0.0])
    limits = LimitParameters(torque=60.0, current=15.0)
    shares = saturation_shares(saturation_cases(command, target, current, limits))
    assert shares == pytest.approx(
        {
            "at_torque_limit_share": 0.3,
            "at_current_limit_share": 0.2,
            "voltage_limited_share": 0.2,
            "saturated_share": 0.6,  # the tick at index 6 has two causes
        }
    )


def test_battery_is_discharged_and_charged() -> None:
    use = battery_use(np.repeat([100.0, -20.0], 500), TICK, 330.0)
    assert tuple(use.values()) == pytest.approx((40.0, 100.0, -20.0, 40.0, 40.0 / 330.0))


def test_empty_records_are_undefined_not_wrong() -> None:
    empty = np.zeros(0)
    assert all(math.isnan(value) for value in battery_use(empty, TICK, 1.0).values())
    shares = saturation_shares(
        saturation_cases(empty, empty, empty, LimitParameters(torque=60.0, current=15.0))
    )
    assert all(math.isnan(value) for value in shares.values())
    assert math.isnan(energy_balance(empty, np.zeros((2, 0)))["energy_residual_J"])


def test_change_at_a_switch_counts_from_the_tick_before_it() -> None:
    torque = np.array([0.0, 1.0, 4.0, 9.0, -3.0, -3.0, -3.0, 8.0])
    changes = changes_at_switches(torque, np.array([2, 6]), 2)
    assert_allclose(changes, [8.0, 11.0])  # 1 to 9, and -3 to 8 where the record ends
    assert_allclose(changes_at_switches(torque, np.array([2]), 0), [3.0])
    each = changes_at_switches(torque, np.array([2, 6]), np.array([1, 0]))
    assert_allclose(each, [8.0, 0.0])


def test_energy_of_a_driven_oscillator_balances() -> None:
    # x = cos t under its spring and a drag -0.1 v that a motor 0.1 v makes up for: both work at ±0.1 v².
    t = np.linspace(0.0, 20.0, 5001)
    drag_work = -0.1 * (t / 2.0 - np.sin(2.0 * t) / 4.0)
    kinetic, potential = 0.5 * np.sin(t) ** 2, 0.5 * np.cos(t) ** 2
    balance = energy_balance(kinetic + potential, np.array([drag_work, -drag_work]))
    assert balance["energy_residual_J"] < 1e-12
    # Both works are monotonic, so what passes through is the sum of their ends.
    assert balance["energy_throughput_J"] == pytest.approx(-2.0 * drag_work[-1])


def test_unexplained_energy_is_detected() -> None:
    work = np.linspace(0.0, 50.0, 101)
    energy = 700.0 + work
    energy[60:] += 0.3
    balance = energy_balance(energy, work[None, :])
    assert balance["energy_residual_J"] == pytest.approx(0.3)
    assert balance["energy_residual_share"] == pytest.approx(0.3 / 50.0)
    assert math.isnan(energy_balance(np.full(3, 5.0), np.zeros((1, 3)))["energy_residual_share"])
