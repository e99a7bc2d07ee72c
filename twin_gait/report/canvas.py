"""What all pictures share: figure, panels, phase bands, legend, file.

Figures are matplotlib objects without pyplot, so that nothing global is touched and no display is
needed.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twin_gait.palette import phase_colour
from twin_gait.parameters import Patient
from twin_gait.scenario import TreadmillScenario
from twin_gait.simulation.run import Run

RESOLUTION = 130  # [dots per inch]
BAND_OPACITY = 0.14
STRIP = 0.975  # the top of a panel above this share of its height shows the phases in full colour


def new_figure(run: Run, title: str, *, height: float, width: float = 11.0) -> Figure:
    """Begin a picture.

    Args:
        run: For the second line of the title.
        title: What the picture shows.
        height: In inches.
        width: In inches.

    Returns:
        An empty figure.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(f"{title}\n{describe(run)}", fontsize="large")
    return figure


def describe(run: Run) -> str:
    """One line that says whose run it is.

    Args:
        run: The run.

    Returns:
        Name, wearer, belt and how the run ended.
    """
    experiment = run.experiment
    parts = [experiment.name, _wearer(experiment.patient)]
    if isinstance(experiment.scenario, TreadmillScenario):
        parts.append(f"{experiment.scenario.belt_speed:.2f} m/s")
        parts.append(f"{100.0 * experiment.scenario.support.share:.0f} % of the weight supported")
    return " · ".join([*parts, f"{run.duration:.1f} s", str(run.status)])


def _wearer(patient: Patient | None) -> str:
    return "no wearer" if patient is None else f"{patient.mass:g} kg, {patient.height:.2f} m"


def style_panel(axes: Axes, title: str, unit: str) -> None:
    """Give a panel its title, the unit of its values and a quiet grid.

    Args:
        axes: The panel.
        title: What it shows.
        unit: Label of the vertical axis.
    """
    axes.set_title(title, fontsize="medium")
    axes.set_ylabel(unit)
    axes.grid(visible=True, color="0.88", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def shade_phases(axes: Axes, places: np.ndarray, phases: np.ndarray, names: Sequence[str]) -> None:
    """Colour the background of a panel by phase.

    Args:
        axes: The panel.
        places: Horizontal coordinate of each sample, ascending, shape ``(n,)``.
        phases: Index of the phase at each sample, shape ``(n,)``.
        names: Names of the phases.
    """
    changes = np.flatnonzero(phases[1:] != phases[:-1]) + 1
    edges = [0, *changes.tolist(), len(phases)]
    for start, end in pairwise(edges):
        left, right = places[start], places[min(end, len(places) - 1)]
        colour = phase_colour(names[phases[start]], int(phases[start]))
        axes.axvspan(left, right, color=colour, alpha=BAND_OPACITY, linewidth=0)
        axes.axvspan(left, right, ymin=STRIP, color=colour, alpha=0.9, linewidth=0)
    axes.set_xlim(places[0], places[-1])


def phase_handles(names: Sequence[str], occurring: np.ndarray) -> list[Artist]:
    """Legend entries of the phases that occur.

    Args:
        names: Names of the phases.
        occurring: Indices of phases, any shape.

    Returns:
        One coloured patch per phase, in the order of the table.
    """
    return [
        Patch(color=phase_colour(names[index], int(index)), alpha=0.9, label=readable(names[index]))
        for index in np.unique(occurring)
    ]


def readable(name: str) -> str:
    """Write an identifier as words."""
    return name.replace("_", " ")


def put_legend(figure: Figure, lines: Sequence[Artist], phases: Sequence[Artist] = ()) -> None:
    """Put one legend under all panels, where it covers nothing: a row of lines, a row of phases.

    Args:
        figure: The figure.
        lines: Entries of lines and areas; of equal labels one is kept.
        phases: Entries of phases.
    """
    rows = [list({str(item.get_label()): item for item in row}.values()) for row in (lines, phases) if row]
    columns = max(len(row) for row in rows)
    blank = Patch(alpha=0.0, label=" ")
    padded = [[*row, *[blank] * (columns - len(row))] for row in rows]
    # matplotlib fills a legend column by column.
    handles = [row[column] for column in range(columns) for row in padded]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize="small")


def picture_bytes(figure: Figure, ground: str = "auto") -> bytes:
    """A figure as PNG.

    Args:
        figure: The figure.
        ground: Its colour; that of the figure by default, ``none`` for a transparent one.

    Returns:
        The file's content.
    """
    room = io.BytesIO()
    figure.savefig(room, format="png", dpi=RESOLUTION, facecolor=ground)
    return room.getvalue()


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG.

    Args:
        figure: The figure.
        path: The file.

    Returns:
        The file.
    """
    figure.savefig(path, dpi=RESOLUTION)
    return path
