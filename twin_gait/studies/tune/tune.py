"""Tuning of a gait table to a wearer: search, and the robust set over which the best tables are ranked."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from twin_gait.experiment.experiment import Experiment
from twin_gait.parameters import quantities
from twin_gait.simulation.simulator import precompile
from twin_gait.studies.batch import walking_wearer
from twin_gait.studies.jobs import Stop
from twin_gait.studies.tune import space, walks
from twin_gait.studies.tune.draws import HELD_OUT, draw_worlds
from twin_gait.studies.tune.evolution import Evolution, rank_in_two_rounds
from twin_gait.studies.tune.objective import FALL, Rating, nominal_cost, residuals
from twin_gait.studies.tune.search import Descent, Generation
from twin_gait.studies.tune.walks import (
    build_cases,
    candidate_table,
    case_weights,
    table_performance,
    walker,
    weighted_cost,
    with_candidate,
)
from twin_gait.studies.workers import Workers

# Share of the time for the search; the robust set and the report take the rest.
SEARCH_SHARE = 0.75
SEARCH_WALKS = 1000  # least number of walks for which loops are compiled
RACED = 6  # number of candidates of a generation, the best of the nominal walk, that walk all cases
FINALISTS = 5  # number of tables from the search, in addition to the initial table
ReportFunction = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class TuningSettings(quantities.Parameters):
    """Settings of a tuning.

    Attributes:
        minutes: Time for everything; running generations are finished.
        generations: Number of generations of the search; None until the time is over. With a number the
            result does not depend on the speed of the machine.
        seed: Seed of the sensor noise; the search itself is deterministic.
        thresholds: Whether angle thresholds are tuned.
        blending: Whether the duration of the blend is tuned.
        per_side: Whether each leg has numbers of its own (hemiparesis).
        robust: Whether the table is also for other wearers, supports, belts, drives and grounds, like a
            packaged table: the search then has slopes over random worlds of ``draws.yaml`` together, after
            :mod:`twin_gait.studies.tune.evolution` if the table does not walk at first, and the robust set
            consists of other random worlds.
        population: Number of candidates of a generation before the table walks.
        draws: Number of random worlds of the robust search.
        held_out: Number of random worlds of the robust set, in which no candidate walked during the search.
        spread: Standard deviation of the first candidates in the unit cube of all numbers, before the table
            walks.
        scatter: Standard deviation by which the start of the robust search is moved away at random, with the
            seed, to show that the search finds its table from elsewhere.
        also: Numbers of the experiment that the robust search changes together with the table: least value,
            start and largest value by key, as for ``--set``.
        search_duration: Duration of a walk in the search in [s].
        robust_duration: Duration of a walk of the robust set in [s].
    """

    minutes: Annotated[quantities.Ratio, quantities.POSITIVE] = 3.0
    generations: Annotated[int | None, quantities.integer_range(1, 100_000, "more than a week of search")] = (
        None
    )
    seed: Annotated[int, quantities.SEEDS] = 0
    thresholds: bool = True
    blending: bool = True
    per_side: bool = False
    robust: bool = False
    population: Annotated[int, quantities.integer_range(4, 1000, "an hour for a generation")] = 24
    draws: Annotated[int, quantities.integer_range(1, 1000, "an hour for a generation")] = 8
    held_out: Annotated[int, quantities.integer_range(1, 10_000, "a day of walking")] = 100
    spread: Annotated[quantities.Ratio, quantities.POSITIVE] = 0.08
    scatter: Annotated[quantities.Ratio, quantities.NOT_NEGATIVE] = 0.0
    also: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    search_duration: quantities.Time = 14.0
    robust_duration: quantities.Time = 20.0


@dataclass(frozen=True, eq=False)
class Finalist:
    """A table that walked the robust set."""

    table: dict[str, Any]  # document of the table, with the searched numbers of the experiment
    # coordinates of the searched numbers; None for the initial table
    points: Sequence[float] | None
    walks: Mapping[str, Rating]  # ratings by name of the case, nominal first

    @property
    def falls(self) -> int:
        """Number of cases with a fall."""
        return sum(walk.fell for walk in self.walks.values())

    @property
    def cost(self) -> float:
        """Cost over the robust set; the nominal case has the same weight as in the search."""
        return weighted_cost(list(self.walks.values()))


class Tuning:
    """A tuning: the data that its stages share, and their results.

    Attributes:
        experiment: Experiment with the table to be improved, and with the seed of the settings.
        settings: Settings of the tuning.
        parameters: All numbers of the table that are searched.
        search_cases: Cases of the search by names, the nominal one first.
        generations: Generations of the search; the first is its start.
        evolved: Number of generations of evolution, before the table walked.
        ranked: All finalists, the best first; ``initial`` is one of them.
        initial: Initial table, which is to be improved.
        elapsed: Duration of the tuning in [s].
    """

    initial: Finalist
    ranked: list[Finalist]
    elapsed: float

    def __init__(
        self,
        experiment: Experiment,
        settings: TuningSettings,
        workers: Workers,
        report: ReportFunction,
        stop: Stop | None,
    ) -> None:
        """Initialise the tuning; nothing is simulated.

        The arguments are those of :func:`twin_gait.studies.tune.tune.tune`.
        """
        self.settings, self._workers, self._stop = settings, workers, stop
        self._report, self._start_time = report, time.perf_counter()
        self.experiment = replace(experiment, seed=settings.seed)
        self._table = space.editable_document(experiment.table)
        table = space.tunable_parameters(
            experiment.table, thresholds=settings.thresholds, blending=settings.blending
        )
        others = space.experiment_parameters(settings.also)
        if others:
            self._table[space.SETTINGS] = {item.path[-1]: item.start for item in others}
            with_candidate(self.experiment, self._table)  # reports an unknown key before anything is compiled
        self.parameters = (*table, *others)
        self.generations: list[Generation] = []
        self.evolved = 0
        if settings.robust:
            self.search_cases = self._draw(settings.draws, 0)
            self._robust_cases = self._draw(settings.held_out, HELD_OUT)
        else:
            self.search_cases = build_cases(self.experiment, "search")
            self._robust_cases = build_cases(self.experiment, "robust") | self.search_cases

    def _draw(self, count: int, stream: int) -> dict[str, Experiment]:
        """Return the nominal world and random worlds by names."""
        return {"nominal": self.experiment} | draw_worlds(self.experiment, count, self.settings.seed, stream)

    def run(self, on_compile: Callable[[], None] | None) -> None:
        """Run all stages, unless ``should_stop`` returns True."""
        settings = self.settings
        self._report_stage("compiling")
        for walked in self._robust_cases.values():  # here, because otherwise every worker would compile
            precompile(walker(walked, duration=settings.search_duration), SEARCH_WALKS, on_compile)
        search = self._robust_search() if settings.robust else self._search()
        for done, generation in enumerate(search):
            self.generations.append(generation)
            minutes = self._report_stage(f"search: generation {done + 1}")
            late = done > 0 and minutes > SEARCH_SHARE * settings.minutes  # at least one generation is run
            if done == settings.generations or (settings.generations is None and late):
                break
        self._report_stage("the robust set")
        finalists = self._finalists()
        self.initial, self.ranked = finalists[0], sorted(finalists, key=lambda item: (item.falls, item.cost))
        self.elapsed = time.perf_counter() - self._start_time

    def _report_stage(self, stage: str) -> float:
        """Report the next stage; return the elapsed minutes."""
        minutes, found = (time.perf_counter() - self._start_time) / 60.0, self.generations
        # The worlds of an evolution differ between generations, so its costs are not a minimum so far.
        words = "best candidate" if found and len(found) <= self.evolved else "best"
        best = f", {words}: cost {found[-1].cost:.2f} (from {found[0].cost:.2f})" if found else ""
        self._report(f"{minutes:4.1f} min  {stage}{best}")
        return minutes

    def _walk(
        self, candidates: Sequence[Mapping[str, Any]], cases: Iterable[Experiment], *, last: bool = False
    ) -> list[list[Rating]]:
        """Simulate walks of each candidate in each case, of the search or if ``last`` of the robust set."""
        settings = self.settings
        duration = settings.robust_duration if last else settings.search_duration
        walked = [walker(case, duration=duration) for case in cases]
        tables = [candidate_table(item) for item in candidates]
        walks_to_run = [
            with_candidate(case, item, table)
            for item, table in zip(candidates, tables, strict=True)
            for case in walked
        ]
        results = walks.walk_all(walks_to_run, self._workers, should_stop=self._stop)
        return [results[at : at + len(walked)] for at in range(0, len(results), len(walked))]

    def _search(self) -> Iterator[Generation]:
        """Walk the initial table, then generations until there is no more gain.

        Slopes come from the nominal walk; the two corners only decide between the best candidates.
        """
        point = [item.start_coordinate for item in self.parameters]
        (ratings,) = self._walk([self._table], self.search_cases.values())
        yield Generation(point, weighted_cost(ratings), [table_performance(ratings)])
        yield from self._descend(point, ratings, 1)

    def _robust_search(self) -> Iterator[Generation]:
        """Walk the start, evolve it until it walks, then follow the slopes over all worlds of the search."""
        settings = self.settings
        point = np.array([item.start_coordinate for item in self.parameters])
        point += settings.scatter * np.random.default_rng(settings.seed).standard_normal(len(point))
        best = np.clip(point, 0.0, 1.0).tolist()
        (ratings,) = self._walk([self._table_at(best)], self.search_cases.values())
        yield Generation(best, weighted_cost(ratings), [table_performance(ratings)])
        if not walks_enough(ratings):
            search = Evolution(
                best, spread=settings.spread, population=settings.population, seed=settings.seed
            )
            while not walks_enough(ratings):
                generation = self._evolve(search)
                best, self.evolved = generation.point, search.generation
                (ratings,) = self._walk([self._table_at(best)], self.search_cases.values())
                yield generation
        yield from self._descend(best, ratings, len(self.search_cases))

    def _descend(self, point: list[float], ratings: Sequence[Rating], sloped: int) -> Iterator[Generation]:
        """Run generations of least squares from a point until there is no more gain.

        ``ratings``: walks of the point in all cases of the search. ``sloped``: number of cases, from the
        nominal one on, in which slopes are measured.
        """
        weights = case_weights(sloped)
        descent = Descent(point, weighted_cost(ratings), _all_residuals(ratings[:sloped]), weights)
        while not descent.has_ended:
            yield self._generation(descent, sloped)

    def _generation(self, descent: Descent, sloped: int) -> Generation:
        """Walk one generation and continue from its best candidate."""
        cases = list(self.search_cases.values())
        neighbours = descent.neighbours()
        ratings = self._walk([self._table_at(point) for point in neighbours], cases[:sloped])
        descent.update_slopes(neighbours, [_all_residuals(item) for item in ratings])
        candidates = [*((None, point) for point in neighbours), *descent.candidate_steps()]
        tables = [self._table_at(point) for _, point in candidates]
        ratings += self._walk(tables[len(ratings) :], cases[:1])
        nominal = [nominal_cost(item[0]) for item in ratings]
        unfinished = [index for index, item in enumerate(ratings) if len(item) < len(cases)]
        raced = sorted(unfinished, key=nominal.__getitem__)[:RACED]
        others = self._walk([tables[index] for index in raced], cases[1:])
        for index, more in zip(raced, others, strict=True):
            ratings[index] += more
        costs = {index: weighted_cost(item) for index, item in enumerate(ratings) if len(item) == len(cases)}
        for index in sorted(costs, key=costs.__getitem__):
            better = costs[index] < descent.cost
            if better and not self._has_errors(tables[index]):
                damping, point = candidates[index]
                descent.accept_step(point, costs[index], _all_residuals(ratings[index][:sloped]), damping)
                break
        else:
            descent.reject_steps()
        return Generation(descent.point, descent.cost, [table_performance(item) for item in ratings])

    def _evolve(self, search: Evolution) -> Generation:
        """Walk one generation of evolution; its cost is the one of its best candidate."""
        first, *others = self._draw(self.settings.draws, search.generation + 1).values()
        points = search.candidates()
        tables = [self._table_at(point) for point in points]
        ratings = self._walk(tables, [first])
        nominal = [
            FALL + nominal_cost(walk) if self._has_errors(table) else nominal_cost(walk)
            for table, (walk,) in zip(tables, ratings, strict=True)
        ]

        def walk_others(chosen: list[int]) -> dict[int, float]:
            for index, more in zip(chosen, self._walk([tables[at] for at in chosen], others), strict=True):
                ratings[index] += more
            surcharge = {at: nominal[at] - nominal_cost(ratings[at][0]) for at in chosen}
            return {at: surcharge[at] + weighted_cost(ratings[at]) for at in chosen}

        costs = rank_in_two_rounds(nominal, walk_others)
        search.update(costs)
        return Generation(search.mean, min(costs), [table_performance(item) for item in ratings])

    def _has_errors(self, candidate: Mapping[str, Any]) -> bool:
        return bool(walks.quick_errors(with_candidate(self.experiment, candidate)))

    def _table_at(self, point: Sequence[float]) -> dict[str, Any]:
        return space.apply_coordinates(self._table, self.parameters, point)

    def _finalists(self) -> list[Finalist]:
        """Walk the initial table, and points of the search, over the robust set."""
        chosen: list[tuple[dict[str, Any], list[float] | None]] = [(self._table, None)]
        for item in leaders(self.generations, FINALISTS):
            table = self._table_at(item.point)
            if all(table != other for other, _ in chosen):
                chosen.append((table, item.point))
        results = self._walk([table for table, _ in chosen], self._robust_cases.values(), last=True)
        return [
            Finalist(table, point, dict(zip(self._robust_cases, ratings, strict=True)))
            for (table, point), ratings in zip(chosen, results, strict=True)
        ]


def walks_enough(ratings: Sequence[Rating]) -> bool:
    """Return whether a table has slopes that a search can follow.

    It must make strides in the nominal world, the first, and in at least half of the others.
    """
    nominal, *others = (len(found) > 0 for found in _all_residuals(ratings))
    return nominal and 2 * sum(others) >= len(others)


def _all_residuals(ratings: Sequence[Rating]) -> list[np.ndarray]:
    """Return the residuals of the walks of a table, the nominal one first."""
    return [residuals(rating, nominal=number == 0) for number, rating in enumerate(ratings)]


def leaders(generations: Sequence[Generation], count: int) -> list[Generation]:
    """Return the points of the search at the ends of ``count`` equal intervals.

    The latest is first, the start of the search last. Points of adjacent generations are unsuitable, because
    they are close to each other and fall in the same case.
    """
    ends = np.linspace(len(generations) - 1, 0, count).round().astype(int)
    points = {tuple(generations[index].point): generations[index] for index in ends.tolist()}
    return list(points.values())


def tune(
    experiment: Experiment,
    settings: TuningSettings,
    *,
    workers: Workers | None = None,
    report: ReportFunction = lambda line: None,
    should_stop: Stop | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Tuning | None:
    """Search for better tables and rank them.

    The result depends on the experiment, the settings and the number of generations, not on the workers.

    Args:
        experiment: A wearer who walks on the ground, and the table to be improved.
        report: Receives a line on the progress of the tuning, with the best cost so far.
        should_stop: Called before each walk; True ends the tuning.

    Returns:
        The tuning; None if it was stopped.

    Raises:
        ParameterError: If there is nothing to tune, the settings are invalid or a walk cannot be simulated.
    """
    walking_wearer(experiment)
    if settings.per_side:
        experiment = replace(experiment, table=space.split_sides(experiment.table))
    tuning = Tuning(experiment, settings, workers or Workers(), report, should_stop)
    try:
        tuning.run(on_compile)
    except walks.TuningStopped:
        return None
    return tuning
