"""The state machine of a gait table in Mermaid, for pages that render it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from twin_gait.gait.table import GaitTable
from twin_gait.report.diagram_words import condition_lines, readable


def state_diagram_mermaid(table: GaitTable) -> str:
    """Write the state diagram in Mermaid's ``stateDiagram-v2``.

    Args:
        table: The gait table.

    Returns:
        Mermaid text, ending with a line break.
    """
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
