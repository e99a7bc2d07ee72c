"""Tests of ground forces, joints and powers of a synthetic walk."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from twin_gait.measures.ground_strides import WalkConditions, slip_speed
from twin_gait.measures.leg_record import leg_record
from twin_gait.measures.strides import ERROR_PARTS, PERCENT, error_parts
from twin_gait.measures.walk import cop_curve, is_belt_driven, walk_measures, walk_power
from twin_gait.vocabulary import JointName, Side

TICK = 1e-3
STRIDE, STANCE = 1500, 1000  # ticks
CARRIED = 400.0  # [N]
SPEED = 0.4  # [m/s]
WALKWAY = WalkConditions(CARRIED, friction_coefficient=0.8, transition_velocity=0.05)
PHASES = ("early_stance", "swing_flexion")
SWING_BEGINS = 900  # ticks after heel strike, while the foot is loaded


def stance_load(tick: np.ndarray) -> np.ndarray:
    """Two humps of 1.2 of the carried weight about a trough of 0.8 in midstance."""
    return CARRIED * (1.0 + 0.2 * np.cos(4.0 * math.pi * (tick / STANCE - 0.25)))


def walk_log(*, slip: float = 0.0) -> pd.DataFrame:
    """Six strides of both legs; the right one half a stride later."""
    ticks = np.arange(6 * STRIDE)
    log = pd.DataFrame({"time_s": ticks * TICK, "guide_force_N": 20.0, "belt_speed_m_per_s": SPEED})
    for side, shift in ((Side.LEFT, 600), (Side.RIGHT, 600 + STRIDE // 2)):
        stride_tick = (ticks - shift) % STRIDE
        stance = stride_tick < STANCE
        load = np.where(stance, stance_load(stride_tick), 0.0)
        braking = np.where(stride_tick < 400, -50.0, np.where(stance, 20.0, 0.0))
        if slip:
            braking = np.where(stance, -0.8 * load * math.tanh(slip / 0.05), 0.0)
        log[f"{side}_phase"] = np.where(stride_tick < SWING_BEGINS, *PHASES)
        log[f"{side}_foot_normal_force_N"] = load
        log[f"{side}_foot_friction_force_N"] = braking
        log[f"{side}_foot_cop_ratio"] = np.where(stance, stride_tick / STANCE, 0.0)
        log[f"{side}_foot_clearance_m"] = np.where(stance, -0.005, 0.02)
        turn = 2.0 * math.pi * stride_tick / STRIDE
        log[f"{side}_hip_angle_rad"] = 0.2 + 0.3 * np.cos(turn)
        log[f"{side}_knee_angle_rad"] = 0.1 + 0.05 * np.sin(2.0 * turn)
        log[f"{side}_ankle_angle_rad"] = 0.15 * np.sin(turn)
        for joint, torque in ((JointName.HIP, 10.0), (JointName.KNEE, -4.0)):
            log[f"{side}_{joint}_velocity_rad_per_s"] = np.sin(turn)
            log[f"{side}_{joint}_motor_torque_Nm"] = torque * np.sin(turn)
            for source, torque in (("voluntary", 5.0), ("passive", -4.0), ("disturbance", 1.0)):
                log[f"{side}_{joint}_{source}_torque_Nm"] = torque * np.sin(turn)
    return log


def measured(log: pd.DataFrame) -> dict[Side, dict[str, float]]:
    left, right = (leg_record(log, side, PHASES, TICK) for side in Side)
    return {
        leg.side: walk_measures(log, leg, other, WALKWAY, swing_phase=1)
        for leg, other in ((left, right), (right, left))
    }


def test_every_measure_of_a_walk_written_by_hand() -> None:
    left = measured(walk_log())[Side.LEFT]
    assert left["cadence_per_min"] == pytest.approx(80.0)
    assert left["step_length_m"] == pytest.approx(0.4 * 0.75)
    assert left["load_peak"] == pytest.approx(1.2, abs=1e-4)
    assert left["loading_peak"] == pytest.approx(1.2, abs=1e-3)
    assert left["trough"] == pytest.approx(0.8, abs=1e-3)
    assert left["push_off_peak"] == pytest.approx(1.2, abs=1e-3)
    assert left["braking_impulse_Ns"] == pytest.approx(-20.0)
    assert left["propulsion_impulse_Ns"] == pytest.approx(12.0)
    assert left["fore_aft_force_N"] == pytest.approx(-8.0 / 1.5)
    assert (left["braking_peak"], left["propulsion_peak"]) == pytest.approx((-0.125, 0.05))
    assert left["ankle_range_deg"] == pytest.approx(math.degrees(0.3))
    assert left["hip_lowest_deg"] == pytest.approx(math.degrees(-0.1))
    assert left["knee_at_contact_deg"] == pytest.approx(math.degrees(0.1))
    assert left["knee_yield_deg"] == pytest.approx(math.degrees(0.05), abs=math.degrees(1e-3))
    assert left["clearance_m"] == pytest.approx(0.02)
    assert left["swing_entry"] == pytest.approx(0.6)
    assert left["swing_load_N"] == pytest.approx(float(stance_load(np.array(900.0))))
    assert left["cop_crossing"] == pytest.approx(0.34)
    assert left["belt_power_W"] == pytest.approx(0.4 * 8.0 / 1.5)
    assert (left["hip_motor_power_W"], left["knee_motor_power_W"]) == pytest.approx((5.0, -2.0))
    powers = [left[f"{source}_power_W"] for source in ("voluntary", "passive", "disturbance")]
    assert powers == pytest.approx([5.0, -4.0, 1.0])


def test_least_load_finds_a_foot_that_bounces_in_weight_acceptance() -> None:
    log = walk_log()
    # It rises from 6 % on, 90 ticks after heel strike.
    assert measured(log)[Side.LEFT]["min_load"] == pytest.approx(1.0 + 0.2 * math.cos(4.0 * math.pi * 0.16))
    stride_tick = (np.arange(len(log)) - 600) % STRIDE
    log.loc[(stride_tick >= 150) & (stride_tick < 250), "left_foot_normal_force_N"] = 0.05 * CARRIED
    left = measured(log)[Side.LEFT]
    assert left["min_load"] == pytest.approx(0.05)
    assert left["trough"] == pytest.approx(0.8, abs=1e-3)  # from 18 % on


def test_clearance_is_computed_over_the_counted_strides() -> None:
    log = walk_log()
    first = measured(log)[Side.LEFT]
    log.loc[log.index < 3 * STRIDE, "left_foot_clearance_m"] = 0.001  # of the first two strides
    assert measured(log)[Side.LEFT]["clearance_m"] == first["clearance_m"]
    log.loc[log.index > 4 * STRIDE, "left_foot_clearance_m"] -= 0.004
    assert measured(log)[Side.LEFT]["clearance_m"] == pytest.approx(0.016)


def test_foot_speed_at_contact_is_the_slope_of_the_clearance() -> None:
    log = walk_log()
    log["left_foot_clearance_m"] = 0.02
    strikes = log.index[(log.index >= 600) & ((log.index - 600) % STRIDE == 0)]
    log.loc[strikes, "left_foot_clearance_m"] -= 0.25 * TICK
    assert measured(log)[Side.LEFT]["landing_speed_m_per_s"] == pytest.approx(0.25)


def test_slip_is_the_speed_at_which_the_friction_arises() -> None:
    left = measured(walk_log(slip=0.03))[Side.LEFT]
    assert left["slip_m"] == pytest.approx(0.03 * STANCE * TICK)
    speeds = np.array([0.0, 1e-4, 0.05, 0.4])
    forces = -0.8 * 300.0 * np.tanh(speeds / 0.05)
    assert_allclose(slip_speed(forces, np.full(4, 300.0), WALKWAY), speeds, rtol=1e-5)
    assert_allclose(slip_speed(-forces, np.full(4, 10.0), WALKWAY), 0.0)  # hardly touches
    smooth = replace(WALKWAY, friction_coefficient=0.0)
    assert np.isnan(slip_speed(forces, np.full(4, 300.0), smooth)).all()


def test_centre_of_pressure_is_weighted_with_the_load() -> None:
    cop, load = np.array([0.2] * 100 + [0.8] * 101), np.array([100.0] * 100 + [300.0] * 101)
    bounds = np.array([[0, 99], [100, 199]])
    curve = cop_curve(cop, load, bounds)
    assert_allclose(curve, (0.2 * 100.0 + 0.8 * 300.0) / 400.0)
    assert np.isnan(cop_curve(cop, np.zeros(201), bounds)).all()


def test_a_walk_without_strides_has_no_numbers() -> None:
    log = walk_log().iloc[: 2 * STRIDE]
    left = measured(log)[Side.LEFT]
    assert np.isnan([*left.values()]).all()


def test_belt_carries_a_walk_if_its_work_exceeds_the_work_of_the_legs() -> None:
    log = walk_log()
    bounds = leg_record(log, Side.LEFT, PHASES, TICK).strides()
    power = walk_power(log, measured(log).values(), bounds, WALKWAY)
    assert power["belt_W"] == pytest.approx(2.0 * 0.4 * 8.0 / 1.5)
    assert power["motors_W"] == pytest.approx(6.0)
    powers = [power[f"{source}_W"] for source in ("voluntary", "passive", "disturbance")]
    assert powers == pytest.approx([10.0, -8.0, 2.0])
    assert power["guide_force_N"] == pytest.approx(20.0)
    assert power["guide_W"] == 0.0 and not power["belt_driven"]
    braced = log.assign(pelvis_forward_velocity_m_per_s=0.1, wearer_pelvis_forward_velocity_m_per_s=0.2)
    assert walk_power(braced, measured(log).values(), bounds, WALKWAY)["guide_W"] == pytest.approx(4.0)
    assert is_belt_driven(10.0, SPEED, 3.9, CARRIED)  # 4 W
    assert not is_belt_driven(10.0, SPEED, 4.1, CARRIED)
    assert not is_belt_driven(7.5, SPEED, -5.0, CARRIED)  # less than 2 % of the carried 400 N
    assert not is_belt_driven(math.nan, SPEED, math.nan, CARRIED)


def test_a_belt_with_changed_speed_counts_with_its_actual_speed() -> None:
    log = walk_log()
    strides = leg_record(log, Side.LEFT, PHASES, TICK).strides()
    last = np.arange(len(log)) >= strides[-1, 0]
    left, faster = (
        measured(item)[Side.LEFT]
        for item in (log, log.assign(belt_speed_m_per_s=np.where(last, 2.0 * SPEED, SPEED)))
    )
    # One of the counted strides went twice as far, all of them alike in force.
    share = 1.0 + 1.0 / len(strides)
    assert faster["belt_power_W"] == pytest.approx(share * left["belt_power_W"])
    assert faster["step_length_m"] == pytest.approx(share * left["step_length_m"])


def test_standing_between_two_walks_is_excluded_from_all_measures() -> None:
    """Six strides, ten seconds of standing, and the same six strides."""
    walk, pause = walk_log(), 10_000
    walk["pelvis_forward_m"], walk["belt_speed_m_per_s"] = SPEED * walk["time_s"], 0.0
    standing = walk.iloc[[-1] * pause].assign(
        left_hip_velocity_rad_per_s=3.0, left_foot_normal_force_N=CARRIED, guide_force_N=-70.0
    )
    standing["left_phase"] = np.where(np.arange(pause) < pause // 2, *PHASES)
    log = pd.concat([walk, standing, walk], ignore_index=True)
    end = len(walk) * TICK
    spans = ((0.0, end), (end + pause * TICK, 2.0 * end + pause * TICK))

    def both(log: pd.DataFrame, **when: Any) -> tuple[dict[str, float], dict[str, float]]:
        left, right = (leg_record(log, side, PHASES, TICK, **when) for side in Side)
        found = walk_measures(log, left, right, WALKWAY, swing_phase=1, skip=0)
        return found, walk_power(log, [found], left.strides(skip=0), WALKWAY)

    (alone, drives), (twice, drive) = both(walk), both(log, steady=spans)
    assert drive == pytest.approx(drives)
    assert twice == pytest.approx(alone)
    assert twice["step_length_m"] == pytest.approx(SPEED * 0.75)


# ------------------------------------------------------------------ offset, timing and shape


def error_in_degrees(total: float, offset: float, timing: float, shape: float, shift: float) -> Any:
    """Return parts of an error, given in [rad] and as a share of the cycle, in reported units."""
    values = (*np.degrees([total, offset, timing, shape]), 100.0 * shift)
    return pytest.approx(dict(zip(ERROR_PARTS, values, strict=True)), abs=math.degrees(1e-7))


def sine(harmonic: int = 1, *, late: float = 0.0) -> np.ndarray:
    return np.sin(2.0 * math.pi * harmonic * (PERCENT / 100.0 - late))


@pytest.mark.parametrize(("late", "offset"), [(0.0, 0.0), (0.21, -0.7), (-0.4, 0.3), (0.5, 0.0)])
def test_parts_of_an_error_in_closed_form(late: float, offset: float) -> None:
    """A sine that is late, too high and has a harmonic that the reference does not."""
    cycles = np.tile(offset + 2.0 * sine(late=late) + 0.5 * sine(3), (4, 1))
    parts = error_parts(cycles, 2.0 * sine())
    timing = 2.0 * math.sqrt(2.0) * abs(math.sin(math.pi * late))
    shape = 0.5 / math.sqrt(2.0)
    total = math.sqrt(offset**2 + timing**2 + shape**2)
    assert parts == error_in_degrees(total, offset, timing, shape, late)


def test_error_parts_are_over_all_strides_and_add_up_to_the_total() -> None:
    rng = np.random.default_rng(7)
    cycles, reference = rng.normal(size=(5, 101)).cumsum(axis=1), rng.normal(size=101).cumsum()
    total, offset, timing, shape, shift = error_parts(cycles, reference).values()
    difference = (cycles - reference)[:, :-1]
    assert total == pytest.approx(math.degrees(math.sqrt(np.mean(difference**2))))
    assert offset == pytest.approx(math.degrees(difference.mean()))
    shifted = [
        np.mean((np.roll(cycles[:, :-1], -samples, axis=1) - reference[:-1] - difference.mean()) ** 2)
        for samples in range(100)
    ]
    assert shape == pytest.approx(math.degrees(math.sqrt(min(shifted))))
    assert shift == pytest.approx((np.argmin(shifted) + 50) % 100 - 50)
    assert total**2 == pytest.approx(offset**2 + timing**2 + shape**2)


def test_strides_that_differ_err_in_shape() -> None:
    parts = error_parts(np.array([sine() + 0.3, sine() - 0.3]), sine())
    assert parts == error_in_degrees(0.3, 0.0, 0.0, 0.3, 0.0)
    assert all(math.isnan(part) for part in error_parts(np.zeros((0, 101)), sine()).values())


def test_error_parts_are_undefined_if_a_stride_has_a_gap() -> None:
    cycles = np.array([sine(), np.where(PERCENT == 50.0, math.nan, sine())])
    assert all(math.isnan(part) for part in [*error_parts(cycles, sine()).values()][:4])
