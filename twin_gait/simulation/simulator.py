"""Simulate an experiment: the one entry, and it touches no disk."""

import reprlib
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import islice

from twin_gait.control.controller import Controller, UncompiledControllerError
from twin_gait.exceptions import JobError, ParameterError, TwinGaitError
from twin_gait.experiment.experiment import Engine, Experiment
from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.engine import EpisodeEngine
from twin_gait.simulation.lane_engine import (
    MIN_BLOCK_SIZE,
    LaneEngine,
    block_key,
    is_lane_loop_cached,
    lane_loop,
)
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run
from twin_gait.simulation.scripted_engine import ScriptedEngine
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

FEWEST_IN_ALL = 2 * WIDTH  # for which it pays to hand blocks over, and to compile a loop for them
# Of the logs of a block, all of which are in memory at once: 32 walks of a minute, 0.7 GB with the 46 columns
# that a summary reads.
MOST_TICKS = 2_000_000
ALWAYS_KEPT = ("_phase", "mode")  # ends of the names of columns by which a run tells when its legs walk
_SETUP_BATCH_SIZE = 4 * WIDTH  # episodes that are laid out at a time, to find those that are alike


class SlowControllerWarning(UserWarning):
    """A controller could not be compiled, so the run steps through Python."""


def simulate(
    experiment: Experiment,
    *,
    controller: Controller | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Run:
    """Run an experiment from start to end.

    A fall or a divergence ends the run and is a result, not an exception: see ``run.status``. A trip of the
    safety monitor is one too, and the run goes on in the safe hold: see ``run.trip``.

    Args:
        experiment: Everything that the run needs.
        controller: Takes the place of the one that ``control.mode`` names. A tick that numba can compile is
            fused into the compiled engine. Any other steps through the reference engine, slower, with a
            :class:`SlowControllerWarning`.
        progress: Called now and then with ticks done and ticks in all.
        should_stop: Asked now and then; True ends the run and marks it as interrupted.
        on_compile: Called if the engine has to be compiled for this model first, which takes 10 to 20 s.

    Returns:
        The run with its log.

    Raises:
        ModelError: If the URDF cannot be used.
        ParameterError: If something in the experiment does not fit together, or the controller does not take
            or give what it should.
        MeasurementError: If, without a safety monitor, the state machine is handed something not finite.
    """
    if not isinstance(experiment, Experiment):
        raise ParameterError(
            f"simulate: expected an Experiment, got {reprlib.repr(experiment)}; "
            "load_experiment(NAME).experiment is one"
        )
    return create_engine(build_setup(experiment, controller), on_compile).run(progress, should_stop)


def create_engine(setup: SimulationSetup, on_compile: Callable[[], None] | None = None) -> EpisodeEngine:
    """The engine that an experiment asks for, at tick 0."""
    if setup.experiment.engine is Engine.COMPILED:
        try:
            engine = ScriptedEngine if setup.experiment.events else CompiledEngine
            return engine(setup, on_compile=on_compile)
        except UncompiledControllerError as error:
            told = f"{error}; stepping through Python instead, which takes some twenty times as long"
            warnings.warn(told, SlowControllerWarning, stacklevel=3)
    return ReferenceEngine(setup)


def group_into_blocks(kinds: Sequence[Hashable | None], ticks: Sequence[int]) -> list[tuple[int, ...]]:
    """Cut episodes into blocks of the same kind (None for one that runs alone) and of similar duration.

    Returns every position once: those that run one by one in front, then blocks for the lanes of one loop.
    """
    groups = defaultdict[Hashable, list[int]](list)
    for place in sorted(range(len(kinds)), key=ticks.__getitem__):
        groups[kinds[place]].append(place)
    alone, blocks = groups.pop(None, []), []
    for group in groups.values():
        while group:  # the longest first: the rest, which runs alone, is short
            size = _most(ticks[group[-1]])
            block, group = group[-size:], group[:-size]
            if len(block) >= MIN_BLOCK_SIZE:
                blocks.append(tuple(block))
            else:
                alone += block
    return [*((place,) for place in sorted(alone)), *blocks]


def _most(ticks: int) -> int:
    """Episodes of a duration whose logs fit into memory together."""
    return max(1, min(WIDTH, MOST_TICKS // max(1, ticks)))


def simulate_blocks(
    experiments: Iterable[Experiment], *, columns: tuple[str, ...] | None = None
) -> Iterator[tuple[int, Run]]:
    """Run many experiments; each run is the same, bit for bit, as that of :func:`simulate`.

    A fall, a trip or a divergence ends its own episode only.

    Args:
        experiments: Taken as they are needed, some more than a block at a time.
        columns: Ends of the names of the columns that the logs keep; all by default. Time, phases and
            operating mode stay.

    Yields:
        Position and run of each, in the order in which they are done.

    Raises:
        JobFailed: If one cannot be run; of those that are laid out with it none is.
    """
    waiting, first = iter(experiments), 0
    while engines := _create_engines(islice(waiting, _SETUP_BATCH_SIZE), first):
        for block in group_into_blocks(
            _kinds(engines), [engine.setup.experiment.n_ticks for engine in engines]
        ):
            runs = _run([engines[place] for place in block], first + block[0], columns)
            for place in reversed(block):  # each is gone when it has been looked at
                yield first + place, runs.pop()
        first += len(engines)


def _create_engines(experiments: Iterable[Experiment], first: int) -> list[EpisodeEngine]:
    """Engines of some episodes, of which the first has a number; JobFailed if one cannot be laid out."""
    engines: list[EpisodeEngine] = []
    try:
        for experiment in experiments:
            engines.append(create_engine(build_setup(experiment)))
    except TwinGaitError as error:
        raise JobError(first + len(engines), str(error)) from error
    return engines


def _kinds(engines: Sequence[EpisodeEngine]) -> list[Hashable | None]:
    """What those share that may share a block; None where a loop would have to be compiled for a few."""
    kinds = [block_key(engine) for engine in engines]
    numbers = Counter(kinds)
    kept = {kind for kind, engine in zip(kinds, engines, strict=True) if is_lane_loop_cached(engine)}
    return [kind if numbers[kind] >= FEWEST_IN_ALL or kind in kept else None for kind in kinds]


def _run(engines: Sequence[EpisodeEngine], first: int, columns: tuple[str, ...] | None) -> list[Run]:
    """Runs of the episodes of a block, or of a single one.

    Raises JobFailed if a single one cannot be run, telling that it is the one with this number.
    """
    names, kept = engines[0].layout.names, None
    if columns is not None:
        kept = [place for place, name in enumerate(names) if name.endswith((*columns, *ALWAYS_KEPT))]
    try:
        if len(engines) > 1:
            return LaneEngine([engine for engine in engines if isinstance(engine, CompiledEngine)]).run(kept)
        return [engine.run(columns=kept) for engine in engines]
    except TwinGaitError as error:
        raise JobError(first, str(error)) from error


def precompile(experiment: Experiment, total: int, on_compile: Callable[[], None] | None = None) -> int:
    """Compile what many like an experiment need, and keep it; if it cannot be run, that is told later.

    Returns how many of them to hand over at a time, so that they can be run as a block.
    """
    with suppress(TwinGaitError):
        engine = create_engine(build_setup(experiment), on_compile)
        if total >= FEWEST_IN_ALL and isinstance(engine, CompiledEngine) and block_key(engine) is not None:
            lane_loop(engine, on_compile)
            return _most(experiment.n_ticks)
    return 1
