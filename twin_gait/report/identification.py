"""Pictures of an identification: friction over speed with the best laws, and where the residuals go."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import readable, style_panel

SHOWN_MODELS = 4
_SHOWN_SAMPLES = 15_000
_COLOURS = (VERMILLION, BLUE, BLUISH_GREEN, ORANGE)
_STYLES = ("-", "--", "-.", ":")
_TEST_COLOURS = (SKY_BLUE, REDDISH_PURPLE, BLUISH_GREEN, ORANGE, BLUE, GREY)
_BINS = 30
_FEWEST_IN_BIN = 5
_NARROW = 0.25  # share of the largest speed that the second panel shows


class DrawnModel(NamedTuple):
    """What the pictures show of a fitted model.

    Attributes:
        name: Of the model.
        dynamic: Whether its curve is that of steady sliding.
        curve: Torque in [N m] over velocities in [rad] / [s].
        rmse: Of the fit in [N m].
        left_out: Errors in [N m] by what was left out.
    """

    name: str
    dynamic: bool
    curve: Callable[[np.ndarray], np.ndarray]
    rmse: float
    left_out: Mapping[str, float]


class DrawnSamples(NamedTuple):
    """What the pictures show of the samples that were fitted, each of shape ``(n,)``.

    Attributes:
        velocity: In [rad] / [s].
        torque: Friction torque in [N m].
        test: Index of the test.
        columns: What residuals are drawn against, by the label of the axis.
        residuals: Of the best model in [N m].
        threshold: Beyond which residuals are weighed less, in [N m].
    """

    velocity: np.ndarray
    torque: np.ndarray
    test: np.ndarray
    columns: Mapping[str, np.ndarray]
    residuals: np.ndarray
    threshold: float


def draw_fits(samples: DrawnSamples, models: Sequence[DrawnModel]) -> Figure:
    """Draw the samples and the best models over the speed, and the models' errors."""
    figure = Figure(figsize=(12.0, 8.2), layout="constrained")
    number, best = len(np.unique(samples.test)), models[0]
    figure.suptitle(
        f"Friction of {number} test{'s' if number > 1 else ''}, {len(samples.velocity)} samples · "
        f"best: {readable(best.name)}, RMSE {best.rmse:.3g} N m",
        fontsize="large",
    )
    panels = figure.subplot_mosaic("AAB;RRR", height_ratios=[1.6, 1.0])
    reach = float(np.abs(samples.velocity).max())
    _draw_laws(panels["A"], samples, models, reach)
    style_panel(panels["A"], "all speeds", "friction torque [N m]")
    _draw_laws(panels["B"], samples, models, _NARROW * reach)
    style_panel(panels["B"], "slow", "")
    panels["A"].legend(fontsize="small", frameon=False, loc="upper left", markerscale=4.0)
    _draw_ranking(panels["R"], models)
    return figure


def _draw_laws(axes: Axes, samples: DrawnSamples, models: Sequence[DrawnModel], reach: float) -> None:
    chosen = np.flatnonzero(np.abs(samples.velocity) <= reach)
    chosen = chosen[:: max(1, -(-len(chosen) // _SHOWN_SAMPLES))]
    axes.plot(
        samples.velocity[chosen],
        samples.torque[chosen],
        ".",
        color="0.72",
        markersize=2.0,
        label="measured",
        rasterized=True,
    )
    grid = _grid(samples.velocity, reach)
    for item, colour, style in zip(models[:SHOWN_MODELS], _COLOURS, _STYLES, strict=False):
        axes.plot(grid, item.curve(grid), color=colour, linestyle=style, label=_label(item))
    if len(chosen):
        low, high = np.quantile(samples.torque[chosen], [0.001, 0.999])
        margin = 0.15 * max(high - low, 1e-9)
        axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(grid[0], grid[-1])
    axes.set_xlabel("velocity [rad/s]")


def _grid(velocity: np.ndarray, reach: float) -> np.ndarray:
    """Speeds at which laws are drawn: denser near zero, and in the directions that were measured."""
    half = reach * np.linspace(0.0, 1.0, 600) ** 2
    parts: list[np.ndarray] = []
    if (velocity < 0.0).mean() > 0.005:
        parts.append(-half[:0:-1])
    parts.append(np.zeros(1))
    if (velocity > 0.0).mean() > 0.005:
        parts.append(half[1:])
    return np.concatenate(parts)


def _label(item: DrawnModel) -> str:
    return f"{readable(item.name)}{' (steady sliding)' if item.dynamic else ''}"


def _draw_ranking(axes: Axes, models: Sequence[DrawnModel]) -> None:
    """Errors of all models, fitted and on what was left out."""
    places = np.arange(len(models))
    axes.barh(places, [item.rmse for item in models], color=SKY_BLUE, height=0.6, label="fitted")
    for what, colour, marker in zip(models[0].left_out, (BLACK, VERMILLION), "|x", strict=False):
        errors = [item.left_out[what] for item in models]
        axes.plot(errors, places, marker, color=colour, markersize=9, label=f"left out: {what}")
    axes.set_yticks(places, [readable(item.name) for item in models], fontsize="small")
    axes.invert_yaxis()
    style_panel(axes, "RMSE [N m], best model first", "")
    axes.legend(fontsize="small", frameon=False, loc="upper right", bbox_to_anchor=(1.0, 1.16), ncols=3)


def draw_residuals(samples: DrawnSamples, name: str) -> Figure:
    """Draw the residuals of the best model against speed, load, angle, time and temperature."""
    shown = len(samples.columns) + 1
    rows = -(-shown // 2)
    figure = Figure(figsize=(12.0, 3.0 * rows + 0.6), layout="constrained")
    figure.suptitle(f"Residuals of {readable(name)}: measured less predicted", fontsize="large")
    panels = figure.subplots(rows, 2, squeeze=False).ravel()
    limit = float(np.quantile(np.abs(samples.residuals), 0.999)) * 1.15 or 1.0
    for axes, (label, values) in zip(panels, samples.columns.items(), strict=False):
        _draw_against(axes, values, samples.residuals, samples.test)
        axes.set_ylim(-limit, limit)
        style_panel(axes, "", "residual [N m]")
        axes.set_xlabel(label)
    _draw_histogram(panels[shown - 1], samples, limit)
    for axes in panels[shown:]:
        axes.set_visible(False)
    return figure


def _draw_against(axes: Axes, values: np.ndarray, residuals: np.ndarray, test: np.ndarray) -> None:
    """Points coloured by test, and the median with the middle half in bins."""
    step = max(1, -(-len(values) // _SHOWN_SAMPLES))
    for number, colour in enumerate(_TEST_COLOURS):
        mine = np.flatnonzero(test[::step] % len(_TEST_COLOURS) == number)
        axes.plot(
            values[::step][mine],
            residuals[::step][mine],
            ".",
            color=colour,
            markersize=1.8,
            alpha=0.5,
            rasterized=True,
        )
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    centres, quarters = _binned(values, residuals)
    if len(centres):
        axes.fill_between(centres, quarters[:, 0], quarters[:, 2], color=BLACK, alpha=0.25, linewidth=0)
        axes.plot(centres, quarters[:, 1], color=BLACK, linewidth=1.6)


def _binned(values: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres of bins of equal width, and the quartiles of the residuals in each."""
    edges = np.linspace(values.min(), values.max(), _BINS + 1)
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _BINS - 1)
    filled = [number for number in range(_BINS) if (place == number).sum() >= _FEWEST_IN_BIN]
    quarters = [np.quantile(residuals[place == number], [0.25, 0.5, 0.75]) for number in filled]
    return 0.5 * (edges[:-1] + edges[1:])[filled], np.array(quarters).reshape(-1, 3)


def _draw_histogram(axes: Axes, samples: DrawnSamples, limit: float) -> None:
    """Distribution of the residuals, with the robust threshold."""
    axes.hist(samples.residuals, bins=np.linspace(-limit, limit, 81).tolist(), color=SKY_BLUE)
    beyond = float((np.abs(samples.residuals) > samples.threshold).mean())
    seen = bool(beyond) and samples.threshold < limit
    if seen:
        for side in (-1.0, 1.0):
            axes.axvline(side * samples.threshold, color=VERMILLION, linestyle="--", linewidth=1.0)
    title = f"{100.0 * beyond:.2g} % beyond the dashed lines are weighed less" if seen else ""
    style_panel(axes, title, "samples")
    axes.set_xlabel("residual [N m]")
