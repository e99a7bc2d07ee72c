"""Tests of the solver of guards against a million random signal vectors and a second evaluator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from errors import raises
from guard_solver import holds
from table_builder import JOINTS, guard, phase

from twin_gait.checking.check import build_case
from twin_gait.checking.exits import ambiguity, cascade, hysteresis
from twin_gait.checking.finding import CheckCase, Finding, label
from twin_gait.checking.graph import deadlock, reachable_pairs, starting_pairs
from twin_gait.checking.signals import SignalPoint, SignalSpace, swapped
from twin_gait.configuration.experiments import load_experiment
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.exceptions import GaitTableError
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.feasibility import (
    MAX_BRANCHES,
    ZERO,
    Case,
    Requirement,
    comparison_bound,
    enumerate_cases,
)
from twin_gait.gait.guards import AllOf, AnyOf, Guard, PhaseMembership
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.signals import ANGLE, all_signal_names
from twin_gait.gait.table import TICK, GaitTable, Transition
from twin_gait.vocabulary import Side

# Limits of urdf/twin.urdf: lowest and highest angle in [deg], speed in [deg/s].
TWIN = {"hip": (-20.0, 110.0, 151.2), "knee": (-4.0, 122.0, 233.1)}
PHASES = ("a", "b", "c", "d")
TIME, OTHER_TIME = "time_in_phase_s", "other.time_in_phase_s"


@cache
def treadmill() -> Experiment:
    return load_experiment("treadmill_guided").experiment


class Vectors:
    """Random signals of both legs inside the limits of the URDF, in the units of the table."""

    def __init__(self, table: GaitTable, generator: np.random.Generator, count: int) -> None:
        self.table = table
        self.count = count
        self.signals = {name: self._draw(name, generator) for name in all_signal_names(JOINTS)}
        self.others = generator.integers(len(table.phases), size=count)
        ends = np.array([self.timeout(name) for name in table.phase_names])
        self.signals[OTHER_TIME] = np.minimum(self.signals[OTHER_TIME], ends[self.others])

    def _draw(self, name: str, generator: np.random.Generator) -> np.ndarray:
        quantity = name.rsplit(".", 1)[-1]
        if quantity in ("load_bw", TIME):
            values = generator.uniform(0.0, 2.0, self.count)
            return values if quantity == "load_bw" else np.round(values / TICK) * TICK
        if name in ("walk", "step"):
            return generator.uniform(0.0, 1.0, self.count)
        if name == "trunk.pitch_deg":  # the pelvis is guided
            return np.zeros(self.count)
        if name.rsplit(".", 2)[-2] not in TWIN:  # no guard here reads it
            return np.zeros(self.count)
        low, high, speed = TWIN[name.rsplit(".", 2)[-2]]
        return generator.uniform(*((low, high) if quantity == "angle_deg" else (-speed, speed)), self.count)

    def timeout(self, name: str) -> float:
        ends = [
            item.timeout_ticks for item in self.table.transitions if item.source == name and item.is_timeout
        ]
        return min((end for end in ends if end is not None), default=10**9) * TICK

    def true(self, node: Guard, time: np.ndarray | None = None) -> np.ndarray:
        """Return where a guard holds, by recursion over its tree on all vectors at once."""
        if isinstance(node, AllOf):
            return np.logical_and.reduce(
                [np.full(self.count, True), *(self.true(g, time) for g in node.guards)]
            )
        if isinstance(node, AnyOf):
            return np.logical_or.reduce([self.true(g, time) for g in node.guards])
        if isinstance(node, PhaseMembership):
            return np.isin(self.others, [self.table.phase_index(name) for name in node.phases])
        left = self._value(node.signal, time)
        if node.minus is not None:
            left = left - self._value(node.minus, time)
        return left > node.threshold if node.operator == ">" else left < node.threshold

    def _value(self, name: str, time: np.ndarray | None) -> np.ndarray:
        return time if name == TIME and time is not None else self.signals[name]

    def at(self, index: int, *, seen_by_other: bool = False) -> dict[str, float]:
        """Return the signals of both legs in one vector, as one leg or the other reads them."""
        named = {swapped(name) if seen_by_other else name: value for name, value in self.signals.items()}
        return {name: float(value[index]) for name, value in named.items()}

    def due(self, item: Transition) -> np.ndarray:
        """Return where a transition is open at a time at which the leg can still be in its phase."""
        time = self.signals[TIME]
        first = max(1, self.table.phases[item.source].minimum_ticks, item.timeout_ticks or 0)
        inside = (time > (first - 0.5) * TICK) & (time < self.timeout(item.source) + 0.5 * TICK)
        return self.true(item.guard) & inside

    def ambiguities(self) -> set[tuple[str, str]]:
        """Pairs of exits with different targets that are open at once in one of the vectors."""
        return {
            (label(first), label(second))
            for first, second in itertools.combinations(self.table.transitions, 2)
            if first.source == second.source
            and first.target != second.target
            and not (first.is_timeout or second.is_timeout)
            and (self.due(first) & self.due(second)).any()
        }

    def cascades(self) -> set[tuple[str, str]]:
        """Transitions into a phase and out of it that are both open, one tick apart, in a vector."""
        entry = np.full(self.count, TICK)
        return {
            (label(into), label(out))
            for into, out in itertools.product(self.table.transitions, repeat=2)
            if into.target == out.source
            and not out.is_timeout
            and (out.timeout_ticks or 0) <= 1
            and (self.due(into) & self.true(out.guard, entry)).any()
        }


def pairs(findings: list[Finding], table: GaitTable) -> set[tuple[str, str]]:
    """Return the pairs of transitions of findings; the transition of the finding comes second."""
    names = [label(item) for item in table.transitions]
    return {(name, item.transition or "") for item in findings for name in names if name in item.reason}


def assert_reported(table: GaitTable, vectors: Vectors, case: CheckCase) -> tuple[int, int]:
    contending, passing = vectors.ambiguities(), vectors.cascades()
    assert contending <= pairs(ambiguity(case), table)
    assert passing <= pairs(cascade(case), table)
    return len(contending), len(passing)


# ---------------------------------------------------------------------------------- random tables


def random_guard(generator: np.random.Generator, depth: int = 0) -> Guard:
    kind = generator.random()
    if depth < 2 and kind < 0.5:
        inner = tuple(random_guard(generator, depth + 1) for _ in range(generator.integers(2, 4)))
        return AllOf(guards=inner) if kind < 0.35 else AnyOf(guards=inner)
    if kind < 0.6:
        members = generator.choice(PHASES, size=generator.integers(1, 4), replace=False)
        return PhaseMembership(phases=tuple(str(name) for name in members))
    prefix = "other." if generator.random() < 0.3 else ""
    joint, operator = generator.choice(JOINTS), generator.choice(["<", ">"])
    texts = [
        f"{prefix}{joint}.angle_deg {operator} {generator.uniform(-10, 60):.1f}",
        f"{prefix}{joint}.velocity_deg_per_s {operator} {generator.uniform(-80, 80):.0f}",
        f"{prefix}foot.load_bw {operator} {generator.uniform(0.05, 1.2):.2f}",
        f"{prefix}time_in_phase_s {operator} {generator.uniform(0.0, 0.8):.3f}",
        f"other.{joint}.angle_deg - {joint}.angle_deg {operator} {generator.uniform(-30, 30):.1f}",
    ]
    return guard(str(generator.choice(texts, p=[0.4, 0.2, 0.1, 0.1, 0.2])))


def random_table(seed: int) -> GaitTable:
    generator = np.random.default_rng(seed)
    transitions = []
    for index in range(10):
        source, target = (str(name) for name in generator.choice(PHASES, size=2, replace=False))
        times = {"timeout_ticks": int(generator.integers(100, 900))} if generator.random() < 0.2 else {}
        only_time = bool(times) and generator.random() < 0.7
        transitions.append(
            Transition(
                source=source,
                target=target,
                cause=f"t{index}",
                debounce_ticks=int(generator.choice([1, 1, 5])),
                **({} if only_time else {"guard": random_guard(generator)}),
                **times,
            )
        )
    phases = {name: phase(minimum_ticks=int(generator.choice([0, 0, 20]))) for name in PHASES}
    return GaitTable(name=f"random {seed}", joints=JOINTS, phases=phases, transitions=tuple(transitions))


SEEDS = range(12)


@cache
def random_case(seed: int) -> CheckCase:
    experiment = treadmill()
    plain = build_case(load_gait_table("treadmill_guided"), experiment)
    return CheckCase(
        table=random_table(seed),
        experiment=experiment,
        limits=plain.limits,
        velocity_limits=plain.velocity_limits,
        first_phases=plain.first_phases,
    )


def test_limits_equal_the_limits_of_the_urdf() -> None:
    space = SignalSpace(random_case(0))
    for joint, (low, high, speed) in TWIN.items():
        for prefix in ("", "other."):
            assert space.range(f"{prefix}{joint}.angle_deg") == pytest.approx((low, high), abs=0.01)
            velocity = space.range(f"{prefix}{joint}.velocity_deg_per_s")
            assert velocity == pytest.approx((-speed, speed), abs=0.2)


@pytest.mark.parametrize("name", ["treadmill_guided", "bench_leg"])
def test_shipped_tables_report_all_that_half_a_million_random_vectors_show(name: str) -> None:
    table = load_gait_table(name)
    case = CheckCase(table=table, experiment=None, limits=random_case(0).limits)
    vectors = Vectors(table, np.random.default_rng(1), 500_000)
    contending, passing = assert_reported(table, vectors, case)
    assert contending == 0  # every phase of these tables leads to one other
    assert passing >= 2


@pytest.mark.parametrize("seed", SEEDS)
def test_random_tables_report_all_that_random_vectors_show(seed: int) -> None:
    table = random_table(seed)
    assert_reported(table, Vectors(table, np.random.default_rng(seed), 40_000), random_case(seed))


def test_random_vectors_open_guards() -> None:
    """Guards must open: on tables without open guards the test above would pass without effect."""
    found = [
        (len(vectors.ambiguities()), len(vectors.cascades()))
        for seed in SEEDS
        for vectors in [Vectors(random_table(seed), np.random.default_rng(seed), 40_000)]
    ]
    contending, passing = np.sum(found, axis=0)
    assert contending > 20
    assert passing > 50


# ---------------------------------------------------------------------------------- counterexamples


def signals_of(finding: Finding, **changes: float) -> tuple[dict[str, float], str]:
    """Return all signals: those of the counterexample, and zero for all others."""
    values = dict.fromkeys(all_signal_names(JOINTS), 0.0)
    values |= {name: value for name, value in finding.counterexample.items() if not isinstance(value, str)}
    return {**values, **changes}, str(finding.counterexample.get("other.phase", PHASES[0]))


def named(finding: Finding, table: GaitTable) -> list[Transition]:
    """Return the transitions that a finding names; a third one with priority over both comes last."""
    return sorted(
        (item for item in table.transitions if label(item) in finding.reason),
        key=lambda item: finding.reason.index(label(item)),
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_every_counterexample_of_an_ambiguity_opens_both_exits(seed: int) -> None:
    table = random_table(seed)
    for finding in ambiguity(random_case(seed)):
        signals, other = signals_of(finding)
        first, second, *_ = named(finding, table)
        assert (first.source, label(second)) == (second.source, finding.transition)
        assert holds(first.guard, signals, other), finding
        assert holds(second.guard, signals, other), finding


@pytest.mark.parametrize("seed", SEEDS)
def test_every_counterexample_of_a_cascade_opens_entry_and_exit(seed: int) -> None:
    table = random_table(seed)
    for finding in cascade(random_case(seed)):
        first, second = named(finding, table)
        into, out = (first, second) if label(second) == finding.transition else (second, first)
        assert into.target == out.source
        signals, other = signals_of(finding)
        assert holds(into.guard, signals, other), finding
        assert holds(out.guard, {**signals, TIME: TICK}, other), finding


@pytest.mark.parametrize("seed", SEEDS)
def test_counterexamples_lie_inside_the_limits(seed: int) -> None:
    case = random_case(seed)
    space = SignalSpace(case)
    for finding in [*ambiguity(case), *cascade(case)]:
        for name, value in finding.counterexample.items():
            if isinstance(value, str):
                assert value in PHASES
            elif not name.endswith(TIME):
                low, high = space.range(name)
                assert low <= value <= high


def test_noise_reverses_a_reported_switch() -> None:
    """The transition back opens in the next tick with every signal changed by at most the noise."""
    forth = Transition(source="a", target="b", cause="there", guard=guard("hip.angle_deg > 10"))
    back = Transition(source="b", target="a", cause="back", guard=guard("hip.angle_deg < 9.8"))
    table = GaitTable(name="t", joints=JOINTS, phases={n: phase() for n in PHASES}, transitions=(forth, back))
    (finding,) = (item for item in hysteresis(build_case(table)) if item.transition == label(back))
    angle = finding.counterexample["hip.angle_deg"]
    assert isinstance(angle, float)
    assert angle > 10.0
    assert angle - ANGLE.noise < 9.8


# ---------------------------------------------------------------------------------- two legs


@pytest.mark.parametrize("seed", SEEDS)
def test_pairs_of_phases_reached_by_two_random_legs_are_predicted(seed: int) -> None:
    case = random_case(seed)
    table, generator = case.table, np.random.default_rng(seed)
    vectors = Vectors(table, generator, 2000)
    known = set(reachable_pairs(case))
    for episode, start in enumerate(starting_pairs(case)):
        legs = [
            GaitStateMachine(table, side, initial_phase=name) for side, name in zip(Side, start, strict=True)
        ]
        for tick in range(episode * 500, episode * 500 + 500):
            phases = [leg.phase for leg in legs]
            assert (min(phases), max(phases)) in known
            times = [leg.time_in_phase(tick - episode * 500) for leg in legs]
            for own, leg in enumerate(legs):
                signals = {**vectors.at(tick, seen_by_other=own == 1), OTHER_TIME: times[1 - own]}
                leg.step(tick - episode * 500, signals, phases[1 - own])


def test_random_legs_reach_new_pairs() -> None:
    entered = [len(reachable_pairs(random_case(seed))) for seed in SEEDS]
    assert sum(entered) > len(SEEDS) * len(PHASES)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_random_vector_opens_an_exit_of_a_deadlock(seed: int) -> None:
    case = random_case(seed)
    table = case.table
    vectors = Vectors(table, np.random.default_rng(seed), 20_000)
    reasons = " ".join(item.reason for item in deadlock(case))
    for pair in reachable_pairs(case):
        stuck = f"one leg in {pair[0]} and the other in {pair[1]} " in reasons
        for own, other in (pair, pair[::-1]):
            in_phase = vectors.others == table.phase_index(other)
            leaving = [item for item in table.transitions if item.source == own]
            gone = any((vectors.due(item) & in_phase).any() for item in leaving if item.debounce_ticks == 1)
            assert not (stuck and gone)


# ---------------------------------------------------------------------------------- the solver


@cache
def plain_space() -> SignalSpace:
    limits = {joint: (math.radians(low), math.radians(high)) for joint, (low, high, _) in TWIN.items()}
    return SignalSpace(CheckCase(table=random_table(0), experiment=None, limits=limits))


def first_point(*texts: str) -> SignalPoint | None:
    point = plain_space().first([guard(text) for text in texts], {TIME: (TICK, 1.0)})
    assert point is None or opens(texts, point)
    return point


def opens(texts: Sequence[str], point: SignalPoint) -> bool:
    return all(holds(guard(text), point.signals, None) for text in texts)


@pytest.mark.parametrize(
    ("texts", "possible"),
    [
        (["hip.angle_deg > 10", "hip.angle_deg < 10"], False),
        (["hip.angle_deg > 10", "hip.angle_deg < 10.001"], True),
        (["hip.angle_deg > 110"], False),
        (["hip.angle_deg > 109.999"], True),
        (["hip.angle_deg < -20"], False),
        (["other.hip.angle_deg - hip.angle_deg > 130"], False),
        (["other.hip.angle_deg - hip.angle_deg > 129.9"], True),
        (["other.hip.angle_deg - hip.angle_deg > 5", "hip.angle_deg - other.hip.angle_deg > 5"], False),
        (["hip.angle_deg - hip.angle_deg > 0"], False),
        (["hip.angle_deg - hip.angle_deg > -1"], True),
        (["foot.load_bw < 0"], False),
        (["foot.load_bw < 0.001"], True),
        # Times are whole ticks: none lies between 50 and 51 ms.
        (["time_in_phase_s > 0.05", "time_in_phase_s < 0.051"], False),
        (["time_in_phase_s > 0.05", "time_in_phase_s < 0.0511"], True),
        (["time_in_phase_s > 1.0"], False),
        (["time_in_phase_s > 0.9991"], True),
    ],
)
def test_points_are_found_exactly_where_inequalities_overlap(texts: list[str], possible: bool) -> None:
    assert (first_point(*texts) is not None) is possible


def test_point_keeps_a_margin_if_the_inequalities_leave_one() -> None:
    wide, narrow = first_point("hip.angle_deg > 10"), first_point("hip.angle_deg > 10", "hip.angle_deg < 11")
    assert wide is not None and wide.signals == {"hip.angle_deg": 11.0}
    assert narrow is not None and 10.0 < narrow.signals["hip.angle_deg"] < 11.0


def ways_of(tree: Guard, phases: tuple[str | None, ...], true: bool) -> list[Case]:
    """Return all alternatives to open or close a guard, including contradictory ones."""
    return list(
        enumerate_cases(
            Case(phases),
            [Requirement(tree, true)],
            lambda *atom: [comparison_bound(*atom)],
            lambda bounds: True,
        )
    )


@pytest.mark.parametrize("seed", range(40))
def test_open_and_closed_alternatives_of_a_guard_equal_its_tree(seed: int) -> None:
    generator = np.random.default_rng(seed)
    tree = random_guard(generator)
    forms = [ways_of(tree, PHASES, true) for true in (True, False)]
    table = random_table(0)
    vectors = Vectors(table, generator, 300)
    for index in range(vectors.count):
        values = {name: float(array[index]) for name, array in vectors.signals.items()}
        other = table.phase_names[vectors.others[index]]
        found = [any(_goes(way, {**values, ZERO: 0.0}, other) for way in form) for form in forms]
        true = holds(tree, values, other)
        assert found == [true, not true]


def _goes(way: Case, values: dict[str, float], other: str) -> bool:
    return other in way.phases and all(item.is_satisfied(values) for item in way.bounds)


def test_absent_leg_opens_no_condition_on_it() -> None:
    for text in (
        "other.hip.angle_deg < 1000",
        "other.phase in [a]",
        "hip.angle_deg - other.hip.angle_deg < 999",
    ):
        assert ways_of(guard(text), (None,), True) == []
        assert len(ways_of(guard(text), (None,), False)) == 1


def test_guard_with_too_many_alternatives_is_refused_in_one_line() -> None:
    pair = AnyOf(guards=(guard("hip.angle_deg < 1"), guard("knee.angle_deg < 1")))
    pairs = math.ceil(math.log2(MAX_BRANCHES)) + 1
    with raises(GaitTableError, MAX_BRANCHES):
        ways_of(AllOf(guards=(pair,) * pairs), PHASES, True)


# ---------------------------------------------------------------------------------- time


def space_of(*transitions: Transition, change: Callable[[Any], Any] = lambda phases: phases) -> SignalSpace:
    phases = change({name: phase() for name in PHASES})
    table = GaitTable(name="t", joints=JOINTS, phases=phases, transitions=transitions)
    return SignalSpace(build_case(table))


def leaving(text: str, **changes: Any) -> Transition:
    return Transition(source="a", target="b", cause="go", guard=guard(text), **changes)


TIME_OUT = Transition(source="a", target="b", cause="timeout", timeout_ticks=500)


@pytest.mark.parametrize(
    ("text", "changes", "opens", "fires"),
    [
        ("hip.angle_deg > 5", {"debounce_ticks": 499}, True, True),
        ("hip.angle_deg > 5", {"debounce_ticks": 500}, True, True),
        ("hip.angle_deg > 5", {"debounce_ticks": 501}, True, False),
        ("time_in_phase_s > 0.3", {"debounce_ticks": 200}, True, True),
        ("time_in_phase_s > 0.3", {"debounce_ticks": 201}, True, False),
        ("time_in_phase_s < 0.1", {"debounce_ticks": 99}, True, True),
        ("time_in_phase_s < 0.1", {"debounce_ticks": 100}, True, False),
        ("time_in_phase_s > 0.5", {}, False, False),
        ("hip.angle_deg > 5", {"timeout_ticks": 501}, False, False),
        ("hip.angle_deg > 5", {"timeout_ticks": 500}, True, True),
    ],
)
def test_timeout_and_debounce_limit_when_an_exit_can_fire(
    text: str, changes: dict[str, Any], opens: bool, fires: bool
) -> None:
    space = space_of(leaving(text, **changes), TIME_OUT)
    assert (space.opening(0) is not None) is opens
    assert space.can_fire(0) is fires


def test_exit_that_needs_time_is_not_open_at_entry() -> None:
    into = Transition(source="b", target="a", cause="in", guard=guard("hip.angle_deg > 5"))
    for text, found in (("time_in_phase_s > 0.05", 0), ("time_in_phase_s > 0.0005", 1)):
        out = AllOf(guards=(guard("hip.angle_deg > 8"), guard(text)))
        table = space_of(into, Transition(source="a", target="b", cause="out", guard=out)).table
        assert len([item for item in cascade(build_case(table)) if item.phase == "a"]) == found
