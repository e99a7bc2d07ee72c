"""Integration error of a run, and of the same run at other steps: the difference to a tenth of its step."""

import math
from dataclasses import replace
from typing import Any, Unpack

import numpy as np

from twin_gait.experiment.experiment import Integration
from twin_gait.gait.table import TICK
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate
from twin_gait.studies.jobs import WorkCallbacks

REFINEMENT = 10
STEPS = (0.1e-3, 0.25e-3, 0.5e-3, 1e-3)  # Steps in [s] that are compared with the step of a run.


def step_error(run: Run, **watch: Unpack[WorkCallbacks]) -> dict[str, Any]:
    """Compare a run, and the same run at other steps, with the run at a tenth of its integration step.

    A gait switches phase at whole ticks, so a tiny difference occasionally shifts a switch by one tick, and
    after that the two walks differ by the motion of a leg in this time. The reported error is the difference
    before the first such shift, which is due to the integrator alone.

    Returns the steps of both runs, the largest difference of the angle of any joint that a drive or the own
    gait moves, and the time from which the phases differ, or None; ``steps`` has these values and the
    computing time for the step of the run and all of :data:`STEPS` that are coarser than the reference.
    """
    step = run.experiment.resolved_integration.step
    reference = _at(run, step / REFINEMENT, **watch)
    coarser = (each for each in STEPS if each > 1.5 * step / REFINEMENT)
    others = (each for each in coarser if not math.isclose(each, step))
    runs = {each: run if each == step else _at(run, each, **watch) for each in sorted((step, *others))}
    rows = [{"step_s": each, **_difference(other, reference)} for each, other in runs.items()]
    row_at_step = next(row for row in rows if row["step_s"] == step)
    found = {name: value for name, value in row_at_step.items() if name != "wall_s"}
    return {**found, "reference_step_s": step / REFINEMENT, "steps": rows}


def _at(run: Run, step: float, **watch: Unpack[WorkCallbacks]) -> Run:
    """Simulate the experiment of a run at another step in [s]."""
    integration = Integration(method=run.experiment.resolved_integration.method, step=step)
    return simulate(replace(run.experiment, integration=integration), **watch)


def _difference(run: Run, reference: Run) -> dict[str, Any]:
    """Return the largest difference of an angle before the phases differ, their time, and computing time."""
    common = min(len(run.log), len(reference.log))
    log, other = run.log[:common], reference.log[:common]
    phases = [name for name in log if str(name).endswith("_phase")]
    differ = (log[phases] != other[phases]).any(axis=1).to_numpy()
    same = max(1, int(np.argmax(differ))) if differ.any() else common
    names = [f"{leg.side}_{joint}_angle_rad" for leg in run.leg_records() for joint in leg.angles]
    return {
        "largest_angle_error_rad": float((log[names] - other[names])[:same].abs().to_numpy().max()),
        "first_slip_s": None if same == common else same * TICK,
        "wall_s": run.wall_s,
    }
