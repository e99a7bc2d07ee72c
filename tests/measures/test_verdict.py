"""Tests of the outcome of a run, which is the same in all outputs."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from errors import states
from table_builder import FIVE_PHASES

from twin_gait import load_experiment, simulate
from twin_gait.cli.program import main
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.outcome import (
    HIGHEST_FLIGHT_SHARE,
    HIGHEST_STRIDE_VARIATION,
    LONGEST_STRIDE,
    flight_share,
    judge_gait,
)
from twin_gait.measures.strides import SKIPPED_STRIDES
from twin_gait.report.formatting import describe_strides
from twin_gait.report.run_figures import draw_cycle
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation.run import RunStatus
from twin_gait.studies.batch import flat_summary
from twin_gait.studies.fault_campaign import fault_row
from twin_gait.vocabulary import JointName, Outcome, Side

TICK = 1e-3


def leg(
    side: Side, strikes: list[float], *, stance: float = 0.6, duration: float = 20.0, **changes
) -> LegRecord:
    """Return a leg that is loaded for ``stance`` seconds after each heel strike; strikes in [s]."""
    n = round(duration / TICK)
    force = np.zeros(n)
    for strike in strikes:
        force[round(strike / TICK) : round((strike + stance) / TICK)] = 300.0
    hip = {JointName.HIP: np.arange(n) * TICK}  # flexes whenever the foot is off the ground
    record = LegRecord(side, TICK, np.zeros(n, int), hip, force, np.zeros(n))
    return replace(record, **changes)


def walker(period: float = 1.2, **changes) -> list[LegRecord]:
    """Return two legs in antiphase, one of them on the ground at any time."""
    strikes = np.arange(0.2, 20.0, period)
    return [
        leg(Side.LEFT, list(strikes), stance=0.55 * period, **changes),
        leg(Side.RIGHT, list(strikes + 0.5 * period), stance=0.55 * period, **changes),
    ]


def test_a_regular_walk_counts_as_walking():
    assert judge_gait(walker()) == (Outcome.WALKED, "")


@pytest.mark.parametrize("margin, outcome", [(-0.1, Outcome.WALKED), (0.1, Outcome.STALLED)])
def test_a_long_gap_between_strides_is_reported_as_a_stall(margin, outcome):
    """The legs stand on the ground in the gap, so that only the missing stride indicates a stall."""
    gap = LONGEST_STRIDE + margin
    strikes = [0.2, 1.4, 2.6, 3.8, 5.0, *np.arange(5.0 + gap, 20.0, 1.2)]
    # All strides but one are equal, so that the variation is not to decide: it is skipped with the first two.
    record = leg(Side.LEFT, [5.0 - 1.2, 5.0, *strikes[5:]], stance=0.6)
    standing = leg(Side.RIGHT, [0.3, 2.3, 4.3, 6.3, 8.3, 10.3, 12.3, 14.3, 16.3, 18.3], stance=1.6)
    verdict = judge_gait([record, standing])
    assert verdict.outcome is outcome
    if outcome is Outcome.STALLED:
        assert states(verdict.reason, "left", f"{gap:.1f} s", "5.0 s")


@pytest.mark.parametrize("waited, outcome", [(3.7, Outcome.WALKED), (0.5, Outcome.STALLED)])
def test_waiting_for_a_step_is_not_a_stall(waited, outcome):
    strikes = [0.2, 1.4, 2.6, 3.8, 5.0, *np.arange(10.0, 20.0, 1.2)]
    waiting = np.zeros(round(20.0 / TICK), dtype=bool)
    waiting[5500 : 5500 + round(waited / TICK)] = True
    standing = leg(Side.RIGHT, [0.3, 2.3, 4.3, 6.3, 8.3, 10.3, 12.3, 14.3, 16.3, 18.3], stance=1.6)
    verdict = judge_gait([leg(Side.LEFT, strikes, stance=0.6, waiting=waiting), standing])
    assert verdict.outcome is outcome
    assert verdict.reason == "" or states(verdict.reason, "left", "4.5 s", "5.0 s")


@pytest.mark.parametrize("factor, outcome", [(0.95, Outcome.WALKED), (1.05, Outcome.STALLED)])
def test_irregular_strides_do_not_count_as_walking(factor, outcome):
    """Strides of T (1 + e) and T (1 - e) in turn vary by e √(n / (n - 1)): sample deviation over mean."""
    count = 12
    spread = factor * HIGHEST_STRIDE_VARIATION / math.sqrt(count / (count - 1))
    times = [1.2, 1.2, *([1.2 * (1.0 + spread), 1.2 * (1.0 - spread)] * (count // 2))]
    strikes = list(0.2 + np.cumsum([0.0, *times]))
    standing = leg(Side.RIGHT, list(np.arange(0.3, 20.0, 2.0)), stance=1.6)
    end = strikes[-1] + 1.0
    irregular = leg(Side.LEFT, strikes, steady=((0.0, end),))
    verdict = judge_gait([irregular, replace(standing, steady=((0.0, end),))])
    assert verdict.outcome is outcome


@pytest.mark.parametrize("margin, outcome", [(-0.02, Outcome.WALKED), (0.02, Outcome.HUNG)])
def test_feet_off_the_ground_give_the_outcome_hung(margin, outcome):
    """Regular strides of two feet of which none carries for a share of each stride."""
    share = HIGHEST_FLIGHT_SHARE + margin
    strikes = np.arange(0.3, 19.0, 2.0)
    stance = 1.0 * (1.0 - share)
    legs = [
        leg(Side.LEFT, list(strikes), stance=stance, duration=18.3, steady=((0.3, 18.3),)),
        leg(Side.RIGHT, list(strikes + 1.0), stance=stance, duration=18.3, steady=((0.3, 18.3),)),
    ]
    assert flight_share(legs) == pytest.approx(share, abs=2e-3)
    assert judge_gait(legs).outcome is outcome


def test_only_the_steady_time_counts():
    legs = walker()
    late = [
        replace(item, normal_force=np.where(np.arange(20000) < 9000, 0.0, item.normal_force)) for item in legs
    ]
    assert judge_gait(late).outcome is Outcome.HUNG
    assert judge_gait([replace(item, steady=((9.0, 20.0),)) for item in late]).outcome is Outcome.WALKED


@pytest.mark.parametrize("end, outcome", [(1.3, Outcome.TOO_SHORT), (2.7, Outcome.WALKED)])
def test_a_run_without_a_whole_stride_of_each_leg_is_too_short_to_judge(end, outcome):
    """Heel strikes of the left leg at 1.4 and 2.6 s, of the right leg at 0.8 and 2.0 s."""
    verdict = judge_gait([replace(item, steady=((0.0, end),)) for item in walker()])
    assert verdict.outcome is outcome
    if outcome is Outcome.TOO_SHORT:
        assert states(verdict.reason, "left", "1.3 s")


def test_legs_that_hang_for_long_are_not_too_short_to_judge():
    hanging = [leg(side, [], duration=4.5) for side in Side]
    assert judge_gait(hanging).outcome is Outcome.HUNG
    assert judge_gait([leg(side, [], duration=3.9) for side in Side]).outcome is Outcome.TOO_SHORT


def test_a_run_without_a_walk_command_is_not_judged_as_failed():
    assert judge_gait([replace(item, steady=()) for item in walker()]) == (Outcome.WALKED, "")


def test_standing_between_two_walks_counts_neither_as_gap_nor_as_stride():
    strikes = [*np.arange(0.2, 6.0, 1.2), *np.arange(14.2, 20.0, 1.2)]
    legs = [leg(Side.LEFT, strikes, stance=0.6), leg(Side.RIGHT, list(np.arange(0.3, 20.0, 2.0)), stance=1.6)]
    assert judge_gait(legs).outcome is Outcome.STALLED
    twice = [replace(item, steady=((0.0, 6.5), (14.0, 20.0))) for item in legs]
    assert judge_gait(twice).outcome is Outcome.WALKED
    for item, stride, fewest in zip(twice, (1.2, 2.0), (7, 5), strict=True):
        strides = np.diff(item.strides(skip=0), axis=1) * item.tick
        assert len(strides) >= fewest
        np.testing.assert_allclose(strides, stride, atol=2e-3)


# ---------------------------------------------------------------- runs


def test_a_run_of_three_tenths_of_a_second_is_too_short_for_a_walk():
    run = simulate(load_experiment("treadmill_guided", ["duration_s=0.3"]).experiment)
    assert run.verdict.outcome is Outcome.TOO_SHORT
    assert summarise_run(run)["outcome"] == flat_summary(run)["outcome"] == "too short to judge"


@pytest.fixture(scope="module")
def walk():
    return simulate(load_experiment("treadmill_guided", ["duration_s=12"]).experiment)


NEARLY_ALL = f"table={FIVE_PHASES}", "scenario.support.share=0.95"
ALL = "control.mode=position", "scenario.support.share=1.0"  # along a path that a foot in the air follows too


@pytest.mark.parametrize(
    "settings, outcome",
    [((), "walked"), (NEARLY_ALL, "hung"), pytest.param(ALL, "hung", marks=pytest.mark.slow)],
)
def test_a_wearer_hanging_in_the_harness_does_not_count_as_walking(settings, outcome):
    run = simulate(load_experiment("treadmill_guided", ["duration_s=12", *settings]).experiment)
    assert run.status is RunStatus.COMPLETED
    assert (run.verdict.outcome, flat_summary(run)["outcome"], summarise_run(run)["outcome"]) == (
        outcome,
    ) * 3


def test_a_run_that_ends_early_reports_its_outcome(walk):
    trip = simulate(
        load_experiment("bench_leg", ["duration_s=2", "faults=['encoder_jump:right_hip@1s']"]).experiment
    )
    assert trip.verdict.outcome == "held"
    assert states(trip.verdict.reason, "1.000 s", "encoder jump", "right hip")
    assert fault_row(trip)["outcome"] == "held"
    fell = replace(walk, status=RunStatus.FELL, reason="the pelvis fell below 0.60 m at 9.000 s")
    assert fell.verdict == ("fell", fell.reason)
    both = replace(fell, trip=trip.trip)
    assert both.verdict.outcome == "fell" and states(both.verdict.reason, "encoder jump", "right hip")
    assert replace(walk, status=RunStatus.DIVERGED, reason="x").verdict == ("diverged", "x")


def test_a_table_without_transitions_requires_no_walk():
    run = simulate(load_experiment("bench_leg", ["duration_s=0.1", "table=examples/hold.yaml"]).experiment)
    assert run.verdict.outcome is None
    assert flat_summary(run)["outcome"] is None


def test_terminal_figure_and_summary_count_the_same_strides(walk):
    summary = summarise_run(walk)
    left = summary["sides"]["left"]
    counted, found = left["strides_counted"], left["strides"]
    assert found - SKIPPED_STRIDES == counted >= 1
    expected = f"{counted} stride{'s' * (counted > 1)} (the first 2 of {found} settle)"
    assert describe_strides(left).startswith(f"{expected} of ")
    titles = [axes.get_title(loc=loc) for axes in draw_cycle(walk).axes for loc in ("left", "center")]
    assert any(title.startswith(f"left hip, {expected}, RMSE") for title in titles)


def test_the_command_begins_with_the_outcome(tmp_path, capsys):
    out = tmp_path / "run"
    given = [
        "simulate",
        "treadmill_guided",
        "--duration",
        "9",
        *(word for setting in NEARLY_ALL for word in ("--set", setting)),
        "--no-pictures",
        "--unchecked",
    ]
    assert main([*given, "--out", str(out)]) == 0
    assert capsys.readouterr().out.startswith("hung: 9 s in ")
    assert json.loads((out / "summary.json").read_text())["outcome"] == "hung"
