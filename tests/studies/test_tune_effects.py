"""What tuning and errors do to the walk: signs and sizes of means over seeds, with intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from table_builder import FIVE_PHASES

from twin_gait.configuration.experiments import load_experiment
from twin_gait.experiment.experiment import Experiment
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.simulator import simulate
from twin_gait.studies.batch import override_experiment
from twin_gait.studies.tune.objective import term_values
from twin_gait.studies.tune.walks import build_cases
from twin_gait.vocabulary import Side

SEEDS = range(4)
WALK = 14.0  # [s]
NOISE = {"sensors.ideal": False, "sensors.angle_noise_rad": 2e-5}
# Mass is off by a tenth; a loss not much larger than that is called graceful.
LARGEST_LOSS = 0.15
PER_SIDE = Path(__file__).parents[1] / "tables" / "stroke_left_per_side.yaml"
# Where that table was tuned: a vertical guide, bouncing contacts, stiff orthoses, gears without losses.
TUNED_IN = (
    "patient=stroke_left",
    "scenario.support.guide=vertical",
    "scenario.contact.dissipation_s_per_m=0.5",
    "plant.ankle={stiffness_Nm_per_rad: 200, rest_deg: 0}",
    "plant.actuators={hip: {gear_efficiency: 1}, knee: {gear_efficiency: 1}}",
)


def walked(experiment: Experiment) -> list[dict[str, float | None]]:
    """Parts of noisy walks, one a seed; a fall fails the test."""
    noisy = override_experiment(experiment, NOISE)
    runs = [simulate(replace(noisy, seed=seed, duration=WALK)) for seed in SEEDS]
    assert all(run.status is RunStatus.COMPLETED for run in runs)
    return [term_values(run) for run in runs]


def interval(values: Iterable[float | None]) -> tuple[float, float]:
    """95 % interval of the mean."""
    found = np.array(list(values), dtype=float)
    reach = stats.t.ppf(0.975, len(found) - 1) * found.std(ddof=1) / math.sqrt(len(found))
    return float(found.mean() - reach), float(found.mean() + reach)


@pytest.mark.slow
def test_legs_tuned_separately_are_less_asymmetric_after_a_stroke() -> None:
    """Against the table that it began with, and against itself with the numbers of one leg for both."""
    shares = {}
    for name in (FIVE_PHASES, str(PER_SIDE)):
        experiment = load_experiment("treadmill_guided", [*TUNED_IN, f"table={name}"]).experiment
        shares[name] = asymmetry(experiment)
    tuned = experiment.table
    for side in Side:
        alike = replace(tuned, phases=tuned.phases_of(side), side_phases={})
        shares[f"both as the {side}"] = asymmetry(replace(experiment, table=alike))
    apart = shares.pop(str(PER_SIDE))
    assert all(apart[1] < low for low, _ in shares.values()), (apart, shares)


def asymmetry(experiment: Experiment) -> tuple[float, float]:
    """95 % interval of the mean difference of the legs."""
    return interval(parts["asymmetry_pct"] for parts in walked(experiment))


@pytest.mark.parametrize("joint", ["hip", "knee"])
def test_errors_of_weight_and_friction_degrade_the_walk_gracefully(joint: str) -> None:
    """Mass ±10 % unknown to the device; joints with more or less friction; gears with higher losses."""
    experiment = load_experiment("treadmill_guided").experiment
    cases = build_cases(experiment, "robust")
    key = f"{joint}_error_deg"
    _, nominal = interval(parts[key] for parts in walked(cases["nominal"]))
    for name in (
        "mass −10 %",
        "mass +10 %",
        "friction ratio 0.35",
        "friction ratio 1",
        "gear efficiency 0.75",
    ):
        _, worst = interval(parts[key] for parts in walked(cases[name]))
        assert worst < (1.0 + LARGEST_LOSS) * nominal, name
