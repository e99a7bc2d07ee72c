"""Sweeps in separate processes, which a test may kill."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path

import pyarrow.parquet as pq

from twin_gait.configuration.documents import dump_yaml

# Imports take seconds: a server imports the modules once and forks at every start.
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(
    ["twin_gait.cli.studies", "twin_gait.studies.sweep.sweep", "twin_gait.cli.program"]
)


def write_spec(path: Path, **entries: object) -> Path:
    """Write a sweep of short episodes with one stride on the bench and other entries; return its path."""
    spec = {
        "experiment": "bench_leg",
        "settings": {"duration_s": 2.0, "sensors.ideal": False, "sensors.angle_noise_rad": 1e-5},
        "method": "latin_hypercube",
        "samples": 12,
        "seed": 3,
        "parameters": {
            "scenario.start.hip_deg": {"from": 5, "to": 30},
            "table.phases.early_stance.knee.stiffness_Nm_per_deg": {"from": 0.1, "to": 10, "scale": "log"},
        },
    }
    spec |= entries
    path.write_text(dump_yaml({key: value for key, value in spec.items() if value is not None}))
    return path


def start_sweep(*arguments: object, errors: Path | None = None) -> BaseProcess:
    """Start ``twin-gait sweep`` in a new process group, with its standard error in a file."""
    process = _SERVER.Process(target=_sweep, args=([str(item) for item in arguments], errors))
    process.start()
    return process


def _sweep(arguments: list[str], errors: Path | None) -> None:
    os.setsid()
    if errors is not None:
        os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT), 2)
    from twin_gait.cli import main

    sys.exit(main(["sweep", *arguments]))


def kill_group(process: BaseProcess) -> None:
    """Kill a sweep with all its workers at once, as in a power failure."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:  # on a busy machine it may not have its own group yet
        process.kill()
    process.join(30)


def wait_until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait for a condition; fail after a number of seconds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "nothing happened in time"
        time.sleep(0.01)


def kept_episodes(out: Path) -> tuple[list[int], list[int]]:
    """Return the episodes in the parts, and in the table, of a sweep."""
    parts = sorted((out / "parts").glob("*.parquet"))
    in_parts = [episode for path in parts for episode in _episodes(path)]
    return in_parts, _episodes(out / "table.parquet") if (out / "table.parquet").is_file() else []


def _episodes(path: Path) -> list[int]:
    return pq.ParquetFile(path).read(["episode"])["episode"].to_pylist()
