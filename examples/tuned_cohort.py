"""Individually tuned tables: gain of a short search over the scaled table, for thirty virtual people.

Each person of a cohort walks a minute with a table from a short search (8 generations), compared with the
shipped table that the scaling law adapts. Page: docs/background/cohort.md.
"""

# %% [markdown]
# `twin-gait tune` does the same for one person, with a report.

# %%
import pandas as pd
from cohorts.tuned import Job, experiment_of, tuned_walk
from cohorts.walkers import cohort_row, walkers
from gallery import read_options

import twin_gait
from twin_gait import simulate_batch
from twin_gait.studies.jobs import run_jobs
from twin_gait.studies.workers import Workers

SEED, PEOPLE, GENERATIONS = 11, 30, 8
QUICK = {"generations": 1, "search_duration": 1.0, "robust_duration": 1.0}

# %%
if __name__ == "__main__":
    form = read_options("tuned_cohort")
    people = walkers(1 if form.quick else PEOPLE, SEED)
    settings = QUICK if form.quick else {"generations": GENERATIONS}
    jobs = [Job(number, walker, settings) for number, walker in enumerate(people)]
    with Workers(form.workers) as workers:
        plain = simulate_batch(experiment_of({}), people, workers=workers)
        tuned = pd.DataFrame(run_jobs(tuned_walk, jobs, workers=workers))
    rows = [cohort_row("treadmill_guided, scaled", SEED, plain), cohort_row("tuned", SEED, tuned)]
    print(pd.DataFrame(rows).to_string(index=False))
    version = twin_gait.__version__
    form.write_results(
        {"version": version, "generations": GENERATIONS, "people": len(people), "tunings": rows}
    )
