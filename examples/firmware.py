"""What does the printed firmware weigh, how long is its longest tick, and is it the simulation's controller?

Every shipped table is printed, built for this machine and for a Cortex-M4F, and compared over 20 s and over
faults. Ten minutes, with gcc, gcc-arm-none-eabi and qemu-system-arm; page: docs/firmware.md.
"""

# %% [markdown]
# `twin-gait firmware treadmill --verify` does this for one table.

# %%
from typing import Any

import pandas as pd
from gallery import form_of

from twin_gait import load_experiment
from twin_gait.firmware.project import print_project
from twin_gait.firmware.verify import verify

TABLES = {
    "treadmill": ("treadmill",),
    "treadmill_pre_swing": ("treadmill", "table=treadmill_pre_swing"),
    "treadmill_40": ("treadmill_40",),
    "treadmill_start_stop": ("treadmill_start_stop",),
    "bench_leg": ("bench_leg",),
}


def row_of(name: str, preset: str, *changes: str) -> dict[str, Any]:
    """Sizes, instructions and differences of a table."""
    experiment = load_experiment(preset, changes).experiment
    records = print_project(experiment).manifest({"provenance": {}})["record_bytes"]
    found = verify(experiment)
    double, single, target, loop = (check.figures for check in found.checks)
    return {
        "table": name,
        "joint board: flash [B]": target["joint_board_flash_bytes"],
        "RAM [B]": records["JointBoard"],
        "gait controller: flash [B]": target["gait_controller_flash_bytes"],
        " RAM [B]": records["GaitController"],
        "instructions a tick: mean": round(target["instructions_mean"]),
        "worst": target["instructions_worst"],
        "numbers compared": double["numbers"],
        "other bits: double": double["differing"],
        "target": target["differing"],
        "float: switches move by [ticks]": single["largest_shift_ticks"],
        "largest RMSE of a current [A]": f"{max(single['current_rmse_A'].values()):.1e}",
        "in the loop": loop["outcome"],
        "20 s in [s]": round(loop["wall_s"], 1),
    }


# %%
if __name__ == "__main__":
    form = form_of("firmware")
    chosen = {"bench_leg": ("bench_leg", "duration_s=3")} if form.quick else TABLES
    rows = [row_of(name, *words) for name, words in chosen.items()]
    print(pd.DataFrame(rows).T.to_string(header=False))
    form.keep({"rows": rows, "worst_instructions": max(row["worst"] for row in rows)})
