"""A function with the kind of everything in it, and what it writes to."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, field

from twin_gait.firmware.expression_kinds import ExpressionKinds
from twin_gait.firmware.kinds import (
    BOOL,
    INT,
    SCALARS,
    Kind,
    ListKind,
    RecordKind,
    Scalar,
    Shapes,
    TupleKind,
    kind_of_hint,
)
from twin_gait.firmware.source import Source, Sources

ELEMENTARY = "twin_gait.core.elementary"
# These look at bits; real.h has them.
BY_HAND = {(ELEMENTARY, "power_of_two"), (ELEMENTARY, "whole_number")}


@dataclass(slots=True, eq=False)
class Function:
    """A function, understood."""

    source: Source  # as it stands in Python
    params: dict[str, Kind]  # kinds of its arguments
    returns: Kind = None  # kind of its result
    locals: dict[str, Kind] = field(default_factory=dict)  # kinds of its names
    kinds: dict[ast.AST, Kind] = field(default_factory=dict)  # of every expression
    calls: dict[ast.Call, Function] = field(default_factory=dict)  # functions that are called, by the call
    constants: dict[str, bool | int | float] = field(default_factory=dict)  # values of the global names in it
    # what names of records and lists have been assigned
    aliases: dict[str, list[ast.expr]] = field(default_factory=dict)
    written: set[str] = field(default_factory=set)  # names of records and lists that are written to
    lengths: set[str] = field(default_factory=set)  # arguments whose length matters

    @property
    def writes(self) -> bool:
        """Whether it changes anything outside."""
        return not self.written.isdisjoint(self.params)


class Functions:
    """All functions that entries lead to, each after those that it calls.

    Attributes:
        order: The functions.
        used: Fields that are read or written, with their class.
        mutable: Fields that hold records or lists and lead to something that is written from here or outside.
    """

    def __init__(self, sources: Sources, shapes: Shapes) -> None:
        """Begin with none."""
        self.sources, self.shapes = sources, shapes
        self.order: list[Function] = []
        self.used: set[tuple[type, str]] = set()
        self.mutable: set[tuple[type, str]] = set()
        self._found: dict[Source, Function] = {}
        self._open: list[Source] = []

    def entry(self, source: Source) -> Function:
        """Understand a function that is called from outside; its annotations say what its arguments are."""
        kinds = []
        for item in source.tree.args.args:
            try:
                kinds.append(kind_of_hint(source.hints.get(item.arg, item.arg)))
            except TypeError:
                raise source.refused(source.tree.args, f"{item.arg} is of no kind that C knows") from None
        return self.called(source, kinds)

    def called(self, source: Source, given: Sequence[Kind]) -> Function:
        """Understand a function for arguments of some kinds."""
        if source in self._open:
            raise source.refused(source.tree.args, "recursion, which has no bounded stack")
        names = [item.arg for item in source.tree.args.args]
        params: dict[str, Kind] = {}
        for name, kind in zip(names, given, strict=True):
            hint = source.hints.get(name)
            params[name] = SCALARS[hint] if hint in SCALARS else kind
        known = self._found.get(source)
        if known is None:
            self._open.append(source)
            known = self._found[source] = Function(source, params)
            if (source.module, source.name) in BY_HAND:
                known.returns = kind_of_hint(source.hints["return"])
            else:
                Inference(self, known).run()
                self.order.append(known)
            self._open.pop()
        self._agree(known, params)
        return known

    def embed(self, shapes: Shapes) -> None:
        """Note that all of some records may be written outside."""
        self.mutable |= {(record, name) for record, fields in shapes.fields.items() for name in fields}

    @staticmethod
    def _agree(function: Function, params: dict[str, Kind]) -> None:
        """Refuse arguments of other kinds than in the calls before; of a list's length where it matters."""
        for name, kind in params.items():
            known = function.params[name]
            if kind == known:
                continue
            if isinstance(known, ListKind) and isinstance(kind, ListKind) and known.item == kind.item:
                if name not in function.lengths:
                    function.params[name] = ListKind(known.item, None)
                    continue
            raise function.source.refused(function.source.tree.args, f"{name} is of two kinds in two calls")


class Inference(ExpressionKinds):
    """Finds the kinds in one function."""

    def __init__(self, functions: Functions, function: Function) -> None:
        """Begin with the arguments."""
        super().__init__(functions, function)
        self.returned: list[Kind] = []

    def run(self) -> None:
        """Go through the function."""
        self._block(self.source.tree.body)
        found: Kind = self.returned[0] if self.returned else None
        if "return" in self.source.hints:
            found = kind_of_hint(self.source.hints["return"])
        self.function.returns = found

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            self._statement(statement)

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets=[target]):
                self._assign(node, target, node.value)
            case ast.If():
                self.expect(node.test, BOOL)
                self.in_order(node.test)
                self._block(node.body)
                self._block(node.orelse)
            case ast.For(orelse=[]):
                self._loop(node)
            case ast.Return():
                self._returns(node)
            case ast.Expr(value=ast.Constant(value=str())) | ast.Pass() | ast.Continue():
                pass
            case ast.Expr(value=ast.Call()):
                self.kind(node.value)
                self.in_order(node.value)
            case _:
                raise self.source.refused(node, "a statement that is not printed")

    def _assign(self, node: ast.stmt, target: ast.expr, value: ast.expr) -> None:
        kind = self.kind(value)
        if isinstance(target, ast.Tuple):
            if not isinstance(kind, TupleKind) or len(kind.items) != len(target.elts):
                raise self.source.refused(node, "as many names as values are expected")
            for item, part in zip(target.elts, kind.items, strict=True):
                self._store(item, part, value)
        else:
            self._store(target, kind, value)
        self.in_order(value, target)

    def _store(self, target: ast.expr, kind: Kind, value: ast.expr) -> None:
        if isinstance(target, ast.Name):
            if kind is None or isinstance(kind, TupleKind):
                raise self.source.refused(value, "is no single value")
            self._declare(target, kind, value)
        else:
            known = self.kind(target)
            if not isinstance(known, Scalar):
                raise self.source.refused(target, "records and lists are changed entry by entry")
            assert isinstance(target, (ast.Attribute, ast.Subscript))
            self.wrote(target.value)
            self.fits(value, kind, known)

    def _declare(self, target: ast.Name, kind: Kind, value: ast.expr) -> None:
        function, name = self.function, target.id
        if name in function.params and not isinstance(kind, Scalar):
            raise self.source.refused(target, "an argument that is assigned anew")
        known = function.params.get(name) or function.locals.setdefault(name, kind)
        self.fits(value, kind, known)
        function.kinds[target] = known
        if not isinstance(kind, Scalar):
            function.aliases.setdefault(name, []).append(value)
            if name in function.written:
                self.wrote(value)

    def _loop(self, node: ast.For) -> None:
        target = node.target
        match node.iter:
            case ast.Call(func=ast.Name(id="range"), args=args) if 1 <= len(args) <= 2:
                for item in args:
                    self.expect(item, INT)
                    self.in_order(item)
                self._counter(target)
            case ast.Call(func=ast.Name(id="enumerate"), args=[items]) if isinstance(target, ast.Tuple):
                self._counter(target.elts[0])
                self._entry_of(target.elts[1], items)
            case _:
                self._entry_of(target, node.iter)
        counters = {item.id for item in ast.walk(target) if isinstance(item, ast.Name)}
        for name in (name for item in node.body for name in ast.walk(item)):
            if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store) and name.id in counters:
                raise self.source.refused(name, "is counted by the loop")
        self._block(node.body)

    def _counter(self, target: ast.expr) -> None:
        assert isinstance(target, ast.Name)
        self._declare(target, INT, target)

    def _entry_of(self, target: ast.expr, items: ast.expr) -> None:
        kind = self.kind(items)
        if not isinstance(kind, ListKind) or not isinstance(target, ast.Name):
            raise self.source.refused(items, "loops are printed over range, enumerate and lists")
        self.known_length(items)
        self._declare(target, kind.item, items)

    def _returns(self, node: ast.Return) -> None:
        hint = self.source.hints.get("return", self)
        kind = self.kind(node.value) if node.value else None
        if node.value:
            self.in_order(node.value)
        wanted = kind_of_hint(hint) if hint is not self else self.returned[0] if self.returned else kind
        parts = zip(kind.items, wanted.items, strict=True) if _pair(kind, wanted) else [(kind, wanted)]  # type: ignore[union-attr]
        for part, whole in parts:
            self.fits(node, part, whole)
        if isinstance(kind, (RecordKind, ListKind)):
            raise self.source.refused(node, "records and lists are not returned")
        self.returned.append(kind)


def _pair(kind: Kind, wanted: Kind) -> bool:
    return (
        isinstance(kind, TupleKind) and isinstance(wanted, TupleKind) and len(kind.items) == len(wanted.items)
    )
