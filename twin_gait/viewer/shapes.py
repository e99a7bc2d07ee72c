"""Smooth triangle meshes from a few numbers: rounded boxes, solids of revolution, tubes, arrows."""

import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from twin_gait.files import shipped_file

_CREASE = math.cos(math.radians(40.0))  # edges with a larger angle keep separate normals


class Shape(NamedTuple):
    """Triangle mesh."""

    vertices: np.ndarray  # in [m], shape ``(n, 3)``
    normals: np.ndarray  # outward unit normals, shape ``(n, 3)``
    faces: np.ndarray  # indices of three vertices each, shape ``(m, 3)``
    # red, green, blue, and opacity if it varies, of each vertex from 0 to 1, shape ``(n, 3)`` or ``(n, 4)``;
    # None to use the material's values
    colours: np.ndarray | None = None


def rounded_box(size: Sequence[float], radius: float) -> Shape:
    """Make a box with rounded edges: a ball whose eight octants are moved to the corners.

    ``size``: lengths along x, y and z in [m]; ``radius`` of the edges in [m], 0 or more; at most half the
    shortest side is used.
    """
    half = np.asarray(size, dtype=float) / 2.0
    # A box without any rounding would have no normals at its edges.
    radius = float(np.clip(radius, 1e-6 * half.min(), 0.999 * half.min()))
    eighth = np.radians([0.0, 45.0, 90.0])
    latitude = np.concatenate((eighth - math.pi / 2.0, eighth))[:, None]
    longitude = np.concatenate([eighth + quarter * math.pi / 2.0 for quarter in range(4)])
    corner = [np.repeat([1, -1, -1, 1], 3), np.repeat([1, 1, -1, -1], 3), np.repeat([-1, 1], 3)[:, None]]
    ball = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    parts = zip(ball, corner, half - radius, strict=True)
    points = np.stack(np.broadcast_arrays(*(radius * on + way * side for on, side, way in parts)), axis=2)
    middle = np.tile([0.0, 0.0, half[2]], (1, 12, 1))
    return surface(np.concatenate((-middle, points, middle)))


def surface(rings: np.ndarray) -> Shape:
    """Make a surface of rings of points, which are closed and counter-clockwise as seen from above.

    ``rings`` from the lowest to the highest in [m], shape ``(n, m, 3)``.
    """
    rings = np.concatenate((rings, rings[:, :1]), axis=1)
    faces, points = _grid_faces(*rings.shape[:2]), rings.reshape(-1, 3)
    first, second, third = (points[faces[:, corner]] for corner in range(3))
    whole = np.any(np.cross(second - first, third - first) != 0.0, axis=1)  # at a tip, points coincide
    return compute_normals(points, faces[whole])


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = (row * columns + column).ravel()
    b, c, d = a + columns, a + columns + 1, a + 1
    return np.concatenate((np.stack((c, b, a), axis=1), np.stack((d, c, a), axis=1)))


def revolve(profile: Sequence[tuple[float, float]] | np.ndarray, columns: int = 28) -> Shape:
    """Make a solid of revolution about the z axis.

    ``profile``: points (radius, height) in [m]; the outside is to the right of the direction from each point
    to the next.
    """
    radius, height = np.array(profile, dtype=float).T[:, :, None]
    angle = np.linspace(0.0, 2.0 * math.pi, columns, endpoint=False)
    points = np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), height)
    return surface(np.stack(points, axis=2))


def cylinder(radius: float, length: float, bevel: float = 0.004) -> Shape:
    """Make a cylinder along z with bevelled edges; all in [m].

    The bevel is limited to a third of the radius and of the length.
    """
    half = length / 2.0
    bevel = min(bevel, radius / 3.0, length / 3.0)
    third = bevel * (1.0 - math.cos(math.pi / 4.0))
    upper = [(radius, half - bevel), (radius - third, half - third), (radius - bevel, half), (0.0, half)]
    return revolve([(ring, -height) for ring, height in reversed(upper)] + upper)


def ball(radius: float, columns: int = 28) -> Shape:
    """Make a ball; ``radius`` in [m]."""
    latitude = np.linspace(-math.pi / 2.0, math.pi / 2.0, columns // 2 + 1)
    profile = radius * np.column_stack((np.cos(latitude), np.sin(latitude)))
    profile[[0, -1], 0] = 0.0
    return revolve(profile, columns)


def tube(points: np.ndarray, radius: float, columns: int = 8) -> Shape:
    """Make a round tube along a path, with flat ends.

    ``points`` of the path in [m], shape ``(n, 3)``; neighbours must differ; ``radius`` in [m].
    """
    ahead = np.gradient(points, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    across = _perpendicular_directions(ahead)
    angle = np.linspace(0.0, 2.0 * math.pi, columns, endpoint=False)[None, :, None]
    around = np.cos(angle) * across[:, None, :] + np.sin(angle) * np.cross(ahead, across)[:, None, :]
    middle = np.repeat(points[:, None, :], columns, axis=1)
    return surface(np.concatenate((middle[:1], middle + radius * around, middle[-1:])))


def _perpendicular_directions(ahead: np.ndarray) -> np.ndarray:
    """Compute a direction perpendicular to each segment of a path, without twist along the path."""
    across = np.empty_like(ahead)
    before = np.eye(3)[int(np.argmin(np.abs(ahead[0])))]
    for k, direction in enumerate(ahead):
        side = before - (before @ direction) * direction
        across[k] = before = side / np.linalg.norm(side)
    return across


def compute_normals(vertices: np.ndarray, faces: np.ndarray) -> Shape:
    """Compute the normals of a mesh, smooth on curved parts and sharp at edges.

    ``vertices``: shape ``(n, 3)``; ``faces``: shape ``(m, 3)``. Returns the mesh, in which a vertex on an
    edge is repeated for each side of the edge.
    """
    _, vertex = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1)[faces]
    corners = vertices[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((int(vertex.max()) + 1, 3))
    np.add.at(total, vertex, flat[:, None, :])
    smooth, unit = _unit(total)[vertex], _unit(flat)
    sharp = np.einsum("fij,fj->fi", smooth, unit) < _CREASE
    normals = np.where(sharp[:, :, None], unit[:, None, :], smooth)
    pairs = np.concatenate((corners, normals), axis=2).reshape(-1, 6)
    # Values are rounded, because sums of the same faces in another order differ in the last bit.
    _, first, index = np.unique(np.round(pairs, 6), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # order of first occurrence
    kept = pairs[first[order]]
    return Shape(kept[:, :3], kept[:, 3:], np.argsort(order)[index.reshape(-1, 3)])


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Normalise vectors of shape ``(n, 3)``; a vector of length 0 is not changed."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30))


def translation(centre: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the homogeneous transform of a translation in [m], shape ``(4, 4)``."""
    placement = np.eye(4)
    placement[:3, 3] = centre
    return placement


def frame(
    up: np.ndarray, forward: np.ndarray | None = None, *, at: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """Return the homogeneous transform whose z axis is ``up``, shape ``(4, 4)``.

    Its x axis is as close as possible to ``forward``; None chooses one of the coordinate axes. ``at``:
    position of the origin in [m].
    """
    third = up / np.linalg.norm(up)
    ahead = np.eye(3)[int(np.argmin(np.abs(third)))] if forward is None else forward
    first = ahead - (ahead @ third) * third
    first /= np.linalg.norm(first)
    placement = translation(at)
    placement[:3, :3] = np.column_stack((first, np.cross(third, first), third))
    return placement


def transform_mesh(shape: Shape, placement: np.ndarray) -> Shape:
    """Move a mesh by a homogeneous transform, shape ``(4, 4)``; a reflection reverses the faces."""
    linear = placement[:3, :3]
    normals = _unit(shape.normals @ np.linalg.inv(linear))
    faces = shape.faces[:, ::-1] if np.linalg.det(linear) < 0.0 else shape.faces
    return shape._replace(vertices=shape.vertices @ linear.T + placement[:3, 3], normals=normals, faces=faces)


def select_faces(shape: Shape, chosen: np.ndarray) -> Shape:
    """Return some faces of a mesh with their vertices.

    ``shape``: the mesh, without colours of its vertices; ``chosen``: mask of the faces, shape ``(m,)``.
    """
    used, index = np.unique(shape.faces[chosen], return_inverse=True)
    return Shape(shape.vertices[used], shape.normals[used], index.reshape(-1, 3))


def merge_meshes(items: Iterable[Shape]) -> Shape:
    """Join meshes into one."""
    items = list(items)
    first = np.cumsum([0, *(len(item.vertices) for item in items)])
    return Shape(
        np.concatenate([item.vertices for item in items]),
        np.concatenate([item.normals for item in items]),
        np.concatenate([item.faces + start for item, start in zip(items, first, strict=False)]),
    )


@cache
def _packaged(name: str) -> Shape:
    path = shipped_file(f"meshes/{name}.obj")
    assert path is not None  # it is part of the package
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    vertices = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    faces = [[int(corner.split("/")[0]) - 1 for corner in row[1:]] for row in rows if row[0] == "f"]
    return compute_normals(vertices, np.array(faces))


def load_packaged_mesh(name: str, placement: np.ndarray) -> Shape:
    """Load a mesh made by ``urdf/make_meshes.py``, moved by ``placement`` of shape ``(4, 4)``."""
    return transform_mesh(_packaged(name), placement)
