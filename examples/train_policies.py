"""Two trained policies: less motor torque at nearly the tracking of the table, and assistance as needed.

A policy is a small network that changes the setpoints of the gait table. The first one lowers the torques of
the motors while the legs follow healthy walking as before; it acts every 10 ms. The second one adapts
stiffness and damping of a leg from stride to stride. An evolution strategy trains them on random wearers, two
minutes of processor time for each. Then they walk with wearers and pushes that the training did not contain,
as do the table and other controllers, and their C is verified. Page: docs/reference/learning.md.
"""

# %%
from __future__ import annotations

from dataclasses import replace
from typing import Any

import pandas as pd
from gallery import read_options
from matplotlib.figure import Figure
from policies.evaluation import CONTROLLERS, evaluate, rows_of
from policies.training import TASKS, train, write_trained

from twin_gait import load_experiment
from twin_gait.firmware.verification import verify
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, VERMILLION
from twin_gait.report.canvas import put_legend, save, style_panel

form = read_options(
    "train_policies",
    train={"default": ",".join(TASKS), "help": "policies to train, separated by commas; nothing: test only"},
)

# %% [markdown]
# ## Training
# Every validation is the mean reward of 32 walks with wearers that the training does not draw. The first
# validation is that of the table, whose setpoints the untrained network does not change.

# %%
for name in filter(None, form.more["train"].split(",")):
    task = TASKS[name]
    if form.quick:
        task = replace(task, duration=1.0, generations=2, pairs=2, validated=1)
    weights, curve = train(task, name)
    write_trained(task, name, weights, form.out)
    pd.DataFrame(curve).to_csv(form.out / f"{name}.csv", index=False)

curves = {name: pd.read_csv(path) for name in TASKS if (path := form.out / f"{name}.csv").is_file()}
figure = Figure(figsize=(8.0, 3.2), layout="constrained")
for axes, (name, curve) in zip(figure.subplots(1, len(TASKS)), curves.items(), strict=False):
    axes.plot(curve["generation"], curve["validation"], color=BLUE, marker=".")
    axes.axhline(curve["validation"].iloc[0], color=BLACK, linewidth=0.8, linestyle="--")
    axes.text(curve["generation"].iloc[-1], curve["validation"].iloc[0], "table", ha="right", va="bottom")
    style_panel(axes, name.replace("_", " "), "mean reward in a step")
    axes.set_xlabel("generation")
save(figure, form.out / "learning_curves.png")

# %% [markdown]
# ## Test
# The policies that ship with the package walk with wearers from the distribution of the training, drawn with
# another seed, without and with pushes of 20 N·m, which the training did not have.

# %%
COUNT, DURATION = (1, 7.0) if form.quick else (32, 15.0)
tested = {name: CONTROLLERS[name] for name in ("table", "low_effort")} if form.quick else CONTROLLERS
table = evaluate(COUNT, DURATION, tested, 1 if form.quick else form.workers)
rows = {key: rows_of(table, pushed=pushed) for key, pushed in (("rows", False), ("pushed", True))}
for key in rows:
    print(key, *rows[key], sep="\n")

# %%
COLOURS = dict(
    zip(CONTROLLERS, (BLACK, BLUE, BLUISH_GREEN, ORANGE, REDDISH_PURPLE, VERMILLION, GREY), strict=True)
)
figure = Figure(figsize=(8.0, 3.6), layout="constrained")
panels = figure.subplots(1, 2)
for axes, joint in zip(panels, ("hip", "knee"), strict=True):
    shown = table[~table["pushed"] & (table["controller"] != "position")]  # position is far from the others
    for name, walks in shown.groupby("controller", sort=False):
        axes.plot(
            *(walks["torque_rms_Nm"], walks[f"rmse_{joint}_deg"], "o"),
            color=COLOURS[str(name)], markersize=3.5, alpha=0.7, label=name,
        )  # fmt: skip
    style_panel(axes, f"{joint}, one point for each wearer", "error against healthy walking, RMSE [°]")
    axes.set_xlabel("motor torque, RMS over all joints [N·m]")
put_legend(figure, panels[0].lines)
save(figure, form.out / "test.png")

# %% [markdown]
# ## Firmware
# The C of both policies is compared with the simulation over 20 s and with faults, and its instructions are
# counted on an emulated Cortex-M4F.


# %%
def firmware_row(name: str, *settings: str) -> dict[str, Any]:
    """Return sizes, instructions and differences of the C of a policy."""
    found = verify(load_experiment("treadmill_guided", settings).experiment)
    double, _, target, _ = (check["found"] for check in found["checks"])
    central = target["bytes"]["gait_controller"]
    return {
        "controller": name,
        "flash [B]": central["flash"],
        "RAM [B]": central["ram"],
        "instructions: mean": round(target["instructions_mean"]),
        "worst tick": target["instructions_worst"],
        "numbers compared": double["numbers"],
        "other bits in double": double["differing"],
        "on the target": target["differing"],
    }


if not form.quick:
    firmware = [firmware_row("table")]
    firmware += [firmware_row(name, "control.mode=policy", f"control.policy={name}") for name in TASKS]
    print(*firmware, sep="\n")
    form.write_results({**rows, "firmware": firmware, "wearers": COUNT})
