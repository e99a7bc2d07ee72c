"""Simulation of one experiment or of many, without access to files except the code cache."""

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

FEWEST_IN_ALL = 2 * WIDTH  # Fewest episodes for which the compilation of a loop for blocks saves time.
# Most ticks in the logs of a block, which are all in memory at the same time: 32 walks of a minute, or 0.7 GB
# with the 46 columns that a summary reads.
MOST_TICKS = 2_000_000
ALWAYS_KEPT = ("_phase", "mode")  # Ends of the names of columns from which a run derives when its legs walk.
_SETUP_BATCH_SIZE = 4 * WIDTH  # Number of episodes that are prepared at a time and grouped into blocks.


class SlowControllerWarning(UserWarning):
    """Warning that a controller could not be compiled, so that the run uses the reference engine."""


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
    safety monitor is a result too, and the run continues in the safe hold: see ``run.trip``.

    Args:
        experiment: Everything that the run needs.
        controller: Controller that replaces the one of ``control.mode``. If numba can compile its functions,
            they become a part of the compiled loop. Otherwise the run uses the reference engine, which is
            slower, and issues a :class:`SlowControllerWarning`.
        progress: Called regularly with the ticks done and the total number of ticks.
        should_stop: Called regularly; True ends the run and marks it as interrupted.
        on_compile: Called if the engine has to be compiled for this model first, which takes 10 to 20 s.

    Returns:
        The run with its log.

    Raises:
        ModelError: If the URDF cannot be used.
        ParameterError: If parts of the experiment are incompatible, or the controller does not accept or
            return the values that it should.
        MeasurementError: If, without a safety monitor, the state machine receives a value that is not finite.
    """
    if not isinstance(experiment, Experiment):
        raise ParameterError(
            f"simulate: expected an Experiment, got {reprlib.repr(experiment)}; "
            "load_experiment(NAME).experiment is one"
        )
    return create_engine(build_setup(experiment, controller), on_compile).run(progress, should_stop)


def create_engine(setup: SimulationSetup, on_compile: Callable[[], None] | None = None) -> EpisodeEngine:
    """Return the engine that an experiment selects, at tick 0."""
    if setup.experiment.engine is Engine.COMPILED:
        try:
            engine = ScriptedEngine if setup.experiment.events else CompiledEngine
            return engine(setup, on_compile=on_compile)
        except UncompiledControllerError as error:
            text = f"{error}; the run continues in plain Python, which is about twenty times slower"
            warnings.warn(text, SlowControllerWarning, stacklevel=3)
    return ReferenceEngine(setup)


def group_into_blocks(kinds: Sequence[Hashable | None], ticks: Sequence[int]) -> list[tuple[int, ...]]:
    """Group episodes into blocks of the same kind (None for one that runs alone) and of similar duration.

    ``kinds`` and ``ticks``: kind and duration in ticks of each episode. Returns every position once: first
    the episodes that run one by one, then the blocks.
    """
    groups = defaultdict[Hashable, list[int]](list)
    for index in sorted(range(len(kinds)), key=ticks.__getitem__):
        groups[kinds[index]].append(index)
    alone, blocks = groups.pop(None, []), []
    for group in groups.values():
        while group:  # the longest first, because the shortest may be left over and run alone
            size = _most(ticks[group[-1]])
            block, group = group[-size:], group[:-size]
            if len(block) >= MIN_BLOCK_SIZE:
                blocks.append(tuple(block))
            else:
                alone += block
    return [*((index,) for index in sorted(alone)), *blocks]


def _most(ticks: int) -> int:
    """Return the number of episodes of a duration whose logs fit into memory together, at most ``WIDTH``."""
    return max(1, min(WIDTH, MOST_TICKS // max(1, ticks)))


def simulate_blocks(
    experiments: Iterable[Experiment], *, columns: tuple[str, ...] | None = None
) -> Iterator[tuple[int, Run]]:
    """Run many experiments; each run is identical, bit for bit, to the result of :func:`simulate`.

    A fall, a trip or a divergence affects only its own episode.

    Args:
        experiments: Read as they are needed, several blocks at a time.
        columns: Ends of the names of the columns that the logs keep; all by default. Time, phases and
            operating mode are always kept. Torques of wearer, pushes and imposed motion are left out if they
            are zero throughout.

    Yields:
        Position and run of each experiment, in the order in which the runs are completed.

    Raises:
        JobError: If an experiment cannot be run; none of those that are prepared together with it is run.
    """
    waiting, first = iter(experiments), 0
    while engines := _create_engines(islice(waiting, _SETUP_BATCH_SIZE), first):
        for block in group_into_blocks(
            _kinds(engines), [engine.setup.experiment.n_ticks for engine in engines]
        ):
            runs = _run([engines[index] for index in block], first + block[0], columns)
            for index in reversed(block):  # the memory of each run is freed when the caller has used it
                yield first + index, runs.pop()
        first += len(engines)


def _create_engines(experiments: Iterable[Experiment], first: int) -> list[EpisodeEngine]:
    """Return the engines of experiments numbered from ``first``; raises JobError if one cannot be built."""
    engines: list[EpisodeEngine] = []
    try:
        for experiment in experiments:
            engines.append(create_engine(build_setup(experiment)))
    except TwinGaitError as error:
        raise JobError(first + len(engines), str(error)) from error
    return engines


def _kinds(engines: Sequence[EpisodeEngine]) -> list[Hashable | None]:
    """Return the kind of each episode, None if a loop would have to be compiled for a few episodes."""
    kinds = [block_key(engine) for engine in engines]
    numbers = Counter(kinds)
    kept = {kind for kind, engine in zip(kinds, engines, strict=True) if is_lane_loop_cached(engine)}
    return [kind if numbers[kind] >= FEWEST_IN_ALL or kind in kept else None for kind in kinds]


def _run(engines: Sequence[EpisodeEngine], first: int, columns: tuple[str, ...] | None) -> list[Run]:
    """Run the episodes of a block, or a single one.

    ``columns``: see :func:`simulate_blocks`. Raises JobError with the number ``first`` if a single episode
    cannot be run.
    """
    names, kept = engines[0].layout.names, None
    if columns is not None:
        wanted, zero = (*columns, *ALWAYS_KEPT), _zero_columns(engines[0])
        kept = [
            index for index, name in enumerate(names) if name.endswith(wanted) and not name.endswith(zero)
        ]
    try:
        if len(engines) > 1:
            return LaneEngine([engine for engine in engines if isinstance(engine, CompiledEngine)]).run(kept)
        return [engine.run(columns=kept) for engine in engines]
    except TwinGaitError as error:
        raise JobError(first, str(error)) from error


def _zero_columns(engine: EpisodeEngine) -> tuple[str, ...]:
    """Return the ends of the names of external torques that are zero in every tick.

    They are equal in all episodes of a block.
    """
    found: tuple[str, ...] = ()
    if not engine.number("has_wearer_torques"):
        found += ("_voluntary_torque_Nm", "_passive_torque_Nm")
    if not engine.scripted and engine.setup.world.imposed_motion is None:
        found += ("_disturbance_torque_Nm",)
    return found


def precompile(experiment: Experiment, total: int, on_compile: Callable[[], None] | None = None) -> int:
    """Compile the loops for many experiments like one, and store them in the code cache.

    An experiment that cannot be run raises no error here. Returns the number of experiments to pass to
    :func:`simulate_blocks` at a time, so that they can be run as a block. ``total``: number of experiments.
    """
    with suppress(TwinGaitError):
        engine = create_engine(build_setup(experiment), on_compile)
        if total >= FEWEST_IN_ALL and isinstance(engine, CompiledEngine) and block_key(engine) is not None:
            lane_loop(engine, on_compile)
            return _most(experiment.n_ticks)
    return 1
