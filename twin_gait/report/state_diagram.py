"""Drawing of the state machine of a gait table in SVG or in Mermaid."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from typing import NamedTuple

from twin_gait.gait.documents import format_number
from twin_gait.gait.guards import LEG_VOCABULARY, AllOf, AnyOf, Guard, PhaseMembership, bracket_guard
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.signals import LEFT, OTHER, RIGHT, find_signal, signal_part
from twin_gait.gait.table import TICK, GaitTable, JointImpedance, StateParameters, StateTable, Transition
from twin_gait.palette import phase_colour
from twin_gait.report.pages import render


def name_to_words(name: str) -> str:
    """Return a name of the table as words on one line: ``early stance`` for ``early_stance``."""
    return " ".join(name.replace("_", " ").split()) or name


def duration(ticks: int) -> str:
    """Format a number of ticks in milliseconds, or in seconds from one second on."""
    seconds = ticks * TICK
    return f"{format_number(seconds)} s" if seconds >= 1.0 else f"{format_number(1000.0 * seconds)} ms"


def describe_signal(signal: str) -> tuple[str, str]:
    """Return the name of a signal in words, and its unit: ``("other hip velocity", "°/s")``."""
    leg = next((front for front in (OTHER, LEFT, RIGHT) if signal.startswith(front)), "")
    part, declared = signal_part(signal.removeprefix(leg)), find_signal(signal)
    return (
        f"{leg.replace('.', ' ')}{name_to_words(part) if part else ''}{declared.label}",
        declared.unit.symbol,
    )


def describe_guard(guard: Guard) -> str:
    """Format a guard with readable names and units: ``hip < −8° and (knee > 40° or foot load < 0.1 BW)``."""
    if isinstance(guard, PhaseMembership):
        names = " or ".join(name_to_words(name) for name in guard.phases)
        return (
            f"other leg in {names}"
            if guard.quantity == LEG_VOCABULARY.quantity
            else f"{guard.quantity} {names}"
        )
    if isinstance(guard, (AllOf, AnyOf)):
        joiner = " and " if isinstance(guard, AllOf) else " or "
        return joiner.join(bracket_guard(inner, describe_guard) for inner in guard.guards)
    left, unit = describe_signal(guard.signal)
    if guard.minus is not None:
        left = f"{left} − {describe_signal(guard.minus)[0]}"
    return f"{left} {guard.operator} {format_number(guard.threshold)}{unit}"


def describe_condition(transition: Transition) -> str:
    """Format the condition of a transition: its guard, then debounce and timeout."""
    words = [] if transition.guard is None else [describe_guard(transition.guard)]
    if transition.debounce_ticks > 1:
        words.append(f"for {duration(transition.debounce_ticks)}")
    if transition.timeout_ticks is not None:
        words.append(f"after {duration(transition.timeout_ticks)}")
    return " ".join(filter(None, words))


def state_diagram_mermaid(table: StateTable) -> str:
    """Write the state diagram in Mermaid's ``stateDiagram-v2``."""
    # Phases have numbers, because a name of the table might be a keyword of Mermaid.
    names = {phase: f"phase_{number}" for number, phase in enumerate(table.phase_names, start=1)}
    lines = ["stateDiagram-v2", f"    [*] --> {names[table.phase_names[0]]}"]
    lines += [f'    state "{_mermaid(name_to_words(phase))}" as {name}' for phase, name in names.items()]
    for item in table.transitions:
        label = _mermaid(f"{name_to_words(item.cause)} [{describe_condition(item)}]")
        lines.append(f"    {names[item.source]} --> {names[item.target]}: {label}")
    return "\n".join(lines) + "\n"


def _mermaid(text: str) -> str:
    """Replace characters that are syntax of Mermaid or HTML by entity codes of Mermaid."""
    return "".join(char if char.isalnum() or char in " _.,°/−ζθ()[]-+" else f"#{ord(char)};" for char in text)


_LINE_CHARACTERS = 110  # in a line of text below the drawing
_HEADLINE, _LINE = 36.0, 16.0  # [px] of a box
_BELOW = 26.0  # [px] between boxes
_DIGITS = 4


class Edge(NamedTuple):
    """Transitions from one phase to another with a common arrow: timeouts, or the other transitions."""

    source: int  # position of the phase that is left
    target: int  # position of the phase that is entered
    timeout: bool  # whether the transitions are timeouts


class Arrow(NamedTuple):
    """Arrow from the edge of a box to a lane next to the boxes, along the lane, and back to a box."""

    start: float  # where the arrow leaves a box, downwards in [px]
    end: float  # where the arrow enters a box, downwards in [px]
    lane: int  # number of the lane from 1 for the innermost; arrows in a lane do not overlap
    timeout: bool
    numbers: str  # numbers of the transitions in the list below the drawing


def state_diagram_svg(table: StateTable) -> str:
    """Draw the phases one below the other, with an arrow for each exit in a lane next to them.

    Returns self-contained SVG that ends with a line break and adapts to a dark page.
    """
    boxes = [
        (f"{number} {name_to_words(phase)}", phase_colour(phase, number - 1), _box_lines(table, phase))
        for number, phase in enumerate(table.phases, start=1)
    ]
    height = _HEADLINE + _LINE * max(len(lines) for *_, lines in boxes)
    content = {
        "name": table.name,
        "boxes": boxes,
        "box_height": height,
        "below": _BELOW,
        "arrows": arrows(table, height),
        "descriptions": list(_transition_lines(table)),
        "hold": name_to_words(table.hold) if isinstance(table, ModeTable) else "",
    }
    return f"{render('state_diagram.svg', content)}\n"


def arrows(table: StateTable, box_height: float) -> list[Arrow]:
    """Assign the arrows of a table to lanes next to its boxes, short arrows inside of long ones."""
    ways: dict[Edge, list[str]] = {}
    for number, item in enumerate(table.transitions, start=1):
        way = Edge(table.phase_index(item.source), table.phase_index(item.target), item.is_timeout)
        ways.setdefault(way, []).append(str(number))
    # Arrows at the edge of each box, with those that lead upwards above the others.
    edges = [
        sorted((sum(way[:2]) - number, way) for way in ways if number in way[:2])
        for number in range(len(table.phases))
    ]

    def level(phase: int, way: Edge) -> float:
        edge = edges[phase]
        rank = edge.index((sum(way[:2]) - phase, way))
        return phase * (box_height + _BELOW) + box_height * (1 + rank) / (1 + len(edge))

    laid: list[Arrow] = []
    for way in sorted(ways, key=lambda way: abs(way.source - way.target)):
        start, end = level(way.source, way), level(way.target, way)
        low, high = sorted((start, end))
        occupied = {other.lane for other in laid if low < max(other[:2]) and min(other[:2]) < high}
        lane = next(lane for lane in range(1, len(laid) + 2) if lane not in occupied)
        laid.append(Arrow(start, end, lane, way.timeout, ", ".join(ways[way])))
    return laid


def _transition_lines(table: StateTable) -> Iterator[str]:
    """Yield the lines of text that explain the numbers of the arrows."""
    for number, item in enumerate(table.transitions, start=1):
        way = f"{name_to_words(item.source)} → {name_to_words(item.target)}"
        text = f"{number}  {way}, {name_to_words(item.cause)}: {describe_condition(item)}"
        yield from textwrap.wrap(text, _LINE_CHARACTERS, subsequent_indent="     ")


def _box_lines(table: StateTable, phase: str) -> list[tuple[str, ...]]:
    """Return the rows of cells in the box of a phase; a row with a single cell is a remark."""
    if isinstance(table, ModeTable):
        mode = table.phases[phase]
        remarks_by_text = {"walk": mode.walk, "step": mode.step, f"posture {mode.posture}": mode.posture}
        return [
            *((text,) for text, applies in remarks_by_text.items() if applies),
            *((text,) for text in _stay(mode)),
        ]
    assert isinstance(table, GaitTable)  # a table is a mode table or a gait table
    common = table.phases[phase]
    rows: list[tuple[str, ...]] = [("", "k", "θ0", "damping", "G")]
    rows += [(name_to_words(name), *_cells(joint)) for name, joint in common.joints.items()]
    share = format_number(common.gravity_compensation, _DIGITS)
    words = [f"gravity share {share}"] if common.gravity_compensation > 0.0 else []
    remarks = ", ".join([*words, *_stay(common)])
    for side, phases in table.side_phases.items():
        if phase in phases:
            rows += [
                (f"{side} {name_to_words(name)}", *_cells(item))
                for name, item in phases[phase].joints.items()
            ]
    return [*rows, *([(remarks,)] if remarks else [])]


def _cells(joint: JointImpedance) -> tuple[str, ...]:
    sign, damping = ("b", joint.damping) if joint.damping is not None else ("ζ", joint.damping_ratio)
    assert damping is not None  # JointImpedance has exactly one of the two
    return (
        format_number(joint.stiffness / math.degrees(1.0), _DIGITS),
        f"{format_number(math.degrees(joint.equilibrium_angle), _DIGITS)}°",
        f"{sign} {format_number(damping, _DIGITS)}",
        format_number(joint.friction_compensation_gain, _DIGITS),
    )


def _stay(phase: StateParameters) -> list[str]:
    return [f"at least {duration(phase.minimum_ticks)}"] if phase.minimum_ticks > 0 else []
