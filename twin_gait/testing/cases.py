"""The tests of a gait table: every transition at every threshold, in time, and in priority; an approved text.

The tests follow the table, so they cannot notice that the table itself was edited; the text, kept in git and
approved by a person, can.
"""

import difflib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from twin_gait.gait.documents import transition_table, truth_table
from twin_gait.gait.table import StateTable
from twin_gait.testing import edges, timing
from twin_gait.testing.driver import MachineFactory, machine_of, play, refuse
from twin_gait.testing.exits import Exit, Scenario, decisive

Check = Callable[[MachineFactory], None]


@dataclass(frozen=True)
class TransitionTest:
    """One test of a machine against one entry of a gait table."""

    # transition and what is shown, for example ``late_stance→swing_flexion (trailing_limb)::holds just below
    # hip.angle_deg < -2.8``
    name: str
    phase: str  # phase in which it starts
    machine: MachineFactory  # builds the machine under test
    check: Check | None  # drives a machine and raises AssertionError; None if no measurements can show it
    ticks: int = 0  # about how many ticks it drives a machine through

    @property
    def undecided(self) -> str | None:
        """Why there is nothing to drive, or None for a test that runs."""
        if self.check is not None:
            return None
        return (
            "no measurements make this decide: it is implied by other conditions, the exit is shadowed, or "
            "the guards leave too many choices to try"
        )

    def run(self) -> None:
        """Drive the machine, unless :attr:`undecided`; AssertionError if it does not as the table says."""
        if self.check is not None:
            self.check(self.machine)


def transition_tests(table: StateTable, machine: MachineFactory | None = None) -> list[TransitionTest]:
    """Write the tests of a gait table.

    For every transition: fires just past each threshold and holds just below and on it, each condition
    of ``all`` and ``any`` by itself, debounce, minimum duration, time-out, priority, the clock
    of the next phase, bad measurements refused. What is expected is worked out from the table alone.

    ``table``: of gait or of modes. ``machine``: builds the machine under test in a phase that it has entered
    at tick 0; the package's own machine for this table if None. Returns the tests, each with a name of its
    own, in the order of the table.
    """
    factory = machine_of(table) if machine is None else machine
    tests: dict[str, TransitionTest] = {}
    for index in range(len(table.transitions)):
        leave = Exit(table, index)
        title = f"{leave.item.source}→{leave.item.target} ({leave.item.cause})"
        for what, check, ticks in _checks(leave):
            name, number = f"{title}::{what}", 1
            while name in tests:
                number += 1
                name = f"{title}::{what} [{number}]"
            tests[name] = TransitionTest(name, leave.phase, factory, check, ticks)
    return list(tests.values())


Shown = tuple[str, Check | None, int]  # what a test shows, what it does, ticks


def _checks(leave: Exit) -> Iterator[Shown]:
    found = list(_scenarios(leave))
    yield from (_playing(leave.table, item) for item in found)
    taking = [item for item in found if item.expected and item.expected[-1] == leave.index]
    if taking:
        yield from _more(leave, min(taking, key=lambda item: len(item.steps)))


def _scenarios(leave: Exit) -> Iterator[Scenario]:
    if leave.item.is_time_out:
        yield from timing.time_out(leave)
    else:
        for entry in decisive(leave.item.guard):
            yield from edges.edges(leave, entry)
            yield from edges.groups(leave, entry)
        yield from timing.debounce(leave)
        yield from timing.waiting(leave)
    for second in leave.siblings:
        if second.index > leave.index:
            yield from edges.priority(leave, second)


def _more(leave: Exit, taking: Scenario) -> Iterator[Shown]:
    """Tests that start from measurements with which the exit is taken."""
    table = leave.table
    last = taking.steps[-leave.debounce - 1 :]
    for item in (*timing.clock(leave, last), *timing.elsewhere(leave)):
        yield _playing(table, item)
    steps = leave.comfortable([leave.opens], Exit.fires) or last
    alone = tuple(step._replace(vector=step.vector._replace(other_phase=None)) for step in steps)
    if leave.yields(alone):
        absent = "another leg" if table.words.member == "phase" else f"a {table.words.member}"
        yield _playing(table, leave.scenario(f"holds without {absent}", alone))
    check = partial(refuse, table, leave.phase, steps)
    yield "refuses signals that are NaN, infinite or missing", check, 17 * len(steps) * len(table.joints)


def _playing(table: StateTable, item: Scenario) -> Shown:
    check = partial(play, table, item) if item.steps else None
    return item.what, check, len(item.steps)


def approval_text(table: StateTable) -> str:
    """All that a table says as Markdown: transitions by priority, laws, parameters, truth tables."""
    return f"{transition_table(table)}\n{truth_table(table)}"


def check_approved(path: Path, present: str) -> str | None:
    """None if the approved text is the present one, else what is wrong, such as a unified diff."""
    if not path.exists():
        return f"{path}: there is no approved text yet"
    approved = path.read_text(encoding="utf-8").splitlines()
    lines = difflib.unified_diff(approved, present.splitlines(), str(path), "the table", lineterm="")
    return "\n".join(lines) or None
