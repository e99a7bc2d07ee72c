"""Every transition of every shipped gait table, driven by measurements found from the table itself.

No threshold is typed here. Measurements that open or close a guard come from
:mod:`guard_solver`, which knows the guard tree but not the package's evaluator.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
import pytest
from guard_solver import (
    OTHER_TIME,
    OWN_TIME,
    Measurements,
    Wish,
    clauses,
    earliest_time_out,
    edge_of,
    exits,
    holds,
    other_guards,
    solve_with_closed,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from twin_gait.configuration.gait_table_file import packaged_gait_table, packaged_gait_tables
from twin_gait.exceptions import GaitTableError, MeasurementError
from twin_gait.gait import TICK, GaitStateMachine, GaitTable, PhaseSwitch, compile_guards
from twin_gait.gait.guards import AllOf, Comparison, Guard, PhaseMembership, all_signal_names, signal_names
from twin_gait.vocabulary import GaitPhase, Side

TABLES = packaged_gait_tables()


@cache
def shipped(name: str) -> GaitTable:
    return packaged_gait_table(name)


FIVE_PHASES = tuple(str(phase) for phase in GaitPhase)
WALKING = [name for name in TABLES if set(shipped(name).phase_names) == set(FIVE_PHASES)]


def guarded(name: str) -> list[int]:
    return [index for index, item in enumerate(shipped(name).transitions) if not item.is_time_out]


def time_outs(name: str) -> list[int]:
    return [index for index, item in enumerate(shipped(name).transitions) if item.is_time_out]


def each(indices: object) -> Iterator[object]:
    """A test case per transition, named after its phases and cause."""
    for name in TABLES:
        for index in indices(name):  # type: ignore[operator]
            item = shipped(name).transitions[index]
            yield pytest.param(name, index, id=f"{name}-{index}-{item.source}-{item.cause}")


each_guarded = pytest.mark.parametrize(("name", "index"), list(each(guarded)))
each_time_out = pytest.mark.parametrize(("name", "index"), list(each(time_outs)))
each_table = pytest.mark.parametrize("name", TABLES)


class Leg:
    """A state machine that is fed with measurements in the units of its table."""

    def __init__(self, table: GaitTable, source: str) -> None:
        self.table = table
        self.machine = GaitStateMachine(table, Side.LEFT, initial_phase=source)

    def step(self, tick: int, found: Measurements) -> PhaseSwitch | None:
        joints = self.table.joints
        return self.machine.step(
            tick,
            found.leg(joints),
            found.leg(joints, "other."),
            found.other_phase,
            found.signals[OTHER_TIME],
        )


def at_tick(found: Measurements, tick: int) -> Measurements:
    """The same measurements at another time in the phase."""
    return Measurements({**found.signals, OWN_TIME: tick * TICK}, found.other_phase)


def window(table: GaitTable, index: int, ticks: int) -> tuple[float, float]:
    """Times in the phase at which a transition may start to be open for some ticks, in [s]."""
    item = table.transitions[index]
    earliest = max(1, table.phases[item.source].minimum_ticks, item.time_out_ticks or 0)
    return earliest * TICK, (earliest_time_out(table, item.source) - ticks) * TICK


def find(
    table: GaitTable, index: int, wishes: Sequence[Wish], closed: Sequence[Guard], *, allow_time: bool = True
) -> Measurements | None:
    """Measurements that fulfil the wishes while the other exits, and some guards more, are closed."""
    earliest, latest = window(table, index, table.transitions[index].dwell_ticks + 1)
    shut = [*other_guards(table, index), *closed]
    return solve_with_closed(table, wishes, shut, earliest, latest, allow_time=allow_time)


def opened(table: GaitTable, index: int) -> Measurements:
    """Measurements well inside a guard with all other exits closed."""
    for clause in clauses(table.transitions[index].guard):
        found = find(table, index, [Wish(atom) for atom in clause], [])
        if found is not None:
            return found
    raise AssertionError(f"{table.name}: transition {index} is never open while all other exits are closed")


def shut(table: GaitTable, index: int) -> Measurements:
    """Measurements well outside all guards of a phase, whatever the time in it."""
    found = find(table, index, [], [table.transitions[index].guard], allow_time=False)
    assert found is not None, f"{table.name}: {table.transitions[index].source} cannot be kept"
    return found


def edges(table: GaitTable, index: int, true: bool) -> list[tuple[Measurements | None, str]]:
    """Measurements on either side of every edge of a guard, everything else fulfilled with room.

    Args:
        table: The table.
        index: The transition.
        true: Just inside the guard, or just outside.

    Returns:
        For each edge the measurements, None where there are none, and a description.
    """
    result = []
    parts = clauses(table.transitions[index].guard)
    for clause in parts:
        # Another way to open the same guard would hide the edge.
        others = [AllOf(guards=other) for other in parts if other is not clause]
        for atom in clause:
            rest = [Wish(other) for other in clause if other != atom]
            for wish in _edge_wishes(table, atom, true):
                found = find(table, index, [*rest, wish], others)
                result.append((found, f"{atom}: {wish.atom} {'just true' if true else 'just false'}"))
    return result


def _edge_wishes(table: GaitTable, atom: Comparison | PhaseMembership, true: bool) -> list[Wish]:
    if isinstance(atom, Comparison):
        return [Wish(atom, true, edge_of(atom, true))]
    names = [name for name in table.phase_names if (name in atom.phases) is true]
    return [Wish(PhaseMembership(phases=(name,))) for name in names]


def test_tables_ship_and_unknown_names_list_them() -> None:
    assert TABLES
    with pytest.raises(GaitTableError, match=", ".join(TABLES)):
        packaged_gait_table("moonwalk")


def test_there_is_a_table_for_the_treadmill_and_one_for_the_bench() -> None:
    assert {"treadmill", "bench_leg"} <= set(WALKING)


@pytest.mark.parametrize("name", WALKING)
def test_phases_of_walking_form_one_cycle_in_their_order(name: str) -> None:
    """Sequential, as in section 5.1 of the thesis: each phase leads to the next and nowhere else."""
    names = shipped(name).phase_names
    assert names == FIVE_PHASES
    following = dict(zip(names, [*names[1:], names[0]], strict=True))
    assert {(item.source, item.target) for item in shipped(name).transitions} == set(following.items())


@pytest.mark.parametrize("name", WALKING)
def test_swing_ends_by_itself_when_the_foot_is_stuck(name: str) -> None:
    for phase in (GaitPhase.SWING_FLEXION, GaitPhase.SWING_EXTENSION):
        assert math.isfinite(earliest_time_out(shipped(name), phase)), phase


@each_guarded
def test_transition_fires_just_past_every_threshold(name: str, index: int) -> None:
    table = shipped(name)
    item = table.transitions[index]
    for found, text in edges(table, index, true=True):
        assert found is not None, f"{text}: no measurements make it decide; the entry is dead or redundant"
        leg, first = Leg(table, item.source), found.tick
        steps = [leg.step(first + k, found) for k in range(item.dwell_ticks)]
        assert steps[:-1] == [None] * (item.dwell_ticks - 1), text
        last = first + item.dwell_ticks - 1
        assert steps[-1] == PhaseSwitch(last, Side.LEFT, item.source, item.target, item.cause, index), text


@each_guarded
def test_transition_holds_just_below_every_threshold(name: str, index: int) -> None:
    """Each threshold by itself, all other conditions fulfilled."""
    table = shipped(name)
    item = table.transitions[index]
    for found, text in edges(table, index, true=False):
        assert found is not None, f"{text}: no measurements make it decide; the condition is redundant"
        leg, held = Leg(table, item.source), 0
        for tick in range(found.tick, found.tick + item.dwell_ticks + 1):
            if holds(item.guard, at_tick(found, tick).signals, found.other_phase):
                break  # a threshold in time passes by itself
            assert leg.step(tick, found) is None, text
            held += 1
        assert held > 0, text


@each_guarded
def test_transition_holds_on_every_threshold(name: str, index: int) -> None:
    """Inequalities are strict: the very threshold does not open the guard."""
    table = shipped(name)
    item = table.transitions[index]
    parts = clauses(item.guard)
    for clause in parts:
        others = [AllOf(guards=other) for other in parts if other is not clause]
        for atom in clause:
            if not isinstance(atom, Comparison) or atom.minus is not None or atom.signal == OWN_TIME:
                continue  # a difference of two radians need not be exact; ticks are tested just below
            rest = [Wish(other) for other in clause if other != atom]
            found = find(table, index, [*rest, Wish(atom, False, 0.0)], others)
            assert found is not None, str(atom)
            exact = Measurements({**found.signals, atom.signal: atom.threshold}, found.other_phase)
            leg = Leg(table, item.source)
            for k in range(item.dwell_ticks):
                assert leg.step(exact.tick + k, exact) is None, str(atom)


@each_guarded
def test_dwell_is_counted_in_consecutive_ticks(name: str, index: int) -> None:
    table = shipped(name)
    item = table.transitions[index]
    inside, outside = opened(table, index), shut(table, index)
    sequence = [inside] * (item.dwell_ticks - 1) + [outside] + [inside] * item.dwell_ticks
    first = min(inside.tick, int(min(earliest_time_out(table, item.source), 10**6)) - len(sequence))
    assert first >= 1
    leg = Leg(table, item.source)
    steps = [leg.step(first + k, found) for k, found in enumerate(sequence)]
    assert steps[:-1] == [None] * (len(sequence) - 1)
    assert steps[-1] is not None
    assert steps[-1].transition == index


@each_guarded
def test_transition_waits_for_least_stay_dwell_and_time(name: str, index: int) -> None:
    """Open from the entry on, it fires as soon as all that is counted in ticks is over."""
    table = shipped(name)
    item = table.transitions[index]
    inside = opened(table, index)
    consecutive, expected = 0, None
    for tick in range(1, inside.tick + item.dwell_ticks + 1):
        is_open = holds(item.guard, at_tick(inside, tick).signals, inside.other_phase)
        consecutive = consecutive + 1 if is_open else 0
        stayed = tick >= max(table.phases[item.source].minimum_ticks, item.time_out_ticks or 0)
        if consecutive >= item.dwell_ticks and stayed:
            expected = tick
            break
    leg = Leg(table, item.source)
    switch = None
    for tick in range(1, inside.tick + item.dwell_ticks + 1):
        switch = leg.step(tick, inside)
        if switch is not None:
            break
    assert switch is not None
    assert (switch.transition, switch.tick) == (index, expected)


@each_time_out
def test_time_out_fires_exactly_at_its_tick(name: str, index: int) -> None:
    table = shipped(name)
    item = table.transitions[index]
    assert item.time_out_ticks == earliest_time_out(table, item.source), "a later time-out can never fire"
    closed = [table.transitions[other].guard for other in exits(table, item.source) if other != index]
    found = solve_with_closed(table, [], closed, allow_time=False)
    assert found is not None, "another exit is always open: the time-out can never fire"
    leg = Leg(table, item.source)
    before = [leg.step(tick, found) for tick in range(1, item.time_out_ticks)]
    assert before == [None] * (item.time_out_ticks - 1)
    assert leg.step(item.time_out_ticks, found) == PhaseSwitch(
        item.time_out_ticks, Side.LEFT, item.source, item.target, item.cause, index
    )


@each_table
def test_first_listed_of_two_exits_that_are_due_wins(name: str) -> None:
    table = shipped(name)
    pairs = 0
    for source in table.phase_names:
        for first, second in itertools.combinations(exits(table, source), 2):
            path = both_due(table, first, second)
            if path is None:
                continue  # no measurements open both
            pairs += 1
            leg = Leg(table, source)
            steps = [leg.step(found.tick, found) for found in path]
            assert steps[:-1] == [None] * (len(path) - 1)
            assert steps[-1] is not None
            assert steps[-1].transition == first
    assert pairs > 0


def both_due(table: GaitTable, first: int, second: int) -> list[Measurements] | None:
    """Measurements, tick by tick, that make two exits of a phase due in the last tick and none before."""
    pair = {index: table.transitions[index] for index in (first, second)}
    waiting = [index for index in pair if not pair[index].is_time_out]
    if not waiting:
        return None
    long = max(waiting, key=lambda index: pair[index].dwell_ticks)
    ticks = {index: pair[index].dwell_ticks if index in waiting else 1 for index in pair}
    alone = ticks[long] - min(ticks.values())
    latest = earliest_time_out(table, pair[first].source)
    earliest = max(
        ticks[long],
        table.phases[pair[first].source].minimum_ticks,
        *(item.time_out_ticks or 0 for item in pair.values()),
    )
    if len(waiting) == 2:
        latest -= 1
    rest = [guard for guard in other_guards(table, long) if guard is not pair[first + second - long].guard]
    both = _open_together(table, waiting, rest, earliest, latest)
    if both is None:
        return None
    before = both
    if alone and len(waiting) == 2:  # the longer dwell begins while the other exit is closed
        found = solve_with_closed(
            table, [Wish(atom) for atom in clauses(pair[long].guard)[0]], other_guards(table, long)
        )
        if found is None:
            return None
        before = found
    sequence = [before] * alone + [both] * (ticks[long] - alone)
    return [at_tick(found, both.tick - len(sequence) + 1 + k) for k, found in enumerate(sequence)]


def _open_together(
    table: GaitTable, indices: list[int], closed: list[Guard], earliest: float, latest: float
) -> Measurements | None:
    for chosen in itertools.product(*(clauses(table.transitions[index].guard) for index in indices)):
        wishes = [Wish(atom) for atom in dict.fromkeys(itertools.chain(*chosen))]
        found = solve_with_closed(table, wishes, closed, earliest * TICK, latest * TICK)
        if found is not None:
            return found
    return None


@each_table
def test_broken_or_missing_measurements_are_refused(name: str) -> None:
    table = shipped(name)
    for source in table.phase_names:
        found = Measurements(dict.fromkeys(all_signal_names(table.joints), 0.1), source)
        for signal in signal_names(table.joints)[:-1]:
            for prefix, whose in (("", "left leg: the"), ("other.", "other leg's")):
                broken = Measurements({**found.signals, prefix + signal: math.nan}, source)
                with pytest.raises(MeasurementError, match=signal) as caught:
                    Leg(table, source).step(1, broken)
                assert whose in str(caught.value)
        short = found.leg(table.joints[:-1])
        with pytest.raises(MeasurementError):
            GaitStateMachine(table, Side.LEFT).step(1, short)


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
        for index in exits(self.table, self.phase):
            item = self.table.transitions[index]
            if not holds(item.guard, signals, other_phase):
                self.open_since.pop(index, None)
                continue
            since = self.open_since.setdefault(index, tick)
            if (
                tick - since + 1 >= item.dwell_ticks
                and stayed >= (item.time_out_ticks or 0)
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
    low, high = np.array([ranges[name.rsplit(".", 1)[-1]] for name in names]).T
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
            signals[OTHER_TIME] = times[other]
            found = Measurements(signals, phases[other])
            switch = machine.step(
                tick,
                found.leg(table.joints),
                found.leg(table.joints, "other."),
                phases[other],
                times[other],
            )
            expected = references[leg].step(tick, signals, phases[other])
            assert (None if switch is None else switch.transition) == expected
            if switch is not None:
                count += 1
                assert (switch.source, switch.target) in listed
                assert (phases[leg], machine.phase) == (switch.source, switch.target)
    assert count > 0
