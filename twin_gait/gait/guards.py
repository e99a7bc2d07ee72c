"""Guards of a gait table: their grammar and their tree.

A guard is a strict linear inequality over one measured signal or the difference of two, a phase membership of
the other leg, or ``all`` / ``any`` of guards. :mod:`twin_gait.gait.program` converts thresholds to SI once;
:mod:`twin_gait.core.guards` evaluates the result.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from twin_gait.exceptions import GaitTableError
from twin_gait.gait.signals import all_signal_names, find_signal, mode_signal_names


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A strict inequality ``signal [- minus] (< or >) threshold`` in the units of the table."""

    signal: str  # Name of the signal, for example ``other.hip.angle_deg``.
    minus: str | None  # Name of a signal that is subtracted, or None.
    operator: str  # Operator, ``"<"`` or ``">"``.
    threshold: float  # Threshold in the unit that the signal's name ends with.

    def __post_init__(self) -> None:
        """Check operator and threshold."""
        if self.operator not in ("<", ">") or not math.isfinite(self.threshold):
            got = f"{self.operator!r} {self.threshold}"
            raise GaitTableError(f"expected '<' or '>', which are strict, and a finite threshold, got {got}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals that the comparison reads."""
        return (self.signal,) if self.minus is None else (self.signal, self.minus)

    def __str__(self) -> str:
        """Write the inequality as in the table."""
        short = f"{self.threshold:g}"
        exact = short if float(short) == self.threshold else repr(self.threshold)
        return f"{' - '.join(self.names)} {self.operator} {exact}"


@dataclass(frozen=True, kw_only=True)
class PhaseMembership:
    """Condition that the other leg is in one of some phases.

    In a table of modes it is the condition that one of some requests is made.
    """

    phases: tuple[str, ...]  # Names of the phases, or of the requests.
    quantity: str = "other.phase"  # Quantity that is tested, in the notation of the table.

    def __str__(self) -> str:
        """Write the membership as in the table."""
        return f"{self.quantity} in [{', '.join(self.phases)}]"


@dataclass(frozen=True, kw_only=True)
class AllOf:
    """Condition that all of some guards are true."""

    guards: tuple[Guard, ...]  # The guards; an empty conjunction is true (a transition with a timeout only).

    def __str__(self) -> str:
        """Write the conjunction."""
        return " and ".join(bracket_guard(guard) for guard in self.guards) or "true"


@dataclass(frozen=True, kw_only=True)
class AnyOf:
    """Condition that at least one of some guards is true."""

    guards: tuple[Guard, ...]  # The guards, at least one.

    def __post_init__(self) -> None:
        """Check that there is a guard."""
        if not self.guards:
            raise GaitTableError("any: expected at least one guard, got none; it would never open")

    def __str__(self) -> str:
        """Write the disjunction."""
        return " or ".join(bracket_guard(guard) for guard in self.guards)


Atom = Comparison | PhaseMembership
Guard = Atom | AllOf | AnyOf


def atoms(guard: Guard) -> Iterator[Atom]:
    """Yield the comparisons and memberships of a guard in the order in which they are written."""
    if isinstance(guard, (AllOf, AnyOf)):
        for inner in guard.guards:
            yield from atoms(inner)
    else:
        yield guard


def compared_signals(guard: Guard) -> list[str]:
    """Return the signals that a guard reads, each once."""
    read = (name for atom in atoms(guard) if isinstance(atom, Comparison) for name in atom.names)
    return list(dict.fromkeys(read))


def map_atoms(guard: Guard, change: Callable[[Atom], Guard]) -> Guard:
    """Return the same tree with each of its comparisons and memberships replaced by ``change``."""
    if isinstance(guard, (AllOf, AnyOf)):
        return replace(guard, guards=tuple(map_atoms(inner, change) for inner in guard.guards))
    return change(guard)


def bracket_guard(guard: Guard, words: Callable[[Guard], str] = str) -> str:
    """Format a guard within another one as text, in brackets if it has parts itself."""
    return f"({words(guard)})" if isinstance(guard, (AllOf, AnyOf)) else words(guard)


_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SIGNAL = r"[A-Za-z_][\w.]*"
_COMPARISON = re.compile(rf"\s*({_SIGNAL})\s*(?:-\s*({_SIGNAL})\s*)?([<>])\s*({_NUMBER})\s*")
_MEMBERSHIP = re.compile(rf"\s*({_SIGNAL})\s+in\s*\[([^\]]*)\]\s*")


class GuardVocabulary(NamedTuple):
    """Vocabulary of the guards of a kind of table."""

    quantity: str  # Quantity that a membership tests.
    member: str  # Name of a member in messages: a phase, or a request.
    # Function from the joints to the names of all signals, in the order of the list of signals.
    signals: Callable[[tuple[str, ...]], tuple[str, ...]]

    def find_problem(self, atom: Atom, joints: tuple[str, ...], members: Sequence[str]) -> str:
        """Describe why a condition is invalid for some joints and members; empty if it is valid."""
        if isinstance(atom, PhaseMembership):
            subject, known, tested = self.member, members, atom.phases
        else:
            subject, known, tested = "signal", self.signals(joints), atom.names
        for name in tested:
            if name not in known:
                return f"there is no {subject} {name!r}; expected one of {', '.join(known)}"
        if isinstance(atom, PhaseMembership) or atom.minus is None:
            return ""
        units = [find_signal(name).unit.name for name in tested]
        mixed = f"{' and '.join(tested)} have different units: {' and '.join(units)}"
        return mixed if len(set(units)) > 1 else ""


LEG_VOCABULARY = GuardVocabulary("other.phase", "phase", all_signal_names)
MODE_VOCABULARY = GuardVocabulary("request", "request", mode_signal_names)


def parse_guard(text: str, vocabulary: GuardVocabulary = LEG_VOCABULARY) -> Atom:
    """Parse one guard, such as ``other.hip.angle_deg > 10`` or ``other.phase in [early_stance]``.

    ``vocabulary``: vocabulary of the guards; whether the named signals and members exist is checked by the
    table.
    Raises GaitTableError if the text is not a guard.
    """
    membership = _MEMBERSHIP.fullmatch(text)
    if membership and membership[1] == vocabulary.quantity:
        members = tuple(name.strip() for name in membership[2].split(",") if name.strip())
        if not members:
            raise GaitTableError(f"guard {text!r}: expected at least one {vocabulary.member} in the brackets")
        return PhaseMembership(phases=members, quantity=vocabulary.quantity)
    comparison = _COMPARISON.fullmatch(text)
    if not comparison or math.isinf(float(comparison[4])):
        raise GaitTableError(
            f"guard {text!r}: expected a strict 'signal < number' or 'signal - signal > number', or "
            f"'{vocabulary.quantity} in [{vocabulary.member}, …]', with finite numbers"
        )
    signal, minus, operator, number = comparison.groups()
    return Comparison(signal=signal, minus=minus, operator=operator, threshold=float(number))
