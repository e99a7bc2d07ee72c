"""A chair that stands where a log has its front edge."""

from __future__ import annotations

from typing import Any, Protocol

from twin_gait.viewer import shapes
from twin_gait.viewer.commands import Material, Window, set_property
from twin_gait.viewer.figure import Figure
from twin_gait.viewer.motion import Motion
from twin_gait.viewer.surroundings import BELT_TOP, ROOT, STEEL, box, place

CHAIR = f"{ROOT}/chair"
SEAT = "seat_forward_m"  # column of its front edge
_WIDTH, _THICKNESS, _LEG = 0.46, 0.05, 0.035  # [m]
_WOOD = Material(colour=(0.80, 0.70, 0.57), roughness=0.9)


class Chair(Protocol):
    """What has to be known of a chair."""

    @property
    def height(self) -> float:
        """Of the seat above the floor in [m]."""

    @property
    def depth(self) -> float:
        """Of the seat in [m]."""


class DrawnChair:
    """A chair, hidden until it has a place; it has no back, because there is the pack of the device."""

    def __init__(self, window: Window, chair: Chair) -> None:
        """Draw it with its front edge at the origin."""
        under, ends = chair.height - _THICKNESS, (-0.04, 0.04 - chair.depth)
        size, middle = (_LEG, _LEG, under - BELT_TOP), 0.5 * (under + BELT_TOP)
        aside = 0.5 * _WIDTH - 0.04
        legs = [box(size, (x, y, middle), 0.006) for x in ends for y in (aside, -aside)]
        centre = (-0.5 * chair.depth, 0.0, under + 0.5 * _THICKNESS)
        seat = box((chair.depth, _WIDTH, _THICKNESS), centre, 0.015)
        place(window, "chair/legs", shapes.merged(legs), STEEL)
        place(window, "chair/seat", seat, _WOOD)
        window.send(set_property(CHAIR, "visible", False))

    def state(self, figure: Figure, motion: Motion, frame: int) -> dict[tuple[str, str], Any]:
        """Where it stands in a frame."""
        if SEAT not in motion.columns:
            return {}
        place = [float(motion.columns[SEAT][frame]), 0.0, 0.0]
        return {(CHAIR, "visible"): True, (CHAIR, "position"): place}
