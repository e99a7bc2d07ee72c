"""Do the shipped people walk with the shipped table, and in which braces?

Each person walks half a minute at two supports, and the default wearer walks in braces from a third to ten
times as stiff as the default ones. One minute; page: docs/background/people.md.
"""

# %% [markdown]
# `twin-gait presets` lists the people; `--set patient=stroke_left` selects one.

# %%
from functools import partial

import pandas as pd
from cohorts.shipped import MASS_ALONE, brace_row, person_row
from gallery import read_options

from twin_gait.configuration.experiments import list_patients
from twin_gait.studies.jobs import run_jobs
from twin_gait.studies.workers import Workers

BRACE_FACTORS = (0.3, 0.5, 1.0, 3.0, 10.0)

# %%
if __name__ == "__main__":
    form = read_options("shipped_people")
    people = [MASS_ALONE, "stroke_left"] if form.quick else [MASS_ALONE, *list_patients()]
    factors = (1.0,) if form.quick else BRACE_FACTORS
    long, short = (5.0, 5.0) if form.quick else (30.0, 20.0)
    with Workers(form.workers) as workers:
        walks = run_jobs(partial(person_row, duration=long), people, workers=workers)
        braces = run_jobs(partial(brace_row, duration=short), factors, workers=workers)
    print(pd.DataFrame(walks).to_string(index=False))
    print(pd.DataFrame(braces).to_string(index=False))
    form.write_results({"people": walks, "braces": braces})
