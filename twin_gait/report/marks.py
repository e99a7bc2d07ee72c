"""What befell a run, on the time axis of a picture: lines at the events, and no phases after a trip."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.outcome import EventKind, held_from
from twin_gait.palette import EVENT_COLOUR
from twin_gait.report.canvas import HELD
from twin_gait.report.window import Window
from twin_gait.simulation.run import Run

_STYLES = {EventKind.FAULT: "--", EventKind.TRIP: "-", EventKind.FALL: ":", EventKind.DIVERGENCE: ":"}


def mark_events(axes: Axes, run: Run, window: Window) -> list[Artist]:
    """Draw a line at every event that a window shows.

    Args:
        axes: A panel over time.
        run: The run.
        window: What the panel shows.

    Returns:
        Entries for the legend.
    """
    return [
        axes.axvline(
            event.time,
            color=EVENT_COLOUR,
            linestyle=_STYLES[event.kind],
            linewidth=1.8,
            zorder=3,
            label=str(event.kind),
        )
        for event in run.events
        if window.time[0] <= event.time <= window.time[-1]
    ]


def shown_phases(run: Run, record: LegRecord, window: Window) -> np.ndarray:
    """Phases of a leg in a window; from a trip on the legs are held, whatever the machine says.

    Args:
        run: The run.
        record: The leg.
        window: Rows of the log.

    Returns:
        Index of the phase, or ``HELD``, shape ``(n,)``.
    """
    phases, held = record.phases[window.rows], held_from(run.events)
    return phases if held is None else np.where(window.time >= held, HELD, phases)
