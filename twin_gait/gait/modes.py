"""The operating modes of the device: one more state machine over the grammar of gait tables.

A mode is a phase of the supervisor. It sets the commands for both legs, to walk or to stand and to step or to
wait, and may send them into a phase of their gait table at once. The request takes the place of the other
leg's phase in guards: a request of a schedule, a live panel or the therapist's tablet, made for one tick.
:mod:`twin_gait.control.supervisor` runs a table of modes.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from twin_gait.core.guards import evaluate_guard
from twin_gait.exceptions import ParameterError
from twin_gait.gait import guards
from twin_gait.gait.program import compile_guards
from twin_gait.gait.signals import TIME
from twin_gait.gait.table import MAX_PHASES, TICK, StateParameters, StateTable, Transition, raise_if


@dataclass(frozen=True, kw_only=True)
class Mode(StateParameters):
    """Settings of one mode.

    Attributes:
        posture: Phase of the legs' gait table that both legs enter when the mode begins, unless they are in
            it; None if their own guards keep determining the phases.
        walk: Whether the legs receive the command to walk, signal ``walk``, or to stand.
        step: Whether the legs receive the command to take a step, signal ``step``, or to wait for one.
    """

    posture: str | None = None
    walk: bool = False
    step: bool = False


@dataclass(frozen=True, kw_only=True)
class ModeTable(StateTable):
    """Operating modes, and the transitions between them."""

    phases: Mapping[str, Mode]  # Modes by name; the device begins in the first one.
    requests: tuple[str, ...]  # Names of the requests that can be made; may be empty.
    hold: str  # Mode of the device after a trip of the safety monitor; it is not left.

    vocabulary: ClassVar[guards.GuardVocabulary] = guards.MODE_VOCABULARY
    kind: ClassVar[str] = "mode"

    def _check_phases(self) -> None:
        raise_if(len(self.requests) > MAX_PHASES, f"requests: expected at most {MAX_PHASES} requests")
        for name in self.requests:
            raise_if(not re.fullmatch(r"[A-Za-z_]\w*", name), f"requests: expected a word, got {name!r}")
            raise_if(self.requests.count(name) > 1, f"requests: {name} is given twice; leave one out")
        self._check_known("hold", self.hold)
        starts_held = f"hold: the device cannot start in {self.hold}; put another mode first under modes"
        raise_if(self.hold == self.phase_names[0], starts_held)
        left = {item.source for item in self.transitions}
        for mode in self.phases:
            stuck = mode not in (*left, self.hold)
            raise_if(stuck, f"modes.{mode}: no transition leaves it; add one to transitions")

    def _check_transition(self, location: str, item: Transition) -> None:
        super()._check_transition(location, item)
        out_of_hold = f"{location}: a trip is final, so no transition may leave {self.hold}; remove it"
        raise_if(item.source == self.hold, out_of_hold)
        late = f"{location}: a request lasts one tick and cannot have a debounce of {item.debounce_ticks} ms"
        raise_if(item.debounce_ticks > 1 and _transition_requests(item), f"{late}; leave debounce_ms out")

    @cached_property
    def members(self) -> tuple[str, ...]:
        """Names of the requests; the code of a request is its position, counted from 1."""
        return self.requests

    @property
    def externally_entered(self) -> tuple[str, ...]:
        """The hold mode, which the monitor enters."""
        return (self.hold,)

    def waits_for_step(self, mode: str) -> bool:
        """Check whether legs that walk in a mode wait for a request to take a step."""
        here, leads = self.phases[mode], (item for item in self.transitions if item.source == mode)
        return (
            here.walk
            and not here.step
            and any(_transition_requests(item) and self.phases[item.target].step for item in leads)
        )


def _transition_requests(item: Transition) -> set[str]:
    """Return the requests that a transition reads."""
    atoms = guards.atoms(item.guard)
    return {name for atom in atoms if isinstance(atom, guards.PhaseMembership) for name in atom.phases}


_TIMED = re.compile(r"\s*(\w+)\s*@\s*(\d{1,9}(?:\.\d{0,9})?|\.\d{1,9})\s*s\s*")


@dataclass(frozen=True)
class TimedRequest:
    """A request at a given time."""

    name: str  # Name of the request.
    ticks: int  # Time of the request in ticks of 1 [ms].

    def __str__(self) -> str:
        """Write the request in its notation."""
        return f"{self.name}@{self.ticks * TICK:g}s"


def parse_request(text: str) -> TimedRequest:
    """Parse a request in its notation, for example ``walk@2.5s``; raise ParameterError if it is invalid."""
    match = _TIMED.fullmatch(text)
    if match is None:
        raise ParameterError(f"request {text!r}: expected REQUEST@TIMEs, for example walk@2.5s")
    return TimedRequest(match[1], round(float(match[2]) / TICK))


def check_requests(requests: tuple[TimedRequest, ...], modes: ModeTable | None) -> None:
    """Check that requests exist and come one at a time; raise ParameterError if not."""
    known = () if modes is None else modes.requests
    ticks = [item.ticks for item in requests]
    for item in requests:
        if item.name not in known:
            there = ", ".join(known) or "none without modes; give modes, such as twin"
            raise ParameterError(f"request {item}: there is no such request; the requests are {there}")
        if ticks.count(item.ticks) > 1:
            problem = "there is another request in the same tick; choose another time"
            raise ParameterError(f"request {item}: {problem}")


def rejection_reason(
    table: ModeTable, mode: str, request: str, signals: Mapping[str, float], ticks: int
) -> str | None:
    """Describe the unmet conditions of each transition for a request; None if one of them is fulfilled.

    ``signals``: values in the units of a table; missing ones are 0. ``ticks``: number of ticks since the mode
    was entered.
    """
    leaving = [(item, _transition_requests(item)) for item in table.transitions if item.source == mode]
    answers = [item for item, requests in leaving if request in requests]
    if not answers:
        known = [name for name in table.requests if any(name in requests for _, requests in leaving)]
        possible = ", ".join(known) or "none"
        return f"{request} is not possible in the mode {mode}; possible requests: {possible}"
    measured = {**dict.fromkeys(table.signals, 0.0), **signals, TIME: ticks * TICK}
    values, member, program = table.to_si(measured), table.member_index(request), compile_guards(table)
    missing = []
    for item in answers:
        rule, lacks = program.transitions[table.transitions.index(item)], []
        least = max(table.phases[mode].minimum_ticks, item.timeout_ticks or 0)
        if ticks < least:
            lacks.append(f"{mode} has lasted {ticks * TICK:g} s, less than {least * TICK:g} s")
        if not evaluate_guard(program, rule.first_node, rule.end_node, values, member):
            lacks.append(f"{item.guard} is not true")
            lacks += [f"{name} is {measured[name]:.4g}" for name in guards.compared_signals(item.guard)]
        missing.append(lacks)
    return None if [] in missing else "; or ".join(", ".join(lacks) for lacks in missing)
