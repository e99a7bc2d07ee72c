"""Environments of Gymnasium: one episode, or a vector of episodes that run in lockstep.

Interface: Gymnasium 1.2 and later, https://gymnasium.farama.org/api/env/ and /api/vector/. A control step is
10 ms by default: the action is written, the ticks of 1 ms run, and observation and reward are computed from
the last of them. The first control step of an episode runs without an action, because before it the device
has measured nothing.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin_gait.exceptions import MissingOptionalDependency
from twin_gait.learn.episode_group import EpisodeGroup, StepResult
from twin_gait.learn.episodes import SingleRecords
from twin_gait.learn.options import make_options
from twin_gait.learn.signals import words_of
from twin_gait.parameters.quantities import require
from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.run import Run

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
except ImportError as error:
    raise MissingOptionalDependency("gymnasium", "learn", "twin_gait.learn") from error


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
            options: Fields of :class:`~twin_gait.learn.options.EnvironmentOptions`.

        Raises:
            ParameterError: If an option is wrong, or the experiment has no wearer who walks on the ground.
        """
        require(render_mode in (None, "rgb_array"), "render_mode", "None or rgb_array", render_mode)
        self.render_mode = render_mode
        self.options = make_options(options)
        self._group = EpisodeGroup(self.options, self.options.load(), record=record)
        self._over = True  # Whether the episode has ended or not begun.
        self.observation_space, self.action_space = _spaces(self._group)
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
        ``options``: fields of :class:`~twin_gait.learn.options.EnvironmentOptions`. Raises ParameterError as
        :class:`GaitEnv` does.
        """
        require(num_envs >= 1, "num_envs", "1 or more", num_envs)
        require(render_mode is None, "render_mode", "None; a single environment draws pictures", render_mode)
        self.num_envs, self.options = num_envs, make_options(options)
        base = self.options.load()
        self._lanes = [range(first, min(first + WIDTH, num_envs)) for first in range(0, num_envs, WIDTH)]
        self._groups = [EpisodeGroup(self.options, base) for _ in self._lanes]
        self.single_observation_space, self.single_action_space = _spaces(EpisodeGroup(self.options, base))
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


def _spaces(group: EpisodeGroup) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Return the spaces of observations and actions, from an episode that is then discarded."""
    size = group.start([np.random.default_rng(0)]).shape[1]
    observations = gymnasium.spaces.Box(-np.inf, np.inf, (size,), group.options.dtype)
    return observations, gymnasium.spaces.Box(-1.0, 1.0, (len(group.action.names),), np.float32)
