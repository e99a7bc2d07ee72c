"""Strides of a live walk by condition, the time between two changes of its parameters."""

from dataclasses import replace
from typing import NamedTuple

import pandas as pd

from twin_gait.experiment.events import Change
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.table import TICK
from twin_gait.simulation.run import Run
from twin_gait.simulation.settings import apply_changes, first_settings

WORK_SHARE = "wearer_work_share"


class Condition(NamedTuple):
    """Part of a walk with constant parameters."""

    start: int  # first tick
    end: int  # tick after the last one
    experiment: Experiment  # experiment with the parameters of this condition


def conditions_of(run: Run) -> list[Condition]:
    """Return the conditions of a walk in their order, up to a trip.

    A change at the start of the walk belongs to the first condition.
    """
    last = len(run.columns) if run.trip is None else run.trip.tick
    changes = [event for event in run.experiment.events if isinstance(event, Change) and event.tick < last]
    starts = sorted({0, *(event.tick for event in changes)})
    settings, found = first_settings(run.experiment), []
    for start, end in zip(starts, [*starts[1:], last], strict=True):
        for event in (item for item in changes if item.tick == start):
            settings = apply_changes(settings, event.changes)
        found.append(Condition(start, end, settings.experiment))
    return found


def strides_by_condition(run: Run) -> pd.DataFrame:
    """Return the table of strides of a walk with conditions that are counted from 0.

    Errors and loads refer to belt speed and support of the condition, not to those at the start of the walk.
    The column ``wearer_work_share`` is the share of the wearer in the positive work of wearer and device; NaN
    without work.
    """
    tables, shown = [], run
    for number, condition in enumerate(conditions_of(run)):
        if condition.experiment.scenario != shown.experiment.scenario:
            shown = replace(run, experiment=condition.experiment)
        ticks = (shown.strides["start_s"] / TICK).round()
        rows = shown.strides[(ticks >= condition.start) & (ticks < condition.end)]
        tables.append(rows.assign(condition=number))
    table = pd.concat(tables, ignore_index=True)
    wearer, device = (table.filter(regex=f"_{owner}_work_J$").sum(axis=1) for owner in ("wearer", "device"))
    return table.assign(**{WORK_SHARE: wearer / (wearer + device)})
