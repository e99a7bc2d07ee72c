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

_LENGTH, _DEPTH, _THICKNESS = 0.96, 0.54, 0.04  # of the table top [m]
_BEHIND, _BESIDE = 0.10, 0.13  # of the hip: middle of the table, its near edge [m]
_DROP = 0.115  # of the table top below the hip [m]
_LEG = 0.05  # thickness of a table leg [m]
CHAIR = f"{ROOT}/chair"
SEAT = "seat_forward_m"  # column of its front edge
_CHAIR_WIDTH, _SEAT_THICKNESS, _CHAIR_LEG = 0.46, 0.05, 0.035  # [m]
METRES = f"{ROOT}/metres"
_STRIP_LENGTH, _STRIP_WIDTH = 9.0, 1.30  # of what is seen of it [m]
_FLOOR_HEIGHT = -0.02  # [m]
_MARKED = 60  # [m] of it that have marks
_LINOLEUM = Material(colour=(0.76, 0.80, 0.86), roughness=0.95, glow=0.14)


def draw_bench(window: Window, floor: float, hip: np.ndarray, far_side: float) -> None:
    """Draw the bench.

    ``floor``: height of the floor in [m]; ``hip``: position of the hip in [m], shape ``(3,)``; ``far_side``:
    1 if the table stands to the left of the leg, -1 if to its right.
    """
    mirror = np.diag([1.0, far_side, 1.0, 1.0])
    mirror[:3, 3] = hip
    height = float(hip[2]) - _DROP - floor
    top = (-_BEHIND, _BESIDE + 0.5 * _DEPTH, -_DROP - 0.5 * _THICKNESS)
    vice = [box((0.17, 0.12, 0.045), (-0.06, _BESIDE + 0.05, -_DROP + 0.022), 0.008)]
    vice += [box((0.045, 0.085, 0.115), (x, _BESIDE + 0.02, -_DROP + 0.095), 0.008) for x in (-0.005, -0.135)]
    y, z = _BESIDE + 0.02, -_DROP + 0.075
    screw = shapes.tube(np.array([[x, y, z] for x in (-0.15, -0.22, -0.29)]), 0.011, columns=12)
    handle = shapes.tube(np.array([[-0.275, y, z + up] for up in (-0.08, 0.0, 0.08)]), 0.006)
    parts = [
        ("table_top", box((_LENGTH, _DEPTH, _THICKNESS), top, 0.008), _WOOD),
        ("table_frame", _table_frame(height), DECK),
        ("vice", shapes.merged(vice), _VICE),
        ("vice_screw", shapes.merged([screw, handle]), STEEL),
        ("weight", _weight(), _IRON),
        ("mat", box((1.10, 0.84, 0.012), (-0.06, 0.24, -_DROP - height + 0.006), 0.004), _MAT),
    ]
    for name, shape, material in parts:
        at_hip = shapes.moved(shape, mirror)
        place(window, name, at_hip, material, under_shadows=name in ("table_top", "mat"))
    draw_floor(window, floor)


# The parts stand in a frame at the hip of a right leg: x forward, y away from the camera, z up.


def _table_frame(height: float) -> Shape:
    under = height - _THICKNESS
    half_way = -_DROP - _THICKNESS - 0.5 * under
    xs = (-_BEHIND - 0.5 * _LENGTH + 0.07, -_BEHIND + 0.5 * _LENGTH - 0.07)
    ys = (_BESIDE + 0.06, _BESIDE + _DEPTH - 0.06)
    legs = [box((_LEG, _LEG, under), (x, y, half_way), 0.006) for x in xs for y in ys]
    rails = [box((xs[1] - xs[0], 0.03, 0.06), (-_BEHIND, y, -_DROP - _THICKNESS - 0.03), 0.004) for y in ys]
    shelf = box(
        (xs[1] - xs[0], ys[1] - ys[0], 0.02), (-_BEHIND, 0.5 * sum(ys), -_DROP - height + 0.16), 0.004
    )
    return shapes.merged([*legs, *rails, shelf])


def _weight() -> Shape:
    """Two plates with a rod, on the table."""
    sizes = ((0.095, 0.035, 0.0), (0.080, 0.030, 0.035), (0.014, 0.055, 0.065))  # radius, length, bottom [m]
    return shapes.merged(
        shapes.moved(
            shapes.cylinder(radius, length),
            translation((-0.44, _BESIDE + 0.24, -_DROP + bottom + 0.5 * length)),
        )
        for radius, length, bottom in sizes
    )


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
