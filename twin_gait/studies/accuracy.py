"""Integration error of a run: its difference to the same run at a tenth of its step."""

from dataclasses import replace
from typing import Any, Unpack

import numpy as np

from twin_gait.experiment.experiment import Integration
from twin_gait.gait.table import TICK
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulator import simulate
from twin_gait.studies.jobs import WorkCallbacks

REFINEMENT = 10


def step_error(run: Run, **watch: Unpack[WorkCallbacks]) -> dict[str, Any]:
    """Compare a run with the same run at a tenth of its integration step.

    A gait switches phase at whole ticks, so a tiny difference occasionally shifts a switch by one tick, and
    after that the two walks differ by the motion of a leg in this time. The reported error is the difference
    before the first such shift, which is due to the integrator alone.

    Returns the steps of both runs, the largest difference of any driven joint's angle, and the time from
    which the phases differ, or None.
    """
    integration = run.experiment.resolved_integration
    fine = Integration(method=integration.method, step=integration.step / REFINEMENT)
    reference = simulate(replace(run.experiment, integration=fine), **watch)
    common = min(len(run.log), len(reference.log))
    log, other = run.log[:common], reference.log[:common]
    phases = [f"{side}_phase" for side in run.sides]
    differ = (log[phases] != other[phases]).any(axis=1).to_numpy()
    same = max(1, int(np.argmax(differ))) if differ.any() else common
    names = [f"{side}_{joint}_angle_rad" for side in run.sides for joint in run.experiment.joints]
    return {
        "step_s": integration.step,
        "reference_step_s": fine.step,
        "largest_angle_error_rad": float((log[names] - other[names])[:same].abs().to_numpy().max()),
        "first_slip_s": None if same == common else same * TICK,
    }
