"""Options of an environment for learning, each a plain value or a function."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.configuration.experiments import LoadedExperiment, load_experiment
from twin_gait.gait.table import TICK
from twin_gait.learn.actions import Action, TorqueAction
from twin_gait.learn.episodes import Randomisation
from twin_gait.learn.rewards import REWARDS, RewardTerm
from twin_gait.learn.signals import ObservationTerm
from twin_gait.parameters.quantities import require
from twin_gait.studies.batch import attach_document, override_experiment, walking_wearer

# Signals that the device measures, with the factors that bring them to the order of 1.
MEASURED: Mapping[str, float] = {
    "measured_angle_rad": 1.0,
    "velocity_fast_rad_per_s": 0.2,
    "foot_load": 1.0,
    "stride_progress": 1.0,
}
DEFAULT_REWARDS: Mapping[str, float] = {
    "tracking": 1.0,
    "device_effort": 0.1,
    "smoothness": 0.1,
    "fall": 10.0,
}


@dataclass(frozen=True)
class EnvironmentOptions:
    """Options of an environment, each a plain value or function.

    Attributes:
        experiment: Name of a preset, path of an experiment file, or a loaded experiment.
        action: Quantities that an action changes, see :mod:`twin_gait.learn.actions`.
        observations: Names of signals with factors, or functions of the signals. A signal is a column of the
            log (privileged ones too) or its end, which selects all legs or joints.
        rewards: Weights by name of the terms of :data:`~twin_gait.learn.rewards.REWARDS`.
        own_rewards: Functions of the user by name; their weights are in ``rewards`` too.
        randomise: Values drawn for each episode, by key of the experiment: a tuple of two bounds, or a list
            of values.
        period_s: Control step in [s], whole milliseconds.
        duration_s: Length of an episode in [s]; that of the experiment by default.
        dtype: Type of the observations; with ``numpy.float64`` they have the digits of the controller.
    """

    experiment: str | Path | LoadedExperiment = "treadmill_guided"
    action: Action = field(default_factory=TorqueAction)
    observations: Mapping[str, float | ObservationTerm] = field(default_factory=lambda: dict(MEASURED))
    rewards: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_REWARDS))
    own_rewards: Mapping[str, RewardTerm] = field(default_factory=dict)
    randomise: Randomisation = field(default_factory=dict)
    period_s: float = 0.01
    duration_s: float | None = None
    dtype: type[np.floating[Any]] = np.float32

    def load(self) -> LoadedExperiment:
        """Load the experiment; raises ParameterError or ParameterFileError if it cannot be used."""
        given = self.experiment
        loaded = given if isinstance(given, LoadedExperiment) else load_experiment(given)
        experiment = loaded.experiment
        if self.duration_s is not None:
            experiment = override_experiment(experiment, {"duration_s": self.duration_s})
        walking_wearer(experiment)
        return attach_document(experiment)

    @property
    def step_ticks(self) -> int:
        """Ticks of a control step; raises ParameterError unless they are whole."""
        ticks = round(self.period_s / TICK)
        whole = ticks >= 1 and abs(ticks * TICK - self.period_s) < 1e-9
        require(whole, "period_s", "a control step of whole milliseconds, 0.001 or more", self.period_s)
        return ticks

    @property
    def terms(self) -> dict[str, tuple[float, RewardTerm]]:
        """Weight and function of each reward term; raises ParameterError for an unknown name."""
        known = {**REWARDS, **self.own_rewards}
        for name in self.rewards:
            require(name in known, "rewards", f"names of reward terms, of {', '.join(known)}", name)
        return {name: (weight, known[name]) for name, weight in self.rewards.items()}


def make_options(given: Mapping[str, Any]) -> EnvironmentOptions:
    """Return options; raises ParameterError for an unknown name."""
    known = EnvironmentOptions.__dataclass_fields__
    for name in given:
        require(name in known, "options", f"names of {', '.join(known)}", name)
    return replace(EnvironmentOptions(), **given)
