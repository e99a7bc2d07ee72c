"""Starts that a model takes over from simpler ones that it contains."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from twin_gait.identification.fitting import Fit

_STIFF = 1e6  # σ0/F_c at which a bristle slides at once: the static law
_ABRUPT = 1e-4  # share of the Stribeck velocity within which the direction changes: the law with sgn ω


def inherited_starts(name: str, fits: Mapping[str, Fit]) -> list[np.ndarray]:
    """Parameter vectors that give a model the law of a simpler one.

    Args:
        name: Of the model.
        fits: Fits of models by name.

    Returns:
        Vectors of that model; none if it has no simpler one among the fits.
    """
    rules = _RULES.get(name, {})
    found = []
    for parent, rule in rules.items():
        if parent in fits:
            beta, eta = fits[parent].model.split(fits[parent].x)
            new_beta, new_eta = rule(beta, np.asarray(eta))
            found.append(np.concatenate([new_beta, np.log(new_eta)]))
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
