"""Quality of the tests of a table: the mutants of its machine that they detect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from kit_equivalence import reason
from kit_mutants import Mutant, mutants

from twin_gait.gait.table import GaitTable
from twin_gait.testing.cases import MachineFactory, TransitionTest, machine_of, transition_tests


@dataclass(frozen=True)
class MutationResult:
    """Results for the mutants of one table.

    Attributes:
        table: Name of the table.
        tests: Number of tests of the kit.
        made: Number of mutants per kind.
        caught: Number of mutants per kind that a test detected.
        equivalent: Mutants that no test detected, each with the proved reason.
        missed: Mutants that no test detected and that are not proved equivalent.
    """

    table: str
    tests: int
    made: Counter[str]
    caught: Counter[str]
    equivalent: tuple[tuple[Mutant, str], ...]
    missed: tuple[Mutant, ...]


def measure(table: GaitTable, progress: Callable[[int], None] | None = None) -> MutationResult:
    """Run the tests of the unchanged table on a machine with each single mutation.

    Args:
        table: The gait table.
        progress: Called with the number of mutants done.

    Returns:
        The counts, and the mutants that no test detected.
    """
    tests = transition_tests(table)
    made, caught = Counter[str](), Counter[str]()
    equivalent, missed = [], []
    for done, mutant in enumerate(mutants(table), start=1):
        made[mutant.kind] += 1
        why = None
        if is_caught(mutant, tests):
            caught[mutant.kind] += 1
        elif (why := reason(table, mutant)) is not None:
            equivalent.append((mutant, why))
        else:
            missed.append(mutant)
        if progress is not None:
            progress(done)
    return MutationResult(table.name, len(tests), made, caught, tuple(equivalent), tuple(missed))


def is_caught(mutant: Mutant, tests: Iterable[TransitionTest], machine: MachineFactory | None = None) -> bool:
    """Return whether a test fails on the machine of a mutant.

    Args:
        mutant: The mutant.
        tests: Tests of the unchanged table.
        machine: Machine that follows the mutant; None for that of the package.

    Returns:
        True at the first test that fails; tests of the changed phase, and short tests, run first.
    """
    machine = machine or machine_of(mutant.table)
    for test in sorted(tests, key=lambda item: (item.scenario.phase != mutant.phase, kit_ticks(item))):
        try:
            replace(test, machine=machine).run()
        except AssertionError:
            return True
    return False


def kit_ticks(test: TransitionTest) -> int:
    """Estimate the number of ticks of a test."""
    again = 17 * len(test.table.joints) if test.scenario.refuses else 1
    return again * len(test.scenario.steps)


def mutation_table(results: Iterable[MutationResult]) -> str:
    """Write results as Markdown.

    Args:
        results: One per gait table.

    Returns:
        Counts per table and kind, then the equivalent mutants with their reasons.
    """
    results = list(results)
    kinds = list(dict.fromkeys(kind for item in results for kind in item.made))
    head = [
        "| caught of made | " + " | ".join(item.table for item in results) + " |",
        "|" + "---|" * (len(results) + 1),
    ]
    rows = [_row(kind, [(item.caught[kind], item.made[kind]) for item in results]) for kind in kinds]
    total = _row("all", [(item.caught.total(), item.made.total()) for item in results])
    equivalent = _row("equivalent", [(len(item.equivalent), None) for item in results])
    missed = _row("missed", [(len(item.missed), None) for item in results])
    tests = _row("tests", [(item.tests, None) for item in results])
    lines = [*head, *rows, total, equivalent, missed, tests, "", *_reasons(results)]
    return "\n".join(lines) + "\n"


def _row(name: str, counts: list[tuple[int, int | None]]) -> str:
    cells = [
        f"{caught}" if made is None else f"{caught} of {made}" if made else "–" for caught, made in counts
    ]
    return f"| {name} | " + " | ".join(cells) + " |"


def _reasons(results: list[MutationResult]) -> list[str]:
    lines = ["<details><summary>Equivalent mutants, each with the reason that was proved</summary>", ""]
    for item in results:
        lines += [f"- {item.table}: {mutant.text} – {why}" for mutant, why in item.equivalent]
    return [*lines, "", "</details>"]
