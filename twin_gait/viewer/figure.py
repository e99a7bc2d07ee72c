"""Articulated figure: one group per joint, so that a posture is one rotation per joint."""

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from twin_gait.viewer import shapes
from twin_gait.viewer.arrows import LEVELS, arc_arrow
from twin_gait.viewer.commands import (
    CommandBuffer,
    Material,
    SceneState,
    draw_mesh,
    set_property,
    set_transform,
)
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.visuals import FIXED_JOINT, LinkPart

ROOT = "/meshcat/figure"
STICK_COLOUR = (0.86, 0.88, 0.91)
_STICK_RADIUS = 0.05  # radius of a stick as a share of the median segment length
_SHORTEST_SEGMENT = 0.02  # [m]
_DEFAULT_SEGMENT = np.array([0.0, 0.0, -0.4])  # [m], segment of a leg whose joints coincide
_ARC_CLEARANCE, _ARC_GAP = 0.033, 0.014  # [m], radial and axial distance of a torque arrow from its motor


class ArticulatedFigure:
    """Moving part of the scene.

    Groups are nested like the joints: the transform of a group is the transform of its joint relative to the
    parent joint, so that segments keep their length under any interpolation in the viewer.

    Attributes:
        model: The Pinocchio model.
        paths: Path of the group of each joint in the scene, by the name of the joint.
    """

    def __init__(
        self, window: CommandBuffer, model: pin.Model, parts: Sequence[LinkPart] = (), *, up_axis: str = "z"
    ) -> None:
        """Make the groups and draw the parts of the URDF, or sticks from joint to joint if there are none.

        ``up_axis``: vertical axis of the model, ``"x"``, ``"y"`` or ``"z"``.
        """
        self.model, self._parts = model, parts
        self._window = window
        self._data = model.createData()
        self.base = np.eye(4)
        # The base turns the vertical of the model to the vertical z of the scene by the shortest rotation.
        vertical = np.eye(3)["xyz".index(up_axis)]
        self.base[:3, :3] = np.round(pin.Quaternion.FromTwoVectors(vertical, np.eye(3)[2]).matrix())
        self.paths = {FIXED_JOINT: ROOT}
        for index in range(1, model.njoints):
            parent = self.paths[str(model.names[model.parents[index]])]
            name = str(model.names[index])
            self.paths[name] = f"{parent}/{name.replace('/', '_')}"
        window.send(set_transform(ROOT, self.base))
        window.apply(self.posture(pin.neutral(model)))
        for number, part in enumerate(parts):
            *colour, opacity = part.colour
            gloss = 0.8 if max(colour) < 0.3 else 0.42
            # Both sides are drawn, because the mesh may have holes.
            look = Material(colour=colour, opacity=opacity, roughness=gloss, two_sided=True)
            self.draw(part.joint, f"visual_{number}", part.shape, look)
        if not parts:
            self._draw_skeleton()

    def draw(self, joint: str, name: str, shape: Shape, material: Material, *, casts: bool = True) -> str:
        """Draw a mesh on a joint, and return its path in the scene.

        ``joint``: name of the joint; ``universe`` for fixed parts; ``name`` of the part, unique per joint;
        ``shape``: mesh in the frame of the joint; ``casts``: whether the part casts a shadow if it is opaque.
        """
        path = f"{self.paths[joint]}/{name}"
        # Only the ground receives shadows: on curved parts they are costly and show the texels of the map.
        draw_mesh(self._window, path, shape, material, casts=casts and material.opacity == 1.0)
        return path

    def _draw_skeleton(self) -> None:
        """Draw a ball at every joint, and sticks to its child joints or to the frames of a last link."""
        ends = [self._ends(index) for index in range(self.model.njoints)]
        lengths = [float(np.linalg.norm(end)) for tips in ends for end in tips]
        radius = _STICK_RADIUS * float(np.median(lengths)) if lengths else _SHORTEST_SEGMENT
        material = Material(colour=STICK_COLOUR, roughness=0.8)
        for name, tips in zip(map(str, self.model.names), ends, strict=True):
            pieces = [shapes.tube(np.array([0.0 * end, 0.5 * end, end]), radius) for end in tips]
            if name != FIXED_JOINT:
                pieces.append(shapes.ball(1.5 * radius, columns=16))
            if pieces:
                self.draw(name, "sticks", shapes.merge_meshes(pieces), material)

    def _ends(self, index: int) -> list[np.ndarray]:
        """Return the positions of the child joints, or of a last link's frames, in the joint's frame [m]."""
        after = [child for child in range(1, self.model.njoints) if self.model.parents[child] == index]
        placements = [self.model.jointPlacements[child] for child in after] or [
            frame.placement for frame in self.model.frames if frame.parentJoint == index
        ]
        ends = [np.asarray(placement.translation).copy() for placement in placements]
        return [end for end in ends if float(np.linalg.norm(end)) > _SHORTEST_SEGMENT]

    def segment(self, joint: str) -> np.ndarray:
        """Return the vector from a joint to its farthest child joint, or to a last link's farthest frame.

        A last link without frames is assumed to be as long as its parent link. The result is in the frame of
        the joint in [m], shape ``(3,)``, and never zero.
        """
        index = self.model.getJointId(joint)
        before = np.asarray(self.model.jointPlacements[index].translation).copy()
        bare = before if np.linalg.norm(before) > _SHORTEST_SEGMENT else _DEFAULT_SEGMENT
        return max(self._ends(index), key=np.linalg.norm, default=bare)

    def draw_cap(self, joint: str, radius: float, material: Material) -> str:
        """Draw the cap of a motor, whose colour shows the phase; ``radius`` in [m]."""
        placement = shapes.frame(self.axis(joint)) @ np.diag([radius, radius, radius, 1.0])
        return self.draw(joint, "motor_cap", shapes.load_packaged_mesh("motor_cap", placement), material)

    def draw_arc(self, joint: str, radius: float, outward: float) -> dict[int, str]:
        """Draw the arrows that show the torque of a motor, all of them hidden.

        They are fixed to the link before the joint, on the outer face of the cap, and begin at the top.
        ``radius`` of the cap in [m]; ``outward``: 1 if the outer face is the left one, -1 for the right one.
        Returns the path of each arrow by its level.
        """
        index = self.model.getJointId(joint)
        parent, before = str(self.model.names[self.model.parents[index]]), self.model.jointPlacements[index]
        axis = np.asarray(before.rotation @ self.axis(joint))
        left, up = self.base[1, :3], self.base[2, :3]  # axes of the scene in the frame of the model
        face = outward * math.copysign(1.0, float(axis @ left)) * axis
        thick = shapes.load_packaged_mesh("motor_cap", np.eye(4)).vertices[:, 2].max()  # for radius 1
        middle = before.translation + (thick * radius + _ARC_GAP) * face
        placement = shapes.frame(axis, up, at=middle)
        paths = {}
        for number in (n for n in range(-LEVELS, LEVELS + 1) if n):
            arrow, material = arc_arrow(number, radius + _ARC_CLEARANCE, placement)
            name = f"torque_{joint.replace('/', '_')}_{number}".replace("-", "minus_")
            paths[number] = self.draw(parent, name, arrow, material, casts=False)
            self._window.send(set_property(paths[number], "visible", False))
        return paths

    def axis(self, joint: str) -> np.ndarray:
        """Return the axis of a revolute or prismatic joint in its frame, unit vector of shape ``(3,)``."""
        moving = self.model.joints[self.model.getJointId(joint)]
        data = moving.createData()
        moving.calc(data, pin.neutral(self.model))
        motion = np.asarray(data.S).reshape(6, -1)[:, 0]  # linear and angular velocity per joint velocity
        return motion[3:] if np.any(motion[3:]) else motion[:3]

    def move(self, q: np.ndarray) -> None:
        """Move the figure to the coordinates ``q``, shape ``(nq,)``; it starts at the neutral ones."""
        pin.forwardKinematics(self.model, self._data, np.asarray(q, dtype=float))

    def posture(self, q: np.ndarray) -> SceneState:
        """Move the figure, and compute the transform of each joint group relative to its parent.

        ``q``: coordinates, shape ``(nq,)``. Returns the ``position`` in [m] and the ``quaternion``
        (x, y, z, w) of each group by its path.
        """
        self.move(q)
        found: SceneState = {}
        for name, transform in zip(list(self.model.names)[1:], list(self._data.liMi)[1:], strict=True):
            path = self.paths[str(name)]
            found[path, "position"] = transform.translation.tolist()
            found[path, "quaternion"] = pin.Quaternion(transform.rotation).coeffs().tolist()
        return found

    def points(self) -> np.ndarray:
        """Return all joints and the vertices of the parts, or all frames, at zero in [m], ``(n, 3)``."""
        pin.framesForwardKinematics(self.model, self._data, pin.neutral(self.model))
        origins = [*self._data.oMi, *(() if self._parts else self._data.oMf)]
        points = [np.array([placement.translation for placement in origins])]
        for part in self._parts:
            placement = self._data.oMi[self.model.getJointId(part.joint)]
            points.append(shapes.transform_mesh(part.shape, placement.homogeneous).vertices)
        return np.concatenate(points) @ self.base[:3, :3].T

    def world_point(self, joint: str, point: np.ndarray | None = None) -> np.ndarray:
        """Return the position of a point on a joint in the scene, whose vertical is z.

        ``point`` in the frame of the joint in [m], shape ``(3,)``; its origin if None. Returned in [m], shape
        ``(3,)``.
        """
        placement = self._data.oMi[self.model.getJointId(joint)]
        return np.asarray(self.base[:3, :3] @ placement.act(np.zeros(3) if point is None else point))

    def frame_point(self, frame: str) -> np.ndarray:
        """Return the position of a frame of the model in the scene in [m], shape ``(3,)``."""
        found = self.model.frames[self.model.getFrameId(frame)]
        joint = str(self.model.names[found.parentJoint])
        return self.world_point(joint, np.asarray(found.placement.translation))
