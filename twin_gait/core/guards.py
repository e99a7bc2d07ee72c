"""The one evaluator of gait-table guards, and the rule that picks a transition.

A gait table is compiled (in :mod:`twin_gait.gait`) into plain arrays, the *guard program*; the
state machine, the compiled engine, replay and checks all read it through these functions.

Arrays of a program:

``nodes``, shape ``(n_nodes, 2)``, integers
    Guards in postfix order: operation (``OP_*``) and operand. ``OP_COMPARE`` takes a row of the
    comparisons, ``OP_PHASE`` a bit mask of phases of the other leg, ``OP_ALL`` and ``OP_ANY`` the
    number of results to join.
``comparisons``, shape ``(n_comparisons, 5)``
    ``signal_a, factor_a, signal_b, factor_b, threshold``: true while
    ``factor_a x[a] + factor_b x[b] > threshold``. ``factor_b`` is 0 for a single signal.
``transitions``, shape ``(n_transitions, 6)``, integers
    ``source, target, first_node, end_node, debounce_ticks, time_out_ticks`` in the order of the table;
    ``time_out_ticks`` is negative for a transition without a time-out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

OP_COMPARE = 0
OP_PHASE = 1
OP_ALL = 2
OP_ANY = 3

SOURCE, TARGET, FIRST_NODE, END_NODE, DEBOUNCE_TICKS, TIME_OUT_TICKS = range(6)

NO_TRANSITION = -1


def guard_holds(
    nodes: np.ndarray[Any, np.dtype[np.int64]],
    first: int,
    end: int,
    comparisons: np.ndarray[Any, np.dtype[np.float64]],
    signals: np.ndarray[Any, np.dtype[np.float64]],
    other_phase: int,
) -> bool:
    """Whether a guard is true for a set of measured signals.

    Intermediate results are bits of one integer that serves as the stack. A comparison with NaN is
    false, so a NaN never opens a guard.

    Args:
        nodes: Guard program, shape ``(n_nodes, 2)``.
        first: First node of the guard.
        end: One past its last node.
        comparisons: Comparison rows, shape ``(n_comparisons, 5)``.
        signals: Signals of this leg and the other in SI units, shape ``(n_signals,)``.
        other_phase: Index of the phase of the other leg, or a negative number without one.

    Returns:
        True if the guard is open.
    """
    stack = 0
    for node in range(first, end):
        operation = nodes[node, 0]
        operand = nodes[node, 1]
        if operation == OP_COMPARE:
            value = comparisons[operand, 1] * signals[int(comparisons[operand, 0])]
            if comparisons[operand, 3] != 0.0:
                value += comparisons[operand, 3] * signals[int(comparisons[operand, 2])]
            result = 1 if value > comparisons[operand, 4] else 0
        elif operation == OP_PHASE:
            result = (operand >> other_phase) & 1 if other_phase >= 0 else 0
        else:
            mask = (1 << operand) - 1
            joined = stack & mask
            stack = stack >> operand
            if operation == OP_ALL:
                result = 1 if joined == mask else 0
            else:
                result = 1 if joined != 0 else 0
        stack = (stack << 1) | result
    return (stack & 1) == 1


def next_transition(
    phase: int,
    ticks_in_phase: int,
    minimum_ticks: int,
    transitions: np.ndarray[Any, np.dtype[np.int64]],
    nodes: np.ndarray[Any, np.dtype[np.int64]],
    comparisons: np.ndarray[Any, np.dtype[np.float64]],
    signals: np.ndarray[Any, np.dtype[np.float64]],
    other_phase: int,
    debounce: np.ndarray[Any, np.dtype[np.int64]],
    first_debounce: int = 0,
) -> int:
    """Pick the transition that a leg takes in this tick, and count the debounce of all its exits.

    Every exit of the phase is evaluated, so that its debounce counter (consecutive ticks with an open
    guard) is right; the first listed one that is due wins. A transition with both a guard and a
    time-out needs both.

    Args:
        phase: Index of the present phase.
        ticks_in_phase: Ticks since it was entered (0 in the tick of entry).
        minimum_ticks: The phase cannot be left before so many ticks.
        transitions: Shape ``(n_transitions, 6)``.
        nodes: Guard program, shape ``(n_nodes, 2)``.
        comparisons: Comparison rows, shape ``(n_comparisons, 5)``.
        signals: Signals of this leg and the other in SI units.
        other_phase: Index of the phase of the other leg at the start of the tick.
        debounce: Counters, one per transition; changed in place.
        first_debounce: Where the counters of this leg begin.

    Returns:
        Index of the transition, or ``NO_TRANSITION``.
    """
    chosen = NO_TRANSITION
    for index in range(transitions.shape[0]):
        if transitions[index, SOURCE] != phase:
            debounce[first_debounce + index] = 0
            continue
        if not guard_holds(
            nodes,
            transitions[index, FIRST_NODE],
            transitions[index, END_NODE],
            comparisons,
            signals,
            other_phase,
        ):
            debounce[first_debounce + index] = 0
            continue
        debounce[first_debounce + index] += 1
        if (
            chosen == NO_TRANSITION
            and debounce[first_debounce + index] >= transitions[index, DEBOUNCE_TICKS]
            and ticks_in_phase >= transitions[index, TIME_OUT_TICKS]
            and ticks_in_phase >= minimum_ticks
        ):
            chosen = index
    return chosen
