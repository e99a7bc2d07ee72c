"""Words for the guards and numbers of a gait table in its drawing, and the drawing in Mermaid."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from twin_gait.gait.documents import number
from twin_gait.gait.guards import LEG_WORDS, AllOf, AnyOf, Guard, PhaseMembership
from twin_gait.gait.signals import LEFT, OTHER, RIGHT, part_of, signal_of
from twin_gait.gait.table import TICK, JointImpedance, StateTable, Transition


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
        return _joiner(guard).join(_bracketed(inner) for inner in guard.guards)
    left, unit = signal_words(guard.signal)
    if guard.minus is not None:
        left = f"{left} − {signal_words(guard.minus)[0]}"
    return f"{left} {guard.operator} {number(guard.threshold)}{unit}"


def _joiner(guard: AllOf | AnyOf) -> str:
    return " and " if isinstance(guard, AllOf) else " or "


def _bracketed(guard: Guard) -> str:
    return f"({guard_words(guard)})" if isinstance(guard, (AllOf, AnyOf)) else guard_words(guard)


def condition_lines(transition: Transition, width: int) -> list[str]:
    """What a transition waits for in lines of at most a width: its conditions, then debounce and time.

    ``and`` or ``or`` stands in front of all conditions but the first.
    """
    guard = transition.guard
    if isinstance(guard, (AllOf, AnyOf)):
        word = _joiner(guard).lstrip()
        lines = [f"{word if index else ''}{_bracketed(inner)}" for index, inner in enumerate(guard.guards)]
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
