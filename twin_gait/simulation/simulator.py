"""Simulate an experiment: the one entry, and it touches no disk."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable

from twin_gait.control.controller import ControllerFunction, require_arguments
from twin_gait.experiment import Engine, Experiment
from twin_gait.experiment.problem import Problem, build_problem
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.run import Run, log_table


class SlowControllerWarning(UserWarning):
    """A controller could not be compiled, so the run steps through Python."""


def simulate(
    experiment: Experiment,
    *,
    controller: ControllerFunction | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_compile: Callable[[], None] | None = None,
) -> Run:
    """Run an experiment from start to end.

    A fall or a divergence ends the run and is a result, not an exception: see ``run.status``. A trip of the
    safety monitor is one too, and the run goes on in the safe hold: see ``run.trip``.

    Args:
        experiment: Everything that the run needs.
        controller: Control law of the joints with the signature of
            :func:`twin_gait.core.control_tick.controller_torques`; that one by default. An ``njit``
            function, or a Python function that numba can compile, is fused into the compiled engine. Any
            other steps through the reference engine, slower, with a :class:`SlowControllerWarning`.
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
    problem = build_problem(experiment)
    engine = _engine(problem, controller, on_compile)
    began = time.perf_counter()
    result = engine.run(progress, should_stop)
    wall = time.perf_counter() - began
    return Run(
        experiment=experiment,
        table=problem.table,
        log=log_table(result.rows, engine.layout, problem.table),
        switches=result.switches,
        status=result.status,
        reason=result.reason,
        wall_s=wall,
        body_weight=problem.world.body_weight,
        trip=result.trip,
    )


def _compiles(controller: ControllerFunction) -> bool:
    from twin_gait.simulation.compiling import compiles  # the compiler takes as long to load as all else

    return compiles(controller)


def _engine(
    problem: Problem, controller: ControllerFunction | None, on_compile: Callable[[], None] | None
) -> ReferenceEngine | CompiledEngine:
    if problem.experiment.engine is Engine.PINOCCHIO:
        if controller is not None:
            require_arguments(controller)
        return ReferenceEngine(problem, controller)
    if controller is None or _compiles(controller):
        return CompiledEngine(problem, controller=controller, on_compile=on_compile)
    warnings.warn(
        f"numba cannot compile the controller {getattr(controller, '__name__', controller)!r}; "
        "stepping through Python instead, which takes some twenty times as long",
        SlowControllerWarning,
        stacklevel=3,
    )
    return ReferenceEngine(problem, controller)
