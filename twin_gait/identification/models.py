"""Friction models, and the samples of speed and friction torque, test by test, to which they are fitted.

Every model is linear in some of its parameters (torques, viscous coefficients) once the others (velocities,
exponents, ratios: its *shape*) are held. A fit works on the vector ``x``: the linear coefficients, then the
logarithms of the shape, which keeps velocities positive and gives the sign-normal form.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

PATH_FACTOR = 8
LONGEST_GAP = 10.0  # samples; a longer gap in a test restarts the state of a dynamic model


@dataclass(frozen=True, eq=False)
class FrictionTest:
    """One test after its processing."""

    name: str  # name of the file
    velocity: np.ndarray  # joint velocity in [rad/s], shape ``(n,)``
    torque: np.ndarray  # friction torque in [N·m] with the sign of the velocity, shape ``(n,)``
    # Samples that a fit may use, shape ``(n,)``; the others only update the state of dynamic models.
    used: np.ndarray
    # Time in [s], shape ``(n,)``; None if the file has none. A new record begins where time goes back.
    time: np.ndarray | None = None
    angle: np.ndarray | None = None  # joint angle in [rad], or None
    load: np.ndarray | None = None  # load torque in [N·m], or None
    motor_rate: np.ndarray | None = None  # rate of the motor's torque at the joint in [N·m/s], or None
    temperature: np.ndarray | None = None  # temperature in [°C], or None
    mass: float | None = None  # weight on the link in [kg], or None
    # Number of samples that were read, used, and rejected by cause.
    counts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # remarks on the reading of the file

    def __len__(self) -> int:
        return len(self.velocity)

    @property
    def from_bench(self) -> bool:
        """Whether the torque is a balance of torques on a bench, not a column of the file."""
        return "after_decimation" in self.counts


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one or more tests in one row of arrays, each of shape ``(n,)``."""

    velocity: np.ndarray  # joint velocity in [rad/s]
    torque: np.ndarray  # friction torque in [N·m]
    used: np.ndarray  # whether each sample counts
    test: np.ndarray  # index of the test
    fresh: np.ndarray  # whether the state of a dynamic model restarts at each sample
    period: np.ndarray | None = None  # time since the sample before in [s]; None if a test has no time
    time: np.ndarray | None = None  # time from the start of each test in [s], or None
    angle: np.ndarray | None = None  # angle in [rad]; None unless all tests have it, like the next two
    load: np.ndarray | None = None  # load torque in [N·m]
    temperature: np.ndarray | None = None  # temperature in [°C]

    def __len__(self) -> int:
        return len(self.velocity)

    @property
    def rarer_direction(self) -> float:
        """Share of the moving samples that move in the rarer direction."""
        way = np.sign(self.velocity[self.used])
        moving = max(int((way != 0.0).sum()), 1)
        return float(min((way > 0.0).sum(), (way < 0.0).sum())) / moving

    def rows(self, chosen: np.ndarray) -> Samples:
        """Select samples by a mask or indices; a dynamic model needs whole tests."""
        columns = {name: None if values is None else values[chosen] for name, values in vars(self).items()}
        return Samples(**cast("dict[str, Any]", columns))

    def used_only(self) -> Samples:
        """Return the samples that count, for models without a state."""
        return self if self.used.all() else self.rows(self.used)


def join_tests(tests: Sequence[FrictionTest]) -> Samples:
    """Concatenate tests; a quantity that one of them lacks is left out."""

    def joined(column: str) -> Any:
        columns = [getattr(test, column) for test in tests]
        return None if any(values is None for values in columns) else np.concatenate(columns)

    number = np.repeat(np.arange(len(tests)), [len(test) for test in tests])
    fresh, time = np.concatenate([_fresh(test) for test in tests]), joined("time")
    return Samples(
        test=number,
        fresh=fresh,
        period=None if time is None else np.where(fresh, 0.0, np.diff(time, prepend=time[:1])),
        time=None if time is None else time - time[np.searchsorted(number, number)],
        **{name: joined(name) for name in ("velocity", "torque", "used", "angle", "load", "temperature")},
    )


def thinned_path(samples: Samples, limit: int) -> Samples:
    """Reduce the number of samples for a model with a state, but keep the path between them."""
    path = thinned(samples, PATH_FACTOR * limit)
    counted = np.flatnonzero(path.used)
    chosen = counted[:: max(-(-len(counted) // limit), 1)]
    return replace(path, used=np.isin(np.arange(len(path)), chosen))


def thinned(samples: Samples, limit: int) -> Samples:
    """Take samples at even intervals, so that a fit of millions takes no longer than one of thousands."""
    step = -(-len(samples) // limit)
    if step <= 1:
        return samples
    kept = np.arange(0, len(samples), step)
    chosen = samples.rows(kept)
    piece = np.cumsum(samples.fresh)[kept]
    fresh = np.concatenate([[True], np.diff(piece) > 0])
    period = None
    if samples.period is not None:
        elapsed = np.cumsum(samples.period)[kept]
        period = np.where(fresh, 0.0, np.diff(elapsed, prepend=elapsed[0]))
    return replace(chosen, fresh=fresh, period=period)


def _fresh(test: FrictionTest) -> np.ndarray:
    """Determine where a record begins: at the first sample, after a gap, and where time goes back."""
    fresh = np.zeros(len(test), dtype=bool)
    fresh[:1] = True
    if len(test) > 2 and test.time is not None:
        steps = np.diff(test.time)
        forward = steps[steps > 0.0]  # a coarse clock repeats its times
        gap = LONGEST_GAP * float(np.median(forward)) if len(forward) else np.inf
        fresh[1:] = (steps > gap) | (steps < 0.0)
    return fresh


_DIFFERENCE = 1e-5  # step of the central differences in the logarithm of a shape parameter


@dataclass(frozen=True)
class ShapeParameter:
    """Parameter that enters non-linearly."""

    name: str  # name of the reported parameter, with its unit
    low: float  # lower bound, a multiple of the scale
    high: float  # upper bound, a multiple of the scale
    scale: Callable[[Samples], float] = lambda samples: 1.0  # scale of the bounds
    physical_low: float | None = None  # lower bound of a physical friction; ``low`` if None
    log_interval: bool = True  # whether the reported parameter has an interval of its logarithm


@dataclass(frozen=True)
class FrictionModel:
    """Friction model: its law, its parameters and the columns that it needs."""

    name: str  # name in options and reports
    formula: str  # formula in one line, for reports
    coefficients: tuple[str, ...]  # reported names, with units, of the parameters that enter linearly
    shape: tuple[ShapeParameter, ...]  # the other parameters
    # Law: samples, coefficients, shape -> torque in [N·m], shape ``(n,)``.
    torque: Callable[[Samples, np.ndarray, np.ndarray], np.ndarray]
    # Conversion of coefficients and shape to reported parameters; accepts many of them as columns.
    to_reported: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]] = lambda beta, eta: (*beta, *eta)
    needs: tuple[str, ...] = ()  # columns of the samples, beyond speed and torque
    dynamic: bool = False  # whether it has a state

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of ``public``."""
        return (*self.coefficients, *(item.name for item in self.shape))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.coefficients) + len(self.shape)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split a vector of shape ``(size,)`` or ``(size, n)`` into coefficients and shape."""
        count = len(self.coefficients)
        return x[:count], np.exp(x[count:])

    def predict(self, x: np.ndarray, samples: Samples) -> np.ndarray:
        """Compute the friction torque in [N·m] of a parameter vector, shape ``(n,)``."""
        return self.torque(samples, *self.split(x))

    def errors(self, x: np.ndarray, samples: Samples) -> np.ndarray:
        """Compute predicted less measured torque of the used samples, in [N·m], shape ``(n_used,)``."""
        return np.asarray((self.predict(x, samples) - samples.torque)[samples.used])

    def jacobian(self, x: np.ndarray, samples: Samples) -> np.ndarray:
        """Compute the derivative of the errors by the parameter vector, shape ``(n_used, size)``.

        Exact for the linear coefficients, by central differences for the logarithms of the shape.
        """
        count = len(self.coefficients)
        columns = [self.basis(np.exp(x[count:]), samples)[samples.used]]
        for index in range(count, self.size):
            step = np.zeros(self.size)
            step[index] = _DIFFERENCE
            change = self.predict(x + step, samples) - self.predict(x - step, samples)
            columns.append((change[samples.used] / (2.0 * _DIFFERENCE))[:, None])
        return np.concatenate(columns, axis=1)

    def basis(self, shape: np.ndarray, samples: Samples) -> np.ndarray:
        """Compute the torque by each coefficient, shape ``(n, n_coefficients)``; it is linear in them."""
        units = np.eye(len(self.coefficients))[:, :, None]  # one column for each coefficient; laws broadcast
        torques = np.asarray(self.torque(samples, units, shape))
        return (torques - self.constant(shape, samples)).T if self.dynamic else torques.T

    def constant(self, shape: np.ndarray, samples: Samples) -> np.ndarray:
        """Compute the torque without any coefficient, shape ``(n,)``: effect of a test's initial state."""
        return np.asarray(self.torque(samples, np.zeros(len(self.coefficients)), shape))

    def parameters(self, x: np.ndarray) -> dict[str, float]:
        """Return the reported parameters of a vector."""
        values = self.to_reported(*self.split(x))
        return {name: float(value) for name, value in zip(self.names, values, strict=True)}
