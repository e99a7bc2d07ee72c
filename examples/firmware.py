"""How large is the printed firmware, how long is its longest tick, and is it equal to the simulation?

Every shipped table is printed, built for this machine and for a Cortex-M4F, and compared over 20 s and with
faults. Then every constant of each unit is changed alone, to count the changes that the test of the printed
project detects. Some minutes, with gcc, gcc-arm-none-eabi and qemu-system-arm; page:
docs/reference/firmware.md.
"""

# %% [markdown]
# `twin-gait firmware treadmill_guided --verify` does this for one table.

# %%
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
from gallery import read_options
from printed_c.changed_constants import REASONS, Unit, classified

from twin_gait import load_experiment
from twin_gait.firmware.verification import verify

TABLES = {
    "treadmill_guided": ("treadmill_guided",),
    "treadmill_pre_swing": ("treadmill_guided", "table=treadmill_pre_swing"),
    "treadmill_40": ("treadmill_40",),
    "treadmill_ankle": ("treadmill_ankle",),
    "treadmill_start_stop": ("treadmill_start_stop",),
    "bench_leg": ("bench_leg",),
}


def row_of(name: str, preset: str, *changes: str) -> dict[str, Any]:
    """Return sizes, instructions and differences of a table."""
    found = verify(load_experiment(preset, changes).experiment)
    double, single, target, loop = (check["found"] for check in found["checks"])
    board, central = (target["bytes"][unit] for unit in ("joint_board", "gait_controller"))
    return {
        "table": name,
        "board: flash [B]": board["flash"],
        "board: RAM [B]": board["ram"],
        "controller: flash [B]": central["flash"],
        "controller: RAM [B]": central["ram"],
        "instructions: mean": round(target["instructions_mean"]),
        "worst tick": target["instructions_worst"],
        "numbers compared": double["numbers"],
        "other bits in double": double["differing"],
        "on the target": target["differing"],
        "switches in float move by [ticks]": single["largest_shift_ticks"],
        "largest RMSE of a current [A]": f"{max(single['current_rmse_A'].values()):.1e}",
        "processor in the loop": loop["outcome"],
    }


# %% [markdown]
# A change that is not detected has no effect, for a reason that is checked for each constant, or is counted
# as not detected.


# %%
def constants_of(experiment: str, units: Sequence[str], step: int = 1) -> list[dict[str, Any]]:
    """Count the changed constants of each unit that the test of a project detects, or the reasons why not."""
    rows = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        command = [sys.executable, "-m", "twin_gait", "firmware", experiment, "--out", folder / "c"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        for unit in units:
            found = Unit(folder / "c", unit, folder / unit)
            counts, unexplained = classified(found, step)
            print(
                unit,
                dict(counts),
                *(f"{item.table} {item.field} {item.old}" for item in unexplained),
                sep="\n",
            )
            row = {"unit": f"`{unit}`", "constants": len(found.changes)}
            rows.append(row | {reason: counts[reason] for reason in REASONS})
    return rows


# %%
if __name__ == "__main__":
    form = read_options("firmware")
    chosen = {"bench_leg": ("bench_leg", "duration_s=3")} if form.quick else TABLES
    rows = [row_of(name, *words) for name, words in chosen.items()]
    if form.quick:
        constants = constants_of("bench_leg", ("joint_board",), step=50)
    else:
        constants = constants_of(
            "treadmill_guided", ("joint_board", "gait_controller", "exoskeleton", "can_codec")
        )
    print(pd.DataFrame(rows).T.to_string(header=False))
    form.write_results(
        {
            "rows": rows,
            "constants": constants,
            "worst_instructions": max(row["worst tick"] for row in rows),
            "numbers": sum(row["numbers compared"] for row in rows),
            "other_bits": sum(row["other bits in double"] + row["on the target"] for row in rows),
            "current_rmse_A": max(float(row["largest RMSE of a current [A]"]) for row in rows),
        }
    )
