"""Every single mutation of a machine, while the kit reads the table as it is.

``PYTHONPATH=tests python tests/testing/test_testing_kit_mutations.py`` writes the counts into
``docs/reference/test_kit.md``, and their sums over the tables into a file that ``docs/insert.py`` quotes; a
test here fails when they are no longer true.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest
from firmware_tools import require_tools
from kit_equivalence import reason
from kit_measure import MutationResult, is_caught, measure, mutation_table
from kit_mutants import mutants
from test_testing_kit import rich_table

from twin_gait.configuration.gait_table_file import load_gait_table, packaged_gait_tables
from twin_gait.files import write_atomically
from twin_gait.testing.cases import transition_tests
from twin_gait.testing.compiled import compiled_machines

pytestmark = pytest.mark.slow  # it grades the kit, not a table

DOCUMENT = Path(__file__).parents[2] / "docs" / "reference" / "test_kit.md"
SUMS = Path(__file__).parents[2] / "examples" / "results" / "test_kit" / "results.json"
BEGIN, END = "<!-- mutations: begin -->\n", "<!-- mutations: end -->\n"
TABLES = packaged_gait_tables()


# Neither caught nor proved, by table, with the reason why each is lived with.
WHOLE_TICKS = "times in phases are whole ticks: they never differ by half a tick"
NO_OTHER_LEG = "no exit of that phase reads the other leg, which the kit leaves where this guard is closed"
LONGER = "time_in_phase_s - other.time_in_phase_s > 0.0005 not strict"
FIRST, OTHERS = "stand→swing_flexion (first_step):", "stand→middle_stance (other_steps):"
LIVED_WITH = {
    "treadmill_start_stop": {
        f"stand→first_swing (first_step): {LONGER}": WHOLE_TICKS,
        "swing_flexion→swing_extension (short_step): leaves middle_stance too": (
            "halt, due one tick later, leads out of the phase in any case"
        ),
    },
    "overground": {
        f"{FIRST} {LONGER}": WHOLE_TICKS,
        f"{FIRST} other.time_in_phase_s - time_in_phase_s < 0.0005 not strict": WHOLE_TICKS,
        f"{FIRST} time_in_phase_s > 2 reads other.time_in_phase_s for time_in_phase_s": (
            "both legs have stood equally long where the kit tests it"
        ),
        f"{FIRST} leaves closing_swing_flexion too": NO_OTHER_LEG,
        f"{OTHERS} leaves closing_swing_flexion too": NO_OTHER_LEG,
        f"{OTHERS} leaves swing_flexion too": NO_OTHER_LEG,
    },
}


@cache
def result(name: str) -> MutationResult:
    return measure(load_gait_table(name))


@pytest.mark.parametrize("name", TABLES)
def test_every_mutant_is_caught_or_proved_equivalent(name: str) -> None:
    found = result(name)
    print(mutation_table([found]))  # pytest -rP shows it
    missed = {mutant.text for mutant in found.missed}
    assert missed == set(LIVED_WITH.get(name, ()))
    assert found.made.total() == found.caught.total() + len(found.equivalent) + len(missed)
    assert found.caught.total() > 0


@pytest.mark.parametrize("name", TABLES)
def test_every_mutant_that_is_caught_in_python_is_caught_in_c(name: str) -> None:
    """Each one is printed as for the device, its thresholds as literals."""
    require_tools("gcc")
    table = load_gait_table(name)
    lived_with = {
        item.text for item in (*result(name).missed, *(item for item, _ in result(name).equivalent))
    }
    caught = [mutant for mutant in mutants(table) if mutant.text not in lived_with]
    assert len(caught) == result(name).caught.total()
    tests = transition_tests(table)
    machines = compiled_machines([mutant.table for mutant in caught])
    pairs = zip(caught, machines, strict=True)
    assert [mutant.text for mutant, machine in pairs if not is_caught(mutant, tests, machine)] == []


@pytest.mark.parametrize("name", TABLES)
def test_equivalent_mutants_are_few_and_of_the_kinds_that_can_be(name: str) -> None:
    """A list of one, a zero in another unit, a debounce before a timeout, a second timeout below another.

    Also two exits in each other's place that are never due together.
    """
    kinds = {mutant.kind for mutant, _ in result(name).equivalent}
    assert kinds <= {"all↔any", "unit", "debounce", "source", "order"}
    assert len(result(name).equivalent) < 0.1 * result(name).made.total()


def test_no_mutant_that_is_caught_is_proved_equivalent() -> None:
    """The proofs against the machine: whoever is noticed behaves differently."""
    table = rich_table()
    tests = transition_tests(table)
    proved = [mutant for mutant in mutants(table) if reason(table, mutant) is not None]
    assert proved
    assert [mutant.text for mutant in proved if is_caught(mutant, tests)] == []


def test_every_kind_of_mutation_is_made_and_caught_on_a_table_that_has_everything() -> None:
    found = measure(rich_table())
    print(mutation_table([found]))
    kinds = (
        "all↔any condition comparison threshold unit signal membership debounce timeout source target order"
    )
    assert set(found.made) == {*kinds.split(), "minimum duration"}
    assert found.missed == ()
    assert all(found.caught[kind] > 0 for kind in found.made)


def test_mutants_differ_from_each_other() -> None:
    texts = [item.text for item in mutants(rich_table())]
    assert len(set(texts)) == len(texts)


def documented(text: str) -> str:
    return text.split(BEGIN)[1].split(END)[0]


def test_documented_counts_are_the_measured_ones() -> None:
    hint = "PYTHONPATH=tests python tests/testing/test_testing_kit_mutations.py writes them"
    assert documented(DOCUMENT.read_text(encoding="utf-8")) == mutation_table(map(result, TABLES)), hint


def sums() -> str:
    """Return the counts of all shipped tables together, as JSON."""
    results = [result(name) for name in TABLES]
    counts = {
        "made": sum(item.made.total() for item in results),
        "caught": sum(item.caught.total() for item in results),
        "equivalent": sum(len(item.equivalent) for item in results),
        "missed": sum(len(item.missed) for item in results),
    }
    return json.dumps({"quick": False, "tables": len(results), **counts}, indent=1) + "\n"


def test_quoted_sums_are_the_measured_ones() -> None:
    assert SUMS.read_text(encoding="utf-8") == sums()


if __name__ == "__main__":
    SUMS.parent.mkdir(exist_ok=True)
    write_atomically(SUMS, sums())
    page = DOCUMENT.read_text(encoding="utf-8")
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    write_atomically(DOCUMENT, before + BEGIN + mutation_table(map(result, TABLES)) + END + after)
