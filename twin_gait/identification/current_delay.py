r"""Estimation of the time by which the current leads the angle in the logs of a bench.

A current that leads by :math:`\tau` changes the balance of torques by :math:`\tau\,\dot T_m`, the rate of the
motor's torque. At equal speed, friction of any law is constant; the remaining balance is regressed on this
rate, on load and on acceleration. Noise of the current would reduce the estimate. The rate of inertia and
load, which follows from the angle alone, is therefore the instrument of the rate (two-stage least squares).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from twin_gait.identification.laws import usual_speed
from twin_gait.identification.models import FrictionTest, join_tests
from twin_gait.identification.processing import BenchSetup, Processing
from twin_gait.identification.statistics import LEVEL, block_indices

# Knots of the piecewise linear friction over the speed, with equal numbers of samples between them.
_KNOTS = 100
_MOST_SAMPLES = 40_000  # largest number of samples, taken evenly
# Below this share of the usual speed, ripple of the friction looks like a delay, because the filter mixes
# speeds with different friction. In falls, friction that depends on the load looks like a delay, too: this
# share of the fast samples has to move in each direction.
_FAST, _BOTH_WAYS = 0.25, 0.2
# [s], least delay of a warning; friction of a knee at 1 Hz is biased by less than 1 % below it.
_NOTICED = 1e-4
_RANK = 1e-10  # relative singular value below which the rate cannot be distinguished


class Delay(NamedTuple):
    """Estimate of the time by which the current leads the angle."""

    time: float  # estimate in [s]
    half_interval: float  # half of the 95 % interval in [s]


def estimate_delay(tests: Sequence[FrictionTest], bench: BenchSetup) -> Delay | None:
    """Estimate the remaining lead of the current over the angle; None if the logs do not determine it."""
    rows = join_tests(tests)
    chosen = np.flatnonzero(rows.used & (np.abs(rows.velocity) > _FAST * usual_speed(rows)))
    if rows.rows(chosen).rarer_direction < _BOTH_WAYS:
        return None
    mass = np.array([test.mass for test in tests], dtype=float)[rows.test]
    load, across = (bench.load_torque(np.asarray(rows.angle) - turn, mass) for turn in (0.0, np.pi / 2))
    accelerations = [_derivative(test, test.velocity) for test in tests]
    acceleration = np.concatenate(accelerations)
    jerks = [_derivative(test, values) for test, values in zip(tests, accelerations, strict=True)]
    expected = bench.inertia(mass) * np.concatenate(jerks) + across * rows.velocity
    measured = np.concatenate([test.motor_rate for test in tests])
    table = np.column_stack([load, across, acceleration, measured, expected, rows.torque])
    chosen = chosen[:: -(-len(chosen) // _MOST_SAMPLES)]
    speed, block = rows.velocity[chosen], block_indices(rows.test[chosen])
    knots = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _KNOTS)))
    hats = np.column_stack([np.interp(speed, knots, one) for one in np.eye(len(knots))])
    basis, _ = np.linalg.qr(hats)
    rest = table[chosen] - basis @ (basis.T @ table[chosen])
    regressors, instruments, torque = rest[:, :4], rest[:, [0, 1, 2, 4]], rest[:, 5]
    number = int(block[-1]) + 1
    scale = np.sqrt((instruments**2).sum(axis=0))
    if number < 2 or not scale.all() or np.linalg.matrix_rank(instruments / scale, tol=_RANK) < 4:
        return None
    inverse = np.linalg.pinv(instruments.T @ regressors)
    shares = inverse @ (instruments.T @ torque)
    error = torque - regressors @ shares
    scores = np.array([instruments[block == one].T @ error[block == one] for one in range(number)])
    variance = (inverse @ (scores.T @ scores) @ inverse.T)[-1, -1] * number / (number - 1)
    return Delay(float(shares[-1]), float(student.ppf(0.5 + LEVEL / 2.0, number - 1)) * math.sqrt(variance))


def _derivative(test: FrictionTest, values: np.ndarray) -> np.ndarray:
    """Return the derivative of values over the time of a test, shape ``(n,)``."""
    return np.asarray(np.gradient(np.asarray(values), np.asarray(test.time)))


def delay_warnings(
    tests: Sequence[FrictionTest], bench: BenchSetup | None, processing: Processing
) -> list[str]:
    """Return a warning if the current leads or lags the angle, except for the thesis's processing.

    Its late velocity has a warning of its own.
    """
    tests = [test for test in tests if test.from_bench]
    if bench is None or not tests or processing is Processing.THESIS:
        return []
    found = estimate_delay(tests, bench)
    if found is None or abs(found.time) < max(found.half_interval, _NOTICED):
        return []
    ends = sorted(abs(found.time + sign * found.half_interval) for sign in (-1.0, 1.0))
    return [
        f"the current {'leads' if found.time > 0.0 else 'lags'} the angle by {1e3 * ends[0]:.2f} to "
        f"{1e3 * ends[1]:.2f} ms (95 %), which biases the friction; add --current-delay-ms "
        f"{1e3 * (bench.current_delay + found.time):.2f}"
    ]
