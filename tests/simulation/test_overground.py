"""The shipped walk with crutches: what it does, and what it needs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin_gait import load_experiment, simulate, summarise_run
from twin_gait.experiment.experiment import Engine
from twin_gait.measures.crutches import crutch_use


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
