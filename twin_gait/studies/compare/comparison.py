"""Simulation of every controller on every day of a wearer, and the table of its measures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import pandas as pd
from scipy.stats import t as student

from twin_gait.control.controllers.assistance import AssistanceParameters
from twin_gait.experiment.device import ControlMode
from twin_gait.experiment.experiment import Experiment
from twin_gait.parameters.quantities import require
from twin_gait.parameters.wearer import MASSES
from twin_gait.simulation.run import Run
from twin_gait.studies.batch import run_episodes, walking_wearer
from twin_gait.studies.compare.measures import Measures, run_measures
from twin_gait.studies.jobs import WorkCallbacks
from twin_gait.worlds.world import BELT_SPEED
from twin_gait.yaml12 import load_data

# Largest relative deviations of a day from the nominal one, in either direction, uniformly distributed
# (assumptions): clothes and luggage, warm or cold gears, a belt speed that differs from its display,
# a good or a bad day.
SPREADS = (0.03, 0.2, 0.03, 0.1)  # for mass, friction, speed and effort
CONFIDENCE = 0.95
# TwinCare uses a share of the table's impedance for each joint; four fifths is an assumption. An experiment
# with shares of its own keeps them.
TWINCARE_SHARE = 0.8


@dataclass(frozen=True)
class ComparedController:
    """A controller of the legs in the comparison."""

    name: str  # name on the command line and in tables
    title: str  # title in a report
    explanation: str  # explanation in plain words
    law: str  # control mode, the law from angle to torque
    colour: str  # colour of its curves
    adaptive: bool = False  # whether the assistance adapts from stride to stride
    uses_partial_share: bool = False  # whether a fixed share of the table acts

    def can_drive(self, experiment: Experiment) -> bool:
        """Return whether the controller can drive the joints of an experiment."""
        control = replace(experiment.control, mode=ControlMode(self.law))
        return not control.controller().check_joints(experiment.joints)

    def apply_to(self, experiment: Experiment) -> Experiment:
        """Return the same experiment with this controller."""
        assistance = AssistanceParameters()
        if self.adaptive or self.uses_partial_share:
            assistance = replace(experiment.control.assistance, adaptive=self.adaptive)
        if self.uses_partial_share and assistance.is_full:
            shares = dict.fromkeys(experiment.joints, TWINCARE_SHARE)
            assistance = replace(assistance, share=shares)
        control = replace(experiment.control, mode=ControlMode(self.law), assistance=assistance)
        return replace(experiment, control=control, controller=None)


_ROWS = load_data(Path(__file__).with_name("controllers.yaml"))
CONTROLLERS = {name: ComparedController(name=name, **row) for name, row in _ROWS.items()}


def find_controllers(names: Sequence[str]) -> tuple[ComparedController, ...]:
    """Return controllers by name, such as ``table`` and ``position``.

    Raises ParameterError if there are no names, a name is unknown, or a name occurs twice.
    """
    once = len(set(names)) == len(names) > 0
    expected = f"some of {', '.join(CONTROLLERS)}, each once"
    require(once and CONTROLLERS.keys() >= set(names), "controllers", expected, ", ".join(names) or "none")
    return tuple(CONTROLLERS[name] for name in names)


class Interval(NamedTuple):
    """Mean and confidence interval over all days, including the nominal one."""

    mean: float  # mean; NaN if no run has the number
    half_width: float  # half-width of its 95 % confidence interval; NaN for fewer than two runs


@dataclass(frozen=True, eq=False)
class Comparison:
    """Results of a comparison of controllers."""

    experiment: Experiment  # common experiment of all controllers
    controllers: tuple[ComparedController, ...]  # controllers in the order of the report
    seeds: int  # number of days on which each was run; the first is the nominal one
    table: pd.DataFrame  # one row per run: ``controller``, ``seed`` and the numbers of run_measures
    runs: dict[str, Run]  # runs of the nominal day, by the name of the controller

    def interval(self, controller: str, number: str) -> Interval:
        """Return mean and interval of a measure over the runs of a controller that have it."""
        runs = self.table[self.table["controller"] == controller]
        return interval_of(runs.get(number, pd.Series(dtype=float)))

    def walked(self, controller: str) -> int:
        """Count the runs of a controller without a fall or a trip."""
        return int(self.table.loc[self.table["controller"] == controller, "walked"].sum())

    def numbers(self, controller: str) -> Measures:
        """Return ``NAME`` and ``NAME_half_width`` of every measure."""
        names = self.table.columns.drop(["controller", "seed", "status", "trip"])
        means = {str(name): self.interval(controller, name) for name in names}
        widths = {f"{name}_half_width": found.half_width for name, found in means.items()}
        return {name: found.mean for name, found in means.items()} | widths


def interval_of(values: pd.Series) -> Interval:
    """Compute the mean with the confidence interval of Student's t distribution; NaN is ignored."""
    deviation: Any = values.sem()
    quantile = student.ppf(0.5 + 0.5 * CONFIDENCE, values.count() - 1)
    return Interval(float(values.mean()), float(quantile * deviation))


def compare(
    experiment: Experiment,
    controllers: Sequence[ComparedController],
    *,
    seeds: int = 1,
    **watch: Unpack[WorkCallbacks],
) -> Comparison | None:
    """Run every controller on every day; the days are the same for all controllers.

    ``seeds``: number of days. Returns the comparison, or None if it was stopped. Raises ParameterError if the
    experiment or the arguments do not allow a comparison.
    """
    walking_wearer(experiment)
    require(seeds >= 1, "seeds", "1 or more", seeds)
    jobs = [(controller, seed) for controller in controllers for seed in range(seeds)]
    day_of, measure = partial(_make_sample, experiment), partial(_measured, experiment.seed)
    found = run_episodes(day_of, measure, jobs, episode_name=lambda index: jobs[index][0].name, **watch)
    if len(found) < len(jobs):
        return None
    named = [{"controller": controller.name, "seed": seed} for controller, seed in jobs]
    table = pd.DataFrame([name | row for name, (row, _) in zip(named, found, strict=True)])
    nominal = {item.name: run for (item, _), (_, run) in zip(jobs, found, strict=True) if run is not None}
    return Comparison(experiment, tuple(controllers), seeds, table, nominal)


def _make_sample(experiment: Experiment, job: tuple[ComparedController, int]) -> Experiment:
    controller, seed = job
    return controller.apply_to(draw_sample(experiment, seed))


def _measured(nominal_seed: int, run: Run) -> tuple[dict[str, object], Run | None]:
    """Return a row of the table, and the run itself if it belongs to the nominal day."""
    trip = "" if run.trip is None else f"{run.trip.text} at {run.trip.time:.2f} s"
    row = {"status": str(run.status), "trip": trip, **run_measures(run)}
    return row, run if run.experiment.seed == nominal_seed else None


def draw_sample(experiment: Experiment, seed: int) -> Experiment:
    """Return the experiment on another day; day 0 is the nominal one."""
    if seed == 0:
        return experiment
    scenario, plant, (walking, patient) = experiment.scenario, experiment.plant, walking_wearer(experiment)
    drawn = np.random.default_rng((experiment.seed, seed)).uniform(-1.0, 1.0, size=4)
    weight, rough, fast, form = (1.0 + np.array(SPREADS) * drawn).tolist()
    conditions = {
        key: replace(item, effort=min(1.0, form * item.effort)) for key, item in patient.conditions.items()
    }
    patient = replace(patient, mass=min(MASSES.maximum, weight * patient.mass), conditions=conditions)
    friction = {joint: rough * plant.friction_ratio.get(joint, 1.0) for joint in plant.friction}
    plant = replace(plant, friction_ratio=friction)
    if scenario.has_adjustments(BELT_SPEED):
        scenario = scenario.replace_adjustment(BELT_SPEED, fast * walking.speed)
    seed += experiment.seed
    return replace(experiment, seed=seed, patient=patient, plant=plant, scenario=scenario)
