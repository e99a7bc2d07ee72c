"""Runs of any age as a page shows them: one alone, or two beside each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import RunDirectoryError
from twin_gait.experiment import Experiment
from twin_gait.report.walk_words import carried_by_belt, describe, table_of_network, table_of_walk
from twin_gait.runs.record import LOG_FILE, read_run
from twin_gait.simulation.run import Run
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.motion import frame_rate, phase_changes
from twin_gait.viewer.page import About, recorded_page
from twin_gait.viewer.scene import Setting
from twin_gait.vocabulary import Surroundings


@dataclass(frozen=True, eq=False)
class ShownRun:
    """A run to be looked at."""

    experiment: Experiment  # what was run
    log: pd.DataFrame  # one row per tick
    about: About  # what its page says of it

    @property
    def duration(self) -> float:
        """From the first row to the last in [s]."""
        return float(self.log["time_s"].iloc[-1] - self.log["time_s"].iloc[0])


def shown_run(run: Run, summary: Mapping[str, Any], *, name: str = "") -> ShownRun:
    """A run as its page shows it, with its measures and who carries it from its summary."""
    experiment = run.experiment
    about = About(
        title=f"twin_gait · {name or experiment.name}",
        subtitle=describe(experiment),
        notes=[*filter(None, (carried_by_belt(summary),))],
        events=run.events,
        outcome=run.verdict.outcome or run.status,
        walk=table_of_walk(summary),
        network=table_of_network(summary),
        modes=modes_of(experiment),
    )
    return ShownRun(experiment, run.log, about)


def page_of(runs: Sequence[ShownRun], *, moments: Sequence[float] = ()) -> str:
    """The page of one run, or of two beside each other, their frames at the same ``moments`` in [s]."""
    changes = (phase_changes(run.log) for run in runs)
    events = ([event.time for event in run.about.get("events", ())] for run in runs)
    wanted = np.unique(np.concatenate([np.asarray(moments, dtype=float), *changes, *events]))
    rate = min(frame_rate(run.duration) for run in runs)
    entries = [
        recorded_run(
            run.log,
            run.experiment.build_world().model,
            about=run.about,
            frames_per_second=rate,
            moments=wanted.tolist(),
            **setting_of(run.experiment),
        )
        for run in runs
    ]
    return recorded_page(entries)


def setting_of(experiment: Experiment) -> Setting:
    """What the viewer draws around the figure."""
    world, walking = experiment.scenario, experiment.scenario.walking
    carried = walking is not None and walking.support_share > 0.0
    return Setting(
        around=world.surroundings,
        patient=experiment.patient,
        slope=0.0 if walking is None else walking.slope,
        ropes=carried or world.surroundings is not Surroundings.WALKWAY,
        crutches=getattr(world, "crutches", None),
        chair=getattr(world, "chair", None),
    )


def modes_of(experiment: Experiment) -> Sequence[str]:
    """Names of the operating modes in the order of their codes, or nothing."""
    return () if experiment.modes is None else tuple(experiment.modes.phases)


def read_shown_run(directory: Path) -> ShownRun:
    """Read a run to look at it."""
    run, summary = read_run(directory)
    if run.log.empty:
        raise RunDirectoryError(f"{directory / LOG_FILE}: has no rows to show; run the simulation again")
    return shown_run(run, summary, name=directory.expanduser().absolute().name)
