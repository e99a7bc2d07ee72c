"""A table for anybody: the people who walk with the shipped table.

Two cohorts of 200 virtual people walk a minute each, with the table that its scaling law adapts to them.
Some minutes on two cores; page: docs/background/cohort.md.
"""

# %% [markdown]
# A gait table is tuned for one person. Its `scaling` adapts it to another person by mass, height, support and
# belt speed. Here people are drawn by stature, mass and sex, are given the condition of a shipped person, and
# walk on the treadmill.

# %%
from cohorts.walkers import DURATION, SUPPORT, cohort_row, failures, walkers
from gallery import read_options

from twin_gait import load_experiment, simulate_batch
from twin_gait.studies.workers import Workers

TABLES = ("treadmill_guided",)
COHORT, SEEDS = 200, (11, 2027)


# %%
def walk_all(count: int, duration: float, workers: Workers) -> tuple[list[dict], list[str]]:
    """Return a row for each table and seed, and a sentence about each person who does not walk."""
    rows, others = [], []
    for table in TABLES:
        settings = [f"table={table}", f"scenario.support.share={SUPPORT}", f"duration_s={duration}"]
        base = load_experiment("treadmill_guided", settings).experiment
        for seed in SEEDS:
            people = walkers(count, seed)
            walks = simulate_batch(base, people, workers=workers)
            rows.append(cohort_row(table, seed, walks))
            others += failures(table, seed, walks, people)
            print(rows[-1], flush=True)
    return rows, others


# %%
if __name__ == "__main__":
    form = read_options("cohort")
    with Workers(form.workers) as workers:
        cohorts, others = walk_all(2 if form.quick else COHORT, 5.0 if form.quick else DURATION, workers)
    form.write_results({"cohorts": cohorts, "others": others})
