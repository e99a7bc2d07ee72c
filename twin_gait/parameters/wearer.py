"""Parameters of the wearer."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName, SegmentModel, Sex, Side

# Shank over body height: Drillis and Contini, in Winter (2009), fig. 4.1.
SHANK_LENGTH = 0.246

# From a child of one to two years to a person who is twice as heavy as the subjects of the segment tables.
MASSES = quantities.Range(10.0, 160.0, words="10 to 160 kg")
HEIGHTS = quantities.Range(0.70, 2.20, words="0.70 to 2.20 m")
AGES = quantities.Range(0.0, 130.0, words="0 to 130 years")
NOISES = quantities.Range(0.0, 5.0, reason="five times the effort itself")
CONTRACTURES = quantities.Range(0.0, math.radians(60.0), words=f"0 to {math.radians(60.0):.3f} rad (60 deg)")

# Joints with torques of the wearer: the passive moments of Riener and Edrich (1999) and the efforts.
WEARER_JOINTS = (JointName.HIP, JointName.KNEE)


@dataclass(frozen=True, kw_only=True)
class JointCondition(quantities.Parameters):
    """Torques of the wearer at one joint; see :mod:`twin_gait.core.wearer_torques`. The default has none.

    Attributes:
        passive: Share of the passive moment of healthy men (Riener and Edrich 1999).
        contracture: Contracture in [rad]: the passive moment at an angle is that of a healthy joint that is
            extended further by the contracture.
        stretch_reflex_threshold: Speed above which a spastic muscle resists, in [rad/s].
        stretch_reflex_gain: Gain of the stretch reflex in [N·m·s/rad]; 0 without spasticity.
        effort: Share of the normative moment that the wearer intends to produce.
        strength: Share of this moment that the muscles can produce; less than 1 is weakness.
    """

    passive: Annotated[quantities.Ratio, quantities.Range(0.0, 3.0, words="0 to 3")] = 0.0
    contracture: Annotated[quantities.Angle, CONTRACTURES] = 0.0
    stretch_reflex_threshold: Annotated[quantities.AngularVelocity, quantities.NOT_NEGATIVE] = 1.0
    stretch_reflex_gain: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 0.0
    effort: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    strength: Annotated[quantities.Ratio, quantities.SHARE] = 1.0

    def __post_init__(self) -> None:
        """Check the ranges, and that there is a passive moment if there is a contracture."""
        super().__post_init__()
        expected = "0 if passive is 0, because there is no passive moment that it could shift"
        require(self.contracture == 0.0 or self.passive > 0.0, "contracture", expected, self.contracture)

    @property
    def is_torque_free(self) -> bool:
        """Whether the wearer produces no torque at this joint."""
        return self.passive == 0.0 and self.stretch_reflex_gain == 0.0 and self.effort * self.strength == 0.0


PLAIN_NAME = "a name of 1 to 80 printable characters, without / and \\, that does not begin with a dot"


def is_plain_name(name: Any) -> bool:
    """Return whether a name can be printed on one line and be the name of a folder."""
    plain = isinstance(name, str) and 0 < len(name) <= 80 and name.isprintable()
    return plain and not name.startswith(".") and not set(name) & set("/\\")


@dataclass(frozen=True, kw_only=True)
class Patient(quantities.Parameters):
    """The wearer.

    The shipped gaits were tuned for a wearer without any torques of their own, so that is the default.

    Attributes:
        mass: Mass in [kg]. Outside the range of the segment table's subjects it is extrapolated
            (:func:`twin_gait.leg_model.anthropometry.wearer_notes`).
        height: Height in [m]; extrapolated as the mass is.
        sex: Sex for the segment tables of de Leva (1996).
        segment_model: Source of the table of segments; that of Winter (2009) is the same for both sexes.
        conditions: Conditions of hips and knees; a joint that is not named has no torques.
        effort_delay: Delay from phase and posture to the torque of the effort, in [s].
        effort_noise: Standard deviation of the effort's torque from tick to tick, as a share of it.
        name: Name of the person, kept when values are changed; None for a wearer without a name.
        age: Age in years, which is compared with that of the healthy reference; None if it is not known.
    """

    mass: Annotated[quantities.Mass, MASSES] = 70.0
    height: Annotated[quantities.Length, HEIGHTS] = 1.75
    sex: Sex = Sex.MALE
    segment_model: SegmentModel = SegmentModel.DE_LEVA
    conditions: Annotated[Mapping[tuple[Side, JointName], JointCondition], quantities.CustomSerialized()] = (
        field(default_factory=dict)
    )
    effort_delay: Annotated[quantities.Time, quantities.Range(0.0, 1.0, words="0 to 1 s")] = 0.1
    effort_noise: Annotated[quantities.Ratio, NOISES] = 0.0
    name: str | None = None
    age: Annotated[quantities.Age | None, AGES] = None

    def __post_init__(self) -> None:
        """Check ranges, joints and the name."""
        super().__post_init__()
        require(self.name is None or is_plain_name(self.name), "name", PLAIN_NAME, self.name)
        for side, joint in self.conditions:
            require(joint in WEARER_JOINTS, f"condition of the {side} {joint}", "a hip or a knee", joint)

    def __hash__(self) -> int:
        """Hash the values that determine the rigid bodies."""
        return hash((self.mass, self.height, self.sex, self.segment_model))

    @property
    def is_torque_free(self) -> bool:
        """Whether the wearer produces no torque at any joint."""
        return all(item.is_torque_free for item in self.conditions.values())
