"""A rigid-body model as plain numbers, for backends that do not use Pinocchio."""

from collections.abc import Sequence
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ModelError

# An exported number below this is a rounded zero; a model has grams and millimetres, not less.
_ROUNDING = 1e-13
_IDENTITY = np.eye(3)
_ROWS = 9  # number of rows of three numbers that describe a body


class BodyArrays(NamedTuple):
    """One body and the joint that carries it; entries are numbers, or symbols while a kernel is traced."""

    parent: int  # index of the parent body, -1 for the world
    prismatic: bool  # whether the joint slides instead of turning
    axis: Any  # axis of the joint in its own frame, shape ``(3,)``
    rotation: Any  # rotation of the joint frame in the parent frame at zero, shape ``(3, 3)``
    position: Any  # position of the joint frame in the parent frame in [m], shape ``(3,)``
    mass: Any  # mass in [kg]
    first_moment: Any  # mass times centre of mass in the joint frame in [kg·m], shape ``(3,)``
    inertia: Any  # inertia about the joint frame's origin in [kg·m²], shape ``(3, 3)``
    armature: Any  # inertia of the rotor at the joint
    name: str = ""  # name of the joint, from which a kernel names its results


class ContactPoint(NamedTuple):
    """A point of a body that may touch the ground."""

    body: int  # index of the body
    position: Any  # in the body's joint frame in [m], shape ``(3,)``
    forefoot: bool = False  # whether it belongs to the forefoot, not to the heel


def export_bodies(model: pin.Model) -> list[BodyArrays]:
    """Export a Pinocchio model of joints with one degree of freedom.

    A continuous joint is exported with its angle, although Pinocchio represents it by cosine and sine.

    Returns bodies in the order of the joints, so that ``q[i]`` moves body ``i``. Raises ModelError if a joint
    has more than one degree of freedom or is a helical or mimic joint.
    """
    rows: list[Any] = []
    rest = []
    for index in range(1, model.njoints):
        joint, placement, inertia = model.joints[index], model.jointPlacements[index], model.inertias[index]
        prismatic, axis = _axis(joint, model.names[index])
        lever, mass = np.asarray(inertia.lever), float(inertia.mass)
        shift = mass * (lever @ lever * _IDENTITY - lever[:, None] * lever)
        about_origin = np.asarray(inertia.inertia) + shift
        rows += [axis, *placement.rotation, placement.translation, mass * lever, *about_origin]
        armature = float(model.armature[joint.idx_v])
        rest.append((int(model.parents[index]) - 1, prismatic, mass, armature, str(model.names[index])))
    plain = iter(_plain(rows))  # one call for all rows, because it takes most of the time
    bodies = []
    for parent, prismatic, mass, armature, name in rest:
        axis, *rotation, position, first_moment, x, y, z = islice(plain, _ROWS)
        inertia = [x, y, z]
        bodies.append(
            BodyArrays(
                parent, prismatic, axis, rotation, position, mass, first_moment, inertia, armature, name
            )
        )
    return bodies


def _axis(joint: pin.JointModel, name: str) -> tuple[bool, list[float]]:
    """Return whether a joint slides, and its axis."""
    motion = np.asarray(joint.createData().S).ravel() if joint.nv == 1 else np.zeros(6)
    along, about = motion[:3].tolist(), motion[3:].tolist()
    if any(along) == any(about):
        kind = joint.shortname().removeprefix("JointModel")
        raise ModelError(f"joint {name!r} is a {kind}; expected a revolute or prismatic joint")
    return any(along), along if any(along) else about


def contact_points(model: pin.Model, frames: Sequence[str]) -> list[ContactPoint]:
    """Return the positions of the named frames of a foot on their bodies; the first one is the heel."""
    points = []
    for number, name in enumerate(frames):
        frame = model.frames[model.getFrameId(name)]
        position = _plain(frame.placement.translation)
        points.append(ContactPoint(int(frame.parentJoint) - 1, position, number > 0))
    return points


def _plain(values: Any) -> list[Any]:
    """Convert arrays to lists of numbers, with rounded zeros as zeros."""
    plain: list[Any] = np.where(np.abs(values) < _ROUNDING, 0.0, values).tolist()
    return plain
