"""Measured gait with which the gait of a run is compared."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from twin_gait.measures.strides import PERCENT
from twin_gait.parameters.quantities import POSITIVE, require
from twin_gait.vocabulary import JointName


@dataclass(frozen=True, kw_only=True)
class ReferenceGait:
    """Mean stride of measured people, which replaces the regression of Koopman et al. (2014).

    Attributes:
        source: Files, task and people from which the curves were computed.
        strides: Number of strides.
        subjects: Number of people.
        cycle_time: Mean duration of a stride in [s], or None if it is not known.
        mean: Mean angle of each joint at every percent of the stride from heel strike in [rad].
        sd: Standard deviation of each joint in [rad]: between people or, for one person, between strides;
            empty for one stride.
    """

    source: str
    strides: int
    subjects: int
    cycle_time: float | None = None
    mean: Mapping[JointName, tuple[float, ...]]
    sd: Mapping[JointName, tuple[float, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the numbers."""
        require(bool(self.mean), "mean", "the curve of a joint", dict(self.mean))
        if self.cycle_time is not None:
            POSITIVE.require("cycle_time", self.cycle_time)
        expected = f"{len(PERCENT)} finite numbers"
        for name, curves in (("mean", self.mean), ("sd", self.sd)):
            for joint, curve in curves.items():
                whole = len(curve) == len(PERCENT) and bool(np.isfinite(curve).all())
                require(whole, f"{name}.{joint}", expected, len(curve))

    def angles(self, joint: JointName) -> np.ndarray | None:
        """Return the mean angle of a joint at ``PERCENT`` in [rad], shape ``(101,)``, or None."""
        return np.array(self.mean[joint]) if joint in self.mean else None

    def deviation(self, joint: JointName) -> np.ndarray | None:
        """Return the standard deviation of a joint at ``PERCENT`` in [rad], shape ``(101,)``, or None."""
        return np.array(self.sd[joint]) if joint in self.sd else None
