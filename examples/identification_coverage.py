"""Coverage: do the 95 % intervals of an identification contain the truth in 95 of 100 campaigns?

Campaigns on the simulated bench, each with a different seed: 45 motor-driven tests in both directions,
identified from their logs alone with the rotational law, and compared with the true law of the bench. The
logs are smoothed once without delay and once as in the thesis. 200 campaigns of each joint take about half
an hour on one core; page: docs/reference/identification.md.
"""

# %% [markdown]
# ## One campaign
# The input of the identification is the record of a bench: angle, velocity, currents, and the weight on the
# link. Apart from that it has only the rotational law (equation 3.1 of the thesis) that it fits.

# %%
from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from gallery import read_options

from twin_gait import JointName
from twin_gait.configuration.bench_device import BENCH_ACTUATORS, BENCH_FRICTION
from twin_gait.identification.identify import IdentificationOptions, identify_tests
from twin_gait.identification.processing import BenchSetup, Processing, process_log
from twin_gait.identification.reading import Log, Quantity
from twin_gait.simulation.bench_joint.loop import simulate_bench
from twin_gait.studies.campaign import Campaign, Protocol, planned_tests
from twin_gait.studies.jobs import run_jobs

LAW = "rotational"
PROCESSINGS = (Processing.ZERO_PHASE, Processing.THESIS)
CAMPAIGNS, QUICK_CAMPAIGNS = 200, 2
CYCLES, QUICK_CYCLES = 2, 1  # cycles of a test; two take half the time of the four in the protocol
LOGGED = {
    Quantity.TIME: "time_s",
    Quantity.ANGLE: "position_rad",
    Quantity.VELOCITY: "velocity_rad_per_s",
    Quantity.MEASURED_CURRENT: "measured_current_A",
    Quantity.TARGET_CURRENT: "target_current_A",
}


class Estimate(NamedTuple):
    """Result of one campaign, with parameters in the order of :func:`true_parameters`."""

    values: np.ndarray
    intervals: np.ndarray  # shape (n, 2)
    warnings: tuple[str, ...]


def true_parameters(joint: JointName) -> dict[str, float]:
    """Return the law of the simulated bench with positive a, b and c, by the names in an identification."""
    law = BENCH_FRICTION[joint].normalised()
    return {
        "breakaway_torque_Nm": law.breakaway_torque,
        "coulomb_friction_Nm": law.coulomb_friction,
        "viscous_friction_Nms_per_rad": law.viscous_friction,
        "breakaway_velocity_rad_per_s": law.breakaway_velocity,
    }


def logs_of(campaign: Campaign) -> list[Log]:
    """Return the logs of a campaign without files."""
    logs = []
    for plan in planned_tests(campaign):
        run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
        columns = {quantity: run.column(name) for quantity, name in LOGGED.items()}
        logs.append(Log(plan.name, columns, plan.mass))
    return logs


def estimates(cycles: int, campaign: tuple[JointName, int]) -> dict[Processing, Estimate]:
    """Simulate the campaign of a joint and a seed, and identify it once for each processing."""
    joint, seed = campaign
    logs = logs_of(Campaign(joint=joint, protocol=Protocol.TWO_WAY, seed=seed, cycles=cycles))
    return {processing: identified(logs, joint, processing) for processing in PROCESSINGS}


def identified(logs: Sequence[Log], joint: JointName, processing: Processing) -> Estimate:
    """Identify logs, and return the parameters, their intervals and the warnings."""
    bench = BenchSetup(actuator=BENCH_ACTUATORS[joint])
    options = IdentificationOptions(bench=bench, processing=processing, models=(LAW,), cross_validation=False)
    result = identify_tests([process_log(log, bench, processing) for log in logs], options)
    (model,) = result.models
    values, names = model.fit.model.parameters(model.fit.x), true_parameters(joint)
    return Estimate(
        np.array([values[name] for name in names]),
        np.array([model.uncertainty.intervals[name] for name in names]),
        (*result.warnings, *model.warnings),
    )


# %% [markdown]
# ## All campaigns
# The *spread* of a parameter is the standard deviation of its estimates, *half-width* the mean over its
# intervals, and it is *covered* if the interval contains the truth. The standard error of a share of 95 %
# over 200 campaigns is 1.5 %.


# %%
def coverage(joint: JointName, found: Sequence[Estimate]) -> pd.DataFrame:
    """Return estimates and truth of a joint, one row per parameter, in the unit of the parameter."""
    truth = np.array(list(true_parameters(joint).values()))
    values = np.array([item.values for item in found])
    low, high = np.moveaxis(np.array([item.intervals for item in found]), 2, 0)
    return pd.DataFrame(
        {
            "parameter": list(true_parameters(joint)),
            "truth": truth,
            "mean": values.mean(axis=0),
            "bias": values.mean(axis=0) / truth - 1.0,
            "spread": values.std(axis=0, ddof=1),
            "half_width": 0.5 * (high - low).mean(axis=0),
            "covered": ((low <= truth) & (truth <= high)).mean(axis=0),
        }
    )


def usual_warnings(found: Sequence[Estimate]) -> dict[str, float]:
    """Return the share of campaigns with a warning, by its words before the first colon or number."""
    heads = [{re.split(r"[:(]|\d", text, maxsplit=1)[0].strip() for text in item.warnings} for item in found]
    counted = Counter(head for item in heads for head in item)
    return {head: count / len(found) for head, count in counted.most_common()}


def row_of(joint: JointName, item: Any) -> dict[str, str]:
    """Format a row for the page."""
    letter = dict(zip(true_parameters(joint), "abdc", strict=True))[item.parameter]
    return {
        "joint": str(joint),
        "parameter": letter,
        "truth": f"{item.truth:g}",
        "mean": f"{item.mean:.4f}",
        "bias": f"{item.bias:+.1%}",
        "spread": f"{item.spread:.4f}",
        "half-width": f"{item.half_width:.4f}",
        "covered": f"{item.covered:.1%}",
    }


# %%
if __name__ == "__main__":
    form = read_options("identification_coverage")
    count, cycles = (QUICK_CAMPAIGNS, QUICK_CYCLES) if form.quick else (CAMPAIGNS, CYCLES)
    joints = (JointName.KNEE,) if form.quick else (JointName.KNEE, JointName.HIP)
    jobs = [(joint, seed) for joint in joints for seed in range(count)]
    found = run_jobs(partial(estimates, cycles), jobs, workers=form.workers)
    tables, warned, rows = [], {}, {}
    for processing in PROCESSINGS:
        rows[str(processing)] = []
        for joint in joints:
            mine = [item[processing] for place, item in zip(jobs, found, strict=True) if place[0] is joint]
            table = coverage(joint, mine)
            tables.append(table.assign(joint=str(joint), processing=str(processing)))
            rows[str(processing)] += [row_of(joint, item) for item in table.itertuples()]
            warned[f"{joint}_{processing}"] = usual_warnings(mine)
            print(f"{joint}, {count} campaigns, {processing}\n{table.round(4).to_string(index=False)}\n")
    pd.concat(tables).to_csv(form.out / "coverage.csv", index=False)
    standard_error = math.sqrt(0.95 * 0.05 / count)
    form.write_results({"campaigns": count, "standard_error": standard_error, **rows, "warnings": warned})

# %% [markdown]
# Homework: the thesis only had falls in one direction (`Protocol.DROP`). Which parameters are still
# reliable?
