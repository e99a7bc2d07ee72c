"""The one evaluator of gait-table guards, and the rule that selects a transition.

A gait table is compiled (in :mod:`twin_gait.gait`) into a :class:`GuardProgram`; the state machine, the
compiled engine, replay and checks all evaluate it with these functions.
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
    """One node of a guard in postfix order."""

    operation: int  # Operation of the node, one of the ``OP_*``.
    # Index of the comparison for ``OP_COMPARE``, bit mask of phases of the other leg for ``OP_PHASE``, number
    # of results to combine for ``OP_ALL`` and ``OP_ANY``.
    operand: int


@dataclass(slots=True)
class CompiledComparison:
    """The inequality ``factor_a x[signal_a] + factor_b x[signal_b] > threshold`` of signals x in SI units."""

    signal_a: int  # Index of the first signal.
    signal_b: int  # Index of the second signal; not read while ``factor_b`` is 0.
    factor_a: float  # Factor of the first signal, 1 or -1.
    factor_b: float  # Factor of the second signal, 1 or -1; 0 for a single signal.
    threshold: float  # Threshold in the SI unit of the signals: [rad], [rad/s], [s], or 1 for a ratio.


@dataclass(slots=True)
class TransitionRule:
    """Conditions under which a phase is left for another."""

    source: int  # Index of the phase that is left.
    target: int  # Index of the phase that is entered.
    first_node: int  # First node of the guard.
    end_node: int  # Index after the last node of the guard.
    debounce_ticks: int  # Number of consecutive ticks of 1 [ms] for which the guard has to be true.
    timeout_ticks: int  # Number of ticks that the phase has to last; negative without a timeout.


@dataclass(slots=True)
class GuardProgram:
    """The transitions of a gait table with their guards."""

    n_transitions: int  # Number of transitions; entries of the list after them are unused.
    minimum_ticks: list[int]  # Minimum duration of each phase in ticks of 1 [ms], before it may be left.
    transitions: list[TransitionRule]  # Transitions in the order of the table, which is their priority.
    nodes: list[GuardNode]  # Nodes of all guards, each guard in postfix order.
    comparisons: list[CompiledComparison]  # Comparisons of all guards, at least one.


def evaluate_guard(
    program: GuardProgram, first: int, end: int, signals: Sequence[float], other_phase: int
) -> bool:
    """Evaluate a guard, nodes ``first`` to ``end`` - 1 of a program, for a set of measured signals.

    Intermediate results are bits of one integer that serves as the stack. A comparison with NaN is false, so
    a NaN never makes a guard true. Signals of this leg and the other are in SI units; ``other_phase`` is
    negative without another leg.
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
    does not move a conditional read out of a loop. The operand is an index only if the node is a comparison.
    """
    node = program.nodes[index]
    operation, operand = node.operation, node.operand
    comparison = program.comparisons[operand if operation == OP_COMPARE else 0]
    first, second = signals[comparison.signal_a], signals[comparison.signal_b]
    if operation == OP_COMPARE:
        return (results << 1) | is_above(comparison, first, second)
    if operation == OP_PHASE:
        return (results << 1) | is_in_mask(operand, other_phase)
    return combine_results(results, operation, operand)


def is_above(comparison: CompiledComparison, first: float, second: float) -> bool:
    """Check whether a comparison is true for its two signals; with NaN it is false."""
    value = comparison.factor_a * first
    if comparison.factor_b != 0.0:
        value += comparison.factor_b * second
    return value > comparison.threshold


def is_in_mask(phases: int, phase: int) -> bool:
    """Check whether a phase is in a bit mask of phases; a negative number is in none."""
    return phase >= 0 and (phases >> phase) & 1 == 1


def combine_results(results: int, operation: int, count: int) -> int:
    """Combine the last ``count`` results of the stack into one; each is a bit, the last one lowest."""
    mask = (1 << count) - 1
    found = results & mask
    true = found == mask if operation == OP_ALL else found != 0
    return ((results >> count) << 1) | true


def min_transition_ticks(program: GuardProgram, index: int) -> int:
    """Return the minimum ticks before a transition is taken: the larger of minimum duration and timeout."""
    rule = program.transitions[index]
    return max(rule.timeout_ticks, program.minimum_ticks[rule.source])


def is_transition_due(open_ticks: int, debounce_ticks: int, ticks_in_phase: int, least_ticks: int) -> bool:
    """Check whether a transition with a true guard may be taken.

    ``open_ticks``: consecutive ticks with a true guard, this one included.
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
    """Return the index of the transition that a leg takes in this tick, or ``NO_TRANSITION``.

    Every exit of the phase is evaluated, so that its debounce counter (consecutive ticks with a true guard)
    is right; the first listed transition that is due is taken. A transition with both a guard and a timeout
    needs both.

    ``ticks_in_phase``: 0 in the tick of entry. ``signals`` and ``other_phase`` (at the start of the tick): as
    in :func:`evaluate_guard`. ``debounce``: counters of this leg, one for each transition; changed in place.
    """
    chosen, transitions = NO_TRANSITION, program.n_transitions
    for index in range(transitions):
        rule = program.transitions[index]
        first, end = rule.first_node, rule.end_node
        is_open = rule.source == phase and evaluate_guard(program, first, end, signals, other_phase)
        chosen = update_debounce(program, index, is_open, ticks_in_phase, debounce, chosen)
    return chosen


def update_debounce(
    program: GuardProgram, index: int, is_open: bool, ticks_in_phase: int, debounce: list[int], chosen: int
) -> int:
    """Count the consecutive ticks for which the guard of a transition has been true, in ``debounce``.

    Returns this transition if it is the first one that is due, else ``chosen``.
    """
    debounce_ticks, least_ticks = (
        program.transitions[index].debounce_ticks,
        min_transition_ticks(program, index),
    )
    open_ticks = debounce[index] + 1 if is_open else 0
    debounce[index] = open_ticks
    due = is_open and is_transition_due(open_ticks, debounce_ticks, ticks_in_phase, least_ticks)
    return index if due and chosen == NO_TRANSITION else chosen
