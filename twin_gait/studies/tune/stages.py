"""The stages of a tuning: compiling, screening, search and robust set."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.exceptions import ParameterError, TwinGaitError
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.simulation import RunStatus
from twin_gait.studies.jobs import Workers
from twin_gait.studies.tune.cases import NOMINAL, Case, robust_cases, search_cases
from twin_gait.studies.tune.parts import FALL, Rating
from twin_gait.studies.tune.search import (
    Effect,
    Generation,
    Search,
    best_so_far,
    better_half,
    effects,
    plan,
)
from twin_gait.studies.tune.space import (
    Parameter,
    editable_document,
    parameters_of,
    table_with,
    with_own_sides,
)
from twin_gait.studies.tune.state import Finalist, Progress, Settings, State, Tuning, write_state
from twin_gait.studies.tune.walks import (
    Ask,
    Portion,
    nominal_cost,
    rate_walks,
    table_of,
    walk_all,
    walker,
    weighted_cost,
)

# Share of the minutes for screening and search; the robust set, the departures and the report take the rest.
SEARCH_SHARE = 0.85
FINALISTS = 5
# Shipped tables for the same walk; a search does not come from the one to the other.
START_TABLES = ("treadmill", "treadmill_normative")
WARM_UP = 0.05  # [s], long enough to compile what a case needs


class Stopped(Exception):  # not an error: somebody asked for it
    """The tuning was asked to stop."""


def start_tables(table: GaitTable) -> tuple[GaitTable, ...]:
    """Tables that a search can begin with: this one first.

    Where it is one of ``START_TABLES``, the others of those follow, with sides told apart if it does so.
    """
    shipped = {name: load_gait_table(name) for name in START_TABLES}
    plain = replace(table, side_phases={}) if table.side_phases else table
    if plain != shipped.get(table.name):
        return (table,)
    others = [other for name, other in shipped.items() if name != table.name]
    return (table, *(with_own_sides(other) if table.side_phases else other for other in others))


class Stages:
    """One call of :func:`twin_gait.studies.tune.tune.tune`: what its stages share."""

    def __init__(
        self,
        experiment: Experiment,
        settings: Settings,
        workers: Workers,
        state: State,
        directory: Path,
        progress: Callable[[Progress], None] | None,
        should_stop: Callable[[], bool] | None,
    ) -> None:
        """Begin; nothing is walked. The arguments are those of :func:`twin_gait.studies.tune.tune.tune`."""
        self._settings, self._workers, self._state = settings, workers, state
        self._directory, self._should_stop = directory, should_stop
        self._progress = progress or (lambda step: None)
        self._began, self._before = time.perf_counter(), state.elapsed
        self._experiment = replace(experiment, seed=settings.seed)
        self._table = editable_document(experiment.table)
        self._begin_with(experiment.table)
        self._effects: tuple[Effect, ...] = ()
        self._best: tuple[float, Mapping[str, float | None]] = (float("inf"), {})
        self._origin_cost = float("inf")

    def _begin_with(self, table: GaitTable) -> None:
        settings = self._settings
        self._origin = editable_document(table)
        self._parameters = parameters_of(table, thresholds=settings.thresholds, blending=settings.blending)

    def everything(self, on_compile: Callable[[], None] | None) -> Tuning:
        """Run all stages.

        Raises:
            Stopped: If somebody asked for it.
            ParameterError: If a walk cannot be run.
        """
        self._compile(on_compile)
        self._walk_start()
        searched = self._screen()
        self._search(searched)
        finalists = self._finalists(searched)
        before = finalists[0]
        ranked = sorted(finalists, key=lambda item: (item.falls, item.cost))
        self.keep()
        return self._tuning(RunStatus.COMPLETED, searched, before, tuple(ranked))

    def unfinished(self) -> Tuning:
        """A tuning that was stopped, of which only the state counts."""
        return self._tuning(RunStatus.INTERRUPTED, (), None, ())

    def _tuning(
        self,
        status: RunStatus,
        searched: tuple[Parameter, ...],
        before: Finalist | None,
        ranked: tuple[Finalist, ...],
    ) -> Tuning:
        name = str(self._origin["name"])
        return Tuning(status, self._parameters, searched, self._effects, self._state, before, ranked, name)

    def keep(self) -> None:
        """Write the state."""
        self._state.elapsed = self._elapsed()
        write_state(self._state, self._directory)

    def _elapsed(self) -> float:
        return self._before + time.perf_counter() - self._began

    def _tell(self, stage: str, done: int, total: int | None) -> None:
        start = self._state.start_cost
        cost, values = self._best
        known = float("inf") if start is None else start
        self._progress(Progress(stage, done, total, self._elapsed(), known, cost, values))

    def _compile(self, on_compile: Callable[[], None] | None) -> None:
        """Compile here what no worker has to, before all of them would."""
        cases = robust_cases(self._experiment)
        for number, case in enumerate(cases):
            self._tell("compiling", number, len(cases))
            for quick in (False, True):
                walked = case.change(walker(self._experiment, duration=WARM_UP, quick=quick))
                try:
                    rate_walks(Portion(number, ((walked, None),), None), on_compile)
                except TwinGaitError as error:
                    raise ParameterError(f"{case.name}: {error}") from error

    def _walk(self, asks: Sequence[Ask], duration: float, stage: str) -> list[Rating]:
        last = stage == "robust set"
        counted = (lambda done, total: self._tell(stage, done, total)) if last else None
        results = walk_all(
            asks,
            walker(self._experiment, duration=duration, quick=not last),
            self._workers,
            reference_speed=self._settings.reference_speed,
            progress=counted,
            should_stop=self._should_stop,
        )
        if results is None:
            raise Stopped
        return results

    def _costs(self, tables: Sequence[Mapping[str, Any]], cases: Sequence[Case], stage: str) -> list[float]:
        """Cost of some tables in the short walks."""
        checked = stage != "screening"  # which wants to know what walks, not what may
        asks = [
            Ask(table, case, checked and case.name == NOMINAL)
            for table in map(table_of, tables)
            for case in cases
        ]
        results = self._walk(asks, self._settings.search_duration, stage)
        size = len(cases)
        costs = []
        for place in range(0, len(results), size):
            cost = weighted_cost(results[place : place + size])
            costs.append(cost)
            # The screening walks fewer cases; its costs do not compare.
            if cost < self._best[0] and stage != "screening":
                self._best = (cost, results[place].values)
        return costs

    def _raced(self, tables: Sequence[GaitTable], cases: Sequence[Case]) -> list[float]:
        """Cost of a population, of which the worse half of the nominal walks does not walk the corners.

        The optimiser learns from the better half, by the order of the costs; each of the others costs more,
        and a table with an error most of all. Only what walked well is checked: that takes as long as a walk.
        """
        first, *corners = cases
        duration = self._settings.search_duration
        nominal = self._walk([Ask(table, first) for table in tables], duration, "")
        order = better_half([nominal_cost(walk) for walk in nominal])
        leaders = [place for place in order if not nominal[place].fell]
        asks = [Ask(tables[place], case, case is corners[0]) for place in leaders for case in corners]
        others = iter(self._walk(asks, duration, ""))
        costs, forbidden = dict[int, float](), dict[int, float]()
        for place in leaders:
            walks = [nominal[place], *(next(others) for _ in corners)]
            if walks[1].errors:
                forbidden[place] = walks[1].cost
                continue
            costs[place] = weighted_cost(walks)
            if costs[place] < self._best[0]:
                self._best = (costs[place], nominal[place].values)
        worst = max(costs.values(), default=FALL)
        told = costs | forbidden
        return [told.get(place, worst + nominal_cost(nominal[place])) for place in range(len(tables))]

    def _walk_start(self) -> None:
        """Walk the table that is to be bettered and all that the search could begin with."""
        tables = start_tables(self._experiment.table)
        documents = [editable_document(table) for table in tables]
        costs = self._costs(documents, search_cases(self._experiment), "")
        self._state.start_cost, self._origin_cost = costs[0], min(costs)
        self._begin_with(tables[costs.index(min(costs))])
        self.keep()

    def _screen(self) -> tuple[Parameter, ...]:
        """Narrow the search; a trajectory at a time is kept."""
        settings, state = self._settings, self._state
        if not settings.screening:
            return self._parameters
        points = plan(self._parameters, settings.seed, settings.trajectories)
        cases = search_cases(self._experiment)[:2]
        size = len(self._parameters) + 1
        while len(state.screening) < len(points):
            place = len(state.screening)
            self._tell("screening", place, len(points))
            tables = [
                table_with(self._origin, self._parameters, point) for point in points[place : place + size]
            ]
            state.screening += self._costs(tables, cases, "screening")
            self.keep()
        found = effects(self._parameters, points, state.screening, settings.seed)
        self._effects = tuple(found)
        pairs = zip(self._parameters, found, strict=True)
        return tuple(parameter for parameter, effect in pairs if effect.kept)

    def _search(self, searched: Sequence[Parameter]) -> None:
        settings, state = self._settings, self._state
        search = Search([item.start_coordinate for item in searched], settings.seed, settings.population)
        search.replay(state.generations)
        kept = float(best_so_far(self._best[0], state.generations)[-1])
        if kept < self._best[0]:
            self._best = (kept, {})  # found before the tuning was stopped; its parts were not kept
        cases = search_cases(self._experiment)
        while not self._over():
            self._tell("search", len(state.generations), settings.generations)
            points = search.ask()
            tables = [table_of(table_with(self._origin, searched, point)) for point in points]
            generation = Generation(points, self._raced(tables, cases))
            search.tell(generation)
            state.generations.append(generation)
            self.keep()

    def _over(self) -> bool:
        """Whether the search has had its generations, or its time; one generation it always gets."""
        done, wanted = len(self._state.generations), self._settings.generations
        if wanted is not None:
            return done >= wanted
        return done > 0 and self._elapsed() > SEARCH_SHARE * 60.0 * self._settings.minutes

    def _finalists(self, searched: Sequence[Parameter]) -> list[Finalist]:
        """What was to be bettered, the search's first table and its best candidates, over the robust set."""
        start_cost = self._state.start_cost
        assert start_cost is not None  # walked before
        chosen: list[tuple[tuple[float, ...] | None, float, dict[str, Any]]] = [
            (None, start_cost, self._table)
        ]
        origin = [item.start_coordinate for item in searched]
        for cost, points in [(self._origin_cost, origin), *leaders(self._state.generations, FINALISTS)]:
            table = table_with(self._origin, searched, points)
            if len(chosen) <= FINALISTS and all(table != other for _, _, other in chosen):
                chosen.append((tuple(points), cost, table))
        cases = robust_cases(self._experiment)
        asks = [Ask(table_of(table), case) for _, _, table in chosen for case in cases]
        results = self._walk(asks, self._settings.robust_duration, "robust set")
        names = [case.name for case in cases]
        return [
            Finalist(table, points, cost, tuple(zip(names, results[i * len(cases) :], strict=False)))
            for i, (points, cost, table) in enumerate(chosen)
        ]


def leaders(generations: Sequence[Generation], count: int) -> list[tuple[float, list[float]]]:
    """The cheapest candidate of each of so many stretches of the search, the latest stretch first.

    The cheapest of all lie side by side in the last generations, and what one of them cannot walk none of
    them can. Cost and coordinates; none of a stretch in which all fell.
    """
    found = []
    for stretch in np.array_split(np.arange(len(generations)), count)[::-1]:
        # Only the better half of a generation has walked all cases.
        pairs = [
            (generations[number].costs[place], generations[number].points[place])
            for number in stretch.tolist()
            for place in better_half(generations[number].costs)
        ]
        found += sorted((pair for pair in pairs if pair[0] < FALL), key=lambda pair: pair[0])[:1]
    return found
