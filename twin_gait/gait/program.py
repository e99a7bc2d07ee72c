"""Compilation of a gait table into the program that the core evaluates."""

from twin_gait.core import guards
from twin_gait.gait.guards import AllOf, AnyOf, Comparison, Guard, PhaseMembership
from twin_gait.gait.signals import signal_scale
from twin_gait.gait.table import MAX_PHASES, StateTable, raise_if

# Phases, and results that wait to be combined, are bits of an integer: a signed one of 64 bits in an engine,
# an int32_t in the device, where all of them may be shifted once more.
ENGINE_BITS, DEVICE_BITS = MAX_PHASES, 30


def compile_guards(table: StateTable, bits: int = ENGINE_BITS) -> guards.GuardProgram:
    """Compile the transitions of a table of gait or of modes, thresholds in SI units.

    ``bits``: number of bits of the integers that hold phases and results. Raises GaitTableError if the table
    or a guard is too large for them.
    """
    _require_fit(table, bits)
    nodes: list[guards.GuardNode] = []
    comparisons: list[guards.CompiledComparison] = []
    rules = []
    for transition in table.transitions:
        first = len(nodes)
        _emit(transition.guard, table, nodes, comparisons)
        rules.append(
            guards.TransitionRule(
                source=table.phase_index(transition.source),
                target=table.phase_index(transition.target),
                first_node=first,
                end_node=len(nodes),
                debounce_ticks=transition.debounce_ticks,
                timeout_ticks=-1 if transition.timeout_ticks is None else transition.timeout_ticks,
            )
        )
    minimum_ticks = [item.minimum_ticks for item in table.phases.values()]
    if not comparisons:  # The evaluator reads a comparison for every node.
        comparisons.append(guards.CompiledComparison(0, 0, 0.0, 0.0, 0.0))
    return guards.GuardProgram(len(rules), minimum_ticks, rules, nodes, comparisons)


def _require_fit(table: StateTable, bits: int) -> None:
    raise_if(
        len(table.members) > bits, f"{len(table.members)} {table.vocabulary.member}s; expected at most {bits}"
    )
    for item in table.transitions:
        if len(item.atoms) <= bits:  # A guard has at most as many waiting results as conditions.
            continue
        name, waiting = f"{item.source} → {item.target} ({item.cause})", _waiting(item.guard)
        too_many = f"{waiting} results must be stored at once; expected at most {bits}; nest some conditions"
        raise_if(waiting > bits, f"transition {name}: {too_many}")


def _waiting(guard: Guard) -> int:
    """Return the largest number of results of a guard that wait at once to be combined.

    It is the largest sum of the results before a part of the guard and those that wait within it.
    """
    parts = guard.guards if isinstance(guard, (AllOf, AnyOf)) else ()
    return max((before + _waiting(part) for before, part in enumerate(parts)), default=1)


def _emit(
    guard: Guard,
    table: StateTable,
    nodes: list[guards.GuardNode],
    comparisons: list[guards.CompiledComparison],
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


def _comparison(guard: Comparison, table: StateTable) -> guards.CompiledComparison:
    names = table.signals
    sign = 1.0 if guard.operator == ">" else -1.0
    return guards.CompiledComparison(
        signal_a=names.index(guard.signal),
        signal_b=0 if guard.minus is None else names.index(guard.minus),
        factor_a=sign,
        factor_b=0.0 if guard.minus is None else -sign,
        threshold=sign * guard.threshold * signal_scale(guard.signal),
    )
