"""Braces between wearer and device."""

from __future__ import annotations

import math
from dataclasses import dataclass

from twin_gait.parameters.checks import require_non_negative, require_positive
from twin_gait.vocabulary import JointName


@dataclass(frozen=True, kw_only=True)
class SpringDamper:
    """A linear spring with a damper beside it.

    Attributes:
        stiffness: In [N m] / [rad], or [N] / [m] where the coordinate slides.
        damping: In [N m s] / [rad], or [N s] / [m].
    """

    stiffness: float
    damping: float

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive("stiffness", self.stiffness)
        require_non_negative("damping", self.damping)


@dataclass(frozen=True, kw_only=True)
class BraceParameters:
    """Braces that bind the wearer to the device: a spring and a damper between their coordinates.

    No measurement of this device is known, all sizes are assumptions: a cuff of 10 kN/m at 0.25 m
    from the hip and at 0.2 m from the knee gives some degrees of play at the torques of the motors; the
    foot stands strapped on its plate, and belts hold the pelvis. The dampers give a wearer of 70 kg a third
    of critical damping, and the foot three quarters.

    Attributes:
        pelvis: Between the waist and the pelvis, vertical.
        hip: Of each hip.
        knee: Of each knee.
        ankle: Of each ankle.
    """

    pelvis: SpringDamper = SpringDamper(stiffness=20e3, damping=400.0)
    hip: SpringDamper = SpringDamper(stiffness=600.0, damping=20.0)
    knee: SpringDamper = SpringDamper(stiffness=400.0, damping=8.0)
    ankle: SpringDamper = SpringDamper(stiffness=1000.0, damping=3.0)

    def stiffened(self, factor: float) -> BraceParameters:
        """The same braces, stiffer, with the same share of critical damping.

        Args:
            factor: Of the stiffness; the dampers grow by its root.

        Returns:
            The braces.
        """

        def stiffer(item: SpringDamper) -> SpringDamper:
            return SpringDamper(
                stiffness=factor * item.stiffness, damping=math.sqrt(max(factor, 0.0)) * item.damping
            )

        return BraceParameters(
            pelvis=stiffer(self.pelvis),
            hip=stiffer(self.hip),
            knee=stiffer(self.knee),
            ankle=stiffer(self.ankle),
        )

    def of(self, joint: JointName) -> SpringDamper:
        """Brace of a joint."""
        return {JointName.HIP: self.hip, JointName.KNEE: self.knee, JointName.ANKLE: self.ankle}[joint]
