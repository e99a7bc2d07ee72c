"""What if the friction model is too strong?

A knee whose friction is compensated by a factor G of a model is pushed and released, while G, the ratio s of
true friction to model, the delay of the velocity filter and the load vary: rest, limit cycle or runaway. All
cases are simulated on the joint bench. One to two minutes on one core; page: docs/background/whatif.md.
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
from whatif.bench import DEGREE, PUSH
from whatif.endings import Ending
from whatif.figures import (
    SERIES,
    draw_endings,
    draw_series,
    ending_handles,
    label_axes,
    position_of,
    simulated_and_predicted,
)
from whatif.friction import (
    DEAD_ZONE,
    FILTERS,
    Compensation,
    Law,
    Question,
    Setting,
    cost_row,
    limit_row,
    map_row,
)

from twin_gait.palette import BLACK, GREY
from twin_gait.report.canvas import put_legend, save, style_panel
from twin_gait.studies.jobs import run_jobs

# %% [markdown]
# ## The map
# G over s, with four filters and two loads, and three kinds of compensation: at the measured velocity, at the
# velocity beyond a dead zone, at the velocity of a reference at rest.

# %%
GAINS = tuple(round(0.1 * step, 1) for step in range(1, 14))
# No ratio is equal to a gain, because the joint is then neutral.
RATIOS = (0.35, 0.55, 0.75, 0.95, 1.15)
MAP_LOADS = (0.0, 3.0)  # [kg], none and the largest one of the thesis
SMALL_PUSH = 0.04  # [rad/s], within the dead zone
OTHER_WAYS = (
    (Compensation.DEAD_ZONE, SMALL_PUSH),
    (Compensation.DEAD_ZONE, PUSH),
    (Compensation.REFERENCE, PUSH),
)


def map_settings(*, quick: bool = False) -> list[Setting]:
    """Return the settings of the map, in order; a twentieth of them in the quick form."""
    gains, ratios = (GAINS[2::5], RATIOS[1::2]) if quick else (GAINS, RATIOS)
    points = list(itertools.product(gains, ratios))
    measured = itertools.product(FILTERS[2:3] if quick else FILTERS, MAP_LOADS, points)
    others = itertools.product(OTHER_WAYS, MAP_LOADS, points)
    return [
        *(Setting(gain=gain, ratio=s, filter=kept, load=load) for kept, load, (gain, s) in measured),
        # The filter does not affect a reference velocity, so that one filter is enough there.
        *(
            Setting(compensation=way, push=speed, gain=gain, ratio=s, load=load)
            for (way, speed), load, (gain, s) in others
        ),
    ]


# %% [markdown]
# ## Limits
# The largest G at which a joint comes to rest, by bisection, over spring and filter, over the shape of the
# true law and the speed of the push (without a spring), and over the load.

# %%
SPRINGS = tuple(value / DEGREE for value in (0.0, 0.05, 0.5, 2.5))  # none, thesis, map, shipped gaits
LOADS = (0.0, 1.5, 3.0)  # [kg], none and those of the thesis
PUSHES = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3)  # [rad/s]
LOAD_SHARES = (0.0, 0.05, 0.1)  # Coulomb friction per load


def questions(*, quick: bool = False) -> list[Question]:
    """Return the limits to search for, in order; a few of them in the quick form."""
    step, filters = (3, FILTERS[3:]) if quick else (1, FILTERS)
    springs = itertools.product(SPRINGS[::step], filters)
    laws = itertools.product(Law, PUSHES[:: 4 if quick else 1])
    loads = itertools.product(LOAD_SHARES[:: 2 if quick else 1], LOADS[:: 2 if quick else 1])
    return [
        *(Question("filter", Setting(spring=spring, filter=kept)) for spring, kept in springs),
        *(Question("law", Setting(spring=0.0, law=law, push=v, filter=FILTERS[1])) for law, v in laws),
        *(Question("load", Setting(load_share=share, load=load)) for share, load in loads),
    ]


# %% [markdown]
# ## Costs
# Cost of each kind of compensation with the filter of the thesis: the work of a hand that imposes a motion on
# the joint, and the error of a joint that follows the same path by its virtual spring.


# %%
def cost_settings(*, quick: bool = False) -> list[Setting]:
    gains = tuple(round(0.1 * step, 1) for step in range(12))[:: 4 if quick else 1]
    return [Setting(compensation=way, gain=gain) for way, gain in itertools.product(Compensation, gains)]


# %% [markdown]
# ## Numbers of the page


# %%
def count(rows: pd.DataFrame, ending: Ending) -> int:
    return int((rows["ending"] == ending).sum())


def key_of(name: str) -> str:
    return name.replace(" ", "_")


def of_the_map(table: pd.DataFrame) -> dict[str, Any]:
    """Count endings below and above G = s at the measured velocity, and of the other kinds above it."""
    rows = table[table["compensation"] == Compensation.MEASURED]
    below, above = rows[rows["gain"] < rows["friction_ratio"]], rows[rows["gain"] > rows["friction_ratio"]]
    cycles = above[above["ending"] == Ending.LIMIT_CYCLE]["amplitude_deg"]
    agreed = (rows["growth_rate_at_rest_per_s"] > 0.0) == (rows["ending"] != Ending.REST)
    zone = table[table["compensation"] == Compensation.DEAD_ZONE]
    zone = zone[zone["gain"] > zone["friction_ratio"]]
    small, large = (zone[zone["push_rad_per_s"] == speed] for speed in (SMALL_PUSH, PUSH))
    reference = table[table["compensation"] == Compensation.REFERENCE]
    return {
        "runs": len(rows),
        "filter_delays_ms": ", ".join(f"{value:g}" for value in sorted(rows["filter_delay_ms"].unique())),
        "below": len(below),
        "below_at_rest": count(below, Ending.REST),
        "above": len(above),
        "above_moving": len(above) - count(above, Ending.REST),
        "limit_cycles": len(cycles),
        "smallest_cycle_deg": float(cycles.min()) if len(cycles) else None,
        "largest_cycle_deg": float(cycles.max()) if len(cycles) else None,
        "runaways": count(above, Ending.RUNAWAY),
        "matrix_agrees": int(agreed.sum()),
        "dead_zone": DEAD_ZONE,
        "dead_zone_small_push": len(small),
        "dead_zone_small_push_at_rest": count(small, Ending.REST),
        "dead_zone_large_push": len(large),
        "dead_zone_large_push_at_rest": count(large, Ending.REST),
        "reference": len(reference),
        "reference_at_rest": count(reference, Ending.REST),
    }


def of_the_limits(limits: pd.DataFrame) -> dict[str, Any]:
    """Return limits of free joints, of the stiffest spring with the slowest filter, by law, and by load."""
    springs = limits[limits["varied"] == "filter"]
    free = springs[springs["spring_Nm_per_deg"] == 0.0]
    latest = springs.sort_values(["spring_Nm_per_deg", "filter_delay_ms"]).iloc[-1]
    laws, loads = limits[limits["varied"] == "law"], limits[limits["varied"] == "load"]
    named = laws.assign(law=laws["law"].map(key_of))
    pushes = named.sort_values("push_rad_per_s").groupby("law")["largest_gain"]
    return {
        "free_linear_least": float(free["linear_gain_at_rest"].min()),
        "free_linear_most": float(free["linear_gain_at_rest"].max()),
        "free_searched_least": float(free["largest_gain"].min()),
        "free_searched_most": float(free["largest_gain"].max()),
        "stiff_and_late": latest.to_dict(),
        "gentlest_push": pushes.first().to_dict(),
        "strongest_push": pushes.last().to_dict(),
        "law_searches": len(laws),
        "law_error": float((laws["largest_gain"] - laws["least_torque_ratio"]).abs().max()),
        "heaviest": loads.sort_values(["coulomb_per_load", "load_kg"]).iloc[-1].to_dict(),
    }


def of_the_costs(costs: pd.DataFrame) -> dict[str, Any]:
    """Return the costs of each kind of compensation at the last gain below s."""
    near = costs[costs["gain"] <= costs["friction_ratio"]].groupby("compensation").tail(1)
    error = costs[costs["gain"] == 0.0]["path_error_deg"].iloc[0]
    near = near.assign(compensation=near["compensation"].map(key_of))
    return {**near.set_index("compensation").to_dict("index"), "path_error_without_deg": float(error)}


# %% [markdown]
# ## Picture


# %%
def draw(table: pd.DataFrame, limits: pd.DataFrame, costs: pd.DataFrame) -> Figure:
    """Draw maps by filter and load, maps of the alternatives, limits and costs."""
    measured = table[table["compensation"] == Compensation.MEASURED]
    delays, loads = sorted(measured["filter_delay_ms"].unique()), sorted(measured["load_kg"].unique())
    columns = max(4, len(delays))
    figure = Figure(figsize=(3.9 * columns, 3.1 * (len(loads) + 2)), layout="constrained")
    figure.suptitle(
        "Friction s times the compensator's model, compensated by G: a knee pushed, and let go on a spring",
        fontsize="large",
    )
    panels = figure.subplots(len(loads) + 2, columns, squeeze=False)
    for (row, load), (column, delay) in itertools.product(enumerate(loads), enumerate(delays)):
        rows = measured[(measured["load_kg"] == load) & (measured["filter_delay_ms"] == delay)]
        draw_map(panels[row, column], rows, f"measured velocity, filter {delay:g} ms, {load:g} kg")
    unloaded = table[table["load_kg"] == loads[0]]
    titles = (
        f"dead zone, push {SMALL_PUSH:g} rad/s",
        f"dead zone, push {PUSH:g} rad/s",
        "standing reference",
    )
    for axes, (way, speed), title in zip(panels[-2], OTHER_WAYS, titles, strict=False):
        rows = unloaded[(unloaded["compensation"] == way) & (unloaded["push_rad_per_s"] == speed)]
        draw_map(axes, rows, title)
    draw_cost(panels[-2, 3], costs, "hand_work_share", "work of a hand, share of that at G = 0")
    draw_limits(panels[-1], limits)
    draw_cost(panels[-1, 3], costs, "path_error_deg", "RMS error on a path [°]")
    for axes in panels.ravel():
        axes.set_visible(axes.has_data())
    diagonal = Line2D([], [], color=BLACK, label="G = s")
    edge = Line2D([], [], color=BLACK, linestyle="--", label="linear loop at rest: spectral radius 1")
    lines = simulated_and_predicted("largest G that comes to rest", "predicted without simulation")
    put_legend(figure, [*ending_handles(table), diagonal, edge], lines)
    return figure


def draw_map(axes: Axes, rows: pd.DataFrame, title: str) -> None:
    draw_endings(axes, rows, "gain", "friction_ratio")
    gains, ratios = (sorted(rows[name].unique()) for name in ("gain", "friction_ratio"))
    s = np.linspace(ratios[0], ratios[-1], 50)
    axes.plot(position_of(gains, s), position_of(ratios, s), color=BLACK, linewidth=1.2)
    growth = rows.pivot(index="friction_ratio", columns="gain", values="growth_rate_at_rest_per_s").to_numpy()
    if growth.min() < 0.0 < growth.max():
        axes.contour(growth, levels=[0.0], colors=BLACK, linestyles="--", linewidths=1.2)
    axes.set(xlim=(-0.5, len(gains) - 0.5), ylim=(-0.5, len(ratios) - 0.5))
    axes.set(xlabel="G", ylabel="s = true friction / model")
    axes.set_title(title, fontsize="medium")


def draw_cost(axes: Axes, costs: pd.DataFrame, column: str, title: str) -> None:
    for way, colour in zip(Compensation, SERIES, strict=False):
        rows = costs[costs["compensation"] == way]
        axes.plot(rows["gain"], rows[column], "o-", color=colour, markersize=3.5, label=str(way))
    ratio = float(costs["friction_ratio"].iloc[0])
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.axvline(ratio, color=BLACK, linewidth=1.2)
    style_panel(axes, title, "")
    label_axes(axes, f"G (s = {ratio:g})")


def draw_limits(panels: np.ndarray, limits: pd.DataFrame) -> None:
    spring, law, load = (limits[limits["varied"] == varied] for varied in ("filter", "law", "load"))
    springs = {value: f"{value:g} N·m/deg" if value else "no spring" for value in spring["spring_Nm_per_deg"]}
    laws = {name: name for name in law["law"]}
    shares = {value: f"{value:.0%} of the load" for value in load["coulomb_per_load"]}
    ratio, gain = "least_torque_ratio", "linear_gain_at_rest"
    for axes, rows, by, across, predicted, names, title, label in (
        (panels[0], spring, "spring_Nm_per_deg", "filter_delay_ms", gain, springs,
         "by filter and spring (line: transition matrix)", "delay of the filter [ms]"),
        (panels[1], law, "law", "push_rad_per_s", ratio, laws,
         "by shape of the true law (line: least ratio)", "speed of the push [rad/s]"),
        (panels[2], load, "coulomb_per_load", "load_kg", ratio, shares,
         "by load-dependent friction (line: least ratio)", "load [kg]"),
    ):  # fmt: skip
        draw_series(axes, rows, by, across, "largest_gain", predicted, names)
        axes.axhline(float(rows["friction_ratio"].iloc[0]), color=BLACK, linewidth=1.2)
        style_panel(axes, title, "G")
        axes.set_ylim(bottom=0.0)
        label_axes(axes, label, loc="lower right")


# %%
if __name__ == "__main__":
    form = read_options("whatif_friction_map")
    table, limits, costs = (
        pd.DataFrame(run_jobs(function, items, workers=form.workers))
        for function, items in (
            (map_row, map_settings(quick=form.quick)),
            (limit_row, questions(quick=form.quick)),
            (cost_row, cost_settings(quick=form.quick)),
        )
    )
    for name, rows in {"map": table, "limits": limits, "costs": costs}.items():
        rows.to_csv(form.out / f"{name}.csv", index=False)
    save(draw(table, limits, costs), form.out / "friction_map.png", resolution=80)
    numbers = {"map": of_the_map(table), "limits": of_the_limits(limits), "costs": of_the_costs(costs)}
    form.write_results(numbers)
    print(pd.Series(numbers["map"]).to_string())
