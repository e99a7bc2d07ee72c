"""Pictures of a run for its directory and for a paper."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from string import ascii_lowercase
from typing import Any

from matplotlib.figure import Figure

from twin_gait.exceptions import ParameterError
from twin_gait.report import run_figures
from twin_gait.report.canvas import (
    SCREEN_WIDTH,
    has_cycles,
    legend_rows,
    standard_settings,
    write_pictures,
)
from twin_gait.simulation.run import Run

# Functions that draw a run in a width in inches, or return None if the picture does not apply, by name.
FIGURES: dict[str, Callable[..., Figure | None]] = {
    "gait_cycle": run_figures.draw_cycle,
    "ground_forces": run_figures.draw_ground_forces,
    "joint_angles": run_figures.draw_angles,
    "torques": run_figures.draw_torques,
    "currents": run_figures.draw_currents,
    "battery": run_figures.draw_battery,
    "feet": run_figures.draw_feet,
    "phase_portrait": run_figures.draw_portrait,
}

# Figures in a run folder; to draw all eight takes longer than the rest of the command.
DEFAULT_FIGURES = ("gait_cycle", "ground_forces", "torques")
DEFAULT_WITHOUT_STRIDES = ("joint_angles", "torques")
NARROWEST, WIDEST = 60.0, 270.0  # [mm]
INCH = 25.4  # [mm]
_ROW, _REST, _LEGEND_ROW = 34.0, 8.0, 3.7  # [mm] height of a row of panels, of their margin, of a legend row
_THINNER = 0.55  # width of lines in print over their width on a screen
PRINT_SETTINGS: dict[Any, float] = {
    "font.size": 7.0,  # [pt]; journals require 6 or more
    "axes.linewidth": 0.5,
    **{f"{axis}tick.major.{item}": 2.0 for axis in "xy" for item in ("size", "pad")},
    **{f"{axis}tick.major.width": 0.5 for axis in "xy"},
    "axes.labelpad": 2.0,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.0,
}


def screen_figures(run: Run) -> dict[str, Figure]:
    """Draw all pictures that apply to a run, by name in the order of ``FIGURES``; none for a single row.

    A run without strides has no picture of the gait cycle, and a run without ground has none of the feet.
    """
    with standard_settings():
        drawn = {name: draw(run, width=SCREEN_WIDTH) for name, draw in FIGURES.items() if len(run.log) > 1}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def plot_run(run: Run, figure: str = "gait_cycle", *, width_mm: float | None = None) -> Figure:
    """Draw a picture of a run.

    Args:
        run: The run.
        figure: ``gait_cycle``, ``ground_forces``, ``joint_angles``, ``torques``, ``currents``,
            ``battery``, ``feet`` or ``phase_portrait``.
        width_mm: Width of a figure for print in [mm], 85 or 174 for one column or two; it has letters and no
            title. None draws for a screen.

    Returns:
        The figure; notebooks show it after ``%matplotlib inline``, its ``savefig`` writes it.

    Raises:
        ParameterError: If there is no such picture, none for this run, or the width is out of range.
    """
    if figure not in FIGURES:
        raise ParameterError(f"figure: expected one of {', '.join(FIGURES)}, got {figure!r}")
    if width_mm is not None and not NARROWEST <= width_mm <= WIDEST:
        raise ParameterError(f"width: expected {NARROWEST:g} to {WIDEST:g} mm, got {width_mm:g}")
    width = SCREEN_WIDTH if width_mm is None else width_mm / INCH
    with standard_settings(None if width_mm is None else PRINT_SETTINGS):
        drawn = FIGURES[figure](run, width=width) if len(run.log) > 1 else None
        if drawn is None:
            known = ", ".join(screen_figures(run)) or "none"
            raise ParameterError(f"figure: this run has no {figure}; expected one of {known}")
        if width_mm is not None:
            _letter_panels(drawn)
            _size(drawn)
    return drawn


def _letter_panels(figure: Figure) -> None:
    """Replace the titles of the panels by letters and a few words."""
    for letter, axes in zip(ascii_lowercase, figure.axes, strict=False):
        short = re.split("[,:]", axes.get_title())[0]
        axes.set_title("")
        axes.set_title(rf"$\mathbf{{{letter}}}$  {short}", loc="left", fontsize="medium", pad=3.0)


def _size(figure: Figure) -> None:
    """Set the height for the panels and the legend, and scale lines and ticks to the size."""
    grid = figure.axes[0].get_gridspec()
    rows = 1 if grid is None else grid.nrows
    (legend,) = figure.legends
    width = figure.get_figwidth()
    row = max(_ROW, width * INCH / 4.0)
    figure.set_size_inches(width, (rows * row + _REST + legend_rows(figure) * _LEGEND_ROW) / INCH)
    for line in [*legend.get_lines(), *(line for axes in figure.axes for line in axes.get_lines())]:
        line.set_linewidth(_THINNER * line.get_linewidth())
        line.set_markersize(_THINNER * line.get_markersize())
    for axes in figure.axes:
        axes.locator_params(nbins=5)


def default_figures(run: Run) -> Sequence[str]:
    """Return the names of the figures in a run folder; ``twin-gait plot`` draws the others.

    A run without strides has its joint angles over time in place of the gait cycle.
    """
    return DEFAULT_FIGURES if has_cycles(run) else DEFAULT_WITHOUT_STRIDES


def write_figures(run: Run, directory: Path, names: Sequence[str]) -> dict[str, str]:
    """Draw figures of a run into a folder; return the reason by the name of each that cannot be drawn."""
    drawings = {name: partial(FIGURES[name], run, width=SCREEN_WIDTH) for name in names}
    return write_pictures(drawings, directory).failed
