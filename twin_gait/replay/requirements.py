"""Which signals the guards of a table read, and whether a recorded walk has them."""

from __future__ import annotations

from collections.abc import Iterator

from twin_gait.core.guards import END_NODE, FIRST_NODE, OP_COMPARE, OP_PHASE
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import OTHER, all_signal_names
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import GaitTable
from twin_gait.replay.recording import Recording

FOOT_LOAD = "foot.load_bw"
OTHER_PHASE = f"{OTHER}phase"


def needed_signals(table: GaitTable) -> dict[str, list[str]]:
    """Signals that the guards of a table read, and which transitions read them.

    Args:
        table: The gait table.

    Returns:
        For each signal the transitions as ``late_stance → swing_flexion (trailing_limb)``, in the order in
        which the table names them.
    """
    needed: dict[str, list[str]] = {}
    for index, item in enumerate(table.transitions):
        for signal in _signals_of(table, index):
            readers = needed.setdefault(signal, [])
            label = f"{item.source} → {item.target} ({item.cause})"
            if label not in readers:
                readers.append(label)
    return needed


def _signals_of(table: GaitTable, index: int) -> Iterator[str]:
    """Signals that one transition compares, read off the compiled guards."""
    program = compile_guards(table)
    names = all_signal_names(table.joints)
    first, end = program.transitions[index, FIRST_NODE], program.transitions[index, END_NODE]
    for operation, operand in program.nodes[first:end]:
        if operation == OP_PHASE:
            yield OTHER_PHASE
        elif operation == OP_COMPARE:
            signal, _, minus, minus_factor, _ = program.comparisons[operand]
            yield names[int(signal)]
            if minus_factor != 0.0:
                yield names[int(minus)]


def check_signals(recording: Recording, table: GaitTable, body_weight: float | None) -> None:
    """Refuse a walk that lacks a signal which a guard reads.

    Args:
        recording: The walk.
        table: The gait table.
        body_weight: Of wearer and device in [N], or None if it is not known.

    Raises:
        GaitTableError: With the signal, the transitions that read it and the way out.
    """
    for signal, readers in needed_signals(table).items():
        problem = _lacking(recording, signal, body_weight)
        if problem:
            raise GaitTableError(
                f"{recording.source}: the table {table.name} reads {signal} in {'; '.join(readers)}, but "
                f"{problem}"
            )


def _lacking(recording: Recording, signal: str, body_weight: float | None) -> str:
    """Why a signal cannot be had; empty if it can."""
    if signal.startswith(OTHER) and len(recording.sides) < 2:
        return "the log has one leg: add --mirror to make the other one of it, or take another table"
    if signal == OTHER_PHASE:
        return ""
    name = signal.removeprefix(OTHER)
    if name == FOOT_LOAD:
        lacking = [side for side in recording.sides if side not in recording.loads]
        if lacking:
            return f"the log has no {lacking[0]}_foot_normal_force_N: name it in --columns"
        return "" if body_weight else "the weight is not known: add --total-mass KG"
    joint, _, quantity = name.partition(".")
    if not quantity:
        return ""  # the time in phase is the machine's own
    for side, joints in recording.angles.items():
        if joint not in joints:
            return f"the log has no angle of the {side} {joint}: name its column in --columns"
    return ""
