"""Tune a gait table to a wearer: screening, search, robust set, and what came out."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twin_gait.configuration.documents import content_hash, experiment_document
from twin_gait.configuration.gait_table_file import packaged_gait_table
from twin_gait.exceptions import MissingOptionalDependency, ParameterError
from twin_gait.experiment import Experiment
from twin_gait.gait.table import GaitTable
from twin_gait.measures.reference import KILOMETRES_PER_HOUR, reference_covers
from twin_gait.simulation import RunStatus
from twin_gait.studies.sweep_spec import sources_hash
from twin_gait.studies.tune.cases import NOMINAL, Case, check_walker, robust_cases, search_cases
from twin_gait.studies.tune.parts import FALL, NEEDED_CLEARANCE, PARTS, WORST
from twin_gait.studies.tune.screening import (
    FEWEST,
    KEPT_SHARE,
    LEVELS,
    REACH,
    TRAJECTORIES,
    Effect,
    effects,
    plan,
)
from twin_gait.studies.tune.search import FIRST_STEP, POPULATION, Generation, Search, better_half
from twin_gait.studies.tune.space import (
    Parameter,
    editable_document,
    parameters_of,
    table_with,
    with_own_sides,
)
from twin_gait.studies.tune.state import State, open_state, write_state
from twin_gait.studies.tune.walks import Ask, Walk, WalkResult, run_walk, walk_all
from twin_gait.studies.workers import LocalRunner, Runner

# Share of the minutes for screening and search; the robust set, the departures and the report take the rest.
SEARCH_SHARE = 0.85
NOMINAL_WEIGHT = 0.5  # of the nominal case in the cost of a candidate; the other cases share the rest
FINALISTS = 5
# Shipped tables for the same walk; a search does not come from the one to the other.
START_TABLES = ("treadmill", "treadmill_normative")
WARM_UP = 0.05  # [s], long enough to compile what a case needs


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a table is tuned.

    Attributes:
        reference_speed: Speed of the reference walk in [m] / [s]; None for the belt's.
        minutes: Time for everything; generations under way are finished.
        generations: Of the search; None until the time is over. With a number the result does not depend on
            the machine's speed.
        seed: Of screening, search and sensor noise.
        screening: Whether the search is narrowed to the numbers that matter.
        thresholds: Whether angle thresholds count.
        blending: Whether the duration of the blend counts.
        per_side: Whether each leg gets numbers of its own (hemiparesis).
        population: Candidates of a generation.
        trajectories: Of the screening.
        search_duration: Length of a walk in screening and search in [s].
        robust_duration: Length of a walk of the robust set in [s].
    """

    reference_speed: float | None = None
    minutes: float = 10.0
    generations: int | None = None
    seed: int = 0
    screening: bool = True
    thresholds: bool = True
    blending: bool = True
    per_side: bool = False
    population: int = POPULATION
    trajectories: int = TRAJECTORIES
    search_duration: float = 14.0
    robust_duration: float = 20.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.minutes < float("inf"):
            raise ParameterError(f"minutes: expected a number above 0, got {self.minutes}")
        if self.generations is not None and self.generations < 1:
            raise ParameterError(f"generations: expected 1 or more, got {self.generations}")
        if self.seed < 0:
            raise ParameterError(f"seed: expected a whole number of 0 or more, got {self.seed}")
        if self.population < 4:
            raise ParameterError(f"population: expected 4 or more, got {self.population}")
        speed = self.reference_speed
        if speed is not None and not reference_covers(speed):
            raise ParameterError(
                f"reference: Koopman's curves cover 0.5 to 5 km/h, got {speed * KILOMETRES_PER_HOUR:g}"
            )


class Progress(NamedTuple):
    """Where a tuning stands.

    Attributes:
        stage: ``compiling``, ``screening``, ``search``, ``robust set`` or ``departures``.
        done: Of this stage: walks, or generations.
        total: In all, or None while only the time ends it.
        elapsed: In [s].
        start_cost: Of the table that it began with.
        best_cost: Of the best candidate so far.
        best_values: Parts of its nominal walk; empty if it was found before the tuning was resumed.
    """

    stage: str
    done: int
    total: int | None
    elapsed: float
    start_cost: float
    best_cost: float
    best_values: Mapping[str, float | None]


@dataclass(frozen=True, eq=False)
class Finalist:
    """A table that walked the robust set.

    Attributes:
        table: Its document.
        points: Coordinates of what was searched for; None for the table that it began with.
        search_cost: In the search.
        walks: Name of the case and result, nominal first.
    """

    table: dict[str, Any]
    points: tuple[float, ...] | None
    search_cost: float
    walks: tuple[tuple[str, WalkResult], ...]

    @property
    def falls(self) -> int:
        """Cases in which it fell."""
        return sum(walk.fell for _, walk in self.walks)

    @property
    def cost(self) -> float:
        """Cost over the robust set; the nominal case weighs as much as in the search."""
        return weighted_cost([walk for _, walk in self.walks])


@dataclass(frozen=True, eq=False)
class Tuning:
    """What a tuning came to.

    Attributes:
        status: ``COMPLETED``, or ``INTERRUPTED``: then only the state is kept.
        parameters: All numbers that could be changed.
        searched: Those that the search changed.
        effects: From the screening; empty without.
        state: With all generations.
        before: The table that was to be bettered.
        ranked: All finalists, the best first; ``before`` is one of them.
        began_with: Name of the table that the search began with, see :func:`start_tables`.
    """

    status: RunStatus
    parameters: tuple[Parameter, ...]
    searched: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    state: State
    before: Finalist | None
    ranked: tuple[Finalist, ...]
    began_with: str


class Stopped(Exception):  # not an error: somebody asked for it
    """The tuning was asked to stop."""


def tune(
    experiment: Experiment,
    directory: Path,
    settings: Settings,
    *,
    runner: Runner | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Tuning:
    """Screen, search and rank, keeping the state in a folder after every step.

    The result depends on the experiment, the settings and the number of generations, neither on the runner
    nor on how often it was stopped and resumed.

    Args:
        experiment: A treadmill with a wearer, and the table that is to be bettered. Where it is a shipped
            one, the search begins with that shipped one that suits the person best.
        directory: The folder; see :func:`twin_gait.studies.tune.state.open_state`.
        settings: How.
        runner: Who walks; the calling process if None.
        resume: Whether to go on with what is in the folder.
        force: Whether an earlier tuning may be replaced.
        progress: Called after every step.
        should_stop: Asked before each walk; True ends the tuning, which can be resumed.
        on_compile: Called if the engine has to be compiled, which takes 10 to 20 s.

    Returns:
        What it came to.

    Raises:
        MissingOptionalDependency: If cma or SALib is not installed.
        ParameterError: If there is nothing to tune, or the settings make no sense.
        ParameterFileError: If a walk could not be run.
        RunDirectoryError: If the folder may not be used.
        WorkersLost: If workers die again and again; what was done is kept.
    """
    check_walker(experiment)
    if settings.per_side:
        experiment = replace(experiment, table=with_own_sides(experiment.table))
    directory = directory.expanduser().absolute()
    own = identity(experiment, settings)
    state = open_state(directory, own, resume=resume, force=force)
    # One that came to nothing leaves a folder that can be resumed.
    write_state(state, directory)
    work = _Work(experiment, settings, runner or LocalRunner(), state, directory, progress, should_stop)
    try:
        return work.everything(on_compile)
    except Stopped:
        work.keep()
        return work.unfinished()


def identity(experiment: Experiment, settings: Settings) -> dict[str, Any]:
    """What makes a tuning this one: a kept state of another cannot be gone on with."""
    chosen = asdict(settings)
    del chosen["minutes"], chosen["generations"]
    return {
        "experiment": content_hash(experiment_document(experiment)),
        **chosen,
        "parts": {part.name: [part.goal, part.weight] for part in PARTS},
        "costs": [WORST, FALL, NEEDED_CLEARANCE, NOMINAL_WEIGHT],
        "steps": [FIRST_STEP, REACH, LEVELS, KEPT_SHARE, FEWEST],
        "sources": sources_hash(),
        "versions": {name: _version(name) for name in ("cma", "SALib", "numpy")},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError as error:
        raise MissingOptionalDependency(package, "tune", "twin-gait tune") from error


def weighted_cost(walks: Sequence[WalkResult]) -> float:
    """Cost of a table over its cases.

    Args:
        walks: The nominal case first.

    Returns:
        Half the nominal cost and half the mean of the others; the nominal cost of a table that must not walk.
    """
    nominal, *others = walks
    if nominal.errors or not others:
        return nominal.cost
    mean = sum(walk.cost for walk in others) / len(others)
    return NOMINAL_WEIGHT * nominal.cost + (1.0 - NOMINAL_WEIGHT) * mean


def start_tables(table: GaitTable) -> tuple[GaitTable, ...]:
    """Tables that a search can begin with.

    Args:
        table: The one that is to be bettered.

    Returns:
        It, and where it is one of ``START_TABLES`` the others of those; the sides told apart if it does.
    """
    shipped = {name: packaged_gait_table(name) for name in START_TABLES}
    plain = replace(table, side_phases={}) if table.side_phases else table
    if plain != shipped.get(table.name):
        return (table,)
    others = [other for name, other in shipped.items() if name != table.name]
    return (table, *(with_own_sides(other) if table.side_phases else other for other in others))


class _Work:
    """One call of :func:`tune`: what its stages share."""

    def __init__(
        self,
        experiment: Experiment,
        settings: Settings,
        runner: Runner,
        state: State,
        directory: Path,
        progress: Callable[[Progress], None] | None,
        should_stop: Callable[[], bool] | None,
    ) -> None:
        self._settings, self._runner, self._state = settings, runner, state
        self._directory, self._should_stop = directory, should_stop
        self._progress = progress or (lambda step: None)
        self._began, self._before = time.perf_counter(), state.elapsed
        self._experiment = experiment
        document = experiment_document(experiment)
        self._document = {**document, "seed": settings.seed, "table": None}
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
        return self._tuning(RunStatus.INTERRUPTED, (), None, ())

    def _tuning(
        self,
        status: RunStatus,
        searched: tuple[Parameter, ...],
        before: Finalist | None,
        ranked: tuple[Finalist, ...],
    ) -> Tuning:
        return Tuning(
            status=status,
            parameters=self._parameters,
            searched=searched,
            effects=self._effects,
            state=self._state,
            before=before,
            ranked=ranked,
            began_with=str(self._origin["name"]),
        )

    def keep(self) -> None:
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
            document = {**self._document, "duration_s": WARM_UP}
            for quick in (False, True):
                walk = Walk(number, document, self._table, case.changes, None, False, quick, sources_hash())
                result = run_walk(walk, on_compile)
                if result.problem:
                    raise ParameterError(f"{case.name}: {result.problem}")

    def _walk(self, asks: Sequence[Ask], duration: float, stage: str) -> list[WalkResult]:
        last = stage == "robust set"
        counted = (lambda done, total: self._tell(stage, done, total)) if last else None
        results = walk_all(
            asks,
            {**self._document, "duration_s": duration},
            self._runner,
            quick=not last,
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
        asks = [Ask(table, case, checked and case.name == NOMINAL) for table in tables for case in cases]
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

    def _raced(self, tables: Sequence[Mapping[str, Any]], cases: Sequence[Case]) -> list[float]:
        """Cost of a population, of which the worse half of the nominal walks does not walk the corners.

        The optimiser looks at the order of the costs and learns from the better half; each of the others
        costs more than all of those.
        """
        first, *corners = cases
        duration = self._settings.search_duration
        nominal = self._walk([Ask(table, first, True) for table in tables], duration, "")
        order = better_half([walk.cost for walk in nominal])
        leaders = [place for place in order if not nominal[place].errors]
        asks = [Ask(tables[place], case) for place in leaders for case in corners]
        others = iter(self._walk(asks, duration, ""))
        costs = {
            place: weighted_cost([nominal[place], *(next(others) for _ in corners)]) for place in leaders
        }
        for place in leaders:
            if costs[place] < self._best[0]:
                self._best = (costs[place], nominal[place].values)
        worst = max(costs.values(), default=0.0)
        return [costs.get(place, worst + nominal[place].cost) for place in range(len(tables))]

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
            tables = [table_with(self._origin, searched, point) for point in points]
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
        for cost, points in [(self._origin_cost, origin), *_cheapest(self._state.generations)]:
            table = table_with(self._origin, searched, points)
            if len(chosen) <= FINALISTS and all(table != other for _, _, other in chosen):
                chosen.append((tuple(points), cost, table))
        cases = robust_cases(self._experiment)
        asks = [Ask(table, case, False) for _, _, table in chosen for case in cases]
        results = self._walk(asks, self._settings.robust_duration, "robust set")
        names = [case.name for case in cases]
        return [
            Finalist(table, points, cost, tuple(zip(names, results[i * len(cases) :], strict=False)))
            for i, (points, cost, table) in enumerate(chosen)
        ]


def _cheapest(generations: Sequence[Generation]) -> list[tuple[float, list[float]]]:
    """Candidates that have walked all cases and may, by their cost, then by their age."""
    every = [
        (item.costs[place], item.points[place]) for item in generations for place in better_half(item.costs)
    ]
    return sorted((pair for pair in every if pair[0] < FALL), key=lambda pair: pair[0])


def best_so_far(start_cost: float, generations: Sequence[Generation]) -> np.ndarray:
    """Cost of the best candidate after each generation, the start's first, shape ``(n + 1,)``."""
    least = [start_cost, *(min(item.costs) for item in generations)]
    return np.minimum.accumulate(np.array(least))
