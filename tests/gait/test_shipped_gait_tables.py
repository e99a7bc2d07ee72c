"""Tests of all transitions of shipped gait tables by the test kit, and of legs on random measurements.

No threshold is typed here: the kit (:mod:`twin_gait.testing`) reads the tables, works out what has to
happen from them alone, and drives the state machine. The approved texts under ``approved`` show when a
table itself was edited; ``pytest --gait-table FILE --approved FILE --approve`` renews one.
"""

from __future__ import annotations

import itertools
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from errors import raises
from guard_solver import OTHER_TIME, OWN_TIME, holds
from hypothesis import given, settings
from hypothesis import strategies as st
from kit_equivalence import NEVER_BOTH, reason
from kit_mutants import mutants

from twin_gait.configuration.gait_table_file import load_gait_table, packaged_gait_tables
from twin_gait.exceptions import ParameterError
from twin_gait.gait.guards import Comparison, PhaseMembership
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import signal_names
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.testing.cases import TransitionTest, approval_text, check_approved, transition_tests
from twin_gait.testing.exits import decisive
from twin_gait.vocabulary import GaitPhase, Side

TABLES = packaged_gait_tables()
APPROVED = Path(__file__).parents[1] / "approved"


@cache
def shipped(name: str) -> GaitTable:
    return load_gait_table(name)


@cache
def kit(name: str) -> list[TransitionTest]:
    return transition_tests(shipped(name))


FIVE_PHASES = tuple(str(phase) for phase in GaitPhase)
# Published machines of prostheses have tables too; these are walks of the device.
WALKING = ["bench_leg", "treadmill_guided", "treadmill_ankle"]
WALK_COMMAND_TICKS = 250  # after which the walk command of both legs changes

each_table = pytest.mark.parametrize("name", TABLES)


def leaving(table: GaitTable, source: str) -> list[int]:
    """Indices of the transitions that leave a phase, in the order of the table."""
    return [index for index, item in enumerate(table.transitions) if item.source == source]


def of_transition(name: str, index: int) -> list[tuple[str, TransitionTest]]:
    """Return the tests of the kit for one transition with the claims that they show."""
    item = shipped(name).transitions[index]
    title = f"{item.source}→{item.target} ({item.cause})::"
    return [(test.name.removeprefix(title), test) for test in kit(name) if test.name.startswith(title)]


@each_table
def test_every_test_of_the_kit_is_of_a_transition(name: str) -> None:
    shown = [of_transition(name, index) for index in range(len(shipped(name).transitions))]
    assert sum(map(len, shown)) == len(kit(name))


def test_unknown_table_name_lists_the_shipped_tables() -> None:
    assert TABLES
    with raises(ParameterError, *TABLES):
        load_gait_table("moonwalk")


@pytest.mark.parametrize("name", WALKING)
def test_phases_of_walking_form_one_cycle_in_their_order(name: str) -> None:
    """Sequential, as in section 5.1 of the thesis: each phase leads to the next and nowhere else."""
    names = shipped(name).phase_names
    assert names == FIVE_PHASES
    following = dict(zip(names, [*names[1:], names[0]], strict=True))
    assert {(item.source, item.target) for item in shipped(name).transitions} == set(following.items())


@pytest.mark.parametrize("name", WALKING)
def test_swing_ends_by_timeout_when_the_foot_is_stuck(name: str) -> None:
    table = shipped(name)
    for phase in (GaitPhase.SWING_FLEXION, GaitPhase.SWING_EXTENSION):
        items = [table.transitions[index] for index in leaving(table, phase)]
        assert any(item.is_timeout for item in items), phase


@pytest.mark.parametrize(
    ("name", "index"),
    [
        pytest.param(name, index, id=f"{name}::{item.source}→{item.target} ({item.cause})")
        for name in TABLES
        for index, item in enumerate(shipped(name).transitions)
    ],
)
def test_transition(name: str, index: int) -> None:
    """Run all tests of the kit on one transition; the message names the first one that fails."""
    for claim, test in of_transition(name, index):
        assert test.undecided is None, f"{claim}: {test.undecided}"
        try:
            test.run()
        except AssertionError as error:
            raise AssertionError(claim) from error


@each_table
def test_kit_shows_every_condition_debounce_and_time_of_a_shipped_table(name: str) -> None:
    table = shipped(name)
    for index, item in enumerate(table.transitions):
        shown = dict(of_transition(name, index)).keys()
        assert "rejects signals that are NaN, infinite or missing" in shown
        for entry in decisive(item.guard):
            assert _wanted(table, entry.atom) <= shown
        for count, word in ((item.debounce_ticks > 1, "debounce:"), (item.is_timeout, "timeout:")):
            assert any(claim.startswith(word) for claim in shown) is bool(count), (word, item)
        least = table.phases[item.source].minimum_ticks
        waits = any(claim.startswith("minimum duration:") for claim in shown)
        assert waits is (least > 1 and not item.is_timeout), item


def _wanted(table: GaitTable, atom: Comparison | PhaseMembership) -> set[str]:
    if isinstance(atom, PhaseMembership):
        verbs = {phase: "fires" if phase in atom.phases else "holds" for phase in table.phase_names}
        return {f"{verb} while the other leg is in {phase}" for phase, verb in verbs.items()}
    edges = {f"fires just past {atom}", f"holds just below {atom}"}
    return edges if OWN_TIME in (atom.signal, atom.minus) else {*edges, f"holds on the threshold of {atom}"}


@each_table
def test_kit_shows_the_priority_of_every_two_exits_of_a_phase(name: str) -> None:
    """Of any two exits of a phase that can be due in one tick; the few that cannot are proved to be so."""
    table = shipped(name)
    orders = [mutant for mutant in mutants(table) if mutant.kind == "order"]
    apart = {mutant.transitions for mutant in orders if reason(table, mutant) == NEVER_BOTH}
    assert len(apart) < 0.25 * len(orders) or not apart
    for source in table.phase_names:
        for first, second in itertools.combinations(leaving(table, source), 2):
            other = table.transitions[second]
            claim = f"priority: wins over {other.target} ({other.cause}) when both are due"
            assert (claim in dict(of_transition(name, first))) is ((first, second) not in apart)


@each_table
def test_table_is_the_one_that_was_approved(name: str) -> None:
    assert check_approved(APPROVED / f"{name}.md", approval_text(shipped(name))) is None


class ReferenceLeg:
    """The rules of the gait table written down a second time, on plain dictionaries."""

    def __init__(self, table: GaitTable, phase: str) -> None:
        self.table = table
        self.phase = phase
        self.entry_tick = 0
        self.open_since: dict[int, int] = {}

    def step(self, tick: int, signals: dict[str, float], other_phase: str) -> int | None:
        stayed = tick - self.entry_tick
        due = []
        for index in leaving(self.table, self.phase):
            item = self.table.transitions[index]
            if not holds(item.guard, signals, other_phase):
                self.open_since.pop(index, None)
                continue
            since = self.open_since.setdefault(index, tick)
            if (
                tick - since + 1 >= item.debounce_ticks
                and stayed >= (item.timeout_ticks or 0)
                and stayed >= self.table.phases[self.phase].minimum_ticks
            ):
                due.append(index)
        if not due:
            return None
        self.phase = self.table.transitions[due[0]].target
        self.entry_tick = tick
        self.open_since = {}
        return due[0]


def random_walk(table: GaitTable, ticks: int, seed: int) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Angles and velocities of both legs that jump now and then, in the units of the table."""
    rng = np.random.default_rng(seed)
    names = [name for name in signal_names(table.joints) if name != OWN_TIME]
    ranges = {"angle_deg": (-25.0, 60.0), "velocity_deg_per_s": (-80.0, 80.0), "load_bw": (0.0, 1.0)}
    unread = (0.0, 1.0)  # of a signal that no shipped guard reads, any
    low, high = np.array([ranges.get(name.rsplit(".", 1)[-1], unread) for name in names]).T
    rows, current = [], rng.uniform(low, high, (2, len(names)))
    for _ in range(ticks):
        change = rng.random((2, len(names))) < 0.02
        current = np.where(change, rng.uniform(low, high, (2, len(names))), current)
        left, right = (dict(zip(names, leg.tolist(), strict=True)) for leg in current)
        rows.append((left, right))
    return rows


@each_table
@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_measurements_keep_both_legs_in_the_cycle(name: str, seed: int) -> None:
    """Against the reference above: same switches in the same ticks, both legs on one snapshot."""
    table = shipped(name)
    starts = table.phase_names[0], table.phase_names[len(table.phase_names) // 2]
    program = compile_guards(table)
    machines = [
        GaitStateMachine(table, side, initial_phase=start, program=program)
        for side, start in zip((Side.LEFT, Side.RIGHT), starts, strict=True)
    ]
    references = [ReferenceLeg(table, start) for start in starts]
    listed = {(item.source, item.target) for item in table.transitions}
    count = 0
    for tick, measured in enumerate(random_walk(table, 1200, seed), start=1):
        phases = [machine.phase for machine in machines]
        times = [(tick - machine.entry_tick) * TICK for machine in machines]
        for leg, machine in enumerate(machines):
            other = 1 - leg
            signals = {**measured[leg], OWN_TIME: times[leg]}
            signals |= {f"other.{key}": value for key, value in measured[other].items()}
            signals |= {
                OTHER_TIME: times[other],
                "walk": float(tick // WALK_COMMAND_TICKS % 2 == 0),
                "step": 1.0,
            }
            switch = machine.step(tick, signals, phases[other])
            expected = references[leg].step(tick, signals, phases[other])
            assert (None if switch is None else switch.transition) == expected
            if switch is not None:
                count += 1
                assert (switch.source, switch.target) in listed
                assert (phases[leg], machine.phase) == (switch.source, switch.target)
    assert count > 0
