"""Energy of the leg and the work of everything that acts on it."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from twin_gait.measures.effort import energy_balance
from twin_gait.palette import BLACK, WORK_COLOURS
from twin_gait.report.canvas import SCREEN_WIDTH, new_figure, put_legend, style_panel
from twin_gait.report.marks import mark_events
from twin_gait.report.window import whole_run
from twin_gait.simulation.columns import work_sources
from twin_gait.simulation.run import Run


def draw_energy(run: Run, *, width: float = SCREEN_WIDTH) -> Figure:
    """Draw work by source, change of energy, and what is left between them.

    Args:
        run: The run.
        width: Of the figure in inches; one narrower than a screen is for print.

    Returns:
        The figure.
    """
    window = whole_run(run)
    energy = (run.log["kinetic_energy_J"] + run.log["potential_energy_J"]).to_numpy()
    works = np.array([run.log[f"{source}_work_J"].to_numpy() for source in work_sources(run.log)])
    balance = energy_balance(energy, works)
    figure = new_figure(run, "Energy balance", height=7.5, width=width)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    lines: list[Artist] = []
    for source, work in zip(work_sources(run.log), works, strict=True):
        if np.any(work != 0.0):
            lines += upper.plot(
                window.time,
                work[window.rows],
                color=WORK_COLOURS[source],
                linewidth=1.5,
                label=f"work of {source}",
            )
    change = (energy - energy[0])[window.rows]
    lines += upper.plot(window.time, change, color=BLACK, linewidth=1.8, label="kinetic and potential energy")
    lines += mark_events(upper, run, window)
    style_panel(upper, "work since the start, and change of energy", "energy [J]")
    lower.plot(window.time, balance.residual[window.rows], color=BLACK, linewidth=1.2)
    share = 100.0 * balance.relative_residual
    style_panel(
        lower,
        f"energy less work: at most {balance.largest_residual:.2g} J of the {balance.throughput:.1f} J "
        f"that came and went ({share:.2g} %)",
        "energy [J]",
    )
    lower.set_xlabel("time [s]")
    lower.set_xlim(window.time[0], window.time[-1])
    put_legend(figure, lines)
    return figure
