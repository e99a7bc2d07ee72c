"""Symbols that record the operations on them as straight-line Python.

A :class:`Symbol` behaves like a number; every operation on it appends a line to its
:class:`Trace`. Constants are folded, zeros and ones are removed and equal sub-expressions are shared, so
that one run of a generic rigid-body algorithm over symbols leaves only the arithmetic that one model
needs.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from twin_gait.core.elementary import sine_cosine


class TraceStep(NamedTuple):
    """Step of an algorithm for one body, with the comment of its lines and the names of its results."""

    comment: str = ""
    quantity: str = "term"
    joint_name: str = ""  # Name of the joint; empty for the world.

    def result(self, quantity: str) -> str:
        """Return the name of a result without its number, in characters that Python and C accept."""
        name = f"{quantity}_{self.joint_name or 'world'}"  # Never the name of an input, such as torque.
        return re.sub(r"\W", "_", name, flags=re.ASCII)[:_LONGEST_NAME]


class Trace:
    """Lines of straight-line Python that have been recorded so far.

    Attributes:
        lines: Assignments in order.
        block: Present step of the algorithm.
        blocks: Step in which a name was assigned first, by name.
        labels: Readable name of each name without its number.
    """

    def __init__(self) -> None:
        """Begin an empty trace."""
        self.lines: list[str] = []
        self.block = TraceStep()
        self.blocks: dict[str, TraceStep] = {}
        self.labels: dict[str, str] = {}
        self._known: dict[tuple[str, ...], list[Symbol]] = {}
        self._count = 0

    def input(self, expression: str) -> Symbol:
        """Return a symbol for an expression that exists already, such as ``q[0]``."""
        return Symbol(self, expression)

    def combined(self, first: Scalar, operator: str, second: Scalar) -> Symbol:
        """Append a binary operation on two numbers, at least one of them a symbol, and return its symbol."""
        left, right = scalar_source(first), scalar_source(second)
        operands = sorted((left, right)) if operator in "+*" else (left, right)
        (result,) = self.emit((operator, *operands), f"{left} {operator} {right}")
        return result

    def call(self, function: str, arguments: Sequence[Scalar], outputs: Sequence[str]) -> list[Symbol]:
        """Append a call of a function and return symbols of its results; ``outputs``: their quantities."""
        given = [scalar_source(item) for item in arguments]
        return self.emit((function, *given), f"{function}({', '.join(given)})", outputs)

    def emit(self, key: tuple[str, ...], expression: str, outputs: Sequence[str] = ()) -> list[Symbol]:
        """Append an assignment, unless the same expression was recorded before, and return its symbols."""
        if key not in self._known:
            quantities = outputs or (self.block.quantity,)
            names = [f"t{self._count + index}" for index in range(len(quantities))]
            self._count += len(names)
            for name, quantity in zip(names, quantities, strict=True):
                self.blocks[name], self.labels[name] = self.block, self.block.result(quantity)
            self.lines.append(f"{', '.join(names)} = {expression}")
            self._known[key] = [Symbol(self, name) for name in names]
        return self._known[key]

    def live_lines(self, outputs: Sequence[Scalar]) -> list[str]:
        """Return the lines that the outputs depend on, in order."""
        needed = {scalar_source(item) for item in outputs}
        kept = []
        for line in reversed(self.lines):
            left, right = line.split(" = ", 1)
            if any(name.strip() in needed for name in left.split(",")):
                kept.append(line)
                needed.update(re.findall(r"\bt\d+\b", right))
        return kept[::-1]


class Symbol:
    """Number without a value yet; if it is a negative, ``negated`` is the symbol that it negates."""

    __slots__ = ("name", "negated", "trace")

    def __init__(self, trace: Trace, name: str) -> None:
        """Name an expression of a trace."""
        self.trace = trace
        self.name = name
        self.negated: Symbol | None = None

    def __add__(self, other: Scalar) -> Scalar:
        if other == 0.0:
            return self
        # Adding a negative number equals subtracting its positive, exactly.
        for one, negative in ((self, other), (other, self)):
            if isinstance(negative, Symbol) and negative.negated is not None:
                return one - negative.negated
        return self.trace.combined(self, "+", other)

    __radd__ = __add__

    def __sub__(self, other: Scalar) -> Scalar:
        if other == 0.0:
            return self
        if isinstance(other, Symbol):
            if other.name == self.name:
                return 0.0
            if other.negated is not None:
                return self + other.negated
        return self.trace.combined(self, "-", other)

    def __rsub__(self, other: float) -> Scalar:
        return -self if other == 0.0 else self.trace.combined(other, "-", self)

    def __neg__(self) -> Symbol:
        (result,) = self.trace.emit(("neg", self.name), f"-{self.name}")
        result.negated = self
        return result

    def __mul__(self, other: Scalar) -> Scalar:
        if other == 0.0:
            return 0.0
        if other == 1.0:
            return self
        return -self if other == -1.0 else self.trace.combined(self, "*", other)

    __rmul__ = __mul__

    def __truediv__(self, other: Scalar) -> Symbol:
        return self.trace.combined(self, "/", other)

    def __rtruediv__(self, other: float) -> Symbol:
        return self.trace.combined(other, "/", self)


Scalar = Symbol | float

MIN_MERGED_CALLS = 4  # calls; fewer are as fast in sequence as in a vector
_LONGEST = 90  # maximum length of an expression in characters
# Characters of a name without its number: C distinguishes names by their first 31 characters.
_LONGEST_NAME = 26
_NAME = re.compile(r"\bt\d+\b")
_ELEMENT = re.compile(r"\b(?:[a-z]+\[\d+\](?:\.[a-z]+)?)")  # element of an array, or its field


def inline_single_uses(lines: Sequence[str], kept: Collection[str]) -> list[str]:
    """Inline results that are used once, and read elements of arrays that are used more than once only once.

    The operations and their order stay the same. The number of names, which determines the time to compile,
    is halved.
    """
    uses = Counter(_NAME.findall(" ".join(line.split(" = ", 1)[1] for line in lines)))
    inside: dict[str, str] = {}
    result = []
    for line in lines:
        left, right = line.split(" = ", 1)
        short = _NAME.sub(lambda found: inside.pop(found[0], found[0]), right)
        if uses[left] == 1 and left not in kept and len(short) < _LONGEST:
            inside[left] = f"({short})"
        else:
            result.append(f"{left} = {short}")
    return _cache_reads(result)


def rename_results(lines: Sequence[str], trace: Trace) -> list[str]:
    """Give the remaining results readable names, and each step of the algorithm a comment.

    A comment is a statement that consists of a string, so that it is part of the syntax tree. ``lines``: from
    :func:`inline_single_uses`, with the names of the trace.
    """
    names = list(dict.fromkeys(name for line in lines for name in _NAME.findall(line)))
    new = _numbered(names, trace.labels)
    result, comment = list[str](), ""
    for line in lines:
        # Entries of arrays that are read before a step belong to the next line.
        target = _NAME.match(line)
        if target and (step := trace.blocks[target[0]].comment) != comment:
            result.append(repr(step))
            comment = step
        result.append(_NAME.sub(lambda match: new[match[0]], line))
    return result


def _numbered(names: Sequence[str], labels: Mapping[str, str]) -> dict[str, str]:
    """Return a unique readable name for each name: its label, with a number where several have that label."""
    shared = Counter(labels[name] for name in names)
    used = {label for label, count in shared.items() if count == 1}
    numbers: Counter[str] = Counter()
    new: dict[str, str] = {}
    for name in names:
        new[name] = label = labels[name]
        while shared[label] > 1 and new[name] in {label, *used}:
            numbers[label] += 1
            new[name] = f"{label}_{numbers[label]}"
        used.add(new[name])
    return new


def _cache_reads(lines: Sequence[str]) -> list[str]:
    """Assign each element of an array that is used more than once to a name before its first use."""
    uses = Counter(found[0] for line in lines for found in _ELEMENT.finditer(line))
    named: set[str] = set()
    result: list[str] = []

    def name(found: re.Match[str]) -> str:
        if uses[found[0]] == 1:
            return found[0]
        short = re.sub(r"\W+", "_", found[0]).strip("_")
        if short not in named:
            named.add(short)
            result.append(f"{short} = {found[0]}")
        return short

    for line in lines:
        # The assignment of the name precedes the first line that uses it.
        result.append(_ELEMENT.sub(name, line))
    return result


def merge_calls(lines: Sequence[str], name: str, shared: int) -> list[str]:
    """Combine several calls of a function into one call with all their arguments, in place of the last call.

    A line that uses a result and precedes this call is moved behind it; otherwise the order stays. No call
    may need the result of another.

    ``lines``: from :meth:`Trace.live_lines`. ``name``: name of the function; the name of the combined call
    is extended by the number of calls. ``shared``: number of leading arguments that all calls have in common.
    """
    calls = [line for line in lines if f" = {name}(" in line]
    if len(calls) < MIN_MERGED_CALLS:
        return list(lines)
    outputs = [output for line in calls for output in line.split(" = ", 1)[0].split(", ")]
    arguments = [line[:-1].split(f" = {name}(", 1)[1].split(", ") for line in calls]
    given = arguments[0][:shared] + [item for items in arguments for item in items[shared:]]
    late, waiting, result = set(outputs), list[str](), list[str]()
    for line in lines:
        if line == calls[-1]:
            result += [f"{', '.join(outputs)} = {name}_{len(calls)}({', '.join(given)})", *waiting]
            late.clear()
        elif line not in calls:
            left, right = line.split(" = ", 1)
            if late.isdisjoint(_NAME.findall(right)):
                result.append(line)
            else:
                late.update(left.split(", "))
                waiting.append(line)
    return result


def scalar_source(value: Scalar) -> str:
    """Return a scalar as Python source; floats exactly."""
    return value.name if isinstance(value, Symbol) else repr(float(value))


def symbolic_sine_cosine(angle: Scalar) -> tuple[Scalar, Scalar]:
    """Return sine and cosine of a number or symbol; both of a symbol come from one call."""
    if isinstance(angle, Symbol):
        sine, cosine = angle.trace.call("sine_cosine", [angle], ("sine", "cosine"))
        return sine, cosine
    return sine_cosine(angle)
