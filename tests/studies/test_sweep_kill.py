"""A sweep loses and repeats nothing, whoever dies: itself, its workers, or the terminal's patience."""

from __future__ import annotations

import os
import signal
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest
from sweep_process import kill_group, start_sweep, stored_episodes, wait_until, write_spec

from twin_gait.studies.sweep.spec import load_sweep
from twin_gait.studies.sweep.sweep import read_table, run_sweep

pytestmark = pytest.mark.slow

EPISODES = 1500  # in blocks, of which no kill sees the last


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    return write_spec(tmp_path_factory.mktemp("spec") / "many.yaml", samples=EPISODES)


@pytest.fixture(scope="module")
def undisturbed(spec, tmp_path_factory):
    out = tmp_path_factory.mktemp("sweeps") / "undisturbed"
    return run_sweep(load_sweep(spec), out, pictures=False).table


def parts_of(out):
    return len(list((out / "parts").glob("*.parquet")))


def parts_beyond(out, count):
    return parts_of(out) > count


def test_a_sweep_killed_ten_times_and_resumed_equals_an_uninterrupted_one(spec, undisturbed, tmp_path):
    out, moments = tmp_path / "sweep", np.random.default_rng(7)
    command = [spec, "--out", out, "--no-pictures"]
    kept: set[int] = set()
    for kill in range(10):
        before = parts_of(out)
        process = start_sweep(*command, "--workers", 2 if kill in (4, 7) else 1)
        if kill % 3:  # while it works, and now and then at any moment, starting up included
            wait_until(partial(parts_beyond, out, before + moments.integers(0, 3)))
        time.sleep(moments.uniform(0.0, 0.05) if kill % 3 else moments.uniform(0.0, 0.3))
        kill_group(process)
        assert process.exitcode == -signal.SIGKILL
        in_parts, in_table = stored_episodes(out) if out.exists() else ([], [])
        assert len(in_parts) == len(set(in_parts))  # nothing was run twice
        assert kept <= set(in_parts) | set(in_table)  # nothing was lost
        kept = set(in_parts) | set(in_table)
    assert 10 < len(kept) < EPISODES
    last = start_sweep(*command, "--workers", 1)
    last.join(120)
    assert last.exitcode == 0
    pd.testing.assert_frame_equal(read_table(out / "table.parquet"), undisturbed, check_exact=True)
    assert sorted(path.name for path in out.iterdir()) == [
        "spec.yaml",
        "summary.json",
        "table.parquet",
    ]


@pytest.mark.parametrize(("workers", "parts"), [(1, 3), (2, 0)], ids=["at work", "workers starting"])
def test_ctrl_c_keeps_finished_episodes_and_ends_with_130(workers, parts, spec, undisturbed, tmp_path):
    out = tmp_path / "sweep"
    command = [spec, "--out", out, "--no-pictures", "--workers", workers]
    process = start_sweep(*command, errors=tmp_path / "errors")
    wait_until(lambda: parts_of(out) > parts)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    process.join(60)
    assert process.exitcode == 130
    message = f"twin-gait: interrupted; the same command resumes the sweep in {out}\n"
    assert (tmp_path / "errors").read_text() == message
    table = read_table(out / "table.parquet")
    assert parts < len(table) < EPISODES
    first = undisturbed.iloc[: len(table)]
    pd.testing.assert_frame_equal(table, first, check_exact=True)


def test_workers_do_not_outlive_a_parent_that_is_killed(spec, tmp_path):
    out = tmp_path / "sweep"
    process = start_sweep(spec, "--out", out, "--workers", 2)
    wait_until(lambda: parts_of(out) > 2)  # the first is the parent's own
    os.kill(process.pid, signal.SIGKILL)
    process.join(30)
    wait_until(lambda: not has_members(process.pid), 30.0)


def has_members(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_two_processes_at_a_time_are_refused(spec, tmp_path):
    out = tmp_path / "sweep"
    process = start_sweep(spec, "--out", out, "--workers", 1)
    try:
        wait_until(lambda: parts_of(out) > 0)
        second = start_sweep(spec, "--out", out, "--workers", 1, errors=tmp_path / "errors")
        second.join(60)
        assert second.exitcode == 2
        message = f"twin-gait: {out}: another process is running this sweep\n"
        assert (tmp_path / "errors").read_text() == message
    finally:
        kill_group(process)
