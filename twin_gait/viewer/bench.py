"""The bench that a single leg hangs on: a table, a vice that holds the hip, a weight against tipping."""

from __future__ import annotations

import numpy as np

from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.surroundings import DECK, STEEL, box, draw_floor, place, translation

_TOP = Material(colour=(0.80, 0.70, 0.57), roughness=0.9)
_VICE = Material(colour=(0.16, 0.33, 0.47), roughness=0.75)
_MAT = Material(colour=(0.50, 0.54, 0.60), roughness=0.95)
_IRON = Material(colour=(0.27, 0.29, 0.33), roughness=0.8)

_LENGTH, _DEPTH, _THICKNESS = 0.96, 0.54, 0.04  # of the table top [m]
_BEHIND, _BESIDE = 0.10, 0.13  # of the hip: middle of the table, its near edge [m]
_DROP = 0.115  # of the table top below the hip [m]
_LEG = 0.05  # thickness of a table leg [m]


def draw_bench(window: Window, floor: float, hip: np.ndarray, far_side: float) -> None:
    """Draw the bench.

    ``floor``: height of the floor in [m]; ``hip``: position of the hip in [m], shape ``(3,)``; ``far_side``:
    1 if the table stands to the left of the leg, -1 if to its right.
    """
    mirror = np.diag([1.0, far_side, 1.0, 1.0])
    mirror[:3, 3] = hip
    height = float(hip[2]) - _DROP - floor
    top = (-_BEHIND, _BESIDE + 0.5 * _DEPTH, -_DROP - 0.5 * _THICKNESS)
    parts = [
        ("table_top", box((_LENGTH, _DEPTH, _THICKNESS), top, 0.008), _TOP),
        ("table_frame", _table_frame(height), DECK),
        ("vice", _vice(), _VICE),
        ("vice_screw", _screw(), STEEL),
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


def _vice() -> Shape:
    jaws = [box((0.045, 0.085, 0.115), (x, _BESIDE + 0.02, -_DROP + 0.095), 0.008) for x in (-0.005, -0.135)]
    return shapes.merged([box((0.17, 0.12, 0.045), (-0.06, _BESIDE + 0.05, -_DROP + 0.022), 0.008), *jaws])


def _screw() -> Shape:
    y, z = _BESIDE + 0.02, -_DROP + 0.075
    screw = shapes.tube(np.array([[-0.15, y, z], [-0.22, y, z], [-0.29, y, z]]), 0.011, columns=12)
    handle = shapes.tube(np.array([[-0.275, y, z - 0.08], [-0.275, y, z], [-0.275, y, z + 0.08]]), 0.006)
    return shapes.merged([screw, handle])


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
