"""What a tuning came to, as one mapping of plain values: the content of ``tune.json``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from twin_gait import __version__
from twin_gait.checking.check import build_case, check, counts
from twin_gait.checking.finding import Finding, Severity
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.gait_table_file import gait_table_from_mapping
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Experiment
from twin_gait.measures.reference import KILOMETRES_PER_HOUR, reference_curve
from twin_gait.measures.strides import PERCENT, normalise_strides
from twin_gait.simulation import Run, simulate
from twin_gait.studies.jobs import Workers
from twin_gait.studies.tune.cases import check_walker, departures
from twin_gait.studies.tune.parts import AIM, HELD_TO, NEEDED_CLEARANCE, PARTS, WORST, part_costs
from twin_gait.studies.tune.search import better_half
from twin_gait.studies.tune.settings import Settings
from twin_gait.studies.tune.space import Parameter
from twin_gait.studies.tune.tuning import Finalist, Tuning, best_so_far
from twin_gait.studies.tune.walks import Ask, WalkResult, experiment_of, walk_all
from twin_gait.vocabulary import MOTOR_JOINTS

OUTCOME_VERSION = 1
# A part that changes by less than this share of its goal counts as unchanged.
SAME = 0.05


class Chosen(NamedTuple):
    """The table that is written.

    Attributes:
        finalist: It.
        findings: Of the whole check.
        refused: Finalists before it that the check found errors in.
    """

    finalist: Finalist
    findings: tuple[Finding, ...]
    refused: int


def choose(tuning: Tuning, experiment: Experiment) -> Chosen:
    """Take the best finalist whose table passes every error rule of the check.

    Args:
        tuning: Completed.
        experiment: What it was tuned for.

    Returns:
        The table with what the check says.

    Raises:
        ParameterError: If none passes, not even the table that the search began with.
    """
    for refused, finalist in enumerate(tuning.ranked):
        driven = experiment_of(experiment_document(experiment), finalist.table, {})
        findings = check(build_case(driven.table, driven))
        if not any(item.severity is Severity.ERROR for item in findings):
            return Chosen(finalist, tuple(findings), refused)
    raise ParameterError(
        f"table {experiment.table.name}: no candidate passes twin-gait check, nor does the table itself; "
        "mend its errors first"
    )


def final_table(chosen: Chosen, experiment: Experiment, wearer: str, began_with: str) -> dict[str, Any]:
    """Document of the table, with a name and a description of its own.

    Args:
        chosen: The table.
        experiment: What it was tuned for.
        wearer: For whom, in words.
        began_with: Name of the table that the search began with.

    Returns:
        The mapping, which every command takes.
    """
    start = experiment.table.name
    origin = (
        f"The table {start} as it was: the search found nothing better for {wearer}."
        if chosen.finalist.points is None
        else f"Tuned by twin-gait tune from the table {began_with} for {wearer}. Found in simulation; "
        "nothing here was measured on a person."
    )
    document = {**chosen.finalist.table, "name": f"{start}_tuned", "description": origin}
    gait_table_from_mapping(document, "the tuned table", start)
    return document


def outcome(
    tuning: Tuning,
    chosen: Chosen,
    experiment: Experiment,
    settings: Settings,
    wearer: str,
    departed: Mapping[str, Any],
) -> dict[str, Any]:
    """Everything that came out, ready for JSON.

    Args:
        tuning: Completed.
        chosen: The table.
        experiment: What it was tuned for.
        settings: How.
        wearer: For whom, in words.
        departed: From :func:`walk_departures`.

    Returns:
        Plain values.
    """
    before = tuning.before
    assert before is not None and tuning.state.start_cost is not None  # a completed tuning has both
    after = chosen.finalist
    curve = best_so_far(tuning.state.start_cost, tuning.state.generations)
    return {
        "schema_version": OUTCOME_VERSION,
        "version": __version__,
        "experiment": experiment.name,
        "wearer": wearer,
        "belt_speed_m_per_s": check_walker(experiment)[0].belt_speed,
        "reference": _reference_words(settings, experiment),
        "table_before": experiment.table.name,
        "began_with": tuning.began_with,
        "found_better": after.points is not None,
        "parts": _parts(before.walks[0][1], after.walks[0][1]),
        "walk_s": settings.robust_duration,
        "needed_clearance_mm": NEEDED_CLEARANCE,
        "worst_cost": WORST,
        "excess": {"aim": AIM, "weight": HELD_TO},
        "cost": {
            "search": {"before": tuning.state.start_cost, "after": after.search_cost},
            "robust": {"before": before.cost, "after": after.cost},
        },
        "robust_set": _robust(before, after),
        "departures": dict(departed),
        "parameters": _parameters(tuning, after),
        "screening": [asdict(effect) for effect in tuning.effects],
        "convergence": {
            "best": curve.tolist(),
            "median": [_median_of_leaders(item.costs) for item in tuning.state.generations],
        },
        "check": {**counts(chosen.findings), "refused_before_it": chosen.refused},
        "effort": _effort(tuning, settings),
    }


def walk_departures(
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    experiment: Experiment,
    settings: Settings,
    workers: Workers,
    *,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> dict[str, Any] | None:
    """How two tables degrade as the world departs from what one of them was tuned for.

    Args:
        before: Document of the one.
        after: Document of the other.
        experiment: What it was tuned for.
        settings: How.
        workers: Who walks.
        progress: Called with walks done and in all.
        should_stop: Asked before each walk.

    Returns:
        By quantity: its nominal value, the values, and of both tables the errors of hip and knee in [deg],
        None where it fell or hardly walked, and the falls. None if it was stopped.
    """
    found = departures(experiment)
    asks = [Ask(table, case) for item in found for table in (before, after) for case in item.cases]
    document = {
        **experiment_document(experiment),
        "seed": settings.seed,
        "table": None,
        "duration_s": settings.robust_duration,
    }
    results = walk_all(
        asks,
        document,
        workers,
        reference_speed=settings.reference_speed,
        progress=progress,
        should_stop=should_stop,
    )
    if results is None:
        return None
    rest = iter(results)
    table: dict[str, Any] = {}
    for item in found:
        sides = {which: [next(rest) for _ in item.cases] for which in ("before", "after")}
        table[item.name] = {
            "nominal": item.nominal,
            "values": list(item.values),
            **{which: _degradation(walks) for which, walks in sides.items()},
        }
    return table


def gait_curves(
    before: Mapping[str, Any], after: Mapping[str, Any], experiment: Experiment, settings: Settings
) -> dict[str, dict[str, np.ndarray]]:
    """Mean cycles of both legs before and after, and the reference.

    Args:
        before: Document of the table that the search began with.
        after: Document of the tuned one.
        experiment: What it was tuned for.
        settings: How.

    Returns:
        By joint: ``reference``, and those of each side such as ``before left``, in [deg] at ``PERCENT``;
        a walk without a counted stride has no curve.
    """
    scenario, patient = check_walker(experiment)
    speed = settings.reference_speed or scenario.belt_speed
    curves: dict[str, dict[str, np.ndarray]] = {
        str(joint): {
            "reference": np.degrees(reference_curve(joint, PERCENT, speed=speed, height=patient.height))
        }
        for joint in MOTOR_JOINTS
    }
    document = {**experiment_document(experiment), "seed": settings.seed}
    for name, table in (("before", before), ("after", after)):
        walked = replace(experiment_of(document, table, {}), duration=settings.robust_duration)
        _add_cycles(curves, name, simulate(walked))
    return curves


def _add_cycles(curves: dict[str, dict[str, np.ndarray]], name: str, run: Run) -> None:
    for side in run.sides:
        record = run.leg_record(side)
        for joint in MOTOR_JOINTS:
            cycles = normalise_strides(record.angles[joint], record.strides())
            if len(cycles):
                curves[str(joint)][f"{name} {side}"] = np.degrees(cycles.mean(axis=0))


def _reference_words(settings: Settings, experiment: Experiment) -> str:
    speed = settings.reference_speed or check_walker(experiment)[0].belt_speed
    return (
        f"Koopman et al. (2014) at {speed * KILOMETRES_PER_HOUR:.3g} km/h, from foot contact to foot contact"
    )


def _parts(before: WalkResult, after: WalkResult) -> list[dict[str, Any]]:
    """Named parts side by side, each with what became of it."""
    costs = {"before": part_costs(before.values), "after": part_costs(after.values)}
    rows = []
    for part in PARTS:
        first, second = before.values[part.name], after.values[part.name]
        rows.append(
            {
                **asdict(part),
                "before": first,
                "after": second,
                "cost_before": costs["before"][part.name],
                "cost_after": costs["after"][part.name],
                "verdict": verdict(first, second, part.goal),
            }
        )
    return rows


def verdict(before: float | None, after: float | None, goal: float) -> str:
    """What became of a part: ``better``, ``traded`` (worse), ``same`` or ``not defined``.

    Args:
        before: Value before.
        after: Value after; the smaller the better.
        goal: Its goal; changes below ``SAME`` of it do not count.

    Returns:
        One of these words.
    """
    if before is None or after is None:
        return "not defined"
    if math.isclose(before, after, rel_tol=0.0, abs_tol=SAME * goal):
        return "same"
    return "better" if after < before else "traded"


def _robust(before: Finalist, after: Finalist) -> list[dict[str, Any]]:
    rows = []
    for (name, first), (_, second) in zip(before.walks, after.walks, strict=True):
        rows.append({"case": name, "before": _walk(first), "after": _walk(second)})
    return rows


def _walk(walk: WalkResult) -> dict[str, Any]:
    return {"cost": walk.cost, "fell": walk.fell, "lasted_share": walk.lasted, **walk.values}


def _degradation(walks: Sequence[WalkResult]) -> dict[str, list[Any]]:
    def of(name: str) -> list[float | None]:
        return [None if walk.fell else walk.values[name] for walk in walks]

    return {
        "hip_error_deg": of("hip_error_deg"),
        "knee_error_deg": of("knee_error_deg"),
        "fell": [walk.fell for walk in walks],
    }


def _median_of_leaders(costs: Sequence[float]) -> float:
    """Median of those that have walked all cases; the others' costs only say that they are worse."""
    return float(np.median([costs[place] for place in better_half(costs)]))


def _parameters(tuning: Tuning, chosen: Finalist) -> list[dict[str, Any]]:
    searched = {item.name: place for place, item in enumerate(tuning.searched)}
    return [_parameter(item, searched.get(item.name), chosen) for item in tuning.parameters]


def _parameter(item: Parameter, place: int | None, chosen: Finalist) -> dict[str, Any]:
    tuned = item.start
    if place is not None and chosen.points is not None:
        tuned = item.value(chosen.points[place])
    return {
        "name": item.name,
        "unit": item.unit,
        "start": item.start,
        "tuned": tuned,
        "lower": item.lower,
        "upper": item.upper,
        "searched": place is not None,
    }


def _effort(tuning: Tuning, settings: Settings) -> dict[str, Any]:
    generations = tuning.state.generations
    return {
        "seed": settings.seed,
        "generations": len(generations),
        "population": settings.population,
        "candidates": sum(len(item.costs) for item in generations),
        "screening_points": len(tuning.state.screening),
        "elapsed_s": tuning.state.elapsed,
        "versions": tuning.state.identity["versions"],
    }
