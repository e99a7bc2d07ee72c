"""Where the boxes, arrows and labels of a state diagram lie: plane geometry in pixels, y downwards."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from twin_gait.gait.table import StateTable, Transition

GAP = 7.0  # [px] between a box and an arrow, or an arrow and its label
# Bends of an arrow over its length, to the left of its direction, which on the ring is outwards. A
# time-out bends the other way, unless the arrows of the way back lie there.
_BEND, _BEND_TIME_OUT, _BEND_TIME_OUT_OF_PAIR = 0.16, -0.14, 0.08
# Shares of its bend that an arrow may take instead, the first that passes no box, and places of its label.
_BENDS = (1.0, 0.6, 0.2, 1.5, -0.5, -1.0, 2.0)
_PLACES = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
_SAMPLES = 41  # of an arrow
_ROUNDS, _GROWTH = 12, 0.1  # of the ring
_COLLISION = 1000  # a label on a label or a box, in samples of arrows that it covers

_T = TypeVar("_T")


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
    """A quadratic curve from box to box."""

    start: Point  # where it leaves the box
    control: Point  # control point
    end: Point  # where its tip is
    middle: Point  # half-way along it
    normal: Point  # unit vector at the middle, to the side where the label lies


class Layout(NamedTuple):
    """Where everything of a diagram lies."""

    boxes: list[Rectangle]  # the phases
    arrows: list[Arrow]  # of each group
    labels: list[Rectangle]  # of each arrow
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
    laid, drawn = list[Arrow](), np.zeros((0, _SAMPLES, 2))
    for item in groups:
        bend = _BEND
        if item.time_out:
            bend = _BEND_TIME_OUT_OF_PAIR if (item.target, item.source) in joined else _BEND_TIME_OUT
        ways = (_arrow(boxes[item.source], boxes[item.target], bend * share) for share in _BENDS)
        best, _ = _cheapest(ways, functools.partial(_hidden, boxes, drawn))
        drawn = np.concatenate((drawn, _samples(best)[None]))
        if item.time_out:  # its label lies inside of the ring
            best = best._replace(normal=Point(-best.normal.x, -best.normal.y))
        laid.append(best)
    return laid


def _hidden(boxes: Sequence[Rectangle], drawn: np.ndarray, way: Arrow) -> int:
    """Samples of an arrow under boxes, or along another arrow from the same place to the same."""
    points = _samples(way)
    return sum(_inside(points, box) for box in boxes) + int((np.abs(drawn - points).max(2) < GAP).sum())


def _cheapest(candidates: Iterable[_T], cost: Callable[[_T], int]) -> tuple[_T, int]:
    """First candidate of the least cost, and the cost; the search ends at a cost of zero."""
    found = list[tuple[int, int, _T]]()
    for number, item in enumerate(candidates):
        found.append((cost(item), number, item))
        if found[-1][0] == 0:
            break
    least, _, best = min(found, key=lambda entry: entry[:2])
    return best, least


def _arrow(source: Rectangle, target: Rectangle, bend: float) -> Arrow:
    """Lay an arrow between two boxes, its label on the left of its direction."""
    dx, dy = target.x - source.x, target.y - source.y
    length = math.hypot(dx, dy)
    left = Point(dy / length, -dx / length)
    height = 2.0 * bend * length  # the curve reaches half as far as its control point
    control = Point(
        (source.x + target.x) / 2.0 + height * left.x, (source.y + target.y) / 2.0 + height * left.y
    )
    start, end = _edge(source, control), _edge(target, control)
    return _labelled(Arrow(start, control, end, start, left), 0.5, 1.0)


def _labelled(curve: Arrow, share: float, side: float) -> Arrow:
    """An arrow with the place of its label at a share of its way, on the left (1) or on the right (-1)."""
    start, control, end = (np.array(point) for point in curve[:3])
    middle = (1 - share) ** 2 * start + 2 * share * (1 - share) * control + share**2 * end
    along = (1 - share) * (control - start) + share * (end - control)
    x, y = side * along / np.hypot(*along)
    return curve._replace(middle=Point(*middle.tolist()), normal=Point(float(y), float(-x)))


def _samples(curve: Arrow) -> np.ndarray:
    """Points along an arrow, shape ``(n, 2)``."""
    start, control, end = (np.array(point) for point in curve[:3])
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    return np.asarray((1 - share) ** 2 * start + 2 * share * (1 - share) * control + share**2 * end)


def _inside(points: np.ndarray, box: Rectangle) -> int:
    """How many points, shape ``(n, 2)``, lie in a rectangle."""
    half = np.array([box.width, box.height]) / 2.0
    return int((np.abs(points - [box.x, box.y]) < half).all(axis=1).sum())


def _overlap(first: Rectangle, second: Rectangle, gap: float = 0.0) -> bool:
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
    rings = (ring(count, *box, spread=1.0 + _GROWTH * number) for number in range(_ROUNDS))
    layouts = (_with_labels(arrows(groups, boxes), boxes, labels) for boxes in rings)
    return _cheapest(layouts, lambda layout: layout.covered)[0]


def _with_labels(curves: list[Arrow], boxes: list[Rectangle], sizes: Sequence[tuple[float, float]]) -> Layout:
    """Place the labels, large ones first, each where it covers least."""
    drawn = np.concatenate([np.zeros((0, 2)), *map(_samples, curves)])
    placed, total = dict[int, Rectangle](), 0
    for number in sorted(range(len(curves)), key=lambda k: -sizes[k][0] * sizes[k][1]):

        def covered(curve: Arrow, size: tuple[float, float] = sizes[number]) -> int:
            place = label_place(curve, *size)
            taken = sum(_overlap(place, item, GAP / 2.0) for item in (*boxes, *placed.values()))
            return _COLLISION * taken + _inside(drawn, place)

        curves[number], least = _cheapest(_label_candidates(curves[number]), covered)
        placed[number] = label_place(curves[number], *sizes[number])
        total += least
    return Layout(boxes, curves, [placed[number] for number in range(len(curves))], total)


def _label_candidates(curve: Arrow) -> Iterator[Arrow]:
    """The usual place first, then others along the arrow on either side."""
    yield curve
    dx, dy = curve.end.x - curve.start.x, curve.end.y - curve.start.y
    usual = 1.0 if curve.normal.x * dy - curve.normal.y * dx > 0.0 else -1.0
    for share in _PLACES:
        for side in (usual, -usual):
            yield _labelled(curve, share, side)


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
    """Rectangle of a label beside the middle of an arrow, clear of it."""
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
