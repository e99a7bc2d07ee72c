"""Measurement of a case: time and accuracy of every implementation, and the goals of their ratios."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from peers.engines import THREADS, EngineSession
from peers.scenarios import RK4, Case, cases
from peers.timing import Implementation, Session, Timing, significant, speed_ratio, time_in_turn

from twin_gait.gait.table import TICK

REFINEMENT = 10  # refinement of the finest step for the reference angles
BATCH_SHARE = 4  # factor by which an episode of a batch is shorter
ROLLOUT = ("MuJoCo rollout", "batch")
# Smallest ratio of the time of a peer to the time of an engine of this package, for the cases in their order.
GOALS = {
    ("MuJoCo, bare", "compiled"): (9.0, 13.0, 8.0, 12.0, 15.0, 24.0),
    ROLLOUT: (25.0, 45.0, 18.0, 35.0, 55.0, 80.0),
    ("plain Python", "compiled"): (150.0,) * 6,
}
# With AVX2 a tick of the batch took 1.65 times as long as with AVX-512 (bench leg, Euler, 2026-11-23).
GOALS_AVX2 = {**GOALS, ROLLOUT: tuple(round(0.6 * goal) for goal in GOALS[ROLLOUT])}
SCALED_TICKS = 1000  # ticks of an episode in the scaling of the batch size
FURTHER_GOALS = (60.0, 60.0, 40.0, 60.0, 100.0, 120.0)  # for the batch
TIME, MEDIAN = "least time per tick [ns]", "median"
RATIO, ERROR = "times as long", "largest error [rad]"
GAIN = "compiled / batch"


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Extent of the measurement.

    Attributes:
        rounds: Number of counted rounds.
        evaluations: Evaluations of the dynamics in one run of native code.
        python_evaluations: Evaluations of the dynamics in one run of a loop in Python.
    """

    rounds: int = 15
    evaluations: int = 20_000
    python_evaluations: int = 2_000

    @classmethod
    def quick(cls) -> Extent:
        """Return the smallest extent that shows that the benchmark works."""
        return cls(rounds=2, evaluations=2_000, python_evaluations=100)

    def ticks(self, case: Case, item: Implementation) -> int:
        """Return the ticks of a run; for a single native episode at least those of the compared angles."""
        if not item.compiled:
            return max(1, self.python_evaluations // case.evaluations)
        if item.episodes > 1:
            return max(1, self.evaluations // BATCH_SHARE // case.evaluations)
        return max(case.compared_ticks, self.evaluations // case.evaluations)


def measure(case: Case, implementations: Sequence[Implementation], extent: Extent) -> dict[str, Any]:
    """Time all implementations of a case in turn, and compare their angles with a finer reference.

    Args:
        case: The case.
        implementations: Implementations, including the compiled engine and its batch.
        extent: Extent of the measurement.

    Returns:
        Scenario, step, rows of the table, and unrounded ratios.
    """
    lengths = {item.name: extent.ticks(case, item) for item in implementations}
    sessions = {item.name: item.open(case, lengths[item.name]) for item in implementations}
    work = {item.name: (sessions[item.name], lengths[item.name] * item.episodes) for item in implementations}
    times = time_in_turn(work, extent.rounds)
    reference = reference_angles(case)
    rows, ratios = [], {GAIN: speed_ratio(times["compiled"], times["batch"])}
    for item in implementations:
        angles = sessions[item.name].angles()
        if angles is not None and len(angles) < case.compared_ticks:
            longer = item.open(case, case.compared_ticks)
            longer.run()
            angles = longer.angles()
        ratios[item.name] = speed_ratio(times[item.name], times[item.beside])
        rows.append(_row(item.name, times[item.name], ratios[item.name], _error(angles, reference)))
    return {"scenario": case.scenario, "step": case.step, "rows": rows, "ratios": ratios}


def _row(name: str, timing: Timing, ratio: float, error: float | None) -> dict[str, Any]:
    return {
        "implementation": name,
        TIME: significant(timing.least),
        MEDIAN: significant(timing.median),
        "of processor": significant(min(timing.processor)),
        "times real time": significant(TICK / (timing.least * 1e-9)),
        RATIO: significant(ratio),
        ERROR: None if error is None else significant(error, 2),
    }


def reference_angles(case: Case) -> np.ndarray:
    """Return coordinates by RK4 at a tenth of the finest step, shape ``(compared_ticks, nv)``."""
    same = [item.integration for item in cases() if item.scenario == case.scenario]
    finest = min((item for item in same if item.method is RK4), key=lambda item: item.step)
    fine = replace(case.experiment, integration=replace(finest, step=finest.step / REFINEMENT))
    session = EngineSession(replace(case, experiment=fine), case.compared_ticks, compiled=True)
    session.run()
    angles = session.angles()
    assert angles is not None  # the session has a log
    return angles


def _error(angles: np.ndarray | None, reference: np.ndarray) -> float | None:
    """Return the largest difference of an angle in [rad] (of the height of a pelvis in [m])."""
    if angles is None:
        return None
    largest = float(np.abs(angles[: len(reference)] - reference).max())
    return largest if np.isfinite(largest) else None


def goal_rows(measured: Sequence[Mapping[str, Any]], vectors: str) -> list[dict[str, Any]]:
    """Compare the ratios of a benchmark with the goals; a goal is missed if its peer was not timed.

    Args:
        measured: Cases from :func:`measure`.
        vectors: Instruction set of the compiled code.
    """
    order = [(case.scenario, case.step) for case in cases()]
    rows = []
    for (peer, ours), bounds in (GOALS if vectors == "AVX-512" else GOALS_AVX2).items():
        for case in measured:
            least = bounds[order.index((case["scenario"], case["step"]))]
            ratio = case["ratios"].get(peer)
            rows.append(
                {
                    "scenario": case["scenario"],
                    "step": case["step"],
                    "what": f"{peer} / {ours}",
                    "measured": "not timed" if ratio is None else f"{ratio:.3g}",
                    "required": f"at least {least:g}",
                    "met": "yes" if ratio is not None and ratio >= least else "**no**",
                }
            )
    return rows


def batch_rows(measured: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the gain of a batch per core and per machine; ``measured``: cases from :func:`measure`."""
    rows = []
    for case, further in zip(measured, FURTHER_GOALS, strict=False):
        found = {name: f"{ratio:.3g}" for name, ratio in case["ratios"].items()}
        rows.append(
            {
                "scenario": case["scenario"],
                "step": case["step"],
                "rollout / batch, per core": found.get("MuJoCo rollout"),
                "further goal": f"{further:g}",
                "mujoco.batch / batch, per core": found.get("MuJoCo batch"),
                "rollout / batch, per machine": found.get("MuJoCo rollout, all cores"),
                GAIN: found[GAIN],
                "with energies / without": found.get("batch, energies"),
                "with log / without": found.get("batch, log"),
            }
        )
    return rows


def scaling_rows(
    case: Case, sessions: Mapping[str, Callable[..., Session]], sizes: Sequence[int], rounds: int
) -> list[dict[str, Any]]:
    """Measure the least time per tick and episode over the batch size, per core and per machine, in [ns].

    Args:
        case: Case that is simulated for one second.
        sessions: Constructors of a session for numbers of episodes and threads, by name.
        sizes: Numbers of episodes.
        rounds: Number of counted rounds.
    """
    rows = []
    for episodes in sizes:
        row: dict[str, Any] = {"episodes": episodes}
        entries = {
            f"{name}, {threads} thread{'s' * (threads > 1)} [ns]": (
                open_session(case, SCALED_TICKS, episodes=episodes, threads=threads),
                SCALED_TICKS * episodes,
            )
            for name, open_session in sessions.items()
            for threads in (1, THREADS)
        }
        rows.append(
            row | {name: significant(timing.least) for name, timing in time_in_turn(entries, rounds).items()}
        )
    return rows
