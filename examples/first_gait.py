"""First gait: load the guided walk, simulate it, and look at one stride. Some seconds."""

# %%
import numpy as np
from gallery import read_options
from matplotlib.figure import Figure

from twin_gait import load_experiment, simulate

form = read_options("first_gait")

# %% [markdown]
# An experiment is one immutable value; `simulate` returns a run whose log has one row per tick of 1 ms.

# %%
run = simulate(load_experiment("treadmill_guided", [f"duration_s={6.5 if form.quick else 8.0}"]).experiment)
print(run)
for switch in run.switches[:6]:
    print(f"  {switch.time:6.3f} s  {switch.side:5}  {switch.source} -> {switch.target} ({switch.cause})")

# %% [markdown]
# One stride of the left leg: from one entry into early stance to the next.

# %%
entries = [item.tick for item in run.switches if item.side == "left" and item.target == "early_stance"]
stride = run.log.iloc[entries[-2] : entries[-1]]
percent = np.linspace(0.0, 100.0, len(stride))

figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.subplots()
axes.plot(percent, np.degrees(stride["left_hip_angle_rad"]), label="hip")
axes.plot(percent, np.degrees(stride["left_knee_angle_rad"]), label="knee")
axes.set(xlabel="stride [%]", ylabel="flexion [°]", title="One stride of the left leg")
axes.legend()
figure.savefig(form.out / "first_gait.png", dpi=120)
form.write_results({"outcome": str(run.verdict.outcome), "stride_s": len(stride) * 1e-3})
print(f"wrote {form.out / 'first_gait.png'}")

# %% [markdown]
# Homework: how does the knee move if friction compensation is switched off?
# (`table.phases.<phase>.knee.friction_compensation_gain=0`)
