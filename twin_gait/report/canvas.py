"""What all pictures share: figure, panels, phase bands, legend, file.

Figures are matplotlib objects without pyplot, so that nothing global is touched and no display is
needed.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.outcome import EventKind, held_from
from twin_gait.measures.strides import PERCENT, SKIPPED_STRIDES
from twin_gait.palette import EVENT_COLOUR, HELD_COLOUR, LIMIT_COLOUR, phase_colour
from twin_gait.report.walk_words import wearer_words
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

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


SHOWN_STRIDES = 2
SHOWN_WITHOUT_STRIDES = 6.0  # [s]
SHOWN_BEFORE_EVENT = 1 / 3  # of a window
# More points than this do not show in a picture.
MOST_POINTS = 20_000
_EVENT_STYLES = {EventKind.FAULT: "--", EventKind.TRIP: "-", EventKind.FALL: ":", EventKind.DIVERGENCE: ":"}


class Window(NamedTuple):
    """Rows of a log."""

    rows: slice  # the rows
    time: np.ndarray  # of each row in [s], shape ``(n,)``


def window_of(run: Run, rows: slice) -> Window:
    """Some rows of a run."""
    return Window(rows, run.log["time_s"].to_numpy()[rows])


def last_strides(run: Run, records: list[LegRecord]) -> Window:
    """The events of a run, or the last strides of the first leg, or the last seconds without strides."""
    events = records[0].stride_events
    if run.events or len(events) <= SHOWN_STRIDES:
        return end_or_events(run, SHOWN_WITHOUT_STRIDES)
    return window_of(run, slice(int(events[-1 - SHOWN_STRIDES]), int(events[-1]) + 1))


def end_or_events(run: Run, duration: float) -> Window:
    """The end of a run, or what led to its first event and followed it; at most so many seconds."""
    length = round(duration / TICK)
    start = len(run.log) - length
    if run.events:
        start = min(start, round(run.events[0].time / TICK - SHOWN_BEFORE_EVENT * length))
    start = max(0, start)
    return window_of(run, slice(start, min(start + length, len(run.log))))


def whole_run(run: Run) -> Window:
    """The whole run, thinned out if it is long."""
    return window_of(run, slice(0, len(run.log), 1 + len(run.log) // MOST_POINTS))


def shown_strides(record: LegRecord) -> np.ndarray:
    """Strides that a cycle picture shows: the settled ones, or the last if none has settled.

    Returns first tick of each stride and of the next one, shape ``(n_strides, 2)``.
    """
    settled = record.strides(skip=SKIPPED_STRIDES)
    return settled if len(settled) else record.strides(skip=0)[-1:]


def shown_phases(run: Run, record: LegRecord, window: Window) -> np.ndarray:
    """Phases of a leg in a window; from a trip on the legs are held, whatever the machine says.

    Returns index of the phase, or ``HELD``, shape ``(n,)``.
    """
    phases, held = record.phases[window.rows], held_from(run.events)
    return phases if held is None else np.where(window.time >= held, HELD, phases)


def mark_events(axes: Axes, run: Run, window: Window) -> list[Artist]:
    """Draw a line at every event that a window shows; entries for the legend."""
    return [
        axes.axvline(
            event.time,
            color=EVENT_COLOUR,
            linestyle=_EVENT_STYLES[event.kind],
            linewidth=1.8,
            zorder=3,
            label=str(event.kind),
        )
        for event in run.events
        if window.time[0] <= event.time <= window.time[-1]
    ]


def limit_lines(axes: Axes, values: Sequence[float], style: str, label: str, width: float) -> list[Artist]:
    """Draw limits behind all curves; entries for the legend."""
    options: dict[str, Any] = {"color": LIMIT_COLOUR, "linestyle": style, "linewidth": width, "zorder": 1}
    return [axes.axhline(value, label=label, **options) for value in values]


def flexion(joint: str) -> str:
    """Label of an axis with the angle of a joint."""
    return f"{joint} {'dorsiflexion' if joint == JointName.ANKLE else 'flexion'} [°]"


def height_of(height: float, records: Sequence[LegRecord], below: int = 0) -> float:
    """Height of a figure with a row of panels a joint, from that of one for two joints, and rows below."""
    return height * (len(records[0].angles) + below) / (2 + below)


def leg_panels(
    figure: Figure, records: Sequence[LegRecord], unit: Callable[[str], str], *, below: int = 0, **share: Any
) -> Iterator[tuple[Axes, LegRecord, JointName]]:
    """One panel for each joint (row) of each leg (column), titled, the unit at the first column.

    ``figure``: an empty figure; ``unit``: label of the vertical axes, by the name of the joint; ``share``:
    ``sharex`` and ``sharey`` as matplotlib's ``subplots`` takes them.
    """
    joints = list(records[0].angles)
    panels = figure.subplots(len(joints) + below, len(records), squeeze=False, **share)
    for axes in panels[len(joints) :].flat:
        axes.remove()
    for row, joint in enumerate(joints):
        for column, record in enumerate(records):
            style_panel(panels[row, column], f"{record.side} {joint}", unit(joint) if column == 0 else "")
            yield panels[row, column], record, joint


def draw_over_time(
    run: Run,
    window: Window,
    title: str,
    unit: Callable[[str], str],
    draw: Callable[[Axes, LegRecord, JointName], list[Artist]],
    *,
    size: tuple[float, float],
    last: Callable[[Axes], list[Artist]] | None = None,
) -> Figure:
    """Draw something of every joint of every leg over time, on the phases and with the events."""
    records, names = run.leg_records(), run.table.phase_names
    figure = new_figure(run, title, width=size[0], height=height_of(size[1], records, int(last is not None)))
    share = {} if last else {"sharex": True, "sharey": "row"}
    lines: list[Artist] = []
    for axes, record, joint in leg_panels(figure, records, unit, below=int(last is not None), **share):
        shade_phases(axes, window.time, shown_phases(run, record, window), names)
        lines += draw(axes, record, joint)
        lines += mark_events(axes, run, window)
    if last is not None:
        grid = figure.axes[0].get_gridspec()
        assert grid is not None  # of subplots
        axes = figure.add_subplot(grid[-1, :])
        lines += last(axes)
        lines += mark_events(axes, run, window)
        axes.set_xlim(window.time[0], window.time[-1])
        axes.set_xlabel("time [s]")
    for axes in figure.axes[-len(records) :] if last is None else []:
        axes.set_xlabel("time [s]")
    phases = np.concatenate([shown_phases(run, record, window) for record in records])
    put_legend(figure, lines, phase_handles(names, phases))
    return figure


def draw_cycle_curve(axes: Axes, angles: np.ndarray, **style: Any) -> list[Artist]:
    """Draw angles over the gait cycle, with an axis that says so.

    ``angles`` in [deg] at ``PERCENT``, shape ``(101,)``; ``style``: as matplotlib's ``plot`` takes it.
    """
    axes.set_xlim(PERCENT[0], PERCENT[-1])
    axes.set_xlabel("share of the gait cycle [%]")
    return list(axes.plot(PERCENT, angles, **style))


def draw_phase_bars(
    axes: Axes, time: np.ndarray, rows: Sequence[tuple[str, np.ndarray]], names: Sequence[str], **style: Any
) -> None:
    """Draw phases as bars over time, one row below the other.

    ``time`` of each sample in [s], shape ``(n,)``; ``rows``: label and index of the phase at each sample,
    shape ``(n,)``.
    """
    for place, (_, phases) in enumerate(rows):
        edges = [0, *(np.flatnonzero(np.diff(phases)) + 1).tolist(), len(phases)]
        for start, end in pairwise(edges):
            left, right = time[start], time[min(end, len(time) - 1)]
            axes.barh(-place, right - left, left=left, color=colour_of(int(phases[start]), names), **style)
    axes.set_yticks([-place for place in range(len(rows))], [label for label, _ in rows])
