"""The friction models that can be fitted: their laws, parameters and bounds.

Every model is linear in some of its parameters (torques, viscous coefficients) once the others (velocities,
exponents, ratios: its *shape*) are held. A fit works on the vector ``x``: the linear coefficients, then the
logarithms of the shape, which keeps velocities positive and gives the sign-normal form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numba
import numpy as np

from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.friction_models import (
    REFERENCE_TEMPERATURE,
    asymmetric_torque,
    conditioned_torque,
    coulomb_viscous_tanh_torque,
    coulomb_viscous_torque,
    directional_viscous_torque,
    lugre_torque,
    ripple_torque,
    stribeck_level,
    stribeck_torque,
    two_velocity_torque,
)
from twin_gait.exceptions import ParameterError
from twin_gait.identification.bristle import bristle_deflection, remembered_start, start_of
from twin_gait.identification.samples import Samples
from twin_gait.simulation.compiling import register_core


class Scale(StrEnum):
    """What the bounds of a shape parameter are multiples of."""

    NONE = "none"
    SPEED = "speed"  # the speed that 95 % of the samples stay below
    SLOWNESS = "slowness"  # its inverse
    STIFFNESS = "stiffness"  # inverse of the way from one sample to the next
    TURN = "turn"  # periods in a turn of the joint, such that the tests span one


@dataclass(frozen=True, kw_only=True)
class Coefficient:
    """A linear coefficient.

    Attributes:
        signed: Whether it may be negative in a physical friction.
    """

    signed: bool = False


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A parameter that enters non-linearly.

    Attributes:
        low: Lower bound, a multiple of the scale.
        high: Upper bound.
        scale: What the bounds are multiples of.
        physical_low: Lower bound of a physical friction; ``low`` if None.
    """

    low: float
    high: float
    scale: Scale = Scale.NONE
    physical_low: float | None = None


@dataclass(frozen=True, kw_only=True)
class FrictionModel:
    """A friction model.

    Attributes:
        name: As the user writes it.
        formula: In one line, for reports.
        names: Parameters as they are reported, with their units, in the order of ``public``.
        coefficients: Linear ones.
        shape: The others.
        torque: Law: samples, coefficients, shape -> torque in [N m], shape ``(n,)``.
        public: Coefficients and shape -> reported parameters; works on columns of many at once.
        needs: Columns of the samples, beyond speed and torque.
        dynamic: Whether it has a state.
        two_way: Whether it tells the directions apart, which samples of one direction cannot.
    """

    name: str
    formula: str
    names: tuple[str, ...]
    coefficients: tuple[Coefficient, ...]
    shape: tuple[Shape, ...]
    torque: Callable[[Samples, np.ndarray, np.ndarray], np.ndarray]
    public: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]
    needs: frozenset[str] = frozenset()
    dynamic: bool = False
    two_way: bool = False

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.coefficients) + len(self.shape)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients and shape of a vector, shape ``(size,)`` or ``(size, n)``."""
        count = len(self.coefficients)
        return x[:count], np.exp(x[count:])

    def predict(self, x: np.ndarray, samples: Samples) -> np.ndarray:
        """Friction torque in [N m] of a parameter vector, shape ``(n,)``."""
        return self.torque(samples, *self.split(x))

    def basis(self, shape: np.ndarray, samples: Samples) -> np.ndarray:
        """Torque by each coefficient, shape ``(n, n_coefficients)``: the law is linear in them."""
        units = np.eye(len(self.coefficients))[:, :, None]  # each coefficient a column: laws broadcast
        torques = np.asarray(self.torque(samples, units, shape))
        return (torques - self.constant(shape, samples)).T if self.dynamic else torques.T

    def constant(self, shape: np.ndarray, samples: Samples) -> np.ndarray:
        """Torque without any coefficient, shape ``(n,)``: what a test's start leaves in a state."""
        return np.asarray(self.torque(samples, np.zeros(len(self.coefficients)), shape))

    def parameters(self, x: np.ndarray) -> dict[str, float]:
        """Reported parameters of a vector."""
        values = self.public(*self.split(x))
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}


_POSITIVE, _SIGNED = Coefficient(), Coefficient(signed=True)
_COULOMB, _VISCOUS = "coulomb_friction_Nm", "viscous_friction_Nms_per_rad"
_BREAKAWAY, _STRIBECK = "breakaway_torque_Nm", "stribeck_velocity_rad_per_s"
_TRANSITION, _OFFSET = "transition_velocity_rad_per_s", "offset_Nm"
_BRISTLE_STIFFNESS, _BRISTLE_DAMPING = "bristle_stiffness_Nm_per_rad", "bristle_damping_Nms_per_rad"
_BREAKAWAY_VELOCITY = "breakaway_velocity_rad_per_s"
_STEEPNESS, _RIPPLE = "steepness_s_per_rad", "ripple_per_turn"
_FORWARD, _BACKWARD = "viscous_friction_forward_Nm", "viscous_friction_backward_Nm"
_STRIBECK_EXPONENT, _VISCOUS_EXPONENT = "stribeck_exponent", "viscous_exponent"
_TRANSITION_SHAPE = Shape(low=1e-4, high=1.0, scale=Scale.SPEED)
_STRIBECK_SHAPE = Shape(low=1e-3, high=10.0, scale=Scale.SPEED)
_STRIBECK_EXPONENT_SHAPE, _VISCOUS_EXPONENT_SHAPE = Shape(low=0.4, high=10.0), Shape(low=0.1, high=3.0)
# σ0/F_c: the inverse of the deflection at which the bristles slide; F_s/F_c.
_BRISTLE_SHAPE = Shape(low=1e-5, high=1e5, scale=Scale.STIFFNESS)
_BREAKAWAY_RATIO = Shape(low=0.1, high=10.0, physical_low=1.0)

# Parameters that are positive and uncertain by a factor: their intervals are those of the logarithm.
LOGARITHMIC = frozenset(
    {
        _STRIBECK,
        _TRANSITION,
        _STRIBECK_EXPONENT,
        _VISCOUS_EXPONENT,
        _BREAKAWAY_VELOCITY,
        _STEEPNESS,
        _BRISTLE_STIFFNESS,
        _RIPPLE,
    }
)


def _plain(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    return (*beta, *eta)


def _breakaway_first(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coefficients are break-away less Coulomb friction, and Coulomb friction."""
    return (beta[0] + beta[1], *beta[1:], *eta)


def _coulomb_viscous(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    return coulomb_viscous_torque(samples.velocity, beta[0], beta[1])


def _coulomb_viscous_tanh(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    return coulomb_viscous_tanh_torque(samples.velocity, beta[0], beta[1], eta[0])


def _stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    breakaway, coulomb, viscous = beta[0] + beta[1], beta[1], beta[2]
    return stribeck_torque(samples.velocity, coulomb, breakaway, viscous, eta[0], eta[1])


@lru_cache(maxsize=1)
def _law_of_the_engines() -> Callable[..., np.ndarray]:
    """Equation (3.1) over arrays: the very function that a simulation feels, compiled to run over samples."""
    register_core()
    law: Callable[..., np.ndarray] = numba.vectorize(rotational_friction_torque)
    return law


def _rotational(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    breakaway, coulomb, viscous = beta[0] + beta[1], beta[1], beta[2]
    return np.asarray(_law_of_the_engines()(samples.velocity, breakaway, coulomb, eta[0], viscous))


def _simscape(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    return two_velocity_torque(
        samples.velocity, beta[0] + beta[1], beta[1], beta[2], math.sqrt(2.0) * eta[0], 0.1 * eta[0]
    )


def _load(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    cold = np.full(len(samples), REFERENCE_TEMPERATURE)
    return conditioned_torque(
        samples.velocity, _column(samples.load), cold, beta[0], beta[2], 0.0, beta[1], 0.0, eta[0]
    )


def _temperature(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    unloaded, warm = np.zeros(len(samples)), _column(samples.temperature)
    return conditioned_torque(
        samples.velocity, unloaded, warm, beta[0], 0.0, beta[2], beta[1], beta[3], eta[0]
    )


def _load_temperature(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    return conditioned_torque(
        samples.velocity,
        _column(samples.load),
        _column(samples.temperature),
        beta[0],
        beta[2],
        beta[3],
        beta[1],
        beta[4],
        eta[0],
    )


def _asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    coulomb, forward, backward, offset = beta
    return asymmetric_torque(
        samples.velocity, offset, coulomb, coulomb, forward, backward, eta[0], 1.0, 1.0, 1.0
    )


def _asymmetric_stribeck(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    excess, coulomb, forward, backward, offset = beta
    return asymmetric_torque(samples.velocity, offset, coulomb, coulomb + excess, forward, backward, *eta)


def _ripple(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    coulomb, viscous, offset, cosine, sine = beta
    smooth = coulomb_viscous_tanh_torque(samples.velocity, coulomb, viscous, 1.0 / eta[0])
    return np.asarray(smooth + offset + ripple_torque(_column(samples.angle), cosine, sine, eta[1]))


def _sliding(samples: Samples, eta: np.ndarray, exponent: float) -> tuple[np.ndarray, np.ndarray]:
    """Bristle torque and bristle rate at a Coulomb friction of 1 N m."""
    stiffness, ratio, stribeck_velocity = eta
    velocity = samples.velocity
    level = stribeck_level(velocity, 1.0, ratio, stribeck_velocity, exponent)
    z = bristle_deflection(velocity, _column(samples.period), samples.fresh, level, stiffness)
    return stiffness * z, velocity - stiffness * np.abs(velocity) / level * z


def _slid(
    samples: Samples, eta: np.ndarray, exponent: float, sliding: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Bristle torque and the rest, with what is left of each test's start.

    How the bristles were bent at the start is not known; the first torque of the test, less what is not
    theirs, tells.
    """
    stiffness, ratio, stribeck_velocity = eta
    level = stribeck_level(samples.velocity, 1.0, ratio, stribeck_velocity, exponent)
    left = remembered_start(samples.velocity, _column(samples.period), samples.fresh, level, stiffness)
    origin = start_of(samples.fresh)
    return np.asarray(sliding + rest + left * (samples.torque[origin] - rest[..., origin]))


def _dahl(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    coulomb, viscous = beta
    shape = np.array([eta[0], 1.0, 1.0])
    bristles, rate = _sliding(samples, shape, 1.0)
    sliding = lugre_torque(samples.velocity, bristles, rate, coulomb, 0.0, 0.0)
    return _slid(samples, shape, 1.0, sliding, coulomb_viscous_torque(samples.velocity, 0.0, viscous))


def _lugre(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    coulomb, damping, viscous = beta
    bristles, rate = _sliding(samples, eta, 2.0)
    sliding = lugre_torque(samples.velocity, bristles, rate, coulomb, damping, 0.0)
    return _slid(samples, eta, 2.0, sliding, coulomb_viscous_torque(samples.velocity, 0.0, viscous))


def _lugre_asymmetric(samples: Samples, beta: np.ndarray, eta: np.ndarray) -> np.ndarray:
    coulomb, damping, forward, backward, offset = beta
    bristles, rate = _sliding(samples, eta[:3], eta[3])
    sliding = lugre_torque(samples.velocity, bristles, rate, coulomb, damping, 0.0)
    rest = offset + directional_viscous_torque(samples.velocity, forward, backward, eta[4])
    return _slid(samples, eta[:3], eta[3], sliding, rest)


def _dahl_public(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    return (*beta, eta[0] * beta[0])


def _lugre_public(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    coulomb = beta[0]
    return (eta[1] * coulomb, *beta, eta[0] * coulomb, *eta[2:])


def _column(values: np.ndarray | None) -> np.ndarray:
    assert values is not None  # models that need a column are offered only where it is
    return values


ONE_WAY = 0.02  # share of the samples below which a direction was not measured

_ALL = (
    FrictionModel(
        name="coulomb_viscous",
        formula="F_c sgn ω + F_v ω",
        names=(_COULOMB, _VISCOUS),
        coefficients=(_POSITIVE, _POSITIVE),
        shape=(),
        torque=_coulomb_viscous,
        public=_plain,
    ),
    FrictionModel(
        name="coulomb_viscous_tanh",
        formula="F_s tanh(k ω) + F_v ω",
        names=(_COULOMB, _VISCOUS, _STEEPNESS),
        coefficients=(_POSITIVE, _POSITIVE),
        shape=(Shape(low=1.0, high=1e4, scale=Scale.SLOWNESS),),
        torque=_coulomb_viscous_tanh,
        public=_plain,
    ),
    FrictionModel(
        name="stribeck",
        formula="[F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)] sgn ω + F_v ω",
        names=(_BREAKAWAY, _COULOMB, _VISCOUS, _STRIBECK, _STRIBECK_EXPONENT),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_STRIBECK_SHAPE, _STRIBECK_EXPONENT_SHAPE),
        torque=_stribeck,
        public=_breakaway_first,
    ),
    FrictionModel(
        name="rotational",
        formula="√(2e) (a − b) exp(−(ω/c)²) ω/c + b tanh(10 ω/c) + d ω",
        names=(_BREAKAWAY, _COULOMB, _VISCOUS, _BREAKAWAY_VELOCITY),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_STRIBECK_SHAPE,),
        torque=_rotational,
        public=_breakaway_first,
    ),
    FrictionModel(
        name="rotational_simscape",
        formula="√(2e) (T_brk − T_C) exp(−(ω/ω_St)²) ω/ω_St + T_C tanh(ω/ω_Coul) + f ω, "
        "ω_St = √2 ω_brk, ω_Coul = ω_brk/10",
        names=(_BREAKAWAY, _COULOMB, _VISCOUS, _BREAKAWAY_VELOCITY),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_STRIBECK_SHAPE,),
        torque=_simscape,
        public=_breakaway_first,
    ),
    FrictionModel(
        name="load_dependent",
        formula="(F_c + F_l |T_L|) tanh(ω/ω_t) + F_v ω",
        names=(_COULOMB, _VISCOUS, "coulomb_per_load", _TRANSITION),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_TRANSITION_SHAPE,),
        torque=_load,
        public=_plain,
        needs=frozenset({"load"}),
    ),
    FrictionModel(
        name="temperature_dependent",
        formula="(F_c + F_T Δϑ) tanh(ω/ω_t) + (F_v + F_vT Δϑ) ω, Δϑ = ϑ − 25 °C",
        names=(
            _COULOMB,
            _VISCOUS,
            "coulomb_per_temperature_Nm_per_K",
            "viscous_per_temperature_Nms_per_radK",
            _TRANSITION,
        ),
        coefficients=(_POSITIVE, _POSITIVE, _SIGNED, _SIGNED),
        shape=(_TRANSITION_SHAPE,),
        torque=_temperature,
        public=_plain,
        needs=frozenset({"temperature"}),
    ),
    FrictionModel(
        name="load_temperature_dependent",
        formula="(F_c + F_l |T_L| + F_T Δϑ) tanh(ω/ω_t) + (F_v + F_vT Δϑ) ω, Δϑ = ϑ − 25 °C",
        names=(
            _COULOMB,
            _VISCOUS,
            "coulomb_per_load",
            "coulomb_per_temperature_Nm_per_K",
            "viscous_per_temperature_Nms_per_radK",
            _TRANSITION,
        ),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE, _SIGNED, _SIGNED),
        shape=(_TRANSITION_SHAPE,),
        torque=_load_temperature,
        public=_plain,
        needs=frozenset({"load", "temperature"}),
    ),
    FrictionModel(
        name="asymmetric",
        formula="T_0 + F_c tanh(ω/ω_t) + F_v± ω",
        names=(_COULOMB, _FORWARD, _BACKWARD, _OFFSET, _TRANSITION),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE, _SIGNED),
        shape=(_TRANSITION_SHAPE,),
        torque=_asymmetric,
        two_way=True,
        public=_plain,
    ),
    FrictionModel(
        name="asymmetric_stribeck",
        formula="T_0 + [F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)] tanh(ω/ω_t) + F_v± |ω|^α sgn ω",
        names=(
            _BREAKAWAY,
            _COULOMB,
            _FORWARD,
            _BACKWARD,
            _OFFSET,
            _TRANSITION,
            _STRIBECK,
            _STRIBECK_EXPONENT,
            _VISCOUS_EXPONENT,
        ),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE, _POSITIVE, _SIGNED),
        shape=(
            _TRANSITION_SHAPE,
            _STRIBECK_SHAPE,
            _STRIBECK_EXPONENT_SHAPE,
            _VISCOUS_EXPONENT_SHAPE,
        ),
        torque=_asymmetric_stribeck,
        two_way=True,
        public=_breakaway_first,
    ),
    FrictionModel(
        name="position_ripple",
        formula="F_c tanh(ω/ω_t) + F_v ω + T_0 + C cos nθ + S sin nθ",
        names=(
            _COULOMB,
            _VISCOUS,
            _OFFSET,
            "ripple_cosine_Nm",
            "ripple_sine_Nm",
            _TRANSITION,
            _RIPPLE,
        ),
        coefficients=(_POSITIVE, _POSITIVE, _SIGNED, _SIGNED, _SIGNED),
        shape=(_TRANSITION_SHAPE, Shape(low=1.0, high=60.0, scale=Scale.TURN)),
        torque=_ripple,
        two_way=True,
        public=_plain,
        needs=frozenset({"angle"}),
    ),
    FrictionModel(
        name="dahl",
        formula="σ0 z + F_v ω, ż = ω − σ0 |ω| z / F_c",
        names=(_COULOMB, _VISCOUS, _BRISTLE_STIFFNESS),
        coefficients=(_POSITIVE, _POSITIVE),
        shape=(_BRISTLE_SHAPE,),
        torque=_dahl,
        public=_dahl_public,
        needs=frozenset({"period"}),
        dynamic=True,
    ),
    FrictionModel(
        name="lugre",
        formula="σ0 z + σ1 ż + F_v ω, ż = ω − σ0 |ω| z / g, g = F_c + (F_s − F_c) exp(−(ω/ω_s)²)",
        names=(_BREAKAWAY, _COULOMB, _BRISTLE_DAMPING, _VISCOUS, _BRISTLE_STIFFNESS, _STRIBECK),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_BRISTLE_SHAPE, _BREAKAWAY_RATIO, _STRIBECK_SHAPE),
        torque=_lugre,
        public=_lugre_public,
        needs=frozenset({"period"}),
        dynamic=True,
    ),
    FrictionModel(
        name="lugre_asymmetric",
        formula="T_0 + σ0 z + σ1 ż + F_v± |ω|^α sgn ω, ż = ω − σ0 |ω| z / g, "
        "g = F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)",
        names=(
            _BREAKAWAY,
            _COULOMB,
            _BRISTLE_DAMPING,
            _FORWARD,
            _BACKWARD,
            _OFFSET,
            _BRISTLE_STIFFNESS,
            _STRIBECK,
            _STRIBECK_EXPONENT,
            _VISCOUS_EXPONENT,
        ),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE, _POSITIVE, _SIGNED),
        shape=(
            _BRISTLE_SHAPE,
            _BREAKAWAY_RATIO,
            _STRIBECK_SHAPE,
            _STRIBECK_EXPONENT_SHAPE,
            _VISCOUS_EXPONENT_SHAPE,
        ),
        torque=_lugre_asymmetric,
        two_way=True,
        public=_lugre_public,
        needs=frozenset({"period"}),
        dynamic=True,
    ),
)
MODELS = {model.name: model for model in _ALL}


def find_models(names: tuple[str, ...]) -> tuple[FrictionModel, ...]:
    """Look models up.

    Args:
        names: As the user wrote them; empty for all.

    Returns:
        The models, in the order of the names.

    Raises:
        ParameterError: If there is no model of a name.
    """
    for name in names:
        if name not in MODELS:
            raise ParameterError(f"model: no {name!r}; there are {', '.join(MODELS)}")
    return tuple(MODELS[name] for name in dict.fromkeys(names)) if names else tuple(MODELS.values())


def rarer_direction(samples: Samples) -> float:
    """Share of the moving samples that move in the rarer direction."""
    way = np.sign(samples.velocity[samples.used])
    moving = max(int((way != 0.0).sum()), 1)
    return float(min((way > 0.0).sum(), (way < 0.0).sum())) / moving


def missing_columns(model: FrictionModel, samples: Samples) -> tuple[str, ...]:
    """What a model needs and the samples lack: columns that vary, or motion in both directions.

    Args:
        model: The model.
        samples: The samples.

    Returns:
        Names of the columns, or ``motion in both directions``.
    """
    missing = tuple(name for name in sorted(model.needs) if not _varies(getattr(samples, name)))
    if model.two_way and rarer_direction(samples) < ONE_WAY:
        return (*missing, "motion in both directions")
    return missing


def _varies(values: np.ndarray | None) -> bool:
    return values is not None and len(values) > 0 and float(np.ptp(values)) > 1e-9
