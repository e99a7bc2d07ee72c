"""Page of one stored run, or of two stored runs next to each other."""

from collections.abc import Sequence

import numpy as np

from twin_gait.exceptions import RunDirectoryError
from twin_gait.experiment.experiment import Experiment
from twin_gait.report.formatting import (
    belt_carries_note,
    describe,
    extrapolation_note,
    missing_peaks,
    unstable_step_note,
    walk_table,
)
from twin_gait.runs.stored_run import StoredRun
from twin_gait.viewer.animation import recorded_run
from twin_gait.viewer.motion import frame_rate, phase_changes
from twin_gait.viewer.page import PageTexts, recorded_page
from twin_gait.viewer.scene import SceneOptions
from twin_gait.vocabulary import Environment


def page_texts(stored: StoredRun, other: StoredRun | None = None) -> PageTexts:
    """Return the texts of the page of a run, with measures from its summary.

    ``other``: second run of a pair. Raises RunDirectoryError if the summary is not complete.
    """
    run, summary, name = stored
    subtitle = describe(run.experiment)
    other_subtitle = subtitle if other is None else describe(other.run.experiment)
    try:
        first = unstable_step_note(summary), belt_carries_note(summary), extrapolation_note(summary)
        notes = [*filter(None, first), *missing_peaks(summary)]
        walk = walk_table(summary)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        problem = f"summary.json is not complete ({type(error).__name__}: {error}); run the simulation again"
        raise RunDirectoryError(f"{name or run.experiment.name}: {problem}") from error
    return PageTexts(
        title=f"twin_gait · {name or run.experiment.name}",
        subtitle=subtitle,
        differing=[text for text in subtitle if text not in other_subtitle],
        notes=notes,
        events=run.events,
        outcome=run.verdict.outcome or run.status,
        walk=walk,
        modes=mode_names(run.experiment),
    )


def render_run_page(runs: Sequence[StoredRun], *, frame_times: Sequence[float] = ()) -> str:
    """Return the page of one run, or of two next to each other; ``frame_times``: times of frames in [s]."""
    changes = (phase_changes(one.run.log) for one in runs)
    events = ([event.time for event in one.run.events] for one in runs)
    shown_times = np.unique(np.concatenate([np.asarray(frame_times, dtype=float), *changes, *events]))
    rate = min(frame_rate(one.run.duration) for one in runs)
    entries = [
        recorded_run(
            one.run.log,
            one.run.experiment.build_world().model,
            about=page_texts(one, other),
            frames_per_second=rate,
            frame_times=shown_times.tolist(),
            **scene_options(one.run.experiment),
        )
        for one, other in zip(runs, (runs[1], runs[0]) if len(runs) == 2 else (None,), strict=True)
    ]
    return recorded_page(entries)


def scene_options(experiment: Experiment) -> SceneOptions:
    """Return the setting that the viewer draws around the figure."""
    world, walking = experiment.scenario, experiment.scenario.walking
    carried = walking is not None and walking.support_share > 0.0
    return SceneOptions(
        environment=world.surroundings,
        drives=experiment.joints,
        driven_sides=experiment.sides,
        patient=experiment.patient,
        slope=0.0 if walking is None else walking.slope,
        ropes=carried or world.surroundings is not Environment.WALKWAY,
        crutches=getattr(world, "crutches", None),
        chair=getattr(world, "chair", None),
    )


def mode_names(experiment: Experiment) -> Sequence[str]:
    """Return the names of the modes of operation in the order of their codes; empty without modes."""
    return () if experiment.modes is None else tuple(experiment.modes.phases)
