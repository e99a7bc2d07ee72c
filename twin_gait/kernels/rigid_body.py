"""Rigid-body algorithms on numbers or symbols: Newton-Euler, composite inertia, sparse L'DL.

The algorithms follow Featherstone, Rigid Body Dynamics Algorithms (2008), chapters 5, 6 and 8, in body
frames with three-vectors. With inputs of :class:`~twin_gait.kernels.tracing.Symbol` they generate the
specialised kernel of one model.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from twin_gait.kernels.tracing import Scalar, sine_and_cosine
from twin_gait.leg_model.bodies import BodyArrays, ContactPoint

# Arrays of numbers and symbols, for which numpy has no type.
Vector: TypeAlias = Any
Matrix: TypeAlias = Any
Bodies: TypeAlias = Sequence[BodyArrays]
Points: TypeAlias = Sequence[ContactPoint]
# Contact law: it takes number, position and velocity of a point in the world, and returns its force along
# world x and z (first two results) and any further results.
Law: TypeAlias = Callable[[int, Vector, Vector], list[Scalar]] | None
# Receives the comment, the quantity and the body (None: the world) of each step before it is computed.
Note: TypeAlias = Callable[[str, str, BodyArrays | None], None]


def vector(values: Sequence[Any] | np.ndarray) -> Vector:
    """Return an array of numbers and symbols."""
    return np.array(values, dtype=object)


ZERO = vector([0.0, 0.0, 0.0])


def _no_note(comment: str, quantity: str, body: BodyArrays | None) -> None:
    """Ignore a step."""


class InverseDynamics(NamedTuple):
    """Forces that belong to a motion."""

    torques: list[Scalar]  # Torques on the coordinates, without armature, shape ``(n,)``.
    contacts: list[list[Scalar]]  # Results of the contact law per point.
    # Moment and force that each joint exerts on its body, in the body's frame and about the joint frame's
    # origin.
    wrenches: list[list[Vector]]
    kinetic_energy: Scalar  # Kinetic energy with that of the rotors.


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product a × b."""
    return vector([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def joint_rotation(axis: Vector, angle: Scalar) -> Matrix:
    """Return the rotation matrix about a constant axis (Rodrigues), sparse for coordinate axes."""
    (s, c), (x, y, z) = sine_and_cosine(angle), axis
    # All products of the components of a coordinate axis are 0, except the one along the axis.
    one = 0.0 if 1.0 in np.abs(axis) else 1.0 - c
    xx, yy, zz = (1.0 if abs(part) == 1.0 else c + part * part * one for part in axis)
    return vector(
        [
            [xx, x * y * one - z * s, x * z * one + y * s],
            [x * y * one + z * s, yy, y * z * one - x * s],
            [x * z * one - y * s, y * z * one + x * s, zz],
        ]
    )


class _Pose(NamedTuple):
    """Pose of a body in its parent and its motion subspace."""

    rotation: Matrix
    position: Vector
    angular: Vector
    linear: Vector


def _pose(body: BodyArrays, q: Scalar) -> _Pose:
    if body.prismatic:
        position = body.position + body.rotation @ (body.axis * q)
        return _Pose(body.rotation, position, ZERO, body.axis)
    rotation = body.rotation @ joint_rotation(body.axis, q)
    return _Pose(rotation, body.position, body.axis, ZERO)


def _poses(bodies: Bodies, q: Vector, note: Note) -> list[_Pose]:
    """Return the pose of every body in its parent."""
    poses = []
    for body, angle in zip(bodies, q, strict=True):
        note("Pose", "pose", body)
        poses.append(_pose(body, angle))
    return poses


def _world_poses(bodies: Bodies, poses: Sequence[_Pose], note: Note) -> list[tuple[Matrix, Vector]]:
    """Return orientation and origin of every body in the world."""
    found: list[tuple[Matrix, Vector]] = []
    for body, pose in zip(bodies, poses, strict=True):
        note("Pose in the world", "world", body)
        rotation, origin = found[body.parent] if body.parent >= 0 else (vector(np.eye(3)), ZERO)
        found.append((rotation @ pose.rotation, origin + rotation @ pose.position))
    return found


def inverse_dynamics(
    bodies: Bodies,
    q: Vector,
    v: Vector,
    a: Vector,
    gravity: Vector,
    contacts: Points = (),
    law: Law = None,
    note: Note = _no_note,
) -> InverseDynamics:
    """Compute the torques of a motion: inertia, Coriolis, centrifugal, gravity, less the contact forces.

    ``gravity``: acceleration of gravity in the world frame. ``note``: receives each step.
    """
    poses = _poses(bodies, q, note)
    velocity: list[tuple[Vector, Vector]] = []
    force: list[list[Vector]] = []
    acceleration: list[tuple[Vector, Vector]] = []
    world = _world_poses(bodies, poses, note)
    results: list[list[Scalar]] = [[] for _ in contacts]
    twice_kinetic: Scalar = 0.0
    for index, (body, pose) in enumerate(zip(bodies, poses, strict=True)):
        back = pose.rotation.T
        w0, l0 = velocity[body.parent] if body.parent >= 0 else (ZERO, ZERO)
        note("Acceleration of the world that replaces gravity", "base_acceleration", None)
        aw0, al0 = acceleration[body.parent] if body.parent >= 0 else (ZERO, gravity * -1.0)
        note("Forward pass, velocity", "velocity", body)
        joint_w, joint_l = pose.angular * v[index], pose.linear * v[index]
        w = back @ w0 + joint_w
        linear = back @ (l0 + cross(w0, pose.position)) + joint_l
        note("Forward pass, acceleration", "acceleration", body)
        aw = back @ aw0 + cross(w, joint_w) + pose.angular * a[index]
        al = (
            back @ (al0 + cross(aw0, pose.position))
            + cross(w, joint_l)
            + cross(linear, joint_w)
            + pose.linear * a[index]
        )
        velocity.append((w, linear))
        acceleration.append((aw, al))
        note("Forward pass, momentum", "momentum", body)
        momentum_l = linear * body.mass + cross(w, body.first_moment)
        momentum_w = body.inertia @ w + cross(body.first_moment, linear)
        rotor = body.armature * v[index] * v[index]
        twice_kinetic = twice_kinetic + w @ momentum_w + linear @ momentum_l + rotor
        note("Forward pass, force", "force", body)
        moment = (
            body.inertia @ aw
            + cross(body.first_moment, al)
            + cross(w, momentum_w)
            + cross(linear, momentum_l)
        )
        linear_force = al * body.mass + cross(aw, body.first_moment) + cross(w, momentum_l)
        rotation, origin = world[index]
        for number, point in enumerate(contacts):
            if point.body != index or law is None:
                continue
            note("Contact", "contact", body)
            position = origin + rotation @ point.position
            speed = rotation @ (linear + cross(w, point.position))
            results[number] = law(number, position, speed)
            local = rotation.T @ vector([results[number][0], 0.0, results[number][1]])
            linear_force = linear_force - local
            moment = moment - cross(point.position, local)
        force.append([moment, linear_force])
    bias: list[Scalar] = [0.0] * len(bodies)
    for index in range(len(bodies) - 1, -1, -1):
        pose, (moment, linear_force) = poses[index], force[index]
        note("Backward pass, torque", "torque", bodies[index])
        bias[index] = pose.angular @ moment + pose.linear @ linear_force
        parent = bodies[index].parent
        if parent >= 0:
            turned = pose.rotation @ linear_force
            force[parent][0] = force[parent][0] + pose.rotation @ moment + cross(pose.position, turned)
            force[parent][1] = force[parent][1] + turned
    return InverseDynamics(bias, results, force, 0.5 * twice_kinetic)


def mass_matrix(bodies: Bodies, q: Vector, note: Note = _no_note) -> list[list[Scalar]]:
    """Compute the joint-space inertia (lower triangle along the tree), armature included."""
    poses = _poses(bodies, q, note)
    n = len(bodies)
    composite = [(body.mass, body.first_moment, body.inertia) for body in bodies]
    matrix: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    for index in range(n - 1, -1, -1):
        pose, (mass, first, inertia) = poses[index], composite[index]
        note("Row of the mass matrix", "inertia", bodies[index])
        moment = inertia @ pose.angular + cross(first, pose.linear)
        force = pose.linear * mass + cross(pose.angular, first)
        matrix[index][index] = pose.angular @ moment + pose.linear @ force + bodies[index].armature
        ancestor = index
        while bodies[ancestor].parent >= 0:
            turned = poses[ancestor].rotation @ force
            moment = poses[ancestor].rotation @ moment + cross(poses[ancestor].position, turned)
            force = turned
            ancestor = bodies[ancestor].parent
            up = poses[ancestor]
            matrix[index][ancestor] = up.angular @ moment + up.linear @ force
        if bodies[index].parent >= 0:
            parent = bodies[index].parent
            note("Inertia of the body and of all bodies that it carries", "composite", bodies[parent])
            composite[parent] = _join(composite[parent], composite[index], pose)
    return matrix


_Composite = tuple[Scalar, Vector, Matrix]


def _join(parent: _Composite, child: _Composite, pose: _Pose) -> _Composite:
    """Add a composite body, moved into the parent frame, to its parent."""
    mass, first, inertia = child
    p = pose.position
    turned_first = pose.rotation @ first
    turned = pose.rotation @ inertia @ pose.rotation.T
    trace = mass * (p @ p) + 2.0 * (p @ turned_first)
    moved = np.full((3, 3), 0.0, dtype=object)
    for i in range(3):
        for j in range(i, 3):
            element = turned[i][j] - (mass * (p[i] * p[j]) + p[i] * turned_first[j] + turned_first[i] * p[j])
            if i == j:
                element = element + trace
            moved[i, j] = moved[j, i] = element
    parent_mass, parent_first, parent_inertia = parent
    return (parent_mass + mass, parent_first + turned_first + p * mass, parent_inertia + moved)


def solve_along_tree(
    bodies: Bodies, matrix: list[list[Scalar]], right: list[Scalar], note: Note = _no_note
) -> list[Scalar]:
    """Solve M a = r with the branch-sparse L'DL factorisation (Featherstone, section 6.5)."""
    n = len(bodies)
    ancestors: list[list[int]] = []  # the nearest first
    for body in bodies:
        ancestors.append([body.parent, *ancestors[body.parent]] if body.parent >= 0 else [])
    matrix = [list(row) for row in matrix]
    x = list(right)
    for k in range(n - 1, -1, -1):
        note("Factorisation of the mass matrix, row", "factor", bodies[k])
        inverse = 1.0 / matrix[k][k]
        for position, i in enumerate(ancestors[k]):
            factor = matrix[k][i] * inverse
            for j in ancestors[k][position:]:
                matrix[i][j] = matrix[i][j] - factor * matrix[k][j]
            matrix[k][i] = factor
        matrix[k][k] = inverse
    for i in range(n - 1, -1, -1):
        note("Backward substitution", "right", bodies[i])
        for j in ancestors[i]:
            x[j] = x[j] - matrix[i][j] * x[i]
    for i in range(n):
        note("Division by the diagonal", "scaled", bodies[i])
        x[i] = x[i] * matrix[i][i]
    for i in range(n):
        note("Forward substitution", "solution", bodies[i])
        for j in ancestors[i]:
            x[i] = x[i] - matrix[i][j] * x[j]
    return x


def forward_dynamics(
    bodies: Bodies,
    q: Vector,
    v: Vector,
    tau: Vector,
    gravity: Vector,
    contacts: Points = (),
    law: Law = None,
    note: Note = _no_note,
) -> tuple[list[Scalar], list[list[Scalar]]]:
    """Compute the accelerations under torques and contact forces, and the contact law's results per point."""
    bias = inverse_dynamics(bodies, q, v, [0.0] * len(bodies), gravity, contacts, law, note)
    right: list[Scalar] = []
    for body, torque, load in zip(bodies, tau, bias.torques, strict=True):
        note("Torque less bias", "net_torque", body)
        right.append(torque - load)
    return solve_along_tree(bodies, mass_matrix(bodies, q, note), right, note), bias.contacts


def potential_energy(bodies: Bodies, q: Vector, gravity: Vector, note: Note = _no_note) -> Scalar:
    """Compute the potential energy of gravity, which is zero at the height of the world's origin."""
    energy: Scalar = 0.0
    poses = _world_poses(bodies, _poses(bodies, q, note), note)
    for body, (rotation, origin) in zip(bodies, poses, strict=True):
        note("Potential energy", "potential", body)
        energy = energy - gravity @ (rotation @ body.first_moment + origin * body.mass)
    return energy
