"""What all pictures share: figure, panels, phase bands, legend, file.

Figures are matplotlib objects without pyplot, so that nothing global is touched and no display is
needed.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twin_gait.files import write_atomically
from twin_gait.palette import HELD_COLOUR, phase_colour
from twin_gait.report.words import wearer_words
from twin_gait.simulation.run import Run

FORMATS = ("pdf", "svg", "png")
RESOLUTION = 130  # [dots per inch]
BAND_OPACITY, STRIP_OPACITY = 0.14, 0.9
SCREEN_WIDTH = 11.0  # [inches]
LEGEND_COLUMN = 1.65  # [inches]
MOST_EVENTS = 3  # in a title
HELD = -1  # in the place of a phase, after a trip
STRIP = 0.975  # the top of a panel above this share of its height shows the phases in full colour


def new_figure(run: Run, title: str, *, height: float, width: float = SCREEN_WIDTH) -> Figure:
    """Begin a picture; its label says what it shows and of which run.

    One for print has no title inside. ``run`` for the second line of the title, and a third where faults
    acted or the monitor tripped.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    events = [f"{event.text}, {event.time:.2f} s" for event in run.events]
    more = [f"and {len(events) - MOST_EVENTS} more"] * (len(events) > MOST_EVENTS)
    lines = [title, describe(run), " · ".join([*events[:MOST_EVENTS], *more])]
    text = "\n".join(line for line in lines if line)
    figure.set_label(text)
    if width >= SCREEN_WIDTH:
        figure.suptitle(text, fontsize="large")
    return figure


def describe(run: Run) -> str:
    """One line that says whose run it is."""
    experiment = run.experiment
    parts = [experiment.name, wearer_words(experiment.patient)]
    walking = experiment.scenario.walking
    if walking is not None:
        parts.append(f"{walking.speed:.2f} m/s")
        parts.append(f"{100.0 * walking.support_share:.0f} % of the weight supported")
    return " · ".join([*parts, f"{run.duration:.1f} s", str(run.verdict.outcome or run.status)])


def style_panel(axes: Axes, title: str, unit: str) -> None:
    """Give a panel its title, the unit of its values and a quiet grid. ``title``: what it shows."""
    axes.set_title(title, fontsize="medium")
    axes.set_ylabel(unit)
    axes.grid(visible=True, color="0.88", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def shade_phases(axes: Axes, places: np.ndarray, phases: np.ndarray, names: Sequence[str]) -> None:
    """Colour the background of a panel by phase.

    ``places``: horizontal coordinate of each sample, ascending, shape ``(n,)``; ``phases``: index of the
    phase at each sample, or ``HELD``, shape ``(n,)``.
    """
    changes = np.flatnonzero(phases[1:] != phases[:-1]) + 1
    edges = np.array([0, *changes.tolist(), len(phases)])
    left, right = places[edges[:-1]], places[np.minimum(edges[1:], len(places) - 1)]
    colours = [colour_of(int(phases[start]), names) for start in edges[:-1]]
    for bottom, opacity in ((0.0, BAND_OPACITY), (STRIP, STRIP_OPACITY)):
        low, high = np.full(len(left), bottom), np.ones(len(left))
        corners = np.stack([[left, left, right, right], [low, high, high, low]], axis=-1).swapaxes(0, 1)
        # One collection, because every patch is asked for the limits of its panel and drawn by itself.
        bands = PolyCollection(list(corners), facecolors=colours, alpha=opacity, linewidth=0, zorder=1)
        bands.set_transform(axes.get_xaxis_transform())
        axes.add_collection(bands, autolim=False)
    axes.set_xlim(places[0], places[-1])


def colour_of(phase: int, names: Sequence[str]) -> str:
    """Colour of a phase by its index, or of ``HELD``."""
    return HELD_COLOUR if phase == HELD else phase_colour(names[phase], phase)


def phase_handles(names: Sequence[str], occurring: np.ndarray) -> list[Artist]:
    """Legend entries of the phases that occur. ``occurring``: indices of phases, any shape."""
    return [
        Patch(
            color=colour_of(int(index), names),
            alpha=STRIP_OPACITY,
            label="held after the trip" if index == HELD else readable(names[index]),
        )
        for index in sorted(np.unique(occurring), key=lambda index: index == HELD)
    ]


def readable(name: str) -> str:
    """Write an identifier as words."""
    return name.replace("_", " ")


def amount(value: float | None, unit: str = "") -> str:
    """A number with its unit and as many places as a person reads; a dash for None."""
    if value is None:
        return "–"
    places = 0 if abs(value) >= 100.0 else 1 if abs(value) >= 10.0 else 2
    return f"{value:.{places}f} {unit}".strip()


def put_legend(figure: Figure, lines: Sequence[Artist], phases: Sequence[Artist] = ()) -> None:
    """Put one legend under all panels, where it covers nothing: rows of lines, rows of phases.

    ``lines``: entries of lines and areas; of equal labels one is kept.
    """
    most = int(figure.get_figwidth() / LEGEND_COLUMN)
    entries = [list({str(item.get_label()): item for item in row}.values()) for row in (lines, phases) if row]
    rows = [row for items in entries for row in _even_rows(items, most)]
    columns = max(len(row) for row in rows)
    blank = Patch(alpha=0.0, label=" ")
    padded = [[*row, *[blank] * (columns - len(row))] for row in rows]
    # matplotlib fills a legend column by column.
    handles = [row[column] for column in range(columns) for row in padded]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize="small")


def _even_rows(items: list[Artist], most: int) -> list[list[Artist]]:
    length = math.ceil(len(items) / math.ceil(len(items) / most))
    return [items[start : start + length] for start in range(0, len(items), length)]


def picture_bytes(figure: Figure) -> bytes:
    """A figure as PNG."""
    room = io.BytesIO()
    figure.savefig(room, format="png", dpi=RESOLUTION)
    return room.getvalue()


def save(figure: Figure, path: Path, *, form: str = "", resolution: int = RESOLUTION) -> Path:
    """Write a figure.

    Letters stay letters in PDF (TrueType) and become outlines in SVG, so that they look the same everywhere.
    The same figure gives the same file. ``form``: ``png``, ``pdf`` or ``svg``; what the name of the file says
    by default; ``resolution`` of a PNG in dots per inch. Raises RunDirectoryError if it cannot be written.
    """
    form = form or path.suffix[1:]
    undated: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    # Half of the usual effort makes a file 7 % larger in two thirds of the time.
    packing: dict[str, Any] = {"pil_kwargs": {"compress_level": 3}} if form == "png" else {}
    room = io.BytesIO()
    with mpl.rc_context({"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "twin_gait"}):
        figure.savefig(room, format=form, dpi=resolution, metadata=undated.get(form), **packing)
    write_atomically(path, room.getvalue())
    return path
