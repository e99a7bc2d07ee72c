"""Episodes together: whatever else is in a block, each is what `simulate` gives alone, bit for bit."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import pytest
from errors import raises
from hypothesis import given
from hypothesis import strategies as st

from twin_gait import Run, load_experiment, simulate, simulate_batch
from twin_gait.exceptions import JobError, ParameterError, TwinGaitError
from twin_gait.experiment.experiment import Engine, Experiment
from twin_gait.runs.summary import summarise_run
from twin_gait.simulation import code_cache, simulator
from twin_gait.simulation.block import ALIGNMENT, WIDTH, interleave
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, LaneEngine
from twin_gait.simulation.simulator import (
    FEWEST_IN_ALL,
    MOST_TICKS,
    group_into_blocks,
    precompile,
    simulate_blocks,
)
from twin_gait.studies.batch import (
    SUMMARY_COLUMNS,
    SUMMARY_LOG_COLUMNS,
    apply_override,
    attach_document,
    flat_summary,
)

EXTERNAL_TORQUES = ("_voluntary_torque_Nm", "_passive_torque_Nm", "_disturbance_torque_Nm")
JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
FALLING = {
    "scenario.support.share": 0.0,
    "scenario.support.lock_stiffness_N_per_m": 0.0,
    "table.phases.early_stance.knee.stiffness_Nm_per_deg": 0.01,
}


def unlike(count: int, seed: int, longest: float) -> list[dict[str, Any]]:
    """Patients, tables, durations, noise, falls, trips at random ticks; some of another structure."""
    rng = np.random.default_rng(seed)
    rows: list[dict[str, Any]] = []
    for number in range(count):
        duration = round(float(rng.uniform(0.1, longest)), 3)
        row: dict[str, Any] = {
            "duration_s": duration,
            "patient.mass_kg": float(rng.uniform(45, 100)),
            "patient.height_m": float(rng.uniform(1.55, 1.95)),
            "scenario.belt_speed_m_per_s": float(rng.uniform(0.3, 0.42)),
            "table.phases.early_stance.knee.stiffness_Nm_per_deg": float(rng.uniform(2, 8)),
            "sensors.ideal": False,
            "sensors.angle_noise_deg": 0.001,
            "seed": number,
        }
        if number % 5 == 1:
            tick = int(rng.integers(1, round(1e3 * duration)))
            row["faults"] = [f"encoder_missing:{JOINTS[number % 4]}@{1e-3 * tick:.3f}s"]
        if number % 5 == 2:
            row |= FALLING
        if number % 7 == 3:
            row = {"patient": "stroke_left", **row}
        if number % 11 == 5:
            row["control.mode"] = "gravity"
        rows.append(row)
    return rows


@pytest.fixture(scope="module")
def walk() -> Experiment:
    return load_experiment("treadmill_guided", ["integration.step_ms=0.5"]).experiment


@pytest.fixture(scope="module")
def bench() -> Experiment:
    return load_experiment("bench_leg", ["duration_s=0.1"]).experiment


def assert_same_run(ours: Run, theirs: Run) -> None:
    pd.testing.assert_frame_equal(ours.log, theirs.log, check_exact=True)
    assert (ours.switches, ours.status, ours.reason, ours.trip) == (
        theirs.switches,
        theirs.status,
        theirs.reason,
        theirs.trip,
    )
    assert (ours.experiment, ours.table, ours.body_weight) == (
        theirs.experiment,
        theirs.table,
        theirs.body_weight,
    )


# ------------------------------------------------------------------- cutting


KINDS = st.lists(st.tuples(st.sampled_from(["a", "b", None]), st.integers(1, 2 * MOST_TICKS)), max_size=300)


@given(episodes=KINDS)
def test_blocks_contain_every_episode_once_and_only_compatible_episodes(episodes):
    kinds, ticks = [kind for kind, _ in episodes], [length for _, length in episodes]
    blocks = group_into_blocks(kinds, ticks)
    assert sorted(index for block in blocks for index in block) == list(range(len(episodes)))
    for block in blocks:
        if len(block) > 1:
            assert MIN_BLOCK_SIZE <= len(block) <= WIDTH
            assert {kinds[index] for index in block} in ({"a"}, {"b"})
            assert len(block) * max(ticks[index] for index in block) <= MOST_TICKS


@pytest.mark.parametrize(("count", "sizes"), [(1, []), (7, []), (33, [32]), (1000, [*[32] * 31])])
def test_compatible_episodes_are_split_into_full_blocks_of_similar_duration(count, sizes):
    ticks = np.random.default_rng(count).integers(1, 5000, count).tolist()
    alike = [block for block in group_into_blocks(["x"] * count, ticks) if len(block) > 1]
    assert sorted(map(len, alike), reverse=True) == sizes
    spans = sorted(
        (min(ticks[index] for index in part), max(ticks[index] for index in part)) for part in alike
    )
    assert all(before[1] <= after[0] for before, after in pairwise(spans))


def test_blocks_do_not_depend_on_the_order_of_the_episodes():
    ticks = list(range(1, 101))
    order = np.random.default_rng(1).permutation(100)
    first = {frozenset(block) for block in group_into_blocks(["x"] * 100, ticks)}
    shuffled = group_into_blocks(["x"] * 100, [ticks[index] for index in order])
    assert {frozenset(int(order[index]) for index in block) for block in shuffled} == first


def test_blocks_are_used_for_many_episodes_whose_logs_fit(bench):
    assert precompile(bench, FEWEST_IN_ALL) == WIDTH
    assert precompile(bench, FEWEST_IN_ALL - 1) == 1
    assert precompile(replace(bench, engine=Engine.PINOCCHIO), 1000) == 1
    assert precompile(replace(bench, duration=100.0), 1000) == 20  # logs of 100 000 ticks


# ------------------------------------------------------------------- running


@pytest.mark.parametrize(
    ("count", "longest"),
    [(1, 2.0), (7, 0.5), pytest.param(33, 2.0, marks=pytest.mark.slow)],
)
def test_different_walks_in_a_block_equal_single_runs(walk, count, longest):
    base = attach_document(walk)
    experiments = [apply_override(base, row, "episode") for row in unlike(count, count, longest)]
    found = dict(simulate_blocks(experiments))
    assert sorted(found) == list(range(count))
    for index, run in found.items():
        assert_same_run(run, simulate(experiments[index]))
    outcomes = {str(run.status) for run in found.values()}, {run.trip is None for run in found.values()}
    assert count < 33 or outcomes == ({"completed", "fell"}, {True, False})


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "count"), [(1, 70), (2, 400)])
def test_short_episodes_in_any_order_equal_single_runs(walk, workers, count):
    rows = unlike(count, 5, 0.15)
    base = attach_document(walk)
    order = np.random.default_rng(workers).permutation(len(rows))
    table = simulate_batch(walk, [rows[index] for index in order], workers=workers)
    alone = pd.DataFrame(
        [flat_summary(simulate(apply_override(base, rows[index], "episode"))) for index in order]
    )
    for name in alone.columns:
        same = (table[name] == alone[name]) | (table[name].isna() & alone[name].isna())
        assert same.all(), name


def test_a_log_may_contain_only_the_columns_that_are_read(walk):
    short = replace(walk, duration=0.3)
    ((_, brief),) = simulate_blocks([short], columns=SUMMARY_LOG_COLUMNS)
    whole = simulate(short)
    # Ground forces and powers of a walk are read, too; gains, friction and targets are not.
    assert len(brief.log.columns) < 0.55 * len(whole.log.columns)
    pd.testing.assert_frame_equal(brief.log, whole.log[brief.log.columns], check_exact=True)
    assert flat_summary(brief) == flat_summary(whole)


@pytest.mark.parametrize("effort", [0.0, 0.1])
def test_a_log_leaves_out_torques_that_are_zero_throughout(walk, effort):
    condition = {"patient.left.knee.effort": effort} if effort else {}
    short = apply_override(attach_document(replace(walk, duration=2.5)), condition)
    ((_, brief),) = simulate_blocks([short], columns=SUMMARY_LOG_COLUMNS)
    whole = simulate(short)
    external = [name for name in whole.log if name.endswith(EXTERNAL_TORQUES)]
    omitted = [name for name in external if name not in brief.log]
    assert len(external) == 12 and len(omitted) == (4 if effort else 12)
    assert (whole.log[omitted] == 0.0).all(axis=None)
    assert whole.log["left_knee_voluntary_torque_Nm"].any() == bool(effort)
    assert flat_summary(brief) == flat_summary(whole)


@pytest.mark.parametrize("preset", ["treadmill_guided", "bench_leg"])
def test_a_row_holds_the_numbers_of_the_summary(preset):
    run = simulate(load_experiment(preset, ["duration_s=9"]).experiment)
    row, summary = flat_summary(run), summarise_run(run)
    expected = {name: summary.get(name) for name in SUMMARY_COLUMNS} | {"seed": run.experiment.seed}
    expected |= {f"power_{name}": value for name, value in summary.get("power", {}).items()}
    expected |= {f"trip_{name}": summary["safety"][name] for name in ("cause", "location", "time_s")}
    for side, values in summary["sides"].items():
        expected |= {f"{side}_{name}": value for name, value in values.get("walk", {}).items()}
        for joint, parts in values.get("errors", {}).items():
            expected |= {f"{side}_{joint}_error_{name}": value for name, value in parts.items()}
        expected |= {f"{side}_{name}": value for name, value in values.items()}
        for joint, effort in values["joints"].items():
            expected |= {f"{side}_{joint}_{name}": value for name, value in effort.items()}
    assert preset == "bench_leg" or row["left_hip_error_total_deg"] > 0.0 < row["power_motors_W"]
    assert row == {name: expected.get(name) for name in row}
    assert sum(value is not None for value in row.values()) > 20


def test_the_reference_engine_and_the_compiled_engine_run_in_one_batch(bench):
    experiments = [bench, replace(bench, duration=0.02, engine=Engine.PINOCCHIO)]
    found = dict(simulate_blocks(experiments, columns=SUMMARY_LOG_COLUMNS))
    names = found[1].log.columns
    pd.testing.assert_frame_equal(found[1].log, simulate(experiments[1]).log[names], check_exact=True)
    assert len(found[0].log) == 100


@pytest.mark.slow
@pytest.mark.compile
def test_a_loop_for_blocks_is_compiled_for_many_and_then_reused_for_few(bench, monkeypatch, tmp_path):
    monkeypatch.setenv("TWIN_GAIT_CACHE", str(tmp_path))
    monkeypatch.setattr(code_cache, "_loops", {})
    blocks: list[int] = []
    monkeypatch.setattr(
        simulator,
        "LaneEngine",
        lambda engines, **options: blocks.append(len(engines)) or LaneEngine(engines, **options),
    )
    for number in (20, FEWEST_IN_ALL, 20):
        assert len(dict(simulate_blocks([bench] * number))) == number
    assert blocks == [WIDTH, WIDTH, 20]


def test_logs_are_released_after_their_block(bench):
    before: list[weakref.ref[pd.DataFrame]] = []
    for _, run in simulate_blocks([bench] * MIN_BLOCK_SIZE):
        assert not [log for log in before if log() is not None]
        before.append(weakref.ref(run.log))
    assert len(before) == MIN_BLOCK_SIZE


def test_a_block_starts_at_a_cache_line() -> None:
    record = np.array([(1.5, 2)], dtype=[("angle", "f8"), ("phase", "i8")])
    blocks = [interleave([record] * size) for size in range(1, WIDTH + 1)]
    assert all(block.ctypes.data % ALIGNMENT == 0 for block in blocks)
    for block in blocks:
        np.testing.assert_array_equal(block, np.repeat(record.view(np.int64)[:, None], WIDTH, axis=1))


def test_a_failure_has_its_index(bench):
    broken = replace(bench, leg=replace(bench.leg, urdf="nowhere.urdf"))
    with raises(JobError, "job 2", "nowhere.urdf") as error:
        list(simulate_blocks([bench, bench, broken, bench]))
    assert error.value.index == 2 and isinstance(error.value.__cause__, TwinGaitError)


def test_an_error_in_building_an_experiment_has_its_index(bench):
    def experiments() -> Iterator[Experiment]:
        yield bench
        raise ParameterError("no such person")

    with raises(JobError, "job 1", "no such person"):
        list(simulate_blocks(experiments()))


def test_work_can_be_stopped_and_many_episodes_are_run_in_portions(bench, monkeypatch):
    monkeypatch.setattr(simulator, "FEWEST_IN_ALL", 1000)  # without compiling for them
    short = replace(bench, duration=0.01)
    assert sorted(index for index, _ in simulate_blocks([short] * 150)) == list(range(150))
    done: list[int] = []
    for index, _ in simulate_blocks([short] * 40):
        done.append(index)
        if len(done) == 3:
            break
    assert sorted(done) == [0, 1, 2]
