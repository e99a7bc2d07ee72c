"""Figures 3.1 to 3.4 and table 3.1."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from thesis.friction import (
    AXIS_END,
    JOINTS,
    LETTERS,
    PERIOD,
    PRINTED,
    TREATMENTS,
    UNITS,
    WINDOW,
    LawFit,
    law_torque,
    rms,
    table_values,
)
from thesis.velocity import FilteredFall

from twin_gait import JointName
from twin_gait.gait.table import TICK
from twin_gait.palette import BLACK, BLUE, GREY, JOINT_COLOURS, ORANGE, SKY_BLUE, VERMILLION
from twin_gait.report.canvas import style_panel

_SHOWN = 5000  # samples
_BIN, _FEWEST = 0.05, 5  # [rad/s], samples
_SPREADS = (0.2, 0.5, 1.0, 2.0, 5.0)  # [N·m], ticks


def draw_velocities(fall: FilteredFall) -> Figure:
    """Draw the three signals over the fall, and in detail around its beginning."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    whole, close = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    ticks, samples = TICK * np.arange(len(fall.raw)), PERIOD * np.arange(len(fall.slow))
    label = f"{1e3 * fall.delay:.0f} ms later"
    for axes in (whole, close):
        axes.plot(ticks, fall.raw, color=BLUE, linewidth=0.7, alpha=0.7, label="ω, 1 kHz")
        axes.plot(
            samples, fall.slow, ".-", color=VERMILLION, markersize=3, linewidth=0.6, label="decimated by 10"
        )
        axes.plot(samples, fall.late, color=ORANGE, linewidth=2.2, label=f"mean of {WINDOW}")
        axes.plot(samples + fall.delay, fall.slow, ":", color=BLACK, linewidth=1.0, label=label)
        axes.set_xlabel("time [s]")
    style_panel(whole, "a fall to the stop", "velocity [rad/s]")
    whole.legend(frameon=False, fontsize="small", loc="upper left")
    moving = samples[int(np.argmax(fall.late > 0.5 * fall.late.max()))]
    close.set_xlim(moving - 0.25, moving + 0.25)
    near = fall.slow[np.abs(samples - moving) < 0.25]
    close.set_ylim(near.min() - 0.01, near.max() + 0.01)
    style_panel(close, f"{1e3 * fall.delay:.1f} ms late, not 0.5 s", "velocity [rad/s]")
    return figure


def draw_fits(joint: JointName, late: LawFit, prompt: LawFit) -> Figure:
    """Draw samples and laws of both processings, and the residuals."""
    figure = Figure(figsize=(11.0, 7.4), layout="constrained")
    panels = figure.subplot_mosaic("AB;RR", height_ratios=[1.7, 1.0])
    both = (("A", late, "the thesis's processing", BLUE), ("B", prompt, "without delay", VERMILLION))
    low, high = np.quantile(late.torque, [0.01, 0.99])
    for name, fit, title, colour in both:
        _draw_samples(panels[name], joint, fit)
        style_panel(panels[name], f"{title}: R² = {fit.goodness.r_squared:.3f}", "friction torque [N·m]")
        panels[name].set_ylim(low - 1.0, high + 1.0)
        speeds, spread = _spread(fit)
        panels["R"].plot(speeds, spread, "o-", color=colour, label=title, markersize=4)
    printed = f"thesis: R² = {PRINTED[joint][0]:g}"
    panels["A"].text(0.98, 0.03, printed, transform=panels["A"].transAxes, ha="right")
    panels["B"].legend(loc="lower right", fontsize="small", frameon=False, markerscale=4.0)
    style_panel(panels["R"], "RMS residual by speed", "[N·m]")
    panels["R"].set(xlabel="velocity [rad/s]", yscale="log", xlim=(0.0, 1.05 * AXIS_END))
    panels["R"].yaxis.set_minor_formatter(NullFormatter())
    panels["R"].set_yticks(_SPREADS, [f"{value:g}" for value in _SPREADS])
    panels["R"].legend(fontsize="small", frameon=False)
    return figure


def _draw_samples(axes: Axes, joint: JointName, fit: LawFit) -> None:
    step = max(1, len(fit.velocity) // _SHOWN)
    axes.plot(fit.velocity[::step], fit.torque[::step], ".", color=SKY_BLUE, markersize=2.0, label="samples")
    speeds = AXIS_END * np.linspace(0.0, 1.05, 400) ** 2
    true = law_torque(table_values(joint), speeds)
    axes.plot(speeds, law_torque(fit.values, speeds), color=VERMILLION, linewidth=2.0, label="fit of (3.1)")
    axes.plot(speeds, true, "--", color=BLACK, label="table 3.1: friction of the bench")
    axes.set(xlabel="velocity [rad/s]", xlim=(0.0, 1.05 * AXIS_END))


def _spread(fit: LawFit) -> tuple[np.ndarray, np.ndarray]:
    """Return the RMS of the residuals in bins of the speed."""
    bins = (fit.velocity / _BIN).astype(int)
    filled = [number for number in range(int(bins.max()) + 1) if (bins == number).sum() >= _FEWEST]
    return (np.array(filled) + 0.5) * _BIN, np.array([rms(fit.residuals[bins == each]) for each in filled])


def draw_comparison(fits: Mapping[JointName, LawFit], fastest: float) -> Figure:
    """Draw printed and identified laws over low speeds and over the speeds of a gait."""
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    panels = ((AXIS_END, "speeds of the falls"), (fastest, "speeds of the motor-driven tests"))
    for axes, (end, title) in zip(figure.subplots(1, 2), panels, strict=True):
        speeds = np.concatenate([[0.0], end * np.linspace(0.01, 1.0, 300) ** 2])
        for joint, fit in fits.items():
            look = {"color": JOINT_COLOURS[joint]}
            true, found = (law_torque(values, speeds) for values in (table_values(joint), fit.values))
            axes.plot(speeds, true, alpha=0.35, linewidth=5.0, label=f"{joint}, table 3.1", **look)
            axes.plot(speeds, found, "--", label=f"{joint}, identified", **look)
        axes.set(xlabel="velocity [rad/s]", xlim=(0.0, end), ylim=(0.0, None))
        style_panel(axes, title, "friction torque [N·m]")
    figure.axes[0].legend(frameon=False, fontsize="small", loc="lower right")
    return figure


def draw_table(fits: Mapping[tuple[JointName, int], LawFit]) -> Figure:
    """Draw 95 % intervals of the parameters by treatment, with a panel for each parameter and joint."""
    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    for row, joint in zip(figure.subplots(len(JOINTS), len(LETTERS), sharey=True), JOINTS, strict=True):
        for axes, letter in zip(row, LETTERS, strict=True):
            for index in range(len(TREATMENTS)):
                fit = fits[joint, index]
                axes.plot(fit.intervals[letter], [index, index], color=JOINT_COLOURS[joint], linewidth=2.5)
                axes.plot(fit.values[letter], index, "o", color=JOINT_COLOURS[joint], markersize=5)
            axes.axvline(table_values(joint)[letter], color=BLACK, linestyle="--", linewidth=1.0)
            axes.axvline(0.0, color=GREY, linewidth=0.6)
            style_panel(axes, f"{joint}: {letter} [{UNITS[letter]}]", "")
            labels = [label for _, _, label, _ in TREATMENTS]
            axes.set_yticks(range(len(TREATMENTS)), labels, fontsize="small")
            axes.set_ylim(len(TREATMENTS) - 0.5, -0.5)
    return figure
