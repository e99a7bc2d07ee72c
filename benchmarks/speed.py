"""Speed and accuracy of an episode and of a batch, compared with MuJoCo and plain Python.

All implementations run in one process and in turn, with the same integrator and step, so that their ratios
apply to other machines. The full form takes about twenty minutes on an otherwise idle machine.
"""

# %%
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import read_options
from peers.engines import ENGINES, BatchSession
from peers.figures import draw_speed
from peers.measuring import GOALS, Extent, batch_rows, goal_rows, measure, scaling_rows
from peers.scenarios import cases
from peers.timing import instruction_set, machine, without_avx512

try:
    from peers.mujoco_peers import MUJOCO_PEERS, RolloutSession
    from peers.options import option_rows
except ImportError:
    sys.exit("needs MuJoCo 4, which pip install 'twin-gait[test]' brings")

CHECK = "time only the peers of the goals, write the goals to FILE if given, exit 1 if one is missed"
CHECK_OPTION = {"nargs": "?", "const": os.devnull, "metavar": "FILE", "help": CHECK}
form = read_options("speed", Path(__file__).parent, check=CHECK_OPTION)
extent = Extent.quick() if form.quick else Extent()
before, vectors, checks = machine(), instruction_set(), form.more["check"]

# %% [markdown]
# Three scenarios, each with two steps: the leg on its bench, both legs in the air, and the treadmill. The
# quick form takes only the first scenario.

# %%
implementations, measured = (*ENGINES, *MUJOCO_PEERS), []
if checks:
    wanted = {name for pair in GOALS for name in pair}
    implementations = tuple(item for item in implementations if item.name in wanted)
for case in cases()[:1] if form.quick else cases():
    measured.append(measure(case, implementations, extent))
    print(f"\n{case.scenario}, {case.step}")
    for row in measured[-1]["rows"]:
        print(f"{row['implementation']:25} {row['least time per tick [ns]']:12,} ns per tick")

# %% [markdown]
# Goals for the ratios of the compiled engine and its batch.

# %%
goals = goal_rows(measured, vectors)
print(f"\ncompiled for {vectors}")
for row in goals:
    print(" | ".join(str(cell) for cell in row.values()))
missed = sum(row["met"] != "yes" for row in goals)
if checks:
    Path(checks).write_text(json.dumps(goals))
    sys.exit(min(missed, 1))

# %% [markdown]
# The goals again with AVX-512 switched off, in a separate process (not in the quick form); batches of many
# episodes of the bench leg of one second; and options of MuJoCo that might make it faster.

# %%
shorter = []
if vectors == "AVX-512" and not form.quick:  # everything is compiled again
    with tempfile.NamedTemporaryFile() as file:
        again = [sys.executable, __file__, "--check", file.name]
        subprocess.run(again, env=without_avx512())
        shorter = json.load(file)
sizes = (1, 33) if form.quick else (1, 7, 33, 100, 1000)
batches = {"batch": BatchSession, "mujoco.rollout": RolloutSession}
chosen = cases()[:1] if form.quick else [case for case in cases() if case.scenario != "contact_free_biped"]
form.write_results(
    {
        "machine": {**before, "load average after": machine()["load average"]},
        "rounds": extent.rounds,
        "goals": goals,
        "missed": missed,
        "of": len(goals),
        "avx2": shorter,
        "cases": measured,
        "batch": batch_rows(measured),
        "scaling": scaling_rows(cases()[0], batches, sizes, extent.rounds),
        "options": option_rows(chosen, extent.evaluations // 8, extent.rounds),
    }
)
draw_speed(measured, form.out / "speed.png")
