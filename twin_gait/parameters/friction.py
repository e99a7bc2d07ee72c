"""Friction of the joints."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from twin_gait.parameters.checks import require, require_non_negative


@dataclass(frozen=True, kw_only=True)
class FrictionParameters:
    """Parameters of the rotational friction law, equation (3.1) of the thesis.

    Attributes:
        breakaway_torque: a in [N m].
        coulomb_friction: b in [N m].
        breakaway_velocity: c in [rad] / [s].
        viscous_friction: d in [N m s] / [rad].
    """

    breakaway_torque: float
    coulomb_friction: float
    breakaway_velocity: float
    viscous_friction: float

    def __post_init__(self) -> None:
        """Check the ranges.

        The law is odd: a, b, c may all be negative together (table 3.1 prints the knee so). The
        friction must not inject power, which non-negative normalised parameters and a dip that
        stays above zero guarantee; :meth:`normalised` brings them to that form first.
        """
        require(
            math.isfinite(self.breakaway_velocity) and self.breakaway_velocity != 0.0,
            "breakaway_velocity",
            "a number other than 0",
            self.breakaway_velocity,
        )
        sign = math.copysign(1.0, self.breakaway_velocity)
        require_non_negative("breakaway_torque (with the sign of c)", sign * self.breakaway_torque)
        require_non_negative("coulomb_friction (with the sign of c)", sign * self.coulomb_friction)
        require_non_negative("viscous_friction", self.viscous_friction)
        # With a < b the law dips near c/√2, where tanh(10/√2) lacks 1.4e-6 to 1: a and d must make up for it.
        law = self.normalised()
        floor = law.breakaway_torque + law.viscous_friction * law.breakaway_velocity / math.sqrt(2.0)
        require(
            floor >= 2e-6 * law.coulomb_friction,
            "breakaway_torque",
            "some breakaway or viscous friction, without which the dip of the law drives the joint",
            self.breakaway_torque,
        )

    def normalised(self) -> FrictionParameters:
        """Return the same law with a, b and c positive."""
        if self.breakaway_velocity > 0.0:
            return self
        return replace(
            self,
            breakaway_torque=-self.breakaway_torque,
            coulomb_friction=-self.coulomb_friction,
            breakaway_velocity=-self.breakaway_velocity,
        )

    def scaled(self, ratio: float) -> FrictionParameters:
        """Return the law multiplied by a ratio, for a plant with other friction than the model.

        Args:
            ratio: Plant friction over model friction, 0 or more.
        """
        require_non_negative("friction ratio", ratio)
        return replace(
            self,
            breakaway_torque=ratio * self.breakaway_torque,
            coulomb_friction=ratio * self.coulomb_friction,
            viscous_friction=ratio * self.viscous_friction,
        )


# Table 3.1 of the thesis, as printed. The knee's a, b and c are all negative there: the same law
# as (1.743, 3.193, 0.2031). In both joints a < b, which the Simscape block that the law comes from
# would refuse; it is kept because it is what was measured between 0 and 0.6 rad/s.
KNEE_FRICTION = FrictionParameters(
    breakaway_torque=-1.743, coulomb_friction=-3.193, breakaway_velocity=-0.2031, viscous_friction=2.06
)
HIP_FRICTION = FrictionParameters(
    breakaway_torque=1.664, coulomb_friction=4.2, breakaway_velocity=0.2252, viscous_friction=2.26
)

# Load-dependent gear friction, over the load: that of a geared servo, 0.148 (Duclusaud et al. 2025),
# rounded up. That of TWIN has not been measured; it is the most that a table is tried with.
HIGHEST_LOAD_FRICTION = 0.15
