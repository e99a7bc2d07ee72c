"""Panels that figures share.

Which part of a run is shown, one panel for each joint of each leg, mean cycles, phases and events over time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.gait.table import TICK
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.outcome import EventKind, held_from
from twin_gait.measures.strides import PERCENT, SKIPPED_STRIDES
from twin_gait.palette import EVENT_COLOUR, LIMIT_COLOUR
from twin_gait.report.canvas import (
    HELD,
    colour_of,
    new_figure,
    phase_handles,
    put_legend,
    shade_phases,
    style_panel,
)
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName

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
