"""How the cost of a batch grows with its size, beside MuJoCo, in one process and in turn.

Takes about three minutes in full.
"""

# %%
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import form_of
from peers.engines import BatchSession
from peers.figures import draw_scaling
from peers.mujoco_peers import RolloutSession
from peers.scenarios import cases
from peers.timing import machine, significant, time_in_turn

form = form_of("scaling", Path(__file__).parent)
rounds = 3 if form.quick else 15

# %% [markdown]
# A second of the bench leg, many times over, on one thread and on two.

# %%
TICKS = 1000
case, batches = cases()[0], []
for episodes in (1, 10) if form.quick else (1, 10, 100, 1000):
    for threads in (1, 2):
        sessions = {
            "batch": BatchSession(case, TICKS, episodes=episodes, threads=threads),
            "mujoco.rollout": RolloutSession(case, TICKS, episodes=episodes, threads=threads),
        }
        work = TICKS * episodes
        times = time_in_turn({name: (session, work) for name, session in sessions.items()}, rounds)
        medians = {f"{name} [ns]": significant(timing.median) for name, timing in times.items()}
        batches.append({"episodes": episodes, "threads": threads, **medians})
        print(batches[-1])

# %%
form.keep({"machine": machine(), "rounds": rounds, "batches": batches})
draw_scaling(batches, form.out / "scaling.png")
