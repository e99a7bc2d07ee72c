"""Guards of a gait table: their grammar and their tree.

A guard is a strict linear inequality over one measured signal or the difference of two, a phase
membership of the other leg, or ``all`` / ``any`` of guards. Thresholds are converted to SI here,
once; :mod:`twin_gait.core.guards` evaluates what comes out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from twin_gait.exceptions import GaitTableError
from twin_gait.gait.signals import (
    DEVICE_NAMES,
    MODE_SIGNALS,
    all_signal_names,
    mode_signal_names,
    signal_names,
    signal_of,
)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A strict inequality ``signal [- minus] (< or >) threshold`` in the units of the table."""

    signal: str  # name of the signal, for example ``other.hip.angle_deg``
    minus: str | None  # name of a signal that is subtracted, or None
    operator: str  # ``"<"`` or ``">"``
    threshold: float  # in the unit that the signal's name carries

    def __post_init__(self) -> None:
        """Check operator and threshold."""
        if self.operator not in ("<", ">"):
            raise GaitTableError(f"guard on {self.signal}: expected '<' or '>', got {self.operator!r}")
        if not math.isfinite(self.threshold):
            raise GaitTableError(f"guard on {self.signal}: expected a finite threshold, got {self.threshold}")

    def __str__(self) -> str:
        """Write the inequality as in the table."""
        left = self.signal if self.minus is None else f"{self.signal} - {self.minus}"
        short = f"{self.threshold:g}"
        exact = short if float(short) == self.threshold else repr(self.threshold)
        return f"{left} {self.operator} {exact}"


@dataclass(frozen=True, kw_only=True)
class PhaseMembership:
    """The other leg is in one of some phases; in a table of modes, one of some requests is made."""

    phases: tuple[str, ...]  # names of the phases, or of the requests
    of: str = "other.phase"  # what is looked at, as the table writes it

    def __str__(self) -> str:
        """Write the membership as in the table."""
        return f"{self.of} in [{', '.join(self.phases)}]"


@dataclass(frozen=True, kw_only=True)
class AllOf:
    """Every one of some guards holds."""

    guards: tuple[Guard, ...]  # the guards; an empty conjunction is true (a transition with a time-out only)

    def __str__(self) -> str:
        """Write the conjunction."""
        return " and ".join(_bracketed(guard) for guard in self.guards) or "true"


@dataclass(frozen=True, kw_only=True)
class AnyOf:
    """At least one of some guards holds."""

    guards: tuple[Guard, ...]  # the guards, at least one

    def __post_init__(self) -> None:
        """Check that there is a guard."""
        if not self.guards:
            raise GaitTableError("any: expected at least one guard, got none; it could never open")

    def __str__(self) -> str:
        """Write the disjunction."""
        return " or ".join(_bracketed(guard) for guard in self.guards)


Guard = Comparison | PhaseMembership | AllOf | AnyOf


def atoms(guard: Guard) -> Iterator[Comparison | PhaseMembership]:
    """Comparisons and memberships of a guard in the order in which they are written and compiled."""
    if isinstance(guard, (AllOf, AnyOf)):
        for inner in guard.guards:
            yield from atoms(inner)
    else:
        yield guard


def mapped(guard: Guard, change: Callable[[Comparison | PhaseMembership], Guard]) -> Guard:
    """The same tree with each of its comparisons and memberships changed."""
    if isinstance(guard, (AllOf, AnyOf)):
        return replace(guard, guards=tuple(mapped(inner, change) for inner in guard.guards))
    return change(guard)


def _bracketed(guard: Guard) -> str:
    return f"({guard})" if isinstance(guard, (AllOf, AnyOf)) else str(guard)


_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SIGNAL = r"[A-Za-z_][\w.]*"
_COMPARISON = re.compile(rf"\s*({_SIGNAL})\s*(?:-\s*({_SIGNAL})\s*)?(<=|>=|<|>|==|=)\s*({_NUMBER})\s*")
_MEMBERSHIP = re.compile(rf"\s*({_SIGNAL})\s+in\s*\[([^\]]*)\]\s*")


class GuardWords(NamedTuple):
    """What the guards of a kind of table may read."""

    of: str  # what a membership looks at
    member: str  # what its members are
    # from the joints to the names of all signals, in the order of the list of signals
    signals: Callable[[Sequence[str]], list[str]]
    listed: Callable[[Sequence[str]], str]  # from the joints to these in words


LEG_WORDS = GuardWords(
    "other.phase",
    "phase",
    all_signal_names,
    lambda joints: (
        f"{', '.join(signal_names(joints))}, the same with 'other.' in front, and {', '.join(DEVICE_NAMES)}"
    ),
)
MODE_WORDS = GuardWords(
    "request",
    "request",
    mode_signal_names,
    lambda joints: (
        f"{', '.join(signal.name for signal in MODE_SIGNALS)}, and with 'left.' or 'right.' in front "
        f"{', '.join(signal_names(joints))}"
    ),
)


def parse_guard(
    text: str, joints: Sequence[str], phases: Sequence[str], words: GuardWords = LEG_WORDS
) -> Guard:
    """Parse one guard, such as ``other.hip.angle_deg > 10`` or ``other.phase in [early_stance]``.

    ``phases``: what a membership may name. ``words``: what guards may read. Raises GaitTableError if the text
    is not a guard, or names an unknown signal or phase.
    """
    membership = _MEMBERSHIP.fullmatch(text)
    if membership and membership.group(1) == words.of:
        members = tuple(name.strip() for name in membership.group(2).split(",") if name.strip())
        if not members:
            raise GaitTableError(f"guard {text!r}: expected at least one {words.member} in the brackets")
        for name in members:
            if name not in phases:
                there = ", ".join(phases)
                raise GaitTableError(f"guard {text!r}: no {words.member} {name!r}; there are {there}")
        return PhaseMembership(phases=members, of=words.of)
    comparison = _COMPARISON.fullmatch(text)
    if not comparison:
        raise GaitTableError(
            f"guard {text!r}: expected 'signal < number', 'signal - signal > number' "
            f"or '{words.of} in [{words.member}, …]'"
        )
    signal, minus, operator, number = comparison.groups()
    if operator not in ("<", ">"):
        raise GaitTableError(f"guard {text!r}: inequalities are strict; write '<' or '>'")
    known = words.signals(joints)
    for name in (signal, minus):
        if name is not None and name not in known:
            raise GaitTableError(f"guard {text!r}: no signal {name!r}; there are {words.listed(joints)}")
    if minus is not None and signal_of(signal).unit != signal_of(minus).unit:
        units = " and ".join(signal_of(name).unit.words for name in (signal, minus))
        raise GaitTableError(f"guard {text!r}: {signal} and {minus} have different units: {units}")
    if not math.isfinite(float(number)):
        raise GaitTableError(f"guard {text!r}: the threshold is not a finite number")
    return Comparison(signal=signal, minus=minus, operator=operator, threshold=float(number))
