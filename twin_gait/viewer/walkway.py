"""A walkway with metres, along which the eye goes with the walker, and the rail of a harness over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window, set_object, set_property
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Motion
from twin_gait.viewer.shapes import Shape
from twin_gait.viewer.surroundings import (
    BELT_TOP,
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

TROLLEY = f"{ROOT}/trolley"
METRES = f"{ROOT}/metres"
_LENGTH, _WIDTH = 9.0, 1.30  # of what is seen of it [m]
_FLOOR_HEIGHT = -0.02  # [m]
_MARKED = 60  # [m] of it that have marks
_LINOLEUM = Material(colour=(0.76, 0.80, 0.86), roughness=0.95, glow=0.14)
# Segments of a digit, in turn from the top clockwise, and the middle one: ends in lengths of a segment.
_SEGMENTS = ((0, 2, 1, 2), (1, 2, 1, 1), (1, 1, 1, 0), (0, 0, 1, 0), (0, 1, 0, 0), (0, 2, 0, 1), (0, 1, 1, 1))
_DIGITS = ("012345", "12", "01643", "01623", "5612", "05623", "056432", "012", "0123456", "561023")
_SEGMENT = np.array([0.036, 0.075])  # forwards and across [m]: long across, because one looks at it flatly
_STROKE = 0.010  # [m]


class DrawnWalkway:
    """A walkway along x; what does not change along it goes along with the walker."""

    def __init__(self, window: Window, forward: int) -> None:
        """Draw it. ``forward``: coordinate with which the walker goes."""
        self._forward = forward
        draw_floor(window, _FLOOR_HEIGHT, radius=3.2)
        strip = box((_LENGTH, _WIDTH, 0.03), (0.0, 0.0, BELT_TOP - _FLOOR_HEIGHT - 0.015), 0.004)
        place(window, "floor/walkway", strip, _LINOLEUM, under_shadows=True)
        lines = [plate((float(x), 0.0), 0.012, _WIDTH) for x in range(1 - round(_LENGTH), _MARKED + 1)]
        numbers = [_number(metre) for metre in range(_MARKED + 1)]
        window.send(set_object(METRES, shapes.merged([*lines, *numbers]), MARK))
        window.send(set_property(f"{METRES}/<object>", "castShadow", False))

    def state(self, figure: Figure, motion: Motion, frame: int) -> dict[tuple[str, str], Any]:
        """The eye goes along: all else comes towards it, but for the floor."""
        way = float(motion.q[frame][self._forward])
        return {("/meshcat", "position"): [-way, 0.0, 0.0], (FLOOR, "position"): [way, 0.0, _FLOOR_HEIGHT]}


def _number(metre: int) -> Shape:
    """Number on the ground beside its line, read from the right side of the walker."""
    strokes = []
    for number, digit in enumerate(str(metre)):
        corner = np.array([metre + 0.04 + 1.7 * _SEGMENT[0] * number, 0.05 - 0.5 * _WIDTH])
        for name in _DIGITS[int(digit)]:
            ends = corner + _SEGMENT * np.array(_SEGMENTS[int(name)]).reshape(2, 2)
            strokes.append(plate(ends.mean(axis=0), *(np.ptp(ends, axis=0) + _STROKE)))
    return shapes.merged(strokes)


@dataclass(frozen=True)
class Trolley:
    """The bar that ropes hang from, on a rail over the walkway."""

    joint: str  # joint that carries the lower ends of the ropes
    hook: np.ndarray  # one of them in the frame of that joint in [m], shape ``(3,)``

    def state(self, figure: Figure, motion: Motion, frame: int) -> dict[tuple[str, str], Any]:
        """It is above them."""
        x = float(figure.world_point(motion.q[frame], self.joint, self.hook)[0])
        return {(TROLLEY, "position"): [x, 0.0, 0.0]}


def draw_rail(window: Window, hooks: np.ndarray) -> None:
    """Draw the rail, and the trolley as it is at the origin.

    ``hooks``: upper ends of the ropes in [m], shape ``(n, 3)``, all at one height.
    """
    middle = hooks.mean(axis=0)
    above = middle + np.array([0.0, 0.0, 0.06])
    hanger = shapes.moved(shapes.cylinder(0.012, 0.06), translation(0.5 * (middle + above)))
    bar = shapes.tube(middle + np.outer([-1.25, 0.0, 1.25], hooks[0] - middle), 0.016, columns=12)
    place(window, "trolley/bar", shapes.merged([bar, hanger]), STEEL)
    rail = box((_MARKED + 10.0, 0.06, 0.05), (0.5 * _MARKED, 0.0, above[2] + 0.025), 0.01)
    place(window, "rail", rail, STEEL)
    window.send(set_property(f"{ROOT}/rail/<object>", "castShadow", False))
