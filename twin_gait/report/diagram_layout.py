"""Where the boxes, arrows and labels of a state diagram lie: plane geometry in pixels, y downwards."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from twin_gait.gait.table import StateTable, Transition

GAP = 7.0  # [px] between a box and an arrow, or an arrow and its label
# Bends of an arrow over its length, to the left of its direction, which on the ring is outwards. A
# time-out bends the other way, unless the arrows of the way back lie there.
_BEND, _BEND_TIME_OUT, _BEND_TIME_OUT_OF_PAIR = 0.16, -0.14, 0.08
# Shares of its bend that an arrow may take instead, the first that passes no box, and places of its label.
_BENDS = (1.0, 0.6, 0.2, 1.5, -0.5, -1.0, 2.0)
_PLACES = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
_SHARES = np.linspace(0.0, 1.0, 41)  # of an arrow, where it is looked at
_ROUNDS, _GROWTH = 12, 0.1  # of the ring
_COLLISION = 1000  # a label on a label or a box, in samples of arrows that it covers


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


class Label(NamedTuple):
    """A label beside its arrow."""

    place: Rectangle  # where it lies
    normal: complex  # unit vector from the arrow to it


class Layout(NamedTuple):
    """Where everything of a diagram lies."""

    boxes: list[Rectangle]  # the phases
    arrows: list[Arrow]  # of each group
    labels: list[Label]  # of each arrow
    covered: int  # samples of arrows that labels cover; a label on a label or a box counts ``_COLLISION``


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


def ring(count: int, width: float, height: float, *, spread: float = 1.0) -> list[Rectangle]:
    """Boxes of a size about the origin on a ring, clockwise from the top; two lie side by side."""
    if count == 1:
        return [Rectangle(0.0, 0.0, width, height)]
    first = math.pi if count == 2 else -math.pi / 2.0
    # Neighbours are as far apart as a label beside or between them needs.
    horizontal, vertical = spread * width * (0.7 + 0.13 * count), spread * height * (0.8 + 0.4 * count)
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


def _overlap(first: Rectangle, second: Rectangle, gap: float) -> bool:
    """Whether two rectangles have less than a gap between them."""
    return (
        abs(first.x - second.x) < (first.width + second.width) / 2.0 + gap
        and abs(first.y - second.y) < (first.height + second.height) / 2.0 + gap
    )


def lay_out(
    groups: Sequence[ArrowGroup], count: int, box: tuple[float, float], labels: Sequence[tuple[float, float]]
) -> Layout:
    """Lay a whole diagram: boxes on a ring, enlarged until no label lies on a box, a label or an arrow.

    Returns the first layout in which nothing lies on anything; else the one with the least of it.
    """
    layouts: list[Layout] = []
    for number in range(_ROUNDS):
        boxes = ring(count, *box, spread=1.0 + _GROWTH * number)
        layouts.append(_with_labels(groups, boxes, labels))
        if layouts[-1].covered == 0:
            break
    return min(layouts, key=lambda layout: layout.covered)


def _with_labels(
    groups: Sequence[ArrowGroup], boxes: list[Rectangle], sizes: Sequence[tuple[float, float]]
) -> Layout:
    """Place the labels, large ones first, each where it covers least."""
    curves, total = arrows(groups, boxes), 0
    drawn = np.concatenate([np.zeros(0), *(curve.points() for curve in curves)])
    placed: dict[int, Label] = {}

    def covered(label: Label) -> int:
        taken = [*boxes, *(other.place for other in placed.values())]
        on_others = sum(_overlap(label.place, item, GAP / 2.0) for item in taken)
        return _COLLISION * on_others + _inside(drawn, label.place)

    for number in sorted(range(len(groups)), key=lambda k: -sizes[k][0] * sizes[k][1]):
        # That of a time-out lies inside of the ring.
        side = -1.0 if groups[number].time_out else 1.0
        best = min(_label_candidates(curves[number], side, *sizes[number]), key=covered)
        total += covered(best)
        placed[number] = best
    return Layout(boxes, curves, [placed[number] for number in range(len(groups))], total)


def _label_candidates(curve: Arrow, usual: float, width: float, height: float) -> Iterator[Label]:
    """Labels along an arrow, clear of it; ``usual``: 1 for those on its left first, -1 for the right."""
    start, control, end = curve
    for share in _PLACES:
        point = (1 - share) ** 2 * start + 2 * share * (1 - share) * control + share**2 * end
        along = (1 - share) * (control - start) + share * (end - control)
        for side in (usual, -usual):
            normal = -1j * side * along / abs(along)
            # The support of a rectangle in a direction: how far it reaches back towards the arrow.
            reach = abs(normal.real) * width / 2.0 + abs(normal.imag) * height / 2.0 + GAP
            middle = point + reach * normal
            yield Label(Rectangle(middle.real, middle.imag, width, height), normal)


def bounds(rectangles: list[Rectangle], margin: float) -> tuple[float, float, float, float]:
    """Left, top, width and height of what holds some rectangles, with a margin."""
    left = min(item.x - item.width / 2.0 for item in rectangles) - margin
    top = min(item.y - item.height / 2.0 for item in rectangles) - margin
    right = max(item.x + item.width / 2.0 for item in rectangles) + margin
    bottom = max(item.y + item.height / 2.0 for item in rectangles) + margin
    return left, top, right - left, bottom - top
