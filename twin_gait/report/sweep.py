"""Pictures of a sweep: main effect of every parameter, and heat maps over pairs of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from twin_gait.palette import BLUE, GREY
from twin_gait.report.canvas import save, style_panel
from twin_gait.report.sweep_axes import Axis, axis_of, is_logarithmic, label_of
from twin_gait.vocabulary import Outcome

WALKED = "walked"
DEFAULT_MEASURES = ("battery_power_mean_W",)
SPREAD = (0.1, 0.9)
MOST_PAIRS = 6
MOST_PARAMETERS = 12
PANELS_IN_ROW = 3
MOST_COLUMNS_WRITTEN = 6
_COLOURS = LinearSegmentedColormap.from_list("share", ["#F4F6F8", BLUE])


def write_sweep_figures(
    table: pd.DataFrame, parameters: Sequence[str], measures: Sequence[str], title: str, folder: Path
) -> list[Path]:
    """Draw a sweep: the share that walked, then each measure over the episodes that did.

    Returns:
        The files: ``main_effects_<measure>.png`` and, of two parameters or more, ``heat_map_<measure>.png``.
    """
    axes = [axis for axis in (axis_of(table, name) for name in parameters) if axis is not None]
    axes = axes[:MOST_PARAMETERS]
    written = []
    for measure in (WALKED, *(measures or DEFAULT_MEASURES)):
        values = values_of(table, measure)
        if not axes or not np.isfinite(values).any():
            continue
        written.append(
            save(draw_main_effects(axes, values, measure, title), folder / f"main_effects_{measure}.png")
        )
        if len(axes) > 1:
            written.append(
                save(draw_heat_maps(axes, values, measure, title), folder / f"heat_map_{measure}.png")
            )
    return written


def values_of(table: pd.DataFrame, measure: str) -> np.ndarray:
    """A measure of every episode.

    Returns:
        Numbers, NaN where the wearer did not walk or there is none, shape ``(n,)``; 1 or 0 for ``walked``.
    """
    # An episode without a verdict is one that was not asked to walk, such as a held posture on the bench.
    walked = (table["outcome"].isna() | (table["outcome"] == Outcome.WALKED)).to_numpy()
    if measure == WALKED:
        return walked.astype(float)
    if measure not in table:
        return np.full(len(table), np.nan)
    values: np.ndarray = table[measure].to_numpy(dtype=float, na_value=np.nan)
    return np.where(walked, values, np.nan)


def cell_means(values: np.ndarray, first: Axis, second: Axis) -> np.ndarray:
    """Mean over the episodes of each combination of two parameters' levels.

    Returns:
        Means, NaN where there is no episode, shape ``(k_first, k_second)``.
    """
    sums, counts = np.zeros((2, len(first.names), len(second.names)))
    there = np.isfinite(values) & (first.places >= 0) & (second.places >= 0)
    cells = first.places[there], second.places[there]
    np.add.at(sums, cells, values[there])
    np.add.at(counts, cells, 1.0)
    means: np.ndarray = np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0.0)
    return means


def draw_main_effects(axes: Sequence[Axis], values: np.ndarray, measure: str, title: str) -> Figure:
    """Draw a measure against each parameter alone, averaged over the others.

    Returns:
        The figure.
    """
    what = _what(measure)
    if measure != WALKED:
        what += f"\nline: mean, shade: {SPREAD[0]:.0%} to {SPREAD[1]:.0%} of the episodes, dots: episodes"
    figure, panels = _panels(f"{title}: {what}", len(axes), height=3.0)
    for panel, axis in zip(panels, axes, strict=True):
        _draw_effect(panel, axis, values, measure)
    _share_range(panels)
    return figure


def draw_heat_maps(axes: Sequence[Axis], values: np.ndarray, measure: str, title: str) -> Figure:
    """Draw the mean of a measure over pairs of parameters, averaged over the others.

    Returns:
        The figure.
    """
    pairs = list(itertools.combinations(axes, 2))[:MOST_PAIRS]
    cells = [cell_means(values, second, first) for first, second in pairs]
    blank = ", white: none" if any(np.isnan(means).any() for means in cells) else ""
    figure, panels = _panels(f"{title}: {_what(measure)}{blank}", len(pairs), height=3.9)
    lowest, highest = _range(cells, measure)
    for panel, (first, second), means in zip(panels, pairs, cells, strict=True):
        image = panel.imshow(means, origin="lower", aspect="auto", cmap=_COLOURS, vmin=lowest, vmax=highest)
        _write_cells(panel, means, measure, lowest, highest)
        panel.set_xticks(range(len(first.names)), first.names, rotation=45 if len(first.names) > 6 else 0)
        panel.set_yticks(range(len(second.names)), second.names)
        panel.set_xlabel(_axis_label(first))
        panel.set_ylabel(_axis_label(second))
    figure.colorbar(image, ax=panels, label=label_of(measure) if measure != WALKED else "share that walked")
    return figure


def _what(measure: str) -> str:
    if measure == WALKED:
        return "share of the episodes that walked"
    return f"{label_of(measure, unit=False)}, mean over the episodes that walked"


def _panels(title: str, count: int, *, height: float) -> tuple[Figure, list[Axes]]:
    columns = min(count, PANELS_IN_ROW)
    rows = -(-count // columns)
    width = max(6.5, 4.0 * columns)
    figure = Figure(figsize=(width, height * rows + 0.6), layout="constrained")
    figure.suptitle(title, fontsize="large")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel in panels[count:]:
        panel.remove()
    return figure, panels[:count]


def _draw_effect(panel: Axes, axis: Axis, values: np.ndarray, measure: str) -> None:
    there = np.isfinite(values) & (axis.places >= 0)
    groups = [values[there & (axis.places == place)] for place in range(len(axis.names))]
    filled = [place for place, group in enumerate(groups) if len(group)]
    centres = np.asarray(axis.centres, dtype=float)[filled]
    means = np.array([groups[place].mean() for place in filled])
    if measure != WALKED:
        _draw_spread(panel, axis, values, there, centres, [groups[place] for place in filled])
    panel.plot(centres, means, "o" if axis.numbers is None else "o-", color=BLUE, linewidth=1.8, markersize=5)
    if axis.numbers is None:
        panel.set_xticks(range(len(axis.names)), axis.names)
        panel.set_xlim(-0.5, len(axis.names) - 0.5)
    elif is_logarithmic(axis):
        panel.set_xscale("log")
    style_panel(panel, "", "share that walked" if measure == WALKED else label_of(measure))
    panel.set_xlabel(label_of(axis.column))


def _draw_spread(
    panel: Axes,
    axis: Axis,
    values: np.ndarray,
    there: np.ndarray,
    centres: np.ndarray,
    groups: Sequence[np.ndarray],
) -> None:
    """What the mean is the mean of: every episode, or the range of most of them."""
    low, high = np.array([np.quantile(group, SPREAD) for group in groups]).T
    if axis.binned and axis.numbers is not None:
        panel.plot(axis.numbers[there], values[there], ".", color=GREY, markersize=3, alpha=0.5)
    elif axis.numbers is None:
        panel.vlines(centres, low, high, color=BLUE, alpha=0.3, linewidth=8)
    else:
        panel.fill_between(centres, low, high, color=BLUE, alpha=0.15, linewidth=0)


def _share_range(panels: Sequence[Axes]) -> None:
    """One vertical scale, so that effects can be compared."""
    lowest = min(panel.get_ylim()[0] for panel in panels)
    highest = max(panel.get_ylim()[1] for panel in panels)
    for panel in panels:
        panel.set_ylim(lowest, highest)


def _range(cells: Sequence[np.ndarray], measure: str) -> tuple[float, float]:
    if measure == WALKED:
        return 0.0, 1.0
    finite = np.concatenate([means[np.isfinite(means)] for means in cells])
    return float(finite.min()), float(finite.max())


def _write_cells(panel: Axes, means: np.ndarray, measure: str, lowest: float, highest: float) -> None:
    """Numbers in the cells, as long as they can be read."""
    panel.set_facecolor("white")
    if means.shape[1] > MOST_COLUMNS_WRITTEN or means.shape[0] > 2 * MOST_COLUMNS_WRITTEN:
        return
    for (row, column), mean in np.ndenumerate(means):
        if np.isfinite(mean):
            dark = mean > lowest + 0.55 * (highest - lowest)
            text = f"{100 * mean:.0f}%" if measure == WALKED else f"{mean:.3g}"
            panel.text(
                column, row, text, ha="center", va="center", fontsize=8, color="white" if dark else "black"
            )


def _axis_label(axis: Axis) -> str:
    return f"{label_of(axis.column)}{', middle of bins' if axis.binned else ''}"
