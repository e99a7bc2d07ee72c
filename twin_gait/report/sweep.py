"""Pictures of a sweep: main effect of every parameter, and heat maps over pairs of parameters.

Columns of the sweep's table become axes with levels or bins.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from textwrap import fill

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from twin_gait.labels import label_of
from twin_gait.palette import BLUE
from twin_gait.report.canvas import Drawing, style_panel
from twin_gait.vocabulary import Outcome

WALKED = "walked"
DEFAULT_MEASURES = ("battery_power_mean_W",)
MOST_PAIRS = 6
MOST_PARAMETERS = 12
PANELS_IN_ROW = 3
_COLOURS = LinearSegmentedColormap.from_list("share", ["#F4F6F8", BLUE])
# More distinct values than this are divided into bins.
MOST_LEVELS = 12
EPISODES_PER_BIN = 6
LABEL_WIDTH = 28  # letters in a line of the label of an axis
FIGURE_KINDS = {"main_effects_": "main effects", "heat_map_": "heat maps"}
MOST_BINS = 8


def parameter_axis(table: pd.DataFrame, column: str) -> pd.Series | None:
    """Return the level of a parameter in each episode, or the median of a bin of equally many episodes.

    Returns an ordered category, missing where an episode has no value; None for fewer than two values.
    """
    values, count = table[column], table[column].nunique()
    if count < 2:
        return None
    if count <= MOST_LEVELS or not pd.api.types.is_numeric_dtype(values):
        return values.astype("category")
    bins = pd.qcut(values, int(np.clip(len(values) / EPISODES_PER_BIN, 2, MOST_BINS)), duplicates="drop")
    return bins.cat.rename_categories(values.groupby(bins, observed=True).median().tolist())


def level_names(axis: pd.Series) -> list[str]:
    """Return the labels of the levels of an axis, numbers in their display unit."""
    digits = partial(np.format_float_positional, precision=4, fractional=False, trim="-")
    levels, factor = axis.cat.categories, label_of(str(axis.name)).factor
    shown = levels * factor if factor != 1.0 and pd.api.types.is_numeric_dtype(levels) else levels
    return [digits(item) if isinstance(item, float) else str(item) for item in shown]


def varying_axes(table: pd.DataFrame, parameters: Sequence[str]) -> list[pd.Series]:
    """Return the axes of the first ``MOST_PARAMETERS`` parameters that vary."""
    axes = (parameter_axis(table, name) for name in parameters)
    return [axis for axis in axes if axis is not None][:MOST_PARAMETERS]


def main_effect(axis: pd.Series, values: np.ndarray) -> pd.DataFrame:
    """Summarise a measure at each level of a parameter.

    ``values``: one per episode, NaN where the wearer did not walk, shape ``(n,)``. Returns a row per level:
    number of all ``episodes``, number ``n`` of those with the measure, and ``mean`` and sample standard
    deviation ``sd`` over these, NaN where there are too few.
    """
    groups = pd.Series(values, axis.index).groupby(axis, observed=False)
    found = pd.DataFrame({"episodes": groups.size(), "n": groups.count(), "mean": groups.mean()})
    return found.assign(sd=groups.std())


def main_effect_rows(
    table: pd.DataFrame, parameters: Sequence[str], measures: Sequence[str]
) -> list[tuple[str, ...]]:
    """Write the main effects as rows of text for a page; the first is the head."""
    rows: list[tuple[str, ...]] = [("measure", "parameter", "level", "episodes", "n", "mean", "SD")]
    for measure in measures:
        values = measure_values(table, measure)
        for axis in varying_axes(table, parameters) if np.isfinite(values).any() else ():
            found = main_effect(axis, values)
            means, spreads = found["mean"].to_list(), found["sd"].to_list()
            counts = found[["episodes", "n"]].astype(str).to_numpy().tolist()
            for name, (total, n), mean, sd in zip(level_names(axis), counts, means, spreads, strict=True):
                spread = "" if measure == WALKED else _digits(sd)
                parameter = label_of(str(axis.name)).title
                rows.append((_measure_label(measure), parameter, name, total, n, _digits(mean), spread))
    return rows


def _digits(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"


def sweep_figures(
    table: pd.DataFrame, parameters: Sequence[str], measures: Sequence[str], title: str
) -> dict[str, Drawing]:
    """Return the figures of a sweep: the share that walked, or a measure over the episodes that walked.

    ``parameters``: columns of the varied parameters; ``measures``: ``walked`` and columns. Returns
    ``main_effects_<measure>`` and, with two parameters or more, ``heat_map_<measure>``.
    """
    axes = varying_axes(table, parameters)
    figures: dict[str, Drawing] = {}
    for measure in measures:
        values = measure_values(table, measure)
        if not axes or not np.isfinite(values).any():
            continue
        figures[f"main_effects_{measure}"] = partial(draw_main_effects, axes, values, measure, title)
        if len(axes) > 1:
            figures[f"heat_map_{measure}"] = partial(draw_heat_maps, axes, values, measure, title)
    return figures


def figure_heading(name: str) -> str:
    """Return the heading of a figure of :func:`sweep_figures` on a page."""
    kind = next(kind for kind in FIGURE_KINDS if name.startswith(kind))
    return f"{FIGURE_KINDS[kind]}: {_measure_label(name.removeprefix(kind))}"


def measure_values(table: pd.DataFrame, measure: str) -> np.ndarray:
    """Return a measure of every episode in its display unit.

    ``measure``: a column, or ``walked``. Returns numbers, NaN where the wearer did not walk or has no value,
    shape ``(n,)``; for ``walked`` 1 or 0, and NaN for a run that was too short to judge.
    """
    # An episode without a verdict contains no walk, such as a held posture on the bench.
    walked = (table["outcome"].isna() | (table["outcome"] == Outcome.WALKED)).to_numpy()
    if measure == WALKED:
        return np.where(table["outcome"] == Outcome.TOO_SHORT, np.nan, walked.astype(float))
    if measure not in table:
        return np.full(len(table), np.nan)
    values: np.ndarray = table[measure].to_numpy(dtype=float, na_value=np.nan)
    return np.where(walked, label_of(measure).factor * values, np.nan)


def cell_means(values: np.ndarray, first: pd.Series, second: pd.Series) -> np.ndarray:
    """Compute the mean over the episodes of each combination of levels of two parameters.

    ``values``: one per episode, shape ``(n,)``. Returns means, NaN where there is no episode, shape
    ``(k_first, k_second)``.
    """
    cells = pd.Series(values, first.index).groupby([first, second], observed=False)
    means: np.ndarray = cells.mean().unstack().to_numpy()
    return means


def draw_main_effects(axes: Sequence[pd.Series], values: np.ndarray, measure: str, title: str) -> Figure:
    """Draw a measure (shape ``(n,)``) over each parameter alone, averaged over the others.

    Error bars show the standard deviation; n below a level is the number of episodes in the mean.
    """
    # All panels have the same vertical scale, so that effects can be compared.
    spread = "share of n runs" if measure == WALKED else "mean ± SD of the n runs that walked"
    heading = f"{title}: {_measure_label(measure)}\n{spread}"
    figure, panels = _panels(heading, len(axes), height=3.2, sharey=True)
    for panel, axis in zip(panels, axes, strict=True):
        found = main_effect(axis, values)
        bars = None if measure == WALKED else found["sd"].fillna(0.0)
        positions = range(len(found))
        panel.errorbar(
            positions, found["mean"], bars, fmt="o-", color=BLUE, lw=1.8, ms=5, elinewidth=1, capsize=3
        )
        style_panel(panel, "", fill(_measure_label(measure), LABEL_WIDTH))
        _name_levels(panel, axis, found["n"].tolist())
        panel.tick_params(labelleft=True)
    if measure == WALKED:
        panels[0].set_ylim(-0.04, 1.04)
    return figure


def draw_heat_maps(axes: Sequence[pd.Series], values: np.ndarray, measure: str, title: str) -> Figure:
    """Draw the mean of a measure over the first ``MOST_PAIRS`` pairs, averaged over the other parameters."""
    pairs = list(itertools.combinations(axes, 2))[:MOST_PAIRS]
    cells = [cell_means(values, second, first) for first, second in pairs]
    sizes = [pd.Series(1.0, x.index).groupby([y, x], observed=False).sum().unstack() for x, y in pairs]
    empty = [np.isnan(means) & (size.to_numpy() > 0) for means, size in zip(cells, sizes, strict=True)]
    legend = "hatched: none walked, or none has a value" if any(where.any() for where in empty) else ""
    if any((size.to_numpy() == 0).any() for size in sizes):
        legend = ", ".join(filter(None, (legend, "blank: no episode")))
    heading = "\n".join(filter(None, (f"{title}: {_measure_label(measure)}", legend)))
    figure, panels = _panels(heading, len(pairs), height=3.9)
    every = np.concatenate([means.ravel() for means in cells])
    lowest, highest = (0.0, 1.0) if measure == WALKED else (np.nanmin(every), np.nanmax(every))
    for panel, (first, second), means, where in zip(panels, pairs, cells, empty, strict=True):
        image = panel.imshow(means, origin="lower", aspect="auto", cmap=_COLOURS, vmin=lowest, vmax=highest)
        for row, column in np.argwhere(where):
            corner = (column - 0.5, row - 0.5)
            panel.add_patch(Rectangle(corner, 1, 1, fill=False, hatch="//", edgecolor="0.6", linewidth=0))
        _name_levels(panel, first)
        panel.set_yticks(range(len(level_names(second))), level_names(second))
        panel.set_ylabel(fill(label_of(str(second.name)).axis, LABEL_WIDTH))
    figure.colorbar(image, ax=panels, label=_measure_label(measure))
    return figure


def _name_levels(panel: Axes, axis: pd.Series, counts: Sequence[int] = ()) -> None:
    """Write a parameter and its levels below a panel, with the number of episodes at each."""
    names = level_names(axis)
    if counts:
        names = [f"{name}\nn = {count}" for name, count in zip(names, counts, strict=True)]
    panel.set_xticks(range(len(names)), names, rotation=45 if len(names) > 6 else 0)
    panel.set_xlabel(fill(label_of(str(axis.name)).axis, LABEL_WIDTH))


def _measure_label(measure: str) -> str:
    return "share that walked" if measure == WALKED else label_of(measure).title


def _panels(title: str, count: int, *, height: float, sharey: bool = False) -> tuple[Figure, list[Axes]]:
    columns = min(count, PANELS_IN_ROW)
    rows = -(-count // columns)
    width = max(6.5, 4.0 * columns)
    figure = Figure(figsize=(width, height * rows + 0.6), layout="constrained")
    figure.suptitle(title, fontsize="large")
    panels = list(figure.subplots(rows, columns, squeeze=False, sharey=sharey).flat)
    for panel in panels[count:]:
        panel.remove()
    return figure, panels[:count]
