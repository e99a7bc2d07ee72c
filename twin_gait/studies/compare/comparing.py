"""Run every controller on every day of a wearer, and put the measures side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import pandas as pd
from scipy.stats import t as student

from twin_gait.control import AssistanceParameters
from twin_gait.experiment import ControlMode, Experiment
from twin_gait.parameters import HEAVIEST_WEARER, require
from twin_gait.simulation import Run
from twin_gait.studies.batch import run_episodes, walking_wearer
from twin_gait.studies.compare.measures import Measures, run_measures
from twin_gait.studies.jobs import Watch
from twin_gait.worlds.world import BELT_SPEED
from twin_gait.yaml12 import load_yaml

# By how much a day differs from the nominal one, either way, evenly distributed (assumptions): clothes and
# luggage, warm or cold gears, a belt that is not quite what its display says, a good or a bad day.
SPREADS = (0.03, 0.2, 0.03, 0.1)  # of mass, friction, speed and effort
CONFIDENCE = 0.95
# TwinCare gives each joint a share of the table's impedance; four fifths is an assumption. An experiment that
# sets shares of its own keeps them.
TWINCARE_SHARE = 0.8


@dataclass(frozen=True)
class Controller:
    """One way to drive the legs."""

    name: str  # on the command line and in tables
    title: str  # in a report
    explanation: str  # what it does, in plain words
    law: str  # mode of control between angle and torque
    colour: str  # of its curves
    adaptive: bool = False  # whether the assistance adapts from stride to stride
    partial: bool = False  # whether a fixed share of the table acts

    def suits(self, experiment: Experiment) -> bool:
        """Whether it can drive the joints of an experiment."""
        control = replace(experiment.control, mode=ControlMode(self.law))
        return not control.controller().refusal(experiment.joints)

    def change(self, experiment: Experiment) -> Experiment:
        """The same experiment with this controller."""
        assistance = AssistanceParameters()
        if self.adaptive or self.partial:
            assistance = replace(experiment.control.assistance, adaptive=self.adaptive)
        if self.partial and assistance.is_full:
            shares = dict.fromkeys(experiment.joints, TWINCARE_SHARE)
            assistance = replace(assistance, share=shares)
        control = replace(experiment.control, mode=ControlMode(self.law), assistance=assistance)
        return replace(experiment, control=control, controller=None)


_ROWS = load_yaml(Path(__file__).with_name("controllers.yaml").read_text(encoding="utf-8"))
CONTROLLERS = {name: Controller(name=name, **row) for name, row in _ROWS.items()}


def find_controllers(names: Sequence[str]) -> tuple[Controller, ...]:
    """Look controllers up, such as ``table`` and ``position``; none, or one twice, is a ParameterError."""
    once = len(set(names)) == len(names) > 0
    expected = f"some of {', '.join(CONTROLLERS)}, each once"
    require(once and CONTROLLERS.keys() >= set(names), "controllers", expected, ", ".join(names) or "none")
    return tuple(CONTROLLERS[name] for name in names)


class Interval(NamedTuple):
    """A mean over all days, the nominal one among them."""

    mean: float  # NaN where no run has the number
    half_width: float  # of its 95 % confidence interval; NaN for fewer than two runs


@dataclass(frozen=True, eq=False)
class Comparison:
    """Controllers beside each other."""

    experiment: Experiment  # what they have in common
    controllers: tuple[Controller, ...]  # in order
    seeds: int  # days that each was run on; the first is the nominal one
    table: pd.DataFrame  # one row per run: ``controller``, ``seed`` and the numbers of run_measures
    runs: dict[str, Run]  # of the nominal day, by the name of the controller

    def interval(self, controller: str, number: str) -> Interval:
        """Mean of a measure over the runs of a controller that have it."""
        runs = self.table[self.table["controller"] == controller]
        return interval_of(runs.get(number, pd.Series(dtype=float)))

    def walked(self, controller: str) -> int:
        """Runs of a controller without a fall or a trip."""
        return int(self.table.loc[self.table["controller"] == controller, "walked"].sum())

    def numbers(self, controller: str) -> Measures:
        """``NAME`` and ``NAME_half_width`` of every measure."""
        names = self.table.columns.drop(["controller", "seed", "status", "trip"])
        means = {str(name): self.interval(controller, name) for name in names}
        widths = {f"{name}_half_width": found.half_width for name, found in means.items()}
        return {name: found.mean for name, found in means.items()} | widths


def interval_of(values: pd.Series) -> Interval:
    """Mean with the confidence interval of Student's t distribution; NaN does not count."""
    deviation: Any = values.sem()
    quantile = student.ppf(0.5 + 0.5 * CONFIDENCE, values.count() - 1)
    return Interval(float(values.mean()), float(quantile * deviation))


def compare(
    experiment: Experiment, controllers: Sequence[Controller], *, seeds: int = 1, **watch: Unpack[Watch]
) -> Comparison | None:
    """Run every controller on every day; all controllers meet the same days.

    Returns the comparison, or None if it was stopped; what cannot be compared is a ParameterError.
    """
    walking_wearer(experiment)
    require(seeds >= 1, "seeds", "1 or more", seeds)
    asked = [(controller, seed) for controller in controllers for seed in range(seeds)]
    day_of, measure = partial(_on_day, experiment), partial(_measured, experiment.seed)
    found = run_episodes(day_of, measure, asked, named=lambda place: asked[place][0].name, **watch)
    if len(found) < len(asked):
        return None
    named = [{"controller": controller.name, "seed": seed} for controller, seed in asked]
    table = pd.DataFrame([name | row for name, (row, _) in zip(named, found, strict=True)])
    nominal = {item.name: run for (item, _), (_, run) in zip(asked, found, strict=True) if run is not None}
    return Comparison(experiment, tuple(controllers), seeds, table, nominal)


def _on_day(experiment: Experiment, asked: tuple[Controller, int]) -> Experiment:
    controller, seed = asked
    return controller.change(varied(experiment, seed))


def _measured(nominal_seed: int, run: Run) -> tuple[dict[str, object], Run | None]:
    """A row of the table, and the run itself if it is of the nominal day."""
    trip = "" if run.trip is None else f"{run.trip.text} at {run.trip.time:.2f} s"
    row = {"status": str(run.status), "trip": trip, **run_measures(run)}
    return row, run if run.experiment.seed == nominal_seed else None


def varied(experiment: Experiment, seed: int) -> Experiment:
    """The experiment on another day."""
    if seed == 0:
        return experiment
    scenario, plant, (walking, patient) = experiment.scenario, experiment.plant, walking_wearer(experiment)
    drawn = np.random.default_rng((experiment.seed, seed)).uniform(-1.0, 1.0, size=4)
    weight, rough, fast, form = (1.0 + np.array(SPREADS) * drawn).tolist()
    conditions = {
        place: replace(item, effort=min(1.0, form * item.effort))
        for place, item in patient.conditions.items()
    }
    patient = replace(patient, mass=min(HEAVIEST_WEARER, weight * patient.mass), conditions=conditions)
    friction = {joint: rough * plant.friction_ratio.get(joint, 1.0) for joint in plant.friction}
    plant = replace(plant, friction_ratio=friction)
    if scenario.adjusts(BELT_SPEED):
        scenario = scenario.adjusted(BELT_SPEED, fast * walking.speed)
    seed += experiment.seed
    return replace(experiment, seed=seed, patient=patient, plant=plant, scenario=scenario)
