"""The rigid bodies of a leg model as a model of OpenSim (.osim): x forward, y up, z to the right."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from twin_gait.conventions import Convention
from twin_gait.leg_model import LegModel
from twin_gait.leg_model.bodies import BodyArrays, export_bodies
from twin_gait.templates import templates_in
from twin_gait.vocabulary import JointName, Side

PELVIS = "pelvis"
PELVIS_COORDINATES = ("pelvis_tilt", "pelvis_tx", "pelvis_ty")
_BODIES = {JointName.HIP: "thigh", JointName.KNEE: "shank", JointName.ANKLE: "foot"}


def body_name(side: Side, joint: JointName) -> str:
    """Name of the body that a joint carries, such as ``shank_r``."""
    return f"{_BODIES[joint]}_{str(side)[0]}"


def to_opensim(up_axis: str) -> np.ndarray:
    """Rotation from the axes of a URDF to those of OpenSim."""
    return np.eye(3) if up_axis == "y" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def render(template: str, **content: Any) -> str:
    """Fill one of ``templates``: OpenSim's files, which have the version that every OpenSim 4 reads."""
    environment = templates_in(Path(__file__).with_name("templates"), autoescape=True)
    environment.filters["numbers"] = _numbers
    return environment.get_template(template).render(content) + "\n"


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)


def osim_text(model: LegModel, name: str, convention: Convention, gravity: float) -> str:
    """Write the bodies as a planar model: joints turn about the lateral axis, the pelvis moves in its plane.

    Rotors are not bodies: their inertia at the joints is left out. A pelvis that is fixed in the world is the
    ground. Gravity is in [m] / [s²].
    """
    bodies = export_bodies(model.model)
    names = [PELVIS] * len(bodies)
    coordinates: list[tuple[tuple[str, ...], float]] = [(PELVIS_COORDINATES, 1.0)] * len(bodies)
    for side, leg in model.legs.items():
        for joint, _ in leg.items():
            index = model.index(side, joint)
            names[index] = body_name(side, joint)
            coordinates[index] = (convention.columns[side, joint],), convention.signs.get(joint, 1.0)
    turn, written = to_opensim(model.up_axis), []
    for index, body in enumerate(bodies):
        if index != model.forward_index:  # the planar joint of the pelvis has both of its guides
            grounded = body.parent < 0 or body.parent == model.forward_index
            parent = "/ground" if grounded else f"/bodyset/{names[body.parent]}"
            written.append(_body(body, names[index], parent, turn, *coordinates[index]))
    return render("model.osim", name=name, gravity=gravity, bodies=written)


def _body(
    body: BodyArrays, name: str, parent: str, turn: np.ndarray, coordinates: tuple[str, ...], sign: float
) -> dict[str, Any]:
    """A body and its joint, which turns about the z axis of the frames that it has on both bodies."""
    centre = turn @ np.array(body.first_moment) / body.mass
    about_origin = turn @ np.array(body.inertia) @ turn.T
    inertia = about_origin - body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    axis = np.array([0.0, 0.0, 1.0]) if body.prismatic else sign * turn @ np.array(body.axis)
    along = Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])[0]
    placed = Rotation.from_matrix(turn @ np.array(body.rotation) @ turn.T)
    frames = (
        ("parent_offset", parent, turn @ np.array(body.position), placed * along),
        ("child_offset", f"/bodyset/{name}", np.zeros(3), along),
    )
    return {
        "name": name,
        "mass": repr(body.mass),
        "centre": centre,
        "inertia": inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        "joint": "PlanarJoint" if body.prismatic else "PinJoint",
        "coordinates": coordinates,
        "frames": [
            {"name": frame, "parent": path, "place": place, "angles": rotation.as_euler("XYZ")}
            for frame, path, place, rotation in frames
        ],
    }
