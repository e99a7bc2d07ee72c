"""Parameters of the friction of the joints."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, ClassVar

from twin_gait.core.friction import ASYMMETRIC, BRISTLE, FRICTIONLESS, ROTATIONAL, PlantFriction
from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import declarations, require

EXPONENTS = quantities.Range(0.0, 10.0, exclusive_minimum=True, reason="fits of joints have 0.3 to 4")


# The deflection of stiffer bristles is below the finest encoder resolution; the step size determines whether
# they can be integrated.
BRISTLES = quantities.Range(0.0, 1e9, exclusive_minimum=True, reason="4 N·m bend them by 4 nrad")


class _FrictionLaw(quantities.Parameters):
    tag = "law"

    def scaled(self, ratio: float) -> FrictionLaw:
        """Return the law multiplied by a ratio, for a plant with other friction than the model.

        ``ratio``: plant friction over model friction, 0 or more. The displacement until bristles slide is
        unchanged.
        """
        quantities.NOT_NEGATIVE.require("friction ratio", ratio)
        # Parameters with newtons in their unit are proportional to the friction; velocities and exponents are
        # not.
        units = {item.name: next(iter(item.keys)) for item in declarations(type(self))}
        given = {name: getattr(self, name) for name, key in units.items() if "_Nm" in key}
        changes = {name: ratio * value for name, value in given.items() if value is not None}
        scaled: FrictionLaw = replace(self, **changes)  # type: ignore[type-var, assignment]
        return scaled


@dataclass(frozen=True, kw_only=True)
class FrictionParameters(_FrictionLaw):
    """Parameters of the rotational friction law, equation (3.1) of the thesis.

    Attributes:
        breakaway_torque: Break-away torque a in [N·m].
        coulomb_friction: Coulomb friction b in [N·m].
        breakaway_velocity: Break-away velocity c in [rad/s].
        viscous_friction: Viscous friction d in [N·m·s/rad].
    """

    kind = "rotational"
    breakaway_torque: quantities.Torque
    coulomb_friction: quantities.Torque
    breakaway_velocity: quantities.AngularVelocity
    viscous_friction: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE]

    def __post_init__(self) -> None:
        """Check the ranges.

        The law is odd: a, b, c may all be negative together (table 3.1 prints the knee in this form). The
        friction must not inject power, which is guaranteed by non-negative normalised parameters and a dip
        that stays above zero; :meth:`normalised` brings them to that form first.
        """
        super().__post_init__()
        speed = self.breakaway_velocity
        require(speed != 0.0, "breakaway_velocity", "a number other than 0", speed)
        law = self.normalised()
        for name in ("breakaway_torque", "coulomb_friction"):
            quantities.NOT_NEGATIVE.require(f"{name} (with the sign of c)", getattr(law, name))
        # The law dips near c/√2 if a < b; there tanh(10/√2) is 1.4e-6 below 1, so a and d must compensate it.
        floor = law.breakaway_torque + law.viscous_friction * law.breakaway_velocity / math.sqrt(2.0)
        expected = "more breakaway or viscous friction, so that the law drives the joint at no speed"
        require(floor >= 2e-6 * law.coulomb_friction, "breakaway_torque", expected, self.breakaway_torque)

    def normalised(self) -> FrictionParameters:
        """Return the same law with a, b and c positive."""
        if self.breakaway_velocity > 0.0:
            return self
        changes = {name: -getattr(self, name) for name in ("breakaway_torque", "coulomb_friction")}
        return replace(self, **changes, breakaway_velocity=-self.breakaway_velocity)

    def to_plant_friction(self, gear_efficiency: float = 1.0) -> PlantFriction:
        """Return the record of the friction in the plant.

        ``gear_efficiency``: efficiency of the gear under load, in addition to the friction.
        """
        law = self.normalised()
        given = (law.breakaway_torque, law.coulomb_friction, law.viscous_friction, gear_efficiency - 1.0)
        return PlantFriction(
            law=ROTATIONAL if any(given) else FRICTIONLESS,
            breakaway_torque=law.breakaway_torque,
            coulomb_friction=law.coulomb_friction,
            stribeck_velocity=law.breakaway_velocity,
            viscous_friction_forward=law.viscous_friction,
            viscous_friction_backward=law.viscous_friction,
            gear_efficiency=gear_efficiency,
        )


NO_FRICTION = FrictionParameters(
    breakaway_torque=0.0, coulomb_friction=0.0, breakaway_velocity=1.0, viscous_friction=0.0
)


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(_FrictionLaw):
    """Common parameters of laws with a Stribeck curve and a separate viscous friction in each direction.

    The Coulomb friction is T_c + T_0 forwards and T_c - T_0 backwards: a difference of the Coulomb friction
    between the directions is the same as an offset.

    Attributes:
        coulomb_friction: Coulomb friction T_c in [N·m].
        breakaway_torque: Break-away torque T_b in [N·m]; None for T_c, without a Stribeck effect.
        stribeck_velocity: Stribeck velocity ω_st in [rad/s]; None if there is no break-away torque.
        stribeck_exponent: Exponent δ of the Stribeck curve, often 2.
        viscous_friction_forward: Viscous friction d+ forwards in [N·m] at 1 rad/s.
        viscous_friction_backward: Viscous friction d- backwards in [N·m] at 1 rad/s.
        viscous_exponent: Exponent α of the viscous friction, 1 for linear friction.
        offset: Offset T_0 in [N·m].
    """

    law: ClassVar[int]
    coulomb_friction: Annotated[quantities.Torque, quantities.POSITIVE]
    breakaway_torque: Annotated[quantities.Torque | None, quantities.POSITIVE] = None
    stribeck_velocity: Annotated[quantities.AngularVelocity | None, quantities.POSITIVE] = None
    stribeck_exponent: Annotated[quantities.Ratio, EXPONENTS] = 2.0
    viscous_friction_forward: Annotated[quantities.Torque, quantities.NOT_NEGATIVE] = 0.0
    viscous_friction_backward: Annotated[quantities.Torque, quantities.NOT_NEGATIVE] = 0.0
    viscous_exponent: Annotated[quantities.Ratio, EXPONENTS] = 1.0
    offset: quantities.Torque = 0.0

    def __post_init__(self) -> None:
        """Check the ranges: no law may accelerate a joint that slides."""
        super().__post_init__()
        paired = (self.breakaway_torque is None) == (self.stribeck_velocity is None)
        expected = "both stribeck_velocity and breakaway_torque, or neither"
        require(paired, "stribeck_velocity", expected, self.stribeck_velocity)
        least = min(self.coulomb_friction, self.breakaway_torque or self.coulomb_friction)
        expected = f"less than the {least:g} N·m to which it is added, with either sign"
        require(abs(self.offset) < least, "offset", expected, self.offset)

    def scaled(self, ratio: float) -> FrictionLaw:
        """Return the law multiplied by a ratio; with 0 it is :data:`NO_FRICTION`."""
        return NO_FRICTION if ratio == 0.0 else super().scaled(ratio)

    def to_plant_friction(self, gear_efficiency: float = 1.0) -> PlantFriction:
        """Convert to the record of the plant, see :meth:`FrictionParameters.to_plant_friction`."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        given: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
        if self.breakaway_torque is None:
            # This has no effect on the law; checks treat a joint as creeping up to this speed, as up to c of
            # (3.1).
            speed = 10.0 * given.get("transition_velocity", 1e-3)
            given |= {"breakaway_torque": self.coulomb_friction, "stribeck_velocity": speed}
        return PlantFriction(law=self.law, gear_efficiency=gear_efficiency, **given)


@dataclass(frozen=True, kw_only=True)
class AsymmetricFriction(StribeckFriction):
    """A static law with separate directions, :func:`twin_gait.core.friction_models.asymmetric_torque`.

    A static law does not hold a joint: it creeps, with an offset by itself at ω_t artanh(T_0 / T_b).

    Attributes:
        transition_velocity: Velocity ω_t in [rad/s], within which the torque changes its direction.
    """

    kind: ClassVar[str] = "asymmetric"
    law: ClassVar[int] = ASYMMETRIC
    transition_velocity: Annotated[quantities.AngularVelocity, quantities.POSITIVE]


@dataclass(frozen=True, kw_only=True)
class LuGreFriction(StribeckFriction):
    """Bristles between the teeth: a joint sticks, springs back and breaks away.

    The model of Canudas de Wit et al. (1995), where δ is 2 and σ2 the same in both directions. Without
    break-away torque and bristle damping it is Dahl's model (1968); see
    :func:`twin_gait.core.friction.friction_torque`.

    Attributes:
        bristle_stiffness: Stiffness σ0 of the bristles in [N·m/rad].
        bristle_damping: Damping σ1 of the bristles in [N·m·s/rad].
    """

    kind: ClassVar[str] = "lugre"
    law: ClassVar[int] = BRISTLE
    bristle_stiffness: Annotated[quantities.RotaryStiffness, BRISTLES]
    bristle_damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 0.0


FrictionLaw = FrictionParameters | AsymmetricFriction | LuGreFriction  # Law of a joint.
