"""Drawing of figures 3.2 and 3.3."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from twin_gait.measures.effort import root_mean_square
from twin_gait.palette import BLACK, BLUE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import style_panel
from twin_gait.studies.reproduction.shared import LawFit, law_torque, table_values
from twin_gait.vocabulary import JointName

AXIS_END = 0.6  # [rad/s], of figures 3.2 and 3.3
_SHOWN = 5000
_BIN, _FEWEST = 0.05, 5  # [rad/s], samples
_SPREADS = (0.2, 0.5, 1.0, 2.0, 5.0)  # [N m], ticks


def draw_fits(joint: JointName, late: LawFit, prompt: LawFit, printed: float) -> Figure:
    """Samples and laws of both processings, and where the residuals are.

    Args:
        joint: Knee or hip.
        late: Fit after the thesis's processing.
        prompt: Fit without delay.
        printed: R² that the thesis prints.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(11.0, 7.4), layout="constrained")
    panels = figure.subplot_mosaic("AB;RR", height_ratios=[1.7, 1.0])
    for name, fit, title in (("A", late, "the thesis's processing"), ("B", prompt, "without delay")):
        _draw_samples(panels[name], joint, fit)
        style_panel(panels[name], f"{title}: R² = {fit.goodness.r_squared:.3f}", "friction torque [N m]")
    low, high = np.quantile(late.torque, [0.01, 0.99])
    for name in "AB":
        panels[name].set_ylim(low - 1.0, high + 1.0)
    panels["A"].text(0.98, 0.03, f"thesis: R² = {printed:g}", transform=panels["A"].transAxes, ha="right")
    panels["B"].legend(loc="lower right", fontsize="small", frameon=False, markerscale=4.0)
    for fit, colour, label in (
        (late, BLUE, "the thesis's processing"),
        (prompt, VERMILLION, "without delay"),
    ):
        speeds, spread = _spread(fit)
        panels["R"].plot(speeds, spread, "o-", color=colour, label=label, markersize=4)
    style_panel(panels["R"], "RMS residual by speed", "[N m]")
    panels["R"].set(xlabel="velocity [rad/s]", yscale="log", xlim=(0.0, 1.05 * AXIS_END))
    panels["R"].yaxis.set_minor_formatter(NullFormatter())
    panels["R"].set_yticks(_SPREADS, [f"{value:g}" for value in _SPREADS])
    panels["R"].legend(fontsize="small", frameon=False)
    return figure


def _draw_samples(axes: Axes, joint: JointName, fit: LawFit) -> None:
    step = max(1, len(fit.velocity) // _SHOWN)
    axes.plot(fit.velocity[::step], fit.torque[::step], ".", color=SKY_BLUE, markersize=2.0, label="samples")
    speeds = AXIS_END * np.linspace(0.0, 1.05, 400) ** 2
    axes.plot(speeds, law_torque(fit.values, speeds), color=VERMILLION, linewidth=2.0, label="fit of (3.1)")
    axes.plot(
        speeds,
        law_torque(table_values(joint), speeds),
        "--",
        color=BLACK,
        label="table 3.1: friction of the bench",
    )
    axes.set(xlabel="velocity [rad/s]", xlim=(0.0, 1.05 * AXIS_END))


def _spread(fit: LawFit) -> tuple[np.ndarray, np.ndarray]:
    """RMS of the residuals in bins of the speed."""
    place = (fit.velocity / _BIN).astype(int)
    filled = [number for number in range(int(place.max()) + 1) if (place == number).sum() >= _FEWEST]
    spread = [root_mean_square(fit.residuals[place == number]) for number in filled]
    return (np.array(filled) + 0.5) * _BIN, np.array(spread)
