"""Where the boxes, arrows and labels of a state diagram lie: plane geometry in pixels, y downwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from twin_gait.gait.table import GaitTable, Transition

GAP = 7.0  # [px] between a box and an arrow, or an arrow and its label
# Bends of an arrow over its length, to the left of its direction, which on the ring is outwards. A
# time-out bends the other way, unless the arrows of the way back lie there.
_BEND, _BEND_TIME_OUT, _BEND_TIME_OUT_OF_PAIR = 0.16, -0.14, 0.08


class Point(NamedTuple):
    """A point in [px]."""

    x: float
    y: float


class Rectangle(NamedTuple):
    """A rectangle by its centre and sizes in [px]."""

    x: float
    y: float
    width: float
    height: float


class Arrow(NamedTuple):
    """A quadratic curve from box to box.

    Attributes:
        start: Where it leaves the box.
        control: Control point.
        end: Where its tip is.
        middle: Half-way along it.
        normal: Unit vector at the middle, to the side where the label lies.
    """

    start: Point
    control: Point
    end: Point
    middle: Point
    normal: Point


class ArrowGroup(NamedTuple):
    """Transitions that share an arrow: same source and target, all time-outs or all guarded.

    Attributes:
        source: Position of the phase that is left.
        target: Position of the phase that is entered.
        time_out: Whether they are time-outs.
        transitions: In order of priority.
    """

    source: int
    target: int
    time_out: bool
    transitions: tuple[Transition, ...]


def arrow_groups(table: GaitTable) -> list[ArrowGroup]:
    """Collect the transitions that share an arrow, in the order of the table."""
    found: dict[tuple[int, int, bool], list[Transition]] = {}
    for item in table.transitions:
        key = (table.phase_index(item.source), table.phase_index(item.target), item.is_time_out)
        found.setdefault(key, []).append(item)
    return [ArrowGroup(*key, tuple(items)) for key, items in found.items()]


def ring(count: int, width: float, height: float) -> list[Rectangle]:
    """Boxes on a ring, clockwise from the top; two lie side by side.

    Args:
        count: Number of boxes.
        width: Of a box.
        height: Of a box.

    Returns:
        The boxes, about the origin.
    """
    if count == 1:
        return [Rectangle(0.0, 0.0, width, height)]
    first = math.pi if count == 2 else -math.pi / 2.0
    # Neighbours are as far apart as a label beside or between them needs.
    horizontal, vertical = width * (0.7 + 0.13 * count), height * (0.8 + 0.4 * count)
    angles = [first + 2.0 * math.pi * k / count for k in range(count)]
    return [Rectangle(horizontal * math.cos(a), vertical * math.sin(a), width, height) for a in angles]


def arrows(groups: Sequence[ArrowGroup], boxes: Sequence[Rectangle]) -> list[Arrow]:
    """Lay the arrows of a diagram.

    Args:
        groups: What they stand for.
        boxes: The phases.

    Returns:
        An arrow for each group.
    """
    joined = {(item.source, item.target) for item in groups}
    laid = []
    for item in groups:
        bend = _BEND
        if item.time_out:
            bend = _BEND_TIME_OUT_OF_PAIR if (item.target, item.source) in joined else _BEND_TIME_OUT
        laid.append(_arrow(boxes[item.source], boxes[item.target], bend, outwards=not item.time_out))
    return laid


def _arrow(source: Rectangle, target: Rectangle, bend: float, *, outwards: bool) -> Arrow:
    """Lay an arrow between two boxes, its label on the left or on the right of its direction."""
    dx, dy = target.x - source.x, target.y - source.y
    length = math.hypot(dx, dy)
    left = Point(dy / length, -dx / length)
    height = 2.0 * bend * length  # the curve reaches half as far as its control point
    control = Point(
        (source.x + target.x) / 2.0 + height * left.x, (source.y + target.y) / 2.0 + height * left.y
    )
    start, end = _edge(source, control), _edge(target, control)
    middle = Point(
        start.x / 4.0 + control.x / 2.0 + end.x / 4.0, start.y / 4.0 + control.y / 2.0 + end.y / 4.0
    )
    sign = 1.0 if outwards else -1.0
    return Arrow(start, control, end, middle, Point(sign * left.x, sign * left.y))


def _edge(box: Rectangle, towards: Point) -> Point:
    """Where the line from the centre of a box to a point leaves it, a gap outside."""
    dx, dy = towards.x - box.x, towards.y - box.y
    sides = [
        (half + GAP) / abs(part)
        for half, part in ((box.width / 2, dx), (box.height / 2, dy))
        if abs(part) > 0
    ]
    share = min(sides, default=0.0)
    return Point(box.x + share * dx, box.y + share * dy)


def label_place(curve: Arrow, width: float, height: float) -> Rectangle:
    """Place a label beside the middle of an arrow, clear of it.

    Args:
        curve: The arrow.
        width: Of the label.
        height: Of the label.

    Returns:
        The label's rectangle.
    """
    # The support of a rectangle in a direction: how far it reaches back towards the arrow.
    reach = abs(curve.normal.x) * width / 2.0 + abs(curve.normal.y) * height / 2.0 + GAP
    x, y = curve.middle.x + reach * curve.normal.x, curve.middle.y + reach * curve.normal.y
    return Rectangle(x, y, width, height)


def bounds(rectangles: list[Rectangle], margin: float) -> tuple[float, float, float, float]:
    """Left, top, width and height of what holds some rectangles, with a margin."""
    left = min(item.x - item.width / 2.0 for item in rectangles) - margin
    top = min(item.y - item.height / 2.0 for item in rectangles) - margin
    right = max(item.x + item.width / 2.0 for item in rectangles) + margin
    bottom = max(item.y + item.height / 2.0 for item in rectangles) + margin
    return left, top, right - left, bottom - top
