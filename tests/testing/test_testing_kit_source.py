"""Single mutations of the source of the state machine itself, driven by the tests of one table.

Where :mod:`test_testing_kit_mutations` changes what the machine reads, here its Python is changed: an
operator, a constant, a statement at a time, in the evaluator, the compiler of guards and the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from kit_measure import kit_ticks
from source_mutants import source_mutants
from test_testing_kit import rich_table

from twin_gait.core import guards
from twin_gait.gait import machine, program
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.testing.cases import transition_tests
from twin_gait.vocabulary import Side

pytestmark = pytest.mark.slow  # it grades the kit, not a table

# What no test can notice: a part of the mutant's text, and why it behaves the same.
EQUIVALENT = {
    "results = 0: 0 → 1": "a bit below all results is never joined",
    "timeout_ticks=-1": "no timeout is any tick that every leg has stayed for: -2, -1 or 1",
    "sign = 1.0 if": "both sides of the inequality are doubled",
    "signal_b=0 if": "the place of a second signal whose factor is zero",
    "strict=True": "the lengths were compared before",
    "self.phase: str = table.phase_names[0]": "the kit always names the phase",
    "self.owner = ": "a word in messages",
    "auto_transitions=False": "triggers that are never called",
}


def evaluator() -> Iterator[tuple[str, Callable[[str], Any]]]:
    for text, names in source_mutants(guards, {"evaluate_guard", "next_transition"}):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(machine, "next_transition", names["next_transition"])
            yield text, lambda phase: GaitStateMachine(rich_table(), Side.LEFT, initial_phase=phase)


def compiler() -> Iterator[tuple[str, Callable[[str], Any]]]:
    for text, names in source_mutants(program, {"compile_guards", "_emit", "_comparison"}):
        compiled = names["compile_guards"]

        def build(phase: str, compiled: Callable[..., Any] = compiled) -> GaitStateMachine:
            table = rich_table()
            return GaitStateMachine(table, Side.LEFT, initial_phase=phase, program=compiled(table))

        yield text, build


def state_machine() -> Iterator[tuple[str, Callable[[str], Any]]]:
    functions = {"__init__", "time_in_phase", "step", "advance", "_require_finite"}
    for text, names in source_mutants(machine, functions):
        changed = names["GaitStateMachine"]
        yield text, lambda phase, changed=changed: changed(rich_table(), Side.LEFT, initial_phase=phase)


@pytest.mark.parametrize("part", [evaluator, compiler, state_machine])
def test_every_mutant_of_the_source_is_caught_or_known_to_be_equivalent(part: Callable[[], Any]) -> None:
    tests = sorted(transition_tests(rich_table()), key=kit_ticks)
    made, explained, survived = 0, [], []
    for text, build in part():
        made += 1
        if _is_caught(tests, build):
            continue
        why = next((reason for fragment, reason in EQUIVALENT.items() if fragment in text), None)
        (survived if why is None else explained).append(f"{text} – {why}")
    print(
        f"{part.__name__}: {made - len(explained) - len(survived)} of {made} caught", *explained, sep="\n- "
    )
    assert survived == []
    assert len(explained) < 0.25 * made


def _is_caught(tests: list[Any], build: Callable[[str], Any]) -> bool:
    """A mutant is caught by a test that fails, and by its own crash."""
    for test in tests:
        try:
            replace(test, machine=build).run()
        except Exception:
            return True
    return False


def test_source_as_it_is_passes() -> None:
    assert not _is_caught(
        transition_tests(rich_table()),
        lambda phase: GaitStateMachine(rich_table(), Side.LEFT, initial_phase=phase),
    )
