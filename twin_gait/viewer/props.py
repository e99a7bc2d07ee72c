"""What stands around the figure in some worlds: a bench, a chair, a walkway with its rail."""

from typing import Any

import numpy as np

from twin_gait.parameters import ChairParameters
from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window, draw_mesh, set_property
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Motion
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.surroundings import (
    BELT_TOP,
    DECK,
    FLOOR,
    MARK,
    ROOT,
    STEEL,
    box,
    draw_floor,
    place,
    plate,
    translation,
)

_WOOD = Material(colour=(0.80, 0.70, 0.57), roughness=0.9)
_VICE = Material(colour=(0.16, 0.33, 0.47), roughness=0.75)
_MAT = Material(colour=(0.50, 0.54, 0.60), roughness=0.95)
_IRON = Material(colour=(0.27, 0.29, 0.33), roughness=0.8)

Range = tuple[float, float]
CHAIR = f"{ROOT}/chair"
SEAT = "seat_forward_m"  # column of its front edge
_CHAIR_WIDTH, _SEAT_THICKNESS, _CHAIR_LEG = 0.46, 0.05, 0.035  # [m]
METRES = f"{ROOT}/metres"
_STRIP_LENGTH, _STRIP_WIDTH = 9.0, 1.30  # of what is seen of it [m]
_FLOOR_HEIGHT = -0.02  # [m]
_MARKED = 60  # [m] of it that have marks
_LINOLEUM = Material(colour=(0.76, 0.80, 0.86), roughness=0.95, glow=0.14)


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
        shapes.moved(shapes.cylinder(radius, length), translation((-0.44, 0.37, top + bottom + 0.5 * length)))
        for radius, length, bottom in ((0.095, 0.035, 0.0), (0.080, 0.030, 0.035), (0.014, 0.055, 0.065))
    ]
    parts = (
        ("table_top", _WOOD, [_slab((-0.58, 0.38), (0.13, 0.67), (under, top))]),
        (
            "table_frame",
            DECK,
            [*legs, *rails, board],
        ),
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
