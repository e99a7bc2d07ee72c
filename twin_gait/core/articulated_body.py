"""Rigid-body dynamics of any tree of joints with one degree of freedom, as loops over its bodies.

The articulated-body algorithm and its relatives (Featherstone, Rigid Body Dynamics Algorithms, 2008,
chapters 5 to 7), for models too large to be written out joint by joint. All vectors stand along the axes of
the world and refer to the origin of their body's joint, so that going from body to parent is a shift, not a
rotation, and a robot far from the world's origin loses no digits. Accelerations are the ordinary ones of
points. Motions are angular above linear, forces moment above force.

Row 0 of every array is the world and row ``i + 1`` the body that coordinate ``i`` moves. The model comes as
one flat array: for every body the columns below, then body row and position of every contact point.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from twin_gait.core.contact import ground_contact_force

Array = np.ndarray[Any, np.dtype[Any]]

# First column of a body's entries: row of the parent, 1 for a joint that slides, axis of the joint in its
# frame, rotation (by rows) and position of the joint in the parent, mass, first moment, inertia about the
# joint (by rows), inertia of the rotor.
PARENT, PRISMATIC, AXIS, ROTATION, POSITION = 0, 1, 2, 5, 14
MASS, FIRST_MOMENT, INERTIA, ARMATURE = 17, 18, 21, 30
BODY_COLUMNS = 31
POINT_COLUMNS = 4


class Tree(NamedTuple):
    """State of all bodies, world first, along the axes of the world.

    Attributes:
        rotation: Of the body, shape ``(n + 1, 3, 3)``.
        origin: Of its joint in [m], shape ``(n + 1, 3)``.
        offset: Of the joint from the parent's in [m], shape ``(n + 1, 3)``.
        subspace: Motion per unit of joint velocity, shape ``(n + 1, 6)``.
        velocity: Shape ``(n + 1, 6)``.
        drift: Acceleration that the velocities alone add at this joint, shape ``(n + 1, 6)``.
        inertia: Shape ``(n + 1, 6, 6)``.
        force: What the body needs besides inertia times acceleration, shape ``(n + 1, 6)``: gyroscopic
            forces less those from outside.
    """

    rotation: Array
    origin: Array
    offset: Array
    subspace: Array
    velocity: Array
    drift: Array
    inertia: Array
    force: Array


def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """Vector product of two vectors given by their components."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def body_table(bodies: Array, n: int) -> Array:
    """Entries of the bodies, shape ``(n, BODY_COLUMNS)``."""
    return bodies[: n * BODY_COLUMNS].reshape((n, BODY_COLUMNS))


def point_table(bodies: Array, n: int) -> Array:
    """Body row and position of the contact points, shape ``(n_points, POINT_COLUMNS)``."""
    rest = bodies[n * BODY_COLUMNS :]
    return rest.reshape((rest.shape[0] // POINT_COLUMNS, POINT_COLUMNS))


def moving_tree(table: Array, q: Array, v: Array) -> Tree:
    """Place all bodies, set them in motion and weigh them.

    Args:
        table: From :func:`body_table`.
        q: Coordinates, shape ``(n,)``.
        v: Velocities, shape ``(n,)``.

    Returns:
        The bodies.
    """
    n = q.shape[0]
    tree = Tree(
        np.zeros((n + 1, 3, 3)),
        np.zeros((n + 1, 3)),
        np.zeros((n + 1, 3)),
        np.zeros((n + 1, 6)),
        np.zeros((n + 1, 6)),
        np.zeros((n + 1, 6)),
        np.zeros((n + 1, 6, 6)),
        np.zeros((n + 1, 6)),
    )
    for k in range(3):
        tree.rotation[0, k, k] = 1.0
    for i in range(n):
        place_body(table, i, q[i], tree)
        move_body(table, i, v[i], tree)
        weigh_body(table, i, tree)
    return tree


def place_body(table: Array, i: int, q: float, tree: Tree) -> None:
    """Rotation, origin, offset and motion subspace of a body whose parent is in place."""
    row, parent = i + 1, int(table[i, PARENT])
    rotation, up = tree.rotation, table[i]
    sliding = up[PRISMATIC] != 0.0
    for j in range(3):
        axis = 0.0
        offset = 0.0
        for k in range(3):
            entry = 0.0
            for m in range(3):
                entry += rotation[parent, j, m] * up[ROTATION + 3 * m + k]
            rotation[row, j, k] = entry
            axis += entry * up[AXIS + k]
            offset += rotation[parent, j, k] * up[POSITION + k]
        tree.subspace[row, 3 + j if sliding else j] = axis
        tree.offset[row, j] = offset + axis * q if sliding else offset
        tree.origin[row, j] = tree.origin[parent, j] + tree.offset[row, j]
    if not sliding:
        turn_body(row, q, up, tree)


def turn_body(row: int, angle: float, entries: Array, tree: Tree) -> None:
    """Turn the columns of a body's rotation about its joint axis (Rodrigues)."""
    s, c = math.sin(angle), math.cos(angle)
    rotation = tree.rotation
    x, y, z = tree.subspace[row, 0], tree.subspace[row, 1], tree.subspace[row, 2]
    for k in range(3):
        bx, by, bz = rotation[row, 0, k], rotation[row, 1, k], rotation[row, 2, k]
        tx, ty, tz = cross(x, y, z, bx, by, bz)
        along = (1.0 - c) * entries[AXIS + k]
        rotation[row, 0, k] = c * bx + s * tx + along * x
        rotation[row, 1, k] = c * by + s * ty + along * y
        rotation[row, 2, k] = c * bz + s * tz + along * z


def move_body(table: Array, i: int, v: float, tree: Tree) -> None:
    r"""Velocity of a body, and the acceleration that velocities alone add at its joint.

    :math:`\omega_p \times s\dot q` of the angle and :math:`\omega_p \times (\omega_p \times r + 2 s \dot q)`
    of the origin.
    """
    row, parent = i + 1, int(table[i, PARENT])
    velocity, drift, r, s = tree.velocity, tree.drift, tree.offset, tree.subspace
    wx, wy, wz = velocity[parent, 0], velocity[parent, 1], velocity[parent, 2]
    ax, ay, az = s[row, 0] * v, s[row, 1] * v, s[row, 2] * v
    lx, ly, lz = s[row, 3] * v, s[row, 4] * v, s[row, 5] * v
    cx, cy, cz = cross(wx, wy, wz, r[row, 0], r[row, 1], r[row, 2])
    velocity[row, 0], velocity[row, 1], velocity[row, 2] = wx + ax, wy + ay, wz + az
    velocity[row, 3] = velocity[parent, 3] + cx + lx
    velocity[row, 4] = velocity[parent, 4] + cy + ly
    velocity[row, 5] = velocity[parent, 5] + cz + lz
    drift[row, 0], drift[row, 1], drift[row, 2] = cross(wx, wy, wz, ax, ay, az)
    drift[row, 3], drift[row, 4], drift[row, 5] = cross(
        wx, wy, wz, cx + 2.0 * lx, cy + 2.0 * ly, cz + 2.0 * lz
    )


def weigh_body(table: Array, i: int, tree: Tree) -> None:
    r"""Inertia of a body along the world's axes and its gyroscopic forces.

    :math:`\omega \times I\omega` and :math:`\omega \times (\omega \times m c)`.
    """
    row = i + 1
    entries, rotation, inertia = table[i], tree.rotation, tree.inertia
    for j in range(3):
        hx, hy, hz = 0.0, 0.0, 0.0
        for k in range(3):
            hx += rotation[row, j, k] * entries[INERTIA + k]
            hy += rotation[row, j, k] * entries[INERTIA + 3 + k]
            hz += rotation[row, j, k] * entries[INERTIA + 6 + k]
        inertia[row, j, 0], inertia[row, j, 1], inertia[row, j, 2] = world_vector(rotation, row, hx, hy, hz)
        inertia[row, 3 + j, 3 + j] = entries[MASS]
    x, y, z = world_vector(
        rotation, row, entries[FIRST_MOMENT], entries[FIRST_MOMENT + 1], entries[FIRST_MOMENT + 2]
    )
    inertia[row, 1, 3] = inertia[row, 3, 1] = z
    inertia[row, 2, 4] = inertia[row, 4, 2] = x
    inertia[row, 0, 5] = inertia[row, 5, 0] = y
    inertia[row, 0, 4] = inertia[row, 4, 0] = -z
    inertia[row, 1, 5] = inertia[row, 5, 1] = -x
    inertia[row, 2, 3] = inertia[row, 3, 2] = -y
    wx, wy, wz = tree.velocity[row, 0], tree.velocity[row, 1], tree.velocity[row, 2]
    force = tree.force
    force[row, 0], force[row, 1], force[row, 2] = cross(
        wx,
        wy,
        wz,
        inertia[row, 0, 0] * wx + inertia[row, 0, 1] * wy + inertia[row, 0, 2] * wz,
        inertia[row, 1, 0] * wx + inertia[row, 1, 1] * wy + inertia[row, 1, 2] * wz,
        inertia[row, 2, 0] * wx + inertia[row, 2, 1] * wy + inertia[row, 2, 2] * wz,
    )
    cx, cy, cz = cross(wx, wy, wz, x, y, z)
    force[row, 3], force[row, 4], force[row, 5] = cross(wx, wy, wz, cx, cy, cz)


def world_vector(rotation: Array, row: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A body's vector along the world's axes."""
    return (
        rotation[row, 0, 0] * x + rotation[row, 0, 1] * y + rotation[row, 0, 2] * z,
        rotation[row, 1, 0] * x + rotation[row, 1, 1] * y + rotation[row, 1, 2] * z,
        rotation[row, 2, 0] * x + rotation[row, 2, 1] * y + rotation[row, 2, 2] * z,
    )


def point_motion(places: Array, number: int, tree: Tree) -> tuple[float, float, float, float, float, float]:
    """Position of a contact point from its body's origin, and its velocity, in the world."""
    row = int(places[number, 0])
    x, y, z = world_vector(tree.rotation, row, places[number, 1], places[number, 2], places[number, 3])
    w = tree.velocity
    ux, uy, uz = cross(w[row, 0], w[row, 1], w[row, 2], x, y, z)
    return x, y, z, w[row, 3] + ux, w[row, 4] + uy, w[row, 5] + uz


def push_point(places: Array, number: int, forward: float, upward: float, tree: Tree) -> None:
    """Let a force along world x and z act on the body of a contact point."""
    row = int(places[number, 0])
    x, y, z = world_vector(tree.rotation, row, places[number, 1], places[number, 2], places[number, 3])
    mx, my, mz = cross(x, y, z, forward, 0.0, upward)
    tree.force[row, 0] -= mx
    tree.force[row, 1] -= my
    tree.force[row, 2] -= mz
    tree.force[row, 3] -= forward
    tree.force[row, 5] -= upward


def touch_ground(places: Array, contact: Array, points: Array, tree: Tree) -> float:
    """Contact forces of all points, put on their bodies.

    Args:
        places: From :func:`point_table`.
        contact: Belt speed, stiffness, dissipation, friction coefficient, transition velocity.
        points: Forward and upward force and height of every point; changed in place.
        tree: The bodies; their forces are changed in place.

    Returns:
        Power of the contact forces in [W].
    """
    power = 0.0
    for number in range(places.shape[0]):
        _, _, z, forward_velocity, _, upward_velocity = point_motion(places, number, tree)
        height = tree.origin[int(places[number, 0]), 2] + z
        forward, upward = ground_contact_force(
            height,
            forward_velocity,
            upward_velocity,
            contact[0],
            contact[1],
            contact[2],
            contact[3],
            contact[4],
        )
        points[number, 0], points[number, 1], points[number, 2] = forward, upward, height
        push_point(places, number, forward, upward, tree)
        power += forward * forward_velocity + upward * upward_velocity
    return power


def shift_force(row: int, parent: int, offset: Array, force: Array) -> None:
    """Add a body's force to that of its parent."""
    mx, my, mz = cross(
        offset[row, 0], offset[row, 1], offset[row, 2], force[row, 3], force[row, 4], force[row, 5]
    )
    force[parent, 0] += force[row, 0] + mx
    force[parent, 1] += force[row, 1] + my
    force[parent, 2] += force[row, 2] + mz
    force[parent, 3] += force[row, 3]
    force[parent, 4] += force[row, 4]
    force[parent, 5] += force[row, 5]


def shift_inertia(row: int, parent: int, offset: Array, inertia: Array) -> None:
    r"""Add a body's inertia to that of its parent: :math:`X^T I X` with the shift X.

    The body's own entry is used up.
    """
    x, y, z = offset[row, 0], offset[row, 1], offset[row, 2]
    for k in range(6):
        cx, cy, cz = cross(x, y, z, inertia[row, k, 3], inertia[row, k, 4], inertia[row, k, 5])
        inertia[row, k, 0] += cx
        inertia[row, k, 1] += cy
        inertia[row, k, 2] += cz
    for k in range(6):
        cx, cy, cz = cross(x, y, z, inertia[row, 3, k], inertia[row, 4, k], inertia[row, 5, k])
        inertia[parent, 0, k] += inertia[row, 0, k] + cx
        inertia[parent, 1, k] += inertia[row, 1, k] + cy
        inertia[parent, 2, k] += inertia[row, 2, k] + cz
        inertia[parent, 3, k] += inertia[row, 3, k]
        inertia[parent, 4, k] += inertia[row, 4, k]
        inertia[parent, 5, k] += inertia[row, 5, k]


def accelerate_body(row: int, parent: int, tree: Tree, acceleration: Array) -> None:
    """Acceleration of a body whose joint does not accelerate itself."""
    r, drift = tree.offset, tree.drift
    cx, cy, cz = cross(
        acceleration[parent, 0],
        acceleration[parent, 1],
        acceleration[parent, 2],
        r[row, 0],
        r[row, 1],
        r[row, 2],
    )
    acceleration[row, 0] = acceleration[parent, 0] + drift[row, 0]
    acceleration[row, 1] = acceleration[parent, 1] + drift[row, 1]
    acceleration[row, 2] = acceleration[parent, 2] + drift[row, 2]
    acceleration[row, 3] = acceleration[parent, 3] + cx + drift[row, 3]
    acceleration[row, 4] = acceleration[parent, 4] + cy + drift[row, 4]
    acceleration[row, 5] = acceleration[parent, 5] + cz + drift[row, 5]


def along(row: int, subspace: Array, vector: Array) -> float:
    """Part of a body's motion or force along its joint."""
    total = 0.0
    for k in range(6):
        total += subspace[row, k] * vector[row, k]
    return total


def forward_dynamics(
    q: Array,
    v: Array,
    torque: Array,
    bodies: Array,
    up: int,
    gravity: float,
    contact: Array,
    a: Array,
    points: Array,
) -> float:
    """Accelerations under joint torques and contact forces: the articulated-body algorithm.

    Args:
        q: Coordinates, shape ``(n,)``.
        v: Velocities, shape ``(n,)``.
        torque: On the coordinates, shape ``(n,)``.
        bodies: The model.
        up: Index of the vertical axis of the world.
        gravity: In [m] / [s²].
        contact: Belt speed, stiffness, dissipation, friction coefficient, transition velocity.
        a: Accelerations, shape ``(n,)``; changed in place.
        points: Forward and upward force and height of every contact point, shape ``(n_points, 3)``; changed
            in place.

    Returns:
        Power of the contact forces in [W].
    """
    n = q.shape[0]
    table = body_table(bodies, n)
    tree = moving_tree(table, q, v)
    power = touch_ground(point_table(bodies, n), contact, points, tree)
    reach = np.zeros((n + 1, 6))
    weight, rest = np.zeros(n), np.zeros(n)
    for i in range(n - 1, -1, -1):
        release_joint(i, int(table[i, PARENT]), torque[i], table[i, ARMATURE], tree, reach, weight, rest)
    acceleration = np.zeros((n + 1, 6))
    acceleration[0, 3 + up] = gravity
    for i in range(n):
        row = i + 1
        accelerate_body(row, int(table[i, PARENT]), tree, acceleration)
        a[i] = (rest[i] - along(row, reach, acceleration)) / weight[i]
        for k in range(6):
            acceleration[row, k] += tree.subspace[row, k] * a[i]
    return power


def release_joint(
    i: int, parent: int, torque: float, armature: float, tree: Tree, reach: Array, weight: Array, rest: Array
) -> None:
    r"""Add a body to its parent, its joint being free to move.

    .. math::

        U = I s,\quad D = s \cdot U + I_r,\quad u = \tau - s \cdot p,\quad
        I_a = I - U U^T / D,\quad p_a = p + I_a c + U u / D

    Args:
        i: Number of the body.
        parent: Row of its parent.
        torque: On the joint.
        armature: Inertia of the rotor.
        tree: The bodies; inertia and force of the parent are changed in place.
        reach: U of every body; changed in place.
        weight: D of every body; changed in place.
        rest: u of every body; changed in place.
    """
    row = i + 1
    inertia, force, drift = tree.inertia, tree.force, tree.drift
    for j in range(6):
        total = 0.0
        for k in range(6):
            total += inertia[row, j, k] * tree.subspace[row, k]
        reach[row, j] = total
    weight[i] = along(row, tree.subspace, reach) + armature
    rest[i] = torque - along(row, tree.subspace, force)
    inverse = 1.0 / weight[i]
    for j in range(6):
        factor = reach[row, j] * inverse
        added = factor * rest[i]
        for k in range(6):
            inertia[row, j, k] -= factor * reach[row, k]
            added += inertia[row, j, k] * drift[row, k]
        force[row, j] += added
    shift_force(row, parent, tree.offset, force)
    shift_inertia(row, parent, tree.offset, inertia)


def carry_loads(table: Array, a: Array, up: int, gravity: float, tree: Tree) -> None:
    """Turn every body's force into the one that its joint passes on to it, under given accelerations."""
    n = a.shape[0]
    acceleration = np.zeros((n + 1, 6))
    acceleration[0, 3 + up] = gravity
    for i in range(n):
        row = i + 1
        accelerate_body(row, int(table[i, PARENT]), tree, acceleration)
        for k in range(6):
            acceleration[row, k] += tree.subspace[row, k] * a[i]
        for j in range(6):
            for k in range(6):
                tree.force[row, j] += tree.inertia[row, j, k] * acceleration[row, k]
    for i in range(n - 1, -1, -1):
        shift_force(i + 1, int(table[i, PARENT]), tree.offset, tree.force)


def inverse_dynamics(
    q: Array, v: Array, a: Array, bodies: Array, up: int, gravity: float, torque: Array
) -> None:
    """Torques of a motion without contact, armature included: Newton and Euler, recursively.

    Args:
        q: Coordinates, shape ``(n,)``.
        v: Velocities, shape ``(n,)``.
        a: Accelerations, shape ``(n,)``.
        bodies: The model.
        up: Index of the vertical axis of the world.
        gravity: In [m] / [s²].
        torque: On the coordinates, shape ``(n,)``; changed in place.
    """
    table = body_table(bodies, q.shape[0])
    tree = moving_tree(table, q, v)
    carry_loads(table, a, up, gravity, tree)
    for i in range(q.shape[0]):
        torque[i] = along(i + 1, tree.subspace, tree.force) + table[i, ARMATURE] * a[i]


def gravity_torques(q: Array, bodies: Array, up: int, gravity: float, torque: Array) -> None:
    """Torques that hold the bodies at rest; as :func:`inverse_dynamics` without motion."""
    rest = np.zeros(q.shape[0])
    inverse_dynamics(q, rest, rest, bodies, up, gravity, torque)


def inertia_torques(q: Array, a: Array, bodies: Array, torque: Array) -> None:
    """Torques of accelerations alone, armature included: mass matrix times acceleration."""
    inverse_dynamics(q, np.zeros(q.shape[0]), a, bodies, 2, 0.0, torque)


def contact_forces(q: Array, v: Array, bodies: Array, contact: Array, points: Array) -> float:
    """Contact forces of a state; as :func:`forward_dynamics` without the accelerations."""
    n = q.shape[0]
    tree = moving_tree(body_table(bodies, n), q, v)
    return touch_ground(point_table(bodies, n), contact, points, tree)


def observe(
    q: Array, v: Array, a: Array, bodies: Array, up: int, gravity: float, points: Array
) -> tuple[float, float, float, float]:
    """Energies, and what the first joint passes on to its body, under known contact forces.

    Args:
        q: Coordinates, shape ``(n,)``.
        v: Velocities, shape ``(n,)``.
        a: Accelerations, shape ``(n,)``.
        bodies: The model.
        up: Index of the vertical axis of the world.
        gravity: In [m] / [s²].
        points: Forward and upward force of every contact point in the first two columns.

    Returns:
        Kinetic and potential energy in [J], force along x in [N] and moment about y in [N m], these two in
        the frame of the first body.
    """
    n = q.shape[0]
    table, places = body_table(bodies, n), point_table(bodies, n)
    tree = moving_tree(table, q, v)
    kinetic, potential = energies(table, v, up, gravity, tree)
    for number in range(places.shape[0]):
        push_point(places, number, points[number, 0], points[number, 1], tree)
    carry_loads(table, a, up, gravity, tree)
    force, moment = 0.0, 0.0
    for k in range(3):
        force += tree.rotation[1, k, 0] * tree.force[1, 3 + k]
        moment += tree.rotation[1, k, 1] * tree.force[1, k]
    return kinetic, potential, force, moment


def energies(table: Array, v: Array, up: int, gravity: float, tree: Tree) -> tuple[float, float]:
    """Kinetic energy with that of the rotors, and potential energy, zero at the world's origin, in [J]."""
    twice_kinetic, potential = 0.0, 0.0
    for i in range(v.shape[0]):
        row = i + 1
        twice_kinetic += table[i, ARMATURE] * v[i] * v[i]
        for j in range(6):
            for k in range(6):
                twice_kinetic += tree.velocity[row, j] * tree.inertia[row, j, k] * tree.velocity[row, k]
        height = table[i, MASS] * tree.origin[row, up]
        for k in range(3):
            height += tree.rotation[row, up, k] * table[i, FIRST_MOMENT + k]
        potential += gravity * height
    return 0.5 * twice_kinetic, potential
