"""Page of one stored run, or of two stored runs next to each other."""

from collections.abc import Sequence

import numpy as np

from twin_gait.exceptions import RunDirectoryError
from twin_gait.experiment import Experiment
from twin_gait.report.walk_words import carried_by_belt, describe, missing_peaks, table_of_walk
from twin_gait.runs.record import StoredRun
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.motion import frame_rate, phase_changes
from twin_gait.viewer.page import About, recorded_page
from twin_gait.viewer.scene import Setting
from twin_gait.vocabulary import Surroundings


def about(stored: StoredRun, other: StoredRun | None = None) -> About:
    """Return the texts of the page of a run, with measures from its summary.

    ``other``: second run of a pair. Raises RunDirectoryError if the summary is not complete.
    """
    run, summary, name = stored
    subtitle = describe(run.experiment)
    beside = subtitle if other is None else describe(other.run.experiment)
    try:
        notes = [*filter(None, (carried_by_belt(summary),)), *missing_peaks(summary)]
        walk = table_of_walk(summary)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        problem = f"summary.json is not complete ({type(error).__name__}: {error}); run the simulation again"
        raise RunDirectoryError(f"{name or run.experiment.name}: {problem}") from error
    return About(
        title=f"twin_gait · {name or run.experiment.name}",
        subtitle=subtitle,
        differing=[text for text in subtitle if text not in beside],
        notes=notes,
        events=run.events,
        outcome=run.verdict.outcome or run.status,
        walk=walk,
        modes=modes_of(run.experiment),
    )


def page_of(runs: Sequence[StoredRun], *, moments: Sequence[float] = ()) -> str:
    """Return the page of one run, or of two next to each other with frames at the same ``moments`` in [s]."""
    changes = (phase_changes(one.run.log) for one in runs)
    events = ([event.time for event in one.run.events] for one in runs)
    wanted = np.unique(np.concatenate([np.asarray(moments, dtype=float), *changes, *events]))
    rate = min(frame_rate(one.run.duration) for one in runs)
    entries = [
        recorded_run(
            one.run.log,
            one.run.experiment.build_world().model,
            about=about(one, other),
            frames_per_second=rate,
            moments=wanted.tolist(),
            **setting_of(one.run.experiment),
        )
        for one, other in zip(runs, (runs[1], runs[0]) if len(runs) == 2 else (None,), strict=True)
    ]
    return recorded_page(entries)


def setting_of(experiment: Experiment) -> Setting:
    """Return the setting that the viewer draws around the figure."""
    world, walking = experiment.scenario, experiment.scenario.walking
    carried = walking is not None and walking.support_share > 0.0
    return Setting(
        around=world.surroundings,
        drives=experiment.joints,
        patient=experiment.patient,
        slope=0.0 if walking is None else walking.slope,
        ropes=carried or world.surroundings is not Surroundings.WALKWAY,
        crutches=getattr(world, "crutches", None),
        chair=getattr(world, "chair", None),
    )


def modes_of(experiment: Experiment) -> Sequence[str]:
    """Return the names of the modes of operation in the order of their codes; empty without modes."""
    return () if experiment.modes is None else tuple(experiment.modes.phases)
