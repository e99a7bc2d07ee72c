"""Friction models that are fitted: torque of every sample from linear coefficients and shape parameters.

A law is linear in its coefficients ``beta`` and not linear in its shape parameters ``eta``. Break-away
friction is therefore fitted as its excess over Coulomb friction; stiffness and break-away friction of
bristles are fitted as ratios to Coulomb friction. ``to_reported`` of a model converts both to the reported
parameters. The formula of a model is the first line of its law without "Compute".
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np

from twin_gait.core import friction, friction_models
from twin_gait.core.friction_models import REFERENCE_TEMPERATURE, bristle_step
from twin_gait.docstrings import summary_of
from twin_gait.identification.models import FrictionModel, Samples, ShapeParameter
from twin_gait.simulation.binding import is_package_function, specialize
from twin_gait.simulation.compiling import BIT_FUNCTIONS

_TINY = 1e-12


def usual_speed(samples: Samples) -> float:
    """Compute the speed in [rad/s] below which 95 % of the used samples are."""
    return max(float(np.quantile(np.abs(samples.velocity[samples.used]), 0.95)), _TINY)


def fineness(samples: Samples) -> float:
    """Compute the inverse of the median angle between consecutive samples, in [1/rad]."""
    moved = np.abs(samples.velocity * (0.0 if samples.period is None else samples.period))
    return 1.0 / max(float(np.median(moved[moved > 0.0])), _TINY) if moved.any() else 1.0


def spans_per_turn(samples: Samples) -> float:
    """Compute the ratio of a turn of the joint to the range of the measured angles; 1 without angles."""
    return 1.0 if samples.angle is None else 2.0 * np.pi / max(float(np.ptp(samples.angle)), _TINY)


_COULOMB, _VISCOUS, OFFSET = "coulomb_friction_Nm", "viscous_friction_Nms_per_rad", "offset_Nm"
_BREAKAWAY, BRISTLE_DAMPING = "breakaway_torque_Nm", "bristle_damping_Nms_per_rad"
_BOTH_WAYS = "viscous_friction_forward_Nm", "viscous_friction_backward_Nm"
_PER_LOAD = "coulomb_per_load"
_PER_KELVIN = "coulomb_per_temperature_Nm_per_K", "viscous_per_temperature_Nms_per_radK"
_RIPPLES = "ripple_cosine_Nm", "ripple_sine_Nm"
# Coefficients that may be negative; all others of a physical friction are 0 or positive.
SIGNED = frozenset({OFFSET, *_PER_KELVIN, *_RIPPLES})
_TRANSITION = ShapeParameter("transition_velocity_rad_per_s", 1e-4, 1.0, usual_speed)
_STRIBECK = ShapeParameter("stribeck_velocity_rad_per_s", 1e-3, 10.0, usual_speed)
_BREAKAWAY_VELOCITY = replace(_STRIBECK, name="breakaway_velocity_rad_per_s")
# Velocity and exponent of the Stribeck curve, and the exponent of viscous friction.
_CURVE = (
    _STRIBECK,
    ShapeParameter("stribeck_exponent", 0.4, 10.0),
    ShapeParameter("viscous_exponent", 0.1, 3.0),
)
_STEEPNESS = ShapeParameter("steepness_s_per_rad", 1.0, 1e4, lambda samples: 1.0 / usual_speed(samples))
_RIPPLE = ShapeParameter("ripple_per_turn", 1.0, 60.0, spans_per_turn)
# Ratio σ0/T_c, the inverse of the deflection at which the bristles slide, and ratio T_b/T_c.
_BRISTLES = ShapeParameter("bristle_stiffness_Nm_per_rad", 1e-5, 1e5, fineness)
_RATIO = ShapeParameter(_BREAKAWAY, 0.1, 10.0, physical_low=1.0, log_interval=False)

# Laws of the plant for arrays: the functions of core with the elementary functions of NumPy.
_NUMPY = {
    "exponential": np.exp,
    "hyperbolic_tangent": np.tanh,
    "sine_cosine": lambda angle: (np.sin(angle), np.cos(angle)),
    "where": np.where,
    "sign_of": np.sign,
}
_PLAIN = filter(is_package_function, (*vars(friction_models).values(), friction.rotational_friction_torque))
array_laws = SimpleNamespace(**{law.__name__: specialize(law, _NUMPY) for law in _PLAIN})


def convert_breakaway(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the reported parameters of a model with break-away friction, its coefficients and its shape.

    The first two coefficients are T_b − T_c and T_c; the first one is replaced by T_b.
    """
    return (beta[0] + beta[1], *beta[1:], *eta)


def convert_bristles(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the reported parameters of a bristle model, its coefficients and its shape.

    The first coefficient is T_c, and the shape begins with σ0/T_c and T_b/T_c, which are multiplied by it.
    """
    return (*beta, *(eta[:2] * beta[0]), *eta[2:])


_Law = Callable[[Samples, np.ndarray, np.ndarray], Any]  # torque of each sample in [N·m], shape ``(n,)``
MODELS: dict[str, FrictionModel] = {}  # models by the names of their laws


def _model(coefficients: tuple[str, ...], *shape: ShapeParameter, **more: Any) -> Callable[[_Law], _Law]:
    """Return a decorator that registers a law as a model; arguments as of :class:`FrictionModel`."""

    def add(law: _Law) -> _Law:
        formula = summary_of(law).removeprefix("Compute ").removesuffix(".")
        MODELS[law.__name__] = FrictionModel(law.__name__, formula, coefficients, shape, law, **more)
        return law

    return add


@_model((_COULOMB, _VISCOUS))
def coulomb_viscous(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute T_c sgn ω + d ω.

    Coefficients: Coulomb, viscous.
    """
    return array_laws.coulomb_viscous_torque(samples.velocity, *beta)


@_model((_COULOMB, _VISCOUS), _STEEPNESS)
def coulomb_viscous_tanh(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute T_c tanh(κ ω) + d ω.

    Coefficients: Coulomb, viscous; shape: steepness.
    """
    return array_laws.coulomb_viscous_tanh_torque(samples.velocity, *beta, *eta)


@_model((_BREAKAWAY, _COULOMB, _VISCOUS), *_CURVE[:2], to_reported=convert_breakaway)
def stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute [T_c + (T_b − T_c) exp(−|ω/ω_st|^δ)] sgn ω + d ω.

    Coefficients: break-away over Coulomb, Coulomb, viscous; shape: Stribeck velocity and exponent.
    """
    level = array_laws.stribeck_level(samples.velocity, beta[1], beta[0] + beta[1], *eta)
    return array_laws.coulomb_viscous_torque(samples.velocity, level, beta[2])


@_model((_BREAKAWAY, _COULOMB, _VISCOUS), _BREAKAWAY_VELOCITY, to_reported=convert_breakaway)
def rotational(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute √(2e) (T_b − T_c) exp(−(ω/ω_c)²) ω/ω_c + T_c tanh(10 ω/ω_c) + d ω.

    Coefficients: break-away over Coulomb, Coulomb, viscous; shape: break-away velocity.
    """
    breakaway = beta[0] + beta[1]
    return array_laws.rotational_friction_torque(samples.velocity, breakaway, beta[1], eta[0], beta[2])


@_model((_BREAKAWAY, _COULOMB, _VISCOUS), _BREAKAWAY_VELOCITY, to_reported=convert_breakaway)
def rotational_simscape(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute √(2e) (T_b − T_c) exp(−(ω/ω_1)²) ω/ω_1 + T_c tanh(ω/ω_2) + d ω, ω_1 = √2 ω_b, ω_2 = ω_b/10.

    The parameters are those of :func:`rotational`, with velocities √2 and 0.1 times the break-away velocity.
    """
    breakaway, velocities = beta[0] + beta[1], (math.sqrt(2.0) * eta[0], 0.1 * eta[0])
    return array_laws.two_velocity_torque(samples.velocity, breakaway, beta[1], beta[2], *velocities)


@_model((_COULOMB, _VISCOUS, _PER_LOAD), _TRANSITION, needs=("load",))
def load_dependent(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute (T_c + c_l |T_L|) tanh(ω/ω_t) + d ω.

    Coefficients: Coulomb, viscous, Coulomb per load; shape: transition velocity.
    """
    return _conditioned(samples, eta, *beta, 0.0, 0.0)


@_model((_COULOMB, _VISCOUS, *_PER_KELVIN), _TRANSITION, needs=("temperature",))
def temperature_dependent(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute (T_c + c_ϑ Δϑ) tanh(ω/ω_t) + (d + d_ϑ Δϑ) ω, Δϑ = ϑ − 25 °C.

    Coefficients: Coulomb, viscous, both per temperature; shape: transition velocity.
    """
    return _conditioned(samples, eta, *beta[:2], 0.0, *beta[2:])


@_model((_COULOMB, _VISCOUS, _PER_LOAD, *_PER_KELVIN), _TRANSITION, needs=("load", "temperature"))
def load_temperature_dependent(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute (T_c + c_l |T_L| + c_ϑ Δϑ) tanh(ω/ω_t) + (d + d_ϑ Δϑ) ω, Δϑ = ϑ − 25 °C.

    Coefficients: Coulomb, viscous, Coulomb per load, both per temperature; shape: transition velocity.
    """
    return _conditioned(samples, eta, *beta)


def _conditioned(
    samples: Samples, eta: np.ndarray, coulomb: Any, viscous: Any, per_load: Any, *per_kelvin: Any
) -> Any:
    """Compute friction that depends on load and temperature.

    A coefficient of zero removes its term, and the samples then need no column for it.
    """
    load = 0.0 if samples.load is None else samples.load
    warm = REFERENCE_TEMPERATURE if samples.temperature is None else samples.temperature
    parts = coulomb, per_load, per_kelvin[0], viscous, per_kelvin[1]
    return array_laws.load_and_temperature_torque(samples.velocity, load, warm, *parts, *eta)


@_model((_COULOMB, *_BOTH_WAYS, OFFSET), _TRANSITION)
def asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute T_0 + T_c tanh(ω/ω_t) + d± ω.

    Coefficients: Coulomb, viscous forward and backward, offset; shape: transition velocity.
    """
    coulomb, *both_ways, offset = beta
    viscous = array_laws.directional_viscous_torque(samples.velocity, *both_ways, 1.0)
    return array_laws.asymmetric_torque(samples.velocity, offset, coulomb, eta[0], viscous)


@_model((_BREAKAWAY, _COULOMB, *_BOTH_WAYS, OFFSET), _TRANSITION, *_CURVE, to_reported=convert_breakaway)
def asymmetric_stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute T_0 + [T_c + (T_b − T_c) exp(−|ω/ω_st|^δ)] tanh(ω/ω_t) + d± |ω|^α sgn ω.

    The parameters are those of :func:`asymmetric`, with break-away over Coulomb first and exponents at the
    end.
    """
    excess, coulomb, *both_ways, offset = beta
    level = array_laws.stribeck_level(samples.velocity, coulomb, coulomb + excess, *eta[1:3])
    viscous = array_laws.directional_viscous_torque(samples.velocity, *both_ways, eta[3])
    return array_laws.asymmetric_torque(samples.velocity, offset, level, eta[0], viscous)


@_model((_COULOMB, _VISCOUS, OFFSET, *_RIPPLES), _TRANSITION, _RIPPLE, needs=("angle",))
def position_ripple(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute T_c tanh(ω/ω_t) + d ω + T_0 + C cos nθ + S sin nθ.

    Coefficients: Coulomb, viscous, offset, cosine, sine; shape: transition velocity, ripples a turn.
    """
    coulomb, viscous, offset, *waves = beta
    smooth = array_laws.coulomb_viscous_tanh_torque(samples.velocity, coulomb, viscous, 1.0 / eta[0])
    return np.asarray(smooth + offset + array_laws.ripple_torque(samples.angle, *waves, eta[1]))


_DYNAMIC = {"to_reported": convert_bristles, "needs": ("period",), "dynamic": True}


@_model((_COULOMB, _VISCOUS), _BRISTLES, **_DYNAMIC)
def dahl(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute σ0 z + d ω, ż = ω − σ0 |ω| z / T_c.

    Coefficients: Coulomb, viscous; shape: stiffness over Coulomb.
    """
    rest = array_laws.coulomb_viscous_torque(samples.velocity, 0.0, beta[1])
    return _bristles(samples, np.array([eta[0], 1.0, 1.0]), 1.0, (beta[0], 0.0), rest)


@_model((_COULOMB, BRISTLE_DAMPING, _VISCOUS), _BRISTLES, _RATIO, _STRIBECK, **_DYNAMIC)
def lugre(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """Compute σ0 z + σ1 ż + d ω, ż = ω − σ0 |ω| z / h, h = T_c + (T_b − T_c) exp(−(ω/ω_st)²).

    Coefficients: Coulomb, bristle damping, viscous; shape: two ratios to Coulomb, Stribeck velocity.
    """
    rest = array_laws.coulomb_viscous_torque(samples.velocity, 0.0, beta[2])
    return _bristles(samples, eta, 2.0, (beta[0], beta[1]), rest)


@_model((_COULOMB, BRISTLE_DAMPING, *_BOTH_WAYS, OFFSET), _BRISTLES, _RATIO, *_CURVE, **_DYNAMIC)
def lugre_asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> Any:
    """T_0 + σ0 z + σ1 ż + d± |ω|^α sgn ω, ż = ω − σ0 |ω| z / h, h = T_c + (T_b − T_c) exp(−|ω/ω_st|^δ).

    The parameters are those of :func:`lugre`, viscous forward and backward, with an offset; shape: both
    exponents at the end.
    """
    coulomb, damping, *viscous, offset = beta
    rest = offset + array_laws.directional_viscous_torque(samples.velocity, *viscous, eta[4])
    return _bristles(samples, eta[:3], eta[3], (coulomb, damping), rest)


def _bristles(
    samples: Samples, eta: np.ndarray, exponent: float, scales: tuple[float, float], rest: np.ndarray
) -> np.ndarray:
    """Compute T_c σ0/T_c z + σ1 ż + ``rest`` plus the torque of the initial deflection.

    ``eta``: σ0/T_c, T_b/T_c and Stribeck velocity. ``scales``: T_c and σ1. ``rest``: all other torques of the
    law in [N·m], shape ``(n,)``. The bristles are computed for a Coulomb friction of 1 N·m and scaled. Their
    deflection at the start of a test is not measured; it follows from the first measured torque of the test
    less ``rest``.
    """
    stiffness, ratio, stribeck_velocity = eta
    velocity, period, fresh = samples.velocity, samples.period, samples.fresh
    assert period is not None  # a model is fitted only to samples with the columns that it needs
    level = array_laws.stribeck_level(velocity, 1.0, ratio, stribeck_velocity, exponent)
    z = bristle_deflection(velocity, period, fresh, level, stiffness)
    rate = velocity - stiffness * np.abs(velocity) / level * z
    sliding = array_laws.lugre_torque(velocity, stiffness * z, rate, *scales, 0.0)
    left = initial_deflection_share(velocity, period, fresh, level, stiffness)
    origin = _start_of(fresh)
    return np.asarray(sliding + rest + left * (samples.torque[origin] - rest[..., origin]))


@partial(specialize, names=BIT_FUNCTIONS, wrap=numba.njit)
def bristle_deflection(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Compute the deflection of the bristles in [rad] at every sample, shape ``(n,)``.

    The velocity of a sample is taken as constant since the sample before. A test starts with undeflected
    bristles; :func:`initial_deflection_share` describes the effect of another start.

    ``velocity`` in [rad/s], shape ``(n,)`` as for the next three arguments. ``period``: time since the sample
    before in [s]. ``fresh``: whether a test starts at the sample; true for the first one. ``level``: h of
    :func:`twin_gait.core.friction_models.bristle_rate` in [N·m]. ``stiffness``: σ0 in [N·m/rad].
    """
    deflection = np.empty(len(velocity))
    z = 0.0
    for i in range(len(velocity)):
        z = 0.0 if fresh[i] else bristle_step(velocity[i], z, level[i], stiffness, period[i])
        deflection[i] = z
    return deflection


def initial_deflection_share(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Compute the share of the deflection at the start of a test that is left at every sample.

    It is exp(−∫ σ0 |ω| / h dt) since the start of the test, because the law is linear in the deflection. The
    arguments are those of :func:`bristle_deflection`. Returns the share, 1 at the start and falling towards
    0, shape ``(n,)``.
    """
    travelled = np.cumsum(np.where(fresh, 0.0, stiffness * np.abs(velocity) * period / level))
    return np.asarray(np.exp(-(travelled - travelled[_start_of(fresh)])))


def _start_of(fresh: np.ndarray) -> np.ndarray:
    """Return the index of the first sample of the test of each sample."""
    return np.asarray(np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0)))
