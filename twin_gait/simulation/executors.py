"""Executors of a schedule: driver functions that run its steps, generated as text and bound like each step.

A scalar driver runs one episode: compiled, in plain Python over Pinocchio or MuJoCo, or printed as C. A lane
driver runs a block of episodes, each step in a loop over ``lanes(e)``; neighbouring steps share one loop.
Build flags stay global names in the text, so that binding replaces them and the compiler removes the code
that they exclude.
"""

import ast
import inspect
import linecache
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from twin_gait.core.schedule import (
    BlockStep,
    ForEach,
    ScalarBranch,
    ScalarSteps,
    Schedule,
    Step,
    VectorBranch,
    When,
)
from twin_gait.simulation.backend import scalar_lanes, vector_lanes


class ScheduleNames(NamedTuple):
    """Expressions for the names in a schedule; ``{e}`` in an expression is the episode."""

    arguments: Mapping[str, str]  # Records and numbers by the name of an argument of a step.
    counts: Mapping[str, str]  # Number of parts by the name of the parts; empty if the driver runs one part.
    fields: Mapping[str, str]  # Fields by their name in a condition.
    flags: Mapping[str, Any]  # Build flags that conditions may name, with their default values.
    # Arguments of a function of all episodes of a block, where they differ from those of one episode.
    of_block: Mapping[str, str] = MappingProxyType({})


def scalar_driver(
    name: str,
    schedule: Schedule,
    names: ScheduleNames,
    result: Step | None = None,
    head: str = "(e, tick)",
    module: str = __name__,
    docstring: str = "Run steps of one episode.",
) -> Callable[..., Any]:
    """Return the function that runs a schedule for one episode.

    ``result``: test whose result the function returns. ``head``: its arguments. ``module`` and
    ``docstring``: its module and docstring. Raises ValueError for a condition or step that ``names`` does
    not cover.
    """
    writer = _Writer(names)
    lines = list(writer.scalar(schedule, "    ", "e"))
    lines += [] if result is None else [f"    return {writer.call(result, 'e')}"]
    return writer.compile_function(name, head, docstring, lines, module)


def lane_driver(
    name: str, schedule: Schedule, names: ScheduleNames, result: Step | None = None
) -> Callable[..., Any]:
    """Return the function that runs a schedule for a block of episodes.

    The arguments are those of :func:`scalar_driver`, but with a ``result`` the function returns whether the
    test is true for any episode.
    """
    writer = _Writer(names)
    lines = list(writer.in_lanes(schedule, "    "))
    lines += [] if result is None else [*writer.any_of(result, "    "), f"    return {writer.flag}"]
    writer.scope |= {"vector_lanes": vector_lanes, "scalar_lanes": scalar_lanes}
    return writer.compile_function(name, "(e, tick)", "Run steps of a block of episodes.", lines, __name__)


class _Writer:
    """Generator of the statements of a driver."""

    def __init__(self, names: ScheduleNames) -> None:
        self.names = names
        self.scope: dict[str, Any] = {}
        self.flags = 0  # Number of variables so far that combine a test over all episodes.

    @property
    def flag(self) -> str:
        """Name of the last variable that combines a test over all episodes."""
        return f"any_{self.flags}"

    def call(self, step: Step, e: str, known: Mapping[str, str] | None = None) -> str:
        """Return the call of a step; ``known``: records and numbers, those of one episode by default."""
        name, known = step.__name__, self.names.arguments if known is None else known
        if self.scope.setdefault(name, step) is not step:
            raise ValueError(f"two steps of a schedule have the name {name}")
        parameters = inspect.signature(step).parameters
        for item in parameters.keys() - known.keys():
            raise ValueError(f"step {name}: no record or number {item}; known: {', '.join(known)}")
        return f"{name}({', '.join(known[item].format(e=e) for item in parameters)})"

    def condition(self, text: str, e: str) -> str:
        """Return a condition with expressions for its fields.

        Raises ValueError for a name that is neither a build flag nor a field.
        """
        flags, fields = self.names.flags, self.names.fields
        for name in _names_in(text):
            if name in flags:
                self.scope[name] = flags[name]
            elif name not in fields:
                known = ", ".join([*flags, *fields])
                raise ValueError(f"condition {text!r}: no build flag or field {name}; known: {known}")
        return re.sub(r"\b[a-z]\w*", lambda found: fields.get(found[0], found[0]).format(e=e), text)

    def scalar(self, steps: Schedule, pad: str, e: str) -> Iterator[str]:
        """Yield the statements for one episode."""
        inner = f"{pad}    "
        for item in _flat(steps):
            match item:
                case ScalarSteps(single_steps):
                    yield from self.scalar(single_steps, pad, e)
                case ForEach(parts, part_steps):
                    count = self.names.counts[parts].format(e=e)
                    if count:
                        yield f"{pad}for number in range({count}):"
                    yield from self.scalar(part_steps, inner if count else pad, e)
                case When():
                    yield from self.branches(item, pad, e, lambda part: self.scalar(part, inner, e))
                case VectorBranch(test, some_steps) | ScalarBranch(test, some_steps):
                    yield f"{pad}if {self.call(test, e)}:"
                    yield from self.scalar(some_steps, inner, e)
                case BlockStep(function):
                    yield f"{pad}{self.call(function, e)}"
                case _:
                    yield f"{pad}{self.call(item, e)}"

    def in_lanes(self, steps: Schedule, pad: str) -> Iterator[str]:
        """Yield the statements for all episodes of a block."""
        inner, waiting = f"{pad}    ", list[Any]()
        for item in _flat(steps):
            if self.shares_loop(item):
                waiting.append(item)
                continue
            yield from self.loop(waiting, pad)
            waiting = []
            match item:
                case ForEach(parts, part_steps):
                    yield f"{pad}for number in range({self.names.counts[parts].format(e='e')}):"
                    yield from self.in_lanes(part_steps, inner)
                case When():
                    yield from self.branches(item, pad, "e", lambda part: self.in_lanes(part, inner))
                case VectorBranch(test, some_steps):
                    yield from self.any_of(test, pad)
                    yield f"{pad}if {self.flag}:"
                    yield from self.in_lanes(some_steps, inner)
                case ScalarBranch(test):
                    yield from self.any_of(test, pad)
                    yield f"{pad}if {self.flag}:"
                    yield f"{inner}for one in scalar_lanes(e):"
                    yield from self.scalar((item,), f"{inner}    ", "one")
                case ScalarSteps(single_steps):
                    yield f"{pad}for one in scalar_lanes(e):"
                    yield from self.scalar(single_steps, inner, "one")
                case BlockStep(function):
                    yield f"{pad}{self.call(function, 'e', {**self.names.arguments, **self.names.of_block})}"
        yield from self.loop(waiting, pad)

    def shares_loop(self, item: Any) -> bool:
        """Return whether an item shares a loop with its neighbours: a step, or steps under build flags."""
        if isinstance(item, When):
            uniform = _names_in(item.condition) <= self.names.flags.keys()
            return uniform and all(map(self.shares_loop, _flat(item.steps + item.otherwise)))
        return inspect.isfunction(item)

    def loop(self, items: list[Any], pad: str) -> Iterator[str]:
        """Yield a loop over the lanes with the items that share the loop."""
        if items:
            yield f"{pad}for one in vector_lanes(e):"
            yield from self.scalar(tuple(items), f"{pad}    ", "one")

    def any_of(self, test: Step, pad: str) -> Iterator[str]:
        """Yield a loop over the lanes that sets a variable to true if a test is true for any lane."""
        self.flags += 1
        yield f"{pad}{self.flag} = False"
        yield f"{pad}for one in vector_lanes(e):"
        yield f"{pad}    {self.flag} |= {self.call(test, 'one')}"

    def branches(
        self, item: When, pad: str, e: str, write: Callable[[Schedule], Iterator[str]]
    ) -> Iterator[str]:
        """Yield a condition with its steps."""
        yield f"{pad}if {self.condition(item.condition, e)}:"
        yield from write(item.steps)
        if item.otherwise:
            yield f"{pad}else:"
            yield from write(item.otherwise)

    def compile_function(
        self, name: str, head: str, summary: str, lines: list[str], module: str
    ) -> Callable[..., Any]:
        """Return the function of some statements; debuggers and the C printer can read its text."""
        text = "\n".join([f"def {name}{head}:", f'    """{summary}"""', *lines, ""])
        # The checksum gives two drivers with the same name two file names.
        file = f"<schedule: {name} {zlib.crc32(text.encode()):08x}>"
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        scope = {**self.scope, "__name__": module}
        # The text contains only names of functions and fields of this package, and no text of a user.
        exec(compile(text, file, "exec"), scope)
        made: Callable[..., Any] = scope[name]
        return made


def _flat(schedule: Schedule) -> Iterator[Any]:
    """Yield the steps and groups of a schedule and of the schedules that it contains."""
    for item in schedule:
        yield from _flat(item) if isinstance(item, tuple) else (item,)


def _names_in(condition: str) -> set[str]:
    """Return the names in a condition."""
    return {node.id for node in ast.walk(ast.parse(condition)) if isinstance(node, ast.Name)}
