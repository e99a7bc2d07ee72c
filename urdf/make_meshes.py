"""Make the meshes of the device that the URDF files show, and of its wearer: ``python urdf/make_meshes.py``.

Every mesh is lofted, turned or bent from the few numbers below, which were drawn by eye for the lengths in
the URDF files and carry no data. Frames are those of the links: x forward, y left, z up, origin at the
upper joint, in [m]. A mesh is closed, its faces run counterclockwise seen from outside, and the same
numbers give the same bytes. numpy is all that it needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
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


def limb(rings: np.ndarray, *, rows: int = 15, points: int = 20) -> Mesh:
    """Limb of ellipses along z with domes for ends, on cubics whose slopes are central differences.

    Args:
        rings: From end to end: height, centre x and y, half axes x and y, all in [m], shape ``(n, 5)``.
        rows: Rings of the mesh beside those of the domes.
        points: Of a ring.

    Returns:
        The mesh.
    """
    rings = rings[np.argsort(rings[:, 0])]
    places, slopes = np.linspace(0.0, len(rings) - 1.0, rows), np.gradient(rings, axis=0)
    start = np.minimum(places.astype(int), len(rings) - 2)
    share, rise = (places - start)[:, None], rings[start + 1] - rings[start]
    bow = (slopes[start] - rise) * (1.0 - share) - (slopes[start + 1] - rise) * share
    curve = rings[start] + share * rise + share * (1.0 - share) * bow
    ends = _dome(curve[0], curve[1]), _dome(curve[-1], curve[-2])[::-1]
    return closed(ellipses(np.concatenate((ends[0], curve[1:-1], ends[1])), points))


def _dome(ring: np.ndarray, neighbour: np.ndarray) -> np.ndarray:
    turn = np.linspace(0.1, np.pi / 2.0, 4)
    dome = np.tile(ring, (4, 1))
    dome[:, 0] += np.sign(ring[0] - neighbour[0]) * 0.8 * ring[3:].min() * np.cos(turn)
    dome[:, 3:] *= np.sin(turn)[:, None]
    return dome


def ellipses(rings: np.ndarray, points: int) -> np.ndarray:
    """Points of rings as :func:`limb` takes them.

    Args:
        rings: Shape ``(n, 5)``.
        points: Of a ring.

    Returns:
        Shape ``(n, points, 3)``.
    """
    made = []
    for height, x, y, half_x, half_y in rings:
        ring = outline(half_x, half_y, 2.0, points) + np.array([x, y])
        made.append(np.column_stack((ring, np.full(points, height))))
    return np.array(made)


def sleeve(rings: np.ndarray, low: float, high: float, *, rows: int = 2, points: int = 24) -> Mesh:
    """Strap around a limb, 4 mm thick.

    Args:
        rings: Of the limb, as :func:`limb` takes them.
        low: Height of its lower edge in [m].
        high: Height of its upper edge in [m].
        rows: Rings of its outside.
        points: Of a ring.

    Returns:
        The mesh.
    """
    rings, heights = rings[np.argsort(rings[:, 0])], np.linspace(low, high, rows)
    skin = np.column_stack([np.interp(heights, rings[:, 0], column) for column in rings.T])
    outside = skin + np.array([0.0, 0.0, 0.0, 0.004, 0.004])
    around = ellipses(np.concatenate((outside, skin[::-1])), points)
    n, m, _ = around.shape
    row, column = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = (row * m + column).ravel(), (row * m + (column + 1) % m).ravel()
    above = [(corner + m) % (n * m) for corner in (a, b)]
    faces = np.concatenate((np.column_stack((a, b, above[1])), np.column_stack((a, above[1], above[0]))))
    return Mesh(around.reshape(-1, 3), faces)


def pipe(path: np.ndarray, radius: float, *, beside: Sequence[float], points: int = 12) -> Mesh:
    """Round tube along a path.

    Args:
        path: Points in [m], shape ``(n, 3)``.
        radius: In [m].
        beside: A direction that the path never takes.
        points: Of a ring.

    Returns:
        The mesh.
    """
    ahead = np.gradient(path, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    across = np.asarray(beside, dtype=float) - (ahead @ np.asarray(beside))[:, None] * ahead
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    ring = outline(radius, radius, 2.0, points)
    around = ring[None, :, :1] * across[:, None] + ring[None, :, 1:] * np.cross(ahead, across)[:, None]
    return closed(path[:, None] + around)


def curved(start: np.ndarray, corner: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Parabola that touches the lines to a corner where it starts and ends.

    Args:
        start: In [m], shape ``(3,)``.
        corner: Likewise.
        end: Likewise.

    Returns:
        Points, shape ``(9, 3)``.
    """
    share = np.linspace(0.0, 1.0, 9)[:, None]
    return np.asarray((1.0 - share) ** 2 * start + 2.0 * share * (1.0 - share) * corner + share**2 * end)


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


# What the viewer scales the meshes by, which knows these numbers too.
BODY_HEIGHT, BODY_MASS = 1.75, 70.0  # of the wearer [m], [kg]
BAR_HEIGHT = 1.83  # of the bar that ropes hang from [m]
TORQUE_RADIUS = 0.1  # of the arrows of motor torques [m]

# The wearer: a body of this height and mass. Of a limb: share of its length below the upper joint, centre
# forward, half axes forward and sideways in [m]; of trunk and head: height over the hips as a share of the
# trunk. Of the foot: share of its length from the heel; centre over the sole, half height and half width as
# shares of its height.
BODY = {
    "thigh": (
        (-0.03, -0.004, 0.08, 0.074),
        (0.08, -0.002, 0.088, 0.08),
        (0.3, 0.006, 0.081, 0.075),
        (0.55, 0.009, 0.068, 0.064),
        (0.8, 0.007, 0.056, 0.053),
        (0.95, 0.006, 0.053, 0.05),
        (1.02, 0.004, 0.05, 0.047),
    ),
    "shank": (
        (-0.02, 0.005, 0.047, 0.045),
        (0.08, 0.0, 0.05, 0.048),
        (0.28, -0.01, 0.056, 0.053),
        (0.5, -0.01, 0.048, 0.046),
        (0.75, -0.005, 0.036, 0.035),
        (0.93, -0.003, 0.033, 0.032),
        (1.0, -0.004, 0.034, 0.031),
    ),
    "foot": (
        (0.1, 0.52, 0.48, 0.42),
        (0.24, 0.68, 0.64, 0.5),
        (0.36, 0.66, 0.64, 0.52),
        (0.52, 0.48, 0.46, 0.58),
        (0.7, 0.34, 0.33, 0.66),
        (0.84, 0.25, 0.24, 0.64),
        (0.92, 0.2, 0.19, 0.54),
    ),
    "trunk": (
        (-0.17, -0.006, 0.066, 0.095),
        (-0.06, -0.014, 0.106, 0.15),
        (0.06, -0.016, 0.112, 0.166),
        (0.2, -0.002, 0.098, 0.15),
        (0.36, 0.01, 0.09, 0.134),
        (0.55, 0.012, 0.104, 0.148),
        (0.72, 0.008, 0.115, 0.168),
        (0.86, -0.004, 0.106, 0.182),
        (0.95, -0.012, 0.082, 0.172),
        (1.02, -0.014, 0.06, 0.116),
        (1.08, -0.008, 0.052, 0.06),
        (1.2, 0.006, 0.05, 0.051),
    ),
    "head": (
        (1.16, 0.02, 0.046, 0.044),
        (1.22, 0.03, 0.07, 0.06),
        (1.33, 0.024, 0.092, 0.074),
        (1.46, 0.012, 0.099, 0.077),
        (1.55, 0.004, 0.086, 0.069),
        (1.59, 0.002, 0.066, 0.054),
    ),
    "upper_arm": (
        (-0.1, 0.042, 0.04),
        (0.08, 0.055, 0.051),
        (0.3, 0.052, 0.046),
        (0.6, 0.046, 0.041),
        (0.88, 0.041, 0.038),
        (1.04, 0.039, 0.037),
    ),
    "forearm": (
        (-0.06, 0.037, 0.036),
        (0.08, 0.043, 0.044),
        (0.25, 0.045, 0.046),
        (0.55, 0.037, 0.037),
        (0.85, 0.028, 0.026),
        (1.0, 0.027, 0.024),
    ),
}
TRUNK, FOOT, FOOT_HEIGHT = 0.504, 0.266, 0.068  # [m]
LENGTHS = {"thigh": 0.42, "shank": 0.43, "upper_arm": 0.326}  # [m]
STRAPS = {"thigh": (0.60, 0.46), "shank": (0.46, 0.32)}  # from and to, as shares of the length
FOREARM, CRUTCH = 0.256, 1.104  # [m], the second from the elbow to the tip
HANDLE = 0.045  # of its middle in front of the shaft [m]


def _body_rings(name: str, length: float) -> np.ndarray:
    return np.array([(share * length, x, 0.0, a, b) for share, x, a, b in BODY[name]])


def _unit(mesh: Mesh, length: float) -> Mesh:
    """Limb of 1 m along z: who draws it makes it as long as it is."""
    return Mesh(mesh.vertices / [1.0, 1.0, length], mesh.faces)


def wearer_limb(name: str) -> Mesh:
    """Thigh or shank, of 1 m below its upper joint."""
    return _unit(limb(_body_rings(name, -LENGTHS[name])), LENGTHS[name])


def wearer_strap(name: str) -> Mesh:
    """Strap around it."""
    low, high = (-share * LENGTHS[name] for share in STRAPS[name])
    return _unit(sleeve(_body_rings(name, -LENGTHS[name]), low, high), LENGTHS[name])


def wearer_foot() -> Mesh:
    """Foot in the frame of the ankle, its sole a foot height below."""
    rings = [
        ((share - 0.25) * FOOT, (1.0 - centre) * FOOT_HEIGHT, 0.0, a * FOOT_HEIGHT, b * FOOT_HEIGHT)
        for share, centre, a, b in BODY["foot"]
    ]
    return moved(limb(np.array(rings)), turn=_ALONG_X)


def wearer_vest() -> Mesh:
    """Vest of the harness."""
    return sleeve(_body_rings("trunk", TRUNK), 0.50 * TRUNK, 0.80 * TRUNK, rows=6, points=28)


def wearer_harness() -> Mesh:
    """Shoulder straps, from where a rope meets them to front and back of the vest."""
    rings = _body_rings("trunk", TRUNK)
    half_x, half_y = (np.interp(0.80 * TRUNK, rings[:, 0], rings[:, column]) for column in (3, 4))
    angle, straps = math.radians(52.0), []
    for side in (1.0, -1.0):
        hook = np.array([0.0, 0.15 * side, 1.12 * TRUNK])
        for front in (1.0, -1.0):
            end = np.array([front * half_x * math.sin(angle), side * half_y * math.cos(angle), 0.80 * TRUNK])
            middle = 0.5 * (hook + end) + [front * 0.035, 0.0, 0.02]
            straps.append(pipe(curved(hook, middle, end), 0.007, beside=(0.0, 1.0, 0.0), points=6))
    return joined(straps)


def wearer_upper_arm() -> Mesh:
    """Upper arm of 1 m from the shoulder along z."""
    rings = [(share * LENGTHS["upper_arm"], 0.0, 0.0, a, b) for share, a, b in BODY["upper_arm"]]
    return _unit(limb(np.array(rings)), LENGTHS["upper_arm"])


def _forearm_rings() -> np.ndarray:
    """Those of a forearm whose elbow is on z and whose hand holds a handle in front of it."""
    rows = [(CRUTCH - share * FOREARM, share * HANDLE, 0.0, a, b) for share, a, b in BODY["forearm"]]
    return np.array(rows)


def wearer_forearm() -> Mesh:
    """Forearm and hand on a crutch; from its tip to the elbow is 1 m along z."""
    latitude = np.radians(np.linspace(-84.0, 84.0, 12))
    half = (0.040 * np.cos(latitude), 0.036 * np.cos(latitude))
    height, x = CRUTCH - FOREARM + 0.005 + 0.046 * np.sin(latitude), np.full(12, HANDLE)
    hand = closed(ellipses(np.column_stack((height, x, np.zeros(12), *half)), 20))
    return _unit(joined([limb(_forearm_rings()), hand]), CRUTCH)


def crutch() -> Mesh:
    """Crutch to it: shaft, behind the forearm up to the cuff, handle, cuff and rubber tip."""
    grip, rings = CRUTCH - FOREARM, _forearm_rings()
    high, low = (CRUTCH - share * FOREARM for share in (0.16, 0.34))
    shaft = np.array([[0.0, 0.0, 0.04], [0.0, 0.0, 0.4 * grip], [0.0, 0.0, grip - 0.02],
                      [-0.045, 0.0, 0.5 * (high + low)]])  # fmt: skip
    handle = np.array([[x, 0.0, grip] for x in (-0.012, 0.05, 0.105)])
    tip = [(0.0, 0.0, 0.0, 0.027, 0.027), (0.012, 0.0, 0.0, 0.024, 0.024), (0.05, 0.0, 0.0, 0.017, 0.017)]
    across = (0.0, 1.0, 0.0)
    parts = [pipe(shaft, 0.0115, beside=across), pipe(handle, 0.0155, beside=across),
             sleeve(rings, low, high, rows=3), closed(ellipses(np.array(tip), 20))]  # fmt: skip
    return _unit(joined(parts), CRUTCH)


def motor_cap() -> Mesh:
    """Cap of a motor of radius 1 about z: a disc of height 1.15 with a groove in either face."""
    half, groove = 0.575, 0.525
    rim = [(1.0, half - 0.14), (0.958, half - 0.042), (0.86, half), (0.72, half), (0.70, groove)]
    upper = [*rim, (0.64, groove), (0.62, half)]
    profile = [(radius, -height) for radius, height in reversed(upper)] + upper
    return closed(ellipses(np.array([(height, 0.0, 0.0, radius, radius) for radius, height in profile]), 28))


def torque(level: int) -> Mesh:
    """Arrow about z that begins on x; the longest of six sweeps 270°."""
    radius, head = TORQUE_RADIUS, 0.044
    sweep = math.radians(45.0) * level
    # The shortest is hardly longer than its head.
    angle = np.linspace(0.0, max(sweep - head / radius, 0.3 * sweep), 4 * level + 2)
    shaft = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)))
    # The head goes along the arc's direction there and a little inward, as the arc goes on.
    out = shaft[-1] / radius
    ahead = np.cross([0.0, 0.0, 1.0], out) - 0.5 * head / radius * out
    ahead /= np.linalg.norm(ahead)
    cone = closed(ellipses(np.array([(0.0, 0.0, 0.0, 0.019, 0.019), (0.043, 0.0, 0.0, 5e-4, 5e-4)]), 12))
    turn = np.column_stack(([0.0, 0.0, 1.0], np.cross(ahead, [0.0, 0.0, 1.0]), ahead))
    return joined(
        [pipe(shaft, 0.008, beside=(0.0, 0.0, 1.0), points=8), moved(cone, turn=turn, shift=shaft[-1])]
    )


def mast() -> Mesh:
    """Mast on the left rail of the treadmill, its arm, and the bar that ropes hang from."""
    foot, bar = np.array([-0.62, 0.38, -0.085]), np.array([0.0, 0.0, BAR_HEIGHT])
    arm, elbow = np.array([0.0, 0.0, 1.88]), np.array([-0.62, 0.38, 1.88])
    inward = 0.20 * (arm - elbow) / np.linalg.norm(arm - elbow)
    bend = curved(elbow - [0.0, 0.0, 0.20], elbow, elbow + inward)
    ends = np.array([[0.0, -0.19, BAR_HEIGHT], bar, [0.0, 0.19, BAR_HEIGHT]])
    across = (1.0, 0.0, 0.0)
    hanger = np.array([[0.0, 0.0, 1.825], [0.0, 0.0, 1.885]])
    parts = [pipe(np.array([foot, *bend, arm]), 0.022, beside=across, points=14),
             pipe(ends, 0.016, beside=across), pipe(hanger, 0.012, beside=across)]  # fmt: skip
    return joined(parts)


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
    "wearer_thigh": partial(wearer_limb, "thigh"),
    "wearer_shank": partial(wearer_limb, "shank"),
    "wearer_thigh_strap": partial(wearer_strap, "thigh"),
    "wearer_shank_strap": partial(wearer_strap, "shank"),
    "wearer_foot": wearer_foot,
    "wearer_trunk": lambda: limb(_body_rings("trunk", TRUNK), rows=20, points=24),
    "wearer_head": lambda: limb(_body_rings("head", TRUNK), rows=12, points=24),
    "wearer_vest": wearer_vest,
    "wearer_harness": wearer_harness,
    "wearer_upper_arm": wearer_upper_arm,
    "wearer_forearm": wearer_forearm,
    "crutch": crutch,
    "motor_cap": motor_cap,
    **{f"torque_{level}": partial(torque, level) for level in range(1, 7)},
    "mast": mast,
}


def corner_normals(mesh: Mesh) -> np.ndarray:
    """Return normals that are smooth on curved parts and preserve edges.

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
