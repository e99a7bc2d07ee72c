"""Tune a gait table to a wearer: search, robust set, and the choice of the table."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from twin_gait.checking.check import build_case, check
from twin_gait.checking.finding import Finding, Severity
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.together import compile_ahead
from twin_gait.studies.jobs import Stop
from twin_gait.studies.tune.parts import Rating, nominal_cost, residuals
from twin_gait.studies.tune.search import Descent, Generation
from twin_gait.studies.tune.space import editable_document, parameters_of, table_with, with_own_sides
from twin_gait.studies.tune.state import Finalist, Progress, Settings, Tuning
from twin_gait.studies.tune.walks import (
    Case,
    check_walker,
    corner_cases,
    quick_errors,
    robust_cases,
    search_cases,
    standing,
    table_of,
    walk_all,
    walker,
    weighted_cost,
)
from twin_gait.studies.workers import Workers
from twin_gait.worlds.scenario import BELT_SPEED

# Share of the minutes for the search; the robust set and the report take the rest.
SEARCH_SHARE = 0.75
SEARCH_WALKS = 1000  # or more, for which loops are compiled
RACED = 6  # candidates of a generation that walk all cases, the best of the nominal walk
FINALISTS = 5  # of the search, beside the table that is to be bettered


class Stopped(Exception):  # not an error: somebody asked for it
    """The tuning was asked to stop."""


class Stages:
    """One call of :func:`twin_gait.studies.tune.tune.tune`: what its stages share."""

    def __init__(
        self,
        experiment: Experiment,
        settings: Settings,
        workers: Workers,
        progress: Callable[[Progress], None] | None,
        should_stop: Stop | None,
    ) -> None:
        """Begin; nothing is walked. The arguments are those of :func:`twin_gait.studies.tune.tune.tune`."""
        self._settings, self._workers, self._should_stop = settings, workers, should_stop
        self._progress = progress or (lambda step: None)
        self._began = time.perf_counter()
        self._experiment = replace(experiment, seed=settings.seed)
        self._table = editable_document(experiment.table)
        self._parameters = parameters_of(
            experiment.table, thresholds=settings.thresholds, blending=settings.blending
        )
        self._generations: list[Generation] = []
        corners = corner_cases() if settings.everyone else ()
        self._search_cases = (*search_cases(self._experiment), *corners)
        self._robust_cases = (*robust_cases(self._experiment), *corners)

    def everything(self, on_compile: Callable[[], None] | None) -> Tuning:
        """Run all stages, unless somebody asks to stop."""
        self._compile(on_compile)
        descent = self._start()
        while not self._over(descent):
            self._tell("search", descent.generation, self._settings.generations)
            self._generations.append(self._generation(descent))
        finalists = self._finalists()
        ranked = sorted(finalists, key=lambda item: (item.falls, item.cost))
        generations = tuple(self._generations)
        return Tuning(self._parameters, generations, finalists[0], tuple(ranked), self._elapsed())

    def _elapsed(self) -> float:
        return time.perf_counter() - self._began

    def _tell(self, stage: str, done: int, total: int | None) -> None:
        found = self._generations
        costs = (found[0].cost, found[-1].cost) if found else None
        self._progress(Progress(stage, done, total, self._elapsed(), costs))

    def _compile(self, on_compile: Callable[[], None] | None) -> None:
        """Compile here what no worker has to, before all of them would."""
        cases, duration = self._robust_cases, self._settings.search_duration
        for number, case in enumerate(cases):
            self._tell("compiling", number, len(cases))
            for quick in (False, True):
                walked = case.change(walker(self._experiment, duration=duration, quick=quick))
                try:
                    build_problem(walked)
                except TwinGaitError as error:
                    raise ParameterError(f"{case.name}: {error}") from error
                walks = SEARCH_WALKS if quick else (FINALISTS + 1) * len(cases)
                compile_ahead(walked, walks, on_compile)

    def _walk(
        self, tables: Sequence[GaitTable], cases: Sequence[Case], *, last: bool = False
    ) -> list[list[Rating]]:
        """Walks of each table, in each case: short and quick ones, or the last ones."""
        settings = self._settings
        duration = settings.robust_duration if last else settings.search_duration
        walked = walker(self._experiment, duration=duration, quick=not last)
        results = walk_all(
            [case.change(replace(walked, table=table)) for table in tables for case in cases],
            self._workers,
            progress=(lambda done, total: self._tell("robust set", done, total)) if last else None,
            should_stop=self._should_stop,
        )
        if results is None:
            raise Stopped
        return [results[at : at + len(cases)] for at in range(0, len(results), len(cases))]

    def _start(self) -> Descent:
        """Walk the table that is to be bettered."""
        (walks,) = self._walk([self._experiment.table], self._search_cases)
        cost, nominal = weighted_cost(walks), walks[0]
        point = [item.start_coordinate for item in self._parameters]
        self._generations.append(Generation(point, cost, nominal_cost(nominal), [standing(walks)]))
        return Descent(point, cost, residuals(nominal))

    def _generation(self, descent: Descent) -> Generation:
        """Walk one generation and go on from its best candidate."""
        first, *corners = self._search_cases
        points = descent.neighbours()
        tables = [self._table_at(point) for point in points]
        walks = self._walk(tables, [first])
        descent.learn(points, [residuals(walk) for (walk,) in walks])
        steps = descent.steps()
        dampings = [None] * len(points) + [damping for damping, _ in steps]
        points += [point for _, point in steps]
        tables += [self._table_at(point) for _, point in steps]
        walks += self._walk(tables[len(walks) :], [first])
        nominal = [nominal_cost(walk) for (walk,) in walks]
        raced = sorted(range(len(points)), key=lambda place: (nominal[place], place))[:RACED]
        others = self._walk([tables[place] for place in raced], corners)
        for place, more in zip(raced, others, strict=True):
            walks[place] += more
        costs = {place: weighted_cost(walks[place]) for place in raced}
        better = (
            place
            for place in sorted(costs, key=lambda place: costs[place])
            if costs[place] < descent.cost
            and not quick_errors(replace(self._experiment, table=tables[place]))
        )
        best = next(better, None)
        if best is None:
            descent.stay()
        else:
            descent.go_to(points[best], costs[best], residuals(walks[best][0]), dampings[best])
        tried = [standing(item) for item in walks]
        return Generation(descent.point, descent.cost, float(np.median(nominal)), tried)

    def _table_at(self, point: Sequence[float]) -> GaitTable:
        return table_of(table_with(self._table, self._parameters, point))

    def _over(self, descent: Descent) -> bool:
        """Whether the search has come to its end, or had its generations or time; one it always gets."""
        done, wanted = descent.generation, self._settings.generations
        if descent.has_ended:
            return True
        if wanted is not None:
            return done >= wanted
        return done > 0 and self._elapsed() > SEARCH_SHARE * 60.0 * self._settings.minutes

    def _finalists(self) -> list[Finalist]:
        """What was to be bettered, and where the search stood, over the robust set."""
        start = self._generations[0]
        chosen: list[tuple[tuple[float, ...] | None, float, dict[str, Any]]] = [
            (None, start.cost, self._table)
        ]
        for item in leaders(self._generations, FINALISTS):
            table = table_with(self._table, self._parameters, item.point)
            if all(table != other for _, _, other in chosen):
                chosen.append((tuple(item.point), item.cost, table))
        cases = self._robust_cases
        results = self._walk([table_of(table) for _, _, table in chosen], cases, last=True)
        names = [case.name for case in cases]
        return [
            Finalist(table, points, cost, tuple(zip(names, walks, strict=True)))
            for (points, cost, table), walks in zip(chosen, results, strict=True)
        ]


def leaders(generations: Sequence[Generation], count: int) -> list[Generation]:
    """Where the search stood at the end of each of so many stretches, the latest first; at last its start.

    What lies side by side in the last generations falls over the same case.
    """
    ends = np.linspace(len(generations) - 1, 0, count).round().astype(int)
    points = {tuple(generations[place].point): generations[place] for place in ends.tolist()}
    return list(points.values())


def tune(
    experiment: Experiment,
    settings: Settings,
    *,
    workers: Workers | None = None,
    progress: Callable[[Progress], None] | None = None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Tuning | None:
    """Search and rank.

    The result depends on the experiment, the settings and the number of generations, not on the workers.

    Args:
        experiment: A wearer who walks on the ground, and the table that is to be bettered.
        should_stop: Asked before each walk; True ends the tuning.

    Returns:
        The tuning; None if it was stopped.

    Raises:
        ParameterError: If there is nothing to tune, or the settings make no sense.
        ParameterFileError: If a walk could not be run.
    """
    check_walker(experiment)
    if settings.everyone and not experiment.scenario.adjusts(BELT_SPEED):
        raise ParameterError(f"{experiment.name}: has no belt; leave out --everyone (other belts)")
    if settings.per_side:
        experiment = replace(experiment, table=with_own_sides(experiment.table))
    stages = Stages(experiment, settings, workers or Workers(), progress, should_stop)
    try:
        return stages.everything(on_compile)
    except Stopped:
        return None


def tuned_table(experiment: Experiment, *, workers: Workers | None = None, **settings: Any) -> GaitTable:
    """The gait table that a tuning finds, without folder and report (``twin-gait tune`` writes both).

    Args:
        experiment: A wearer who walks on the ground, and the table that is to be bettered.
        workers: Processes or a cluster that execute the walks; the calling process if None.
        **settings: Those of :class:`twin_gait.studies.tune.state.Settings`: ``minutes`` for everything
            (3), or ``generations`` of the search, with which the result does not depend on the machine's
            speed; ``seed``; ``search_duration`` and ``robust_duration`` of a walk in [s].

    Raises:
        ParameterError: If there is nothing to tune, or no table passes the check.
    """
    tuning = tune(experiment, Settings(**settings), workers=workers)
    assert tuning is not None  # nobody stops it
    return table_of(choose(tuning, experiment).finalist.table)


class Chosen(NamedTuple):
    """The table that is written."""

    finalist: Finalist  # it
    findings: tuple[Finding, ...]  # of the whole check
    refused: int  # finalists before it that the check found errors in


def choose(tuning: Tuning, experiment: Experiment) -> Chosen:
    """Take the best finalist whose table passes every error rule of the check, or ParameterError."""
    for refused, finalist in enumerate(tuning.ranked):
        findings = check(build_case(table_of(finalist.table), experiment))
        if not any(item.severity is Severity.ERROR for item in findings):
            return Chosen(finalist, tuple(findings), refused)
    raise ParameterError(
        f"table {experiment.table.name}: no candidate passes twin-gait check, nor does the table itself; "
        "mend its errors first"
    )


def final_table(chosen: Chosen, experiment: Experiment, wearer: str) -> dict[str, Any]:
    """Document of the table, with a name and a description of its own."""
    start = experiment.table.name
    origin = (
        f"The table {start} as it was: the search found nothing better for {wearer}."
        if chosen.finalist.points is None
        else f"Tuned by twin-gait tune from the table {start} for {wearer}. Found in simulation; "
        "nothing here was measured on a person."
    )
    document = {**chosen.finalist.table, "name": f"{start}_tuned", "description": origin}
    table_of(document)
    return document
