"""Which part of a run a picture shows, and the leg records that pictures draw from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.gait.table import TICK
from twin_gait.measures.leg_record import LegRecord
from twin_gait.measures.strides import SKIPPED_STRIDES
from twin_gait.simulation.run import Run

SHOWN_STRIDES = 2
SHOWN_WITHOUT_STRIDES = 6.0  # [s]
SHOWN_BEFORE_EVENT = 1 / 3  # of a window
# More points than this do not show in a picture.
MOST_POINTS = 20_000


class Window(NamedTuple):
    """Rows of a log.

    Attributes:
        rows: The rows.
        time: Of each row in [s], shape ``(n,)``.
    """

    rows: slice
    time: np.ndarray


def last_strides(run: Run, records: list[LegRecord]) -> Window:
    """What befell the run, or the last strides of the first leg, or the last seconds without strides.

    Args:
        run: The run.
        records: Its legs.

    Returns:
        The rows to show.
    """
    events = records[0].stride_events
    if run.events or len(events) <= SHOWN_STRIDES:
        return end_or_events(run, SHOWN_WITHOUT_STRIDES)
    return _window(run, slice(int(events[-1 - SHOWN_STRIDES]), int(events[-1]) + 1))


def end_or_events(run: Run, duration: float) -> Window:
    """The end of a run, or what led to its first event and came of it.

    Args:
        run: The run.
        duration: How much of it at most in [s].

    Returns:
        The rows to show.
    """
    length = round(duration / TICK)
    start = len(run.log) - length
    if run.events:
        start = min(start, round(run.events[0].time / TICK - SHOWN_BEFORE_EVENT * length))
    start = max(0, start)
    return _window(run, slice(start, min(start + length, len(run.log))))


def whole_run(run: Run) -> Window:
    """The whole run, thinned out if it is long.

    Args:
        run: The run.

    Returns:
        The rows to show.
    """
    return _window(run, slice(0, len(run.log), 1 + len(run.log) // MOST_POINTS))


def _window(run: Run, rows: slice) -> Window:
    return Window(rows, run.log["time_s"].to_numpy()[rows])


def shown_strides(record: LegRecord) -> np.ndarray:
    """Strides that a cycle picture shows: the settled ones, or the last if none has settled.

    Args:
        record: A leg.

    Returns:
        First tick of each stride and of the next one, shape ``(n_strides, 2)``.
    """
    settled = record.strides(skip=SKIPPED_STRIDES)
    return settled if len(settled) else record.strides(skip=0)[-1:]
