"""Parts of a device on the segments of a wearer, for a device that is no complete leg."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait.parameters import quantities
from twin_gait.vocabulary import Side


class BodySegment(StrEnum):
    """Segment of the wearer that carries a part of the device."""

    PELVIS = "pelvis"
    LEFT_THIGH = "left_thigh"
    LEFT_SHANK = "left_shank"
    LEFT_FOOT = "left_foot"
    RIGHT_THIGH = "right_thigh"
    RIGHT_SHANK = "right_shank"
    RIGHT_FOOT = "right_foot"


def segments_of(side: Side) -> tuple[BodySegment, BodySegment, BodySegment]:
    """Return thigh, shank and foot of a leg."""
    thigh, shank, foot = (BodySegment(f"{side}_{name}") for name in ("thigh", "shank", "foot"))
    return thigh, shank, foot


@dataclass(frozen=True, kw_only=True)
class AddedMass(quantities.Parameters):
    """Mass of a part of the device on a segment.

    Attributes:
        mass: Mass in [kg].
        along: Position of its centre of mass along the segment, from 0 at the proximal joint to 1 at the
            distal one; of a foot from heel to toe; above the hips as a share of the trunk.
        forward: Distance of the centre of mass in front of the line of the segment in [m].
        radius_of_gyration: Radius of gyration about the centre of mass in [m].
    """

    mass: Annotated[quantities.Mass, quantities.NOT_NEGATIVE]
    along: Annotated[quantities.Ratio, quantities.Range(-1.0, 2.0, words="-1 to 2")] = 0.5
    forward: quantities.Length = 0.0
    radius_of_gyration: Annotated[quantities.Length, quantities.NOT_NEGATIVE] = 0.05


@dataclass(frozen=True, kw_only=True)
class Attachment(quantities.Parameters):
    """Parts of a device on the segments of the wearer, and segments that a prosthesis replaces.

    Attributes:
        masses: Masses on the segments.
        replaced: Share of the mass of the wearer's own segment that is missing, 1 for a segment that the
            device replaces; a part of the thigh keeps centre and radius of gyration of the whole.
    """

    masses: Mapping[BodySegment, AddedMass] = field(default_factory=dict)
    replaced: Annotated[Mapping[BodySegment, quantities.Ratio], quantities.SHARE] = field(
        default_factory=dict
    )

    def __hash__(self) -> int:
        """Hash the parts, so that equal models can be shared."""
        return hash((tuple(self.masses.items()), tuple(self.replaced.items())))
