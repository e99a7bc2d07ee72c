"""Runaways of a command end in the hold before the wearer falls, and no walk comes near the bound."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd
import pytest
from injected_faults.deviation import deviations, filtered, largest_deviation
from injected_faults.runaways import (
    APART,
    RATES,
    draw_runaways,
    draw_walkers,
    runaway_row,
    walker_of,
    walker_row,
    with_faults,
)

from twin_gait import JointName, Side, load_experiment, simulate
from twin_gait.control.safety import TripCause
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun
from twin_gait.studies.batch import run_episodes
from twin_gait.studies.fault_campaign import DRAWN_KINDS

BOUND = 10.0  # [N·m]


def runaways(experiment, count: int, seed: int) -> pd.DataFrame:
    faults = draw_runaways(experiment, count, seed, 1.0)
    return pd.DataFrame(run_episodes(partial(with_faults, experiment), runaway_row, faults))


def test_runaways_are_drawn_over_their_ranges_and_every_second_one_has_another_fault():
    experiment = load_experiment("treadmill_guided", ["duration_s=8"]).experiment
    drawn = draw_runaways(experiment, 400, 3, 1.0)
    assert drawn == draw_runaways(experiment, 400, 3, 1.0)
    assert [len(faults) for faults in drawn] == [1, 2] * 200
    assert {faults[1].kind for faults in drawn[1::2]} == set(DRAWN_KINDS)
    first = [faults[0] for faults in drawn]
    assert {fault.location for fault in first} == {"left_hip", "left_knee", "right_hip", "right_knee"}
    rates, times = (
        np.array([getattr(fault, name) for fault in first]) for name in ("magnitude_or_default", "time")
    )
    assert RATES[0] <= np.abs(rates).min() < 8.0 and 1500.0 < np.abs(rates).max() <= RATES[1]
    assert 0.4 < np.mean(rates > 0.0) < 0.6
    assert 1.0 <= times.min() < 1.1 and 3.9 < times.max() <= 4.0
    assert max(abs(faults[1].time - faults[0].time) for faults in drawn[1::2]) <= APART + 1e-9


@pytest.mark.parametrize("count", [16, pytest.param(96, marks=pytest.mark.slow)])
def test_no_seeded_runaway_ends_in_a_fall(count):
    experiment = load_experiment("treadmill_guided", ["duration_s=7"]).experiment
    table = runaways(experiment, count, 11)
    assert len(table) == count and (table["outcome"] == "held").all() and (table["cause"] != "").all()
    alone = table[table["second"] == ""]
    assert (alone["cause"] == "command_against_setpoint").mean() > 0.8


@pytest.mark.slow
@pytest.mark.parametrize(
    "preset", ["treadmill_guided", "treadmill_40", "treadmill_start_stop", "treadmill_ankle"]
)
def test_no_seeded_runaway_ends_in_a_fall_on_any_belt(preset):
    """In the longer run a wearer whose runaway is slow has time to fall."""
    table = runaways(load_experiment(preset, ["duration_s=10"]).experiment, 320, 12)
    assert not (table["outcome"] == "fell").any() and not (table["outcome"] == "diverged").any()


NOISE = ["sensors.ideal=false", "sensors.angle_noise_rad=1e-3"]
WALKS = {
    "treadmill_guided": ("treadmill_guided", []),
    "treadmill_40": ("treadmill_40", []),
    "treadmill_ankle": ("treadmill_ankle", []),
    "start and stop": ("treadmill_start_stop", ["duration_s=17"]),
    "bench_leg": ("bench_leg", []),
    "start and stop with noise": ("treadmill_start_stop", ["duration_s=17", *NOISE]),
    "position": ("treadmill_guided", ["control.mode=position"]),
    "transparent": ("bench_leg", ["control.mode=transparent"]),
    "delay": ("treadmill_guided", ["control.delay_ms=3"]),
    "no blending": ("treadmill_guided", ["table.blending.duration_ms=0"]),
}
LOOPS_OF_THEIR_OWN = "position", "delay"  # compiled for this test alone


@pytest.mark.parametrize(
    "walk",
    [
        pytest.param(walk, id=name, marks=[pytest.mark.slow] if name in LOOPS_OF_THEIR_OWN else [])
        for name, walk in WALKS.items()
    ],
)
def test_a_run_without_a_fault_stays_far_from_the_bound(walk):
    preset, changes = walk
    settings = ["duration_s=8", *changes, "control.safety.command_deviation_Nm=1e3"]
    run = simulate(load_experiment(preset, settings).experiment)
    assert largest_deviation(run) < 0.5 * BOUND


@pytest.mark.slow
def test_random_walks_stay_far_from_the_bound():
    count = 32
    experiment = load_experiment("treadmill_guided", ["duration_s=6"]).experiment
    rows = run_episodes(partial(walker_of, experiment), walker_row, draw_walkers(count, 7))
    walked = [row["deviation_Nm"] for row in rows if row["outcome"] == "walked"]
    assert len(walked) >= 0.625 * count and max(walked) < 0.2 * BOUND


@pytest.mark.parametrize(
    "network", ["can", "{impedance: ccu, delay_ms: 2}", "{loss: 0.1, jitter_us: 700, delay_ms: 3}"]
)
def test_a_walk_over_a_bus_stays_far_from_the_bound(network):
    """Log columns come from the gait controller here, so that a tight bound shows a difference."""
    settings = ["duration_s=6", f"network={network}", f"control.safety.command_deviation_Nm={0.2 * BOUND}"]
    assert simulate(load_experiment("treadmill_guided", settings).experiment).trip is None


def test_changes_of_a_running_walk_stay_far_from_the_bound():
    """Stiffness, damping, equilibrium and gain of every phase change at once, ten times a second."""
    settings = ["duration_s=60", f"control.safety.command_deviation_Nm={0.2 * BOUND}"]
    run = SteppedRun(build_setup(load_experiment("treadmill_guided", settings).experiment))
    generator, rows = np.random.default_rng(0), np.array(run.numbers["phase_rows"])
    for _ in range(50):
        run.advance(100)
        changed = rows * generator.uniform(0.8, 1.25, rows.shape)
        run.set({**run.numbers, "phase_rows": changed.tolist()}, fade_ticks=0)
    assert run.trip is None and run.tick == 5000


def test_the_deviation_of_a_log_is_the_runaway_that_was_injected():
    fault = "controller_runaway:right_hip@2s=20Nm/s"
    settings = ["duration_s=2.6", f"faults=['{fault}']", "sensors.ideal=false"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    assert run.trip is not None and run.trip.cause is TripCause.SETPOINT
    raw = deviations(run, Side.RIGHT, JointName.HIP)[: run.trip.tick]
    injected = 20.0 * np.maximum(np.arange(-1, run.trip.tick - 1) * 1e-3 - 2.0, 0.0)
    assert np.abs(filtered(raw - injected, 0.02)).max() < 0.2 * BOUND
    found = np.abs(filtered(deviations(run, Side.RIGHT, JointName.HIP)[: run.trip.tick + 1], 0.02))
    assert found[-1] > BOUND and (found[:-1] <= BOUND).all()
