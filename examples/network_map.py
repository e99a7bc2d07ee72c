"""Springs on the boards or on the gait controller: the effects of delay and loss on the CAN bus.

The guided walk over a bus with 0–20 ms of further delay and 0–20 % of lost frames, with virtual springs and
dampers on the boards of the joints, as in the thesis, and on the central unit (CCU). Then the explanation:
the linearised loop of one phase. Two minutes on two cores; page: docs/background/network.md.
"""

# %% [markdown]
# ## The map
# Over the bus of `urdf/twin.dbc`: 1 Mbit/s, eight frames of eight bytes every 2 ms.

# %%
from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from gallery import read_options
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from twin_gait import Experiment, Run, load_experiment, simulate, simulate_batch
from twin_gait.checking.hanging_leg import linear_loops
from twin_gait.checking.linear_loop import transition_matrix
from twin_gait.checking.network import traffic_of
from twin_gait.palette import BLACK, BLUE, EVENT_COLOUR, VERMILLION
from twin_gait.report.canvas import save, style_panel

BOARD, CCU = "board", "ccu"
LOCATIONS = {BOARD: "springs on the boards", CCU: "springs on the CCU"}
COLOURS = {BOARD: BLUE, CCU: VERMILLION}
DELAYS = tuple(range(21))  # [ms]
LOSSES = (0.0, 0.025, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2)
SHOWN = (0, 2, 5, 6, 10, 15, 20)  # [ms] in the table of the page
KNEE = "right_knee"
WALKED = "walked"


def bus_loads() -> list[dict]:
    """Return the worst-case load of the bus at two bit rates, and the arrival time of its last frame."""
    rows = []
    for rate in (1000, 500):
        bus = load_experiment("treadmill_guided", [f"network={{bit_rate_kbit_per_s: {rate}}}"]).experiment
        load, times = traffic_of(bus)
        last = max(times.values())
        latest = "never" if last == math.inf else f"{1e3 * last:.2f} ms after it is due"
        rows.append({"bit rate": f"{rate} kbit/s", "load": f"{load:.0%}", "the last frame": latest})
    return rows


def outcome_map(
    delays: Sequence[int], losses: Sequence[float], duration: float, workers: int
) -> pd.DataFrame:
    """Simulate a walk at every point and return outcome and error, with a row for each."""
    base = load_experiment("treadmill_guided", ["network=can", f"duration_s={duration}"]).experiment
    points = list(itertools.product(LOCATIONS, delays, losses))
    overrides = [
        {"network.impedance": location, "network.delay_s": 1e-3 * delay, "network.loss": loss}
        for location, delay, loss in points
    ]
    table = simulate_batch(base, overrides, workers=workers)
    errors = table[[f"{side}_rmse_knee_by_contact_deg" for side in ("left", "right")]].mean(axis=1)
    rows = pd.DataFrame(points, columns=["springs", "delay_ms", "loss"])
    return rows.assign(outcome=table["outcome"].to_numpy(), rmse_knee_deg=errors.round(2).to_numpy())


def counts_of(block: pd.DataFrame) -> dict:
    """Return the number of successful walks of one place, the delay up to which all walked, and errors."""
    good = block[block["outcome"] == WALKED]
    ended = block[block["outcome"] != WALKED]
    return {
        "walks": len(block),
        "walked": len(good),
        "others": ", ".join(sorted(set(ended["outcome"]))) or "none",
        "first_ended_ms": int(ended["delay_ms"].min()) if len(ended) else None,
        "last_walked_ms": int(good["delay_ms"].max()),
        "rmse_knee_least_deg": float(good["rmse_knee_deg"].min()),
        "rmse_knee_most_deg": float(good["rmse_knee_deg"].max()),
    }


# %% [markdown]
# ## Explanation
# A torque that responds to the motion of the joint a time T ago is, for motions that are slow against T,
#
# $$-k\,[\theta(t-T)-\theta_0] - b\,\omega(t-T) \approx -k(\theta-\theta_0) - (b-kT)\omega + bT\dot\omega$$
#
# so that the loop has $kT$ less damping and $bT$ less inertia. With the springs on the boards T is nearly 0
# for any bus, and only the setpoints of a new phase are late. On the CCU measurement and torque use the bus.
# The swinging knee is then faster, and the monitor of its board stops it, because no joint may be too fast to
# brake before its limit. The figure compares the speed of the knee in the full simulation, without the
# monitor, with the linear loop of `twin-gait check` after a single release.


# %%
class Swing(NamedTuple):
    """Swing of the right knee with the springs in one place and some delay."""

    place: str
    delay: int  # [ms]
    round_trip: float  # mean time from a measurement to the torque that responds to it, [s]
    speed: float  # highest speed of extension, [rad/s]
    stop: float  # least angle at which the braked knee would stop, [rad]
    outcome: str


def swing_of(location: str, delay: int, duration: float) -> Swing:
    """Simulate a walk without the monitor and return the swing of its knee."""
    network = f"network={{impedance: {location}, delay_ms: {delay}}}"
    settings = [network, f"duration_s={duration}", "control.safety.enabled=false"]
    run = simulate(load_experiment("treadmill_guided", settings).experiment)
    angle, velocity = (
        run.log[f"{KNEE}_{name}"].to_numpy() for name in ("measured_angle_rad", "velocity_fast_rad_per_s")
    )
    distance = 0.5 / run.experiment.control.safety.stopping_deceleration
    stop = float((angle + distance * velocity * np.abs(velocity)).min())
    trip = 0.0 if location == BOARD else round_trip(run)
    return Swing(location, delay, trip, -float(velocity.min()), stop, run.verdict.outcome or "")


def round_trip(run: Run) -> float:
    """Return the mean age of measurements at the gait controller plus that of setpoints at the board [s]."""
    assert run.traffic is not None
    frames = run.traffic["frames"]
    return sum(frame["mean_age_s"] for name, frame in frames.items() if name.startswith(KNEE))


def linear_speeds(experiment: Experiment, delays: Sequence[int]) -> list[float]:
    """Compute the highest speed of extension of the released knee over that without delay.

    Args:
        delays: Delays from a measurement to the torque that responds to it, in ticks.
    """
    phases = {phase: loop for (_, phase), loop in linear_loops(experiment, velocity=1.0).items()}
    loop = phases["swing_extension"]
    speeds = []
    for delay in (0, *delays):
        matrix = transition_matrix(replace(loop, delay=delay))
        state, fastest = np.zeros(len(matrix)), 0.0
        # Blocks of two: angle, velocity, fast velocity, angles of the last tick and of the last slow sample.
        state[[1, 7, 9]] = 1.0
        for _ in range(60):
            state = matrix @ state
            fastest = max(fastest, -float(state[3]))
        speeds.append(fastest)
    return [speed / speeds[0] for speed in speeds[1:]]


def knee_numbers(experiment: Experiment) -> dict[str, float]:
    """Return inertia, k and b of the swinging knee from its linear loop."""
    loop = {phase: loop for (_, phase), loop in linear_loops(experiment, velocity=1.0).items()}[
        "swing_extension"
    ]
    mass = 1e-3 * np.linalg.inv(loop.motion.driven[2:])
    return {
        "inertia": float(mass[1, 1]),
        "stiffness": float(loop.stiffness[1]),
        "damping": float(loop.damping[1]),
    }


# %%
def draw(walks: pd.DataFrame, swings: Sequence[Swing], linear: Sequence[float]) -> Figure:
    """Draw two maps, and the speed of the knee over the delay."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.1))
    walked = walks[walks["outcome"] == WALKED]["rmse_knee_deg"]
    scale = Normalize(walked.min(), walked.max()) if walked.notna().any() else Normalize(0.0, 1.0)
    for panel, (location, words) in zip(axes[:2], LOCATIONS.items(), strict=True):
        block = walks[walks["springs"] == location]
        errors = block.assign(shown=block["rmse_knee_deg"].where(block["outcome"] == WALKED))
        grid = errors.pivot(index="loss", columns="delay_ms", values="shown")
        drawn = panel.pcolormesh(
            grid.columns, 100.0 * grid.index, grid.to_numpy(), norm=scale, cmap="viridis_r"
        )
        ended = block[block["outcome"] != WALKED]
        panel.plot(ended["delay_ms"], 100.0 * ended["loss"], "x", color=EVENT_COLOUR, markersize=4)
        style_panel(panel, f"Springs{words.removeprefix('springs')}", "frames lost [%]")
        panel.set_xlabel("further delay [ms]")
    figure.colorbar(drawn, ax=axes[1], label="RMSE of the knee [°]; ×: held")
    panel, start = axes[2], swings[0].speed
    for location, words in LOCATIONS.items():
        of_location = [item for item in swings if item.place == location]
        delays, speeds = [item.delay for item in of_location], [item.speed / start for item in of_location]
        panel.plot(delays, speeds, "o", color=COLOURS[location], label=f"{words}, simulated")
    panel.plot(delays, linear, color=BLACK, label="linear loop")
    style_panel(panel, "Highest speed of the swinging knee", "over that without delay")
    panel.set_xlabel("further delay [ms]")
    panel.legend(frameon=False, fontsize="small")
    return figure


# %%
if __name__ == "__main__":
    form = read_options("network_map")
    duration = 12.0 if form.quick else 20.0
    delays, losses = ((0, 20), (0.0, 0.2)) if form.quick else (DELAYS, LOSSES)
    walks = outcome_map(delays, losses, duration, form.workers)
    walks.to_csv(form.out / "network_map.csv", index=False, lineterminator="\n")
    base = load_experiment("treadmill_guided").experiment
    swings = [swing_of(location, delay, duration) for location in LOCATIONS for delay in delays]
    late = [round(item.round_trip / 1e-3) for item in swings if item.place == CCU]
    linear = linear_speeds(base, late)
    save(draw(walks, swings, linear), form.out / "network_map.png", resolution=100)
    start = swings[0].speed
    rows = [
        {
            "delay [ms]": item.delay,
            "round trip [ms]": trip,
            "knee, simulated": f"{item.speed / start:.2f}",
            "knee, linear loop": f"{ratio:.2f}",
            "stops at [°]": f"{math.degrees(item.stop):.1f}".replace("-", "−"),
            "without monitor": item.outcome,
        }
        for item, trip, ratio in zip(
            (item for item in swings if item.place == CCU), late, linear, strict=True
        )
        if item.delay in SHOWN
    ]
    counted = {place: counts_of(block) for place, block in walks.groupby("springs")}
    form.write_results(
        {
            "loads": bus_loads(),
            "places": counted,
            "knee": knee_numbers(base),
            "rows": rows,
            "largest_difference": max(
                abs(item.speed / start - ratio)
                for item, ratio in zip((item for item in swings if item.place == CCU), linear, strict=True)
            ),
        }
    )
    for row in (*bus_loads(), *rows):
        print(" | ".join(f"{key}: {value}" for key, value in row.items()))
    print(counted)
