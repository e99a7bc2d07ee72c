"""The friction models that can be fitted, by name, which of them samples can tell, and their starts."""

from collections.abc import Callable, Mapping

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.identification import laws
from twin_gait.identification.friction_model import FrictionModel, Scale, Shape
from twin_gait.identification.samples import Samples

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
_TRANSITION_SHAPE = Shape(low=1e-4, high=1.0, scale=Scale.SPEED)
_STRIBECK_SHAPE = Shape(low=1e-3, high=10.0, scale=Scale.SPEED)
_STRIBECK_EXPONENT, _VISCOUS_EXPONENT = Shape(low=0.4, high=10.0), Shape(low=0.1, high=3.0)
_STEEPNESS_SHAPE = Shape(low=1.0, high=1e4, scale=Scale.SLOWNESS)
_RIPPLE_SHAPE = Shape(low=1.0, high=60.0, scale=Scale.TURN)
# σ0/F_c: the inverse of the deflection at which the bristles slide; F_s/F_c.
_BRISTLE_SHAPE = Shape(low=1e-5, high=1e5, scale=Scale.STIFFNESS)
_BREAKAWAY_RATIO = Shape(low=0.1, high=10.0, physical_low=1.0)
# Parameters that are positive and uncertain by a factor: their intervals are those of the logarithm.
LOGARITHMIC = frozenset(
    {_STRIBECK, _TRANSITION, *_EXPONENTS, _BREAKAWAY_VELOCITY, _STEEPNESS, _BRISTLE_STIFFNESS, _RIPPLE}
)
ONE_WAY = 0.02  # share of the samples below which a direction was not measured
_LOAD, _TEMPERATURE, _PERIOD = frozenset({"load"}), frozenset({"temperature"}), frozenset({"period"})
_ALL = (
    FrictionModel(
        "coulomb_viscous",
        "F_c sgn ω + F_v ω",
        (_COULOMB, _VISCOUS),
        "++",
        (),
        laws.coulomb_viscous,
        laws.as_fitted,
    ),
    FrictionModel(
        "coulomb_viscous_tanh",
        "F_s tanh(k ω) + F_v ω",
        (_COULOMB, _VISCOUS, _STEEPNESS),
        "++",
        (_STEEPNESS_SHAPE,),
        laws.coulomb_viscous_tanh,
        laws.as_fitted,
    ),
    FrictionModel(
        "stribeck",
        "[F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)] sgn ω + F_v ω",
        (_BREAKAWAY, _COULOMB, _VISCOUS, _STRIBECK, _EXPONENTS[0]),
        "+++",
        (_STRIBECK_SHAPE, _STRIBECK_EXPONENT),
        laws.stribeck,
        laws.breakaway_first,
    ),
    FrictionModel(
        "rotational",
        "√(2e) (a − b) exp(−(ω/c)²) ω/c + b tanh(10 ω/c) + d ω",
        _ROTATIONAL,
        "+++",
        (_STRIBECK_SHAPE,),
        laws.rotational,
        laws.breakaway_first,
    ),
    FrictionModel(
        "rotational_simscape",
        "√(2e) (T_brk − T_C) exp(−(ω/ω_St)²) ω/ω_St + T_C tanh(ω/ω_Coul) + f ω, "
        "ω_St = √2 ω_brk, ω_Coul = ω_brk/10",
        _ROTATIONAL,
        "+++",
        (_STRIBECK_SHAPE,),
        laws.simscape,
        laws.breakaway_first,
    ),
    FrictionModel(
        "load_dependent",
        "(F_c + F_l |T_L|) tanh(ω/ω_t) + F_v ω",
        (_COULOMB, _VISCOUS, _PER_LOAD, _TRANSITION),
        "+++",
        (_TRANSITION_SHAPE,),
        laws.load,
        laws.as_fitted,
        _LOAD,
    ),
    FrictionModel(
        "temperature_dependent",
        "(F_c + F_T Δϑ) tanh(ω/ω_t) + (F_v + F_vT Δϑ) ω, Δϑ = ϑ − 25 °C",
        (_COULOMB, _VISCOUS, *_PER_KELVIN, _TRANSITION),
        "++±±",
        (_TRANSITION_SHAPE,),
        laws.temperature,
        laws.as_fitted,
        _TEMPERATURE,
    ),
    FrictionModel(
        "load_temperature_dependent",
        "(F_c + F_l |T_L| + F_T Δϑ) tanh(ω/ω_t) + (F_v + F_vT Δϑ) ω, Δϑ = ϑ − 25 °C",
        (_COULOMB, _VISCOUS, _PER_LOAD, *_PER_KELVIN, _TRANSITION),
        "+++±±",
        (_TRANSITION_SHAPE,),
        laws.load_temperature,
        laws.as_fitted,
        _LOAD | _TEMPERATURE,
    ),
    FrictionModel(
        "asymmetric",
        "T_0 + F_c tanh(ω/ω_t) + F_v± ω",
        (_COULOMB, *_BOTH_WAYS, _OFFSET, _TRANSITION),
        "+++±",
        (_TRANSITION_SHAPE,),
        laws.asymmetric,
        laws.as_fitted,
        two_way=True,
    ),
    FrictionModel(
        "asymmetric_stribeck",
        "T_0 + [F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)] tanh(ω/ω_t) + F_v± |ω|^α sgn ω",
        (_BREAKAWAY, _COULOMB, *_BOTH_WAYS, _OFFSET, _TRANSITION, _STRIBECK, *_EXPONENTS),
        "++++±",
        (_TRANSITION_SHAPE, _STRIBECK_SHAPE, _STRIBECK_EXPONENT, _VISCOUS_EXPONENT),
        laws.asymmetric_stribeck,
        laws.breakaway_first,
        two_way=True,
    ),
    FrictionModel(
        "position_ripple",
        "F_c tanh(ω/ω_t) + F_v ω + T_0 + C cos nθ + S sin nθ",
        (_COULOMB, _VISCOUS, _OFFSET, "ripple_cosine_Nm", "ripple_sine_Nm", _TRANSITION, _RIPPLE),
        "++±±±",
        (_TRANSITION_SHAPE, _RIPPLE_SHAPE),
        laws.ripple,
        laws.as_fitted,
        frozenset({"angle"}),
        two_way=True,
    ),
    FrictionModel(
        "dahl",
        "σ0 z + F_v ω, ż = ω − σ0 |ω| z / F_c",
        (_COULOMB, _VISCOUS, _BRISTLE_STIFFNESS),
        "++",
        (_BRISTLE_SHAPE,),
        laws.dahl,
        laws.dahl_reported,
        _PERIOD,
        dynamic=True,
    ),
    FrictionModel(
        "lugre",
        "σ0 z + σ1 ż + F_v ω, ż = ω − σ0 |ω| z / g, g = F_c + (F_s − F_c) exp(−(ω/ω_s)²)",
        (_BREAKAWAY, _COULOMB, _BRISTLE_DAMPING, _VISCOUS, _BRISTLE_STIFFNESS, _STRIBECK),
        "+++",
        (_BRISTLE_SHAPE, _BREAKAWAY_RATIO, _STRIBECK_SHAPE),
        laws.lugre,
        laws.lugre_reported,
        _PERIOD,
        dynamic=True,
    ),
    FrictionModel(
        "lugre_asymmetric",
        "T_0 + σ0 z + σ1 ż + F_v± |ω|^α sgn ω, ż = ω − σ0 |ω| z / g, g = F_c + (F_s − F_c) exp(−|ω/ω_s|^δ)",
        (
            *(_BREAKAWAY, _COULOMB, _BRISTLE_DAMPING, *_BOTH_WAYS, _OFFSET),
            *(_BRISTLE_STIFFNESS, _STRIBECK, *_EXPONENTS),
        ),
        "++++±",
        (_BRISTLE_SHAPE, _BREAKAWAY_RATIO, _STRIBECK_SHAPE, _STRIBECK_EXPONENT, _VISCOUS_EXPONENT),
        laws.lugre_asymmetric,
        laws.lugre_reported,
        _PERIOD,
        dynamic=True,
        two_way=True,
    ),
)
MODELS = {model.name: model for model in _ALL}


def find_models(names: tuple[str, ...]) -> tuple[FrictionModel, ...]:
    """Look models up by their names, in their order; all without a name, a ParameterError for one of none."""
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

    def varies(values: np.ndarray | None) -> bool:
        return values is not None and len(values) > 0 and float(np.ptp(values)) > 1e-9

    missing = tuple(name for name in sorted(model.needs) if not varies(getattr(samples, name)))
    if model.two_way and rarer_direction(samples) < ONE_WAY:
        return (*missing, "motion in both directions")
    return missing


_STIFF = 1e6  # σ0/F_c at which a bristle slides at once: the static law
_ABRUPT = 1e-4  # share of the Stribeck velocity within which the direction changes: the law with sgn ω
_Rule = Callable[[np.ndarray, np.ndarray], tuple[list[float], list[float]]]


def _ratio(excess: float, coulomb: float) -> float:
    """F_s/F_c as far as LuGre's bounds have room for it."""
    return float(np.clip(1.0 + excess / coulomb, 0.1, 10.0)) if coulomb else 1.0


# By model and simpler one: from the parameters of the simpler one to those that give the same law.
_RULES: Mapping[tuple[str, str], _Rule] = {
    ("asymmetric", "coulomb_viscous_tanh"): lambda b, e: ([b[0], b[1], b[1], 0.0], [1.0 / e[0]]),
    ("asymmetric_stribeck", "asymmetric"): lambda b, e: ([0.0, *b], [e[0], 10.0 * e[0], 2.0, 1.0]),
    ("asymmetric_stribeck", "stribeck"): lambda b, e: (
        [b[0], b[1], b[2], b[2], 0.0],
        [_ABRUPT * e[0], *e, 1.0],
    ),
    ("load_dependent", "coulomb_viscous_tanh"): lambda b, e: ([b[0], b[1], 0.0], [1.0 / e[0]]),
    ("temperature_dependent", "coulomb_viscous_tanh"): lambda b, e: ([*b, 0.0, 0.0], [1.0 / e[0]]),
    ("load_temperature_dependent", "load_dependent"): lambda b, e: ([*b, 0.0, 0.0], [e[0]]),
    ("load_temperature_dependent", "temperature_dependent"): lambda b, e: (
        [b[0], b[1], 0.0, b[2], b[3]],
        [e[0]],
    ),
    ("dahl", "coulomb_viscous"): lambda b, e: ([*b], [_STIFF]),
    ("lugre", "dahl"): lambda b, e: ([b[0], 0.0, b[1]], [e[0], 1.0, 1.0]),
    ("lugre", "stribeck"): lambda b, e: ([b[1], 0.0, b[2]], [_STIFF, _ratio(b[0], b[1]), e[0]]),
    ("lugre_asymmetric", "lugre"): lambda b, e: ([b[0], b[1], b[2], b[2], 0.0], [*e, 2.0, 1.0]),
    ("lugre_asymmetric", "asymmetric_stribeck"): lambda b, e: (
        [b[1], 0.0, b[2], b[3], b[4]],
        [_STIFF, _ratio(b[0], b[1]), e[1], e[2], e[3]],
    ),
}


def inherited_starts(name: str, fits: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """Parameter vectors that give a model the law of a simpler one."""
    found = []
    for (model, parent), rule in _RULES.items():
        if model == name and parent in fits:
            beta, eta = rule(*MODELS[parent].split(fits[parent]))
            found.append(np.concatenate([beta, np.log(eta)]))
    return found
