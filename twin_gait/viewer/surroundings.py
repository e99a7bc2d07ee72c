"""What stands around the figure: light, floor, treadmill, the mast of the ropes."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window, draw_mesh, set_property, set_transform
from twin_gait.viewer.shapes import Shape

Triple = tuple[float, float, float]
# Speed of a belt that runs evenly in [m] / [s]; of another the way in [m] that it has gone by a time in [s].
Belt = float | Callable[[float], float]

ROOT = "/meshcat/surroundings"
TREADMILL = f"{ROOT}/treadmill"
BELT = f"{TREADMILL}/belt"
BELT_MARK_SPACING = 0.20  # [m]
FLOOR = f"{ROOT}/floor"
BELT_TOP = -0.014  # [m]: as deep as the soles of the shipped walks press into the soft ground of the model

RUBBER = Material(colour=(0.21, 0.23, 0.26), roughness=0.95)
DECK = Material(colour=(0.80, 0.83, 0.87), roughness=0.8)
STEEL = Material(colour=(0.66, 0.70, 0.76), roughness=0.8)
_FLOOR = Material(colour=(0.85, 0.875, 0.90), roughness=0.95)
MARK = Material(colour=(0.42, 0.46, 0.52), roughness=0.95)

_BELT_LENGTH, _BELT_WIDTH = 1.80, 0.70
_RAIL_WIDTH = 0.06
_DECK_HEIGHT = 0.085
_EDGE = 0.005
_END_LENGTH = BELT_MARK_SPACING + 0.02  # hides the marks where they jump back by one spacing
_MAST = (-0.62, 0.5 * _BELT_WIDTH + 0.5 * _RAIL_WIDTH)  # foot of the mast, on the rail behind the figure
_MAST_RADIUS, _MAST_BEND = 0.022, 0.20  # [m]


_LIGHTS: tuple[tuple[str, str, Any], ...] = (
    ("AmbientLight", "intensity", 0.56), ("FillLight", "position", [-2.0, -4.5, 4.0]),
    ("FillLight", "intensity", 0.34), ("SpotLight", "position", [1.6, -2.4, 5.2]),
    ("SpotLight", "castShadow", True), ("SpotLight", "intensity", 0.32), ("SpotLight", "angle", 0.5),
    ("SpotLight", "penumbra", 0.9),
)  # fmt: skip


def set_studio(window: Window) -> None:
    """Set a pale background and the light of a studio, with soft shadows."""
    window.send(set_property("/Background", "top_color", [0.985, 0.99, 0.995]))
    window.send(set_property("/Background", "bottom_color", [0.84, 0.87, 0.90]))
    for name in ("Axes", "Grid", "Lights/PointLightNegativeX", "Lights/PointLightPositiveX"):
        window.send(set_property(f"/{name}", "visible", False))
    window.send(set_property("/Lights/SpotLight", "visible", True))
    for light, name, value in _LIGHTS:
        window.send(set_property(f"/Lights/{light}/<object>", name, value))


def draw_floor(window: Window, height: float, radius: float = 2.0) -> None:
    """Draw a round floor that fades into the background.

    ``height`` in [m]; ``radius`` at which it has faded out, in [m].
    """
    rings = np.linspace(1.0, 0.0, 9)
    disc = shapes.turned([(float(ring) * radius, 0.0) for ring in rings], columns=48)
    share = np.linalg.norm(disc.vertices, axis=1) / radius
    opacity = np.clip((1.0 - share) / 0.6, 0.0, 1.0)
    faded = disc._replace(opacity=opacity * opacity * (3.0 - 2.0 * opacity))
    place(window, "floor", faded, _FLOOR, under_shadows=True)
    window.send(set_property(FLOOR, "position", [0.0, 0.0, height]))
    # Drawn before other translucent parts, which must not vanish behind it.
    window.send(set_property(f"{FLOOR}/<object>", "renderOrder", -1))


def tilted(slope: float) -> np.ndarray:
    """Pose of a belt that rises forwards by an angle in [rad] about the origin, shape ``(4, 4)``."""
    pose = np.eye(4)
    pose[0, 0] = pose[2, 2] = np.cos(slope)
    pose[2, 0] = np.sin(slope)
    pose[0, 2] = -pose[2, 0]
    return pose


def draw_treadmill(window: Window, slope: float = 0.0) -> None:
    """Draw a treadmill whose belt runs along x, under the soles that press on it.

    ``slope`` by which it rises forwards in [rad].
    """
    window.send(set_transform(TREADMILL, tilted(slope)))
    x, y = 0.5 * (_BELT_LENGTH - _END_LENGTH + 0.03), 0.5 * (_BELT_WIDTH + _RAIL_WIDTH)
    rail = (_BELT_LENGTH + 0.02, _RAIL_WIDTH, _DECK_HEIGHT)
    end = (_END_LENGTH + 0.03, _BELT_WIDTH + 2.0 * _RAIL_WIDTH + 0.01, _DECK_HEIGHT)
    frame = [box(rail, (0.0, side * y, -0.5 * _DECK_HEIGHT + 0.010), _EDGE) for side in (1.0, -1.0)]
    frame += [box(end, (side * x, 0.0, -0.5 * _DECK_HEIGHT + 0.012), _EDGE) for side in (1.0, -1.0)]
    hood = (_END_LENGTH - 0.04, _BELT_WIDTH + _RAIL_WIDTH, 0.05)  # of the belt's motor at the front
    frame.append(box(hood, (0.5 * _BELT_LENGTH - 0.5 * hood[0], 0.0, 0.5 * hood[2]), 0.02))
    place(window, "treadmill/frame", shapes.merged(frame), DECK, under_shadows=True)
    surface = box((_BELT_LENGTH, _BELT_WIDTH, 0.03), (0.0, 0.0, BELT_TOP - 0.015))
    place(window, "treadmill/belt_surface", surface, RUBBER, under_shadows=True)
    inner = _BELT_LENGTH - _END_LENGTH
    # The first is under the cover of the end before and after the jump, and so is the last.
    at = np.arange(-0.5 * inner + 0.085, 0.5 * inner + 0.01, BELT_MARK_SPACING)
    marks = [plate((float(x), 0.0), 0.012, _BELT_WIDTH - 0.04) for x in at]
    draw_mesh(window, f"{BELT}/marks", shapes.merged(marks), MARK, under_shadows=True)
    draw_floor(window, -_DECK_HEIGHT - 0.5 * _BELT_LENGTH * abs(np.sin(slope)))


def draw_mast(window: Window, hooks: np.ndarray) -> None:
    """Draw a mast beside the treadmill, its arm, and the bar above the wearer that the ropes hang from.

    ``hooks``: upper ends of the ropes in [m], shape ``(n, 3)``, all at one height.
    """
    middle = hooks.mean(axis=0)
    reach = 1.25 * (hooks - middle)
    x, y = _MAST
    foot, elbow = np.array([x, y, -_DECK_HEIGHT]), np.array([x, y, middle[2] + 0.05])
    end = middle + np.array([0.0, 0.0, 0.05])
    bend = shapes.bend(_towards(elbow, foot), elbow, _towards(elbow, end))
    mast = shapes.tube(np.concatenate((foot[None], bend, end[None])), _MAST_RADIUS, columns=14)
    low, high = reach[np.argmin(reach[:, 1])], reach[np.argmax(reach[:, 1])]
    bar = shapes.tube(np.array([middle + low, middle, middle + high]), 0.016, columns=12)
    hanger = shapes.moved(shapes.cylinder(0.012, 0.06), translation(0.5 * (middle + end)))
    place(window, "mast", shapes.merged([mast, bar, hanger]), STEEL)


def _towards(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """A point that is as far from a corner as the mast bends."""
    return np.asarray(start + _MAST_BEND * (end - start) / np.linalg.norm(end - start))


def belt_offset(way: float) -> float:
    """How far the belt marks are behind where they were drawn when the belt has gone a way in [m].

    Returned along x in [m], between minus one spacing and 0.
    """
    return -(way % BELT_MARK_SPACING)


def box(size: Triple, centre: Triple, edge: float = 0.012) -> Shape:
    """Make a box at a place, its edges rounded with a radius; all in [m]."""
    return shapes.moved(shapes.rounded_box(size, edge), translation(centre))


def place(
    window: Window, name: str, shape: Shape, material: Material, *, under_shadows: bool = False
) -> None:
    """Draw a part that does not move; one on which shadows fall casts none itself."""
    casts = not under_shadows
    draw_mesh(window, f"{ROOT}/{name}", shape, material, casts=casts, under_shadows=under_shadows)


def plate(middle: Sequence[float] | np.ndarray, length: float, width: float) -> Shape:
    """Make a rectangle on the ground, a hair above it: middle, length along x, width along y in [m]."""
    corners = 0.5 * np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    vertices = np.column_stack((corners + middle, np.full(4, BELT_TOP + 0.0016)))
    return Shape(vertices, np.tile([0.0, 0.0, 1.0], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))


def translation(centre: Triple | np.ndarray) -> np.ndarray:
    """Placement without a turn, shape ``(4, 4)``."""
    placement = np.eye(4)
    placement[:3, 3] = centre
    return placement
