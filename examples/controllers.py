"""Controllers compared: the same wearer on the same belt with different laws from angle to torque.

A wearer with a left hemiparesis walks with the springs of the five phases, with four fifths of them, with a
share that adapts from stride to stride, and along a predetermined path; without springs the legs collapse.
The figure shows angles of the affected knee and the torque of the device. Then the command
``twin-gait compare`` counts more over different samples. Half a minute; page: docs/reference/compare.md.
"""

# %%
from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from typing import Any

import numpy as np
from gallery import read_options
from matplotlib.figure import Figure

from twin_gait import Run, load_experiment, simulate, summarise_run
from twin_gait.measures.strides import normalise_strides
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, ORANGE, REDDISH_PURPLE
from twin_gait.report.canvas import put_legend, save, style_panel

form = read_options("controllers")
DURATION = 12.0 if form.quick else 30.0  # [s]
CONTROLLERS = {
    "table": [],
    "four fifths of it": ["control.assistance.hip=0.8", "control.assistance.knee=0.8"],
    "adaptive share": ["control.assistance.adaptive=true"],
    "position": ["control.mode=position"],
    "one spring": ["control.mode=constant"],
    "no spring": ["control.mode=transparent"],
}
COLOURS = dict(zip(CONTROLLERS, (BLUE, BLUISH_GREEN, ORANGE, REDDISH_PURPLE), strict=False))
AFFECTED = "left"

# %%
runs = {
    name: simulate(
        load_experiment(
            "treadmill_guided", ["patient=stroke_left", f"duration_s={DURATION}", *settings]
        ).experiment
    )
    for name, settings in CONTROLLERS.items()
}
for name, run in runs.items():
    print(
        f"{name:18} {run.verdict.outcome}", *(f"{event.time:.1f} s: {event.text}" for event in run.events[:1])
    )

# %% [markdown]
# ## The affected knee over the stride
# Means over the strides of the controllers that walk. The torque is that of the motor; `twin-gait compare`
# reports the torque of the device on the leg, behind the gear.


# %%
def mean_stride(run: Run, column: str) -> np.ndarray:
    """Return the mean of a column of the affected leg over the stride, shape ``(101,)``."""
    strides = run.leg_record(AFFECTED).strides()
    return np.mean(normalise_strides(run.log[f"{AFFECTED}_{column}"].to_numpy(), strides), axis=0)


walked = {name: run for name, run in runs.items() if run.verdict.outcome == "walked"}
figure = Figure(figsize=(8.0, 3.6), layout="constrained")
angle, torque = figure.subplots(1, 2)
for name, run in walked.items():
    angle.plot(np.degrees(mean_stride(run, "knee_angle_rad")), color=COLOURS[name], label=name)
    torque.plot(mean_stride(run, "knee_motor_torque_Nm"), color=COLOURS[name])
torque.axhline(0.0, color=BLACK, linewidth=0.6)
style_panel(angle, "flexion of the affected knee", "°")
style_panel(torque, "motor torque of the affected knee", "N·m")
for axes in (angle, torque):
    axes.set(xlabel="stride [%]", xlim=(0, 100))
put_legend(figure, angle.lines)
save(figure, form.out / "controllers.png")

# %%
rows = []
for name, run in runs.items():
    row = {"controller": name, "outcome": str(run.verdict.outcome)}
    if name in walked:
        side = summarise_run(run)["sides"][AFFECTED]
        row |= {
            "stride [s]": f"{side['stride_time_mean_s']:.2f}",
            "RMSE hip [°]": f"{side['rmse_hip_by_contact_deg']:.1f}",
            "RMSE knee [°]": f"{side['rmse_knee_by_contact_deg']:.1f}",
            "RMS motor torque of the knee [N·m]": f"{side['joints']['knee']['torque_rms_Nm']:.0f}",
        }
    rows.append(row)
print(*rows, sep="\n")

# %% [markdown]
# ## Several samples
# The command compares the same wearer in samples that differ in belt speed, effort and sensors, with means
# and 95 % confidence intervals. Controllers without a complete walk are left out.

# %%
DAYS = ("--seeds", "2", "--duration", "15") if form.quick else ("--seeds", "5")
COMPARED = "table", "position", "assist_as_needed", "twincare"
with tempfile.TemporaryDirectory() as folder:
    command = [
        *(sys.executable, "-m", "twin_gait", "compare", "--patient", "stroke_left", *DAYS),
        *("--controllers", ",".join(COMPARED), "--out", f"{folder}/compare", "--json"),
    ]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
compared: dict[str, Any] = json.loads(answer)
for line in compared["table"]:
    print(" | ".join(line.values()))
form.write_results({"rows": rows, "subtitle": compared["subtitle"], "days": compared["table"]})
