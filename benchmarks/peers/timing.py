"""Time sessions in turn, round after round, and say on what machine."""

from __future__ import annotations

import gc
import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from peers.scenarios import Case


class Session(Protocol):
    """Something that does the same work again and again; all that may be done beforehand is done."""

    def reset(self) -> None:
        """Go back to the start; not timed."""

    def run(self) -> None:
        """Do the work; this is timed."""

    def angles(self) -> np.ndarray | None:
        """Coordinates at every tick of the last run, shape ``(n_ticks, nv)`` in the order of the leg model.

        None if the session steps another motion than the closed loop or keeps no record.
        """


@dataclass(frozen=True)
class Implementation:
    """One way to step through a case.

    Attributes:
        name: In tables.
        open: Sets it up for a case and a number of ticks.
        episodes: Episodes that one run steps at once.
        compiled: Whether the loop is native code; others get fewer ticks.
    """

    name: str
    open: Callable[[Case, int], Session]
    episodes: int = 1
    compiled: bool = True


@dataclass(frozen=True)
class Timing:
    """Times of one session.

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


def time_in_turn(entries: Mapping[str, tuple[Session, int]], rounds: int) -> dict[str, Timing]:
    """Time all sessions once a round, so that a disturbance of the machine meets all of them alike.

    A first round warms caches up and counts for nothing. The collector of garbage is held during a run.

    Args:
        entries: By name, a session and the units of work of one run: ticks times episodes, or calls.
        rounds: How many count.

    Returns:
        Times by name.
    """
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in entries}
    for _ in range(rounds + 1):
        for name, (session, work) in entries.items():
            session.reset()
            wall, processor = _seconds(session)
            times[name].append((wall / work * 1e9, processor / wall))
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
    """
    clock = np.array(slower.rounds) / np.array(faster.rounds)
    processor = clock * np.array(slower.processor) / np.array(faster.processor)
    return float(min(np.median(clock), np.median(processor)))


def significant(value: float, digits: int = 3) -> float:
    """A number without digits that say nothing, for tables; a whole one from as many digits on."""
    rounded = float(f"{value:.{digits}g}")
    return round(value) if abs(value) >= 10 ** (digits - 1) else rounded


def machine() -> dict[str, Any]:
    """Processor, cores, load and versions, as plain values."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load average": round(os.getloadavg()[0], 2),
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("twin-gait", "numpy", "numba", "pin", "mujoco")},
        },
    }
