"""Runs to be looked at: their page made again from their logs, one alone or two beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.validation import read_yaml
from twin_gait.exceptions import ParameterError, ParameterFileError, RunDirectoryError, ViewerError
from twin_gait.experiment import Experiment
from twin_gait.measures.outcome import RunEvent
from twin_gait.runs.record import (
    EXPERIMENT_FILE,
    LOG_FILE,
    belt_motion_of,
    belt_speed_of,
    describe,
    load_run,
    read_run,
)
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.motion import frame_rate, phase_changes
from twin_gait.viewer.page import recorded_page

MOST_RUNS = 2
_URDF_KEY = "provenance.urdf_sha256"
_URDF_NOTE = "The URDF has changed since this run."


@dataclass(frozen=True, eq=False)
class ShownRun:
    """A run to be looked at.

    Attributes:
        name: What its heading says.
        experiment: What was run.
        log: One row per tick.
        notes: What a reader has to know.
        events: Faults, trip, fall and divergence.
        outcome: How it ended, in a word.
    """

    name: str
    experiment: Experiment
    log: pd.DataFrame
    notes: tuple[str, ...] = ()
    events: tuple[RunEvent, ...] = ()
    outcome: str = ""

    @property
    def duration(self) -> float:
        """From the first row to the last in [s]."""
        return float(self.log["time_s"].iloc[-1] - self.log["time_s"].iloc[0])


def read_shown_run(directory: Path) -> ShownRun:
    """Read a run to look at it.

    A URDF that has changed since the run forbids to run it again, but not to look at it: the page says so.
    """
    directory = Path(directory).expanduser()
    name = f"twin_gait · {directory.absolute().name}"
    try:
        notes: tuple[str, ...] = ()
        stored = load_run(directory)
    except ParameterFileError as error:
        if error.key != _URDF_KEY:
            raise
        stored, notes = read_run(directory, _as_it_is_now(directory)), (_URDF_NOTE,)
    shown = ShownRun(name, stored.experiment, stored.log, notes, stored.events, stored.outcome)
    if "time_s" not in shown.log.columns or shown.log.empty:
        raise RunDirectoryError(f"{directory / LOG_FILE}: has no rows to show; run the simulation again")
    return shown


def _as_it_is_now(directory: Path) -> Experiment:
    path = directory / EXPERIMENT_FILE
    data = {key: value for key, value in read_yaml(path).items() if key != "provenance"}
    return experiment_from_mapping(data, str(path), directory)


def page_of(runs: Sequence[ShownRun], *, moments: Sequence[float] = ()) -> str:
    """The page of one run, or of two beside each other under one clock.

    Two runs get their frames at the same moments, so that the page can subtract one from the other.

    Args:
        runs: One or two.
        moments: Moments to have a frame of, in [s].
    """
    if not 1 <= len(runs) <= MOST_RUNS:
        raise ParameterError(f"expected one run or two to show beside each other, got {len(runs)}")
    wanted = np.unique(
        np.concatenate(
            [
                np.asarray(moments, dtype=float),
                *(phase_changes(run.log) for run in runs),
                *([event.time for event in run.events] for run in runs),
            ]
        )
    )
    rate = min(frame_rate(run.duration) for run in runs)
    return recorded_page([_entry(run, rate, wanted.tolist()) for run in runs])


def _entry(run: ShownRun, frames_per_second: float, moments: Sequence[float]) -> dict[str, Any]:
    belt = belt_speed_of(run.experiment)
    try:
        return recorded_run(
            run.log,
            run.experiment.build_world().model,
            title=run.name,
            subtitle=describe(run.experiment.patient, belt),
            belt_speed=belt_motion_of(run.experiment, run.log),
            patient=run.experiment.patient,
            frames_per_second=frames_per_second,
            moments=moments,
            notes=run.notes,
            events=run.events,
            outcome=run.outcome,
        )
    except ViewerError as error:
        raise ViewerError(f"{run.name.split(' · ')[-1]}: {error}") from error
