"""One table, whoever computes it: any length, order and workers, and a cluster that loses a worker."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from errors import states
from sweep_process import start_sweep, wait_until, write_spec

from twin_gait.cli import main
from twin_gait.studies.batch import Override, simulate_batch
from twin_gait.studies.sweep.spec import load_sweep
from twin_gait.studies.sweep.sweep import read_table

pytestmark = [pytest.mark.slow, pytest.mark.cluster]

MANY = 1000
SETTING = "scenario.start.hip_deg"


def episodes() -> list[dict[str, Any]]:
    """Starts and seeds by number: what an episode is does not depend on how many there are."""
    rng = np.random.default_rng(1)
    return [{SETTING: float(angle), "seed": number} for number, angle in enumerate(rng.uniform(5, 30, MANY))]


@pytest.fixture(scope="module")
def spec(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("many") / "many.yaml"
    return write_spec(path, method="list", samples=None, parameters=None, seed=0, episodes=episodes())


def batch(spec: Path, overrides: list[Override], workers: int) -> pd.DataFrame:
    return simulate_batch(load_sweep(spec).experiment, overrides, workers=workers)


@pytest.fixture(scope="module")
def alone(spec) -> pd.DataFrame:
    """All thousand in this process, one after the other."""
    table = batch(spec, episodes(), 1)
    assert table["battery_power_mean_W"].nunique() == MANY
    return table


def assert_same(ours: pd.DataFrame, theirs: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(ours.astype(theirs.dtypes), theirs, check_exact=True)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("length", [1, 7, 32])
def test_short_batches_are_the_beginning_of_a_long_one(spec, alone, length, workers):
    assert_same(batch(spec, episodes()[:length], workers), alone.head(length))


def test_the_order_of_episodes_does_not_matter(spec, alone):
    order = np.random.default_rng(2).permutation(MANY)[:32]
    chosen = [episodes()[number] for number in order]
    found = batch(spec, chosen, 2).drop(columns="episode")
    assert_same(found, alone.iloc[order].drop(columns="episode").reset_index(drop=True))


def test_a_thousand_on_two_workers_are_the_same(spec, alone, tmp_path):
    out = tmp_path / "out"
    assert main(["sweep", str(spec), "--out", str(out), "--workers", "2", "--no-pictures"]) == 0
    assert_same(read_table(out / "table.parquet"), alone)


class Cluster:
    """A scheduler and workers on the loopback, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "scheduler.json"
        self.processes = [self._start("scheduler", "--port", "0")]
        wait_until(self.file.is_file)
        self.address = json.loads(self.file.read_text())["address"]

    def add_worker(self) -> subprocess.Popen[bytes]:
        local = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder))
        self.processes.append(self._start("worker", *local))
        return self.processes[-1]

    def _start(self, role: str, *options: str) -> subprocess.Popen[bytes]:
        common = ("--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(self.file))
        command = [sys.executable, "-m", "dask", role, *common, *options]
        with (self.folder / f"{role}.log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder)

    def stop(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait(30)


@pytest.fixture
def cluster(tmp_path) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    made = Cluster(tmp_path)
    try:
        yield made
    finally:
        made.stop()


def test_a_thousand_on_a_cluster_that_loses_a_worker_half_way_are_the_same(spec, alone, cluster, tmp_path):
    out = tmp_path / "out"
    victim, _ = cluster.add_worker(), cluster.add_worker()
    process = start_sweep(spec, "--out", out, "--scheduler", cluster.address, "--no-pictures")
    wait_until(lambda: rows_kept(out) >= MANY // 2, 180.0)
    victim.send_signal(signal.SIGKILL)
    process.join(180)
    assert process.exitcode == 0
    assert json.loads((out / "summary.json").read_text())["last_call"]["resumed_with"] == 0
    assert_same(read_table(out / "table.parquet"), alone)


def rows_kept(out: Path) -> int:
    """Episodes in the parts, by their names; chunks of a fresh sweep have no gaps."""
    bounds = [path.stem.split("-") for path in (out / "parts").glob("*.parquet")]
    return sum(int(last) - int(first) + 1 for first, last in bounds)


def test_a_lost_scheduler_is_one_line_and_finished_episodes_are_kept(spec, alone, cluster, tmp_path):
    out = tmp_path / "out"
    cluster.add_worker()
    options = ["--out", out, "--no-pictures"]
    errors = tmp_path / "errors"
    process = start_sweep(spec, *options, "--scheduler", cluster.address, errors=errors)
    wait_until(lambda: rows_kept(out) >= 5)
    os.kill(cluster.processes[0].pid, signal.SIGKILL)
    process.join(60)
    assert process.exitcode == 1
    (line,) = errors.read_text().splitlines()
    assert "the cluster has stopped" in line and "finished episodes have been written" in line
    table = read_table(out / "table.parquet")
    assert 5 <= len(table) < MANY
    assert_same(table, alone.iloc[table["episode"]].reset_index(drop=True))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere"])
def test_a_scheduler_that_is_not_there_is_one_line(spec, address, tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    monkeypatch.setattr("twin_gait.studies.workers.CONNECTION_TIMEOUT", 0.5)
    assert main(["sweep", str(spec), "--out", str(tmp_path / "out"), "--scheduler", address]) == 2
    error = capsys.readouterr().err
    assert states(error, f"--scheduler {address}") and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_without_dask_the_extra_is_named(spec, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["sweep", str(spec), "--out", str(tmp_path / "out"), "--scheduler", "tcp://h:1"]) == 2
    error = capsys.readouterr().err
    assert "pip install 'twin-gait[cluster]'" in error and error.count("\n") == 1
