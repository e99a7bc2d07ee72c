"""A table tuned to each walker of a cohort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from cohorts.walkers import DURATION, SUPPORT

from twin_gait import Experiment, load_experiment, simulate, summarise
from twin_gait.studies import overridden, tuned_table


class Job(NamedTuple):
    """Somebody for whom the shipped table is tuned.

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
    return overridden(load_experiment("treadmill", settings).experiment, walker)


def tuned_walk(job: Job) -> dict[str, Any]:
    """Tune, walk a minute, and give outcome and errors under the names of a batch's table."""
    experiment = experiment_of(job.walker)
    table = tuned_table(experiment, seed=job.number, **job.settings)
    run = simulate(replace(experiment, table=table))
    errors = {
        f"{side}_rmse_{joint}_by_contact_deg": values[f"rmse_{joint}_by_contact_deg"]
        for side, values in summarise(run)["sides"].items()
        for joint in ("hip", "knee")
    }
    return {"outcome": str(run.verdict.outcome), "duration_s": run.duration, **errors}
