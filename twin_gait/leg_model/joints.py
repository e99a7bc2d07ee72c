"""Names of the joints of a leg in a URDF, their positive directions, and the guides of the pelvis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twin_gait.parameters.quantities import Parameters
from twin_gait.vocabulary import JointName, PelvisGuide, Side

# Names of the pelvis joints in the model.
PELVIS_JOINT = "pelvis_vertical"  # translation upwards
FORWARD_JOINT = "pelvis_forward"  # translation forwards
PITCH_JOINT = "pelvis_pitch"  # rotation of the trunk
ALL_GUIDES = FORWARD_JOINT, PELVIS_JOINT, PITCH_JOINT
# Joints between world and pelvis, starting at the world; the pitch is positive if the trunk leans forward.
GUIDES = {
    PelvisGuide.FIXED: (),
    PelvisGuide.VERTICAL: (PELVIS_JOINT,),
    PelvisGuide.HARNESS: (FORWARD_JOINT, PELVIS_JOINT),
    PelvisGuide.STRAPS: ALL_GUIDES,
    PelvisGuide.FREE: ALL_GUIDES,
}

FORWARD = np.array([1.0, 0.0, 0.0])
# Rotations about the axis to the left, by the right-hand rule: hip flexion takes the thigh from down to
# forward, knee flexion the shank from down to backward, dorsiflexion the toes from forward to up.
_FLEXION = {JointName.HIP: -1.0, JointName.KNEE: 1.0, JointName.ANKLE: -1.0}
_SIDEWAYS = 0.5  # an axis more than 60° off the line from left to right gives no sign


class BodySelection(StrEnum):
    """Selection of the bodies that a model contains."""

    BOTH = "both"
    DEVICE = "device"
    WEARER = "wearer"


@dataclass(frozen=True, kw_only=True)
class LegJoints(Parameters):
    """Names of the joints and contact frames of one leg in the URDF.

    A minus in front of a joint's name, as in ``-KneeFE``, reverses the sign of its angle; a plus confirms the
    direction of the URDF. Without a sign the direction of the axis decides.

    Attributes:
        hip: Name of the hip flexion joint.
        knee: Name of the knee joint.
        ankle: Name of the ankle joint, or None.
        contact_frames: Names of the frames that touch the ground (heel, toe), if any.
    """

    hip: str
    knee: str
    ankle: str | None = None
    contact_frames: tuple[str, ...] = ()

    def items(self) -> tuple[tuple[JointName, str], ...]:
        """Return the joints that exist, from proximal to distal, with their names."""
        return self._items

    @cached_property
    def _items(self) -> tuple[tuple[JointName, str], ...]:
        names = zip(JointName, (self.hip, self.knee, self.ankle), strict=True)
        return tuple((joint, name) for joint, name in names if name is not None)

    @property
    def plain(self) -> LegJoints:
        """The same joints without signs in front of their names."""
        names: dict[str, Any] = {joint: name.lstrip("+-") for joint, name in self.items()}
        return replace(self, **names)


class ReversedJointWarning(UserWarning):
    """Warning that a joint of a URDF turns opposite to the convention of this package."""


def reversed_joints(
    path: Path, model: pin.Model, legs: Mapping[Side, LegJoints], up: np.ndarray
) -> tuple[frozenset[str], list[Warning]]:
    """Find the joints whose angle has to change its sign, so that flexion and dorsiflexion are positive.

    A minus in front of a name reverses the joint, a plus keeps it. Without a sign the joint's axis at zero
    posture decides, and a warning reports the decision, or that none is possible.

    ``path``: path of the URDF, for messages. ``model``: the model as in the URDF, x forward. ``up``: unit
    vector that points up, shape ``(3,)``. Returns the names of the joints to reverse, and the warnings.
    """
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    left = np.cross(up, FORWARD)
    found, doubts = set[str](), list[Warning]()
    for side, joint, given in ((side, *item) for side, leg in legs.items() for item in leg.items()):
        name = given.lstrip("+-")
        sign, problem, index = given.removesuffix(name), "", model.getJointId(name)
        jacobian = pin.getJointJacobian(model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        flexes = _FLEXION[joint] * float(left @ jacobian[3:, model.joints[index].idx_v])
        if not sign and flexes < -_SIDEWAYS:
            sign = "-"
            problem = (
                f"positive {name} extends the {joint}, so its sign is inverted; write {joint}: -{name} to "
                f"confirm this, or +{name} to keep the sign"
            )
        elif not sign and flexes <= _SIDEWAYS:
            problem = f"{name} has no axis from left to right; see leg.up_axis, or write +{name}"
        elif sign == "-" and flexes > _SIDEWAYS:
            problem = f"positive {given} extends the {joint}; write {name} unless this is intended"
        if sign == "-":
            found.add(name)
        if problem:
            doubts.append(ReversedJointWarning(f"{path}: {side} {joint}: {problem}"))
    return frozenset(found), doubts
