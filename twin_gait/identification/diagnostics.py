"""What a reader of an identification must be warned about."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterError
from twin_gait.identification.bench import BenchSetup, Processing, ProcessingOptions
from twin_gait.identification.fitting import Fit
from twin_gait.identification.processing import RATE, WINDOW
from twin_gait.identification.samples import FrictionTest, Samples
from twin_gait.identification.statistics import Uncertainty

WIDE = 0.25  # half-width of an interval over the parameter
CORRELATED = 0.98
_ONE_WAY = 0.05  # share of the samples in the rarer direction
_FAST, _SLOW = 1.0, 0.1  # [rad] / [s]: a gait needs the knee up to 3.6; table 3.1 changes below 0.2
_FEW = 0.02  # share of the samples that counts as none
_SPEEDS = 100  # classes of speed, as many samples in each
_TELLING = 0.5  # [N m] of load, RMS, that the speed does not predict; less says nothing about the load
# Load-dependent friction of a one-way fall, or an inertia that is a little wrong, do less.
_GAIN, _TILT = 0.15, 8.0  # of the load's size, and of its angle in [deg]
_DRIFT = 0.5  # of the residual's standard deviation, from the first third of the time to the last


def sample_warnings(samples: Samples) -> list[str]:
    """What the samples cannot tell, whatever the model."""
    speed, rarer = np.abs(samples.velocity[samples.used]), samples.rarer_direction
    slow, fast = float((speed < _SLOW).mean()), float((speed > _FAST).mean())
    found = []
    if rarer < _ONE_WAY:
        found.append(
            f"one direction only: {100.0 * rarer:.1f} % of the samples move the other way; an offset of "
            "current or load cannot be told from Coulomb friction"
        )
    if slow < _FEW:
        found.append(
            f"no slow samples: {100.0 * slow:.1f} % below {_SLOW:g} rad/s; break-away and Stribeck friction "
            "are extrapolated"
        )
    if fast < _FEW:
        found.append(
            f"no fast samples: {100.0 * fast:.1f} % above {_FAST:g} rad/s, the fastest is "
            f"{speed.max():.3g} rad/s; viscous friction beyond is extrapolated"
        )
    return found


def balance_warnings(
    tests: Sequence[FrictionTest], bench: BenchSetup | None, options: ProcessingOptions
) -> list[str]:
    r"""Whether the motor bears the weight that the bench says; a ParameterError if it bears it upside down.

    Friction of any law goes with the speed. With a load that is truly g times as large, at angles that are δ
    smaller, the balance of torques is
    :math:`f(\omega) + (1 - g \cos\delta)\,F\ell\cos\varphi - g \sin\delta\,F\ell\sin\varphi` at the angle φ
    from the horizontal; its parts are told within classes of equal speed. The thesis's late velocity would
    look like such an angle.
    """
    if bench is None or options.processing is Processing.THESIS:
        return []
    tables = []
    for test in tests:
        if test.from_bench:
            assert test.angle is not None and test.mass is not None  # of which the balance was made
            load, across = (bench.load_torque(test.angle - turn, test.mass) for turn in (0.0, np.pi / 2))
            columns = {"speed": test.velocity, "load": load, "across": across, "torque": test.torque}
            tables.append(pd.DataFrame(columns)[test.used])
    if not tables:
        return []
    table = pd.concat(tables, ignore_index=True)
    classes = pd.qcut(table.pop("speed"), _SPEEDS, labels=False, duplicates="drop")
    rest = (table - table.groupby(classes).transform("mean")).to_numpy()
    share, _, _, sizes = np.linalg.lstsq(rest[:, :2], rest[:, 2])
    if sizes[-1] < _TELLING * np.sqrt(len(rest)):
        return []
    true = complex(1.0 - share[0], -share[1])
    if true.real < 0.0:
        raise ParameterError(
            "logs: by the current the weight pulls upwards; turn current and angle to be positive along the "
            "fall: --columns measured_current=-NAME,angle=-NAME"
        )
    gain, tilt = float(abs(true)), float(np.angle(true, deg=True))
    if abs(gain - 1.0) < _GAIN and abs(tilt) < _TILT:
        return []
    return [
        f"by the current the weight's torque is {gain:.2f} times what mass and lever say, and the angle "
        f"{tilt:+.0f}° too large (expected 1 and 0): check --joint, --mass, --lever-m, --link-inertia-kgm2, "
        "the unit of the current, and --start-angle-deg for logs that do not begin with the link horizontal"
    ]


def processing_warnings(options: ProcessingOptions) -> list[str]:
    """What the processing does to the result."""
    if options.processing is not Processing.THESIS:
        return []
    late = 0.5 * (WINDOW - 1) / RATE
    return [
        f"the thesis's processing makes the velocity {1e3 * late:.0f} ms late against current and load: the "
        "parameters are biased (--processing zero_phase)"
    ]


def fit_warnings(fit: Fit, uncertainty: Uncertainty, samples: Samples) -> list[str]:
    """What is doubtful about a fit."""
    names, correlations, found = fit.model.names, uncertainty.correlations, []
    for name, value in fit.model.parameters(fit.x).items():
        low, high = uncertainty.intervals[name]
        half = 0.5 * (high - low)
        if not np.isfinite(half):
            found.append(f"{name} is not determined by these samples")
        elif half > WIDE * abs(value):
            share = f"{100.0 * half / abs(value):.0f} %" if value else "wider than the value"
            found.append(f"{name} is uncertain: half-width of the interval {share} of the value")
    found += [
        f"{names[i]} and {names[j]} are correlated ({correlations[i, j]:+.3f}): only a combination is known"
        for i in range(len(names))
        for j in range(i)
        if abs(correlations[i, j]) > CORRELATED
    ]
    for place in fit.at_bound:
        linear = place < len(fit.model.coefficients)
        what = "a coefficient" if linear else "a velocity, exponent or ratio"
        found.append(
            f"{what} lies on its bound ({_parameter_at(fit, place)}); its interval is not an estimate"
        )
    if not fit.model.needs:  # friction must take power from the joint
        power = (fit.model.predict(fit.x, samples) * samples.velocity)[samples.used]
        driven = 100.0 * float((power < -1e-9).mean())
        if driven >= 0.1:
            found.append(
                f"the law drives the joint in {driven:.1f} % of the samples; --physical forbids that"
            )
    return found


def _parameter_at(fit: Fit, place: int) -> str:
    """The reported parameter that a position of the vector moves most, relative to its value."""
    moved = fit.x.copy()
    moved[place] += 1e-3
    values, other = (np.array(list(fit.model.parameters(x).values())) for x in (fit.x, moved))
    return fit.model.names[int(np.argmax(np.abs(other - values) / (np.abs(values) + 1e-9)))]


def drift_warnings(residuals: np.ndarray, samples: Samples) -> list[str]:
    """Drift of the residuals in [N m] of the samples that are used along the tests, such as warming up."""
    if samples.time is None or len(residuals) < 30:
        return []
    time, way = samples.time[samples.used], np.sign(samples.velocity[samples.used])
    along = residuals * way  # friction that falls shows with one sign in both directions
    early, late = np.quantile(time, [1.0 / 3.0, 2.0 / 3.0])
    drift = float(along[time >= late].mean() - along[time <= early].mean())
    if abs(drift) < _DRIFT * float(residuals.std()):
        return []
    return [f"friction drifts by {drift:+.2g} N m from the first to the last third of the tests: warming up?"]


def file_warnings(
    tests: Sequence[FrictionTest],
    bench: BenchSetup | None,
    samples: Samples,
    number: int,
    skipped: Mapping[str, tuple[str, ...]],
) -> list[str]:
    """What to know about the files, their ``number`` of samples, and models that were skipped."""
    found, kept = [], len(samples)
    for note in dict.fromkeys(note for test in tests for note in test.notes):
        names = [test.name for test in tests if note in test.notes]
        found.append(f"{names[0]}: {note}" if len(names) == 1 else f"{len(names)} files: {note}")
    if bench is not None and bench.mass is not None:
        others = [f"{test.name} ({test.mass:g} kg)" for test in tests if test.mass not in (None, bench.mass)]
        if others:
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            found.append(f"--mass {bench.mass:g} is overruled by what {others[0]}{more} says")
    if kept < number:
        found.append(f"of {number} samples every {-(-number // kept)}th was used, {kept} in all")
    untimed = [name for name, columns in skipped.items() if "period" in columns]
    if samples.period is None and untimed:
        found.append(
            f"without a time {', '.join(untimed)} cannot be fitted; name the column with --columns time=NAME"
        )
    return found
