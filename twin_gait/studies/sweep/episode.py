"""Episodes of a sweep as jobs; a worker that runs them loads no more than this module asks for."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.validation import converting
from twin_gait.experiment import Experiment
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.batch import Base, Override

if TYPE_CHECKING:
    from twin_gait.studies.sweep.spec import Sweep


class Episodes(Sequence["Episode"]):
    """Episodes of a sweep as jobs, made one by one: a million of them at once would take memory."""

    def __init__(self, sweep: Sweep, numbers: Sequence[int]) -> None:
        """Take those with some numbers."""
        self._sweep, self._numbers = sweep, numbers
        self._document = json.dumps(sweep.document["experiment"])

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, place: Any) -> Any:
        number = self._numbers[place]
        return Episode(number, self._sweep.design[number], self._sweep.seed, self._document)


class Episode(NamedTuple):
    """An episode: plain values only."""

    number: int  # its position in the design
    override: Override  # what it changes
    seed: int  # of the sweep
    document: str  # the experiment that all have in common, as JSON with the hash of its URDF

    def __str__(self) -> str:
        return f"episode {self.number}"

    def experiment(self) -> Experiment:
        """What is to be run, with draws of its own; an error names episode and key."""
        base = _base(self.document)
        draws = np.random.SeedSequence(self.seed, spawn_key=(self.number,))
        seeded = {**base.document, "seed": int(draws.generate_state(1, np.uint64)[0])}
        return base._replace(document=seeded).changed(self.override, str(self))


@lru_cache(maxsize=1)
def _base(document: str) -> Base:
    return Base.of(experiment_from_mapping(json.loads(document), "the sweep", Path()))


def check_episode(episode: Episode) -> None:
    """Check the overrides of an episode."""
    experiment = episode.experiment()
    # A text may name a joint or phase that is not there; numbers are checked by their ranges.
    plain = all(isinstance(value, int | float) for value in episode.override.values())
    if episode.number == 0 or not plain:
        converting(str(episode), "", partial(_lay_out, experiment))


def _lay_out(experiment: Experiment) -> None:
    """Do what goes before the first tick, to find what does not fit together."""
    problem = build_problem(experiment)
    for phase in filter(None, problem.world.initial_phases.values()):
        problem.table.phase_index(phase)
