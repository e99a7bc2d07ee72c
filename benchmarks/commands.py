"""Times of whole commands in this source tree and in another one, measured in turn.

``python benchmarks/commands.py --before TREE`` compares with the package in another folder, such as a git
worktree of an earlier commit. The times are minima over the rounds; the processor time of a command includes
that of its child processes. ``bare imports`` is a process that only imports the modules that ``simulate`` has
imported at its end. The results ``ratios.before`` and ``ratios.after`` are the times of ``simulate`` over
those of ``bare imports``: ``clock`` by wall-clock time, ``processor`` by processor time.
"""

# %%
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "examples"))

from gallery import read_options
from peers.timing import machine, significant

BEFORE = {"type": Path, "metavar": "TREE", "help": "folder with the package to compare with"}
form = read_options("commands", Path(__file__).parent, before=BEFORE)
before = form.more["before"]
TREES = {**({"before": before.resolve()} if before else {}), "after": Path(__file__).resolve().parents[1]}
rounds, n_rows = (1, 1_000) if form.quick else (7, 100_000)

# %% [markdown]
# A synthetic series of velocities and friction torques for `identify`, from Stribeck's law with noise.

# %%
work = Path(tempfile.mkdtemp(prefix="commands_"))
random = np.random.default_rng(1)
velocity = 3.0 * np.sin(np.linspace(0.0, 200.0, n_rows))
friction = np.sign(velocity) * (4.0 + 2.0 * np.exp(-np.abs(velocity) / 0.3)) + 1.5 * velocity
series = np.column_stack([velocity, friction + random.normal(0.0, 0.3, n_rows)])
names = "velocity [rad/s],friction_torque [Nm]"
np.savetxt(work / "series.csv", series, "%.6f", ",", header=names, comments="")
commands = {
    "simulate": "simulate treadmill_guided --force --out run",
    "simulate --no-pictures": "simulate treadmill_guided --no-pictures --force --out bare",
    "check treadmill_guided": "check treadmill_guided",
    "presets": "presets",
    f"identify, {n_rows:,} rows": "identify series.csv --force --out fit",
}


# %% [markdown]
# A first run in each tree records the modules that `simulate` imports, for `bare imports`. A first round
# fills the cache, which has the code of both trees, and is not counted.

# %%
RECORD = """
import sys
from twin_gait.cli import main
main("simulate treadmill_guided --force --out run".split())
with open(sys.argv[1], "w") as file:
    print(*(name for name in sys.modules if name != "__main__"), file=file)
"""
IMPORT = """
import contextlib, importlib, sys
for name in open(sys.argv[1]).read().split():
    with contextlib.suppress(ImportError):  # a name that another module has put in the table
        importlib.import_module(name)
"""
programs = {name: work / f"{name}.py" for name in ("record", "bare_imports")}
programs["record"].write_text(RECORD)
programs["bare_imports"].write_text(IMPORT)


def seconds(tree: Path, words: list[str]) -> tuple[float, float]:
    """Return wall-clock time and processor time of a command and its child processes in [s]."""
    began, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    home = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}  # the value that commands set
    done = subprocess.run([sys.executable, *words], env=home, cwd=work, capture_output=True)
    wall, now = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{tree}: {' '.join(words)}: {done.stderr.decode()}")
    return wall, now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime


for tree, folder in TREES.items():
    seconds(folder, [str(programs["record"]), f"modules_{tree}"])
programs_of = {name: lambda tree, command=command: ["-m", "twin_gait", *command.split()]
               for name, command in commands.items()}  # fmt: skip
programs_of["bare imports"] = lambda tree: [str(programs["bare_imports"]), f"modules_{tree}"]
times = {(name, tree): [] for name in programs_of for tree in TREES}
for _ in range(rounds + 1):
    for name, tree in times:
        times[name, tree].append(seconds(TREES[tree], programs_of[name](tree)))
least = {key: np.min(each[1:], axis=0) for key, each in times.items()}

# %%
rows = []
for name in programs_of:
    row = {"command": name}
    for tree in TREES:
        wall, processor = least[name, tree]
        row |= {f"{tree} [s]": significant(wall), f"{tree}, processor [s]": significant(processor)}
    rows.append(row)
    print(row)
ratios = {
    tree: dict(zip(("clock", "processor"), map(significant, found), strict=True))
    for tree in TREES
    for found in [least["simulate", tree] / least["bare imports", tree]]
}
print("simulate over its bare imports:", ratios)
form.write_results({"machine": machine(), "rounds": rounds, "rows": rows, "ratios": ratios})
