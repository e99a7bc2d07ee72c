"""Where the boxes, arrows and badges of a state diagram lie: plane geometry in pixels, y downwards."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twin_gait.gait.table import StateTable, Transition

GAP = 7.0  # [px] between a box and an arrow
# Bends of an arrow over its length, to the left of its direction, which on the ring is outwards. A
# time-out bends the other way, unless the arrows of the way back lie there.
_BEND, _BEND_TIME_OUT, _BEND_TIME_OUT_OF_PAIR = 0.16, -0.14, 0.08
# Shares of its bend that an arrow may take instead, the first that passes no box.
_BENDS = (1.0, 0.6, 0.2, 1.5, -0.5, -1.0, 2.0)
_SHARES = np.linspace(0.0, 1.0, 41)  # of an arrow, where it is looked at
_PLACES = [20, 16, 24, 12, 28, 8, 32]  # of a badge among them, the first that is clear
_COLLISION = 1000  # a badge on a badge or a box, in samples of arrows that it covers


class Rectangle(NamedTuple):
    """A rectangle by its centre and sizes in [px]."""

    x: float
    y: float
    width: float
    height: float


class Arrow(NamedTuple):
    """A quadratic curve from box to box; its points are complex numbers in [px]."""

    start: complex  # where it leaves the box
    control: complex  # control point
    end: complex  # where its tip is

    def points(self) -> np.ndarray:
        """Points along it, shape ``(n,)``."""
        back = 1.0 - _SHARES
        curve = back**2 * self.start + 2.0 * _SHARES * back * self.control + _SHARES**2 * self.end
        return np.asarray(curve)


class ArrowGroup(NamedTuple):
    """Transitions that share an arrow: same source and target, all time-outs or all guarded."""

    source: int  # position of the phase that is left
    target: int  # position of the phase that is entered
    time_out: bool  # whether they are time-outs
    transitions: tuple[Transition, ...]  # in order of priority


def arrow_groups(table: StateTable) -> list[ArrowGroup]:
    """Collect the transitions that share an arrow, in the order of the table."""
    found: dict[tuple[int, int, bool], list[Transition]] = {}
    for item in table.transitions:
        key = (table.phase_index(item.source), table.phase_index(item.target), item.is_time_out)
        found.setdefault(key, []).append(item)
    return [ArrowGroup(*key, tuple(items)) for key, items in found.items()]


def ring(count: int, width: float, height: float) -> list[Rectangle]:
    """Boxes of a size about the origin on a ring, clockwise from the top; two lie side by side."""
    if count == 1:
        return [Rectangle(0.0, 0.0, width, height)]
    first = math.pi if count == 2 else -math.pi / 2.0
    # Neighbours are as far apart as a badge between them needs.
    horizontal, vertical = width * (0.7 + 0.13 * count), height * (0.8 + 0.4 * count)
    angles = [first + 2.0 * math.pi * k / count for k in range(count)]
    return [Rectangle(horizontal * math.cos(a), vertical * math.sin(a), width, height) for a in angles]


def arrows(groups: Sequence[ArrowGroup], boxes: Sequence[Rectangle]) -> list[Arrow]:
    """Lay an arrow for each group between its boxes, around the boxes that it does not join."""
    joined = {(item.source, item.target) for item in groups}
    laid: list[Arrow] = []

    def hidden(way: Arrow) -> int:
        """Samples under boxes, or along another arrow from the same place to the same."""
        points = way.points()
        along = [_near(points - other.points(), GAP, GAP) for other in laid]
        return sum(along) + sum(_inside(points, box) for box in boxes)

    for item in groups:
        bend = _BEND
        if item.time_out:
            bend = _BEND_TIME_OUT_OF_PAIR if (item.target, item.source) in joined else _BEND_TIME_OUT
        ways = [_arrow(boxes[item.source], boxes[item.target], bend * share) for share in _BENDS]
        laid.append(min(ways, key=hidden))
    return laid


def _arrow(source: Rectangle, target: Rectangle, bend: float) -> Arrow:
    """Lay an arrow between two boxes, bent to the left of its direction."""
    start, end = complex(source.x, source.y), complex(target.x, target.y)
    # The curve reaches half as far as its control point.
    control = (start + end) / 2.0 - 2.0j * bend * (end - start)
    return Arrow(_edge(source, control), control, _edge(target, control))


def _edge(box: Rectangle, towards: complex) -> complex:
    """Where the line from the centre of a box to a point leaves it, a gap outside."""
    centre = complex(box.x, box.y)
    way = towards - centre
    parts = ((box.width / 2.0, way.real), (box.height / 2.0, way.imag))
    return centre + way * min((half + GAP) / abs(part) for half, part in parts if part != 0.0)


def _near(offsets: np.ndarray, x: float, y: float) -> int:
    """How many offsets, shape ``(n,)``, are shorter than a length along x and one along y."""
    return int(((np.abs(offsets.real) < x) & (np.abs(offsets.imag) < y)).sum())


def _inside(points: np.ndarray, box: Rectangle) -> int:
    """How many points, shape ``(n,)``, lie in a rectangle."""
    return _near(points - complex(box.x, box.y), box.width / 2.0, box.height / 2.0)


def badges(
    curves: Sequence[Arrow], boxes: Sequence[Rectangle], widths: Sequence[float], height: float
) -> list[Rectangle]:
    """Places on arrows, clear of boxes, of each other and, where it can be, of other arrows."""
    placed: list[Rectangle] = []
    for curve, width in zip(curves, widths, strict=True):
        others = np.concatenate([np.zeros(0), *(other.points() for other in curves if other is not curve)])

        def covered(place: Rectangle, others: np.ndarray = others) -> int:
            taken = sum(_overlap(place, item) for item in (*boxes, *placed))
            return _COLLISION * taken + _inside(others, place)

        middles = curve.points()[_PLACES]
        free = (Rectangle(point.real, point.imag, width, height) for point in middles)
        placed.append(min(free, key=covered))
    return placed


def _overlap(first: Rectangle, second: Rectangle) -> bool:
    """Whether two rectangles have less than half a gap between them."""
    centre = complex(second.x - first.x, second.y - first.y)
    x, y = (first.width + second.width + GAP) / 2.0, (first.height + second.height + GAP) / 2.0
    return abs(centre.real) < x and abs(centre.imag) < y


def bounds(rectangles: list[Rectangle], margin: float) -> tuple[float, float, float, float]:
    """Left, top, width and height of what holds some rectangles, with a margin."""
    x, y, width, height = np.array(rectangles).T
    left, top = (x - width / 2.0).min() - margin, (y - height / 2.0).min() - margin
    right, bottom = (x + width / 2.0).max() + margin, (y + height / 2.0).max() + margin
    return left, top, right - left, bottom - top
