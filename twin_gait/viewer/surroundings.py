"""What stands around the figure: light, floor, treadmill and mast, bench, chair, walkway and rails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twin_gait.parameters import ChairParameters
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window, draw_mesh, set_property, set_transform
from twin_gait.viewer.shapes import Shape

if TYPE_CHECKING:
    from twin_gait.viewer.figure import Figure
    from twin_gait.viewer.motion import Motion

Range = tuple[float, float]
Triple = tuple[float, float, float]

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

_WOOD = Material(colour=(0.80, 0.70, 0.57), roughness=0.9)
_VICE = Material(colour=(0.16, 0.33, 0.47), roughness=0.75)
_MAT = Material(colour=(0.50, 0.54, 0.60), roughness=0.95)
_IRON = Material(colour=(0.27, 0.29, 0.33), roughness=0.8)

CHAIR = f"{ROOT}/chair"
SEAT = "seat_forward_m"  # column of its front edge
_CHAIR_WIDTH, _SEAT_THICKNESS, _CHAIR_LEG = 0.46, 0.05, 0.035  # [m]
METRES = f"{ROOT}/metres"
_STRIP_LENGTH, _STRIP_WIDTH = 9.0, 1.30  # of what is seen of it [m]
_FLOOR_HEIGHT = -0.02  # [m]
_MARKED = 60  # [m] of it that have marks
_LINOLEUM = Material(colour=(0.76, 0.80, 0.86), roughness=0.95, glow=0.14)

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
    hanger = shapes.moved(shapes.cylinder(0.012, 0.06), shapes.translation(0.5 * (middle + end)))
    place(window, "mast", shapes.merged([mast, bar, hanger]), STEEL)


def _towards(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """A point that is as far from a corner as the mast bends."""
    return np.asarray(start + _MAST_BEND * (end - start) / np.linalg.norm(end - start))


def draw_bench(window: Window, floor: float, hip: np.ndarray, far_side: float) -> None:
    """Draw the bench: a table with vice and weights, on a mat.

    ``floor``: height of the floor in [m]; ``hip``: position of the hip in [m], shape ``(3,)``; ``far_side``:
    1 if the table stands to the left of the leg, -1 if to its right.
    """
    # From the hip of a right leg: x forward, y away from the camera, z up, all in [m].
    top, ground = -0.115, floor - float(hip[2])
    under, shelf = top - 0.04, ground + 0.16
    legs = [
        _slab((x, x + 0.05), (y, y + 0.05), (ground, under)) for x in (-0.535, 0.285) for y in (0.165, 0.585)
    ]
    board = _slab((-0.51, 0.31), (0.19, 0.61), (shelf - 0.01, shelf + 0.01))
    rails = [_slab((-0.51, 0.31), (y, y + 0.03), (under - 0.06, under)) for y in (0.175, 0.595)]
    jaws = [_slab((x, x + 0.045), (0.107, 0.192), (top + 0.037, top + 0.152)) for x in (-0.027, -0.157)]
    weights = [
        shapes.moved(shapes.cylinder(radius, length), shapes.translation((-0.44, 0.37, top + middle)))
        for radius, length, middle in ((0.095, 0.035, 0.0175), (0.080, 0.030, 0.05), (0.014, 0.055, 0.0925))
    ]
    parts = (
        ("table_top", _WOOD, [_slab((-0.58, 0.38), (0.13, 0.67), (under, top))]),
        ("table_frame", DECK, [*legs, *rails, board]),
        ("vice", _VICE, [_slab((-0.145, 0.025), (0.12, 0.24), (top, top + 0.044)), *jaws]),
        ("weight", _IRON, weights),
        ("mat", _MAT, [_slab((-0.61, 0.49), (-0.18, 0.66), (ground, ground + 0.012))]),
    )
    mirror = np.diag([1.0, far_side, 1.0, 1.0])
    mirror[:3, 3] = hip
    for name, material, pieces in parts:
        at_hip = shapes.moved(shapes.merged(pieces), mirror)
        place(window, name, at_hip, material, under_shadows=name in ("table_top", "mat"))
    draw_floor(window, floor)


def _slab(x: Range, y: Range, z: Range) -> Shape:
    """A box from here to there along each axis in [m]."""
    lows, highs = np.array([x, y, z]).T
    size, (x_middle, y_middle, z_middle) = highs - lows, (0.5 * (lows + highs)).tolist()
    return box(size.tolist(), (x_middle, y_middle, z_middle), 0.006)


class DrawnChair:
    """A chair, hidden until it has a place; it has no back, because there is the pack of the device."""

    def __init__(self, window: Window, chair: ChairParameters) -> None:
        """Draw it with its front edge at the origin."""
        under, ends = chair.height - _SEAT_THICKNESS, (-0.04, 0.04 - chair.depth)
        size, middle = (_CHAIR_LEG, _CHAIR_LEG, under - BELT_TOP), 0.5 * (under + BELT_TOP)
        aside = 0.5 * _CHAIR_WIDTH - 0.04
        legs = [box(size, (x, y, middle), 0.006) for x in ends for y in (aside, -aside)]
        centre = (-0.5 * chair.depth, 0.0, under + 0.5 * _SEAT_THICKNESS)
        seat = box((chair.depth, _CHAIR_WIDTH, _SEAT_THICKNESS), centre, 0.015)
        place(window, "chair/legs", shapes.merged(legs), STEEL)
        place(window, "chair/seat", seat, _WOOD)
        window.send(set_property(CHAIR, "visible", False))

    def state(self, figure: Figure, motion: Motion, frame: int) -> dict[tuple[str, str], Any]:
        """Where it stands in a frame."""
        if SEAT not in motion.columns:
            return {}
        place = [float(motion.columns[SEAT][frame]), 0.0, 0.0]
        return {(CHAIR, "visible"): True, (CHAIR, "position"): place}


class DrawnWalkway:
    """A walkway along x; what does not change along it goes along with the walker."""

    def __init__(self, window: Window, forward: int) -> None:
        """Draw it. ``forward``: coordinate with which the walker goes."""
        self._forward = forward
        draw_floor(window, _FLOOR_HEIGHT, radius=3.2)
        strip = box((_STRIP_LENGTH, _STRIP_WIDTH, 0.03), (0.0, 0.0, BELT_TOP - _FLOOR_HEIGHT - 0.015), 0.004)
        place(window, "floor/walkway", strip, _LINOLEUM, under_shadows=True)
        # Every fifth is twice as thick.
        lines = [
            plate((float(x), 0.0), 0.012 if x % 5 else 0.024, _STRIP_WIDTH)
            for x in range(1 - round(_STRIP_LENGTH), _MARKED + 1)
        ]
        draw_mesh(window, METRES, shapes.merged(lines), MARK, under_shadows=True)

    def state(self, figure: Figure, motion: Motion, frame: int) -> dict[tuple[str, str], Any]:
        """The eye goes along: all else comes towards it, but for the floor."""
        way = float(motion.q[frame][self._forward])
        return {("/meshcat", "position"): [-way, 0.0, 0.0], (FLOOR, "position"): [way, 0.0, _FLOOR_HEIGHT]}


def draw_rails(window: Window, hooks: np.ndarray) -> None:
    """Draw a rail over the walkway for each rope. ``hooks``: their upper ends in [m], shape ``(n, 3)``."""
    size = (_MARKED + 10.0, 0.05, 0.05)
    rails = [box(size, (0.5 * _MARKED, float(y), float(z) + 0.025), 0.01) for _, y, z in hooks]
    draw_mesh(window, f"{ROOT}/rails", shapes.merged(rails), STEEL)


def belt_offset(way: float) -> float:
    """How far the belt marks are behind where they were drawn when the belt has gone a way in [m].

    Returned along x in [m], between minus one spacing and 0.
    """
    return -(way % BELT_MARK_SPACING)


def box(size: Triple, centre: Triple, edge: float = 0.012) -> Shape:
    """Make a box at a place, its edges rounded with a radius; all in [m]."""
    return shapes.moved(shapes.rounded_box(size, edge), shapes.translation(centre))


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
