"""Pictures of an identification: friction over speed with the best laws, and where the residuals go."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.identification import Identification, IdentifiedModel, Samples
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import readable, style_panel

SHOWN_MODELS = 4
_SHOWN_SAMPLES = 15_000
_LONG = 1e9  # [s]
_COLOURS = (VERMILLION, BLUE, BLUISH_GREEN, ORANGE)
_STYLES = ("-", "--", "-.", ":")
_TEST_COLOURS = (SKY_BLUE, REDDISH_PURPLE, BLUISH_GREEN, ORANGE, BLUE, GREY)
_BINS = 30
_FEWEST_IN_BIN = 5
_NARROW = 0.25  # share of the largest speed that the second panel shows


def draw_fits(result: Identification) -> Figure:
    """Draw the samples and the best models over the speed, and the models' errors."""
    samples, models = result.samples.used_only(), result.models
    figure = Figure(figsize=(12.0, 8.2), layout="constrained")
    number, best = len(np.unique(samples.test)), models[0]
    figure.suptitle(
        f"Friction of {number} test{'s' if number > 1 else ''}, {len(samples.velocity)} samples · "
        f"best: {readable(best.name)}, RMSE {best.goodness.rmse:.3g} N m",
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


def _draw_laws(axes: Axes, samples: Samples, models: Sequence[IdentifiedModel], reach: float) -> None:
    chosen = np.flatnonzero(np.abs(samples.velocity) <= reach)
    chosen = chosen[:: max(1, -(-len(chosen) // _SHOWN_SAMPLES))]
    measured: dict[str, Any] = {"color": "0.72", "markersize": 2.0, "label": "measured", "rasterized": True}
    axes.plot(samples.velocity[chosen], samples.torque[chosen], ".", **measured)
    grid = _grid(samples.velocity, reach)
    for item, colour, style in zip(models[:SHOWN_MODELS], _COLOURS, _STYLES, strict=False):
        label = f"{readable(item.name)}{' (steady sliding)' if item.fit.model.dynamic else ''}"
        axes.plot(grid, _steady_curve(item, samples, grid), color=colour, linestyle=style, label=label)
    if len(chosen):
        low, high = np.quantile(samples.torque[chosen], [0.001, 0.999])
        margin = 0.15 * max(high - low, 1e-9)
        axes.set_ylim(low - margin, high + margin)
    axes.set_xlim(grid[0], grid[-1])
    axes.set_xlabel("velocity [rad/s]")


def _grid(velocity: np.ndarray, reach: float) -> np.ndarray:
    """Speeds at which laws are drawn: denser near zero, and in the directions that were measured."""
    half = reach * np.linspace(0.0, 1.0, 600) ** 2
    measured = [way for way in (-1.0, 1.0) if (np.sign(velocity) == way).mean() > 0.005]
    grid = np.concatenate([-half[:0:-1], half])
    return grid[np.isin(np.sign(grid), [0.0, *measured])]


def _steady_curve(item: IdentifiedModel, samples: Samples, velocity: np.ndarray) -> np.ndarray:
    """Torque of a model in steady sliding, at the mean angle, load and temperature of samples."""
    number = len(velocity) + 1

    def held(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.full(number, float(values.mean()))

    steady = Samples(
        velocity=np.concatenate([velocity[:1], velocity]),
        torque=np.zeros(number),
        used=np.ones(number, dtype=bool),
        test=np.zeros(number, dtype=int),
        fresh=np.arange(number) == 0,
        period=np.full(number, _LONG),  # each point slides for long, whatever came before
        angle=held(samples.angle),
        load=held(None if samples.load is None else np.abs(samples.load)),
        temperature=held(samples.temperature),
    )
    return item.fit.model.predict(item.fit.x, steady)[1:]


def _draw_ranking(axes: Axes, models: Sequence[IdentifiedModel]) -> None:
    """Errors of all models, fitted and on what was left out."""
    places = np.arange(len(models))
    axes.barh(places, [item.goodness.rmse for item in models], color=SKY_BLUE, height=0.6, label="fitted")
    left_out = [{run.by: run.rmse for run in item.validations} for item in models]
    for what, colour, marker in zip(left_out[0], (BLACK, VERMILLION), "|x", strict=False):
        errors = [found[what] for found in left_out]
        axes.plot(errors, places, marker, color=colour, markersize=9, label=f"left out: {what}")
    axes.set_yticks(places, [readable(item.name) for item in models], fontsize="small")
    axes.invert_yaxis()
    style_panel(axes, "RMSE [N m], best model first", "")
    axes.legend(fontsize="small", frameon=False, loc="upper right", bbox_to_anchor=(1.0, 1.16), ncols=3)


def draw_residuals(result: Identification) -> Figure:
    """Draw the residuals of the best model against speed, load, angle, time and temperature."""
    samples, best = result.samples.used_only(), result.models[0]
    known = {
        "velocity [rad/s]": samples.velocity,
        "load torque [N m]": samples.load,
        "joint angle [rad]": samples.angle,
        "time in the test [s]": samples.time,
        "temperature [°C]": samples.temperature,
    }
    columns = {name: values for name, values in known.items() if values is not None}
    shown = len(columns) + 1
    rows = -(-shown // 2)
    figure = Figure(figsize=(12.0, 3.0 * rows + 0.6), layout="constrained")
    figure.suptitle(f"Residuals of {readable(best.name)}: measured less predicted", fontsize="large")
    panels = figure.subplots(rows, 2, squeeze=False).ravel()
    limit = float(np.quantile(np.abs(best.residuals), 0.999)) * 1.15 or 1.0
    for axes, (label, values) in zip(panels, columns.items(), strict=False):
        _draw_against(axes, values, best.residuals, samples.test)
        axes.set_ylim(-limit, limit)
        style_panel(axes, "", "residual [N m]")
        axes.set_xlabel(label)
    _draw_histogram(panels[shown - 1], best.residuals, best.fit.threshold, limit)
    for axes in panels[shown:]:
        axes.set_visible(False)
    return figure


def _draw_against(axes: Axes, values: np.ndarray, residuals: np.ndarray, test: np.ndarray) -> None:
    """Points coloured by test, and the median with the middle half in bins."""
    step = max(1, -(-len(values) // _SHOWN_SAMPLES))
    colours = [_TEST_COLOURS[number % len(_TEST_COLOURS)] for number in test[::step]]
    style: dict[str, Any] = {"s": 3.0, "alpha": 0.5, "linewidths": 0.0, "rasterized": True}
    axes.scatter(values[::step], residuals[::step], c=colours, **style)
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


def _draw_histogram(axes: Axes, residuals: np.ndarray, threshold: float, limit: float) -> None:
    """Distribution of the residuals, with the robust threshold."""
    axes.hist(residuals, bins=np.linspace(-limit, limit, 81).tolist(), color=SKY_BLUE)
    beyond = float((np.abs(residuals) > threshold).mean())
    seen = bool(beyond) and threshold < limit
    if seen:
        for side in (-1.0, 1.0):
            axes.axvline(side * threshold, color=VERMILLION, linestyle="--", linewidth=1.0)
    title = f"{100.0 * beyond:.2g} % beyond the dashed lines are weighed less" if seen else ""
    style_panel(axes, title, "samples")
    axes.set_xlabel("residual [N m]")
