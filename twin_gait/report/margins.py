"""Margins around the panels of a figure, from the sizes of what stands there: computed, not solved for.

matplotlib's constrained layout lays a whole figure out twice and solves for the margins of every panel, which
takes longer than drawing it. A grid of panels under a title and over a legend needs six numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import LayoutEngine
from matplotlib.text import Text
from matplotlib.transforms import Bbox

POINTS = 72.0  # [pt] per inch
GAP = 3.5  # [pt] between what is beside each other
TALL = 1.25  # height of a line of text over its font size, with what reaches below
_ROUNDS = 2  # tick labels depend on the size of the panels, which depends on the tick labels
_LEAST = 0.2  # of a figure that its panels keep, whatever stands around them


class _Overhang(NamedTuple):
    """How far what belongs to a panel reaches beyond it in [pt]."""

    left: float
    right: float
    top: float
    bottom: float


class FixedMargins(LayoutEngine):
    """Puts one grid of panels between the title and the legend of a figure.

    The gaps between all rows are equal, and those between all columns.
    """

    _adjust_compatible = True
    _colorbar_gridspec = True

    def execute(self, fig: Figure) -> None:
        """Set the margins; matplotlib calls this whenever it draws the figure.

        Args:
            fig: The figure; panels outside of its grid stay where they are.
        """
        for _ in range(_ROUNDS):
            _set_margins(fig)


def _set_margins(figure: Figure) -> None:
    panels = [(axes, spot) for axes in figure.axes if (spot := axes.get_subplotspec()) is not None]
    if not panels:
        return
    rows, columns = panels[0][1].get_gridspec().get_geometry()
    width, height = (POINTS * inches for inches in figure.get_size_inches())
    reaches = [(_overhang(axes), spot) for axes, spot in panels]
    left = max(reach.left for reach, spot in reaches if spot.colspan.start == 0)
    right = max(reach.right for reach, _ in reaches)
    top = max(reach.top for reach, spot in reaches if spot.rowspan.start == 0)
    bottom = max(reach.bottom for reach, spot in reaches if spot.rowspan.stop == rows)
    beside = max((reach.left for reach, spot in reaches if spot.colspan.start > 0), default=0.0)
    above = max((reach.top for reach, spot in reaches if spot.rowspan.start > 0), default=0.0)
    below = max((reach.bottom for reach, spot in reaches if spot.rowspan.stop < rows), default=0.0)
    title, legend = _title_height(figure), _legend_height(figure)
    across = _shares(left + GAP, right + GAP, beside + right + 2.0 * GAP, columns, width)
    up = _shares(bottom + legend + GAP, top + title + GAP, above + below + GAP, rows, height)
    figure.subplots_adjust(
        left=across.first, right=across.last, wspace=across.gap,
        bottom=up.first, top=up.last, hspace=up.gap,
    )  # fmt: skip


class _Shares(NamedTuple):
    """Ends of the panels as shares of a figure, and the gap between two as a share of a panel's mean size."""

    first: float
    last: float
    gap: float


def _shares(before: float, after: float, gap: float, count: int, size: float) -> _Shares:
    """Divide a size in [pt] into margins, panels and gaps; what stands around may be too large for it."""
    most = (1.0 - _LEAST) * size
    shrink = min(1.0, most / (before + after + gap * (count - 1)))
    before, after, gap = (shrink * part for part in (before, after, gap))
    panel = (size - before - after - gap * (count - 1)) / count
    return _Shares(before / size, 1.0 - after / size, gap / panel)


def _overhang(axes: Axes) -> _Overhang:
    across, up = axes.xaxis, axes.yaxis
    left = _label_room(up) + _tick_room(up)  # ticks stand there without labels too
    if _has_labels(up, "labelleft"):
        left += _label_box(up).width
    beyond = _end_labels(axes) if _has_labels(across, "labelbottom") else (0.0, 0.0)
    bottom = _label_room(across) + _tick_room(across)
    if _has_labels(across, "labelbottom"):
        bottom += _label_box(across).height
    return _Overhang(max(left, beyond[0]), beyond[1], _title_room(axes), bottom)


def _has_labels(axis: Axis, side: str) -> bool:
    return bool(axis.get_tick_params().get(side, True))


def _tick_room(axis: Axis) -> float:
    """Length of a tick and its distance to its label in [pt]."""
    first = axis.get_major_ticks(1)[0]
    pad: Any = first.get_pad()  # type: ignore[func-returns-value]  # the stubs say that it gives nothing
    return float(first.get_tick_padding() + pad)


def _label_room(axis: Axis) -> float:
    """Height of the label of an axis with its distance to the labels of the ticks in [pt]."""
    label = axis.get_label()
    return axis.labelpad + TALL * float(label.get_fontsize()) if label.get_text() else 0.0


def _label_box(axis: Axis) -> Bbox:
    """Size of the longest label of the ticks in [pt]."""
    texts = axis.get_major_formatter().format_ticks(list(axis.get_majorticklocs()))
    first = axis.get_major_ticks(1)[0].label1
    # A sign is wider than a figure.
    longest = max(texts, key=lambda text: (len(text), "\N{MINUS SIGN}" in text), default="")
    sample = Text(text=longest, fontproperties=first.get_fontproperties())
    return _in_points(sample, axis.axes)


def _end_labels(axes: Axes) -> tuple[float, float]:
    """How far the labels of the first and of the last tick reach beyond the ends of a panel in [pt]."""
    start, end = sorted(axes.get_xlim())
    inside = [float(place) for place in axes.xaxis.get_majorticklocs() if start <= place <= end]
    if not inside:
        return 0.0, 0.0
    half, scale = 0.5 * _label_box(axes.xaxis).width, _points(axes, axes.bbox.width) / (end - start)
    return max(0.0, half - scale * (inside[0] - start)), max(0.0, half - scale * (end - inside[-1]))


def _points(axes: Axes, pixels: float) -> float:
    return pixels * POINTS / axes.figure.dpi


def _in_points(text: Text, axes: Axes) -> Bbox:
    text.set_figure(axes.figure)
    box = text.get_window_extent()
    return Bbox.from_extents(0.0, 0.0, _points(axes, box.width), _points(axes, box.height))


def _title_room(axes: Axes) -> float:
    """How far the texts above a panel reach over it in [pt]."""
    texts = [item for item in axes.get_children() if isinstance(item, Text) and item.get_text()]
    reach = max((text.get_window_extent().y1 - axes.bbox.y1 for text in texts), default=0.0)
    return _points(axes, max(0.0, reach))


def _title_height(figure: Figure) -> float:
    """How far the title of a figure reaches down in [pt]."""
    lowest = min((text.get_window_extent().y0 for text in figure.texts), default=figure.bbox.y1)
    return (figure.bbox.y1 - lowest) * POINTS / figure.dpi


def _legend_height(figure: Figure) -> float:
    """How far the legend of a figure reaches up in [pt]."""
    highest = max((legend.get_window_extent().y1 for legend in figure.legends), default=0.0)
    return highest * POINTS / figure.dpi
