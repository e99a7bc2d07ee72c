"""Which wearers walk ten metres with crutches, and how much do the arms contribute?

The preset ``overground`` for wearers of 55–95 kg and 1.60–1.90 m with encoder noise, with steps that a
therapist requests and with steps by trunk lean; the contribution of the arms compared with published ranges;
and the walk without arms. A minute; page: docs/background/overground.md.
"""

# %%
from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from gallery import read_options

from twin_gait import Experiment, Run, load_experiment, simulate, summarise_run
from twin_gait.measures.foot_contact import CONTACT_FORCE

MASSES, HEIGHTS = (55, 65, 75, 85, 95), (1.60, 1.70, 1.80, 1.90)
TRIGGERS = "therapist", "trunk lean"
START, EVERY = 1.0, 1.14  # [s]: time of the request to walk, and interval of the step requests
WAY, SPEEDS = 10.0, (0.2, 0.42)  # [m], [m/s]
NOISE = 2e-5  # [rad] encoder noise of each tick: about three counts (an assumption, as in tuning)

# Published values for people with a complete injury in an exoskeleton with crutches. The source of a value
# with "recalled" was not found again, so that this value is uncertain.
PUBLISHED = {
    "speed [m/s]": (
        "0.13 to 0.55",
        "measured: Wu et al. 2018; Hartigan et al. 2015; Tefertiller et al. 2018",
    ),
    "step length [m]": ("0.29 to 0.41", "measured: Wu et al. 2018, from ways and steps"),
    "mean load of a crutch [% of weight]": ("10 to 20", "recalled, low confidence"),
    "peak load of a crutch [% of weight]": ("20 to 40", "recalled, low confidence"),
    "lean of the trunk [deg]": ("5 to 20", "recalled, low confidence"),
    "electric energy [J/m]": ("530", "recalled: Farris et al. 2011, 117 W at 0.22 m/s"),
}


# %%
def experiment(mass: float, height: float, trigger: str) -> Experiment:
    """Return the shipped walk with another wearer, with the time for ten metres at the least speed."""
    duration = START + WAY / SPEEDS[0]
    requests = [f"walk_automatic@{START}s"]
    if trigger == "therapist":
        steps = np.arange(START + 0.1, duration, EVERY)
        requests = [f"walk@{START}s", *(f"step@{time:.3f}s" for time in steps)]
    settings = [
        "modes=walking",
        f"requests=[{', '.join(requests)}]",
        f"patient.mass_kg={mass}",
        f"patient.height_m={height}",
        f"sensors={{ideal: false, angle_noise_rad: {NOISE}}}",
        f"duration_s={duration}",
    ]
    return load_experiment("overground", settings).experiment


def time_to(run: Run, way: float) -> float | None:
    """Return the time at which the pelvis has moved a distance in [s]; None if it has not."""
    position = run.log["pelvis_forward_m"].to_numpy()
    arrived = np.flatnonzero(position - position[0] >= way)
    return float(run.log["time_s"].iloc[arrived[0]]) if len(arrived) else None


def row_of(mass: float, height: float, trigger: str, run: Run) -> dict[str, object]:
    """Return the results of one wearer as a row."""
    arrival = time_to(run, WAY)
    speed = None if arrival is None else WAY / (arrival - START)
    return {
        "mass [kg]": mass,
        "height [m]": height,
        "step by": trigger,
        "speed over 10 m [m/s]": "-" if speed is None else f"{speed:.2f}",
        "reaches": speed is not None and SPEEDS[0] <= speed <= SPEEDS[1],
        "ends": run.reason or str(run.status),
    }


def heel_off_delays(run: Run) -> list[float]:
    """Return the times from the end of the held lean, the step request, to the unloaded foot in [s]."""
    names = list(run.experiment.modes.phases)
    stepping = run.log["mode"].to_numpy() == names.index("automatic_step")
    begins = np.flatnonzero(stepping[1:] & ~stepping[:-1]) + 1
    found = []
    for begin in begins:
        lifts = [item for item in run.switches if item.tick >= begin and item.target == "swing_flexion"]
        if lifts:
            load = run.log[f"{lifts[0].side}_foot_normal_force_N"].to_numpy()[begin:]
            free = np.flatnonzero(load < CONTACT_FORCE)
            found += [float(free[0]) * 1e-3] if len(free) else []
    return found


def beside_published(run: Run) -> list[dict[str, str]]:
    """Return the measures of the walk of the preset and published values as rows."""
    found = summarise_run(run)
    free, arms = found["free_trunk"], list(found["free_trunk"]["arms"].values())
    steps = [side["walk"]["step_length_m"] for side in found["sides"].values()]
    ours = {
        "speed [m/s]": f"{free['speed_m_per_s']:.2f}",
        "step length [m]": f"{np.mean(steps):.2f}",
        "mean load of a crutch [% of weight]": f"{100 * np.mean([arm['mean_share'] for arm in arms]):.0f}",
        "peak load of a crutch [% of weight]": f"{100 * max(arm['peak_share'] for arm in arms):.0f}",
        "lean of the trunk [deg]": f"{free['lean_lowest_deg']:.0f} to {free['lean_highest_deg']:.0f}",
        "electric energy [J/m]": f"{free['battery_energy_per_metre_J']:.0f}",
    }
    return [
        {"": name, "simulated": value, "published": PUBLISHED[name][0], "label": PUBLISHED[name][1]}
        for name, value in ours.items()
    ]


def draw(run: Run) -> plt.Figure:
    """Draw distance, lean and loads of the crutches."""
    figure, axes = plt.subplots(3, 1, figsize=(7, 7), sharex=True, layout="constrained")
    time = run.log["time_s"]
    axes[0].plot(time, run.log["pelvis_forward_m"])
    axes[0].set_ylabel("way of the pelvis [m]")
    axes[1].plot(time, np.degrees(run.log["trunk_pitch_rad"]))
    axes[1].set_ylabel("lean of the trunk [°]")
    for side in run.sides:
        axes[2].plot(time, run.log[f"{side}_crutch_normal_force_N"], label=f"{side} crutch", linewidth=0.8)
    axes[2].set_ylabel("load [N]")
    axes[2].set_xlabel("time [s]")
    axes[2].legend(frameon=False)
    return figure


# %%
if __name__ == "__main__":
    form = read_options("overground")
    walk = simulate(load_experiment("overground").experiment)
    draw(walk).savefig(form.out / "overground.png", dpi=110)
    comparison = beside_published(walk)
    for line in comparison:
        print(line)
    free = summarise_run(walk)["free_trunk"]
    print("without arms:", free["without_arms"])
    grid = [(m, h, how) for how in TRIGGERS for m in MASSES for h in HEIGHTS]
    runs = [(case, simulate(experiment(*case))) for case in (grid[-1:] if form.quick else grid)]
    cases = [row_of(*case, run) for case, run in runs]
    for row in cases:
        print(row)
    reached = {how: [bool(row["reaches"]) for row in cases if row["step by"] == how] for how in TRIGGERS}
    delays = [delay for case, run in runs if case[2] == "trunk lean" for delay in heel_off_delays(run)]
    print({how: f"{sum(there)} of {len(there)}" for how, there in reached.items()})
    print(f"heel off {np.median(delays):.2f} s after the held lean, {min(delays):.2f} to {max(delays):.2f}")
    form.write_results(
        {
            "comparison": comparison,
            "without_arms": free["without_arms"],
            "arms": free["arms"],
            "cases": [{name: value for name, value in row.items() if name != "reaches"} for row in cases],
            "share_percent": 100.0 * float(np.mean([row["reaches"] for row in cases])),
            "heel_off_s": {"median": float(np.median(delays)), "least": min(delays), "most": max(delays)},
        }
    )
