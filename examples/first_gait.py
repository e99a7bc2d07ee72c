"""First gait: load the default walk, simulate it, and look at one stride.

Run it anywhere after installing the package; it writes first_gait.png beside itself or into the folder
given as argument.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from twin_gait import load_experiment, simulate


def main(folder: Path, duration: float = 8.0) -> None:
    experiment = load_experiment("treadmill", [f"duration_s={duration}"]).experiment
    run = simulate(experiment)
    print(f"{run.status}: {run.duration:g} s, {len(run.switches)} changes of phase")
    for switch in run.switches[:6]:
        print(f"  {switch.time:6.3f} s  {switch.side:5}  {switch.source} -> {switch.target} ({switch.cause})")

    # One stride of the left leg: from one entry into early stance to the next.
    entries = [s.tick for s in run.switches if s.side == "left" and s.target == "early_stance"]
    stride = run.log.iloc[entries[-2] : entries[-1]]
    percent = np.linspace(0.0, 100.0, len(stride))

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    axes.plot(percent, np.degrees(stride["left_hip_angle_rad"]), label="hip")
    axes.plot(percent, np.degrees(stride["left_knee_angle_rad"]), label="knee")
    axes.set(xlabel="stride [%]", ylabel="flexion [°]", title="One stride of the left leg")
    axes.legend()
    figure.savefig(folder / "first_gait.png", dpi=120)
    print(f"wrote {folder / 'first_gait.png'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
    # Homework: what does the knee do if friction compensation is switched off?
    # (table.phases.<phase>.knee.friction_compensation_gain=0)
