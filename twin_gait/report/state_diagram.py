"""The state machine of a gait table as a drawing in SVG, or in Mermaid."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator

from twin_gait.gait.documents import mode_words, number
from twin_gait.gait.guards import LEG_WORDS, AllOf, AnyOf, Guard, PhaseMembership, bracketed
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.signals import LEFT, OTHER, RIGHT, part_of, signal_of
from twin_gait.gait.table import TICK, GaitTable, JointImpedance, State, StateTable, Transition
from twin_gait.palette import phase_colour
from twin_gait.report.diagram_layout import arrow_groups, arrows, badges, bounds, ring
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
        joiner = " and " if isinstance(guard, AllOf) else " or "
        return joiner.join(bracketed(inner, guard_words) for inner in guard.guards)
    left, unit = signal_words(guard.signal)
    if guard.minus is not None:
        left = f"{left} − {signal_words(guard.minus)[0]}"
    return f"{left} {guard.operator} {number(guard.threshold)}{unit}"


def condition_words(transition: Transition) -> str:
    """What a transition waits for: its conditions, then debounce and time."""
    words = [] if transition.guard is None else [guard_words(transition.guard)]
    if transition.debounce_ticks > 1:
        words.append(f"for {duration(transition.debounce_ticks)}")
    if transition.time_out_ticks is not None:
        words.append(f"after {duration(transition.time_out_ticks)}")
    return " ".join(filter(None, words))


def state_diagram_mermaid(table: StateTable) -> str:
    """Write the state diagram in Mermaid's ``stateDiagram-v2``."""
    # Numbers, because a name of the table might be a word of Mermaid's.
    names = {phase: f"phase_{place}" for place, phase in enumerate(table.phase_names, start=1)}
    lines = ["stateDiagram-v2", f"    [*] --> {names[table.phase_names[0]]}"]
    lines += [f'    state "{_mermaid(readable(phase))}" as {name}' for phase, name in names.items()]
    for item in table.transitions:
        label = _mermaid(f"{readable(item.cause)} [{condition_words(item)}]")
        lines.append(f"    {names[item.source]} --> {names[item.target]}: {label}")
    return "\n".join(lines) + "\n"


def _mermaid(text: str) -> str:
    """Text with what Mermaid or HTML would read as syntax in Mermaid's entity codes."""
    return "".join(char if char.isalnum() or char in " _.,°/−ζθ()[]-+" else f"#{ord(char)};" for char in text)


LINE, SMALL_LINE = 17.0, 16.0  # [px] from line to line below the drawing and in boxes
_LINE_CHARACTERS = 110
_BADGE = 19.0  # [px], height of a number on an arrow
_CHARACTER = 7.1  # [px], width of a letter of these lines, on the safe side
_COLUMNS = (14.0, 92.0, 152.0, 208.0, 280.0)  # [px] from the left edge of a box
_BOX_WIDTH = 322.0
_DIGITS = 4
_MARGIN, _HEAD = 20.0, 34.0  # [px] around the drawing, and above it for the title
_TITLE_CHARACTER = 11.0

_LEGEND = (
    "Solid: the guard opens. Dashed: time-out. Of those that leave a phase the first listed wins.",
    "k stiffness [Nm/°], θ0 equilibrium, ζ damping ratio or b damping [Nms/rad], G friction compensation",
)
_MODE_LEGEND = (_LEGEND[0], "A trip of the safety monitor leads from every mode to {}.")
# Characters that XML 1.0 does not allow even as references.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def state_diagram_svg(table: StateTable) -> str:
    """Draw the phases on a ring in the order of the cycle, with an arrow for each way out.

    Returns SVG, ending with a line break; it needs no other file and follows a dark page.
    """
    lines = [_box_lines(table, phase) for phase in table.phases]
    names = [f"{place} {readable(phase)}" for place, phase in enumerate(table.phases, start=1)]
    box_width = max(_BOX_WIDTH, 66.0 + 1.3 * _CHARACTER * max(map(len, names)))
    box_height = 36.0 + SMALL_LINE * max(map(len, lines))
    groups = arrow_groups(table)
    boxes = ring(len(table.phases), box_width, box_height)
    curves = arrows(groups, boxes)
    numbers = [
        ", ".join(str(1 + table.transitions.index(item)) for item in group.transitions) for group in groups
    ]
    marks = badges(curves, boxes, [10.0 + _CHARACTER * len(number) for number in numbers], _BADGE)
    said, legend = list(_transition_lines(table)), _legend(table)
    left, top, width, height = bounds([*boxes, *marks], _MARGIN)
    widths = [_TITLE_CHARACTER * len(table.name), *(_CHARACTER * len(text) for text in (*said, *legend))]
    colours = [phase_colour(name, place) for place, name in enumerate(table.phase_names)]
    content = {
        "name": table.name,
        "x": left + _MARGIN,
        "foot": top + height,
        "left": left,
        "top": top - _HEAD,
        "width": max(width, 2.0 * _MARGIN + max(widths)),
        "height": _HEAD + height + LINE * len((*said, *legend)) + _MARGIN,
        "arrows": list(zip(curves, groups, strict=True)),
        "boxes": list(zip(boxes, colours, names, lines, strict=True)),
        "badges": list(zip(marks, numbers, strict=True)),
        "said": said,
        "legend": legend,
        "columns": _COLUMNS,
        "line": LINE,
        "small_line": SMALL_LINE,
    }
    return _FORBIDDEN.sub("\ufffd", render("state_diagram.svg", content)) + "\n"


def _transition_lines(table: StateTable) -> Iterator[str]:
    """What the numbers of the arrows stand for."""
    for place, item in enumerate(table.transitions, start=1):
        way = f"{readable(item.source)} → {readable(item.target)}"
        text = f"{place}  {way}, {readable(item.cause)}: {condition_words(item)}"
        yield from textwrap.wrap(text, _LINE_CHARACTERS, subsequent_indent="     ")


def _legend(table: StateTable) -> list[str]:
    texts = _MODE_LEGEND if isinstance(table, ModeTable) else _LEGEND
    return [text.format(readable(getattr(table, "hold", ""))) for text in texts]


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
