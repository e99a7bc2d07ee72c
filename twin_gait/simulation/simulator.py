"""Simulate an experiment: the one entry, and it touches no disk."""

import time
import warnings
from collections.abc import Callable, Sequence

from twin_gait.control.controller import Controller, UncompiledControllerError
from twin_gait.experiment import Engine, Experiment
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.engine import EngineResult, log_layout
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run, log_table


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
    engine = engine_of(build_problem(experiment, controller), on_compile)
    began = time.perf_counter()
    result = engine.run(progress, should_stop)
    return run_of(engine.problem, result, time.perf_counter() - began)


def run_of(
    problem: Problem, result: EngineResult, wall_s: float, columns: Sequence[int] | None = None
) -> Run:
    """The run of a problem that an engine has brought to its end.

    ``result``: what it gave. ``wall_s``: how long it took in [s]. ``columns``: positions of the columns of
    the log that were kept; all by default.
    """
    return Run(
        experiment=problem.experiment,
        table=problem.table,
        log=log_table(result.rows, log_layout(problem), problem.table, columns),
        switches=result.switches,
        status=result.status,
        reason=result.reason,
        wall_s=wall_s,
        body_weight=problem.world.body_weight,
        trip=result.trip,
        traffic=result.traffic,
    )


def engine_of(
    problem: Problem, on_compile: Callable[[], None] | None = None
) -> ReferenceEngine | CompiledEngine:
    """The engine that an experiment asks for, at tick 0."""
    if problem.experiment.engine is Engine.COMPILED:
        try:
            return CompiledEngine(problem, on_compile=on_compile)
        except UncompiledControllerError as error:
            warnings.warn(
                f"{error}; stepping through Python instead, which takes some twenty times as long",
                SlowControllerWarning,
                stacklevel=3,
            )
    return ReferenceEngine(problem)
