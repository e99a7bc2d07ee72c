"""Picture of the temperature study: what a compensator is worth under conditions that it does not know."""

from __future__ import annotations

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
    seen_and_predicted,
)


def draw_temperature(cases: pd.DataFrame, best: pd.DataFrame) -> Figure:
    """Draw the study of :mod:`twin_gait.studies.whatif.temperature`.

    Args:
        cases: One row per case and gain.
        best: One row per case.

    Returns:
        The figure.
    """
    warm, warm_best = cases[cases["kind"] == "temperature"], best[best["kind"] == "temperature"]
    models = sorted(warm["identified_at_degC"].unique())
    figure = Figure(figsize=(15.0, 9.6), layout="constrained")
    figure.suptitle(
        "A friction compensator under conditions that it was not identified at: knee, true law of table 3.1",
        fontsize="large",
    )
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    for panel, model in zip(above.subplots(1, len(models), squeeze=False)[0], models, strict=True):
        draw_endings(panel, warm[warm["identified_at_degC"] == model], "gain", "temperature_degC")
        panel.set_title(f"model identified at {model:g} °C: joint pushed, on a spring", fontsize="medium")
        panel.set_xlabel("G")
        panel.set_ylabel("true temperature [°C]")
    panels = below.subplots(1, 4)
    names = {model: f"identified at {model:g} °C" for model in models}
    _draw_gains(
        panels[0], warm_best, names, "largest_resting_gain", "least_torque_ratio", "largest resting G"
    )
    _draw_gains(panels[1], warm_best, names, "best_gain", "closed_best_gain", "G of least friction")
    _draw_left(panels[2], warm, float(models[len(models) // 2]))
    _draw_others(panels[3], best)
    put_legend(figure, ending_handles(cases), seen_and_predicted("simulated", "closed form"))
    return figure


def _draw_gains(
    axes: Axes, best: pd.DataFrame, names: dict[float, str], seen: str, closed: str, title: str
) -> None:
    draw_series(axes, best, "identified_at_degC", "temperature_degC", seen, closed, names)
    axes.axhline(1.0, color=BLACK, linewidth=0.8)
    style_panel(axes, title, "G")
    axes.set_xlabel("true temperature [°C]")
    axes.legend(fontsize="small", frameon=False)


def _draw_left(axes: Axes, warm: pd.DataFrame, model: float) -> None:
    """Friction that the hand still feels over the temperature, for some gains."""
    rows = warm[warm["identified_at_degC"] == model]
    gains = [gain for gain in (0.0, 0.4, 0.8, 1.0, 1.2) if gain in set(rows["gain"])]
    for gain, colour in zip(gains, SERIES_COLOURS, strict=False):
        chosen = rows[rows["gain"] == gain].sort_values("temperature_degC")
        axes.plot(
            chosen["temperature_degC"],
            chosen["hand_friction_Nm"],
            "o-",
            color=colour,
            markersize=4,
            label=f"G = {gain:g}",
        )
    style_panel(axes, f"friction left to the hand, identified at {model:g} °C", "RMS [N m]")
    axes.set_xlabel("true temperature [°C]")
    # Room for the legend above the lines.
    axes.set_ylim(0.0, 1.25 * float(rows["hand_friction_Nm"].max()))
    axes.legend(fontsize="small", frameon=False, ncols=2, loc="upper right")


def _draw_others(axes: Axes, best: pd.DataFrame) -> None:
    """Age and load: both gains, simulated and in closed form."""
    rows = best[best["kind"] != "temperature"]
    labels = [
        f"friction × {row.ageing:g}" if row.kind == "age" else f"load {row.load_kg:g} kg"
        for row in rows.itertuples()
    ]
    places = range(len(rows))
    for (seen, closed, name), colour in zip(
        (
            ("largest_resting_gain", "least_torque_ratio", "largest at rest"),
            ("best_gain", "closed_best_gain", "least friction"),
        ),
        SERIES_COLOURS,
        strict=False,
    ):
        axes.plot(rows[closed], places, "|", color=colour, markersize=14, markeredgewidth=2)
        axes.plot(rows[seen], places, "o", color=colour, markersize=5, label=name)
    axes.add_line(Line2D([1.0, 1.0], [-0.5, len(rows) - 0.5], color=GREY, linewidth=0.8))
    axes.set_yticks(list(places), labels)
    style_panel(axes, "age and load (bars: closed form)", "")
    axes.set_xlabel("G")
    axes.legend(fontsize="small", frameon=False)
