"""Picture of the inertia study: which share can be compensated from which sensor, and how it shakes."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait.palette import BLACK
from twin_gait.report.canvas import put_legend, style_panel
from twin_gait.report.whatif import (
    SERIES_COLOURS,
    draw_endings,
    ending_handles,
    place_of,
    seen_and_predicted,
)

Corner = Literal["lower right", "upper right"]


def draw_inertia(stability: pd.DataFrame, limits: pd.DataFrame, noise: pd.DataFrame) -> Figure:
    """Draw the study of :mod:`twin_gait.studies.whatif.inertia`.

    Args:
        stability: Endings over delay and share.
        limits: Largest stable shares.
        noise: Noise of the torque, and the inertia that is still felt.

    Returns:
        The figure.
    """
    gears, sources = stability["gear"].unique(), list(stability["source"].unique())
    figure = Figure(figsize=(14.0, 3.3 * (len(gears) + 1) + 0.8), layout="constrained")
    figure.suptitle("Inertia compensation of a knee that a hand holds", fontsize="large")
    rows = figure.subfigures(len(gears) + 1, 1, squeeze=False)[:, 0]
    for subfigure, gear in zip(rows, gears, strict=False):
        for panel, source in zip(subfigure.subplots(1, len(sources)), sources, strict=True):
            _draw_map(panel, _of(stability, gear, source), _of(limits, gear, source))
            panel.set_title(f"{source}, {gear} gear", fontsize="medium")
    _draw_numbers(rows[-1].subplots(1, 3), limits, noise, sources)
    edge = Line2D([], [], color=BLACK, label="linear loop: edge of growth (eigenvalues)")
    put_legend(
        figure, [*ending_handles(stability), edge], seen_and_predicted("simulated", "linear, closed form")
    )
    return figure


def _of(table: pd.DataFrame, gear: str, source: str) -> pd.DataFrame:
    return table[(table["gear"] == gear) & (table["source"] == source)]


def _draw_map(axes: Axes, rows: pd.DataFrame, limits: pd.DataFrame) -> None:
    draw_endings(axes, rows, "mean_delay_ms", "share")
    shares = sorted(rows["share"].unique())
    held = limits[limits["held"]].sort_values("mean_delay_ms")
    places = np.arange(len(held))
    axes.plot(places, place_of(shares, held["largest_share"].to_numpy()), "o-", color=BLACK, markersize=3.5)
    axes.set_xticks(places, [f"{value:.1f}" for value in held["mean_delay_ms"]])
    axes.set_ylim(-0.5, len(shares) - 0.5)
    axes.set_xlabel("mean delay of the acceleration [ms]")
    axes.set_ylabel("share of the inertia")


def _draw_numbers(panels: np.ndarray, limits: pd.DataFrame, noise: pd.DataFrame, sources: list[str]) -> None:
    share = noise["share"].median()
    chosen = noise[noise["share"] == share]
    for source, colour in zip(sources, SERIES_COLOURS, strict=False):
        free = limits[(limits["source"] == source) & ~limits["held"]]
        for gear, style in (("rigid", "-"), ("compliant", "--")):
            rows = free[free["gear"] == gear].sort_values("mean_delay_ms")
            label = source if gear == "rigid" else None
            panels[0].plot(
                rows["mean_delay_ms"],
                rows["largest_share"],
                style,
                color=colour,
                marker=".",
                label=label,
            )
        mine = chosen[chosen["source"] == source]
        for factor, rows in mine.groupby("noise_factor"):
            rows = rows.sort_values("mean_delay_ms")
            label = source if factor == mine["noise_factor"].min() else None
            panels[1].plot(rows["mean_delay_ms"], rows["linear_torque_noise_Nm"], color=colour, label=label)
            panels[1].plot(rows["mean_delay_ms"], rows["torque_noise_Nm"], "o", color=colour, markersize=4.5)
        _draw_felt(panels[2], noise[noise["source"] == source], colour, source)
    _finish(panels[0], "joint without a hand: largest stable share (dashed: compliant)", "share")
    panels[0].set_ylim(0.0, 1.1)
    factors = " and ".join(f"{value:g}×" for value in sorted(noise["noise_factor"].unique()))
    _finish(
        panels[1], f"noise of the torque at a share of {share:g}, {factors} noise", "RMS [N m]", "upper right"
    )
    panels[1].set_yscale("log")
    shares = ", ".join(f"{value:g}" for value in sorted(noise["share"].unique()))
    _finish(panels[2], f"inertia that the hand feels at 1 Hz, shares {shares}", "share of the true inertia")
    panels[2].set_ylim(0.0, 1.0)


def _draw_felt(axes: Axes, noise: pd.DataFrame, colour: str, source: str) -> None:
    for place, (_, rows) in enumerate(noise.groupby("share")):
        rows = rows.drop_duplicates("mean_delay_ms").sort_values("mean_delay_ms")
        label = None if place else source
        axes.plot(rows["mean_delay_ms"], rows["closed_felt_inertia_share"], color=colour, label=label)
        axes.plot(rows["mean_delay_ms"], rows["felt_inertia_share"], "o", color=colour, markersize=4.5)


def _finish(axes: Axes, title: str, unit: str, corner: Corner = "lower right") -> None:
    style_panel(axes, title, unit)
    axes.set_xlabel("mean delay of the acceleration [ms]")
    axes.legend(fontsize="small", frameon=False, loc=corner)
