"""What two legs on one table can get into together, with free signals."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from twin_gait.checking.ambiguity import can_fire, opening
from twin_gait.checking.finding import Finding, Severity, Subject, label
from twin_gait.checking.polyhedra import TIME, Clause, both
from twin_gait.checking.signals import OTHER_PHASE, OTHER_TIME, Point, SignalSpace, swapped
from twin_gait.scenario.treadmill import TreadmillScenario
from twin_gait.vocabulary import GaitPhase

Pair = tuple[str, str]


class Step(NamedTuple):
    """How a pair of phases is entered.

    Attributes:
        before: The pair before.
        taken: Transitions that are taken in one tick, of the first leg or of both.
        witness: Signals of the first leg and the other that open them.
    """

    before: Pair
    taken: tuple[int, ...]
    witness: dict[str, float | str]


def is_swing(phase: str) -> bool:
    """Whether the foot is meant to be in the air in a phase, by its name."""
    if phase in set(GaitPhase):
        return not GaitPhase(phase).is_stance
    return "swing" in phase.lower()


def starting_pairs(subject: Subject) -> list[Pair]:
    """Pairs of phases that two legs can start in.

    Those of a treadmill; else one leg in the first phase of the table and the other in any stance.
    """
    table = subject.table
    scenario = None if subject.experiment is None else subject.experiment.scenario
    if isinstance(scenario, TreadmillScenario) and set(scenario.initial_phases) <= set(table.phases):
        return [scenario.initial_phases]
    first = table.phase_names[0]
    return [(first, phase) for phase in table.phases if not is_swing(phase)] or [(first, first)]


class TwoLegs:
    """Pairs of phases that two legs reach with free signals; the order of the legs does not matter.

    Both legs read one snapshot, ``other.phase`` is that before the tick, and each takes at most one
    transition in a tick.

    Attributes:
        space: Signals of the table.
        entered: How each pair is entered first; None for the pairs that the legs start in.
    """

    def __init__(self, subject: Subject) -> None:
        """Search all pairs breadth first."""
        self.space = SignalSpace(subject)
        self._fires = [can_fire(self.space, index) for index in range(len(self.space.table.transitions))]
        self._single: dict[tuple[int, str], dict[str, float | str] | None] = {}
        self.entered: dict[Pair, Step | None] = {}
        waiting: deque[Pair] = deque()
        for pair in starting_pairs(subject):
            if _sorted(pair) not in self.entered:
                self.entered[_sorted(pair)] = None
                waiting.append(_sorted(pair))
        while waiting:
            for pair, step in self._steps(waiting.popleft()):
                self.entered[pair] = step
                waiting.append(pair)

    def _steps(self, pair: Pair) -> Iterator[tuple[Pair, Step]]:
        """Pairs that are entered from a pair and have not been before."""
        for own, other in ((pair[0], pair[1]), (pair[1], pair[0])):
            for index in self.space.exits(own):
                target = _sorted((self.space.transition(index).target, other))
                witness = self.can_leave(index, other)
                if target not in self.entered and witness is not None:
                    yield target, Step((own, other), (index,), witness)
        for first, second in itertools.product(self.space.exits(pair[0]), self.space.exits(pair[1])):
            target = _sorted((self.space.transition(first).target, self.space.transition(second).target))
            if target not in self.entered:
                witness = self._together(first, second)
                if witness is not None:
                    yield target, Step(pair, (first, second), witness)

    def can_leave(self, index: int, other: str) -> dict[str, float | str] | None:
        """Signals that open a transition while the other leg is in a phase; None if there are none."""
        if (index, other) not in self._single:
            found = opening(self.space, index, frozenset({other})) if self._fires[index] else None
            self._single[index, other] = (
                None if found is None else {**self.space.witness(found[0], [found[1]]), OTHER_PHASE: other}
            )
        return self._single[index, other]

    def lifts_in_swing(self, index: int) -> Step | None:
        """How a transition can be taken while the other leg swings; None if it cannot."""
        source = self.space.transition(index).source
        for other in self.space.table.phase_names:
            witness = self.can_leave(index, other) if _sorted((source, other)) in self.entered else None
            if is_swing(other) and witness is not None:
                return Step((source, other), (index,), witness)
        return None

    def lifts_together(self, index: int, others: Sequence[int]) -> Step | None:
        """How a transition can be taken in the tick in which the other leg takes one of some."""
        for second in others:
            pair = self.space.transition(index).source, self.space.transition(second).source
            witness = self._together(index, second) if _sorted(pair) in self.entered else None
            if witness is not None:
                return Step(pair, (index, second), witness)
        return None

    def _together(self, first: int, second: int) -> dict[str, float | str] | None:
        """Signals that open a transition of either leg in the same tick."""
        own, other = self.space.transition(first).source, self.space.transition(second).source
        if self.can_leave(first, other) is None or self.can_leave(second, own) is None:
            return None
        times = {TIME: self.space.window(first), OTHER_TIME: self.space.window(second)}

        def holds(point: Point) -> bool:
            mirrored = {swapped(name): value for name, value in point.signals.items()}
            return self.space.is_open(first, point) and self.space.is_open(second, Point(mirrored, own))

        for one, two in itertools.product(self.space.clauses(first), self.space.clauses(second)):
            if other not in one.others or own not in two.others:
                continue
            there = frozenset[str | None]({other})
            clause = Clause(both(one, two.renamed(swapped)).inequalities, there)
            point = self.space.find(clause.inequalities, there, times, holds)
            if point is not None:
                return {**self.space.witness(point, [clause]), OTHER_PHASE: other}
        return None


def _sorted(pair: Pair) -> Pair:
    return min(pair), max(pair)


def both_in_swing(subject: Subject) -> list[Finding]:
    """Both legs can be in swing at once under free signals.

    An error if the experiment has two legs or a guard reads the other leg; a warning if the table knows
    nothing of another leg and may be meant for one; a note if no phase is swing by its name, so that
    there is nothing to look for.

    Args:
        subject: What is checked.

    Returns:
        A finding for each transition out of stance that can begin it, with signals that open it.
    """
    if not subject.has_other_leg:
        return []
    if not any(map(is_swing, subject.table.phases)):
        return [_nothing_swings()]
    legs = TwoLegs(subject)
    lifting = [
        index
        for index, item in enumerate(subject.table.transitions)
        if not is_swing(item.source) and is_swing(item.target)
    ]
    findings = {}
    for index in lifting:
        step = legs.lifts_in_swing(index) or legs.lifts_together(index, lifting)
        if step is not None:
            findings[index] = _both_lifted(legs, step)
    return list(findings.values())


def _nothing_swings() -> Finding:
    return Finding(
        rule="both_in_swing",
        severity=Severity.NOTE,
        reason="no phase is swing by its name, so whether both legs can swing at once is not known",
        suggestion="let the names of the phases of swing contain the word",
    )


def _both_lifted(legs: TwoLegs, step: Step) -> Finding:
    taken = [legs.space.transition(index) for index in step.taken]
    own, other = step.before
    sure = legs.space.subject.experiment is not None or _reads_other(legs.space.subject)
    names = " and ".join(dict.fromkeys(label(item) for item in taken))
    together = " in the same tick" if len(taken) > 1 else ""
    return Finding(
        rule="both_in_swing",
        severity=Severity.ERROR if sure else Severity.WARNING,
        phase=own,
        transition=label(taken[0]),
        reason=f"with one leg in {own} and the other in {other}, {names} can bring both into swing{together}",
        suggestion="add other.phase in [phases of stance] to it, and let one leg be ahead",
        witness=step.witness,
    )


def _reads_other(subject: Subject) -> bool:
    return any("other." in str(item.guard) for item in subject.table.transitions)


def deadlock(subject: Subject) -> list[Finding]:
    """Two legs can reach a pair of phases in which neither can ever go on, whatever is measured.

    Args:
        subject: What is checked.

    Returns:
        A finding for each such pair.
    """
    if not subject.has_other_leg or len(subject.table.phases) == 1:
        return []
    legs = TwoLegs(subject)
    return [
        Finding(
            rule="deadlock",
            severity=Severity.ERROR,
            phase=first,
            reason=f"with one leg in {first} and the other in {second} no signals ever let either go on",
            suggestion=f"let {first} or {second} be left in this case too, or give one a time-out",
        )
        for first, second in legs.entered
        if not any(
            legs.can_leave(index, other) is not None
            for own, other in ((first, second), (second, first))
            for index in legs.space.exits(own)
        )
    ]


RULES = (both_in_swing, deadlock)
