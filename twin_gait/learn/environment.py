"""Environments of Gymnasium: one episode, or a vector of episodes that run in lockstep.

Interface: Gymnasium 1.2 and later, https://gymnasium.farama.org/api/env/ and /api/vector/. A control step is
10 ms by default: the action is written, the ticks of 1 ms run, and observation and reward are computed from
the last of them. The first control step of an episode runs without an action, because before it the device
has measured nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.configuration.experiments import LoadedExperiment, load_experiment
from twin_gait.control.controller import PATH_SAMPLES
from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.gait.table import TICK
from twin_gait.learn.actions import Action, BoundAction, TorqueAction
from twin_gait.learn.episodes import (
    Randomisation,
    Records,
    SingleRecords,
    draw_engine,
    make_records,
)
from twin_gait.learn.rewards import REWARDS, RewardTerm, total
from twin_gait.learn.signals import ObservationTerm, Signals, words_of
from twin_gait.parameters.quantities import require
from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.episode import COMPLETED, DIVERGED
from twin_gait.simulation.run import Run
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import attach_document, override_experiment, walking_wearer
from twin_gait.vocabulary import Outcome

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
except ImportError as error:
    raise MissingOptionalDependency("gymnasium", "learn", "twin_gait.learn") from error

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
MOST_PROGRESS = 2.0  # Progress in the stride, in cycles of the reference, at which the signal ends.


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
    """

    experiment: str | Path | LoadedExperiment = "treadmill"
    action: Action = field(default_factory=TorqueAction)
    observations: Mapping[str, float | ObservationTerm] = field(default_factory=lambda: dict(MEASURED))
    rewards: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_REWARDS))
    own_rewards: Mapping[str, RewardTerm] = field(default_factory=dict)
    randomise: Randomisation = field(default_factory=dict)
    period_s: float = 0.01
    duration_s: float | None = None

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


@dataclass(frozen=True)
class StepResult:
    """Result of a control step of all episodes of a group, arrays with an entry for each."""

    observations: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    reward_terms: dict[str, np.ndarray]
    outcomes: np.ndarray  # Why an episode ended: an outcome, or an empty text.


class EpisodeGroup:
    """Episodes with the same options that step together: at most as many as the lanes of a block."""

    def __init__(self, options: EnvironmentOptions, base: LoadedExperiment, *, record: bool = False) -> None:
        """Store the options; :meth:`start` begins the episodes. ``record``: whether logs are kept."""
        self.options, self.base, self._record = options, base, record
        self._step, self._terms = options.step_ticks, options.terms
        # Ranges of an action are those of the experiment before anything is drawn, equal in all episodes.
        self._setup = build_setup(base.experiment)
        self.records: Records
        self.signals: Signals
        self.action: BoundAction

    def start(self, generators: Sequence[np.random.Generator]) -> np.ndarray:
        """Begin an episode with each random generator, and return the observations."""
        engines = [draw_engine(self.base, self.options.randomise, item) for item in generators]
        self.records = make_records(engines, self._step, record=self._record)
        words = self.records.words
        self.signals = Signals(self.records.places, words, self._step, self.options.period_s)
        self.action = self.options.action.bind(self._setup, self.records.places, len(engines))
        setup, count = engines[0].setup, len(engines)
        self._sides = [str(side) for side in setup.sides]
        self._joints = [(index, f"{item.side}_{item.joint}") for index, item in enumerate(setup.joints)]
        self._per_leg = setup.joints_per_leg
        self._paths = np.zeros((count, PATH_SAMPLES, self._per_leg))
        self._cycles = np.zeros(count)
        self._starts = np.zeros((len(self._sides), count))  # Tick in which the stride of each leg began.
        self._lasts = np.array([item.setup.experiment.n_ticks for item in engines])
        for lane, engine in enumerate(engines):
            self._enter(lane, engine)
        self._read()
        for _, term in self._terms.values():  # so that changes are counted from here on
            term(self.signals)
        return self._observe()

    def _enter(self, lane: int, engine: CompiledEngine) -> None:
        """Store the constants of a new episode."""
        setup, numbers = engine.setup, self.records.words.view(float)
        path = setup.plan.reference
        self._paths[lane] = path.angles
        self._cycles[lane] = path.cycle_ticks
        self._starts[:, lane] = -np.array(path.starts) * path.cycle_ticks
        self._lasts[lane] = setup.experiment.n_ticks
        walking, patient = walking_wearer(setup.experiment)
        constants = {"wearer_mass_kg": patient.mass, "carried_share": walking.carried_share}
        limits = setup.experiment.control.limits
        for item in setup.joints:
            constants[f"{item.side}_{item.joint}_torque_limit_Nm"] = limits[item.joint].torque
        for name, value in constants.items():
            self.signals.derived.setdefault(name, np.zeros(len(self._cycles)))[lane] = value
        self.action.reset(numbers, lane)

    def _read(self) -> None:
        """Compute the derived signals: progress in the stride, and the angles of healthy walking there."""
        signals = self.signals
        signals.tick = self.records.ticks_done.copy()
        lanes = np.arange(len(self._cycles))
        for leg, side in enumerate(self._sides):
            entry = signals[f"{side}_phase_entry_tick"]
            begun = (signals[f"{side}_phase"] == 0.0) & (entry > 0.0)
            self._starts[leg] = np.where(begun, entry, self._starts[leg])
            progress = (signals.tick - self._starts[leg]) / self._cycles
            signals.derived[f"{side}_stride_progress"] = np.minimum(progress, MOST_PROGRESS)
            position = (progress - np.floor(progress)) * (PATH_SAMPLES - 1)
            before = np.minimum(position.astype(int), PATH_SAMPLES - 2)
            share = position - before
            for index, name in self._joints[leg * self._per_leg : (leg + 1) * self._per_leg]:
                column = index % self._per_leg
                low, high = self._paths[lanes, before, column], self._paths[lanes, before + 1, column]
                signals.derived[f"{name}_reference_rad"] = low + share * (high - low)

    def _observe(self) -> np.ndarray:
        """Return the observations, shape ``(n, size)``."""
        found = list[np.ndarray]()
        for name, term in self.options.observations.items():
            if callable(term):
                values = np.asarray(term(self.signals), dtype=float)
                found += [values] if values.ndim == 1 else list(values.T)
            else:
                found += [term * values for values in self.signals.each(name)]
        require(len(found) > 0, "observations", "at least one signal", "none")
        return np.array(found, dtype=np.float32).T

    def step(
        self, actions: np.ndarray, generators: Mapping[int, np.random.Generator], running: np.ndarray
    ) -> StepResult:
        """Step the episodes in some lanes, and begin new ones in others.

        ``actions``: values from -1 to 1, shape ``(n, size)``. ``generators``: random generator of each lane
        that begins a new episode; its reward is 0. ``running``: lanes that step.
        """
        numbers = self.records.words.view(float)
        self.signals.store_previous()
        self.action.apply(self.signals, numbers, actions)
        for lane, generator in generators.items():
            engine = draw_engine(self.base, self.options.randomise, generator)
            self.records.replace(lane, engine)
            self._enter(lane, engine)
        self.records.advance(running)
        self.signals.refresh()
        self._read()
        return self._result(running)

    def _result(self, running: np.ndarray) -> StepResult:
        """Compute the result of a step in which some lanes ran and the others began a new episode."""
        signals, count = self.signals, len(self._cycles)
        active = np.zeros(count, dtype=bool)
        active[running] = True
        terms = {
            name: np.where(active, weight * term(signals), 0.0)
            for name, (weight, term) in self._terms.items()
        }
        status, tripped = signals["status"], signals["trip_tick"] >= 0.0
        terminated = active & ((status != COMPLETED) | tripped)
        outcomes = np.full(count, "", dtype=object)
        outcomes[terminated & tripped] = str(Outcome.HELD)
        outcomes[terminated & (status != COMPLETED)] = str(Outcome.FELL)
        outcomes[terminated & (status == DIVERGED)] = str(Outcome.DIVERGED)
        return StepResult(
            observations=self._observe(),
            rewards=total(list(terms.values())) if terms else np.zeros(count),
            terminated=terminated,
            truncated=active & ~terminated & (signals.tick >= self._lasts),
            reward_terms=terms,
            outcomes=outcomes,
        )


class GaitEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Environment of one episode.

    Attributes:
        signal_names: Names of the signals that observations and rewards can use.
        action_names: Meaning of each number of an action.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012  # as its base

    def __init__(self, *, render_mode: str | None = None, record: bool = False, **options: Any) -> None:
        """Load the experiment.

        Args:
            render_mode: ``rgb_array`` for pictures from :meth:`render`.
            record: Whether the log of the episode is kept, for :attr:`run`; about 1 MB per second.
            options: Fields of :class:`EnvironmentOptions`.

        Raises:
            ParameterError: If an option is wrong, or the experiment has no wearer who walks on the ground.
        """
        require(render_mode in (None, "rgb_array"), "render_mode", "None or rgb_array", render_mode)
        self.render_mode = render_mode
        self.options = make_options(options)
        self._group = EpisodeGroup(self.options, self.options.load(), record=record)
        self._over = True  # Whether the episode has ended or not begun.
        sizes = _sizes(self._group)
        self.observation_space, self.action_space = _observations(sizes[0]), _actions(sizes[1])
        self.signal_names, self.action_names = self._group.records.places.names, self._group.action.names
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.options.period_s)}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new episode; see :meth:`gymnasium.Env.reset`. There are no ``options``."""
        super().reset(seed=seed)
        self._over = False
        return self._group.start([self.np_random])[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Run a control step; see :meth:`gymnasium.Env.step`.

        ``info`` has the weighted reward of each term (``reward_terms``), and ``outcome`` if the episode was
        terminated. Raises ResetNeeded before the first reset and after the end of an episode.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("the episode has ended or not begun; call reset() first")
        actions = np.asarray(action, dtype=float)[None]
        found = self._group.step(actions, {}, np.zeros(1, dtype=int))
        info: dict[str, Any] = {
            "reward_terms": {name: float(values[0]) for name, values in found.reward_terms.items()}
        }
        if found.terminated[0]:
            info["outcome"] = str(found.outcomes[0])
        ended = bool(found.terminated[0]), bool(found.truncated[0])
        self._over = any(ended)
        return found.observations[0], float(found.rewards[0]), *ended, info

    @property
    def run(self) -> Run:
        """Episode so far as a run, which can be saved and plotted; requires ``record=True``."""
        records = self._group.records
        if not isinstance(records, SingleRecords):
            raise TypeError("a single environment has single records")
        return records.run(0)

    def render(self) -> np.ndarray | None:
        """Draw the posture as a picture, shape ``(height, width, 3)``; None without a render mode."""
        if self.render_mode is None:
            return None
        from twin_gait.learn.picture import draw_posture

        records = self._group.records
        q = records.words.view(float)[words_of(records.places.root.q)[:, 0], 0]
        return draw_posture(records.engines[0].setup, q)


class VectorGaitEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Vector environment: the episodes run as vector code, with the same results as :class:`GaitEnv`.

    The episode of an environment ends as in Gymnasium's mode ``NEXT_STEP``: the next step begins a new
    episode, ignores the action and returns the reward 0.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  # as its base

    def __init__(self, num_envs: int = WIDTH, *, render_mode: str | None = None, **options: Any) -> None:
        """Load the experiment, and compile the loop for blocks if it is not in the code cache.

        ``num_envs``: number of environments; multiples of 32 are fastest, fewer than 16 run one by one.
        ``options``: fields of :class:`EnvironmentOptions`. Raises ParameterError as :class:`GaitEnv` does.
        """
        require(num_envs >= 1, "num_envs", "1 or more", num_envs)
        require(render_mode is None, "render_mode", "None; a single environment draws pictures", render_mode)
        self.num_envs, self.options = num_envs, make_options(options)
        base = self.options.load()
        self._lanes = [range(first, min(first + WIDTH, num_envs)) for first in range(0, num_envs, WIDTH)]
        self._groups = [EpisodeGroup(self.options, base) for _ in self._lanes]
        sizes = _sizes(EpisodeGroup(self.options, base))
        self.single_observation_space, self.single_action_space = _observations(sizes[0]), _actions(sizes[1])
        batch = gymnasium.vector.utils.batch_space
        self.observation_space = batch(self.single_observation_space, num_envs)
        self.action_space = batch(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator] = []
        self._over = np.zeros(num_envs, dtype=bool)  # Environments whose episode has ended.

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new episode in every environment; environment i has the seed ``seed + i``."""
        if seed is not None or not self._generators:
            seeds = seed if isinstance(seed, Sequence) else self._seeds(seed)
            self._generators = [gymnasium.utils.seeding.np_random(item)[0] for item in seeds]
        self._over[:] = False
        found = [
            group.start([self._generators[lane] for lane in lanes])
            for group, lanes in zip(self._groups, self._lanes, strict=True)
        ]
        return np.concatenate(found), {}

    def _seeds(self, seed: int | None) -> list[int | None]:
        return [None if seed is None else seed + number for number in range(self.num_envs)]

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Run a control step in every environment; see :meth:`gymnasium.vector.VectorEnv.step`.

        ``infos`` has the weighted rewards by term, each an array, and the outcomes of terminated episodes.
        """
        values, results = np.asarray(actions, dtype=float), list[StepResult]()
        for group, lanes in zip(self._groups, self._lanes, strict=True):
            over = self._over[lanes.start : lanes.stop]
            begun = {lane: self._generators[lanes.start + lane] for lane in np.flatnonzero(over).tolist()}
            part = values[lanes.start : lanes.stop]
            results.append(group.step(part, begun, np.flatnonzero(~over)))
        joined = {
            name: np.concatenate([getattr(found, name) for found in results])
            for name in ("observations", "rewards", "terminated", "truncated", "outcomes")
        }
        terms = {
            name: np.concatenate([found.reward_terms[name] for found in results])
            for name in results[0].reward_terms
        }
        self._over = joined["terminated"] | joined["truncated"]
        infos: dict[str, Any] = {"reward_terms": terms}
        if joined["terminated"].any():
            infos |= {"outcome": joined["outcomes"], "_outcome": joined["terminated"].copy()}
        observations, rewards = joined["observations"], joined["rewards"]
        return observations, rewards, joined["terminated"], joined["truncated"], infos


def register(name: str, options: Mapping[str, Any]) -> None:
    """Register an environment for ``gymnasium.make`` and ``make_vec``; ``options``: see above."""
    module = __name__
    gymnasium.register(
        name,
        entry_point=f"{module}:{GaitEnv.__name__}",
        vector_entry_point=f"{module}:{VectorGaitEnv.__name__}",
        kwargs=dict(options),
    )


def make_options(given: Mapping[str, Any]) -> EnvironmentOptions:
    """Return options; raises ParameterError for an unknown name."""
    known = EnvironmentOptions.__dataclass_fields__
    for name in given:
        require(name in known, "options", f"names of {', '.join(known)}", name)
    return replace(EnvironmentOptions(), **given)


def _sizes(group: EpisodeGroup) -> tuple[int, int]:
    """Return the numbers of an observation and of an action, from an episode that is then discarded."""
    observations = group.start([np.random.default_rng(0)])
    return observations.shape[1], len(group.action.names)


def _observations(size: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)


def _actions(size: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)
