"""Which way the joints of a URDF turn, and joints that turn the other way."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twin_gait.leg_model.joints import LegJoints
from twin_gait.vocabulary import JointName, Side

FORWARD = np.array([1.0, 0.0, 0.0])
# About the axis to the left, by the right-hand rule: hip flexion takes the thigh from down to forward, knee
# flexion the shank from down to backward, dorsiflexion the toes from forward to up.
_FLEXION = {JointName.HIP: -1.0, JointName.KNEE: 1.0, JointName.ANKLE: -1.0}
_SIDEWAYS = 0.5  # an axis more than 60° off the line from left to right tells no sign


class ReversedJointWarning(UserWarning):
    """A joint of a URDF turns the other way than this package counts."""


def plain_names(legs: Mapping[Side, LegJoints]) -> dict[Side, LegJoints]:
    """Joint names without the sign in front of them."""
    names: dict[Side, dict[str, Any]]
    names = {side: {joint: name.lstrip("+-") for joint, name in leg.items()} for side, leg in legs.items()}
    return {side: replace(leg, **names[side]) for side, leg in legs.items()}


def reversed_joints(
    path: Path, model: pin.Model, legs: Mapping[Side, LegJoints], up: np.ndarray
) -> frozenset[str]:
    """Joints whose angle has to change its sign, so that flexion and dorsiflexion are positive.

    A minus in front of a name says that it has to, a plus that it has not. Without a sign the joint's axis at
    zero posture decides, and a warning says so, or that it cannot.

    ``path``: of the URDF, for messages. ``model``: as the URDF has it, x forward. ``up``: unit vector that
    points up, shape ``(3,)``.
    """
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    left = np.cross(up, FORWARD)
    found = set()
    for side, joint, given in ((side, *item) for side, leg in legs.items() for item in leg.items()):
        name = given.lstrip("+-")
        sign, problem, index = given.removesuffix(name), "", model.getJointId(name)
        jacobian = pin.getJointJacobian(model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        flexes = _FLEXION[joint] * float(left @ jacobian[3:, model.joints[index].idx_v])
        if not sign and flexes < -_SIDEWAYS:
            sign = "-"
            problem = (
                f"positive {name} extends the {joint}, so it is taken as -{name}; write {joint}: -{name} "
                f"to say so, or +{name} to keep it"
            )
        elif not sign and flexes <= _SIDEWAYS:
            problem = f"{name} has no axis from left to right; see leg.up_axis, or write +{name}"
        elif sign == "-" and flexes > _SIDEWAYS:
            problem = f"positive {given} extends the {joint}; write {name} unless that is meant"
        if sign == "-":
            found.add(name)
        if problem:
            warnings.warn(f"{path}: {side} {joint}: {problem}", ReversedJointWarning, stacklevel=1)
    return frozenset(found)
