"""How fast an episode and a batch are simulated, beside MuJoCo and plain Python, and how accurately.

All implementations run in one process and in turn, with the same integrator and step, so that their ratios
carry over to other machines. Takes about twenty minutes in full, on a machine with nothing else to do.
"""

# %%
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import form_of
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

CHECK = "time only what the goals are about, write them to FILE if any, exit 1 if one is missed"
CHECK_OPTION = {"nargs": "?", "const": os.devnull, "metavar": "FILE", "help": CHECK}
form = form_of("speed", Path(__file__).parent, check=CHECK_OPTION)
extent = Extent.quick() if form.quick else Extent()
before, vectors, checks = machine(), instruction_set(), form.more["check"]

# %% [markdown]
# Three scenarios, each with two steps: the leg on its bench, both legs in the air, and the treadmill. The
# quick form takes the first of them only.

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
# The ratios that the compiled engine and its batch are held to.

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
# The goals once more with AVX-512 switched off, in a process of its own (not in the quick form); a second of
# the bench leg many times over; and options of MuJoCo that might make it faster.

# %%
shorter = []
if vectors == "AVX-512" and not form.quick:  # all is compiled once more
    with tempfile.NamedTemporaryFile() as file:
        again = [sys.executable, __file__, "--check", file.name]
        subprocess.run(again, env=without_avx512())
        shorter = json.load(file)
sizes = (1, 33) if form.quick else (1, 7, 33, 100, 1000)
batches = {"batch": BatchSession, "mujoco.rollout": RolloutSession}
chosen = cases()[:1] if form.quick else [case for case in cases() if case.scenario != "contact_free_biped"]
form.keep(
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
