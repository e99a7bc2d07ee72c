"""Common parts of all pictures: figure, panels, phase bands, legend, file.

Figures are matplotlib objects without pyplot, so that no global state changes and no display is
needed.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from twin_gait.experiment.experiment import Experiment
from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.labels import label_of
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.outcome import EventKind, trip_time
from twin_gait.measures.phases import phase_spells
from twin_gait.measures.strides import PERCENT, SKIPPED_STRIDES, normalise_strides
from twin_gait.palette import EVENT_COLOUR, HELD_COLOUR, LIMIT_COLOUR, REFERENCE_COLOUR, phase_colour
from twin_gait.report.failures import format_error
from twin_gait.report.formatting import describe_wearer
from twin_gait.report.pages import FIGURES_FOLDER, render
from twin_gait.report.reference import reference_cycle, reference_label
from twin_gait.report.state_diagram import name_to_words
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

RESOLUTION = 130  # [dots per inch]
BAND_OPACITY, STRIP_OPACITY = 0.14, 0.9  # opacity of phases in the background and at the top of a panel
SCREEN_WIDTH = 11.0  # [inches] smallest width of a figure for the screen
LEGEND_COLUMN, LEGEND_ROW = 1.65, 0.18  # [inches] width of a column and height of a row of the legend
# Margin of the figure, height of a line of its title, height of the title of a panel, in [inches].
EDGE, TITLE_LINE, PANEL_TITLE = 0.06, 0.2, 0.28
LEFT, RIGHT, X_TICKS, X_LABEL, Y_TICKS = 0.9, 0.17, 0.06, 0.5, 0.3  # [inches] margins of panels
MOST_EVENTS = 3  # largest number of events in a title
HELD = -1  # replaces the index of a phase after a trip
STRIP = 0.975  # the top of a panel above this share of its height shows the phases in full colour

Drawing = Callable[[], Figure | None]  # draws a picture, or returns None if it does not apply
# Defaults of matplotlib, without the settings of the user.
_STANDARD: dict[Any, Any] = {name: value for name, value in mpl.rcParamsDefault.items() if name != "backend"}


class Pictures(NamedTuple):
    """Pictures that were written, and those that could not be drawn."""

    written: dict[str, bytes]  # PNG by name
    failed: dict[str, str]  # reason by name


@contextlib.contextmanager
def standard_settings(more: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Use the defaults of matplotlib and ``more`` in a block; a matplotlibrc of the user has no effect."""
    settings: dict[Any, Any] = {**_STANDARD, **(more or {})}
    with mpl.rc_context(settings):
        yield


def style_panel(axes: Axes, title: str, unit: str) -> None:
    """Set the title of a panel, the label ``unit`` of its vertical axis and a light grid."""
    axes.set_title(title, fontsize="medium", y=1.0)  # without y, matplotlib looks for ticks above the panel
    axes.set_ylabel(unit)
    axes.grid(visible=True, color="0.88", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def shade_phases(axes: Axes, positions: np.ndarray, phases: np.ndarray, names: Sequence[str]) -> None:
    """Colour the background of a panel by phase.

    ``positions``: horizontal coordinate of each sample, ascending, shape ``(n,)``; ``phases``: index of the
    phase at each sample, or ``HELD``, shape ``(n,)``.
    """
    spells = phase_spells(phases)
    colours = [colour_of(spell.phase, names) for spell in spells]
    starts = positions[[spell.start for spell in spells]]
    bands = np.column_stack((starts, np.diff(starts, append=positions[-1]))).tolist()
    style: dict[str, Any] = {"facecolors": colours, "linewidth": 0, "zorder": 1}
    for bottom, opacity in ((0.0, BAND_OPACITY), (STRIP, STRIP_OPACITY)):
        whole = axes.get_xaxis_transform()
        axes.broken_barh(bands, (bottom, 1.0 - bottom), transform=whole, alpha=opacity, **style)
    axes.set_xlim(positions[0], positions[-1])


def colour_of(phase: int, names: Sequence[str]) -> str:
    """Return the colour of a phase; ``phase``: index in ``names``, or ``HELD``."""
    return HELD_COLOUR if phase == HELD else phase_colour(names[phase], phase)


def phase_handles(names: Sequence[str], occurring: np.ndarray) -> list[Artist]:
    """Return the legend entries of the phases that occur; ``occurring``: indices of phases, any shape."""
    order = sorted(np.unique(occurring).tolist(), key=lambda index: index == HELD)
    labels = {**dict(enumerate(map(name_to_words, names))), HELD: "held after the trip"}
    return [Patch(color=colour_of(index, names), alpha=STRIP_OPACITY, label=labels[index]) for index in order]


def put_legend(figure: Figure, lines: Sequence[Artist], phases: Sequence[Artist] = ()) -> None:
    """Add one legend below all panels: lines and areas, then phases.

    Entries with the same label are merged.
    """
    entries = list({str(item.get_label()): item for item in (*lines, *phases)}.values())
    columns = min(len(entries), legend_columns(figure))
    figure.legend(handles=entries, loc="outside lower center", ncols=columns, frameon=False, fontsize="small")


def legend_columns(figure: Figure) -> int:
    """Return the largest number of columns of a legend in the width of a figure."""
    return max(1, int(figure.get_figwidth() / LEGEND_COLUMN))


def legend_rows(figure: Figure) -> int:
    """Return the number of rows of the legend of a figure."""
    (legend,) = figure.legends
    return math.ceil(len(legend.get_texts()) / legend_columns(figure))


def picture_bytes(figure: Figure, form: str = "png", resolution: int = RESOLUTION) -> bytes:
    """Return a figure as PNG, PDF or SVG; the same figure gives the same bytes.

    Text stays text in PDF (TrueType) and becomes outlines in SVG, so that it looks the same everywhere.
    ``resolution``: resolution of a PNG in dots per inch.
    """
    undated: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    # Compression level 3 instead of 6 makes a file 7 % larger in two thirds of the time.
    packing: dict[str, Any] = {"pil_kwargs": {"compress_level": 3}} if form == "png" else {}
    buffer = io.BytesIO()
    with standard_settings({"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "twin_gait"}):
        figure.savefig(buffer, format=form, dpi=resolution, metadata=undated.get(form), **packing)
    return buffer.getvalue()


def write_pictures(drawings: Mapping[str, Drawing], folder: Path) -> Pictures:
    """Draw pictures and write them as PNG under their names into a folder, which is created if needed.

    A picture that cannot be drawn is left out, and its error is returned instead of raised, so that the
    numbers of a run are still written.
    """
    folder.mkdir(exist_ok=True)
    pictures = Pictures({}, {})
    for name, draw in drawings.items():
        try:
            with standard_settings():
                figure = draw()
                if figure is not None:
                    pictures.written[name] = picture_bytes(figure)
                    write_atomically(folder / f"{name}.png", pictures.written[name])
        except Exception as error:
            pictures.failed[name] = format_error(error)
    return pictures


def write_figures_page(
    path: Path,
    drawings: Mapping[str, Drawing],
    title: str,
    subtitle: str,
    rows: Sequence[Sequence[str]],
    tables: Mapping[str, Sequence[Sequence[str]]],
    heading_of: Callable[[str], str] = name_to_words,
) -> dict[str, str]:
    """Write figures into a folder, and a page that shows them after one table and before other tables.

    The first row of a table is its head. ``heading_of``: function from the name of a figure to its heading.
    Returns the reason of each figure that could not be drawn, by name.
    """
    pictures = write_pictures(drawings, path.with_name(FIGURES_FOLDER))
    named = {heading_of(name): picture for name, picture in pictures.written.items()}
    content = {"title": title, "subtitle": subtitle, "rows": rows, "pictures": named, "tables": tables}
    write_atomically(path, render("figures.html", content))
    return pictures.failed


def save(figure: Figure, path: Path, *, form: str = "", resolution: int = RESOLUTION) -> Path:
    """Write a figure with :func:`picture_bytes`, and return the path.

    ``form``: ``png``, ``pdf`` or ``svg``, by default the ending of the name of the file; ``resolution``:
    resolution of a PNG in dots per inch. Raises RunDirectoryError if the figure cannot be written.
    """
    write_atomically(path, picture_bytes(figure, form or path.suffix[1:], resolution))
    return path


SHOWN_STRIDES = 2  # number of strides in a figure over time
SHOWN_WITHOUT_STRIDES = 6.0  # [s] length of a figure over time without strides or with an event
SHOWN_BEFORE_EVENT = 1 / 3  # share of a window before the event
_EVENT_STYLES = {EventKind.FAULT: "--", EventKind.TRIP: "-", EventKind.FALL: ":", EventKind.DIVERGENCE: ":"}


def last_strides(run: Run) -> slice:
    """Return the rows of the log for figures over time.

    These are the rows around the first event, if the run has events; otherwise the last strides of the first
    leg; otherwise, with too few strides, the last seconds.
    """
    begins = run.leg_records()[0].stride_events
    if run.events or len(begins) <= SHOWN_STRIDES:
        return event_window(run, SHOWN_WITHOUT_STRIDES)
    return slice(int(begins[-1 - SHOWN_STRIDES]), int(begins[-1]) + 1)


def event_window(run: Run, duration: float) -> slice:
    """Return the rows of a window of ``duration`` in [s]: around the first event of a run, or at its end."""
    length = round(duration / TICK)
    start = len(run.log) - length
    if run.events:
        start = min(start, round(run.events[0].time / TICK - SHOWN_BEFORE_EVENT * length))
    return slice(max(0, start), max(0, start) + length)


def shown_strides(record: LegRecord) -> np.ndarray:
    """Return the strides in a cycle picture: the settled ones, or the last one if none has settled.

    Returns the first tick of each stride and of the next one, shape ``(n_strides, 2)``.
    """
    settled = record.strides(skip=SKIPPED_STRIDES)
    return settled if len(settled) else record.strides(skip=0)[-1:]


def has_cycles(run: Run) -> bool:
    """Return whether every leg of a run has a stride that a cycle picture can show."""
    return all(len(shown_strides(record)) > 0 for record in run.leg_records())


class RunFigure:
    """Picture of a run under construction; on a screen its title names its content and the run.

    All its labels are entries of one legend below the panels.

    Attributes:
        figure: Figure of the picture.
        window: Rows of the log in curves over time.
        time: Time of these rows in [s].
        records: Columns of the log of each leg.
        lines: Entries of the legend.
    """

    def __init__(self, run: Run, title: str, size: tuple[float, float], window: slice = slice(None)) -> None:
        """Begin a picture; a picture for print has no title.

        ``size``: width and height in inches, the height for two joints if there are panels of legs; a picture
        narrower than a screen is for print. ``window``: rows of the log, by default the whole run.
        """
        self.run, self.window = run, window
        self.time = run.log["time_s"].to_numpy()[self.window]
        self.records = run.leg_records()
        # Phases of the device, then those of the wearer's own gait that the device does not have.
        self.names = tuple(dict.fromkeys(name for table in self._tables() for name in table.phase_names))
        self.lines: list[Artist] = []
        events = [f"{event.text}, {event.time:.2f} s" for event in run.events[:MOST_EVENTS]]
        wearer, result = ", ".join(describe_wearer(run.experiment)), run.verdict.outcome or run.status
        run_line = f"{run.experiment.name} · {wearer} · {run.duration:.1f} s · {result}"
        text = "\n".join(filter(None, (title, run_line, " · ".join(events))))
        self.on_screen = size[0] >= SCREEN_WIDTH
        self.figure = Figure(figsize=size, layout=None if self.on_screen else "constrained")
        if self.on_screen:
            self.figure.suptitle(text, fontsize="large")

    def _tables(self) -> list[GaitTable]:
        """Return the gait tables of device and legs."""
        return [self.run.table, *(self.run.leg_table(record.side) for record in self.records)]

    def leg_panels(
        self, key: str, *, timed: bool = True, driven: bool = False
    ) -> Iterator[tuple[Axes, LegRecord, JointName]]:
        """Yield a titled panel for each joint (row) and leg (column), labelled at the first one of its row.

        Only joints that a drive or the wearer's own gait moves have a panel, and only legs with such a joint
        have a column. ``key``: key of the label of the vertical axes, with braces for the joint; ``timed``:
        whether the phases over time are in the background; ``driven``: whether only joints with a drive have
        a panel.
        """
        legs = [(record, record.driven if driven else (*record.angles,)) for record in self.records]
        legs = [(record, of_leg) for record, of_leg in legs if of_leg]
        joints = [joint for joint in JointName if any(joint in of_leg for _, of_leg in legs)]
        self.figure.set_figheight(self.figure.get_figheight() * len(joints) / 2)
        shape = len(joints), len(legs)
        sharex: Literal[True, "row"] = True if timed else "row"
        panels = self.figure.subplots(*shape, squeeze=False, sharex=sharex, sharey="row")
        for row, joint in enumerate(joints):
            first = next(record for record, of_leg in legs if joint in of_leg)
            for axes, (record, of_leg) in zip(panels[row], legs, strict=True):
                if joint not in of_leg:
                    axes.set_axis_off()
                    continue
                label = label_of(key.format(joint)).axis if record is first else ""
                style_panel(axes, f"{record.side} {joint}", label)
                axes.tick_params(labelleft=record is first)  # also if the first leg has no panel here
                if timed:
                    shade_phases(axes, self.time, self.phases(record), self.names)
                yield axes, record, joint

    def phases(self, record: LegRecord, rows: slice | None = None) -> np.ndarray:
        """Return the phases of a leg in some rows, with ``HELD`` from a trip on.

        ``rows``: by default those of the window. Returns index of the phase, or ``HELD``, shape ``(n,)``.
        """
        phases, held = self.phase_codes(record), trip_time(self.run.events)
        if held is not None:
            phases = np.where(self.run.log["time_s"] >= held, HELD, phases)
        return phases[rows or self.window]

    def phase_codes(self, record: LegRecord) -> np.ndarray:
        """Return the phase of a leg at each tick as its index in ``names``, shape ``(n,)``."""
        names = self.run.leg_table(record.side).phase_names
        codes = np.array([self.names.index(name) for name in names])
        return np.asarray(codes[record.phases])

    def curve(self, axes: Axes, prefix: str, column: str, color: str, **style: Any) -> None:
        """Draw a column of the log over time in its display unit, with its name in the legend.

        ``prefix``: prefix of the column by side and joint; ``style`` as for ``plot`` of matplotlib.
        """
        label, values = label_of(column), self.run.log[prefix + column].to_numpy()
        style = {"linewidth": 1.5, "color": color, "label": label.name, **style}
        self.lines += axes.plot(self.time, label.factor * values[self.window], **style)

    def limits(self, axes: Axes, values: Sequence[float], style: str, label: str, width: float = 1.2) -> None:
        """Draw horizontal lines at limits, behind all curves; ``values`` in the unit of the axis."""
        options: dict[str, Any] = {"color": LIMIT_COLOUR, "linestyle": style, "linewidth": width}
        self.lines += [axes.axhline(value, label=label, zorder=1, **options) for value in values]

    def finish_time_plot(self, *lowest: Axes, phases: bool = True) -> Figure:
        """Return the picture with events in all panels and the time axis below some of them.

        ``lowest``: panels with a time axis, by default the last row. ``phases``: whether the phases are in
        the legend.
        """
        shown = [event for event in self.run.events if self.time[0] <= event.time <= self.time[-1]]
        for axes, event in itertools.product(self.figure.axes, shown):
            style: dict[str, Any] = {"linestyle": _EVENT_STYLES[event.kind], "label": str(event.kind)}
            self.lines.append(axes.axvline(event.time, color=EVENT_COLOUR, linewidth=1.8, zorder=3, **style))
        for axes in lowest or self.figure.axes[-len(self.records) :]:
            axes.set_xlim(self.time[0], self.time[-1])
            axes.set_xlabel("time [s]")
        return self.finish([self.phases(record) for record in self.records] if phases else ())

    def finish(self, phases: Sequence[np.ndarray] = ()) -> Figure:
        """Return the picture with its legend, which includes the phases that occur in the arrays."""
        handles = phase_handles(self.names, np.concatenate(phases)) if phases else []
        put_legend(self.figure, self.lines, handles)
        if self.on_screen:
            arrange(self.figure)
        return self.figure


def arrange(figure: Figure) -> None:
    """Place title, panels and legend of a figure on a screen.

    The margins are fixed, because a layout engine takes longer to compute them than to draw the figure.
    """
    width, height = figure.get_size_inches()
    grid = figure.axes[0].get_gridspec()
    assert grid is not None  # panels are made by ``subplots``
    heading = figure.get_suptitle()
    figure.suptitle(heading, y=1.0 - EDGE / height)
    above = EDGE + TITLE_LINE * len(heading.splitlines()) + PANEL_TITLE
    below = X_LABEL + LEGEND_ROW * legend_rows(figure) + EDGE
    inner = figure.axes[: -grid.ncols]
    between = PANEL_TITLE + (X_LABEL if any(axes.get_xlabel() for axes in inner) else X_TICKS)
    panel = (height - above - below - (grid.nrows - 1) * between) / grid.nrows
    between_columns = Y_TICKS / ((width - LEFT - RIGHT - (grid.ncols - 1) * Y_TICKS) / grid.ncols)
    figure.subplots_adjust(
        left=LEFT / width, right=1.0 - RIGHT / width, bottom=below / height, top=1.0 - above / height,
        hspace=between / panel, wspace=between_columns,
    )  # fmt: skip


def draw_cycle_curve(axes: Axes, angles: np.ndarray, **style: Any) -> list[Artist]:
    """Draw angles over the gait cycle, with a label of the axis.

    ``angles``: angles in [deg] at ``PERCENT``, shape ``(101,)``; ``style``: as for ``plot`` of matplotlib.
    """
    axes.set_xlim(PERCENT[0], PERCENT[-1])
    axes.set_xlabel("share of the gait cycle [%]")
    return list(axes.plot(PERCENT, angles, **style))


def draw_mean_cycles(experiment: Experiment, runs: Mapping[str, Run], colours: Mapping[str, str]) -> Figure:
    """Draw mean strides of several walks and of the reference, with a panel for each joint of a leg.

    ``runs``: runs of an experiment by name; ``colours``: their colours. A run without a counted stride has no
    curve.
    """
    styles: dict[str, dict[str, Any]] = {name: {"color": colours[name], "linewidth": 1.5} for name in runs}
    healthy = {"color": REFERENCE_COLOUR, "linestyle": ":", "linewidth": 1.5}
    driven, shown = list(itertools.product(experiment.joints, experiment.sides)), dict[str, Any]()
    figure = Figure(figsize=(13.0 * len(driven) / 6, 3.3), layout="constrained")
    panels = figure.subplots(1, len(driven), squeeze=False)[0]
    for axes, (joint, side) in zip(panels, driven, strict=True):
        for name, run in runs.items():
            record = run.leg_record(side)
            cycles = normalise_strides(record.angles[joint], record.strides())
            if len(cycles):
                draw_cycle_curve(axes, np.degrees(cycles.mean(axis=0)), **styles[name])
                shown[name] = styles[name]
        reference = reference_cycle(experiment, joint)
        if reference is not None:
            draw_cycle_curve(axes, np.degrees(reference), **healthy)
            shown[reference_label(experiment)] = healthy
        style_panel(axes, label_of(f"{side}_{joint}_angle_rad").title, "")
    if shown:
        put_legend(figure, [Line2D([], [], label=name, **style) for name, style in shown.items()])
    return figure
