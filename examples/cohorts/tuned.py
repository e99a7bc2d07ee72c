"""Tables tuned to each walker of a cohort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from cohorts.walkers import DURATION, SUPPORT

from twin_gait import Experiment, load_experiment, simulate, summarise_run
from twin_gait.studies.batch import override_experiment
from twin_gait.studies.tune.result import tuned_table


class Job(NamedTuple):
    """Task of tuning the shipped table to one walker.

    Attributes:
        number: Of the walker, the seed of the sensor noise.
        walker: Changes of the experiment.
        settings: Of the tuning.
    """

    number: int
    walker: Mapping[str, Any]
    settings: Mapping[str, Any]


def experiment_of(walker: Mapping[str, Any]) -> Experiment:
    """Return the treadmill experiment of one minute."""
    settings = [f"scenario.support.share={SUPPORT}", f"duration_s={DURATION}"]
    return override_experiment(load_experiment("treadmill_guided", settings).experiment, walker)


def tuned_walk(job: Job) -> dict[str, Any]:
    """Tune, simulate a minute, and return outcome and errors under the column names of a batch."""
    experiment = experiment_of(job.walker)
    table = tuned_table(experiment, seed=job.number, **job.settings)
    run = simulate(replace(experiment, table=table))
    errors = {
        f"{side}_rmse_{joint}_by_contact_deg": values[f"rmse_{joint}_by_contact_deg"]
        for side, values in summarise_run(run)["sides"].items()
        for joint in ("hip", "knee")
    }
    return {"outcome": str(run.verdict.outcome), "duration_s": run.duration, **errors}
