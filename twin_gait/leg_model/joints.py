"""How the joints of a leg are called in a URDF, and how the pelvis is held."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from twin_gait.parameters.quantities import Parameters
from twin_gait.vocabulary import JointName, PelvisGuide

# Joints of the pelvis in the model.
PELVIS_JOINT = "pelvis_vertical"  # up
FORWARD_JOINT = "pelvis_forward"  # forwards
PITCH_JOINT = "pelvis_pitch"  # of the trunk
ALL_GUIDES = FORWARD_JOINT, PELVIS_JOINT, PITCH_JOINT
# Joints between world and pelvis, from the world on; the pitch is positive as the trunk leans forward.
GUIDES = {
    PelvisGuide.FIXED: (),
    PelvisGuide.VERTICAL: (PELVIS_JOINT,),
    PelvisGuide.HARNESS: (FORWARD_JOINT, PELVIS_JOINT),
    PelvisGuide.FREE: ALL_GUIDES,
}


class Bodies(StrEnum):
    """Whose bodies a model has."""

    BOTH = "both"
    DEVICE = "device"
    WEARER = "wearer"


@dataclass(frozen=True, kw_only=True)
class LegJoints(Parameters):
    """Names of the joints and contact frames of one leg in the URDF.

    A minus in front of a joint's name, as in ``-KneeFE``, counts its angle the other way; a plus says that
    the URDF's way is meant. Without a sign the direction of the axis decides.

    Attributes:
        hip: Name of the hip flexion joint.
        knee: Name of the knee joint.
        ankle: Name of the ankle joint, or None.
        contact_frames: Names of the frames that touch the ground (heel, toe), maybe none.
    """

    hip: str
    knee: str
    ankle: str | None = None
    contact_frames: tuple[str, ...] = ()

    def items(self) -> list[tuple[JointName, str]]:
        """Joints that exist, from proximal to distal."""
        names = zip(JointName, (self.hip, self.knee, self.ankle), strict=True)
        return [(joint, name) for joint, name in names if name is not None]
