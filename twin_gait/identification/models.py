"""Which friction models samples can tell, and starts of their fits from simpler ones."""

from collections.abc import Callable, Mapping

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.identification.friction_model import FrictionModel
from twin_gait.identification.laws import MODELS
from twin_gait.identification.samples import Samples

ONE_WAY = 0.02  # share of the samples below which a direction was not measured


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


_STIFF = 1e6  # σ0/T_c at which a bristle slides at once: the static law
_ABRUPT = 1e-4  # share of the Stribeck velocity within which the direction changes: the law with sgn ω
_Rule = Callable[[np.ndarray, np.ndarray], tuple[list[float], list[float]]]


def _ratio(excess: float, coulomb: float) -> float:
    """T_b/T_c as far as LuGre's bounds have room for it."""
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
