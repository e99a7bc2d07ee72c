"""Make the meshes of the device that the URDF files show: ``python urdf/make_meshes.py``.

Every mesh is lofted, turned or bent from the few numbers below, which were drawn by eye for the lengths in
the URDF files and carry no data. Frames are those of the links: x forward, y left, z up, origin at the
upper joint, in [m]. A mesh is closed, its faces run counterclockwise seen from outside, and the same
numbers give the same bytes. numpy is all that it needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

FOLDER = Path(__file__).with_name("meshes")
_SMOOTH = math.cos(math.radians(38.0))  # faces that turn by less share their normals
_WELD = 4  # decimals of a coordinate in the file: 0.1 mm
_ALONG_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # turns z into y
_ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # turns z into x


class Mesh(NamedTuple):
    """Triangle mesh.

    Attributes:
        vertices: In [m], shape ``(n, 3)``.
        faces: Indices of three vertices each, shape ``(m, 3)``.
    """

    vertices: np.ndarray
    faces: np.ndarray


def closed(rings: np.ndarray) -> Mesh:
    """Skin over rings of points, closed by a fan at either end.

    Args:
        rings: Counterclockwise seen from the last ring, shape ``(n, m, 3)``.

    Returns:
        The mesh.
    """
    n, m, _ = rings.shape
    vertices = np.concatenate((rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)))
    row, column = np.meshgrid(np.arange(n - 1), np.arange(m), indexing="ij")
    a = (row * m + column).ravel()
    b = (row * m + (column + 1) % m).ravel()
    around, after = np.arange(m), (np.arange(m) + 1) % m
    first, last = np.full(m, n * m), np.full(m, n * m + 1)
    top = (n - 1) * m
    faces = np.concatenate(
        (
            np.column_stack((a, b, b + m)),
            np.column_stack((a, b + m, a + m)),
            np.column_stack((first, after, around)),
            np.column_stack((last, top + around, top + after)),
        )
    )
    return Mesh(vertices, faces)


def outline(half_x: float, half_y: float, power: float, points: int) -> np.ndarray:
    """Superellipse: an ellipse at power 2, nearly a rectangle at 5.

    Args:
        half_x: Half axis along x in [m].
        half_y: Half axis along y in [m].
        power: Of the superellipse.
        points: Their number.

    Returns:
        Counterclockwise points, shape ``(points, 2)``.
    """
    angle = 2.0 * np.pi * np.arange(points) / points
    x, y = np.cos(angle), np.sin(angle)
    bent = [np.sign(part) * np.abs(part) ** (2.0 / power) for part in (x, y)]
    return np.column_stack((half_x * bent[0], half_y * bent[1]))


def loft(
    sections: Sequence[Sequence[float]], *, power: float = 3.5, points: int = 20, edge: float = 0.006
) -> Mesh:
    """Body along z with rounded ends.

    Args:
        sections: From the lowest up: height, centre x, centre y, half axis x, half axis y, all in [m].
        power: Of the superellipses.
        points: Of a ring.
        edge: Radius of the rounding at the ends in [m].

    Returns:
        The mesh.
    """
    rows = [list(map(float, section)) for section in sections]
    turn = np.radians([0.0, 50.0])
    low = [_shrunk(rows[0], edge * (1.0 - math.sin(a)), -edge * math.cos(a)) for a in turn]
    high = [_shrunk(rows[-1], edge * (1.0 - math.sin(a)), edge * math.cos(a)) for a in turn[::-1]]
    rings = []
    for height, x, y, half_x, half_y in (*low, *rows, *high):
        ring = outline(half_x, half_y, power, points) + np.array([x, y])
        rings.append(np.column_stack((ring, np.full(points, height))))
    return closed(np.array(rings))


def _shrunk(section: Sequence[float], by: float, shift: float) -> list[float]:
    height, x, y, half_x, half_y = section
    return [height + shift, x, y, half_x - by, half_y - by]


def turned(profile: Sequence[tuple[float, float]], columns: int = 24) -> Mesh:
    """Turn a profile about the y axis.

    Args:
        profile: Points (radius, y) in [m] from one end of the axis to the other, radius above 0.
        columns: Facets of a full turn.

    Returns:
        The mesh.
    """
    rings = []
    for radius, along in profile:
        ring = outline(radius, radius, 2.0, columns)
        rings.append(np.column_stack((ring, np.full(columns, along))))
    return moved(closed(np.array(rings)), turn=_ALONG_Y)


def bent(
    path: np.ndarray,
    half_height: np.ndarray | float,
    half_width: float,
    *,
    power: float = 4.0,
    points: int = 16,
) -> Mesh:
    """Flat bar bent along a path in a level plane.

    Args:
        path: Points in [m], shape ``(n, 3)``.
        half_height: Half the height of the bar in [m].
        half_width: Half its thickness in [m].
        power: Of the section.
        points: Of the section.

    Returns:
        The mesh.
    """
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0])
    beside = np.cross(up, forward)
    section = outline(half_width, half_height, power, points)
    rings = []
    for point, across in zip(path, beside, strict=True):
        rings.append(point + section[:, :1] * across + section[:, 1:] * up)
    return closed(np.array(rings))


def arc(radius: float, start: float, end: float, centre: Sequence[float], points: int) -> np.ndarray:
    """Points of a level arc.

    Args:
        radius: In [m].
        start: Angle from x towards y in [deg].
        end: Angle in [deg].
        centre: In [m].
        points: Their number.

    Returns:
        Shape ``(points, 3)``.
    """
    angle = np.radians(np.linspace(start, end, points))
    around = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(points)))
    return np.asarray(radius * around + np.asarray(centre, dtype=float))


def moved(mesh: Mesh, *, turn: np.ndarray | None = None, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Turn a mesh, then shift it.

    Args:
        mesh: The mesh.
        turn: Rotation, shape ``(3, 3)``.
        shift: In [m].

    Returns:
        The mesh.
    """
    vertices = mesh.vertices if turn is None else mesh.vertices @ turn.T
    return Mesh(vertices + np.asarray(shift, dtype=float), mesh.faces)


def joined(meshes: Iterable[Mesh]) -> Mesh:
    """Put closed meshes into one.

    Args:
        meshes: In the same frame.

    Returns:
        One mesh.
    """
    vertices, faces, count = [], [], 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def backpack() -> Mesh:
    """Shell of the backpack: narrower and thinner towards the top."""
    sections = [
        (0.000, -0.166, 0.0, 0.040, 0.115),
        (0.020, -0.168, 0.0, 0.048, 0.132),
        (0.110, -0.170, 0.0, 0.052, 0.140),
        (0.220, -0.168, 0.0, 0.048, 0.134),
        (0.285, -0.164, 0.0, 0.038, 0.118),
        (0.300, -0.162, 0.0, 0.032, 0.108),
    ]
    return loft(sections, power=4.5, points=28, edge=0.010)


def battery() -> Mesh:
    """Battery on the back of the backpack."""
    sections = [(0.060, -0.226, 0.0, 0.018, 0.092), (0.235, -0.222, 0.0, 0.018, 0.088)]
    return loft(sections, power=5.0, points=20, edge=0.006)


def waist_frame() -> Mesh:
    """Bar around the back of the waist, from hip actuator to hip actuator."""
    corner = arc(0.075, 90.0, 175.0, (-0.075, 0.088, 0.012), 7)
    side = np.array([[0.012, 0.168, 0.0], [-0.03, 0.166, 0.004]])
    left = np.concatenate((side, corner, [[-0.150, 0.05, 0.012]]))
    path = np.concatenate((left, (left * [1.0, -1.0, 1.0])[::-1]))
    return bent(path, 0.025, 0.011)


def thigh_shell() -> Mesh:
    """Shell over the femur tube, waisted, bowed a little forward."""
    share = np.linspace(1.0, 0.0, 8)
    half_x = 0.040 - 0.011 * share - 0.009 * np.sin(np.pi * share)
    bow = 0.010 * np.sin(np.pi * share)
    return loft([(-0.056 - 0.308 * s, x, 0.0, a, 0.0165) for s, x, a in zip(share, bow, half_x, strict=True)])


def shank_shell() -> Mesh:
    """Shell over the tibia tube, fuller below the knee."""
    share = np.linspace(1.0, 0.0, 8)
    half_x = 0.034 - 0.014 * share + 0.004 * np.sin(np.pi * share)
    bow = -0.006 * np.sin(np.pi * share)
    return loft([(-0.050 - 0.345 * s, x, 0.0, a, 0.0145) for s, x, a in zip(share, bow, half_x, strict=True)])


def motor_hub() -> Mesh:
    """Hub on both faces of a motor: a rim, a groove, a bolt."""
    rim = [(0.039, 0.0290), (0.0375, 0.0335), (0.034, 0.0350), (0.027, 0.0350)]
    bolt = [(0.0255, 0.0325), (0.013, 0.0325), (0.0115, 0.0365), (0.006, 0.0375)]
    side = [*rim, *bolt]
    return turned([(r, -y) for r, y in reversed(side)] + side)


def ankle_hub() -> Mesh:
    """Joint of the ankle-foot orthosis."""
    side = [
        (0.027, 0.0150),
        (0.0255, 0.0185),
        (0.022, 0.0200),
        (0.013, 0.0200),
        (0.011, 0.0225),
        (0.005, 0.023),
    ]
    return turned([(r, -y) for r, y in reversed(side)] + side, columns=24)


def cuff(radius: float, inside: float, height: float) -> Mesh:
    """Half shell outside the left limb, and the bar that holds it on the tube.

    Args:
        radius: Of the limb in [m].
        inside: How far the middle of the limb lies inside the tube in [m].
        height: In [m].

    Returns:
        The mesh, at the middle of its height.
    """
    shell = bent(arc(radius, -18.0, 198.0, (0.0, -inside, 0.0), 15), 0.5 * height, 0.0035, points=10)
    bar = loft(
        [(-0.018, 0.0, -0.002, 0.016, 0.014), (0.018, 0.0, -0.002, 0.016, 0.014)], points=16, edge=0.004
    )
    return joined((shell, bar))


def sole() -> Mesh:
    """Foot plate, its lower face at 0, x from the ankle."""
    table = [(-0.048, 0.020), (-0.035, 0.030), (0.000, 0.036), (0.060, 0.042), (0.110, 0.046)]
    table += [(0.140, 0.043), (0.158, 0.032), (0.168, 0.016)]
    # Heights stand along x here: a section's x is what becomes minus the height.
    plate = loft([(x, -0.009, 0.0, 0.009, half) for x, half in table], power=4.0, points=24, edge=0.003)
    return moved(plate, turn=_ALONG_X)


def stirrup() -> Mesh:
    """Upright of the orthosis from the ankle down to the foot plate, then under the foot of the left leg."""
    table = [(-0.072, 0.014), (-0.035, 0.012), (-0.004, 0.017)]
    upright = loft([(z, 0.0, 0.0, half, 0.0075) for z, half in table], points=14, edge=0.003)
    section = (0.0, -0.02, 0.022, 0.026)
    across = loft([(-0.070, *section), (-0.062, *section)], points=12, edge=0.002)
    return joined((upright, across))


MESHES: dict[str, Callable[[], Mesh]] = {
    "backpack": backpack,
    "battery": battery,
    "waist_frame": waist_frame,
    "thigh_shell": thigh_shell,
    "shank_shell": shank_shell,
    "motor_hub": motor_hub,
    "ankle_hub": ankle_hub,
    "thigh_cuff": lambda: cuff(0.080, 0.074, 0.075),
    "shank_cuff": lambda: cuff(0.060, 0.054, 0.065),
    "sole": sole,
    "stirrup": stirrup,
}


def corner_normals(mesh: Mesh) -> np.ndarray:
    """Normals that are smooth on curved parts and keep edges.

    A corner takes the mean, weighted by area, of the faces around its vertex that turn away from its own by
    less than an edge does.

    Args:
        mesh: The mesh.

    Returns:
        Unit normals, shape ``(m, 3, 3)``.
    """
    corners = mesh.vertices[mesh.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    around: list[list[int]] = [[] for _ in mesh.vertices]
    for face, vertices in enumerate(mesh.faces):
        for vertex in vertices:
            around[vertex].append(face)
    normals = np.empty((len(mesh.faces), 3, 3))
    for face, vertices in enumerate(mesh.faces):
        for corner, vertex in enumerate(vertices):
            near = np.array(around[vertex])
            near = near[unit[near] @ unit[face] > _SMOOTH]
            total = area[near].sum(axis=0)
            normals[face, corner] = total / np.linalg.norm(total)
    return normals


def obj_text(name: str, mesh: Mesh) -> str:
    """Text of a Wavefront OBJ file with normals.

    Args:
        name: Of the object.
        mesh: The mesh.

    Returns:
        The text.
    """
    normals = np.round(corner_normals(mesh), 2) + 0.0
    different, index = np.unique(normals.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 3)
    lines = ["# Made by make_meshes.py.", f"o {name}"]
    lines += ["v " + " ".join(f"{value:.{_WELD}f}" for value in vertex) for vertex in mesh.vertices + 0.0]
    lines += ["vn " + " ".join(f"{value:.2f}" for value in normal) for normal in different]
    for face, turns in zip(mesh.faces + 1, index + 1, strict=True):
        lines.append(
            "f " + " ".join(f"{vertex}//{normal}" for vertex, normal in zip(face, turns, strict=True))
        )
    return "\n".join(lines).replace("-0.0000", "0.0000") + "\n"


def texts() -> dict[str, str]:
    """Text of every mesh file by its name."""
    return {f"{name}.obj": obj_text(name, make()) for name, make in MESHES.items()}


def main() -> None:
    """Write the mesh files."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in texts().items():
        (FOLDER / name).write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
