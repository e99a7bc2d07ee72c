"""Common parts of the what-if pictures: maps of endings, and simulated dots on predicted lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_hex, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from whatif.endings import Ending

from twin_gait.palette import BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION

COLOURS = {Ending.REST: SKY_BLUE, Ending.LIMIT_CYCLE: ORANGE, Ending.RUNAWAY: VERMILLION}
SERIES = (BLUE, VERMILLION, BLUISH_GREEN, REDDISH_PURPLE, ORANGE)
TINT = 0.55  # of white in a cell, so that numbers in it can be read


def tinted(ending: Ending) -> str:
    red, green, blue = (TINT + (1.0 - TINT) * part for part in to_rgb(COLOURS[ending]))
    return to_hex((red, green, blue))


def draw_endings(axes: Axes, table: pd.DataFrame, across: str, upwards: str) -> None:
    """Draw a map of endings over two columns, with the amplitude in degrees of a limit cycle."""
    endings = list(COLOURS)
    codes = table.assign(code=[endings.index(name) for name in table["ending"]])
    cells = codes.pivot(index=upwards, columns=across, values="code")
    sizes = table.pivot(index=upwards, columns=across, values="amplitude_deg").to_numpy(dtype=float)
    colours = ListedColormap([tinted(ending) for ending in endings])
    axes.imshow(cells, origin="lower", aspect="auto", cmap=colours, vmin=-0.5, vmax=len(endings) - 0.5)
    outline = withStroke(linewidth=2.0, foreground=tinted(Ending.LIMIT_CYCLE))
    for (row, column), code in np.ndenumerate(cells.to_numpy()):
        if endings[int(code)] is Ending.LIMIT_CYCLE:
            size = sizes[row, column]
            label = f"{size:.0f}" if size >= 10.0 else f"{size:.2g}"
            axes.text(
                column, row, label, ha="center", va="center", fontsize=6.5, path_effects=[outline]
            )  # fmt: skip
    axes.set_xticks(range(len(cells.columns)), [f"{value:g}" for value in cells.columns])
    axes.set_yticks(range(len(cells.index)), [f"{value:g}" for value in cells.index])
    axes.tick_params(length=0, labelsize=7.5)
    for side in axes.spines.values():
        side.set_visible(False)


def position_of(values: Sequence[float], wanted: np.ndarray) -> np.ndarray:
    """Return the positions of numbers on an axis of cells with ascending values, extrapolated at the ends."""
    positions = np.arange(len(values))
    inside = np.interp(wanted, values, positions)
    below = (wanted - values[0]) / (values[1] - values[0])
    above = positions[-1] + (wanted - values[-1]) / (values[-1] - values[-2])
    return np.where(wanted < values[0], below, np.where(wanted > values[-1], above, inside))


def ending_handles(table: pd.DataFrame) -> list[Artist]:
    """Return the legend entries of the occurring endings."""
    labels = {Ending.LIMIT_CYCLE: "limit cycle (amplitude in °)"}
    return [
        Patch(color=tinted(ending), label=labels.get(ending, str(ending)))
        for ending in COLOURS
        if ending in set(table["ending"])
    ]


def draw_series(
    axes: Axes,
    table: pd.DataFrame,
    by: str,
    across: str,
    simulated: str,
    predicted: str,
    names: Mapping[Any, str],
) -> None:
    """Draw what was simulated as dots and what was predicted as lines, one colour per value of a column."""
    for (key, label), colour in zip(names.items(), SERIES, strict=False):
        rows = table[table[by] == key].sort_values(across)
        axes.plot(rows[across], rows[predicted], color=colour, linewidth=1.4, label=label)
        axes.plot(rows[across], rows[simulated], "o", color=colour, markersize=4.5)


def simulated_and_predicted(simulated: str, predicted: str) -> list[Artist]:
    """Return the legend entries of dots and lines."""
    return [
        Line2D([], [], color=GREY, marker="o", linestyle="", markersize=4.5, label=simulated),
        Line2D([], [], color=GREY, linewidth=1.4, label=predicted),
    ]


def label_axes(axes: Axes, across: str, **legend: Any) -> None:
    """Label the horizontal axis and place the legend of the panel."""
    axes.set_xlabel(across)
    axes.legend(fontsize="small", frameon=False, **legend)
