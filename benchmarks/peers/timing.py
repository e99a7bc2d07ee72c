"""Timing of sessions in turn, round after round, and description of the machine."""

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

VECTORS = {"AVX-512": "+avx512f", "AVX2": "+avx2"}  # feature of LLVM by name, best first


class Session(Protocol):
    """Session that repeats the same work, with all preparation done in advance."""

    def reset(self) -> None:
        """Return to the start; this is not timed."""

    def run(self) -> None:
        """Do the work; this is timed."""

    def angles(self) -> np.ndarray | None:
        """Return the coordinates at every tick of the last run, in the order of the leg model.

        The shape is ``(n_ticks, nv)``; None if the motion is not that of the closed loop or is not recorded.
        """


@dataclass(frozen=True)
class Implementation:
    """Implementation that can simulate a case.

    Attributes:
        name: Name in tables.
        open: Constructor of a session for a case and a number of ticks.
        episodes: Number of episodes that one run simulates at once.
        beside: Name of the implementation to which its time is related.
        compiled: Whether the loop is native code; a loop in Python has fewer ticks.
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
        clock: Wall-clock times.
        processor: Processor time of all threads together.
    """

    clock: tuple[float, ...]
    processor: tuple[float, ...]

    @property
    def least(self) -> float:
        """Least wall-clock time in [ns]: the time on an undisturbed machine."""
        return min(self.clock)

    @property
    def median(self) -> float:
        """Median of the wall-clock times in [ns]; the further above the least, the busier the machine."""
        return float(np.median(self.clock))


def time_in_turn(entries: Mapping[str, tuple[Session, int]], rounds: int) -> dict[str, Timing]:
    """Time all sessions once per round, so that a disturbance of the machine affects all of them alike.

    A first round warms up the caches and is not counted. The garbage collector is off during a run.

    Args:
        entries: Session and units of work of one run (ticks times episodes, or calls), by name.
        rounds: Number of counted rounds.

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
    """Return wall-clock time and processor time of a run in [s]."""
    gc.collect()
    gc.disable()
    try:
        began, used = time.perf_counter(), time.process_time()
        session.run()
        return time.perf_counter() - began, time.process_time() - used
    finally:
        gc.enable()


def speed_ratio(slower: Timing, faster: Timing) -> float:
    """Return the least time of the slower session over the least time of the faster one.

    The result is the smaller one of two ratios, of wall-clock times and of processor times. On a quiet
    machine they are equal. On a busy machine a short run may be undisturbed while a long run has to wait,
    which favours the faster session; processor time alone would not include threads that wait for each other.
    """
    return min(slower.least / faster.least, min(slower.processor) / min(faster.processor))


def significant(value: float, digits: int = 3) -> float:
    """Round a number to significant digits for tables; numbers with at least as many digits are integers."""
    rounded = float(f"{value:.{digits}g}")
    return round(value) if abs(value) >= 10 ** (digits - 1) else rounded


def abilities() -> str:
    """Return the features of the processor for which numba compiles: by default those of this one."""
    return os.environ.get("NUMBA_CPU_FEATURES", binding.get_host_cpu_features().flatten())


def instruction_set() -> str:
    """Return the name of the vector instructions of the compiled loops."""
    features = abilities().split(",")
    return next((name for name, feature in VECTORS.items() if feature in features), "no AVX2")


def without_avx512() -> dict[str, str]:
    """Return an environment in which numba compiles for this processor without AVX-512."""
    features = abilities().replace("+avx512", "-avx512")
    return {**os.environ, "NUMBA_CPU_FEATURES": features}


def machine() -> dict[str, Any]:
    """Return processor, instruction set, cores, load and versions as plain values."""
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
