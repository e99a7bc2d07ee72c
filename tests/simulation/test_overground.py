"""The shipped walk with crutches: what it does, and what it needs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin_gait import load_experiment, simulate, summarise_run
from twin_gait.experiment.experiment import Engine
from twin_gait.measures.crutches import crutch_use, single_support


@pytest.fixture(scope="module")
def walk():
    return simulate(load_experiment("overground", ["duration_s=12"]).experiment)


def test_the_walk_has_a_constant_speed_and_a_forward_trunk(walk):
    assert walk.verdict.outcome == "walked" and walk.trip is None
    settled = walk.log[walk.log["time_s"] > 4.0]
    way = np.ptp(settled["pelvis_forward_m"].to_numpy())
    assert 0.2 < way / 8.0 < 0.42
    lean = np.degrees(settled["trunk_pitch_rad"])
    assert 0.0 < lean.min() and lean.max() < 25.0


def test_without_arms_the_same_walk_falls_at_once_and_the_summary_reports_it(walk):
    free = summarise_run(walk)["free_trunk"]
    assert free["without_arms"]["status"] == "fell" and free["without_arms"]["duration_s"] < 4.0
    way = walk.log["pelvis_forward_m"]
    assert free["distance_m"] == way.iloc[-1] - way.iloc[0] > 2.0


def test_arms_stay_within_their_limits_and_their_use_equals_the_log(walk):
    limits = walk.experiment.scenario.crutches
    for side in walk.sides:
        push = walk.log[f"{side}_arm_axial_force_N"]
        assert push.max() <= limits.push_limit
        assert walk.log[f"{side}_shoulder_moment_Nm"].abs().max() <= limits.moment_limit
        use = crutch_use(walk.log, side, 1e-3, walk.body_weight)
        load = walk.log[f"{side}_crutch_normal_force_N"]
        assert use["impulse_Ns"] == pytest.approx(np.trapezoid(load, walk.log["time_s"]), rel=1e-3)
        assert use["mean_share"] == pytest.approx(
            use["impulse_Ns"] / walk.duration / walk.body_weight, rel=1e-3
        )
        assert math.isnan(crutch_use(walk.log, side, 1e-3, 0.0)["mean_share"])  # of no weight


def test_the_work_of_the_arms_counts_as_work_of_the_wearer(walk):
    power = sum(walk.log[f"{side}_arm_power_W"].to_numpy() for side in walk.sides)
    work = np.cumsum(power) * 1e-3
    assert np.abs(work - walk.log["external_work_J"].to_numpy()).max() < 0.02 * np.ptp(work)


ROD = "scenario.crutches={centre_of_mass_m: 0.55, inertia_kgm2: 0.55, tension_limit_N: 100}"
# Use of the arms and postures that wait in double support, found by hand for this test.
FIRM = "stiffness_Nm_per_deg: {}, equilibrium_deg: {}"
FOUR_POINT = (
    "scenario.arms={pattern: four_point, lowering_m_per_s: 0.5, planted_s: 0.05, reach_deg: 12, "
    "axial_force: 0.144, axial_force_per_lean_per_rad: 1.14, "
    "axial_force_per_lean_rate_s_per_rad: 0.2, lean_deg: 20.7, "
    "shoulder_moment_Nm: 6, min_axial_force: 0.042, swing_s: 0.424}",
    "scenario.crutch_ahead={left_m: 0.32, right_m: 0.32}",
    "table={extends: overground, phases: {"
    f"late_stance: {{hip: {{{FIRM.format(5.1, -1.3)}}}, knee: {{{FIRM.format(7.3, 11.6)}}}}}, "
    f"early_stance: {{hip: {{{FIRM.format(5.1, 21.8)}}}, knee: {{{FIRM.format(7.3, 11.6)}}}}}, "
    f"middle_stance: {{hip: {{{FIRM.format(2.9, 9.2)}}}}}}}}}",
)


def test_crutches_with_the_inertia_of_rods_keep_the_energy_balance():
    run = simulate(load_experiment("overground", [ROD, "duration_s=5"]).experiment)
    use = summarise_run(run)
    assert use["energy_residual_share"] < 1e-6 and use["step_stable"]
    for side in run.sides:
        assert 50.0 < use["free_trunk"]["arms"][side]["tension_peak_N"] <= 100.0


def test_in_four_point_gait_a_loaded_crutch_is_down_on_one_foot():
    """The first step begins in a standing posture of the preset's table, which leans back."""
    run = simulate(load_experiment("overground", [*FOUR_POINT, "duration_s=14"]).experiment)
    assert run.status == "completed"
    steps = [switch for switch in run.switches if switch.target == "swing_flexion"]
    assert len(steps) >= 6 and {steps[1].side, steps[2].side} == {*run.sides}
    log = run.log.iloc[steps[1].tick - 100 :]
    names = {"height": 1.75, "tip_aside": 0.15, "gravity": 9.81}
    support = single_support(log, 1e-3, **names)
    assert support["share_without_crutch"] == 0.0 and support["static_margin_m"] > 0.0
    as_needed = single_support(
        simulate(load_experiment("overground", ["duration_s=14"]).experiment).log, 1e-3, **names
    )
    assert as_needed["share_without_crutch"] > 0.5 and as_needed["static_margin_m"] < 0.0
    assert 0.05 < crutch_use(run.log, "left", 1e-3, run.body_weight)["mean_share"] < 0.2


def test_a_requested_four_point_step_waits_for_its_crutch():
    """The crutch is moved after the command to walk: 0.15 s of perception, 0.42 s of swing, then lowering."""
    settings = ["modes=walking", "requests=[walk@1s, step@1.1s]", "duration_s=3.2"]
    run = simulate(load_experiment("overground", [*FOUR_POINT, *settings]).experiment)
    first = run.switches[0]
    assert first.target == "swing_flexion" and 1600 < first.tick < 3100
    assert not [answer for answer in run.request_results if answer.rejection]


def test_without_step_commands_the_wearer_stands(walk):
    table = walk.table
    still = replace(
        table,
        phases={"stand": table.phases["stand"]},
        postures=("stand",),
        transitions=(),
        cycles=(),
        waivers=(),
        scaling=replace(table.scaling, stance_phases=("stand",)),
    )
    stood = simulate(replace(walk.experiment, table=still, duration=4.0, engine=Engine.PINOCCHIO))
    assert stood.status == "completed" and np.ptp(stood.log["pelvis_forward_m"]) < 0.1


@pytest.mark.parametrize("since", [1.0, 8.0, 20.0])
def test_a_standing_wearer_steps_on_command_after_any_time(since):
    """Both legs have stood since the same tick, and neither is clearly behind."""
    requests = f"requests=[walk@{since}s, step@{since + 0.1}s]"
    settings = ["modes=walking", requests, f"duration_s={since + 1.0}"]
    run = simulate(load_experiment("overground", settings).experiment)
    first = run.switches[0]
    assert (first.target, first.tick) == ("swing_flexion", round(1e3 * (since + 0.1)))
