"""Pictures of an identification: friction over speed with the best laws, and where the residuals go."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binned_statistic

from twin_gait.identification import Identification, IdentifiedModel, Samples
from twin_gait.identification.models import thinned
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, GREY, ORANGE, REDDISH_PURPLE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import readable, style_panel

_SHOWN_SAMPLES = 15_000
_LONG = 1e9  # [s]
_LINES = ((VERMILLION, "-"), (BLUE, "--"), (BLUISH_GREEN, "-."), (ORANGE, ":"))  # of the best models
_TEST_COLOURS = np.array([SKY_BLUE, REDDISH_PURPLE, BLUISH_GREEN, ORANGE, BLUE, GREY])
_BINS = 30
_PANELS = {"all speeds": 1.0, "slow": 0.25}  # share of the largest speed that each shows


def draw_fits(result: Identification) -> Figure:
    """Draw the samples and the best models over the speed."""
    samples, best = result.samples.used_only(), result.models[0]
    figure = Figure(figsize=(12.0, 5.2), layout="constrained")
    figure.suptitle(f"Friction · best: {readable(best.name)}, RMSE {best.goodness.rmse:.3g} N m")
    low, high = float(samples.velocity.min()), float(samples.velocity.max())
    even, shown = np.linspace(-1.0, 1.0, 1201), thinned(samples, _SHOWN_SAMPLES)
    grid = max(-low, high) * even * np.abs(even)  # denser near zero
    grid = grid[(low <= grid) & (grid <= high)]
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (title, share) in zip(panels, _PANELS.items(), strict=True):
        axes.plot(shown.velocity, shown.torque, ".", color="0.72", markersize=2.0, label="measured")
        for item, (colour, style) in zip(result.models, _LINES, strict=False):
            label = f"{readable(item.name)}{' (steady sliding)' if item.fit.model.dynamic else ''}"
            curve = _steady_curve(item, samples, grid)
            axes.plot(grid[1:], curve[1:], color=colour, linestyle=style, label=label)
        axes.set_xlim(share * min(low, 0.0), share * max(high, 0.0))
        axes.set_xlabel("velocity [rad/s]")
        style_panel(axes, title, "friction torque [N m]")
    bottom, top = np.quantile(samples.torque, [0.001, 0.999])
    margin = 0.15 * max(top - bottom, 1e-9)
    panels[0].set_ylim(bottom - margin, top + margin)
    panels[0].legend(fontsize="small", frameon=False, loc="upper left", markerscale=4.0)
    return figure


def _steady_curve(item: IdentifiedModel, samples: Samples, velocity: np.ndarray) -> np.ndarray:
    """Torque of a model in steady sliding, at the mean angle, load and temperature of samples.

    Each speed is kept for long, whatever came before; that of a state at the first one is not known.
    """
    number = len(velocity)
    known = {name: getattr(samples, name) for name in ("angle", "load", "temperature")}
    steady = replace(
        samples.rows(np.zeros(number, dtype=int)),
        velocity=velocity,
        fresh=np.arange(number) == 0,
        period=np.full(number, _LONG),
        **{name: np.full(number, np.abs(x).mean()) for name, x in known.items() if x is not None},
    )
    return item.fit.model.predict(item.fit.x, steady)


def draw_residuals(result: Identification) -> Figure:
    """Draw the residuals of the best model against speed, load, angle, time and temperature, and medians."""
    samples, best = result.samples.used_only(), result.models[0]
    known = {
        "velocity [rad/s]": samples.velocity,
        "load torque [N m]": samples.load,
        "joint angle [rad]": samples.angle,
        "time in the test [s]": samples.time,
        "temperature [°C]": samples.temperature,
    }
    columns = {name: values for name, values in known.items() if values is not None}
    figure = Figure(figsize=(1.0 + 3.6 * len(columns), 4.0), layout="constrained")
    figure.suptitle(f"Residuals of {readable(best.name)}: measured less predicted")
    panels = figure.subplots(1, len(columns), sharey=True, squeeze=False)[0]
    some = slice(None, None, -(-len(samples) // _SHOWN_SAMPLES))
    colours = _TEST_COLOURS[samples.test[some] % len(_TEST_COLOURS)]
    for axes, (label, values) in zip(panels, columns.items(), strict=True):
        axes.scatter(values[some], best.residuals[some], s=3.0, c=colours, alpha=0.5, linewidths=0.0)
        middle, edges, _ = binned_statistic(values, best.residuals, "median", bins=_BINS)
        axes.stairs(middle, edges, baseline=None, color=BLACK, linewidth=1.6)
        axes.set_xlabel(label)
        style_panel(axes, "", "residual [N m]")
    limit = float(np.quantile(np.abs(best.residuals), 0.999)) * 1.15 or 1.0
    panels[0].set_ylim(-limit, limit)
    return figure
