"""Episodes with the same options that step together, with observations, rewards and ends as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin_gait.configuration.experiments import LoadedExperiment
from twin_gait.control.controller import PATH_SAMPLES
from twin_gait.learn.actions import BoundAction
from twin_gait.learn.episodes import Records, draw_engine, make_records
from twin_gait.learn.options import EnvironmentOptions
from twin_gait.learn.rewards import total
from twin_gait.learn.signals import Signals
from twin_gait.parameters.quantities import require
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.episode import COMPLETED, DIVERGED
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.studies.batch import walking_wearer
from twin_gait.vocabulary import Outcome

MOST_PROGRESS = 2.0  # Progress in the stride, in cycles of the reference, at which the signal ends.


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
        places = self.records.places if hasattr(self, "records") else None
        self.records = make_records(engines, self._step, places, record=self._record)
        words = self.records.words
        self.signals = Signals(self.records.places, words, self._step, self.options.period_s)
        self.action = self.options.action.bind(self._setup, self.records.places, len(engines))
        setup, count = engines[0].setup, len(engines)
        self._sides = [str(side) for side in setup.sides]
        names, per_leg = [f"{item.side}_{item.joint}" for item in setup.joints], setup.joints_per_leg
        self._joints = [names[first : first + per_leg] for first in range(0, len(names), per_leg)]  # by leg
        self._paths = np.zeros((count, PATH_SAMPLES, per_leg))
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
            share = (position - before)[:, None]
            low, high = self._paths[lanes, before], self._paths[lanes, before + 1]
            angles = (low + share * (high - low)).T
            for name, angle in zip(self._joints[leg], angles, strict=True):
                signals.derived[f"{name}_reference_rad"] = angle

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
        return np.array(found, dtype=self.options.dtype).T

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
