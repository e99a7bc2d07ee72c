"""An episode of a sweep as a job, which any process that has this package can do."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.validation import converting
from twin_gait.experiment import Experiment
from twin_gait.simulation import simulate
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.batch import Flat, Override, episode_of, flat_summary


class Episode(NamedTuple):
    """An episode: plain values only.

    Attributes:
        number: Its position in the design.
        override: What it changes.
        seed: Of the sweep.
        document: The experiment that all have in common, as JSON with the hash of its URDF.
    """

    number: int
    override: Override
    seed: int
    document: str

    def __str__(self) -> str:
        return f"episode {self.number}"

    def experiment(self) -> Experiment:
        """What is to be run.

        Raises:
            ParameterFileError: If a change is wrong, naming episode and key.
        """
        return episode_of(_base(self.document), self.override, self.number, self.seed)


@lru_cache(maxsize=1)
def _base(document: str) -> Experiment:
    return experiment_from_mapping(json.loads(document), "the sweep", Path())


def check_episode(episode: Episode) -> None:
    """Check the overrides of an episode.

    Args:
        episode: The episode.

    Raises:
        TwinGaitError: If one is wrong.
    """
    experiment = episode.experiment()
    # A text may name a joint or phase that is not there; numbers are checked by their ranges.
    plain = all(isinstance(value, int | float) for value in episode.override.values())
    if episode.number == 0 or not plain:
        converting(str(episode), "", partial(_lay_out, experiment))


def _lay_out(experiment: Experiment) -> None:
    """Do what goes before the first tick, to find what does not fit together."""
    problem = build_problem(experiment)
    for phase in problem.world.initial_phases.values():
        if phase is not None:
            problem.table.phase_index(phase)


def run_episode(episode: Episode, on_compile: Callable[[], None] | None = None) -> Flat:
    """Run an episode.

    Args:
        episode: The episode.
        on_compile: As in :func:`twin_gait.simulation.simulate`.

    Returns:
        Its summary; a fall or a divergence is one.
    """
    return flat_summary(simulate(episode.experiment(), on_compile=on_compile))
