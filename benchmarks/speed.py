"""How fast an episode is simulated, beside MuJoCo and itself as plain Python, and how accurately.

All implementations run in one process and in turn, with the same integrator and step, so that their ratios
carry over to other machines. Takes about five minutes in full, on a machine that has nothing else to do.
"""

# %%
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import form_of
from peers.engines import ENGINES
from peers.figures import draw_speed
from peers.measuring import Extent, batch_gains, goal_rows, measure, time_walk
from peers.scenarios import cases
from peers.timing import machine

try:
    from peers.mujoco_peers import MUJOCO_PEERS
except ImportError:
    print("without MuJoCo, which pip install 'twin-gait[test]' brings")
    MUJOCO_PEERS = ()

form = form_of("speed", Path(__file__).parent)
extent = Extent.quick() if form.quick else Extent()
before = machine()

# %% [markdown]
# Three scenarios, each with two steps: the leg on its bench, both legs in the air, and the treadmill. The
# quick form takes the first of them only.

# %%
measured = []
for case in cases()[:1] if form.quick else cases():
    measured.append(measure(case, (*ENGINES, *MUJOCO_PEERS), extent))
    print(f"\n{case.scenario}, {case.step}")
    for row in measured[-1]["rows"]:
        print(f"{row['implementation']:20} {row['time per tick [ns]']:12,} ns per tick")

# %% [markdown]
# Twenty seconds on the treadmill as `simulate()` runs them, with their log, and the ratios that the
# compiled engine is held to.

# %%
walk = time_walk(extent)
goals = goal_rows(measured, walk)
print(f"\n{walk['duration_s']:g} s of treadmill: {walk['simulate_s']:.3f} s")
for row in goals:
    print(" | ".join(str(cell) for cell in row.values()))

# %%
form.keep(
    {
        "machine": {**before, "load average after": machine()["load average"]},
        "rounds": extent.rounds,
        "cases": measured,
        "walk": walk,
        "goals": goals,
        "missed": sum(row["met"] != "yes" for row in goals),
        "of": len(goals),
        "batch_gain": batch_gains(measured),
    }
)
draw_speed(measured, form.out / "speed.png")
