"""Checks whether the segments of a leg in a URDF can belong to a device or a person."""

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from twin_gait.exceptions import ModelError
from twin_gait.leg_model.joints import LegJoints
from twin_gait.leg_model.urdf_document import UrdfWarning, joint_elements, mimic_joints, urdf_document
from twin_gait.vocabulary import Side

# The range extends from the orthosis of an infant to more than the thigh of the tallest known person: 2.72 m
# tall, a quarter of it thigh. Lengths in centimetres or millimetres lie outside.
SHORTEST_SEGMENT, LONGEST_SEGMENT = 0.05, 1.0  # [m]
LARGEST_MASS = 100.0  # [kg], largest mass of one segment; the leg of a person of 250 kg weighs 45 kg
# Tolerance for the digits that a drawing program leaves out of a file; an impossible inertia is off by more.
_ROUNDED_SHARE = 0.01


def check_segments(path: Path, model: pin.Model, legs: Mapping[Side, LegJoints]) -> None:
    """Check lengths, masses and inertias of the bodies that the joints of the legs carry.

    ``path``: path of the URDF, for messages. ``model``: the device as in the file, all other joints locked.
    Raises ModelError if a segment is too short or too long, too heavy, or has an inertia that no rigid body
    can have; or if no segment has a mass.
    """
    carried = [model.getJointId(name) for leg in legs.values() for _, name in leg.items()]
    if not any(model.inertias[index].mass for index in carried):
        raise ModelError(
            f"{path}: no link of the legs has a mass; expected <inertial> with a <mass> above 0 kg"
        )
    for leg in legs.values():
        names = [name for _, name in leg.items()]
        for above, name in itertools.pairwise(names):
            length = float(np.linalg.norm(model.jointPlacements[model.getJointId(name)].translation))
            if not SHORTEST_SEGMENT <= length <= LONGEST_SEGMENT:
                expected = f"expected {SHORTEST_SEGMENT:g} to {LONGEST_SEGMENT:g} m for a segment of a leg"
                raise ModelError(
                    f"{path}: joint {name!r} is {length:g} m from {above!r}; {expected}, so check the unit "
                    "of its <origin>"
                )
        for name in names:
            problem = _problem_of(model.inertias[model.getJointId(name)])
            if problem:
                raise ModelError(f"{path}: the segment that joint {name!r} moves {problem}")


def _problem_of(body: pin.Inertia) -> str:
    """Return the reason why a segment cannot have a mass, centre of mass or inertia; empty if it can."""
    mass, distance = float(body.mass), float(np.linalg.norm(body.lever))
    if mass > LARGEST_MASS:
        return f"has a mass of {mass:g} kg; expected at most {LARGEST_MASS:g} kg"
    if distance > LONGEST_SEGMENT:
        limit = f"expected at most {LONGEST_SEGMENT:g} m, so check the unit of its <origin>"
        return f"has its centre of mass {distance:g} m from the joint; {limit}"
    least, middle, largest = np.linalg.eigvalsh(np.asarray(body.inertia))
    shown = ", ".join(f"{value:.3g}" for value in (least, middle, largest))
    if largest > mass * LONGEST_SEGMENT**2:
        return (
            f"has principal moments of inertia of {shown} kg·m² at a mass of {mass:g} kg; expected a radius "
            f"of gyration of at most {LONGEST_SEGMENT:g} m, so check the units"
        )
    rounding = _ROUNDED_SHARE * largest
    if least < -rounding or largest > least + middle + rounding:
        return (
            f"has principal moments of inertia of {shown} kg·m²; none is below 0, and none of a rigid body "
            "is above the sum of the other two"
        )
    return ""


def check_couplings(path: Path, legs: Mapping[Side, LegJoints]) -> list[Warning]:
    """Check the elements of a URDF that make the joints of the legs depend on something else.

    Returns warnings of ``<dynamics>``, which is not used, and of joints that follow a joint of a leg but are
    locked. Raises ModelError if a joint of a leg follows another joint.
    """
    found: list[Warning] = []
    names = {name for leg in legs.values() for _, name in leg.items()}
    for name, mimic in mimic_joints(path).items():
        if name in names:
            raise ModelError(
                f"{path}: joint {name!r} of a leg mimics {mimic.joint!r}; expected a joint that moves by "
                "itself, so remove its <mimic>, or leave the joint out of the leg"
            )
        if mimic.joint in names:
            text = f"joint {name!r} mimics {mimic.joint!r}, but is locked at zero: it belongs to no leg"
            found.append(UrdfWarning(f"{path}: {text}"))
    for name, joint in joint_elements(urdf_document(path)).items():
        dynamics = joint.find("dynamics")
        values = {} if dynamics is None or name not in names else dynamics.attrib
        given = ", ".join(f"{key} {text}" for key, text in values.items() if text.strip() not in ("0", "0.0"))
        if given:
            text = f"<dynamics> of joint {name!r} ({given}) is not used; set the drives of the experiment"
            found.append(UrdfWarning(f"{path}: {text}"))
    return found
