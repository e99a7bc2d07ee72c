"""Batches of short walks: the same table whoever runs them, and each row what `simulate` gives alone."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from errors import raises

from twin_gait import load_experiment, simulate
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.experiment import Experiment
from twin_gait.runs.summary import summarise_run
from twin_gait.studies import batch
from twin_gait.studies.batch import override_experiment, simulate_batch

FALLING = 4
OVERRIDES: list[dict[str, Any]] = [
    {"patient.mass_kg": 60.0 + 2.0 * number, "scenario.belt_speed_m_per_s": 0.30 + 0.01 * number}
    for number in range(12)
]
OVERRIDES[FALLING] = {
    "patient.mass_kg": 68.0,
    "scenario.support.share": 0.0,
    "scenario.support.lock_stiffness_N_per_m": 0.0,
    "table.phases.middle_stance.knee.stiffness_Nm_per_deg": 0.01,  # the leg that carries alone
}


@pytest.fixture(scope="module")
def walk() -> Experiment:
    return load_experiment("treadmill_guided", ["duration_s=6", "engine=compiled"]).experiment


@pytest.fixture(scope="module")
def noisy(walk: Experiment) -> Experiment:
    sensors = replace(walk.sensors, ideal=False, angle_noise=1e-5)
    return replace(walk, duration=0.5, sensors=sensors, seed=11)


@pytest.fixture(scope="module")
def alone(walk: Experiment) -> pd.DataFrame:
    """All twelve in this process."""
    return simulate_batch(walk, OVERRIDES)


def assert_same(ours: pd.DataFrame, theirs: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(ours, theirs, check_exact=True)


@pytest.mark.slow
def test_two_workers_give_the_same_table(walk, alone):
    polls, counts = [], []

    def progress(done: int, total: int) -> None:
        counts.append((done, total))
        # A worker's task and one to follow: what is under way does not grow with the batch.
        assert len(polls) <= done + 3

    table = simulate_batch(
        walk,
        OVERRIDES,
        workers=2,
        progress=progress,
        should_stop=lambda: polls.append(True) or False,
    )
    assert_same(table, alone)
    assert counts == [(done, 12) for done in range(1, 13)]


@pytest.mark.parametrize("length", [1, 7])
def test_a_shorter_batch_is_the_beginning_of_a_longer_one(walk, alone, length):
    short = simulate_batch(walk, OVERRIDES[:length])
    longer = alone.head(length)
    keys = [name for name in longer.columns if name in short.columns]
    assert set(longer.columns) - set(short.columns) <= set(OVERRIDES[FALLING])
    assert_same(short, longer[keys])


def test_order_does_not_matter(walk, alone):
    order = np.random.default_rng(3).permutation(len(OVERRIDES))
    shuffled = simulate_batch(walk, [OVERRIDES[index] for index in order])
    assert shuffled["episode"].tolist() == list(range(12))
    shuffled = shuffled.assign(episode=order).sort_values("episode").reset_index(drop=True)
    assert_same(shuffled[list(alone.columns)], alone)


def test_a_row_is_the_summary_of_its_episode(walk, alone):
    settings = ["duration_s=6", "engine=compiled", "patient.mass_kg=82", "scenario.belt_speed_m_per_s=0.41"]
    by_command_line = load_experiment("treadmill_guided", settings).experiment
    assert override_experiment(walk, OVERRIDES[11]) == by_command_line
    summary, row = summarise_run(simulate(by_command_line)), alone.iloc[11]
    assert row["patient.mass_kg"] == 82.0
    assert row["duration_s"] == 6.0
    assert row["battery_power_mean_W"] == summary["battery_power_mean_W"]
    left = summary["sides"]["left"]
    assert row["left_strides"] == left["strides"] >= 1
    assert row["left_further_contacts"] == left["further_contacts"]
    assert row["left_hip_torque_rms_Nm"] == left["joints"]["hip"]["torque_rms_Nm"]
    assert row["right_knee_saturated_share"] == summary["sides"]["right"]["joints"]["knee"]["saturated_share"]


def test_changes_have_an_effect_and_no_wall_time_is_kept(alone):
    assert alone["battery_power_mean_W"].nunique() == len(OVERRIDES)
    assert not [name for name in alone.columns if "wall" in name or "realtime" in name]


def test_a_fall_ends_its_episode_only(alone):
    fallen = alone["fell"]
    assert fallen.tolist() == [index == FALLING for index in range(12)]
    assert alone["status"][FALLING] == "fell"
    assert 0.0 < alone["duration_s"][FALLING] < 6.0
    assert (alone["duration_s"][~fallen] == 6.0).all()
    assert np.isnan(alone["scenario.support.share"][0])


WRONG = {
    "misspelt": ({"patient.mas_kg": 80}, ("episode 1", "patient.mas_kg", "mass_kg")),
    "out of range": ({"patient.mass_kg": -1}, ("episode 1", "patient.mass_kg", "10", "160 kg", "-1")),
    "not a key": ({"patient..mass_kg": 80}, ("episode 1", "patient..mass_kg")),
    "no such item": (
        {"table.transitions[99].cause": "x"},
        ("episode 1", "table.transitions[99].cause"),
    ),
    "assignment": ({"patient.mass_kg=80": 80}, ("episode 1", "patient.mass_kg=80")),
    "two units": ({"duration_s": 2, "duration_ms": 20}, ("episode 1", "duration_s", "duration_ms")),
    "wrong type": ({"duration_s": "long"}, ("episode 1", "duration_s", "long")),
}


@pytest.mark.parametrize(("wrong", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_change_is_one_line_and_nothing_runs(walk, monkeypatch, wrong, message):
    ran: list[Any] = []
    monkeypatch.setattr(batch, "run_episodes", lambda *arguments, **options: ran.append(arguments))
    with raises(ParameterFileError, *message) as error:
        simulate_batch(walk, [{}, wrong])
    assert "\n" not in str(error.value)
    assert ran == []


UNGUARDED = """
from twin_gait import load_experiment, simulate_batch
experiment = load_experiment("bench_leg", ["duration_s=0.1"]).experiment
simulate_batch(experiment, [{"seed": seed} for seed in range(EPISODES)], workers=2)
"""


@pytest.mark.slow
@pytest.mark.parametrize("episodes", [2, 5])
def test_a_script_without_a_main_guard_is_reported_once(tmp_path, episodes):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED.replace("EPISODES", str(episodes)))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert len(lines) < 20, done.stderr
    assert "if __name__ == '__main__':" in lines[-1]
    assert done.stderr.count("Traceback") == 1  # that of the script itself


def test_an_episode_that_cannot_be_run_is_named_across_processes(walk):
    with raises(ParameterError, "episode 1", "nothing"):
        simulate_batch(walk, [{"duration_s": 0.1}, {"leg.left.hip": "nothing"}], workers=2)


def test_invalid_numbers_of_workers_are_refused(walk):
    with raises(ParameterError, "workers", "1", "0"):
        simulate_batch(walk, [{}, {}], workers=0)


def test_equal_episodes_are_equal_and_a_seed_gives_other_draws(noisy):
    table = simulate_batch(noisy, [{}, {}, {"seed": 12}, {"seed": 11}])
    assert table["seed"].tolist() == [11, 11, 12, 11]
    power = table["battery_power_mean_W"]
    assert power[0] == power[1] == power[3] != power[2]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_stopped_batch_keeps_the_first_episodes(walk, alone, workers):
    done = 0

    def progress(number: int, total: int) -> None:
        nonlocal done
        done = number

    table = simulate_batch(walk, OVERRIDES, workers=workers, progress=progress, should_stop=lambda: done >= 3)
    # With two workers those that were under way are finished and kept.
    assert 3 <= len(table) <= (3 if workers == 1 else 6)
    assert_same(table, alone.head(len(table)))


def test_a_batch_stopped_at_once_and_an_empty_one_have_no_rows(walk):
    assert len(simulate_batch(walk, OVERRIDES[:2], should_stop=lambda: True)) == 0
    assert len(simulate_batch(walk, [])) == 0


def test_a_key_named_like_a_measure_keeps_both_columns(walk):
    table = simulate_batch(walk, [{"duration_s": np.float64(0.2)}, {**OVERRIDES[FALLING], "duration_s": 4}])
    assert table["set.duration_s"].tolist() == [0.2, 4.0]
    assert table["duration_s"][0] == 0.2
    assert table["duration_s"][1] < 4.0
