"""The state machine of a gait table as a drawing in SVG."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from xml.sax.saxutils import escape

from twin_gait.gait.documents import mode_words, number
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.table import GaitTable, JointImpedance, State, StateTable
from twin_gait.palette import phase_colour
from twin_gait.report.diagram_layout import (
    Arrow,
    ArrowGroup,
    Rectangle,
    arrow_groups,
    bounds,
    lay_out,
)
from twin_gait.report.diagram_words import condition_lines, damping_words, duration, readable

LINE, SMALL_LINE = 17.0, 16.0  # [px] from line to line of labels and in boxes
_LABEL_CHARACTERS = 32
_CHARACTER = 7.1  # [px], width of a letter at the label's size, on the safe side
_COLUMNS = (14.0, 66.0, 126.0, 182.0, 254.0)  # [px] from the left edge of a box, for short joint names
_BOX_WIDTH, _NAME_CHARACTERS = 296.0, 6
_DIGITS = 4
# [px]: around the drawing, above it for the title, below it for the legend, and the least width for that.
_MARGIN, _HEAD, _FOOT, _LEAST_WIDTH = 20.0, 34.0, 54.0, 640.0
_TITLE_CHARACTER = 11.0

_LEGEND = (
    "Solid: the guard opens. Dashed: time-out. First listed cause wins.",
    "k stiffness [Nm/°], θ0 equilibrium, ζ damping ratio or b damping [Nms/rad], G friction compensation",
)
_MODE_LEGEND = (_LEGEND[0], "A trip of the safety monitor leads from every mode to {}.")
_SHAPES = """
  text { font: 13px system-ui, "Segoe UI", "DejaVu Sans", Arial, sans-serif;
         paint-order: stroke; stroke-width: 3px; stroke-linejoin: round }
  .title { font-size: 17px; font-weight: 600 }
  .name { font-size: 15px; font-weight: 600 }
  .cause { font-weight: 600 }
  .faint { font-size: 12px }
  .box { stroke-width: 2.5px }
  .dot { stroke-width: 1px }
  .arrow { fill: none; stroke-width: 1.8px }
  .time-out { stroke-dasharray: 6 5 }"""


def _theme(ink: str, faint: str, ground: str) -> str:
    """Colours of text and lines on a ground, without the variables of CSS, which not every program knows."""
    return f"""
  text {{ fill: {ink}; stroke: {ground} }}
  .faint {{ fill: {faint} }}
  .ground, .box {{ fill: {ground} }}
  .dot, .arrow {{ stroke: {faint} }}
  .tip {{ fill: {faint} }}"""


# Text and ground change together, so that one is legible on the other whatever the page around is.
_LIGHT, _DARK = _theme("#1a1a1a", "#595959", "#ffffff"), _theme("#f0f0f0", "#b0b0b0", "#16181c")
_STYLE = f"{_SHAPES}{_LIGHT}\n  @media (prefers-color-scheme: dark) {{{_DARK}\n  }}\n"


def phase_colours(table: StateTable) -> dict[str, str]:
    """Colour of each phase; a phase with a name of its own takes one that the others leave.

    Returns colours as ``#RRGGBB`` by phase; they repeat in tables of more phases than there are colours.
    """
    usual = {name: phase_colour(name, 0) for name in table.phase_names}
    own = [name for name in table.phase_names if phase_colour(name, 0) != phase_colour(name, 1)]
    taken = {colour for name, colour in usual.items() if name not in own}
    for position, name in enumerate(own):
        free = (phase_colour(name, k) for k in range(len(table.phases) + 8))
        usual[name] = next((c for c in free if c not in taken), phase_colour(name, position))
        taken.add(usual[name])
    return usual


def state_diagram_svg(table: StateTable) -> str:
    """Draw the phases on a ring in the order of the cycle, with an arrow for each way out.

    Returns SVG, ending with a line break; it needs no other file and follows a dark page.
    """
    lines = max(len(_box_lines(table, phase)) for phase in table.phases)
    groups = arrow_groups(table)
    size = _box_width(table), 36.0 + SMALL_LINE * lines
    label_sizes = [_label_size(item) for item in groups]
    boxes, curves, labels, _ = lay_out(groups, len(table.phases), size, label_sizes)
    frame = _frame(table, [*boxes, *labels])
    parts = [
        *_head(table, frame),
        *(_arrow_path(curve, group) for curve, group in zip(curves, groups, strict=True)),
        *itertools.chain.from_iterable(_box(table, k, box) for k, box in enumerate(boxes)),
        *itertools.chain.from_iterable(
            _label(place, curve, group) for place, curve, group in zip(labels, curves, groups, strict=True)
        ),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _frame(table: StateTable, content: list[Rectangle]) -> tuple[float, float, float, float]:
    """Left, top, width and height of the whole drawing, title and legend included."""
    left, top, width, height = bounds(content, _MARGIN)
    least = max(_LEAST_WIDTH, 2.0 * _MARGIN + _TITLE_CHARACTER * len(table.name))
    return left, top - _HEAD, max(width, least), height + _HEAD + _FOOT


def _head(table: StateTable, frame: tuple[float, float, float, float]) -> Iterator[str]:
    """What stands before the arrows: style, ground, title and legend."""
    left, top, width, height = frame
    size = f'width="{width:.0f}" height="{height:.0f}"'
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.0f} {top:.0f} {width:.0f} {height:.0f}" '
        f'{size} role="img">'
    )
    yield f"<title>{_xml(f'State diagram of {table.name}')}</title>"
    yield f"<style>{_STYLE}</style>"
    yield (
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
        'orient="auto"><path class="tip" d="M0 0 10 5 0 10z"/></marker></defs>'
    )
    yield f'<rect class="ground" x="{left:.0f}" y="{top:.0f}" {size} rx="10"/>'
    yield _line(left + _MARGIN, top + _HEAD - 6.0, table.name, "title")
    for row, text in enumerate(_legend(table)):
        yield _line(left + _MARGIN, top + height - _FOOT + 12.0 + LINE * row, text, "faint")


def _legend(table: StateTable) -> tuple[str, ...]:
    if isinstance(table, ModeTable):
        return tuple(text.format(readable(table.hold)) for text in _MODE_LEGEND)
    return _LEGEND


def _box(table: StateTable, position: int, box: Rectangle) -> Iterator[str]:
    """A phase: colour, name, and what it sets."""
    phase = table.phase_names[position]
    colour = phase_colours(table)[phase]
    x, y = box.x - box.width / 2.0, box.y - box.height / 2.0
    yield (
        f'<rect class="box" x="{x:.1f}" y="{y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" '
        f'rx="10" stroke="{colour}"/>'
    )
    yield f'<circle class="dot" cx="{x + 21:.1f}" cy="{y + 18:.1f}" r="7" fill="{colour}"/>'
    yield _line(x + 36.0, y + 23.0, f"{position + 1} {readable(phase)}", "name")
    for row, cells in enumerate(_box_lines(table, phase)):
        style = "faint" if row == 0 or len(cells) == 1 else ""
        for column, cell in zip(_columns(table), cells, strict=False):
            yield _line(x + column, y + 43.0 + SMALL_LINE * row, cell, style)


def _columns(table: StateTable) -> list[float]:
    """Where the columns of a box begin, shifted for long names of joints."""
    rows = [row for phase in table.phases for row in _box_lines(table, phase) if len(row) > 1]
    longest = max((len(row[0]) for row in rows), default=0)
    shift = _CHARACTER * max(0, longest - _NAME_CHARACTERS)
    return [_COLUMNS[0], *(column + shift for column in _COLUMNS[1:])]


def _box_width(table: StateTable) -> float:
    name = max(len(readable(phase)) for phase in table.phases)
    return max(_BOX_WIDTH + _columns(table)[1] - _COLUMNS[1], 80.0 + 1.3 * _CHARACTER * name)


def _box_lines(table: StateTable, phase: str) -> list[tuple[str, ...]]:
    """Rows of cells in a phase's box; a row of one cell is a remark."""
    if isinstance(table, ModeTable):
        words = [*mode_words(table.phases[phase]), *_stay(table.phases[phase])]
        return [(text,) for text in words]
    assert isinstance(table, GaitTable)  # there is no third kind
    common = table.phases[phase]
    rows: list[tuple[str, ...]] = [("", "k", "θ0", "damping", "G")]
    rows += [(readable(name), *_cells(joint)) for name, joint in common.joints.items()]
    share = number(common.gravity_compensation, _DIGITS)
    words = [f"gravity share {share}"] if common.gravity_compensation > 0.0 else []
    remarks = ", ".join([*words, *_stay(common)])
    for side, own in table.side_phases.items():
        if phase in own:
            rows += [(f"{side} {readable(name)}", *_cells(item)) for name, item in own[phase].joints.items()]
    return [*rows, *([(remarks,)] if remarks else [])]


def _cells(joint: JointImpedance) -> tuple[str, ...]:
    return (
        number(joint.stiffness / math.degrees(1.0), _DIGITS),
        f"{number(math.degrees(joint.equilibrium_angle), _DIGITS)}°",
        damping_words(joint, _DIGITS),
        number(joint.friction_compensation_gain, _DIGITS),
    )


def _stay(phase: State) -> list[str]:
    return [f"at least {duration(phase.minimum_ticks)}"] if phase.minimum_ticks > 0 else []


def _arrow_path(curve: Arrow, group: ArrowGroup) -> str:
    kind = "arrow time-out" if group.time_out else "arrow"
    (x0, y0), (x1, y1), (x2, y2) = curve.start, curve.control, curve.end
    path = f"M{x0:.1f} {y0:.1f}Q{x1:.1f} {y1:.1f} {x2:.1f} {y2:.1f}"
    return f'<path class="{kind}" d="{path}" marker-end="url(#tip)"/>'


def _label_lines(group: ArrowGroup) -> list[tuple[str, str]]:
    """Lines of a label with their style: the cause in bold, its conditions below."""
    lines: list[tuple[str, str]] = []
    for item in group.transitions:
        lines += [("", "")] if lines else []
        lines.append((readable(item.cause), "cause"))
        lines += [(text, "") for text in condition_lines(item, _LABEL_CHARACTERS)]
    return lines


def _label_size(group: ArrowGroup) -> tuple[float, float]:
    lines = _label_lines(group)
    return _CHARACTER * max(len(text) for text, _ in lines), LINE * len(lines)


def _label(place: Rectangle, curve: Arrow, group: ArrowGroup) -> Iterator[str]:
    """A label, set flush on the side of its arrow."""
    anchor, x = "middle", place.x
    if abs(curve.normal.x) > 0.35:
        side = 1.0 if curve.normal.x > 0.0 else -1.0
        anchor, x = ("start" if side > 0.0 else "end"), place.x - side * place.width / 2.0
    for row, (text, style) in enumerate(_label_lines(group)):
        y = place.y - place.height / 2.0 + LINE * (row + 0.75)
        yield _line(x, y, text, style, anchor)


def _line(x: float, y: float, text: str, style: str, anchor: str = "start") -> str:
    kind = f' class="{style}"' if style else ""
    side = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text{kind} x="{x:.1f}" y="{y:.1f}"{side}>{_xml(text)}</text>'


# Characters that XML 1.0 does not allow even as references.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _xml(text: str) -> str:
    """Text of a user's file as XML."""
    return escape(_FORBIDDEN.sub("\ufffd", text))
