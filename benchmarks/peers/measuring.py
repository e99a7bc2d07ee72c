"""Measure a case: time and accuracy of every implementation, and the ratios that are asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from peers.engines import EngineSession, SimulateSession
from peers.scenarios import RK4, Case, cases
from peers.timing import Implementation, Timing, significant, speed_ratio, time_in_turn

from twin_gait.gait import TICK

REFINEMENT = 10  # of the finest step, for the reference of the angles
# Peer, ours, scenario, step (None: all), and how many times as long the peer is to take at least.
GOALS = (
    ("MuJoCo, bare", "compiled", "bench_leg", "Euler 1 ms", 12.0),
    ("MuJoCo, bare", "compiled", "bench_leg", "RK4 1 ms", 15.0),
    ("MuJoCo, bare", "compiled", "contact_free_biped", None, 8.0),
    ("MuJoCo, bare", "compiled", "treadmill", None, 8.0),
    *(
        (peer, ours, scenario, None, least)
        for scenario in ("bench_leg", "contact_free_biped", "treadmill")
        for peer, ours, least in (("plain Python", "compiled", 150.0), ("MuJoCo rollout", "batch", 15.0))
    ),
)
WALK_LIMIT = 0.4  # [s] for twenty seconds on the treadmill as the preset runs them, with their log
TIME, LOW, HIGH = "time per tick [ns]", "1st quartile", "3rd quartile"
RATIO, ERROR = "times as long", "largest error [rad]"


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How much is measured.

    Attributes:
        rounds: Rounds that count.
        evaluations: Of the dynamics in one run of native code.
        python_evaluations: Likewise of what steps through Python.
        walk_ticks: Length of the walk that is timed as a whole.
    """

    rounds: int = 15
    evaluations: int = 20_000
    python_evaluations: int = 2_000
    walk_ticks: int = 20_000

    @classmethod
    def quick(cls) -> Extent:
        """As little as shows that it works."""
        return cls(rounds=2, evaluations=2_000, python_evaluations=100, walk_ticks=2_000)

    def ticks(self, case: Case, item: Implementation) -> int:
        """Length of a run of an implementation; of native code at least what its angles are compared over.

        Episodes of a batch are no shorter than a single one: people run them for seconds.
        """
        if not item.compiled:
            return max(1, self.python_evaluations // case.evaluations)
        return max(case.compared_ticks, self.evaluations // case.evaluations)


def measure(case: Case, implementations: Sequence[Implementation], extent: Extent) -> dict[str, Any]:
    """Time all implementations of a case in turn, and compare their angles with a finer reference.

    Args:
        case: The case.
        implementations: With the compiled engine and its batch, which the others are set in relation to.
        extent: How much is measured.

    Returns:
        Scenario, step, rows of the table, and the ratios without rounding.
    """
    lengths = {item.name: extent.ticks(case, item) for item in implementations}
    sessions = {item.name: item.open(case, lengths[item.name]) for item in implementations}
    work = {item.name: (sessions[item.name], lengths[item.name] * item.episodes) for item in implementations}
    times = time_in_turn(work, extent.rounds)
    reference = reference_angles(case)
    rows, ratios = [], {}
    for item in implementations:
        angles = sessions[item.name].angles()
        if angles is not None and len(angles) < case.compared_ticks:
            longer = item.open(case, case.compared_ticks)
            longer.run()
            angles = longer.angles()
        ratios[item.name] = speed_ratio(times[item.name], times["batch" if item.episodes > 1 else "compiled"])
        rows.append(_row(item.name, times[item.name], ratios[item.name], _error(angles, reference)))
    return {"scenario": case.scenario, "step": case.step, "rows": rows, "ratios": ratios}


def _row(name: str, timing: Timing, ratio: float, error: float | None) -> dict[str, Any]:
    low, high = timing.quartiles
    return {
        "implementation": name,
        TIME: significant(timing.median),
        LOW: significant(low),
        HIGH: significant(high),
        "of processor": significant(timing.processor_median),
        "times real time": significant(TICK / (timing.median * 1e-9)),
        RATIO: significant(ratio),
        ERROR: None if error is None else significant(error, 2),
    }


def reference_angles(case: Case) -> np.ndarray:
    """Coordinates by Runge-Kutta at a tenth of the finest step of the scenario: ``(compared_ticks, nv)``."""
    same = [item.integration for item in cases() if item.scenario == case.scenario]
    finest = min((item for item in same if item.method is RK4), key=lambda item: item.step)
    fine = replace(case.experiment, integration=replace(finest, step=finest.step / REFINEMENT))
    session = EngineSession(replace(case, experiment=fine), case.compared_ticks, compiled=True)
    session.run()
    angles = session.angles()
    assert angles is not None  # it records
    return angles


def _error(angles: np.ndarray | None, reference: np.ndarray) -> float | None:
    """Largest difference of an angle in [rad] (the height of a pelvis in [m])."""
    if angles is None:
        return None
    largest = float(np.abs(angles[: len(reference)] - reference).max())
    return largest if np.isfinite(largest) else None


def time_walk(extent: Extent) -> dict[str, Any]:
    """Time the preset of the treadmill as ``twin-gait simulate`` runs it."""
    case = cases()[-1]
    session = SimulateSession(case, extent.walk_ticks)
    timing = time_in_turn({"walk": (session, 1)}, extent.rounds)["walk"]
    run = session.last
    assert run is not None  # it has just run
    return {
        "step": case.step,
        "duration_s": run.duration,
        "status": str(run.status),
        "simulate_s": significant(timing.median * 1e-9),
        "loop_s": significant(run.wall_s),
    }


def goal_rows(measured: Sequence[Mapping[str, Any]], walk: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Hold a benchmark to all ratios of its cases; one whose peer was not timed is missed."""
    rows = []
    for peer, ours, scenario, step, least in GOALS:
        for case in measured:
            if case["scenario"] == scenario and step in (None, case["step"]):
                ratio = case["ratios"].get(peer)
                what, found = f"{peer} / {ours}", "not timed" if ratio is None else f"{ratio:.3g}"
                met = ratio is not None and ratio >= least
                rows.append(_goal(scenario, case["step"], what, found, f"at least {least:g}", met))
    wall, duration = walk["simulate_s"], walk["duration_s"]
    what = f"{duration:g} s of simulate(), with log"
    found, limit = f"{wall:.3g} s", f"below {WALK_LIMIT:g} s"
    return [*rows, _goal("treadmill", walk["step"], what, found, limit, wall < WALK_LIMIT)]


def _goal(scenario: str, step: str, what: str, found: str, bound: str, met: bool) -> dict[str, Any]:
    return {
        "scenario": scenario,
        "step": step,
        "what": what,
        "measured": found,
        "asked for": bound,
        "met": "yes" if met else "**no**",
    }


def batch_gains(measured: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """How many times as fast a batch on threads is as one episode without its log: least and most."""
    gains = []
    for case in measured:
        times = {row["implementation"]: row[TIME] for row in case["rows"]}
        gains.append(times["compiled"] / times["batch"])
    return {"least": min(gains), "most": max(gains)}
