"""Friction identified from simulated campaigns as in the thesis, compared with closed forms."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student
from thesis.bench import KNEE, SEED
from thesis.claims import number_text

from twin_gait import JointName
from twin_gait.configuration.bench_device import BENCH_ACTUATORS, BENCH_FRICTION
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.gait.table import TICK
from twin_gait.identification.fitting import FitOptions, Loss
from twin_gait.identification.identify import IdentificationOptions, identify_tests
from twin_gait.identification.models import FrictionTest
from twin_gait.identification.processing import RATE, WINDOW, BenchSetup, Processing, process_log
from twin_gait.identification.reading import Log, read_log
from twin_gait.identification.statistics import Goodness, goodness
from twin_gait.studies.campaign import SPREAD, TWO_WAY_PERIOD, Campaign, Protocol, planned_tests, run_campaign

HIP = JointName.HIP
JOINTS = (KNEE, HIP)
FALLS, DRIVEN = Protocol.DROP, Protocol.TWO_WAY
LATE, PROMPT = Processing.THESIS, Processing.ZERO_PHASE
# Parameters of equation (3.1) by the thesis's letters: name in an identification.
LETTERS = {
    "a": "breakaway_torque_Nm",
    "b": "coulomb_friction_Nm",
    "c": "breakaway_velocity_rad_per_s",
    "d": "viscous_friction_Nms_per_rad",
}
UNITS = dict(zip(LETTERS, ("N·m", "N·m", "rad/s", "N·m·s/rad"), strict=True))
LEVEL = 0.999  # of the intervals in bands: so few of the claims may fail by chance
DEVIATIONS = 3.0  # standard deviations that chance is given in other bands
AXIS_END = 0.6  # [rad/s], of figures 3.2 and 3.3
PERIOD = 1.0 / RATE  # [s] between the samples of which WINDOW are averaged
FACTOR = round(PERIOD / TICK)
# R² and adjusted R² of figures 3.2 and 3.3.
PRINTED = {KNEE: (0.3936, 0.3916), HIP: (-0.446, -0.4505)}
# How a campaign is treated, best first: protocol, processing, label, word in results.
TREATMENTS = (
    (DRIVEN, PROMPT, "motor-driven, without delay", "driven"),
    (FALLS, PROMPT, "falls, without delay", "falls"),
    (DRIVEN, LATE, "motor-driven, thesis's processing", "driven_late"),
    (FALLS, LATE, "falls, thesis's processing", "falls_late"),
)


def rms(values: np.ndarray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


# ---------------------------------------------------------------------- campaigns and fits


@dataclass(frozen=True, eq=False)
class LawFit:
    """Equation (3.1) fitted to a campaign by least squares, by the letters a, b, c and d in SI units.

    ``intervals`` are those of 95 % by a bootstrap over ``blocks`` tests; ``velocity`` in [rad/s],
    ``torque`` and ``residuals`` (measured less predicted) in [N·m] are the samples.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    blocks: int
    goodness: Goodness
    velocity: np.ndarray
    torque: np.ndarray
    residuals: np.ndarray

    def half_width(self, letter: str, level: float = LEVEL) -> float:
        """Return half the width of an interval: Student's quantile times the bootstrap standard error."""
        low, high = self.intervals[letter]
        quantiles = student.ppf([0.5 + 0.5 * level, 0.5 + 0.5 * 0.95], self.blocks - 1)
        return float(0.5 * (high - low) * quantiles[0] / quantiles[1])


@cache
def logs_of(joint: JointName, protocol: Protocol, seed: int) -> tuple[Log, ...]:
    """Return the logs of a campaign on the simulated bench, written to files and read back."""
    with tempfile.TemporaryDirectory() as folder:
        logs = Path(folder) / "campaign"
        run_campaign(Campaign(joint=joint, protocol=protocol, seed=seed), logs)
        return tuple(read_log(path) for path in sorted(logs.glob("*.log")))


@cache
def fit_campaign(
    joint: JointName,
    protocol: Protocol,
    processing: Processing,
    *,
    forward: bool = False,
    mass_as_printed: bool = False,
    seed: int = SEED,
) -> LawFit:
    """Fit equation (3.1) by ordinary least squares, as the thesis's toolbox does.

    With ``forward`` only samples that move along the fall are fitted, as figures 3.2 and 3.3 show;
    ``mass_as_printed`` takes J_mass as m b.
    """
    bench = BenchSetup(actuator=BENCH_ACTUATORS[joint], mass_as_printed=mass_as_printed)
    options = processing
    tests = [process_log(log, bench, options) for log in logs_of(joint, protocol, seed)]
    return _fit([_forward(test) for test in tests] if forward else tests, bench, seed)


def _forward(test: FrictionTest) -> FrictionTest:
    return replace(test, used=test.used & (test.velocity > 0.0))


def _fit(tests: list[FrictionTest], bench: BenchSetup, seed: int) -> LawFit:
    fit = FitOptions(loss=Loss.LINEAR, seed=seed)
    options = IdentificationOptions(bench=bench, fit=fit, models=("rotational",), cross_validation=False)
    result = identify_tests(tests, options)
    found, samples = result.models[0], result.samples.used_only()
    values, intervals = found.fit.model.parameters(found.fit.x), found.uncertainty.intervals
    return LawFit(
        values={letter: values[name] for letter, name in LETTERS.items()},
        intervals={letter: intervals[name] for letter, name in LETTERS.items()},
        blocks=found.uncertainty.blocks,
        goodness=found.goodness,
        velocity=samples.velocity,
        torque=samples.torque,
        residuals=found.residuals,
    )


def table_values(joint: JointName) -> dict[str, float]:
    """Return table 3.1 of the thesis with a, b and c positive."""
    law = BENCH_FRICTION[joint].normalised()
    values = law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity, law.viscous_friction
    return dict(zip(LETTERS, values, strict=True))


def law_torque(values: Mapping[str, float], velocity: np.ndarray) -> np.ndarray:
    """Compute equation (3.1) in [N·m] over speeds in [rad/s], also for impossible parameters."""
    parameters = [values[letter] for letter in LETTERS]
    return np.array([rotational_friction_torque(float(speed), *parameters) for speed in velocity])


def torque_at(values: Mapping[str, float], speed: float) -> float:
    """Compute the torque of equation (3.1) in [N·m] at one speed in [rad/s]."""
    return float(law_torque(values, np.array([speed]))[0])


# ---------------------------------------------------------------------- figures 3.2 and 3.3


def implied_samples(r_squared: float, adjusted: float) -> float:
    """Return the samples n that both statistics imply, (1 - R²_adj)/(1 - R²) = (n - 1)/(n - p), p = 4."""
    ratio = (1.0 - adjusted) / (1.0 - r_squared)
    return (ratio * len(LETTERS) - 1.0) / (ratio - 1.0)


def lagged_viscous(viscous: float, inertia: float, frequency: float) -> float:
    r"""Compute the viscous coefficient that the processing of the thesis finds for a sinusoidal motion.

    The averaged velocity is late by :math:`\tau_v`, its forward difference by :math:`\tau_a`; both are weaker
    by :math:`g`. The residual inertia torque is in phase with the velocity:

    .. math::

        d' = \frac{d \cos\Omega\tau_v - J\,\Omega \sin\Omega\tau_v}{g} + J\,\Omega \sin\Omega(\tau_v - \tau_a)

    Args:
        viscous: :math:`d` in [N·m·s/rad].
        inertia: :math:`J` in [kg·m²].
        frequency: :math:`\Omega` in [rad/s].

    Returns:
        :math:`d'` in [N·m·s/rad]. Coulomb friction near the reversals is left out.
    """
    late = 0.5 * TICK + 0.5 * (WINDOW - 1) * PERIOD
    gain = math.sin(0.5 * WINDOW * frequency * PERIOD) / (WINDOW * math.sin(0.5 * frequency * PERIOD))
    in_phase = viscous * math.cos(frequency * late) - inertia * frequency * math.sin(frequency * late)
    return in_phase / gain + inertia * frequency * math.sin(0.5 * frequency * PERIOD)


def fit_numbers(joint: JointName, late: LawFit, prompt: LawFit, driven: LawFit) -> dict[str, Any]:
    """Return fits of falls with the processing of the thesis and without delay, and of motor-driven tests."""
    campaign, bench = Campaign(joint=joint), BenchSetup(actuator=BENCH_ACTUATORS[joint])
    masses = {plan.mass for plan in planned_tests(campaign)}
    frequency, truth = 2.0 * math.pi / TWO_WAY_PERIOD, table_values(joint)
    lagged = [lagged_viscous(truth["d"], float(bench.inertia(mass)), frequency) for mass in masses]
    margin, samples, implied = driven.half_width("d"), late.goodness.samples, implied_samples(*PRINTED[joint])
    slow = late.velocity < truth["c"]
    unfitted = goodness(late.torque, late.torque - law_torque(truth, late.velocity), len(LETTERS))
    return {
        "r_squared": late.goodness.r_squared,
        "adjusted": late.goodness.adjusted_r_squared,
        "least_adjusted": -(len(LETTERS) - 1.0) / (samples - len(LETTERS)),
        "prompt_r_squared": prompt.goodness.r_squared,
        "dispersion": rms(late.residuals[slow]) / rms(late.residuals[~slow]),
        "driven_d": driven.values["d"],
        "driven_d_low": min(lagged) - margin,
        "driven_d_high": max(lagged) + margin,
        "lagged_d": [min(lagged), max(lagged)],
        "highest_speed": float(late.velocity.max()),
        "samples": samples,
        "implied_samples": implied,
        "implied_falls": implied * late.blocks / samples,
        "table_r_squared": unfitted.r_squared,
        "laws": [
            _law_row("friction of the bench", truth, None),
            _law_row("fit with the thesis's processing", late.values, late.goodness),
            _law_row("fit without delay", prompt.values, prompt.goodness),
        ],
    }


def _law_row(label: str, values: Mapping[str, float], of_fit: Goodness | None) -> dict[str, str]:
    """Return a row of a page's table: parameters, and goodness of fit (RMSE per degree of freedom)."""
    return {
        "law": label,
        **{f"{letter} [{UNITS[letter]}]": number_text(value) for letter, value in values.items()},
        "SSE [N² m²]": "" if of_fit is None else f"{of_fit.sse:.0f}",
        "RMSE [N·m]": "" if of_fit is None else f"{of_fit.residual_standard_error:.3g}",
    }


# ---------------------------------------------------------------------- figure 3.4


def chance_of_torque(joint: JointName, torque: float, speed: float) -> float:
    """Return three standard deviations [N·m] of the mean friction torque over the tests that reach a speed.

    It is known before any simulation from the random error of a test and the number of fast tests.
    """
    campaign, actuator = Campaign(joint=joint, protocol=DRIVEN), BENCH_ACTUATORS[joint]
    tests = sum(plan.settings["peak_speed_rad_per_s"] >= speed for plan in planned_tests(campaign))
    offset = SPREAD["current_offset"] * actuator.torque_constant * actuator.gear_ratio
    return DEVIATIONS * math.hypot(SPREAD["friction"] * torque, offset) / math.sqrt(tests)


def dip_velocity(values: Mapping[str, float]) -> float:
    """Return the speed [rad/s] of least friction beyond the first rise; the exponential peaks at c/√2."""
    ends = 0.3 * values["c"], 1.5 * values["c"]
    options = {"xatol": 1e-6}
    found = minimize_scalar(
        lambda speed: torque_at(values, speed), bounds=ends, method="bounded", options=options
    )
    return float(found.x)


def comparison_numbers(fits: Mapping[JointName, LawFit]) -> dict[str, float]:
    """Return the friction at the end of the axis of the thesis and the speed of the dip for both joints."""
    numbers = {}
    for joint, fit in fits.items():
        truth = table_values(joint)
        torque, dip = torque_at(truth, AXIS_END), dip_velocity(truth)
        margin, relative = chance_of_torque(joint, torque, AXIS_END), fit.half_width("c") / fit.values["c"]
        numbers |= {
            f"{joint}_torque": torque_at(fit.values, AXIS_END),
            f"{joint}_torque_table": torque,
            f"{joint}_torque_low": torque - margin,
            f"{joint}_torque_high": torque + margin,
            f"{joint}_dip": dip_velocity(fit.values),
            f"{joint}_dip_table": dip,
            f"{joint}_dip_low": dip * (1.0 - relative),
            f"{joint}_dip_high": dip * (1.0 + relative),
        }
    truths = [table_values(joint)["d"] for joint in (HIP, KNEE)]
    numbers["viscous_ratio_table"] = truths[0] / truths[1]
    numbers["viscous_ratio"] = fits[HIP].values["d"] / fits[KNEE].values["d"]
    return numbers


# ---------------------------------------------------------------------- table 3.1


def table_numbers(fits: Mapping[tuple[JointName, int], LawFit], as_printed: LawFit) -> dict[str, Any]:
    """Return the parameters with bands around the truth, and the effect of J_mass = m b on the knee.

    Args:
        fits: By joint and place in ``TREATMENTS``.
        as_printed: The knee's motor-driven tests without delay, with J_mass as printed.
    """
    numbers: dict[str, Any] = {}
    for joint in JOINTS:
        for letter, truth in table_values(joint).items():
            fit = fits[joint, 0]
            margin = fit.half_width(letter)
            numbers |= {
                f"{joint}_{letter}": fit.values[letter],
                f"{joint}_{letter}_low": truth - margin,
                f"{joint}_{letter}_high": truth + margin,
            }
    for index, (*_, word) in enumerate(TREATMENTS):
        numbers[f"covered_{word}"] = sum(
            low <= table_values(joint)[letter] <= high
            for joint in JOINTS
            for letter, (low, high) in fits[joint, index].intervals.items()
        )
    return {
        **numbers,
        "rmse": fits[KNEE, 0].goodness.rmse,
        "rmse_as_printed": as_printed.goodness.rmse,
        "d": fits[KNEE, 0].values["d"],
        "d_as_printed": as_printed.values["d"],
    }
