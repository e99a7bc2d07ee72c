"""What if the inertia is compensated too?

The share of the knee's inertia that a differentiated encoder, a gyroscope or an accelerometer can compensate:
over source, delay and share, for a rigid and a compliant gear, by simulation on the joint bench and by
eigenvalues; and the noise of the torque with the apparent inertia. One to two minutes on one core; page:
docs/background/whatif.md.
"""

# %%
from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pandas as pd
from gallery import read_options
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from whatif.endings import Ending
from whatif.figures import (
    SERIES,
    draw_endings,
    ending_handles,
    label_axes,
    position_of,
    simulated_and_predicted,
)
from whatif.inertia import Setting, Source, limit_row, noise_row, stability_row

from twin_gait.palette import BLACK
from twin_gait.report.canvas import put_legend, save, style_panel
from twin_gait.studies.jobs import run_jobs

# %% [markdown]
# ## Settings
# The delay of the encoder is that of its filters; the delay of a unit on the link is from sample to use.

# %%
SHARES = tuple(round(0.1 * step, 1) for step in range(1, 12))
TIME_CONSTANTS = (0.001, 0.002, 0.005, 0.010, 0.020)  # [s]; the firmware has 5 ms
DELAYS = (0, 2, 5, 10, 20)  # [ticks]
BUS_DELAY = 2  # [ticks] of a bus of 500 Hz
UNDECIDED = 0.1  # [1/s]; slower growth or decay is not judged in a linear run
NOISE_SHARES = (0.25, 0.5, 0.75)
NOISE_FACTORS = (1.0, 10.0)  # factors of the noise of a common unit, and of the angle of an encoder count


def settings_by_delay(*, quick: bool = False) -> list[Setting]:
    """Return held joints without shares: gear, source, delay; two delays and a rigid gear if quick."""
    filters, delays = (TIME_CONSTANTS[1:4:2], DELAYS[1:4:2]) if quick else (TIME_CONSTANTS, DELAYS)
    found: list[Setting] = []
    for compliant, source in itertools.product((False,) if quick else (False, True), Source):
        if source is Source.ENCODER:
            lags = [(time_constant, 0) for time_constant in filters]
        else:
            lags = [(TIME_CONSTANTS[0], delay) for delay in delays]
        found += [Setting(source, lag, delay, compliant=compliant) for lag, delay in lags]
    return found


def settings_by_filter(*, quick: bool = False) -> list[Setting]:
    """Return held rigid joints without shares: source, filter, noise; samples of a unit on the bus."""
    filters, factors = (TIME_CONSTANTS[2:4], NOISE_FACTORS[:1]) if quick else (TIME_CONSTANTS, NOISE_FACTORS)
    return [
        Setting(source, value, 0 if source is Source.ENCODER else BUS_DELAY, noise=factor)
        for source, value, factor in itertools.product(Source, filters, factors)
    ]


# %% [markdown]
# ## Numbers of the page


# %%
def of_stability(table: pd.DataFrame, limits: pd.DataFrame) -> dict[str, Any]:
    """Return largest stable shares by gear, sensor and hand, and predictions against simulated runs."""
    decided = table[table["growth_rate_per_s"].abs() > UNDECIDED]
    moving = table[table["ending"] != Ending.REST]
    rigid, compliant = (limits[limits["gear"] == gear] for gear in ("rigid", "compliant"))
    free = compliant[~compliant["held"]]
    link = free[free["source"] != Source.ENCODER].sort_values("largest_share")
    return {
        "rigid_free": ends(rigid[~rigid["held"]]["largest_share"]),
        "rigid_held": ends(rigid[rigid["held"]]["largest_share"]),
        "compliant_encoder": ends(free[free["source"] == Source.ENCODER]["largest_share"]),
        "compliant_quick_unit": ends(link[link["bus_delay_ms"] <= BUS_DELAY]["largest_share"]),
        "compliant_worst": link.iloc[0].to_dict() if len(link) else None,
        "misses": int(((decided["growth_rate_per_s"] > 0.0) != decided["linear_run_is_unstable"]).sum()),
        "decided": len(decided),
        "runs": len(table),
        "moving": len(moving),
        "limit_cycles": int((moving["ending"] == Ending.LIMIT_CYCLE).sum()),
        "runaways": int((moving["ending"] == Ending.RUNAWAY).sum()),
        "amplitude_deg": ends(moving["amplitude_deg"]),
        "torque_amplitude_Nm": ends(moving["torque_amplitude_Nm"]),
        "moving_though_stable": int((moving["growth_rate_per_s"] < 0.0).sum()),
    }


def ends(values: pd.Series) -> dict[str, float] | None:
    return {"least": float(values.min()), "most": float(values.max())} if len(values) else None


def of_noise(noise: pd.DataFrame) -> dict[str, Any]:
    """Return the torque noise with the fastest and slowest filter of each source, and errors of theory."""
    chosen = noise[(noise["noise_factor"] == 1.0) & (noise["share"] == noise["share"].median())]
    ordered = chosen.sort_values("mean_delay_ms").groupby("source")
    quick, slow = (part.set_index("source") for part in (ordered.head(1), ordered.tail(1)))
    return {
        "share": float(noise["share"].median()),
        "quickest": quick.to_dict("index"),
        "slowest": slow.to_dict("index"),
        "noisiest_quick": str(quick["torque_noise_Nm"].idxmax()),
        "quietest_slow": str(slow["torque_noise_Nm"].idxmin()),
        "noise_error": float((noise["torque_noise_Nm"] / noise["linear_torque_noise_Nm"] - 1.0).abs().max()),
        "inertia_error": float((noise["apparent_inertia"] - noise["closed_apparent_inertia"]).abs().max()),
    }


# %% [markdown]
# ## Picture


# %%
def draw(table: pd.DataFrame, limits: pd.DataFrame, noise: pd.DataFrame) -> Figure:
    """Draw endings over delay and share by gear and source; shares, noise and apparent inertia below."""
    gears, sources = table["gear"].unique(), list(table["source"].unique())
    figure = Figure(figsize=(14.0, 3.3 * (len(gears) + 1) + 0.8), layout="constrained")
    figure.suptitle("Inertia compensation of a knee that a hand holds", fontsize="large")
    rows = figure.subfigures(len(gears) + 1, 1, squeeze=False)[:, 0]
    for subfigure, gear in zip(rows, gears, strict=False):
        for axes, source in zip(subfigure.subplots(1, len(sources)), sources, strict=True):
            selected = [part[(part["gear"] == gear) & (part["source"] == source)] for part in (table, limits)]
            draw_map(axes, *selected)
            axes.set_title(f"{source}, {gear} gear", fontsize="medium")
    draw_numbers(rows[-1].subplots(1, 3), limits[~limits["held"]], noise, sources)
    edge = Line2D([], [], color=BLACK, label="linear loop: edge of stability (eigenvalues)")
    lines = simulated_and_predicted("simulated", "linear, closed form")
    put_legend(figure, [*ending_handles(table), edge], lines)
    return figure


def draw_map(axes: Axes, rows: pd.DataFrame, limits: pd.DataFrame) -> None:
    draw_endings(axes, rows, "mean_delay_ms", "share")
    shares = sorted(rows["share"].unique())
    held = limits[limits["held"]].sort_values("mean_delay_ms")
    positions = np.arange(len(held))
    axes.plot(
        positions, position_of(shares, held["largest_share"].to_numpy()), "o-", color=BLACK, markersize=3.5
    )
    axes.set_xticks(positions, [f"{value:.1f}" for value in held["mean_delay_ms"]])
    axes.set_ylim(-0.5, len(shares) - 0.5)
    axes.set(xlabel="mean delay of the acceleration [ms]", ylabel="share of the inertia")


def draw_numbers(panels: np.ndarray, free: pd.DataFrame, noise: pd.DataFrame, sources: list[str]) -> None:
    """Draw shares of free joints, noise of the torque, and apparent inertia, over the delay."""
    share = noise["share"].median()
    for source, colour in zip(sources, SERIES, strict=False):
        for gear, style in (("rigid", "-"), ("compliant", "--")):
            rows = free[(free["source"] == source) & (free["gear"] == gear)].sort_values("mean_delay_ms")
            label = source if gear == "rigid" else None
            panels[0].plot(
                rows["mean_delay_ms"], rows["largest_share"], style, color=colour, marker=".", label=label
            )
        selected = noise[noise["source"] == source]
        at_share, once = selected[selected["share"] == share], selected[selected["noise_factor"] == 1.0]
        draw_lines(panels[1], at_share, "noise_factor", "torque_noise_Nm", "linear_torque_noise_Nm", colour)
        draw_lines(panels[2], once, "share", "apparent_inertia", "closed_apparent_inertia", colour)
    factors = " and ".join(f"{value:g}×" for value in sorted(noise["noise_factor"].unique()))
    shares = ", ".join(f"{value:g}" for value in sorted(noise["share"].unique()))
    style_panel(panels[0], "joint without a hand: largest stable share (dashed: compliant)", "share")
    style_panel(panels[1], f"noise of the torque at a share of {share:g}, {factors} noise", "RMS [N·m]")
    style_panel(panels[2], f"apparent inertia at 1 Hz, shares {shares}", "share of the true inertia")
    panels[0].set_ylim(0.0, 1.1)
    panels[1].set_yscale("log")
    panels[2].set_ylim(0.0, 1.0)
    for axes, corner in zip(panels, ("lower right", "upper right", "lower right"), strict=True):
        label_axes(axes, "mean delay of the acceleration [ms]", loc=corner)


def draw_lines(axes: Axes, table: pd.DataFrame, by: str, simulated: str, predicted: str, colour: str) -> None:
    """Draw dots on lines, one line per value of a column, all of one colour and source."""
    for index, (_, rows) in enumerate(table.groupby(by)):
        rows = rows.sort_values("mean_delay_ms")
        label = None if index else str(rows["source"].iloc[0])
        axes.plot(rows["mean_delay_ms"], rows[predicted], color=colour, label=label)
        axes.plot(rows["mean_delay_ms"], rows[simulated], "o", color=colour, markersize=4.5)


# %%
if __name__ == "__main__":
    form = read_options("whatif_inertia")
    held, filtered = settings_by_delay(quick=form.quick), settings_by_filter(quick=form.quick)
    shares, noise_shares = (SHARES[3::4], NOISE_SHARES[1:2]) if form.quick else (SHARES, NOISE_SHARES)
    table, limits, noise = (
        pd.DataFrame(run_jobs(function, items, workers=form.workers))
        for function, items in (
            (stability_row, [item._replace(share=share) for item in held for share in shares]),
            (limit_row, [item._replace(held=kept) for kept in (True, False) for item in held]),
            (noise_row, [item._replace(share=share) for item in filtered for share in noise_shares]),
        )
    )
    for name, rows in {"stability": table, "limits": limits, "noise": noise}.items():
        rows.to_csv(form.out / f"{name}.csv", index=False)
    save(draw(table, limits, noise), form.out / "inertia.png", resolution=80)
    numbers = {"stability": of_stability(table, limits), "noise": of_noise(noise)}
    form.write_results(numbers)
    print(pd.Series(numbers["stability"]).to_string())
