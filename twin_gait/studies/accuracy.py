"""How far a run is from the same run at a tenth of its integration step."""

from dataclasses import replace
from typing import Any, Unpack

import numpy as np

from twin_gait.experiment import Integration
from twin_gait.simulation import Run, simulate
from twin_gait.studies.jobs import Watch

REFINEMENT = 10


def step_error(run: Run, **watch: Unpack[Watch]) -> dict[str, Any]:
    """Steps of both runs, largest difference of the angle of any driven joint, and whether the phases agree.

    A gait switches phase by whole ticks, so a tiny difference now and then moves a switch by one tick,
    and from there the two walks differ by what a leg moves in that time. The error before the first
    switch at different ticks is the integrator's own.
    """
    integration = run.experiment.stepping
    fine = Integration(method=integration.method, step=integration.step / REFINEMENT)
    reference = simulate(replace(run.experiment, integration=fine), **watch)
    names = [f"{side}_{joint}_angle_rad" for side in run.sides for joint in run.experiment.joints]
    common = min(len(run.log), len(reference.log))
    difference = np.abs(run.log[names].to_numpy()[:common] - reference.log[names].to_numpy()[:common])
    phases = [f"{side}_phase" for side in run.sides]
    differ = (run.log[phases][:common] != reference.log[phases][:common]).any(axis=1).to_numpy()
    same = max(1, int(np.argmax(differ)) if differ.any() else common)
    return {
        "step_s": integration.step,
        "reference_step_s": fine.step,
        "largest_angle_error_rad": float(difference.max()),
        "largest_angle_error_before_first_slip_rad": float(difference[:same].max()),
        "first_slip_s": None if same == common else same * 1e-3,
        "same_phase_order": [(item.side, item.target) for item in run.switches]
        == [(item.side, item.target) for item in reference.switches],
    }
