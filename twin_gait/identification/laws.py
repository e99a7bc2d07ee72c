"""The friction models: their laws over samples, from linear coefficients ``beta`` and shape ``eta``.

Break-away friction is fitted as its excess over Coulomb friction, stiffness and break-away friction of
bristles as ratios to it, so that each law is linear in its coefficients; ``public`` of a model turns them
into what is reported.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numba
import numpy as np

from twin_gait.core import friction, friction_models
from twin_gait.core.friction_models import REFERENCE_TEMPERATURE, bristle_step
from twin_gait.identification.friction_model import (
    FrictionModel,
    Shape,
    fineness,
    slowness,
    spans_in_a_turn,
    usual_speed,
)
from twin_gait.identification.samples import Samples
from twin_gait.simulation.binding import bind
from twin_gait.simulation.compiling import ON_BITS

_COULOMB, _VISCOUS = "coulomb_friction_Nm", "viscous_friction_Nms_per_rad"
_BREAKAWAY, _STRIBECK = "breakaway_torque_Nm", "stribeck_velocity_rad_per_s"
_TRANSITION, _OFFSET = "transition_velocity_rad_per_s", "offset_Nm"
_BRISTLE_STIFFNESS, _BRISTLE_DAMPING = "bristle_stiffness_Nm_per_rad", "bristle_damping_Nms_per_rad"
_BREAKAWAY_VELOCITY = "breakaway_velocity_rad_per_s"
_STEEPNESS, _RIPPLE = "steepness_s_per_rad", "ripple_per_turn"
_BOTH_WAYS = "viscous_friction_forward_Nm", "viscous_friction_backward_Nm"
_EXPONENTS = "stribeck_exponent", "viscous_exponent"
_PER_LOAD = "coulomb_per_load"
_PER_KELVIN = "coulomb_per_temperature_Nm_per_K", "viscous_per_temperature_Nms_per_radK"
_ROTATIONAL = _BREAKAWAY, _COULOMB, _VISCOUS, _BREAKAWAY_VELOCITY
_TRANSITION_SHAPE = Shape(low=1e-4, high=1.0, scale=usual_speed)
_STRIBECK_SHAPE = Shape(low=1e-3, high=10.0, scale=usual_speed)
_STRIBECK_EXPONENT, _VISCOUS_EXPONENT = Shape(low=0.4, high=10.0), Shape(low=0.1, high=3.0)
_STEEPNESS_SHAPE = Shape(low=1.0, high=1e4, scale=slowness)
_RIPPLE_SHAPE = Shape(low=1.0, high=60.0, scale=spans_in_a_turn)
# σ0/T_c: the inverse of the deflection at which the bristles slide; T_b/T_c.
_BRISTLE_SHAPE = Shape(low=1e-5, high=1e5, scale=fineness)
_BREAKAWAY_RATIO = Shape(low=0.1, high=10.0, physical_low=1.0)
# Parameters that are positive and uncertain by a factor: their intervals are those of the logarithm.
LOGARITHMIC = frozenset(
    {_STRIBECK, _TRANSITION, *_EXPONENTS, _BREAKAWAY_VELOCITY, _STEEPNESS, _BRISTLE_STIFFNESS, _RIPPLE}
)

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
two_velocity_torque = over_arrays(friction_models.two_velocity_torque)


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


_Law = Callable[[Samples, np.ndarray, np.ndarray], np.ndarray]
MODELS: dict[str, FrictionModel] = {}  # by name, which is that of the law


def _model(
    formula: str,
    names: tuple[str, ...],
    coefficients: str,
    *shape: Shape,
    public: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]] = as_fitted,
    needs: str = "",
    **more: Any,
) -> Callable[[_Law], _Law]:
    """Make a model of a law; see :class:`FrictionModel`."""

    def add(law: _Law) -> _Law:
        known = FrictionModel(law.__name__, formula, names, coefficients, shape, law, public, **more)
        MODELS[law.__name__] = replace(known, needs=frozenset(needs.split()))
        return law

    return add


@_model("T_c sgn ω + d ω", (_COULOMB, _VISCOUS), "++")
def coulomb_viscous(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous."""
    return coulomb_viscous_torque(samples.velocity, *beta)


@_model("T_c tanh(κ ω) + d ω", (_COULOMB, _VISCOUS, _STEEPNESS), "++", _STEEPNESS_SHAPE)
def coulomb_viscous_tanh(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous; shape: steepness."""
    return coulomb_viscous_tanh_torque(samples.velocity, *beta, *eta)


@_model(
    "[T_c + (T_b − T_c) exp(−|ω/ω_st|^δ)] sgn ω + d ω",
    (_BREAKAWAY, _COULOMB, _VISCOUS, _STRIBECK, _EXPONENTS[0]),
    "+++", _STRIBECK_SHAPE, _STRIBECK_EXPONENT, public=breakaway_first,
)  # fmt: skip
def stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: break-away over Coulomb, Coulomb, viscous; shape: Stribeck velocity and exponent."""
    level = stribeck_level(samples.velocity, beta[1], beta[0] + beta[1], *eta)
    return coulomb_viscous_torque(samples.velocity, level, beta[2])


@_model(
    "√(2e) (T_b − T_c) exp(−(ω/ω_c)²) ω/ω_c + T_c tanh(10 ω/ω_c) + d ω",
    _ROTATIONAL, "+++", _STRIBECK_SHAPE, public=breakaway_first,
)  # fmt: skip
def rotational(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: break-away over Coulomb, Coulomb, viscous; shape: break-away velocity."""
    return rotational_friction_torque(samples.velocity, beta[0] + beta[1], beta[1], eta[0], beta[2])


@_model(
    "√(2e) (T_b − T_c) exp(−(ω/ω_1)²) ω/ω_1 + T_c tanh(ω/ω_2) + d ω, "
    "ω_1 = √2 ω_b, ω_2 = ω_b/10",
    _ROTATIONAL, "+++", _STRIBECK_SHAPE, public=breakaway_first,
)  # fmt: skip
def rotational_simscape(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """As :func:`rotational`, with velocities √2 and 0.1 times the break-away velocity."""
    breakaway, velocities = beta[0] + beta[1], (math.sqrt(2.0) * eta[0], 0.1 * eta[0])
    return two_velocity_torque(samples.velocity, breakaway, beta[1], beta[2], *velocities)


@_model(
    "(T_c + c_l |T_L|) tanh(ω/ω_t) + d ω",
    (_COULOMB, _VISCOUS, _PER_LOAD, _TRANSITION), "+++", _TRANSITION_SHAPE, needs="load",
)  # fmt: skip
def load_dependent(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, Coulomb per load; shape: transition velocity."""
    coulomb, viscous, per_load = beta
    load, warm = _column(samples.load), REFERENCE_TEMPERATURE
    return conditioned_torque(samples.velocity, load, warm, coulomb, per_load, 0.0, viscous, 0.0, *eta)


@_model(
    "(T_c + c_ϑ Δϑ) tanh(ω/ω_t) + (d + d_ϑ Δϑ) ω, Δϑ = ϑ − 25 °C",
    (_COULOMB, _VISCOUS, *_PER_KELVIN, _TRANSITION), "++±±", _TRANSITION_SHAPE, needs="temperature",
)  # fmt: skip
def temperature_dependent(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, both per temperature; shape: transition velocity."""
    coulomb, viscous, *per_kelvin = beta
    load, warm = 0.0, _column(samples.temperature)
    parts = (coulomb, 0.0, per_kelvin[0], viscous, per_kelvin[1])
    return conditioned_torque(samples.velocity, load, warm, *parts, *eta)


@_model(
    "(T_c + c_l |T_L| + c_ϑ Δϑ) tanh(ω/ω_t) + (d + d_ϑ Δϑ) ω, Δϑ = ϑ − 25 °C",
    (_COULOMB, _VISCOUS, _PER_LOAD, *_PER_KELVIN, _TRANSITION), "+++±±", _TRANSITION_SHAPE,
    needs="load temperature",
)  # fmt: skip
def load_temperature_dependent(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, Coulomb per load, both per temperature; shape: transition velocity."""
    coulomb, viscous, *conditions = beta
    load, warm = _column(samples.load), _column(samples.temperature)
    parts = (coulomb, *conditions[:2], viscous, conditions[2])
    return conditioned_torque(samples.velocity, load, warm, *parts, *eta)


@_model(
    "T_0 + T_c tanh(ω/ω_t) + d± ω",
    (_COULOMB, *_BOTH_WAYS, _OFFSET, _TRANSITION), "+++±", _TRANSITION_SHAPE, two_way=True,
)  # fmt: skip
def asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous forward and backward, offset; shape: transition velocity."""
    coulomb, *both_ways, offset = beta
    viscous = directional_viscous_torque(samples.velocity, *both_ways, 1.0)
    return asymmetric_torque(samples.velocity, offset, coulomb, eta[0], viscous)


@_model(
    "T_0 + [T_c + (T_b − T_c) exp(−|ω/ω_st|^δ)] tanh(ω/ω_t) + d± |ω|^α sgn ω",
    (_BREAKAWAY, _COULOMB, *_BOTH_WAYS, _OFFSET, _TRANSITION, _STRIBECK, *_EXPONENTS), "++++±",
    _TRANSITION_SHAPE, _STRIBECK_SHAPE, _STRIBECK_EXPONENT, _VISCOUS_EXPONENT,
    public=breakaway_first, two_way=True,
)  # fmt: skip
def asymmetric_stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """As :func:`asymmetric`, with break-away over Coulomb first and the exponents behind."""
    excess, coulomb, *both_ways, offset = beta
    level = stribeck_level(samples.velocity, coulomb, coulomb + excess, *eta[1:3])
    viscous = directional_viscous_torque(samples.velocity, *both_ways, eta[3])
    return asymmetric_torque(samples.velocity, offset, level, eta[0], viscous)


@_model(
    "T_c tanh(ω/ω_t) + d ω + T_0 + C cos nθ + S sin nθ",
    (_COULOMB, _VISCOUS, _OFFSET, "ripple_cosine_Nm", "ripple_sine_Nm", _TRANSITION, _RIPPLE), "++±±±",
    _TRANSITION_SHAPE, _RIPPLE_SHAPE, needs="angle", two_way=True,
)  # fmt: skip
def position_ripple(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous, offset, cosine, sine; shape: transition velocity, ripples a turn."""
    coulomb, viscous, offset, cosine, sine = beta
    smooth = coulomb_viscous_tanh_torque(samples.velocity, coulomb, viscous, 1.0 / eta[0])
    return np.asarray(smooth + offset + ripple_torque(_column(samples.angle), cosine, sine, eta[1]))


@_model(
    "σ0 z + d ω, ż = ω − σ0 |ω| z / T_c",
    (_COULOMB, _VISCOUS, _BRISTLE_STIFFNESS), "++", _BRISTLE_SHAPE,
    public=dahl_reported, needs="period", dynamic=True,
)  # fmt: skip
def dahl(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, viscous; shape: stiffness over Coulomb."""
    rest = coulomb_viscous_torque(samples.velocity, 0.0, beta[1])
    return _bristles(samples, np.array([eta[0], 1.0, 1.0]), 1.0, (beta[0], 0.0), rest)


@_model(
    "σ0 z + σ1 ż + d ω, ż = ω − σ0 |ω| z / h, h = T_c + (T_b − T_c) exp(−(ω/ω_st)²)",
    (_BREAKAWAY, _COULOMB, _BRISTLE_DAMPING, _VISCOUS, _BRISTLE_STIFFNESS, _STRIBECK), "+++",
    _BRISTLE_SHAPE, _BREAKAWAY_RATIO, _STRIBECK_SHAPE, public=lugre_reported, needs="period", dynamic=True,
)  # fmt: skip
def lugre(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Coefficients: Coulomb, bristle damping, viscous; shape: two ratios to Coulomb, Stribeck velocity."""
    rest = coulomb_viscous_torque(samples.velocity, 0.0, beta[2])
    return _bristles(samples, eta, 2.0, (beta[0], beta[1]), rest)


@_model(
    "T_0 + σ0 z + σ1 ż + d± |ω|^α sgn ω, ż = ω − σ0 |ω| z / h, h = T_c + (T_b − T_c) exp(−|ω/ω_st|^δ)",
    (_BREAKAWAY, _COULOMB, _BRISTLE_DAMPING, *_BOTH_WAYS, _OFFSET,
     _BRISTLE_STIFFNESS, _STRIBECK, *_EXPONENTS),
    "++++±", _BRISTLE_SHAPE, _BREAKAWAY_RATIO, _STRIBECK_SHAPE, _STRIBECK_EXPONENT, _VISCOUS_EXPONENT,
    public=lugre_reported, needs="period", dynamic=True, two_way=True,
)  # fmt: skip
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


def _compiled(loop: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """A loop as machine code, made when it is first called."""
    compiled: Callable[..., np.ndarray] = bind(loop, ON_BITS, numba.njit)
    return compiled


def _column(values: np.ndarray | None) -> np.ndarray:
    assert values is not None  # models that need a column are offered only where it is
    return values


@_compiled
def bristle_deflection(
    velocity: np.ndarray, period: np.ndarray, fresh: np.ndarray, level: np.ndarray, stiffness: float
) -> np.ndarray:
    """Deflection of the bristles in [rad] at every sample, shape ``(n,)``.

    The velocity holds from the sample before to the sample. A test starts with straight bristles; what is
    left of another start is :func:`remembered_start`.

    ``velocity``: in [rad] / [s], shape ``(n,)`` as the next three. ``period``: since the sample before in
    [s]. ``fresh``: where a test starts; true at the first sample. ``level``: h of
    :func:`twin_gait.core.friction_models.bristle_rate` in [N m]. ``stiffness``: σ0 in [N m] / [rad].
    """
    deflection = np.empty(len(velocity))
    z = 0.0
    for i in range(len(velocity)):
        z = 0.0 if fresh[i] else bristle_step(velocity[i], z, level[i], stiffness, period[i])
        deflection[i] = z
    return deflection


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
