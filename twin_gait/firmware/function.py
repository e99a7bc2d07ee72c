"""A function with the kinds of its names and the names to which it writes; all functions of the entries."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from twin_gait.firmware.kinds import SCALARS, Kind, Shapes, joined, kind_of_hint
from twin_gait.firmware.layout import identifier
from twin_gait.firmware.source import Source, Sources
from twin_gait.firmware.values import Value

ELEMENTARY = "twin_gait.core.elementary"
# Functions that real.h contains: on the bits of a number, and the square root, which boards do not have.
HANDWRITTEN = {
    *((ELEMENTARY, "power_of_two"), (ELEMENTARY, "whole_number")),
    ("twin_gait.firmware.single_episode", "real_sqrt"),
}


@dataclass(slots=True, eq=False)
class Function:
    """An analysed function."""

    source: Source  # source in Python
    params: dict[str, Kind]  # kinds of its arguments
    returns: Kind = None  # kind of its result
    locals: dict[str, Kind] = field(default_factory=dict)  # kinds of its names
    calls: dict[ast.Call, Function] = field(default_factory=dict)  # called functions, by the call
    constants: dict[str, bool | int | float] = field(default_factory=dict)  # values of its global names
    # values that have been assigned to the names of records and lists
    aliases: dict[str, list[Value]] = field(default_factory=dict)
    written: set[str] = field(default_factory=set)  # names of records and lists that are written to
    lengths: set[str] = field(default_factory=set)  # arguments with a relevant length
    # Functions before it with the same name in C, which differ in Python by underscores or the module.
    namesakes: int = 0

    @property
    def name(self) -> str:
        """Name in C."""
        return identifier(self.source.name) + (f"_{self.namesakes + 1}" if self.namesakes else "")

    @property
    def result(self) -> str:
        """Type of the result; for several numbers, a structure of its own."""
        if isinstance(self.returns, tuple):
            return "".join(word.capitalize() for word in self.source.name.split("_")) + "Result"
        return str(self.returns or "void")

    @property
    def writes(self) -> bool:
        """Whether the function changes any of its arguments."""
        return not self.written.isdisjoint(self.params)


class Functions:
    """All functions that the entries call, directly or indirectly, each after its callees.

    Attributes:
        order: The functions.
        used: Fields that are read or written, with their class.
        mutable: Fields of records or lists that lead to a value to which these functions, or code outside,
            write.
    """

    def __init__(
        self, sources: Sources, shapes: Shapes, read: Callable[[Functions, Function], object]
    ) -> None:
        """Start without functions; ``read`` analyses the statements of a function and records the results."""
        self.sources, self.shapes, self._read = sources, shapes, read
        self.order: list[Function] = []
        self.used: set[tuple[type, str]] = set()
        self.mutable: set[tuple[type, str]] = set()
        self._found: dict[Source, Function] = {}
        self._open: list[Source] = []

    def entry(self, source: Source) -> Function:
        """Analyse a function that is called from outside; its annotations give the kinds of its arguments."""
        kinds = []
        for item in source.tree.args.args:
            try:
                kinds.append(kind_of_hint(source.hints.get(item.arg, item.arg)))
            except TypeError:
                problem = f"{item.arg} has a type that cannot be printed"
                raise source.print_error(source.tree.args, problem) from None
        return self.called(source, kinds)

    def called(self, source: Source, given: Sequence[Kind]) -> Function:
        """Analyse a function for arguments of given kinds."""
        if source in self._open:
            raise source.print_error(source.tree.args, "recursion is not allowed: its stack is not bounded")
        names = [item.arg for item in source.tree.args.args]
        params: dict[str, Kind] = {}
        for name, kind in zip(names, given, strict=True):
            hint = source.hints.get(name)
            params[name] = SCALARS[hint] if hint in SCALARS else kind
        known = self._found.get(source)
        if known is None:
            known = Function(source, params, kind_of_hint(source.hints.get("return")))
            known.namesakes = sum(identifier(item.name) == known.name for item in self._found)
            self._found[source] = known
            if (source.module, source.name) not in HANDWRITTEN:
                self._open.append(source)
                # Its writes are complete after its last line only, so that it is printed in a second pass.
                self._read(self, known)
                self._open.pop()
                self.order.append(known)
        # Other kinds than in earlier calls, or a list of another length if the length is relevant.
        for name, kind in params.items():
            before, both = known.params[name], joined(known.params[name], kind)
            if (both is None and kind is not None) or (both != before and name in known.lengths):
                raise source.print_error(source.tree.args, f"{name} has different types in two calls")
            known.params[name] = both
        return known
