"""The friction models that can be fitted, by name, which of them samples can tell, and their starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.identification import laws
from twin_gait.identification.friction_model import Coefficient, FrictionModel, Scale, Shape
from twin_gait.identification.samples import Samples

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
ONE_WAY = 0.02  # share of the samples below which a direction was not measured
_ALL = (
    FrictionModel(
        name="coulomb_viscous",
        formula="F_c sgn ω + F_v ω",
        names=(_COULOMB, _VISCOUS),
        coefficients=(_POSITIVE, _POSITIVE),
        shape=(),
        torque=laws.coulomb_viscous,
        public=laws.as_fitted,
    ),
    FrictionModel(
        name="coulomb_viscous_tanh",
        formula="F_s tanh(k ω) + F_v ω",
        names=(_COULOMB, _VISCOUS, _STEEPNESS),
        coefficients=(_POSITIVE, _POSITIVE),
        shape=(Shape(low=1.0, high=1e4, scale=Scale.SLOWNESS),),
        torque=laws.coulomb_viscous_tanh,
        public=laws.as_fitted,
    ),
    FrictionModel(
        name="stribeck",
        formula="[F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)] sgn ω + F_v ω",
        names=(_BREAKAWAY, _COULOMB, _VISCOUS, _STRIBECK, _STRIBECK_EXPONENT),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_STRIBECK_SHAPE, _STRIBECK_EXPONENT_SHAPE),
        torque=laws.stribeck,
        public=laws.breakaway_first,
    ),
    FrictionModel(
        name="rotational",
        formula="√(2e) (a − b) exp(−(ω/c)²) ω/c + b tanh(10 ω/c) + d ω",
        names=(_BREAKAWAY, _COULOMB, _VISCOUS, _BREAKAWAY_VELOCITY),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_STRIBECK_SHAPE,),
        torque=laws.rotational,
        public=laws.breakaway_first,
    ),
    FrictionModel(
        name="rotational_simscape",
        formula="√(2e) (T_brk − T_C) exp(−(ω/ω_St)²) ω/ω_St + T_C tanh(ω/ω_Coul) + f ω, "
        "ω_St = √2 ω_brk, ω_Coul = ω_brk/10",
        names=(_BREAKAWAY, _COULOMB, _VISCOUS, _BREAKAWAY_VELOCITY),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_STRIBECK_SHAPE,),
        torque=laws.simscape,
        public=laws.breakaway_first,
    ),
    FrictionModel(
        name="load_dependent",
        formula="(F_c + F_l |T_L|) tanh(ω/ω_t) + F_v ω",
        names=(_COULOMB, _VISCOUS, "coulomb_per_load", _TRANSITION),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_TRANSITION_SHAPE,),
        torque=laws.load,
        public=laws.as_fitted,
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
        torque=laws.temperature,
        public=laws.as_fitted,
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
        torque=laws.load_temperature,
        public=laws.as_fitted,
        needs=frozenset({"load", "temperature"}),
    ),
    FrictionModel(
        name="asymmetric",
        formula="T_0 + F_c tanh(ω/ω_t) + F_v± ω",
        names=(_COULOMB, _FORWARD, _BACKWARD, _OFFSET, _TRANSITION),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE, _SIGNED),
        shape=(_TRANSITION_SHAPE,),
        torque=laws.asymmetric,
        two_way=True,
        public=laws.as_fitted,
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
        torque=laws.asymmetric_stribeck,
        two_way=True,
        public=laws.breakaway_first,
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
        torque=laws.ripple,
        two_way=True,
        public=laws.as_fitted,
        needs=frozenset({"angle"}),
    ),
    FrictionModel(
        name="dahl",
        formula="σ0 z + F_v ω, ż = ω − σ0 |ω| z / F_c",
        names=(_COULOMB, _VISCOUS, _BRISTLE_STIFFNESS),
        coefficients=(_POSITIVE, _POSITIVE),
        shape=(_BRISTLE_SHAPE,),
        torque=laws.dahl,
        public=laws.dahl_reported,
        needs=frozenset({"period"}),
        dynamic=True,
    ),
    FrictionModel(
        name="lugre",
        formula="σ0 z + σ1 ż + F_v ω, ż = ω − σ0 |ω| z / g, g = F_c + (F_s − F_c) exp(−(ω/ω_s)²)",
        names=(_BREAKAWAY, _COULOMB, _BRISTLE_DAMPING, _VISCOUS, _BRISTLE_STIFFNESS, _STRIBECK),
        coefficients=(_POSITIVE, _POSITIVE, _POSITIVE),
        shape=(_BRISTLE_SHAPE, _BREAKAWAY_RATIO, _STRIBECK_SHAPE),
        torque=laws.lugre,
        public=laws.lugre_reported,
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
        torque=laws.lugre_asymmetric,
        two_way=True,
        public=laws.lugre_reported,
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
    """What a model needs and the samples lack: columns that vary, or motion in both directions."""
    missing = tuple(name for name in sorted(model.needs) if not _varies(getattr(samples, name)))
    if model.two_way and rarer_direction(samples) < ONE_WAY:
        return (*missing, "motion in both directions")
    return missing


def _varies(values: np.ndarray | None) -> bool:
    return values is not None and len(values) > 0 and float(np.ptp(values)) > 1e-9


_STIFF = 1e6  # σ0/F_c at which a bristle slides at once: the static law
_ABRUPT = 1e-4  # share of the Stribeck velocity within which the direction changes: the law with sgn ω


def inherited_starts(name: str, fits: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """Parameter vectors that give a model the law of a simpler one."""
    found = []
    for parent, rule in _RULES.get(name, {}).items():
        if parent in fits:
            beta, eta = rule(*MODELS[parent].split(fits[parent]))
            found.append(np.concatenate([beta, np.log(eta)]))
    return found


_Rule = Callable[[np.ndarray, np.ndarray], tuple[list[float], list[float]]]


def _ratio(excess: float, coulomb: float) -> float:
    """F_s/F_c as far as LuGre's bounds have room for it."""
    return float(np.clip(1.0 + excess / coulomb, 0.1, 10.0)) if coulomb else 1.0


_RULES: Mapping[str, Mapping[str, _Rule]] = {
    "asymmetric": {
        "coulomb_viscous_tanh": lambda b, e: ([b[0], b[1], b[1], 0.0], [1.0 / e[0]]),
    },
    "asymmetric_stribeck": {
        "asymmetric": lambda b, e: ([0.0, *b], [e[0], 10.0 * e[0], 2.0, 1.0]),
        "stribeck": lambda b, e: ([b[0], b[1], b[2], b[2], 0.0], [_ABRUPT * e[0], *e, 1.0]),
    },
    "load_dependent": {
        "coulomb_viscous_tanh": lambda b, e: ([b[0], b[1], 0.0], [1.0 / e[0]]),
    },
    "temperature_dependent": {
        "coulomb_viscous_tanh": lambda b, e: ([b[0], b[1], 0.0, 0.0], [1.0 / e[0]]),
    },
    "load_temperature_dependent": {
        "load_dependent": lambda b, e: ([b[0], b[1], b[2], 0.0, 0.0], [e[0]]),
        "temperature_dependent": lambda b, e: ([b[0], b[1], 0.0, b[2], b[3]], [e[0]]),
    },
    "dahl": {
        "coulomb_viscous": lambda b, e: ([b[0], b[1]], [_STIFF]),
    },
    "lugre": {
        "dahl": lambda b, e: ([b[0], 0.0, b[1]], [e[0], 1.0, 1.0]),
        "stribeck": lambda b, e: ([b[1], 0.0, b[2]], [_STIFF, _ratio(b[0], b[1]), e[0]]),
    },
    "lugre_asymmetric": {
        "lugre": lambda b, e: ([b[0], b[1], b[2], b[2], 0.0], [*e, 2.0, 1.0]),
        "asymmetric_stribeck": lambda b, e: (
            [b[1], 0.0, b[2], b[3], b[4]],
            [_STIFF, _ratio(b[0], b[1]), e[1], e[2], e[3]],
        ),
    },
}
