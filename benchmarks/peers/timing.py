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
from llvmlite import binding
from peers.scenarios import Case

VECTORS = {"AVX-512": "+avx512f", "AVX2": "+avx2"}  # by LLVM's names, best first


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
        beside: Name of the implementation that its time is set in relation to.
        compiled: Whether the loop is native code; others get fewer ticks.
    """

    name: str
    open: Callable[[Case, int], Session]
    episodes: int = 1
    beside: str = "compiled"
    compiled: bool = True


@dataclass(frozen=True)
class Timing:
    """Times of one session for one unit of work in [ns], round by round.

    Attributes:
        clock: By the clock.
        processor: Processor time of all threads together.
    """

    clock: tuple[float, ...]
    processor: tuple[float, ...]

    @property
    def least(self) -> float:
        """Least time by the clock in [ns]: what the machine can do where nothing disturbs it."""
        return min(self.clock)

    @property
    def median(self) -> float:
        """Median by the clock in [ns]; the further above the least, the busier the machine."""
        return float(np.median(self.clock))


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
            clock, processor = _seconds(session)
            times[name].append((clock / work * 1e9, processor / work * 1e9))
    return {name: Timing(*zip(*values[1:], strict=True)) for name, values in times.items()}


def _seconds(session: Session) -> tuple[float, float]:
    """Time by the clock and processor time of a run in [s]."""
    gc.collect()
    gc.disable()
    try:
        began, used = time.perf_counter(), time.process_time()
        session.run()
        return time.perf_counter() - began, time.process_time() - used
    finally:
        gc.enable()


def speed_ratio(slower: Timing, faster: Timing) -> float:
    """How many times as long the first takes: its least time over the least of the other.

    The smaller one of two ratios, by the clock and by processor time. On a quiet machine they are equal.
    On a busy one a short run slips through undisturbed while a long one waits, which flatters whatever is
    fast; processor time alone would not see threads that wait for each other.
    """
    return min(slower.least / faster.least, min(slower.processor) / min(faster.processor))


def significant(value: float, digits: int = 3) -> float:
    """A number without digits that say nothing, for tables; a whole one from as many digits on."""
    rounded = float(f"{value:.{digits}g}")
    return round(value) if abs(value) >= 10 ** (digits - 1) else rounded


def abilities() -> str:
    """Abilities of the processor that numba compiles for: this one's, if it is not told others."""
    return os.environ.get("NUMBA_CPU_FEATURES", binding.get_host_cpu_features().flatten())


def instruction_set() -> str:
    """Vectors that the loops are compiled for."""
    features = abilities().split(",")
    return next((name for name, feature in VECTORS.items() if feature in features), "no AVX2")


def without_avx512() -> dict[str, str]:
    """Environment in which numba compiles for this processor as if it had no AVX-512."""
    features = abilities().replace("+avx512", "-avx512")
    return {**os.environ, "NUMBA_CPU_FEATURES": features}


def machine() -> dict[str, Any]:
    """Processor, instruction set, cores, load and versions, as plain values."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "instruction_set": instruction_set(),
        "cores": os.cpu_count(),
        "load average": round(os.getloadavg()[0], 2),
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("twin-gait", "numpy", "numba", "pin", "mujoco")},
        },
    }
