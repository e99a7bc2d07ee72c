"""A table for anybody: who walks with the shipped tables, and how their scaling laws were fitted.

Four cohorts of 200 virtual people walk a minute each, and CMA-ES looks again for the exponents of the
scaling laws of both tables. Twenty minutes on two cores; page: docs/cohort.md.
"""

# %% [markdown]
# A gait table is found for one person. Its `scaling` adapts it to another one from mass, height, support and
# belt speed. Here people are drawn by stature, mass and sex, given a condition of those who ship, and put on
# the treadmill.

# %%
import pandas as pd
from cohorts.scaling import draw_people, fit_rows, gain_of
from cohorts.walkers import DURATION, SUPPORT, cohort_row, failures, walkers
from gallery import form_of

from twin_gait import load_experiment, simulate_batch
from twin_gait.studies import Workers

TABLES = ("treadmill", "treadmill_normative")
FIT_PEOPLE, FIT_SEED, OTHERS_SEED, GENERATIONS = 48, 3, 2028, 6
COHORT, SEEDS = 200, (11, 2027)  # the second was not looked at before tables and laws were fixed


# %%
def walk_all(count: int, duration: float, workers: Workers) -> tuple[list[dict], list[str]]:
    """A row for each table and seed, and a sentence on everybody who does not walk."""
    rows, others = [], []
    for table in TABLES:
        settings = [f"table={table}", f"scenario.support.share={SUPPORT}", f"duration_s={duration}"]
        base = load_experiment("treadmill", settings).experiment
        for seed in SEEDS:
            who = walkers(count, seed)
            walks = simulate_batch(base, who, workers=workers).table
            rows.append(cohort_row(table, seed, walks))
            others += failures(table, seed, walks, who)
            print(rows[-1], flush=True)
    return rows, others


def fit_all(count: int, generations: int, workers: Workers) -> list[dict]:
    """What laws are worth to the people that they were fitted to, and to as many others."""
    rows = []
    for table in TABLES:
        sets = draw_people(count, FIT_SEED), draw_people(count, OTHERS_SEED)
        rows += fit_rows(table, *sets, generations, workers)
    return rows


# %%
if __name__ == "__main__":
    form = form_of("cohort")
    with Workers(form.workers) as workers:
        cohorts, others = walk_all(2 if form.quick else COHORT, 5.0 if form.quick else DURATION, workers)
        fits = fit_all(2 if form.quick else FIT_PEOPLE, 1 if form.quick else GENERATIONS, workers)
    print(pd.DataFrame(fits).to_string(index=False))
    gains = {table: gain_of(fits, table) for table in TABLES}
    form.keep({"cohorts": cohorts, "others": others, "fits": fits, "gain": gains})
