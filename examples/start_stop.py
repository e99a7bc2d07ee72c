"""From standing to walking and back: the wearers and speeds for which `treadmill_start_stop` works.

One parameter is changed at a time, and the command to stand comes at times spread evenly over a stride of the
steady walk. Two minutes on two cores; page: docs/background/start_stop.md.
"""

# %% [markdown]
# A trial is successful if there was no fall and no trip, and 4 s after the command to stand both
# legs are in `stand` with more than 50 N under either foot.

# %%
from cohorts.standing import ROWS, ending_of, line_of, trials_of, walk_of
from gallery import form_of

from twin_gait.studies import Workers, run_episodes

# %%
if __name__ == "__main__":
    form = form_of("start_stop")
    rows = [ROWS[0]._replace(moments=2)] if form.quick else ROWS
    lines = []
    with Workers(form.workers) as workers:
        for row in rows:
            endings = run_episodes(walk_of, ending_of, trials_of(row), workers=workers)
            lines.append(line_of(row, endings))
            print(*lines[-1].values(), sep=" | ", flush=True)
    form.keep({"trials": lines})
