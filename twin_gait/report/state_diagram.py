"""The state machine of a gait table as a drawing in SVG, or in Mermaid."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from twin_gait.gait.documents import mode_words, number
from twin_gait.gait.guards import LEG_WORDS, AllOf, AnyOf, Guard, PhaseMembership, bracketed
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.signals import LEFT, OTHER, RIGHT, part_of, signal_of
from twin_gait.gait.table import TICK, GaitTable, JointImpedance, State, StateTable, Transition
from twin_gait.palette import phase_colour
from twin_gait.report.diagram_layout import ArrowGroup, Label, Rectangle, arrow_groups, bounds, lay_out
from twin_gait.report.pages import render


def readable(name: str) -> str:
    """A name of the table as words on one line: ``early stance`` for ``early_stance``."""
    return " ".join(name.replace("_", " ").split()) or name


def duration(ticks: int) -> str:
    """Write a number of ticks as milliseconds, or seconds from one second on."""
    seconds = ticks * TICK
    return f"{number(seconds)} s" if seconds >= 1.0 else f"{number(1000.0 * seconds)} ms"


def damping_words(joint: JointImpedance, digits: int = 10) -> str:
    """Write the damping of a joint as the table gives it: ``ζ`` or ``b`` in [Nms/rad]."""
    if joint.damping_ratio is not None:
        return f"ζ {number(joint.damping_ratio, digits)}"
    assert joint.damping is not None  # JointImpedance holds exactly one of them
    return f"b {number(joint.damping, digits)}"


def signal_words(signal: str) -> tuple[str, str]:
    """Name of a signal in words, and its unit: ``("other hip velocity", "°/s")``."""
    leg = next((front for front in (OTHER, LEFT, RIGHT) if signal.startswith(front)), "")
    part, declared = part_of(signal.removeprefix(leg)), signal_of(signal)
    return f"{leg.replace('.', ' ')}{readable(part) if part else ''}{declared.words}", declared.unit.symbol


def guard_words(guard: Guard) -> str:
    """A guard with readable names and units: ``hip < −8° and (knee > 40° or foot load < 0.1 BW)``."""
    if isinstance(guard, PhaseMembership):
        names = " or ".join(readable(name) for name in guard.phases)
        return f"other leg in {names}" if guard.of == LEG_WORDS.of else f"{guard.of} {names}"
    if isinstance(guard, (AllOf, AnyOf)):
        return _joiner(guard).join(bracketed(inner, guard_words) for inner in guard.guards)
    left, unit = signal_words(guard.signal)
    if guard.minus is not None:
        left = f"{left} − {signal_words(guard.minus)[0]}"
    return f"{left} {guard.operator} {number(guard.threshold)}{unit}"


def _joiner(guard: AllOf | AnyOf) -> str:
    return " and " if isinstance(guard, AllOf) else " or "


def condition_lines(transition: Transition, width: int) -> list[str]:
    """What a transition waits for in lines of at most a width: its conditions, then debounce and time.

    ``and`` or ``or`` stands in front of all conditions but the first.
    """
    guard = transition.guard
    if isinstance(guard, (AllOf, AnyOf)):
        word = _joiner(guard).lstrip()
        lines = [
            f"{word if index else ''}{bracketed(inner, guard_words)}"
            for index, inner in enumerate(guard.guards)
        ]
    else:
        lines = [guard_words(guard)]
    if transition.debounce_ticks > 1:
        lines.append(f"for {duration(transition.debounce_ticks)}")
    if transition.time_out_ticks is not None:
        lines.append(f"after {duration(transition.time_out_ticks)}")
    return [part for line in lines for part in textwrap.wrap(line, width)]


def state_diagram_mermaid(table: StateTable) -> str:
    """Write the state diagram in Mermaid's ``stateDiagram-v2``."""
    names = _mermaid_names(table.phase_names)
    lines = ["stateDiagram-v2", f"    [*] --> {names[table.phase_names[0]]}"]
    lines += [f'    state "{_mermaid(readable(phase))}" as {name}' for phase, name in names.items()]
    for item in table.transitions:
        conditions = " ".join(condition_lines(item, 10**6))
        label = _mermaid(f"{readable(item.cause)} [{conditions}]")
        lines.append(f"    {names[item.source]} --> {names[item.target]}: {label}")
    return "\n".join(lines) + "\n"


def _mermaid_names(phases: Sequence[str]) -> dict[str, str]:
    """Identifiers: the phases' own names, unless one might be a word of Mermaid's."""
    if all(re.fullmatch(r"[A-Za-z]+(_[A-Za-z0-9]+)+", phase) for phase in phases):
        return {phase: phase for phase in phases}
    return {phase: f"phase_{position}" for position, phase in enumerate(phases, start=1)}


def _mermaid(text: str) -> str:
    """Text with what Mermaid or HTML would read as syntax in Mermaid's entity codes."""
    return "".join(char if char.isalnum() or char in " _.,°/−ζθ()[]-+" else f"#{ord(char)};" for char in text)


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
# Characters that XML 1.0 does not allow even as references.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class _Text(NamedTuple):
    """A line of text."""

    x: float
    y: float
    words: str
    style: str = ""
    anchor: str = "start"


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
    lines = {phase: _box_lines(table, phase) for phase in table.phases}
    # Long names of joints shift the columns behind them.
    longest = max((len(row[0]) for rows in lines.values() for row in rows if len(row) > 1), default=0)
    shift = _CHARACTER * max(0, longest - _NAME_CHARACTERS)
    name = max(len(readable(phase)) for phase in table.phases)
    box_width = max(_BOX_WIDTH + shift, 80.0 + 1.3 * _CHARACTER * name)
    box_height = 36.0 + SMALL_LINE * max(map(len, lines.values()))
    groups = arrow_groups(table)
    labels = [_label_lines(item) for item in groups]
    sizes = [(_CHARACTER * max(len(text) for text, _ in item), LINE * len(item)) for item in labels]
    layout = lay_out(groups, len(table.phases), (box_width, box_height), sizes)
    left, top, width, height = bounds([*layout.boxes, *(label.place for label in layout.labels)], _MARGIN)
    top, height = top - _HEAD, height + _HEAD + _FOOT
    x, foot = left + _MARGIN, top + height - _FOOT + 12.0
    texts = [_Text(x, top + _HEAD - 6.0, table.name, "title")]
    texts += [_Text(x, foot + LINE * row, text, "faint") for row, text in enumerate(_legend(table))]
    for place, (phase, box) in enumerate(zip(table.phases, layout.boxes, strict=True), start=1):
        texts += _box_texts(f"{place} {readable(phase)}", lines[phase], shift, box)
    for label, said in zip(layout.labels, labels, strict=True):
        texts += _label_texts(label, said)
    content = {
        "name": _FORBIDDEN.sub("\ufffd", table.name),
        "left": left,
        "top": top,
        "width": max(width, _LEAST_WIDTH, 2.0 * _MARGIN + _TITLE_CHARACTER * len(table.name)),
        "height": height,
        "arrows": list(zip(layout.arrows, groups, strict=True)),
        "boxes": list(zip(layout.boxes, phase_colours(table).values(), strict=True)),
        "texts": [text._replace(words=_FORBIDDEN.sub("\ufffd", text.words)) for text in texts],
    }
    return render("state_diagram.svg", content) + "\n"


def _legend(table: StateTable) -> tuple[str, ...]:
    if isinstance(table, ModeTable):
        return tuple(text.format(readable(table.hold)) for text in _MODE_LEGEND)
    return _LEGEND


def _box_texts(name: str, lines: list[tuple[str, ...]], shift: float, box: Rectangle) -> Iterator[_Text]:
    """Name of a phase, and what it sets."""
    x, y = box.x - box.width / 2.0, box.y - box.height / 2.0
    columns = [_COLUMNS[0], *(column + shift for column in _COLUMNS[1:])]
    yield _Text(x + 36.0, y + 23.0, name, "name")
    for row, cells in enumerate(lines):
        style = "faint" if row == 0 or len(cells) == 1 else ""
        for column, cell in zip(columns, cells, strict=False):
            yield _Text(x + column, y + 43.0 + SMALL_LINE * row, cell, style)


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


def _label_lines(group: ArrowGroup) -> list[tuple[str, str]]:
    """Lines of a label with their style: the cause in bold, its conditions below."""
    lines: list[tuple[str, str]] = []
    for item in group.transitions:
        lines += [("", "")] if lines else []
        lines.append((readable(item.cause), "cause"))
        lines += [(text, "") for text in condition_lines(item, _LABEL_CHARACTERS)]
    return lines


def _label_texts(label: Label, lines: list[tuple[str, str]]) -> Iterator[_Text]:
    """A label, set flush on the side of its arrow."""
    place = label.place
    anchor, x = "middle", place.x
    if label.normal.real > 0.35:
        anchor, x = "start", place.x - place.width / 2.0
    elif label.normal.real < -0.35:
        anchor, x = "end", place.x + place.width / 2.0
    for row, (text, style) in enumerate(lines):
        yield _Text(x, place.y - place.height / 2.0 + LINE * (row + 0.75), text, style, anchor)
