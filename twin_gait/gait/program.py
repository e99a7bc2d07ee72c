"""Compile a gait table into the program that the core evaluates."""

from collections.abc import Sequence

from twin_gait.core import guards
from twin_gait.exceptions import GaitTableError
from twin_gait.gait.guards import AllOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.signals import signal_scale
from twin_gait.gait.table import StateTable, Transition

OPEN_RESULTS = 62  # results that wait to be joined are bits of a signed 64-bit integer
DEVICE_BITS = 30  # of an int32_t, so that all of them may be shifted once more


def compile_guards(table: StateTable) -> guards.GuardProgram:
    """Compile the transitions of a table of gait or of modes, thresholds in SI units."""
    nodes: list[guards.GuardNode] = []
    comparisons: list[guards.Comparison] = []
    rules = []
    for transition in table.transitions:
        first = len(nodes)
        _emit(transition.guard, table, nodes, comparisons)
        _check_size(transition, nodes[first:])
        rules.append(
            guards.TransitionRule(
                source=table.phase_index(transition.source),
                target=table.phase_index(transition.target),
                first_node=first,
                end_node=len(nodes),
                debounce_ticks=transition.debounce_ticks,
                time_out_ticks=-1 if transition.time_out_ticks is None else transition.time_out_ticks,
            )
        )
    minimum_ticks = [item.minimum_ticks for item in table.phases.values()]
    return guards.GuardProgram(len(rules), minimum_ticks, rules, nodes, comparisons)


def guard_is_open(guard: Guard, table: StateTable, signals: Sequence[float], member: int) -> bool:
    """Whether a guard by itself is true, by the evaluator of programs.

    ``signals``: in SI, in the order of the table. ``member``: place among its members, negative for none.
    """
    nodes: list[guards.GuardNode] = []
    comparisons: list[guards.Comparison] = []
    _emit(guard, table, nodes, comparisons)
    return guards.guard_holds(
        guards.GuardProgram(0, [], [], nodes, comparisons), 0, len(nodes), signals, member
    )


def _check_size(transition: Transition, nodes: list[guards.GuardNode], bits: int = OPEN_RESULTS) -> None:
    """Refuse a guard whose results the evaluator cannot hold."""
    waiting = most = 0
    for node in nodes:
        waiting += 1 - (node.operand if node.operation in (guards.OP_ALL, guards.OP_ANY) else 0)
        most = max(most, waiting)
    if most > bits:
        raise GaitTableError(
            f"transition {transition.source} → {transition.target} ({transition.cause}): {most} conditions "
            f"wait to be joined; at most {bits} fit, so nest some of them"
        )


def require_bits(table: StateTable, program: guards.GuardProgram, bits: int = DEVICE_BITS) -> None:
    """Refuse, by a GaitTableError, a table with more phases or waiting results than there are bits."""
    if len(table.members) > bits:
        raise GaitTableError(f"{len(table.members)} {table.words.member}s; at most {bits} fit")
    for transition, rule in zip(table.transitions, program.transitions, strict=True):
        _check_size(transition, program.nodes[rule.first_node : rule.end_node], bits)


def _emit(
    guard: Guard, table: StateTable, nodes: list[guards.GuardNode], comparisons: list[guards.Comparison]
) -> None:
    if isinstance(guard, Comparison):
        comparisons.append(_comparison(guard, table))
        nodes.append(guards.GuardNode(guards.OP_COMPARE, len(comparisons) - 1))
    elif isinstance(guard, PhaseMembership):
        mask = sum(1 << table.members.index(name) for name in guard.phases)
        nodes.append(guards.GuardNode(guards.OP_PHASE, mask))
    else:
        for inner in guard.guards:
            _emit(inner, table, nodes, comparisons)
        nodes.append(
            guards.GuardNode(guards.OP_ALL if isinstance(guard, AllOf) else guards.OP_ANY, len(guard.guards))
        )


def _comparison(guard: Comparison, table: StateTable) -> guards.Comparison:
    names = table.signals
    sign = 1.0 if guard.operator == ">" else -1.0
    return guards.Comparison(
        signal_a=names.index(guard.signal),
        signal_b=0 if guard.minus is None else names.index(guard.minus),
        factor_a=sign,
        factor_b=0.0 if guard.minus is None else -sign,
        threshold=sign * guard.threshold * signal_scale(guard.signal),
    )
