"""What the pictures of the what-if studies share: maps of endings, and lines with their prediction."""

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

from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION

# What becomes of a joint, by the words of the tables.
_CYCLE = "limit cycle"
ENDING_COLOURS: dict[str, str] = {"rest": SKY_BLUE, _CYCLE: ORANGE, "runaway": VERMILLION}
SERIES_COLOURS = (BLUE, VERMILLION, BLUISH_GREEN, REDDISH_PURPLE, ORANGE)
_TINT = 0.55  # of white in a cell, so that numbers in it can be read


def _tinted(colour: str) -> str:
    red, green, blue = (_TINT + (1.0 - _TINT) * part for part in to_rgb(colour))
    return to_hex((red, green, blue))


def draw_endings(axes: Axes, table: pd.DataFrame, across: str, upwards: str) -> None:
    """Draw a map of endings, with the amplitude in degrees where the joint keeps swinging.

    Args:
        axes: The panel.
        table: With ``ending`` and ``amplitude_deg``, one row per cell.
        across: Column of the horizontal axis.
        upwards: Column of the vertical axis.
    """
    names = list(ENDING_COLOURS)
    codes = table.assign(code=[names.index(name) for name in table["ending"]])
    cells = codes.pivot(index=upwards, columns=across, values="code")
    sizes = table.pivot(index=upwards, columns=across, values="amplitude_deg").to_numpy(dtype=float)
    colours = ListedColormap([_tinted(colour) for colour in ENDING_COLOURS.values()])
    axes.imshow(cells, origin="lower", aspect="auto", cmap=colours, vmin=-0.5, vmax=len(names) - 0.5)
    for (row, column), code in np.ndenumerate(cells.to_numpy()):
        if names[int(code)] == _CYCLE:
            size = _short(float(sizes[row, column]))
            text = axes.text(column, row, size, ha="center", va="center", fontsize=6.5)
            text.set_path_effects([withStroke(linewidth=2.0, foreground=_tinted(ENDING_COLOURS[_CYCLE]))])
    axes.set_xticks(range(len(cells.columns)), [f"{value:g}" for value in cells.columns])
    axes.set_yticks(range(len(cells.index)), [f"{value:g}" for value in cells.index])
    axes.tick_params(length=0, labelsize=7.5)
    for side in axes.spines.values():
        side.set_visible(False)


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def place_of(values: Sequence[float], wanted: np.ndarray) -> np.ndarray:
    """Where numbers lie among the evenly drawn cells of a map.

    Args:
        values: Of the cells, ascending.
        wanted: The numbers, shape ``(n,)``.

    Returns:
        Coordinates on the axis, beyond its ends by the nearest step, shape ``(n,)``.
    """
    places = np.arange(len(values))
    inside = np.interp(wanted, values, places)
    below = (wanted - values[0]) / (values[1] - values[0])
    above = places[-1] + (wanted - values[-1]) / (values[-1] - values[-2])
    return np.where(wanted < values[0], below, np.where(wanted > values[-1], above, inside))


def ending_handles(table: pd.DataFrame) -> list[Artist]:
    """Legend entries of the endings that occur.

    Args:
        table: With ``ending``.

    Returns:
        The entries.
    """
    occurring = set(table["ending"])
    return [
        Patch(color=_tinted(colour), label="limit cycle (amplitude in °)" if name == _CYCLE else name)
        for name, colour in ENDING_COLOURS.items()
        if name in occurring
    ]


def draw_series(
    axes: Axes,
    table: pd.DataFrame,
    by: str,
    across: str,
    seen: str,
    predicted: str,
    names: Mapping[Any, str],
) -> None:
    """Draw what was seen as dots and what was predicted as lines, one colour per series.

    Args:
        axes: The panel.
        table: One row per point.
        by: Column that tells the series apart.
        across: Column of the horizontal axis.
        seen: Column of the dots.
        predicted: Column of the lines.
        names: Labels of the series, in the order of their colours.
    """
    for (key, label), colour in zip(names.items(), SERIES_COLOURS, strict=False):
        rows = table[table[by] == key].sort_values(across)
        axes.plot(rows[across], rows[predicted], color=colour, linewidth=1.4, label=label)
        axes.plot(rows[across], rows[seen], "o", color=colour, markersize=4.5)


def seen_and_predicted(seen: str, predicted: str) -> list[Artist]:
    """Legend entries of dots and lines.

    Args:
        seen: What the dots are.
        predicted: What the lines are.

    Returns:
        The entries.
    """
    return [
        Line2D([], [], color=GREY, marker="o", linestyle="", markersize=4.5, label=seen),
        Line2D([], [], color=GREY, linewidth=1.4, label=predicted),
    ]


def note(axes: Axes, text: str, x: float, y: float, colour: str = BLACK) -> None:
    """Write a few words into a panel.

    Args:
        axes: The panel.
        text: The words.
        x: Share of the panel's width.
        y: Share of its height.
        colour: Of the words.
    """
    axes.text(x, y, text, transform=axes.transAxes, fontsize=8, color=colour, ha="left", va="top")
