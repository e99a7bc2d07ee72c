"""Compile a gait table into the arrays that the core evaluates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.core.guards import OP_ALL, OP_ANY, OP_COMPARE, OP_PHASE
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import AllOf, Comparison, Guard, PhaseMembership, all_signal_names, signal_scale
from twin_gait.gait.table import GaitTable, Transition

OPEN_RESULTS = 62  # results that wait to be joined are bits of a signed 64-bit integer


class GuardProgram(NamedTuple):
    """Transitions and guards as arrays; their meaning is in :mod:`twin_gait.core.guards`.

    Attributes:
        transitions: Shape ``(n_transitions, 6)``, integers.
        nodes: Shape ``(n_nodes, 2)``, integers.
        comparisons: Shape ``(n_comparisons, 5)``.
        minimum_ticks: Minimum duration in each phase, shape ``(n_phases,)``, integers.
    """

    transitions: np.ndarray
    nodes: np.ndarray
    comparisons: np.ndarray
    minimum_ticks: np.ndarray


def compile_guards(table: GaitTable) -> GuardProgram:
    """Compile the transitions of a table.

    Args:
        table: The gait table.

    Returns:
        The program, with thresholds in SI units.
    """
    nodes: list[tuple[int, int]] = []
    comparisons: list[tuple[float, ...]] = []
    rows = []
    for transition in table.transitions:
        first = len(nodes)
        _emit(transition.guard, table, nodes, comparisons)
        _check_size(transition, nodes[first:])
        time_out = -1 if transition.time_out_ticks is None else transition.time_out_ticks
        rows.append(
            (
                table.phase_index(transition.source),
                table.phase_index(transition.target),
                first,
                len(nodes),
                transition.debounce_ticks,
                time_out,
            )
        )
    return GuardProgram(
        transitions=np.array(rows, dtype=np.int64).reshape(-1, 6),
        nodes=np.array(nodes, dtype=np.int64).reshape(-1, 2),
        comparisons=np.array(comparisons, dtype=np.float64).reshape(-1, 5),
        minimum_ticks=np.array([item.minimum_ticks for item in table.phases.values()], dtype=np.int64),
    )


def _check_size(transition: Transition, nodes: list[tuple[int, int]]) -> None:
    """Refuse a guard whose results the evaluator cannot hold."""
    waiting = most = 0
    for operation, operand in nodes:
        waiting += 1 - (operand if operation in (OP_ALL, OP_ANY) else 0)
        most = max(most, waiting)
    if most > OPEN_RESULTS:
        raise GaitTableError(
            f"transition {transition.source} → {transition.target} ({transition.cause}): {most} conditions "
            f"wait to be joined; at most {OPEN_RESULTS} fit, so nest some of them"
        )


def _emit(
    guard: Guard, table: GaitTable, nodes: list[tuple[int, int]], comparisons: list[tuple[float, ...]]
) -> None:
    if isinstance(guard, Comparison):
        comparisons.append(_comparison_row(guard, table))
        nodes.append((OP_COMPARE, len(comparisons) - 1))
    elif isinstance(guard, PhaseMembership):
        mask = sum(1 << table.phase_index(phase) for phase in guard.phases)
        nodes.append((OP_PHASE, mask))
    else:
        for inner in guard.guards:
            _emit(inner, table, nodes, comparisons)
        nodes.append((OP_ALL if isinstance(guard, AllOf) else OP_ANY, len(guard.guards)))


def _comparison_row(guard: Comparison, table: GaitTable) -> tuple[float, ...]:
    names = all_signal_names(table.joints)
    sign = 1.0 if guard.operator == ">" else -1.0
    scale = signal_scale(guard.signal)
    minus = 0.0 if guard.minus is None else float(names.index(guard.minus))
    return (
        float(names.index(guard.signal)),
        sign,
        minus,
        0.0 if guard.minus is None else -sign,
        sign * guard.threshold * scale,
    )
