"""What a reader of an identification must be warned about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin_gait.identification.bench import BenchSetup, Processing, ProcessingOptions
from twin_gait.identification.bootstrap import Uncertainty
from twin_gait.identification.fitting import Fit
from twin_gait.identification.models import rarer_direction
from twin_gait.identification.processing import RATE
from twin_gait.identification.samples import FrictionTest, Samples

WIDE = 0.25  # half-width of an interval over the parameter
CORRELATED = 0.98
_ONE_WAY = 0.05  # share of the samples in the rarer direction
_FAST, _SLOW = 1.0, 0.1  # [rad] / [s]: a gait needs the knee up to 3.6; table 3.1 changes below 0.2
_FEW = 0.02  # share of the samples that counts as none
_DRIFT = 0.5  # of the residual's standard deviation, from the first third of the time to the last


def sample_warnings(samples: Samples) -> list[str]:
    """What the samples cannot tell, whatever the model."""
    velocity = samples.velocity[samples.used]
    speed, found = np.abs(velocity), []
    rarer = rarer_direction(samples)
    if rarer < _ONE_WAY:
        found.append(
            f"one direction only: {100.0 * rarer:.1f} % of the samples move the other way; an offset of "
            "current or load cannot be told from Coulomb friction"
        )
    if (speed < _SLOW).mean() < _FEW:
        found.append(
            f"no slow samples: {100.0 * (speed < _SLOW).mean():.1f} % below {_SLOW:g} rad/s; break-away and "
            "Stribeck friction are extrapolated"
        )
    if (speed > _FAST).mean() < _FEW:
        found.append(
            f"no fast samples: {100.0 * (speed > _FAST).mean():.1f} % above {_FAST:g} rad/s, the fastest is "
            f"{speed.max():.3g} rad/s; viscous friction beyond is extrapolated"
        )
    return found


def processing_warnings(options: ProcessingOptions) -> list[str]:
    """What the processing does to the result."""
    if options.processing is not Processing.THESIS:
        return []
    late = 0.5 * (options.window - 1) / RATE
    return [
        f"the thesis's processing makes the velocity {1e3 * late:.0f} ms late against current and load: the "
        "parameters are biased (--processing zero_phase)"
    ]


def fit_warnings(fit: Fit, uncertainty: Uncertainty, samples: Samples) -> list[str]:
    """What is doubtful about a fit."""
    return [
        *_wide_intervals(fit, uncertainty),
        *_correlated(fit, uncertainty),
        *_bounded(fit),
        *_power(fit, samples),
    ]


def _wide_intervals(fit: Fit, uncertainty: Uncertainty) -> list[str]:
    found = []
    for name, value in fit.model.parameters(fit.x).items():
        low, high = uncertainty.intervals[name]
        half = 0.5 * (high - low)
        if not np.isfinite(half):
            found.append(f"{name} is not determined by these samples")
        elif half > WIDE * abs(value):
            share = f"{100.0 * half / abs(value):.0f} %" if value else "wider than the value"
            found.append(f"{name} is uncertain: half-width of the interval {share} of the value")
    return found


def _correlated(fit: Fit, uncertainty: Uncertainty) -> list[str]:
    names, matrix = fit.model.names, uncertainty.correlations
    return [
        f"{names[i]} and {names[j]} are correlated ({matrix[i, j]:+.3f}): only a combination is known"
        for i in range(len(names))
        for j in range(i)
        if abs(matrix[i, j]) > CORRELATED
    ]


def _bounded(fit: Fit) -> list[str]:
    count = len(fit.model.coefficients)
    found = []
    for place in fit.at_bound:
        what = "a coefficient" if place < count else "a velocity, exponent or ratio"
        found.append(
            f"{what} lies on its bound ({_parameter_at(fit, place)}); its interval is not an estimate"
        )
    return found


def _parameter_at(fit: Fit, place: int) -> str:
    """The reported parameter that a position of the vector moves most, relative to its value."""
    values = np.array(list(fit.model.parameters(fit.x).values()))
    moved = fit.x.copy()
    moved[place] += 1e-3
    change = np.abs(np.array(list(fit.model.parameters(moved).values())) - values) / (np.abs(values) + 1e-9)
    return fit.model.names[int(np.argmax(change))]


def _power(fit: Fit, samples: Samples) -> list[str]:
    """Friction must take power from the joint."""
    if fit.model.needs:
        return []
    predicted = (fit.model.predict(fit.x, samples) * samples.velocity)[samples.used]
    share = float((predicted < -1e-9).mean())
    if share < 0.001:
        return []
    return [f"the law drives the joint in {100.0 * share:.1f} % of the samples; --physical forbids that"]


def drift_warnings(tests: Sequence[FrictionTest], residuals: np.ndarray, samples: Samples) -> list[str]:
    """Drift of the residuals along the tests, such as warming up.

    Args:
        residuals: Of the samples that are used, in [N m].
    """
    if samples.time is None or len(residuals) < 30:
        return []
    time, way = samples.time[samples.used], np.sign(samples.velocity[samples.used])
    along = residuals * way  # friction that falls shows with one sign in both directions
    early, late = np.quantile(time, [1.0 / 3.0, 2.0 / 3.0])
    drift = float(along[time >= late].mean() - along[time <= early].mean())
    if abs(drift) < _DRIFT * float(residuals.std()):
        return []
    return [f"friction drifts by {drift:+.2g} N m from the first to the last third of the tests: warming up?"]


def thinning_warnings(number: int, kept: int) -> list[str]:
    """Say that not every sample was used."""
    if kept == number:
        return []
    return [f"of {number} samples every {-(-number // kept)}th was used, {kept} in all"]


def file_warnings(tests: Sequence[FrictionTest]) -> list[str]:
    """What a reader should know about the files, each once."""
    where: dict[str, list[str]] = {}
    for test in tests:
        for note in test.notes:
            where.setdefault(note, []).append(test.name)
    return [
        f"{names[0]}: {note}" if len(names) == 1 else f"{len(names)} files: {note}"
        for note, names in where.items()
    ]


def weight_warnings(tests: Sequence[FrictionTest], bench: BenchSetup | None) -> list[str]:
    """Say that files name another weight than the bench does: theirs counts."""
    if bench is None or bench.mass is None:
        return []
    others = [f"{test.name} ({test.mass:g} kg)" for test in tests if test.mass not in (None, bench.mass)]
    more = f" and {len(others) - 1} more" if len(others) > 1 else ""
    return [f"--mass {bench.mass:g} is overruled by what {others[0]}{more} says"] if others else []


def untimed_warnings(samples: Samples, skipped: Mapping[str, tuple[str, ...]]) -> list[str]:
    """Say that a missing time costs the models with a state."""
    missed = [name for name, columns in skipped.items() if "period" in columns]
    if samples.period is not None or not missed:
        return []
    return [f"without a time {', '.join(missed)} cannot be fitted; name the column with --columns time=NAME"]
