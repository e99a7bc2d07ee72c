"""The rigid bodies of a leg model as a model of OpenSim (.osim): x forward, y up, z to the right."""

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from twin_gait.conventions import Convention
from twin_gait.leg_model import LegModel
from twin_gait.leg_model.bodies import BodyArrays, export_bodies
from twin_gait.vocabulary import JointName, Side

FORMAT = "40000"  # what OpenSim 4.0 wrote; every later one reads it
PELVIS = "pelvis"
PELVIS_COORDINATES = ("pelvis_tilt", "pelvis_tx", "pelvis_ty")
_BODIES = {JointName.HIP: "thigh", JointName.KNEE: "shank", JointName.ANKLE: "foot"}


def body_name(side: Side, joint: JointName) -> str:
    """Name of the body that a joint carries, such as ``shank_r``."""
    return f"{_BODIES[joint]}_{str(side)[0]}"


def to_opensim(up_axis: str) -> np.ndarray:
    """Rotation from the axes of a URDF to those of OpenSim."""
    return np.eye(3) if up_axis == "y" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def osim_text(model: LegModel, name: str, convention: Convention, gravity: float) -> str:
    """Write the bodies as a planar model: joints turn about the lateral axis, the pelvis moves in its plane.

    Rotors are not bodies: their inertia at the joints is left out. A pelvis that is fixed in the world is the
    ground. Gravity is in [m] / [s²].
    """
    turn, bodies = to_opensim(model.up_axis), export_bodies(model.model)
    names, coordinates = _names(model, convention, len(bodies))
    document = ElementTree.Element("OpenSimDocument", Version=FORMAT)
    root = ElementTree.SubElement(document, "Model", name=name)
    ElementTree.SubElement(root, "gravity").text = _numbers([0.0, -gravity, 0.0])
    ElementTree.SubElement(root, "length_units").text = "meters"
    ElementTree.SubElement(root, "force_units").text = "N"
    ElementTree.SubElement(root, "Ground", name="ground")
    sets = {
        kind: ElementTree.SubElement(ElementTree.SubElement(root, kind, name=kind.lower()), "objects")
        for kind in ("BodySet", "JointSet")
    }
    for index, (body, own, (coordinate, sign)) in enumerate(zip(bodies, names, coordinates, strict=True)):
        if index == model.forward_index:  # the planar joint of the pelvis has both of its guides
            continue
        _add_body(sets["BodySet"], body, own, turn)
        grounded = body.parent < 0 or body.parent == model.forward_index
        parent = "/ground" if grounded else f"/bodyset/{names[body.parent]}"
        _add_joint(sets["JointSet"], body, own, parent, turn, coordinate, sign)
    ElementTree.indent(document)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(document, encoding="unicode") + "\n"
    )


def _names(
    model: LegModel, convention: Convention, count: int
) -> tuple[list[str], list[tuple[tuple[str, ...], float]]]:
    """Names of the bodies, and of their coordinates with the sign of each."""
    bodies = [PELVIS] * count
    coordinates: list[tuple[tuple[str, ...], float]] = [(PELVIS_COORDINATES, 1.0)] * count
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            index = model.index(side, joint)
            bodies[index] = body_name(side, joint)
            coordinates[index] = (convention.columns[side, joint],), convention.signs.get(joint, 1.0)
    return bodies, coordinates


def _add_body(parent: ElementTree.Element, body: BodyArrays, name: str, turn: np.ndarray) -> None:
    centre = turn @ np.array(body.first_moment) / body.mass
    about_origin = turn @ np.array(body.inertia) @ turn.T
    inertia = about_origin - body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    element = ElementTree.SubElement(parent, "Body", name=name)
    ElementTree.SubElement(element, "mass").text = repr(body.mass)
    ElementTree.SubElement(element, "mass_center").text = _numbers(centre)
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    ElementTree.SubElement(element, "inertia").text = _numbers(inertia[rows, columns])


def _add_joint(
    parent: ElementTree.Element,
    body: BodyArrays,
    name: str,
    parent_path: str,
    turn: np.ndarray,
    coordinates: Sequence[str],
    sign: float,
) -> None:
    """A joint turns about the z axis of the frames that it has on both bodies."""
    kind = "PlanarJoint" if body.prismatic else "PinJoint"
    axis = np.array([0.0, 0.0, 1.0]) if body.prismatic else sign * turn @ np.array(body.axis)
    along = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])[0]
    element = ElementTree.SubElement(parent, kind, name=f"{name}_joint")
    ElementTree.SubElement(element, "socket_parent_frame").text = "parent_offset"
    ElementTree.SubElement(element, "socket_child_frame").text = "child_offset"
    own = ElementTree.SubElement(element, "coordinates")
    for coordinate in coordinates:
        ElementTree.SubElement(own, "Coordinate", name=coordinate)
    frames = ElementTree.SubElement(element, "frames")
    placed = Rotation.from_matrix(turn @ np.array(body.rotation) @ turn.T)
    for frame, path, place, rotation in (
        ("parent_offset", parent_path, turn @ np.array(body.position), placed * along),
        ("child_offset", f"/bodyset/{name}", np.zeros(3), along),
    ):
        offset = ElementTree.SubElement(frames, "PhysicalOffsetFrame", name=frame)
        ElementTree.SubElement(offset, "socket_parent").text = path
        ElementTree.SubElement(offset, "translation").text = _numbers(place)
        ElementTree.SubElement(offset, "orientation").text = _numbers(rotation.as_euler("XYZ"))


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
