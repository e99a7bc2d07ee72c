"""Runaways of a joint's command: does the monitor prevent a fall without false trips?

Two thousand seeded runaways on the guided walk, over rate, time and joint, half of them with a second fault,
with and without the bound on the deviation of the command from its setpoint; fewer on the other presets. Then
the deviation in walks without a fault. Twenty minutes on one core; page: docs/reference/faults.md.
"""

# %% [markdown]
# `twin-gait simulate --fault controller_runaway:right_knee@2.679s=397.27Nm/s` injects a single runaway.

# %%
from functools import partial
from typing import Any

import pandas as pd
from gallery import read_options
from injected_faults.runaways import (
    RATES,
    WITHOUT,
    draw_runaway_map,
    draw_runaways,
    draw_walkers,
    runaway_row,
    walker_of,
    walker_row,
    with_faults,
)

from twin_gait import Experiment, load_experiment, presets
from twin_gait.report.canvas import save
from twin_gait.studies.batch import override_experiment, run_episodes

SEED = 0
NOISE = {"sensors.ideal": False, "sensors.angle_noise_rad": 1e-4}
DEFAULT = "treadmill_guided"
# Runs, duration and time of the earliest runaway in [s]; by then the legs walk.
CAMPAIGNS = {
    DEFAULT: (2000, 10.0, 2.0),
    "treadmill_40": (500, 10.0, 2.0),
    "treadmill_start_stop": (500, 18.0, 1.0),
    "treadmill_ankle": (500, 10.0, 2.0),
    "overground": (200, 14.0, 2.0),
}
WALKERS, WALK_DURATION = 300, 12.0


# %%
def simulate_runaways(experiment: Experiment, count: int, first_time: float, workers: int) -> pd.DataFrame:
    """Simulate seeded runaways and return a row for each."""
    faults = draw_runaways(experiment, count, SEED, first_time)
    return pd.DataFrame(run_episodes(partial(with_faults, experiment), runaway_row, faults, workers=workers))


def outcome_rows(preset: str, table: pd.DataFrame) -> list[dict[str, Any]]:
    """Count the outcomes of runaways, alone and with a second fault."""
    rows = []
    for faults, block in ((1, table[table["second"] == ""]), (2, table[table["second"] != ""])):
        tripped, fell, held = block["cause"] != "", block["outcome"] == "fell", block["outcome"] == "held"
        noticed = block[block["cause"] == "command_against_setpoint"]
        late = 1e3 * (noticed["trip_time_s"] - noticed["time_s"])
        rows.append(
            {
                "preset": preset,
                "faults": faults,
                "runs": len(block),
                "falls without a trip": int((fell & ~tripped).sum()),
                "falls after a trip": int((fell & tripped).sum()),
                "held": int(held.sum()),
                "others": int((~fell & ~held).sum()),
                "trips on the deviation": len(noticed),
                "after: median": f"{late.median():.0f} ms" if len(late) else "–",
                "longest": f"{late.max():.0f} ms" if len(late) else "–",
            }
        )
    return rows


# %% [markdown]
# ## Walks without a fault
# The bound is too high to be reached here: the largest deviation shows its distance from the usual bound.


# %%
def shipped_rows(names: list[str], changes: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the largest deviations in presets, with ideal and with noisy encoders."""
    rows = []
    for name in names:
        experiment = override_experiment(load_experiment(name).experiment, changes)
        ideal, noisy = run_episodes(partial(walker_of, experiment), walker_row, [{}, NOISE])
        rows.append(
            {
                "preset": name,
                "ideal encoders": f"{ideal['deviation_Nm']:.2f} N·m",
                "noise of 0.1 mrad": f"{noisy['deviation_Nm']:.2f} N·m",
            }
        )
    return rows


def random_walks(count: int, duration: float, workers: int) -> dict[str, Any]:
    """Simulate random wearers and settings, and return the deviations of those who walk."""
    experiment = load_experiment(DEFAULT, [f"duration_s={duration}"]).experiment
    rows = run_episodes(
        partial(walker_of, experiment), walker_row, draw_walkers(count, SEED), workers=workers
    )
    walked = [row["deviation_Nm"] for row in rows if row["outcome"] == "walked"]
    return {"drawn": count, "walked": len(walked), "largest_Nm": max(walked, default=0.0)}


# %%
if __name__ == "__main__":
    form = read_options("runaways")
    campaigns = {DEFAULT: (8, 6.0, 1.0)} if form.quick else CAMPAIGNS
    rows, tables = [], {}
    for preset, (count, duration, first_time) in campaigns.items():
        experiment = load_experiment(preset, [f"duration_s={duration}"]).experiment
        tables[preset] = simulate_runaways(experiment, count, first_time, form.workers)
        rows += outcome_rows(preset, tables[preset])
    count, duration, first_time = campaigns[DEFAULT]
    unbounded = override_experiment(load_experiment(DEFAULT, [f"duration_s={duration}"]).experiment, WITHOUT)
    before = simulate_runaways(unbounded, count, first_time, form.workers)
    print(pd.DataFrame(rows).T.to_string(header=False))
    tables[DEFAULT].to_csv(form.out / "runaways.csv", index=False, lineterminator="\n", float_format="%.6g")
    save(draw_runaway_map(before, tables[DEFAULT]), form.out / "runaways.png")

    shipped = shipped_rows(["bench_leg"], {"duration_s": 2.0}) if form.quick else shipped_rows(presets(), {})
    walks = random_walks(4, 3.0, 1) if form.quick else random_walks(WALKERS, WALK_DURATION, form.workers)
    on_belt = [row for row in rows if row["preset"] != "overground"]
    form.write_results(
        {
            "outcomes": rows,
            "without": outcome_rows(DEFAULT, before),
            "falls": {
                "runs": sum(row["runs"] for row in on_belt),
                "without_trip": sum(row["falls without a trip"] for row in on_belt),
                "after_trip": sum(row["falls after a trip"] for row in on_belt),
            },
            "rates_Nm_per_s": RATES,
            "shipped": shipped,
            "walks": walks,
        }
    )
