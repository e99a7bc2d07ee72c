"""The ratios that the compiled engine is held to, and whether a benchmark meets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

# Subject and the contestants whose times are divided; every method and step of the subject counts.
BENCH_EULER, BENCH_RK4 = "Euler 1 ms", "RK4 1 ms"


@dataclass(frozen=True, kw_only=True)
class Goal:
    """A least ratio.

    Attributes:
        subject: Where it holds.
        stepping: Method and step, or None for all of the subject.
        peer: Contestant that may take so many times as long.
        ours: Contestant that is judged.
        least: The ratio.
    """

    subject: str
    peer: str
    ours: str
    least: float
    stepping: str | None = None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """A judged goal.

    Attributes:
        subject: Subject.
        stepping: Method and step.
        what: What was divided by what, or timed.
        figure: What was measured; None if it could not be.
        bound: What was asked for.
        unit: ``x``, where more is better, or ``s``, where less is.
        passed: Whether the figure keeps the bound.
    """

    subject: str
    stepping: str
    what: str
    figure: float | None
    bound: float
    unit: str
    passed: bool


GOALS = (
    Goal(subject="bench_leg", stepping=BENCH_EULER, peer="mujoco_bare", ours="compiled", least=12.0),
    Goal(subject="bench_leg", stepping=BENCH_RK4, peer="mujoco_bare", ours="compiled", least=15.0),
    Goal(subject="contact_free_biped", peer="mujoco_bare", ours="compiled", least=8.0),
    Goal(subject="treadmill", peer="mujoco_bare", ours="compiled", least=8.0),
    *(
        Goal(subject=subject, peer=peer, ours=ours, least=least)
        for subject in ("bench_leg", "contact_free_biped", "treadmill")
        for peer, ours, least in (
            ("plain_python", "compiled", 150.0),
            ("mujoco_rollout", "batch", 15.0),
        )
    ),
)
# Twenty seconds on the treadmill as the preset runs them, with their log.
WALK_SUBJECT, WALK_LIMIT = "treadmill", 0.4  # [s]


def judge(document: Mapping[str, Any]) -> list[Verdict]:
    """Hold a benchmark to all ratios of its subjects.

    Args:
        document: From :func:`twin_gait.studies.benchmark.benchmark.benchmark`.

    Returns:
        A verdict per goal and stepping; a goal whose peer was not timed has failed.
    """
    verdicts = []
    for goal in GOALS:
        for case in document["cases"]:
            if case["subject"] == goal.subject and goal.stepping in (None, case["stepping"]):
                verdicts.append(_judge_ratio(goal, case))
    walk = document.get("walk")
    if walk is not None:
        verdicts.append(_judge_walk(walk))
    return verdicts


def _judge_ratio(goal: Goal, case: Mapping[str, Any]) -> Verdict:
    rows = {row["contestant"]: row for row in case["rows"]}
    figure = None
    if goal.peer in rows and goal.ours in rows:
        figure = rows[goal.peer]["ratio_to"].get(goal.ours)
    return Verdict(
        subject=goal.subject,
        stepping=case["stepping"],
        what=f"{goal.peer} / {goal.ours}",
        figure=figure,
        bound=goal.least,
        unit="x",
        passed=figure is not None and figure >= goal.least,
    )


def _judge_walk(walk: Mapping[str, Any]) -> Verdict:
    return Verdict(
        subject=WALK_SUBJECT,
        stepping=walk["stepping"],
        what=f"{walk['duration_s']:g} s of simulate(), with log",
        figure=walk["wall_s"],
        bound=WALK_LIMIT,
        unit="s",
        passed=walk["wall_s"] < WALK_LIMIT,
    )


def all_met(verdicts: Sequence[Verdict]) -> bool:
    """Whether every goal is met, and there is one."""
    return bool(verdicts) and all(verdict.passed for verdict in verdicts)


def verdict_rows(verdicts: Sequence[Verdict]) -> list[dict[str, Any]]:
    """Verdicts as mappings for JSON."""
    return [asdict(verdict) for verdict in verdicts]
