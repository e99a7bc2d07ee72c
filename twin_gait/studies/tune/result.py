"""Result of a tuning: the chosen table, and its folder with numbers, report and figures."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from twin_gait.checking.check import build_case, check, counts
from twin_gait.checking.finding import Severity
from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.experiment import Experiment
from twin_gait.files import write_atomically, write_json
from twin_gait.gait.table import GaitTable
from twin_gait.measures.reference import KILOMETRES_PER_HOUR
from twin_gait.report.canvas import write_pictures
from twin_gait.report.failures import failed_pictures
from twin_gait.report.pages import FIGURES_FOLDER
from twin_gait.report.tune import page, tuning_drawings
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.runs.summary import software_versions
from twin_gait.simulation.simulator import simulate
from twin_gait.studies.batch import walking_wearer
from twin_gait.studies.tune.objective import (
    EXCESS_THRESHOLD,
    WORST,
    Rating,
    nominal_cost,
    term_costs,
)
from twin_gait.studies.tune.space import SETTINGS
from twin_gait.studies.tune.tune import Finalist, Tuning, TuningSettings, tune
from twin_gait.studies.tune.walks import NOMINAL_WEIGHT, table_performance, walker, with_candidate
from twin_gait.studies.workers import Workers

TABLE_FILE, OUTCOME_FILE, REPORT_FILE = "table.yaml", "tune.json", "report.html"
OUTCOME_VERSION = 1
TUNING = FolderKind("a tuning", OUTCOME_FILE)
_REFERENCE = "Koopman et al. (2014) at {:.3g} km/h, from foot contact to foot contact"
# A part that changes by less than this fraction of its goal counts as unchanged.
SAME = 0.05


def choose(tuning: Tuning) -> tuple[Finalist, dict[str, int]]:
    """Return the best finalist whose table has no error in the check, and the counts of its findings.

    Raises ParameterError if no table passes the check.
    """
    for finalist in tuning.ranked:
        experiment = with_candidate(tuning.experiment, finalist.table)
        findings = check(build_case(experiment.table, experiment))
        if not any(item.severity is Severity.ERROR for item in findings):
            return finalist, counts(findings)
    raise ParameterError(
        f"table {tuning.experiment.table.name}: no candidate passes twin-gait check, and neither does the "
        "table itself; correct its errors first"
    )


def tuned_table(experiment: Experiment, *, workers: Workers | None = None, **settings: Any) -> GaitTable:
    """Return the gait table that a tuning finds, without folder and report (``twin-gait tune`` writes both).

    Args:
        experiment: A wearer who walks on the ground, and the table to be improved.
        workers: Processes or a cluster that execute the walks; the calling process if None.
        **settings: Settings as of :class:`~twin_gait.studies.tune.tune.TuningSettings`: ``minutes`` for
            everything (3), or ``generations`` of the search, with which the result does not depend on the
            speed of the machine; ``seed``; ``search_duration`` and ``robust_duration`` of a walk in [s].

    Raises:
        ParameterError: If there is nothing to tune, or no table passes the check.
    """
    tuning = tune(experiment, TuningSettings(**settings), workers=workers)
    assert tuning is not None  # there is no should_stop
    return with_candidate(tuning.experiment, choose(tuning)[0].table).table


def write_tuning(tuning: Tuning, directory: Path, *, wearer: str, force: bool = False) -> dict[str, Any]:
    """Choose the table and write all files.

    ``wearer``: description of the wearer in words. Returns the content of ``tune.json``. Raises
    ParameterError if no table passes the check. Raises RunDirectoryError if the folder exists, unless it is a
    tuning and ``force`` is set, or if it cannot be written.
    """
    finalist, found = choose(tuning)
    start = tuning.experiment.table.name
    origin = (
        f"Tuned by twin-gait tune from the table {start} for {wearer}. Found in simulation; nothing here was "
        "measured on a person."
    )
    if finalist.points is None:
        origin = f"The table {start} without a change: the search found no better one for {wearer}."
    table = {**finalist.table, "name": f"{start}_tuned", "description": origin}
    settings = table.pop(SETTINGS, {})
    result = result_document(tuning, finalist, wearer) | {"check": found, "settings": settings}
    walked = walker(tuning.experiment, duration=tuning.settings.robust_duration)
    runs = {
        name: simulate(with_candidate(walked, item.table))
        for name, item in (("before", tuning.initial), ("after", finalist))
    }
    with staged_directory(directory, TUNING, force=force) as staging:
        drawings = tuning_drawings(result, tuning.experiment, runs)
        pictures = write_pictures(drawings, staging / FIGURES_FOLDER)
        write_atomically(staging / REPORT_FILE, page(result, pictures.written))
        result |= failed_pictures(pictures.failed)
        write_atomically(staging / TABLE_FILE, dump_yaml(table))
        write_json(staging / OUTCOME_FILE, result)
    return result


def result_document(tuning: Tuning, after: Finalist, wearer: str) -> dict[str, Any]:
    """Return the content of ``tune.json`` without the findings of the check."""
    experiment, settings, before = tuning.experiment, tuning.settings, tuning.initial
    speed, generations = walking_wearer(experiment)[0].speed, tuning.generations
    names, measured = list(tuning.search_cases), experiment.reference
    return {
        "schema_version": OUTCOME_VERSION,
        "experiment": experiment.name,
        "wearer": wearer,
        "belt_speed_m_per_s": speed,
        "reference": measured.source if measured else _REFERENCE.format(speed * KILOMETRES_PER_HOUR),
        "table_before": experiment.table.name,
        "joints": list(experiment.joints),
        "found_better": after.points is not None,
        "parts": _parts(*(next(iter(item.walks.values())) for item in (before, after))),
        "walk_s": settings.robust_duration,
        "worst_cost": WORST,
        "nominal_weight": NOMINAL_WEIGHT,
        "excess": {"aim": EXCESS_THRESHOLD},
        "cost": {"before": before.cost, "after": after.cost},
        "robust_set": [
            {"case": name, "before": _walk(before.walks[name], number), "after": _walk(walk, number)}
            for number, (name, walk) in enumerate(after.walks.items())
        ],
        "trade_offs": {
            "cases": names[1:],
            "candidates": [item for generation in generations for item in generation.tried],
            "before": table_performance([before.walks[name] for name in names]),
            "after": table_performance([after.walks[name] for name in names]),
        },
        "parameters": _parameters(tuning, after),
        "convergence": [item.cost for item in generations],
        "falls": {"before": before.falls, "after": after.falls},
        "effort": {
            "search": "CMA-ES until the table walks, then damped least squares"
            if tuning.evolved
            else "damped least squares",
            "evolved_generations": tuning.evolved,
            "random_worlds": settings.robust,
            "seed": settings.seed,
            "generations": len(generations) - 1,  # the first is the start
            "candidates": sum(len(item.tried) for item in generations),
            "elapsed_s": tuning.elapsed,
            "versions": software_versions(),
        },
    }


def _parts(before: Rating, after: Rating) -> list[dict[str, Any]]:
    """Return the named parts before and after, each with its verdict."""
    first, second = (term_costs(walk.values, walk.joints) for walk in (before, after))
    found = []
    for part in before.terms:
        was, now = before.values[part.name], after.values[part.name]
        costs = {"cost_before": first[part.name], "cost_after": second[part.name]}
        values = {"before": was, "after": now, **costs, "verdict": verdict(was, now, part.goal)}
        found.append({**asdict(part), **values})
    return found


def verdict(before: float | None, after: float | None, goal: float) -> str:
    """Return whether a part is ``better``, ``traded`` (worse), the ``same`` or ``not defined``.

    A smaller value is better.
    """
    if before is None or after is None:
        return "not defined"
    if math.isclose(before, after, rel_tol=0.0, abs_tol=SAME * goal):
        return "same"
    return "better" if after < before else "traded"


def _walk(walk: Rating, number: int) -> dict[str, Any]:
    """Return a walk of the robust set as a mapping; number 0 is the nominal one."""
    cost = walk.cost if number else nominal_cost(walk)
    return {"cost": cost, "fell": walk.fell, "lasted_share": walk.lasted_share, **walk.values}


def _parameters(tuning: Tuning, chosen: Finalist) -> list[dict[str, Any]]:
    points = chosen.points or tuple(item.start_coordinate for item in tuning.parameters)
    return [
        {
            "name": item.name, "unit": item.unit, "start": item.start, "tuned": item.value(point),
            "lower": item.lower, "upper": item.upper,
        }
        for item, point in zip(tuning.parameters, points, strict=True)
    ]  # fmt: skip
