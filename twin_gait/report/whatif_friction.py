"""Picture of the friction map: endings over G and s, thresholds, and what each way to compensate costs."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait.palette import BLACK, GREY
from twin_gait.report.canvas import put_legend, style_panel
from twin_gait.report.whatif import (
    SERIES_COLOURS,
    draw_endings,
    draw_series,
    ending_handles,
    place_of,
    seen_and_predicted,
)

MEASURED, DEAD_ZONE, REFERENCE = "measured", "dead zone", "reference"


def draw_friction_map(map_: pd.DataFrame, thresholds: pd.DataFrame, prices: pd.DataFrame) -> Figure:
    """Draw the study of :mod:`twin_gait.studies.whatif.friction_map`.

    Args:
        map_: Endings.
        thresholds: Largest gains.
        prices: What each way costs.

    Returns:
        The figure.
    """
    measured = map_[map_["compensation"] == MEASURED]
    delays, loads = sorted(measured["filter_delay_ms"].unique()), sorted(measured["load_kg"].unique())
    columns = max(4, len(delays))
    figure = Figure(figsize=(3.9 * columns, 3.1 * (len(loads) + 2)), layout="constrained")
    figure.suptitle(
        "Friction s times the compensator's model, compensated by G: a knee pushed, and let go on a spring",
        fontsize="large",
    )
    panels = figure.subplots(len(loads) + 2, columns, squeeze=False)
    for row, load in enumerate(loads):
        for column, delay in enumerate(delays):
            rows = measured[(measured["load_kg"] == load) & (measured["filter_delay_ms"] == delay)]
            _draw_map(panels[row, column], rows, f"measured velocity, filter {delay:g} ms, {load:g} kg")
    _draw_alternatives(panels[-2], map_[map_["load_kg"] == loads[0]])
    _draw_price(panels[-2, 3], prices, "hand_work_share", "work of a hand, share of that at G = 0")
    _draw_springs(panels[-1, 0], thresholds[thresholds["varied"] == "filter"])
    _draw_laws(panels[-1, 1], thresholds[thresholds["varied"] == "law"])
    _draw_loads(panels[-1, 2], thresholds[thresholds["varied"] == "load"])
    _draw_price(panels[-1, 3], prices, "path_error_deg", "RMS error on a path [°]")
    for panel in panels.ravel():
        panel.set_visible(panel.has_data())
    diagonal = Line2D([], [], color=BLACK, label="G = s")
    linear = Line2D(
        [],
        [],
        color=BLACK,
        linestyle="--",
        label="linear loop at rest: edge of growth (closed-loop transition matrix)",
    )
    put_legend(
        figure,
        [*ending_handles(map_), diagonal, linear],
        seen_and_predicted("largest G that comes to rest", "predicted without simulation"),
    )
    return figure


def _draw_map(axes: Axes, rows: pd.DataFrame, title: str) -> None:
    draw_endings(axes, rows, "gain", "friction_ratio")
    gains, ratios = (sorted(rows[name].unique()) for name in ("gain", "friction_ratio"))
    s = np.linspace(ratios[0], ratios[-1], 50)
    axes.plot(place_of(gains, s), place_of(ratios, s), color=BLACK, linewidth=1.2)
    growth = rows.pivot(index="friction_ratio", columns="gain", values="growth_at_rest_per_s").to_numpy()
    if growth.min() < 0.0 < growth.max():
        axes.contour(growth, levels=[0.0], colors=BLACK, linestyles="--", linewidths=1.2)
    axes.set_xlim(-0.5, len(gains) - 0.5)
    axes.set_ylim(-0.5, len(ratios) - 0.5)
    axes.set_title(title, fontsize="medium")
    axes.set_xlabel("G")
    axes.set_ylabel("s = true friction / model")


def _draw_alternatives(panels: np.ndarray, rows: pd.DataFrame) -> None:
    zone = rows[rows["compensation"] == DEAD_ZONE]
    pushes = sorted(zone["push_rad_per_s"].unique())
    for panel, speed in zip(panels, pushes, strict=False):
        _draw_map(panel, zone[zone["push_rad_per_s"] == speed], f"dead zone, push {speed:g} rad/s")
    _draw_map(
        panels[len(pushes)], rows[rows["compensation"] == REFERENCE], "velocity of a standing reference"
    )


def _draw_price(axes: Axes, prices: pd.DataFrame, column: str, title: str) -> None:
    for way, colour in zip((MEASURED, DEAD_ZONE, REFERENCE), SERIES_COLOURS, strict=False):
        rows = prices[prices["compensation"] == way]
        axes.plot(rows["gain"], rows[column], "o-", color=colour, markersize=3.5, label=way)
    ratio = float(prices["friction_ratio"].iloc[0])
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.axvline(ratio, color=BLACK, linewidth=1.2)
    style_panel(axes, title, "")
    axes.set_xlabel(f"G (s = {ratio:g})")
    axes.legend(fontsize="small", frameon=False)


def _draw_springs(axes: Axes, rows: pd.DataFrame) -> None:
    springs = sorted(rows["spring_Nm_per_deg"].unique())
    names = {value: f"{value:g} Nm/deg" if value else "no spring" for value in springs}
    draw_series(
        axes, rows, "spring_Nm_per_deg", "filter_delay_ms", "largest_gain", "linear_gain_at_rest", names
    )
    _finish(
        axes, rows, "by filter and spring (line: closed-loop transition matrix)", "delay of the filter [ms]"
    )


def _draw_laws(axes: Axes, rows: pd.DataFrame) -> None:
    names = {name: name for name in rows["law"].unique()}
    draw_series(axes, rows, "law", "push_rad_per_s", "largest_gain", "least_torque_ratio", names)
    _finish(axes, rows, "by shape of the true law (line: least ratio)", "speed of the push [rad/s]")


def _draw_loads(axes: Axes, rows: pd.DataFrame) -> None:
    names = {value: f"{100.0 * value:g} % of the load" for value in sorted(rows["coulomb_per_load"].unique())}
    draw_series(axes, rows, "coulomb_per_load", "load_kg", "largest_gain", "least_torque_ratio", names)
    _finish(axes, rows, "by load-dependent friction (line: least ratio)", "load [kg]")


def _finish(axes: Axes, rows: pd.DataFrame, title: str, across: str) -> None:
    axes.axhline(float(rows["friction_ratio"].iloc[0]), color=BLACK, linewidth=1.2)
    style_panel(axes, title, "G")
    axes.set_xlabel(across)
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize="small", frameon=False, loc="lower right")
