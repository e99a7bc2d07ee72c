"""What a reader of an identification must be warned about."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterError
from twin_gait.identification.fitting import Fit
from twin_gait.identification.models import FrictionTest, Samples, join_tests
from twin_gait.identification.processing import RATE, WINDOW, BenchSetup, Processing, ProcessingOptions
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


def sample_warnings(samples: Samples) -> list[str]:
    """What the samples cannot tell, whatever the model."""
    speed = np.abs(samples.velocity[samples.used])
    doubts = (
        (samples.rarer_direction, _ONE_WAY, "one direction only: {:.1f} % of the samples move the other way; "
         "an offset of current or load cannot be told from Coulomb friction"),
        ((speed < _SLOW).mean(), _FEW, f"no slow samples: {{:.1f}} % below {_SLOW:g} rad/s; break-away and "
         "Stribeck friction are extrapolated"),
        ((speed > _FAST).mean(), _FEW, f"no fast samples: {{:.1f}} % above {_FAST:g} rad/s; viscous friction "
         f"beyond {speed.max():.3g} rad/s is extrapolated"),
    )  # fmt: skip
    return [text.format(100.0 * share) for share, least, text in doubts if share < least]


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
    tests = [test for test in tests if test.from_bench]
    if bench is None or not tests or options.processing is Processing.THESIS:
        return []
    rows = join_tests(tests)
    mass = np.array([test.mass for test in tests], dtype=float)[rows.test]
    load, across = (bench.load_torque(np.asarray(rows.angle) - turn, mass) for turn in (0.0, np.pi / 2))
    columns = {"speed": rows.velocity, "load": load, "across": across, "torque": rows.torque}
    table = pd.DataFrame(columns)[rows.used]
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
            found.append(f"{name} is uncertain: {value:.3g}, and half of the interval {half:.2g}")
    found += [
        f"{names[i]} and {names[j]} are correlated ({correlations[i, j]:+.3f}): only a combination is known"
        for i in range(len(names))
        for j in range(i)
        if abs(correlations[i, j]) > CORRELATED
    ]
    found += [f"{names[place]} lies on its bound; its interval is no estimate" for place in fit.at_bound]
    if not fit.model.needs:  # friction must take power from the joint
        power = fit.model.predict(fit.x, samples) * samples.velocity
        driven = 100.0 * float((power[samples.used] < -1e-9).mean())
        if driven >= 0.1:
            text = f"the law drives the joint in {driven:.1f} % of the samples; --physical forbids that"
            found.append(text)
    return found


def file_warnings(
    tests: Sequence[FrictionTest], bench: BenchSetup | None, samples: Samples, number: int
) -> list[str]:
    """What to know about the files, and their ``number`` of samples."""
    found, kept = [], len(samples)
    for note in dict.fromkeys(note for test in tests for note in test.notes):
        names = [test.name for test in tests if note in test.notes]
        found.append(f"{names[0] if len(names) == 1 else f'{len(names)} files'}: {note}")
    mass = None if bench is None else bench.mass
    others = [f"{test.name} ({test.mass:g} kg)" for test in tests if test.mass not in (None, mass)]
    if mass is not None and others:
        found.append(f"--mass {mass:g} is overruled by what {others[0]} says, of {len(others)} such files")
    if kept < number:
        found.append(f"of {number} samples every {-(-number // kept)}th was used, {kept} in all")
    return found
