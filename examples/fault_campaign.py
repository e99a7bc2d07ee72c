"""A thousand seeded faults on the guided walk: outcomes, detection times, and invariants of all runs.

Faults of encoders, motors, controller, load sensors and supply vary in kind, joint, time and magnitude; every
log is checked against the bounds of the safety monitor, independently of the code of the monitor. Three
minutes on two cores; page: docs/reference/faults.md.
"""

# %% [markdown]
# `twin-gait faults --set table=my_table.yaml` writes the table of outcomes for another gait table, and
# `twin-gait simulate --fault encoder_freeze:left_knee@4.2s` injects a single fault.

# %%
from dataclasses import asdict

import pandas as pd
from gallery import read_options
from injected_faults.audit import audited_row, stated_reaction
from injected_faults.figure import draw_campaign

from twin_gait import load_experiment, simulate
from twin_gait.control.safety import TripCause
from twin_gait.report.canvas import save
from twin_gait.studies.fault_campaign import draw_faults, outcome_table, simulate_faults

RUNS, SEED, DURATION = 1000, 0, 8.0
EXAMPLE = "encoder_freeze:left_knee@4.2s"


# %%
def count_invariants(table: pd.DataFrame) -> dict:
    """Count the runs in which the invariants hold."""
    tripped = table[table["cause"] != ""]
    return {
        "runs": len(table),
        "within_limits": int(table["within_limits"].sum()),
        "no_empty_value": int((table["null_values"] == 0).sum()),
        "trips": len(tripped),
        "hold_kept": int(tripped["hold_kept"].sum()),
        "in_time": int(tripped["in_time"].sum()),
        "fastest_joint_rad_per_s": float(tripped["speed_after_rad_per_s"].max()),
        "fastest_sinking_m_per_s": float(tripped["sinking_m_per_s"].max()),
    }


# %%
if __name__ == "__main__":
    form = read_options("fault_campaign")
    experiment = load_experiment(
        "treadmill_guided", [f"duration_s={3.0 if form.quick else DURATION}"]
    ).experiment
    faults = draw_faults(experiment, 10 if form.quick else RUNS, SEED)
    table = simulate_faults(experiment, faults, row=audited_row, workers=form.workers)
    outcomes = outcome_table(table)
    print(outcomes.to_string(index=False))
    table.to_csv(form.out / "faults.csv", index=False, lineterminator="\n", float_format="%.6g")

    example = load_experiment(
        "treadmill_guided", [f"duration_s={DURATION}", f"faults=['{EXAMPLE}']"]
    ).experiment
    save(draw_campaign(table, simulate(example)), form.out / "faults.png")
    safety, limits = experiment.control.safety, experiment.control.limits
    form.write_results(
        {
            "outcomes": outcomes.to_dict("records"),
            "held": count_invariants(table),
            "limits": {
                joint: {"torque_Nm": limits[joint].torque, "current_A": limits[joint].current}
                for joint in experiment.joints
            },
            "safety": asdict(safety),
            "reaction_ms": {str(cause): 1e3 * stated_reaction(cause, safety) for cause in TripCause},
        }
    )
