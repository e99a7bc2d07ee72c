"""Change the gait table: let the knee flex further in swing and see what the walk makes of it.

A gait table is a frozen value. ``dataclasses.replace`` makes a changed copy; the file on disk and the preset
stay as they are. The same can be done in a YAML file or with ``--set``.
"""

import math
from dataclasses import replace

import numpy as np

from twin_gait import GaitPhase, load_experiment, simulate


def shift_equilibrium(table, phase, joint, degrees):
    """Return a copy of a table with the equilibrium angle of one joint in one phase shifted."""
    parameters = table.phases[phase]
    impedance = parameters.joints[joint]
    shifted = replace(impedance, equilibrium_angle=impedance.equilibrium_angle + math.radians(degrees))
    joints = {**parameters.joints, joint: shifted}
    phases = {**table.phases, phase: replace(parameters, joints=joints)}
    return replace(table, phases=phases)


def main(duration: float = 7.0) -> None:
    experiment = load_experiment("treadmill", [f"duration_s={duration}"]).experiment
    for degrees in (0.0, 5.0):
        table = shift_equilibrium(experiment.table, GaitPhase.SWING_FLEXION, "knee", degrees)
        run = simulate(replace(experiment, table=table))
        settled = run.log[run.log["time_s"] > 1.5]
        peak = np.degrees(settled["left_knee_angle_rad"].max())
        clearance = settled.loc[settled["left_phase"] == GaitPhase.SWING_EXTENSION, "left_foot_clearance_m"]
        print(
            f"knee equilibrium in swing flexion {degrees:+g}°: {run.status}, peak flexion {peak:.1f}°, "
            f"highest foot clearance {1000 * clearance.max():.0f} mm"
        )


if __name__ == "__main__":
    main()
    # Homework: how far can you shift it before the wearer falls? Which threshold would you move along?
