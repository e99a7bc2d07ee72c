"""Do the intervals of an identification hold the truth as often as they say?

Campaigns on the simulated bench, each with its own seed, are identified from their logs alone and compared
with the friction law that the bench had. The same campaigns show how far the thesis's post-processing and its
one-way falls are off.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from twin_gait.identification import (
    MODELS,
    FitOptions,
    Log,
    Loss,
    Processing,
    ProcessingOptions,
    Quantity,
    RigParameters,
    fit_model,
    join_tests,
    process_log,
)
from twin_gait.identification.bootstrap import uncertainty
from twin_gait.identification.doubts import doubts_of_fit, doubts_of_processing, doubts_of_samples
from twin_gait.parameters import require
from twin_gait.scenario.bench_joint import BENCH_ACTUATORS, BENCH_FRICTION
from twin_gait.simulation.bench_joint import simulate_bench
from twin_gait.studies.campaign import Campaign, Protocol, TwoWayProtocol, planned_tests
from twin_gait.studies.jobs import run_jobs
from twin_gait.vocabulary import JointName

LAW = "rotational"
# Columns that an identification may see, in the thesis's order.
_LOGGED = {
    Quantity.TIME: "time_s",
    Quantity.ANGLE: "position_rad",
    Quantity.VELOCITY: "velocity_rad_per_s",
    Quantity.MEASURED_CURRENT: "measured_current_A",
    Quantity.TARGET_CURRENT: "target_current_A",
}


@dataclass(frozen=True, kw_only=True)
class CoverageStudy:
    """What is repeated.

    Attributes:
        joint: Knee or hip.
        protocol: How the joint is moved.
        campaigns: How many, with seeds from 0.
        processings: How the logs are smoothed; each sees the same logs.
        two_way: Motor-driven tests; two periods each take half the time of the protocol's four.
    """

    joint: JointName
    protocol: Protocol = Protocol.TWO_WAY
    campaigns: int = 200
    processings: tuple[Processing, ...] = (Processing.ZERO_PHASE,)
    two_way: TwoWayProtocol = field(default_factory=lambda: TwoWayProtocol(cycles=2))

    def __post_init__(self) -> None:
        """Check the ranges."""
        require(self.campaigns >= 2, "campaigns", "2 or more", self.campaigns)
        require(len(self.processings) > 0, "processings", "at least one", self.processings)


class Estimate(NamedTuple):
    """What one campaign came to.

    Attributes:
        values: Parameters, as ``true_parameters`` orders them.
        intervals: Ends of the 95 % intervals, shape ``(n, 2)``.
        warnings: What the identification says to its reader.
    """

    values: np.ndarray
    intervals: np.ndarray
    warnings: tuple[str, ...]


class ParameterCoverage(NamedTuple):
    """A parameter over all campaigns, in its own unit.

    Attributes:
        truth: Of the simulated bench.
        mean: Of the estimates.
        spread: Standard deviation of the estimates.
        half_width: Mean half-width of the intervals.
        covered: Share of the intervals that hold the truth.
    """

    truth: float
    mean: float
    spread: float
    half_width: float
    covered: float

    @property
    def bias(self) -> float:
        """Of the mean, relative to the truth."""
        return self.mean / self.truth - 1.0


def true_parameters(joint: JointName) -> dict[str, float]:
    """The law of the simulated bench in sign-normal form, by the names that an identification reports.

    Args:
        joint: Knee or hip.

    Returns:
        The parameters.
    """
    law = BENCH_FRICTION[joint]
    sign = math.copysign(1.0, law.breakaway_velocity)  # table 3.1 has the knee with three signs turned
    return {
        "breakaway_torque_Nm": sign * law.breakaway_torque,
        "coulomb_friction_Nm": sign * law.coulomb_friction,
        "viscous_friction_Nms_per_rad": law.viscous_friction,
        "breakaway_velocity_rad_per_s": sign * law.breakaway_velocity,
    }


def measure_coverage(
    study: CoverageStudy,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> dict[Processing, list[Estimate]]:
    """Simulate and identify the campaigns.

    Args:
        study: What is repeated.
        workers: Processes.
        progress: Called with the campaigns done and their number.
        should_stop: Asked between campaigns; True ends the study with those that are done.

    Returns:
        One estimate a campaign, by processing.
    """
    campaigns = run_jobs(
        partial(estimate_campaign, study),
        range(study.campaigns),
        workers=workers,
        progress=progress,
        should_stop=should_stop,
    )
    return {processing: [item[processing] for item in campaigns] for processing in study.processings}


def estimate_campaign(study: CoverageStudy, seed: int) -> dict[Processing, Estimate]:
    """Simulate one campaign and identify it.

    Args:
        study: What is repeated.
        seed: Of the campaign.

    Returns:
        An estimate by processing.
    """
    logs = campaign_logs(
        Campaign(joint=study.joint, protocol=study.protocol, seed=seed, two_way=study.two_way)
    )
    return {processing: _identified(logs, study.joint, processing) for processing in study.processings}


def campaign_logs(campaign: Campaign) -> list[Log]:
    """The logs of a campaign, without a detour over files.

    Args:
        campaign: The campaign.

    Returns:
        What a bench would have recorded, test by test.
    """
    logs = []
    for plan in planned_tests(campaign):
        run = simulate_bench(plan.test, seed=plan.noise_seed, variation=plan.variation)
        columns = {quantity: run.column(name) for quantity, name in _LOGGED.items()}
        logs.append(Log(plan.name, columns, plan.mass))
    return logs


def _identified(logs: Sequence[Log], joint: JointName, processing: Processing) -> Estimate:
    rig, options = RigParameters(actuator=BENCH_ACTUATORS[joint]), ProcessingOptions(processing=processing)
    samples = join_tests([process_log(log, rig, options) for log in logs])
    fit = fit_model(MODELS[LAW], samples, FitOptions(loss=Loss.HUBER))
    known = uncertainty(fit, samples, 0)
    values, names = fit.model.parameters(fit.x), true_parameters(joint)
    return Estimate(
        np.array([values[name] for name in names]),
        np.array([known.intervals[name] for name in names]),
        (
            *doubts_of_processing(options),
            *doubts_of_samples(samples),
            *doubts_of_fit(fit, known, samples),
        ),
    )


def parameter_coverage(joint: JointName, estimates: Sequence[Estimate]) -> dict[str, ParameterCoverage]:
    """Compare estimates with the truth.

    Args:
        joint: Knee or hip.
        estimates: One a campaign.

    Returns:
        By parameter.
    """
    values = np.array([item.values for item in estimates])
    low, high = np.moveaxis(np.array([item.intervals for item in estimates]), 2, 0)
    found = {}
    for place, (name, truth) in enumerate(true_parameters(joint).items()):
        found[name] = ParameterCoverage(
            truth=truth,
            mean=float(values[:, place].mean()),
            spread=float(values[:, place].std(ddof=1)),
            half_width=float((0.5 * (high - low))[:, place].mean()),
            covered=float(((low <= truth) & (truth <= high))[:, place].mean()),
        )
    return found


def coverage_table(found: Mapping[str, ParameterCoverage]) -> str:
    """The comparison as text.

    Args:
        found: By parameter.

    Returns:
        One line each, under a heading.
    """
    lines = [f"{'':<30} {'truth':>8} {'mean':>8} {'bias':>8} {'spread':>8} {'half':>8} {'covered':>8}"]
    for name, item in found.items():
        lines.append(
            f"{name:<30} {item.truth:8.4f} {item.mean:8.4f} {100.0 * item.bias:+7.1f}% {item.spread:8.4f} "
            f"{item.half_width:8.4f} {100.0 * item.covered:7.1f}%"
        )
    return "\n".join(lines)


def usual_warnings(estimates: Sequence[Estimate]) -> dict[str, float]:
    """Warnings and how often they are given.

    Args:
        estimates: One a campaign.

    Returns:
        Share of the campaigns by the words before the first colon or number, most frequent first.
    """
    counted = Counter(head for item in estimates for head in {_head(text) for text in item.warnings})
    return {head: count / len(estimates) for head, count in counted.most_common()}


def _head(warning: str) -> str:
    """A warning without what differs from campaign to campaign."""
    return re.split(r"[:(]|\d", warning, maxsplit=1)[0].strip()
