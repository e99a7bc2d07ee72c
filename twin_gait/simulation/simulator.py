"""Simulate an experiment: the one entry, and it touches no disk."""

from __future__ import annotations

import time
from collections.abc import Callable

from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Engine, Experiment
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.pinocchio_engine import ControllerFactory, PinocchioEngine
from twin_gait.simulation.problem import Problem, build_problem
from twin_gait.simulation.run import Run, log_table


def simulate(
    experiment: Experiment,
    *,
    controllers: ControllerFactory | None = None,
    progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Run:
    """Run an experiment from start to end.

    A fall or a divergence ends the run and is a result, not an exception: see ``run.status``.

    Args:
        experiment: Everything that the run needs.
        controllers: Makes the controller of each joint; the thesis's impedance on friction
            compensation by default.
        progress: Called now and then with ticks done and ticks in all.
        should_stop: Asked now and then; True ends the run and marks it as interrupted.

    Returns:
        The run with its log.

    Raises:
        ModelError: If the URDF cannot be used.
        ParameterError: If something in the experiment does not fit together.
        MeasurementError: If a controller or sensor hands the state machine something not finite.
    """
    problem = build_problem(experiment)
    engine = _engine(problem, controllers)
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
    )


def _engine(problem: Problem, controllers: ControllerFactory | None) -> PinocchioEngine | CompiledEngine:
    if problem.experiment.engine is Engine.PINOCCHIO:
        return PinocchioEngine(problem, controllers)
    if controllers is not None:
        raise ParameterError("controllers written in Python need engine: pinocchio")
    return CompiledEngine(problem)
