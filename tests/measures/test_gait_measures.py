"""Gait measures on signals whose measures can be worked out by hand, and after export and re-import."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from synthetic_run import synthetic_run

from twin_gait.conventions import OPENSIM_GAIT2392, RAJAGOPAL
from twin_gait.export.motion import export_csv, export_motion
from twin_gait.gait.table import TICK
from twin_gait.measures.effort import (
    battery_life,
    interaction_torque,
    opposing_torque,
    positive_work,
    root_mean_square,
    share_of_work,
)
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.phases import phase_onsets
from twin_gait.measures.reference import gait_profile_score, gait_variable_score
from twin_gait.measures.strides import (
    cadence,
    double_support_shares,
    is_in_stride,
    join_strides,
    normalise_strides,
    step_times,
    stride_extremes,
    stride_means,
    stride_sums,
    values_in_strides,
)
from twin_gait.runs.log_files import read_log_table
from twin_gait.vocabulary import JointName, Side

# ---------------------------------------------------------------- steps


def test_strides_of_two_seconds_are_sixty_steps_a_minute():
    assert cadence(np.array([1.9, 2.1])) == pytest.approx(60.0)
    assert math.isnan(cadence(np.zeros(0)))


def test_step_runs_from_the_other_foots_last_strike():
    bounds, others = np.array([[300, 1000], [1000, 2000], [2000, 3000]]), np.array([400, 1200, 1700])
    # The last one has no strike of the other foot since 2000: the other foot made no step.
    assert_allclose(step_times(bounds, others, TICK), [0.6, 0.3, math.nan])
    assert len(step_times(bounds[:0], others, TICK)) == 0


def test_spans_are_summed_without_their_last_tick():
    bounds = np.array([[0, 3], [3, 10]])
    assert_allclose(stride_sums(np.arange(10.0), bounds), [3.0, 42.0])
    assert_allclose(stride_means(np.arange(10.0), bounds), [1.0, 6.0])


def test_onset_of_a_phase_is_its_first_entry_and_of_the_first_phase_the_nearest_one():
    bounds = np.array([[100, 200], [200, 300], [300, 500]])
    assert_allclose(phase_onsets(np.array([120, 190, 200, 450]), bounds), [20.0, 0.0, 75.0])
    assert_allclose(phase_onsets(np.array([95, 230, 420]), bounds, first=True), [-5.0, 30.0, -35.0])
    assert np.isnan(phase_onsets(np.array([600]), bounds)).all()
    assert np.isnan(phase_onsets(np.array([600]), bounds, first=True)).all()
    assert np.isnan(phase_onsets(np.zeros(0, dtype=int), bounds)).all()


def test_both_feet_carry_for_a_quarter_of_the_stride():
    tick = np.arange(400)
    left, right = tick % 200 < 125, (tick + 100) % 200 < 125
    strides = np.array([[0, 200], [200, 400]])
    assert_allclose(double_support_shares(left, right, strides), [0.25, 0.25])
    assert_allclose(double_support_shares(left, ~left, strides), [0.0, 0.0])
    assert len(double_support_shares(left, right, strides[:0])) == 0


def test_strides_of_two_walks_exclude_the_time_between_them():
    bounds = np.array([[10, 20], [20, 30], [80, 90]])
    assert join_strides(bounds).tolist() == [[10, 30], [80, 90]]
    assert values_in_strides(np.arange(100), bounds).tolist() == [*range(10, 30), *range(80, 90)]
    ticks = np.array([9, 10, 20, 29, 30, 50, 80, 90])
    assert is_in_stride(ticks, bounds).tolist() == [False, True, True, True, False, False, True, False]
    assert is_in_stride(ticks, bounds, last=True).tolist() == [False, *[True] * 4, False, True, True]
    assert join_strides(bounds[:0]).shape == (0, 2)
    assert not is_in_stride(ticks, bounds[:0], last=True).any()
    assert len(values_in_strides(np.arange(100), bounds[:0])) == 0


# ---------------------------------------------------------------- distance from healthy gait


def test_score_of_an_offset_is_the_offset_and_of_a_sine_its_rms():
    phase = np.linspace(0.0, 2.0 * np.pi, 101)
    reference = 10.0 * np.cos(phase)
    assert gait_variable_score(np.array([reference + 3.0]), reference) == pytest.approx(3.0)
    sine = reference + 4.0 * np.sin(phase)
    assert gait_variable_score(np.array([sine]), reference) == pytest.approx(4.0 / math.sqrt(2.0))


def test_score_is_of_the_mean_stride_so_that_opposite_errors_cancel():
    reference = np.zeros(101)
    assert gait_variable_score(np.array([reference + 5.0, reference - 5.0]), reference) == 0.0
    assert math.isnan(gait_variable_score(np.zeros((0, 101)), reference))


def test_mean_score_is_the_root_mean_square_of_the_scores():
    assert gait_profile_score([3.0, 4.0]) == pytest.approx(math.sqrt(12.5))
    assert math.isnan(gait_profile_score([]))


# ---------------------------------------------------------------- device and wearer


def test_motor_that_only_accelerates_its_rotor_does_no_work_on_the_leg():
    time = np.arange(2000) * TICK
    velocity = np.sin(3.0 * time)
    motor = 3.3 * 3.0 * np.cos(3.0 * time)  # the rotor's inertia times the exact acceleration
    left = interaction_torque(motor, np.zeros(2000), velocity, 3.3, TICK)
    assert np.abs(left[1:-1]).max() < 3.3 * 3.0**3 * TICK**2 / 6.0 * 1.01  # error of the central difference


def test_friction_dissipates_the_motor_work():
    still = np.zeros(5)
    assert_allclose(interaction_torque(still + 4.0, still - 1.5, still, 3.3, TICK), 2.5)


def test_positive_work_of_a_torque_in_phase_with_the_velocity():
    time = np.arange(10_000) * TICK
    torque, velocity = 2.0 * np.sin(2.0 * np.pi * time), 3.0 * np.sin(2.0 * np.pi * time)
    assert positive_work(torque, velocity, TICK) == pytest.approx(10.0 * 0.5 * 6.0, rel=1e-9)
    assert positive_work(-torque, velocity, TICK) == 0.0


def test_wearer_with_the_same_work_as_the_device_has_a_share_of_one_half():
    assert share_of_work(3.0, 3.0) == 0.5
    assert share_of_work(0.0, 3.0) == 0.0
    assert math.isnan(share_of_work(0.0, 0.0))


def test_torques_oppose_each_other_by_the_smaller_of_the_two():
    device = np.array([5.0, -2.0, 3.0, 0.0, -4.0])
    wearer = np.array([-1.0, 7.0, 2.0, 6.0, -1.0])
    assert_allclose(opposing_torque(device, wearer), [1.0, 2.0, 0.0, 0.0, 0.0])


def test_root_mean_square_of_three_and_four():
    assert root_mean_square(np.array([3.0, -4.0])) == pytest.approx(math.sqrt(12.5))
    assert math.isnan(root_mean_square(np.zeros(0)))


def test_battery_of_92_watt_hours_supplies_ten_watts_for_nine_hours():
    assert battery_life(92.2 * 3600.0, 10.0) / 3600.0 == pytest.approx(9.22)
    assert battery_life(92.2 * 3600.0, -1.0) == math.inf
    assert math.isnan(battery_life(92.2 * 3600.0, math.nan))


# ---------------------------------------------------------------- out and in again


@pytest.fixture(scope="module")
def walk() -> pd.DataFrame:
    return synthetic_run().log


def measures(hip: np.ndarray, strides: np.ndarray) -> list[float]:
    cycles = normalise_strides(hip, strides)
    extremes = stride_extremes(hip, strides)
    return [gait_variable_score(cycles, np.zeros(101)), *extremes.ravel().tolist()]


def read_csv(path) -> pd.DataFrame:
    """As any reader takes it: words, and numbers with all their digits."""
    with path.open(newline="") as file:
        names, *rows = csv.reader(file)
    table = pd.DataFrame(rows, columns=names)
    words = [name for name in names if name.endswith("_phase")]
    return table.astype({name: float for name in names if name not in words})


def test_measures_survive_a_csv_bit_for_bit(walk, tmp_path):
    path = tmp_path / "log.csv"
    export_csv(walk, path)
    back = read_csv(path)
    assert list(back) == list(walk)
    for name in walk.select_dtypes("number"):
        assert (back[name].to_numpy() == walk[name].to_numpy()).all(), name
    names = list(walk["left_phase"].cat.categories)
    first, second = (leg_record(log, Side.LEFT, names, TICK) for log in (walk, back))
    assert (first.strides() == second.strides()).all() and len(first.strides()) > 2
    assert measures(first.angles[JointName.HIP], first.strides()) == measures(
        second.angles[JointName.HIP], second.strides()
    )


@pytest.mark.parametrize(("unit", "rounding"), [("rad", 0.0), ("deg", 1e-14)])
@pytest.mark.parametrize("convention", [OPENSIM_GAIT2392, RAJAGOPAL])
def test_measures_survive_a_motion_file(walk, tmp_path, unit, rounding, convention):
    path = tmp_path / "walk.sto"
    export_motion(walk, path, convention, unit=unit)
    motion = read_log_table(path)
    assert motion.unit == unit
    strides = leg_record(walk, Side.LEFT, list(walk["left_phase"].cat.categories), TICK).strides()
    for joint, name in ((JointName.HIP, "hip_flexion_l"), (JointName.KNEE, "knee_angle_l")):
        angle = motion.numbers(name)
        back = convention.convert_angle(joint, np.radians(angle) if unit == "deg" else angle)
        before = walk[f"left_{joint}_angle_rad"].to_numpy()
        assert_allclose(measures(back, strides), measures(before, strides), rtol=0.0, atol=rounding)


def test_motion_file_keeps_the_rules_of_opensim(walk, tmp_path):
    """Title, version, counts that are true, the flag of the unit, endheader, tabs, time first and rising."""
    path = tmp_path / "walk.mot"
    export_motion(walk, path, RAJAGOPAL, unit="deg")
    header, _, body = path.read_text().partition("endheader\n")
    lines = header.splitlines()
    assert lines[0] == "walk"
    stated = dict(line.split("=") for line in lines[1:])
    assert set(stated) == {"version", "nRows", "nColumns", "inDegrees"}
    names, rows = body.split("\n", 1)
    table = np.loadtxt(io.StringIO(rows), delimiter="\t")
    assert names.split("\t")[0] == "time"
    assert (
        table.shape == (int(stated["nRows"]), int(stated["nColumns"])) == (len(walk), len(names.split("\t")))
    )
    assert stated["inDegrees"] == "yes" and (np.diff(table[:, 0]) > 0.0).all()
    assert not {len(line.split("\t")) for line in rows.splitlines()} - {int(stated["nColumns"])}
