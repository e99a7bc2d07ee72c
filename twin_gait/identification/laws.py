"""The laws of the friction models over samples, from linear coefficients ``beta`` and shape ``eta``.

Break-away friction is fitted as its excess over Coulomb friction, stiffness and break-away friction of
bristles as ratios to it, so that each law is linear in its coefficients. The last functions turn them into
what is reported.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import numba
import numpy as np

from twin_gait.core import friction, friction_models
from twin_gait.core.friction_models import REFERENCE_TEMPERATURE, bristle_step
from twin_gait.identification.samples import Samples
from twin_gait.simulation.binding import bind
from twin_gait.simulation.compiling import ON_BITS

# The laws of the plant, run over arrays: the same functions with NumPy's in place of core's.
_NUMPY = {
    "exponential": np.exp,
    "hyperbolic_tangent": np.tanh,
    "sine_cosine": lambda angle: (np.sin(angle), np.cos(angle)),
    "chosen": np.where,
    "sign_of": np.sign,
}


def over_arrays(law: Callable[..., float]) -> Callable[..., np.ndarray]:
    """A static law that takes arrays of any shape."""
    bound: Callable[..., np.ndarray] = bind(law, _NUMPY)
    return bound


asymmetric_torque = over_arrays(friction_models.asymmetric_torque)
conditioned_torque = over_arrays(friction_models.conditioned_torque)
coulomb_viscous_tanh_torque = over_arrays(friction_models.coulomb_viscous_tanh_torque)
coulomb_viscous_torque = over_arrays(friction_models.coulomb_viscous_torque)
directional_viscous_torque = over_arrays(friction_models.directional_viscous_torque)
lugre_torque = over_arrays(friction_models.lugre_torque)
ripple_torque = over_arrays(friction_models.ripple_torque)
rotational_friction_torque = over_arrays(friction.rotational_friction_torque)
stribeck_level = over_arrays(friction_models.stribeck_level)
stribeck_torque = over_arrays(friction_models.stribeck_torque)
two_velocity_torque = over_arrays(friction_models.two_velocity_torque)


def coulomb_viscous(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous."""
    return coulomb_viscous_torque(samples.velocity, *beta)


def coulomb_viscous_tanh(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous; shape: steepness."""
    return coulomb_viscous_tanh_torque(samples.velocity, *beta, *eta)


def stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: break-away over Coulomb, Coulomb, viscous; shape: Stribeck velocity and exponent."""
    return stribeck_torque(samples.velocity, beta[1], beta[0] + beta[1], beta[2], *eta)


def rotational(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: break-away over Coulomb, Coulomb, viscous; shape: break-away velocity."""
    return rotational_friction_torque(samples.velocity, beta[0] + beta[1], beta[1], eta[0], beta[2])


def simscape(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """As :func:`rotational`, with velocities √2 and 0.1 times the break-away velocity."""
    breakaway, velocities = beta[0] + beta[1], (math.sqrt(2.0) * eta[0], 0.1 * eta[0])
    return two_velocity_torque(samples.velocity, breakaway, beta[1], beta[2], *velocities)


def _conditioned(
    samples: Samples,
    coulomb: float,
    viscous: float,
    transition: float,
    per_load: float | None = None,
    per_temperature: tuple[float, float] | None = None,
) -> np.ndarray:
    """Coulomb and viscous friction; Coulomb per load, and both per temperature, where that is fitted."""
    number, (coulomb_warm, viscous_warm) = len(samples), per_temperature or (0.0, 0.0)
    warm = np.full(number, REFERENCE_TEMPERATURE) if per_temperature is None else _column(samples.temperature)
    loaded = np.zeros(number) if per_load is None else _column(samples.load)
    load_share = 0.0 if per_load is None else per_load
    return conditioned_torque(
        samples.velocity, loaded, warm, coulomb, load_share, coulomb_warm, viscous, viscous_warm, transition
    )


def load(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, Coulomb per load; shape: transition velocity."""
    return _conditioned(samples, beta[0], beta[1], eta[0], beta[2])


def temperature(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, both per temperature; shape: transition velocity."""
    return _conditioned(samples, beta[0], beta[1], eta[0], per_temperature=(beta[2], beta[3]))


def load_temperature(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, Coulomb per load, both per temperature; shape: transition velocity."""
    return _conditioned(samples, beta[0], beta[1], eta[0], beta[2], (beta[3], beta[4]))


def asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous forward and backward, offset; shape: transition velocity."""
    coulomb, *viscous, offset = beta
    return asymmetric_torque(samples.velocity, offset, coulomb, coulomb, *viscous, eta[0], 1.0, 1.0, 1.0)


def asymmetric_stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """As :func:`asymmetric`, with break-away over Coulomb first and the exponents behind."""
    excess, coulomb, *viscous, offset = beta
    return asymmetric_torque(samples.velocity, offset, coulomb, coulomb + excess, *viscous, *eta)


def ripple(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, offset, cosine, sine; shape: transition velocity, ripples a turn."""
    coulomb, viscous, offset, cosine, sine = beta
    smooth = coulomb_viscous_tanh_torque(samples.velocity, coulomb, viscous, 1.0 / eta[0])
    return np.asarray(smooth + offset + ripple_torque(_column(samples.angle), cosine, sine, eta[1]))


def dahl(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous; shape: stiffness over Coulomb."""
    rest = coulomb_viscous_torque(samples.velocity, 0.0, beta[1])
    return _bristles(samples, np.array([eta[0], 1.0, 1.0]), 1.0, (beta[0], 0.0), rest)


def lugre(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, bristle damping, viscous; shape: two ratios to Coulomb, Stribeck velocity."""
    rest = coulomb_viscous_torque(samples.velocity, 0.0, beta[2])
    return _bristles(samples, eta, 2.0, (beta[0], beta[1]), rest)


def lugre_asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """As :func:`lugre`, viscous forward and backward, with an offset; shape: both exponents behind."""
    coulomb, damping, forward, backward, offset = beta
    rest = offset + directional_viscous_torque(samples.velocity, forward, backward, eta[4])
    return _bristles(samples, eta[:3], eta[3], (coulomb, damping), rest)


def _bristles(
    samples: Samples, eta: np.ndarray, exponent: float, scales: tuple[float, float], rest: np.ndarray
) -> np.ndarray:
    """Torque of bristles, scaled by Coulomb friction and damping, and the rest, with what a start leaves.

    Bristles are those of a Coulomb friction of 1 N m. How they were bent at the start of a test is not known;
    its first torque, less what is not theirs, tells.
    """
    stiffness, ratio, stribeck_velocity = eta
    velocity, period, fresh = samples.velocity, _column(samples.period), samples.fresh
    level = stribeck_level(velocity, 1.0, ratio, stribeck_velocity, exponent)
    z = bristle_deflection(velocity, period, fresh, level, stiffness)
    rate = velocity - stiffness * np.abs(velocity) / level * z
    sliding = lugre_torque(velocity, stiffness * z, rate, *scales, 0.0)
    left = remembered_start(velocity, period, fresh, level, stiffness)
    origin = _start_of(fresh)
    return np.asarray(sliding + rest + left * (samples.torque[origin] - rest[..., origin]))


def _column(values: np.ndarray | None) -> np.ndarray:
    assert values is not None  # models that need a column are offered only where it is
    return values


def as_fitted(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Reported as they are fitted."""
    return (*beta, *eta)


def breakaway_first(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coefficients are break-away less Coulomb friction, and Coulomb friction."""
    return (beta[0] + beta[1], *beta[1:], *eta)


def dahl_reported(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Shape is stiffness over Coulomb friction."""
    return (*beta, eta[0] * beta[0])


def lugre_reported(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Shape begins with stiffness and break-away friction over Coulomb friction."""
    coulomb = beta[0]
    return (eta[1] * coulomb, *beta, eta[0] * coulomb, *eta[2:])


def bristle_deflection(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Deflection of the bristles in [rad] at every sample, shape ``(n,)``.

    The velocity holds from the sample before to the sample. A test starts with straight bristles; what is
    left of another start is :func:`remembered_start`.

    ``velocity``: in [rad] / [s], shape ``(n,)`` as the next three. ``period``: since the sample before in
    [s]. ``fresh``: where a test starts; true at the first sample. ``level``: g of
    :func:`twin_gait.core.friction_models.bristle_rate` in [N m]. ``stiffness``: σ0 in [N m] / [rad].
    """
    return np.asarray(_loop()(velocity, period, fresh, level, stiffness))


def remembered_start(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Share of the deflection at the start of a test that is left at every sample: the law is linear in it.

    From 1 at the start towards 0, shape ``(n,)``. The arguments are those of :func:`bristle_deflection`.
    """
    travelled = np.cumsum(np.where(fresh, 0.0, stiffness * np.abs(velocity) * period / level))
    return np.asarray(np.exp(-(travelled - travelled[_start_of(fresh)])))


def _start_of(fresh: np.ndarray) -> np.ndarray:
    """Index of the first sample of the test of each sample."""
    return np.asarray(np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0)))


@lru_cache(maxsize=1)
def _loop() -> Callable[..., np.ndarray]:
    compiled: Callable[..., np.ndarray] = bind(_deflections, ON_BITS, numba.njit)
    return compiled


def _deflections(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    deflection = np.empty(len(velocity))
    z = 0.0
    for i in range(len(velocity)):
        if fresh[i]:
            z = 0.0
        else:
            z = bristle_step(velocity[i], z, level[i], stiffness, period[i])
        deflection[i] = z
    return deflection
