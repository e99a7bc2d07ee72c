"""The one evaluator of gait-table guards, and the rule that picks a transition.

A gait table is compiled (in :mod:`twin_gait.gait`) into a :class:`GuardProgram`; the state machine, the
compiled engine, replay and checks all read it through these functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

OP_COMPARE = 0
OP_PHASE = 1
OP_ALL = 2
OP_ANY = 3

NO_TRANSITION = -1


@dataclass(slots=True)
class GuardNode:
    """One step of a guard in postfix order."""

    operation: int  # What to do, one of the ``OP_*``.
    # For ``OP_COMPARE`` the index of the comparison, for ``OP_PHASE`` a bit mask of phases of the other leg,
    # for ``OP_ALL`` and ``OP_ANY`` the number of results to join.
    operand: int


@dataclass(slots=True)
class Comparison:
    """True while ``factor_a x[signal_a] + factor_b x[signal_b] > threshold``, signals x in SI units."""

    signal_a: int  # Index of the first signal.
    signal_b: int  # Index of the second signal; not read while ``factor_b`` is 0.
    factor_a: float  # Of the first signal, 1 or -1.
    factor_b: float  # Of the second signal, 1 or -1; 0 for a single signal.
    threshold: float  # In the SI unit of the signals: [rad], [rad] / [s], [s], or 1 for a ratio.


@dataclass(slots=True)
class TransitionRule:
    """When a phase is left for another."""

    source: int  # Index of the phase that is left.
    target: int  # Index of the phase that is entered.
    first_node: int  # First node of the guard.
    end_node: int  # One past its last node.
    debounce_ticks: int  # The guard has to be open for so many consecutive ticks of 1 [ms].
    time_out_ticks: int  # The phase has to last for so many ticks; negative without a time-out.


@dataclass(slots=True)
class GuardProgram:
    """The transitions of a gait table with their guards."""

    n_transitions: int  # Number of transitions; a list may go on with entries that mean nothing.
    minimum_ticks: list[int]  # A phase is not left before so many ticks of 1 [ms], one for each phase.
    transitions: list[TransitionRule]  # In the order of the table, which is their priority.
    nodes: list[GuardNode]  # Of all guards, each in postfix order.
    comparisons: list[Comparison]  # Of all guards, at least one.


def guard_holds(
    program: GuardProgram, first: int, end: int, signals: Sequence[float], other_phase: int
) -> bool:
    """Whether a guard is true for a set of measured signals: nodes ``first`` to ``end`` - 1 of a program.

    Intermediate results are bits of one integer that serves as the stack. A comparison with NaN is false, so
    a NaN never opens a guard. Signals of this leg and the other are in SI units; ``other_phase`` is negative
    without another leg.
    """
    results = 0
    for index in range(first, end):
        results = evaluate_node(program, index, signals, other_phase, results)
    return (results & 1) == 1


def evaluate_node(
    program: GuardProgram, index: int, signals: Sequence[float], other_phase: int, results: int
) -> int:
    """Evaluate one node of a guard on the stack ``results``, and return the new stack.

    Fields of the program are read before any branch: in lanes they are the same for all episodes, and LLVM
    moves no conditional read out of a loop. The operand of a node that is no comparison is no index.
    """
    node = program.nodes[index]
    operation, operand = node.operation, node.operand
    comparison = program.comparisons[operand if operation == OP_COMPARE else 0]
    first, second = signals[comparison.signal_a], signals[comparison.signal_b]
    if operation == OP_COMPARE:
        return (results << 1) | is_above(comparison, first, second)
    if operation == OP_PHASE:
        return (results << 1) | is_among(operand, other_phase)
    return joined(results, operation, operand)


def is_above(comparison: Comparison, first: float, second: float) -> bool:
    """Whether a comparison is true for its two signals; with NaN it is not."""
    value = comparison.factor_a * first
    if comparison.factor_b != 0.0:
        value += comparison.factor_b * second
    return value > comparison.threshold


def is_among(phases: int, phase: int) -> bool:
    """Whether a phase is one of those of a bit mask; a negative number is none."""
    return phase >= 0 and (phases >> phase) & 1 == 1


def joined(results: int, operation: int, count: int) -> int:
    """Results, a bit each and the last one lowest, with the last ``count`` of them joined to one."""
    mask = (1 << count) - 1
    found = results & mask
    true = found == mask if operation == OP_ALL else found != 0
    return ((results >> count) << 1) | true


def least_ticks_of(program: GuardProgram, index: int) -> int:
    """Ticks that the phase lasts at least before a transition leaves it: of the phase, and of a time-out."""
    rule = program.transitions[index]
    return max(rule.time_out_ticks, program.minimum_ticks[rule.source])


def is_due(open_ticks: int, debounce_ticks: int, ticks_in_phase: int, least_ticks: int) -> bool:
    """Whether a transition with an open guard may be taken.

    ``open_ticks``: consecutive ticks with an open guard, this one included.
    """
    return open_ticks >= debounce_ticks and ticks_in_phase >= least_ticks


def next_transition(
    program: GuardProgram,
    phase: int,
    ticks_in_phase: int,
    signals: Sequence[float],
    other_phase: int,
    debounce: list[int],
) -> int:
    """Index of the transition that a leg takes in this tick, or ``NO_TRANSITION``; debounces are counted.

    Every exit of the phase is evaluated, so that its debounce counter (consecutive ticks with an open guard)
    is right; the first listed one that is due wins. A transition with both a guard and a time-out needs both.

    ``ticks_in_phase``: 0 in the tick of entry. ``signals`` and ``other_phase`` (at the start of the tick): as
    in :func:`guard_holds`. ``debounce``: counters of this leg, one for each transition; changed in place.
    """
    chosen, transitions = NO_TRANSITION, program.n_transitions
    for index in range(transitions):
        rule = program.transitions[index]
        first, end = rule.first_node, rule.end_node
        is_open = rule.source == phase and guard_holds(program, first, end, signals, other_phase)
        chosen = count_open_ticks(program, index, is_open, ticks_in_phase, debounce, chosen)
    return chosen


def count_open_ticks(
    program: GuardProgram, index: int, is_open: bool, ticks_in_phase: int, debounce: list[int], chosen: int
) -> int:
    """Count the ticks for which the guard of a transition has been open, in ``debounce``.

    Returns this transition if it is the first one that is due, else ``chosen``.
    """
    debounce_ticks, least_ticks = program.transitions[index].debounce_ticks, least_ticks_of(program, index)
    open_ticks = debounce[index] + 1 if is_open else 0
    debounce[index] = open_ticks
    due = is_open and is_due(open_ticks, debounce_ticks, ticks_in_phase, least_ticks)
    return index if due and chosen == NO_TRANSITION else chosen
