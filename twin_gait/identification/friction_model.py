"""What a friction model is: a law over samples, its parameters and their bounds.

Every model is linear in some of its parameters (torques, viscous coefficients) once the others (velocities,
exponents, ratios: its *shape*) are held. A fit works on the vector ``x``: the linear coefficients, then the
logarithms of the shape, which keeps velocities positive and gives the sign-normal form.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin_gait.identification.samples import Samples

_DIFFERENCE = 1e-5  # step of the central differences in the logarithm of a shape parameter


def unscaled(samples: Samples) -> float:
    """A bound is what it says."""
    return 1.0


@dataclass(frozen=True)
class Shape:
    """A parameter that enters non-linearly."""

    name: str  # of the parameter that is reported in its place, with its unit
    low: float  # lower bound, a multiple of the scale
    high: float  # upper bound
    scale: Callable[[Samples], float] = unscaled  # what the bounds are multiples of
    physical_low: float | None = None  # lower bound of a physical friction; ``low`` if None
    by_factor: bool = True  # whether what is reported is uncertain by a factor: an interval of its logarithm


def as_fitted(beta: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Reported as they are fitted."""
    return (*beta, *eta)


@dataclass(frozen=True)
class FrictionModel:
    """A friction model."""

    name: str  # as the user writes it
    formula: str  # in one line, for reports
    coefficients: tuple[str, ...]  # parameters that enter linearly, as they are reported with their units
    shape: tuple[Shape, ...]  # the others
    # law: samples, coefficients, shape -> torque in [N m], shape ``(n,)``
    torque: Callable[[Samples, np.ndarray, np.ndarray], np.ndarray]
    # coefficients and shape -> reported parameters; works on columns of many at once
    public: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]] = as_fitted
    needs: tuple[str, ...] = ()  # columns of the samples, beyond speed and torque
    dynamic: bool = False  # whether it has a state
    two_way: bool = False  # whether it tells the directions apart, which samples of one direction cannot

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of ``public``."""
        return (*self.coefficients, *(item.name for item in self.shape))

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

    def errors(self, x: np.ndarray, samples: Samples) -> np.ndarray:
        """Predicted less measured torque of the samples that are used, in [N m], shape ``(n_used,)``."""
        return np.asarray((self.predict(x, samples) - samples.torque)[samples.used])

    def jacobian(self, x: np.ndarray, samples: Samples) -> np.ndarray:
        """Derivative of the errors by the parameter vector, shape ``(n_used, size)``.

        Exact for the linear coefficients, by central differences for the logarithms of the shape.
        """
        count = len(self.coefficients)
        columns = [self.basis(np.exp(x[count:]), samples)[samples.used]]
        for place in range(count, self.size):
            step = np.zeros(self.size)
            step[place] = _DIFFERENCE
            change = self.predict(x + step, samples) - self.predict(x - step, samples)
            columns.append((change[samples.used] / (2.0 * _DIFFERENCE))[:, None])
        return np.concatenate(columns, axis=1)

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
