"""Time sessions in turn, round after round, and say on what machine."""

from __future__ import annotations

import gc
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.runs.summary.summary import versions
from twin_gait.studies.benchmark.contestant import Session

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Timing:
    """Times of one contestant.

    Attributes:
        rounds: Wall-clock time of every round for one unit of work in [ns].
        processor: Processor time over wall-clock time of every round: 1 for one thread that nothing
            disturbs.
    """

    rounds: tuple[float, ...]
    processor: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median in [ns]."""
        return float(np.median(self.rounds))

    @property
    def quartiles(self) -> tuple[float, float]:
        """First and third quartile in [ns]."""
        low, high = np.percentile(self.rounds, (25.0, 75.0))
        return float(low), float(high)

    @property
    def processor_median(self) -> float:
        """Median of the processor time in [ns]: of all threads together, and without what disturbed them."""
        return float(np.median(np.array(self.rounds) * np.array(self.processor)))


@dataclass(frozen=True)
class Entry:
    """A session to be timed.

    Attributes:
        name: Of the contestant.
        session: Set up.
        work: Units that one run does: ticks times episodes, or calls.
    """

    name: str
    session: Session
    work: int


def time_in_turn(
    entries: Sequence[Entry], rounds: int, on_run: Callable[[], None] | None = None
) -> dict[str, Timing]:
    """Time all entries once a round, so that a disturbance of the machine meets all of them alike.

    A first round warms caches up and counts for nothing. The collector of garbage is held during a run.

    Args:
        entries: With different names.
        rounds: How many count.
        on_run: Called after every run.

    Returns:
        Times by name.
    """
    times: dict[str, list[tuple[float, float]]] = {entry.name: [] for entry in entries}
    for _ in range(rounds + 1):
        for entry in entries:
            entry.session.reset()
            wall, processor = _seconds(entry.session)
            times[entry.name].append((wall / entry.work * 1e9, processor / wall))
            if on_run is not None:
                on_run()
    return {name: Timing(*zip(*values[1:], strict=True)) for name, values in times.items()}


def _seconds(session: Session) -> tuple[float, float]:
    """Wall-clock and processor time of a run in [s]."""
    gc.collect()
    gc.disable()
    try:
        began, used = time.perf_counter(), time.process_time()
        session.run()
        return time.perf_counter() - began, time.process_time() - used
    finally:
        gc.enable()


def speed_ratio(slower: Timing, faster: Timing) -> float:
    """How many times as long the first takes: median over the rounds, each with its own pair.

    The smaller one of two ratios, by the clock and by processor time. On a quiet machine they are equal.
    On a busy one a short run slips through undisturbed while a long one waits, which flatters whatever is
    fast; processor time alone would not see threads that wait for each other.

    Args:
        slower: Of the peer.
        faster: Of the one that is judged, from the same rounds.

    Returns:
        The ratio.
    """
    clock = np.array(slower.rounds) / np.array(faster.rounds)
    processor = clock * np.array(slower.processor) / np.array(faster.processor)
    return float(min(np.median(clock), np.median(processor)))


def machine() -> dict[str, Any]:
    """Processor, cores, load and versions.

    Returns:
        Plain values.
    """
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load_average": [round(item, 2) for item in os.getloadavg()],
        "system": platform.platform(),
        "versions": {**versions(), **_mujoco_version()},
    }


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _mujoco_version() -> Mapping[str, str]:
    try:
        return {"mujoco": metadata.version("mujoco")}
    except metadata.PackageNotFoundError:
        return {}
