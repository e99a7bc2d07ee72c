"""A function with the kind of everything in it, and what it writes to."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from twin_gait.firmware.kinds import (
    BOOL,
    INT,
    INT_LIMIT,
    LARGEST_SINGLE,
    REAL,
    SCALARS,
    Kind,
    ListKind,
    RecordKind,
    Scalar,
    Shapes,
    TupleKind,
    kind_of_hint,
    scalar_of,
)
from twin_gait.firmware.source import Source, Sources, constant_in

ELEMENTARY = "twin_gait.core.elementary"
BITWISE = (ast.LShift, ast.RShift, ast.BitAnd, ast.BitOr, ast.BitXor)
ARITHMETIC = (ast.Add, ast.Sub, ast.Mult)
WHOLE = (ast.FloorDiv, ast.Mod)
COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)
# These look at bits; real.h has them.
BY_HAND = {(ELEMENTARY, "power_of_two"), (ELEMENTARY, "whole_number")}
BUILT_IN = {"abs", "max", "min", "len", "float", "int"}


@dataclass(slots=True, eq=False)
class Function:
    """A function, understood.

    Attributes:
        source: As it stands in Python.
        params: Kinds of its arguments.
        returns: Kind of its result.
        locals: Kinds of its names.
        kinds: Of every expression.
        calls: Functions that are called, by the call.
        constants: Values of the global names in it.
        aliases: What names of records and lists have been assigned.
        written: Names of records and lists that are written to.
        lengths: Arguments whose length matters.
    """

    source: Source
    params: dict[str, Kind]
    returns: Kind = None
    locals: dict[str, Kind] = field(default_factory=dict)
    kinds: dict[ast.AST, Kind] = field(default_factory=dict)
    calls: dict[ast.Call, Function] = field(default_factory=dict)
    constants: dict[str, bool | int | float] = field(default_factory=dict)
    aliases: dict[str, list[ast.expr]] = field(default_factory=dict)
    written: set[str] = field(default_factory=set)
    lengths: set[str] = field(default_factory=set)

    @property
    def writes(self) -> bool:
        """Whether it changes anything outside."""
        return not self.written.isdisjoint(self.params)


class Functions:
    """All functions that entries lead to, each after those that it calls.

    Attributes:
        order: The functions.
        used: Fields that are read or written, with their class.
        mutable: Fields that hold records or lists and lead to something that is written.
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
                _Inference(self, known).run()
                self.order.append(known)
            self._open.pop()
        self._agree(known, params)
        return known

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


class _Inference:
    """Finds the kinds in one function."""

    def __init__(self, functions: Functions, function: Function) -> None:
        """Begin with the arguments."""
        self.functions, self.function, self.source = functions, function, function.source
        self.assigned = set(function.params)
        self.returned: list[Kind] = []

    def run(self) -> None:
        """Go through the function."""
        self.block(self.source.tree.body)
        found: Kind = self.returned[0] if self.returned else None
        if "return" in self.source.hints:
            found = kind_of_hint(self.source.hints["return"])
        self.function.returns = found

    # ------------------------------------------------------------------ statements

    def block(self, statements: Sequence[ast.stmt]) -> bool:
        """Go through statements.

        Returns:
            Whether what comes after them is reached.
        """
        for number, statement in enumerate(statements):
            if not self.statement(statement):
                if number + 1 < len(statements):
                    raise self.source.refused(statements[number + 1], "is never reached")
                return False
        return True

    def statement(self, node: ast.stmt) -> bool:
        match node:
            case ast.Assign(targets=[target]):
                self.assign(node, target, node.value)
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                self.assign(node, target, value)
            case ast.If():
                return self.condition(node)
            case ast.For(orelse=[]):
                self.loop(node)
            case ast.Return():
                self.returns(node)
                return False
            case ast.Expr(value=ast.Constant(value=str())) | ast.Pass():
                pass
            case ast.Expr(value=ast.Call()):
                self.kind(node.value)
                self.in_order(node.value)
            case ast.Continue() | ast.Break():
                return False
            case _:
                raise self.source.refused(node, "a statement that is not printed")
        return True

    def assign(self, node: ast.stmt, target: ast.expr, value: ast.expr) -> None:
        kind = self.kind(value)
        self.in_order(value, target)
        if isinstance(target, ast.Tuple):
            if not isinstance(kind, TupleKind) or len(kind.items) != len(target.elts):
                raise self.source.refused(node, "as many names as values are expected")
            for item, part in zip(target.elts, kind.items, strict=True):
                self.store(item, part, value)
        else:
            self.store(target, kind, value)

    def store(self, target: ast.expr, kind: Kind, value: ast.expr) -> None:
        if isinstance(target, ast.Name):
            if kind is None or isinstance(kind, TupleKind):
                raise self.source.refused(value, "is no single value")
            self.declare(target, kind, value)
        else:
            known = self.kind(target)
            if not isinstance(known, Scalar):
                raise self.source.refused(target, "records and lists are changed entry by entry")
            assert isinstance(target, (ast.Attribute, ast.Subscript))
            self.wrote(target.value)
            self.fits(value, kind, known)

    def declare(self, target: ast.Name, kind: Kind, value: ast.expr) -> None:
        function, name = self.function, target.id
        if name in function.params and not isinstance(kind, Scalar):
            raise self.source.refused(target, "an argument that is assigned anew")
        known = function.params.get(name) or function.locals.setdefault(name, kind)
        self.fits(value, kind, known)
        function.kinds[target] = known
        self.assigned.add(name)
        if not isinstance(kind, Scalar):
            function.aliases.setdefault(name, []).append(value)
            if name in function.written:
                self.wrote(value)

    def fits(self, node: ast.AST, kind: Kind, wanted: Kind) -> None:
        """Refuse a value of a kind that cannot take the place of the one that is wanted."""
        widened = (kind in (INT, BOOL) and wanted is REAL) or (kind is BOOL and wanted is INT)
        if isinstance(kind, ListKind) and isinstance(wanted, ListKind):
            widened = kind.item == wanted.item
        if kind != wanted and not widened:
            raise self.source.refused(node, f"is {_named(kind)} where {_named(wanted)} is expected")

    def condition(self, node: ast.If) -> bool:
        self.expect(node.test, BOOL)
        self.in_order(node.test)
        before = set(self.assigned)
        ends = self.block(node.body)
        after, self.assigned = self.assigned, before
        other = self.block(node.orelse)
        if ends and other:
            self.assigned &= after
        elif ends:
            self.assigned = after
        return ends or other

    def loop(self, node: ast.For) -> None:
        target, before = node.target, set(self.assigned)
        match node.iter:
            case ast.Call(func=ast.Name(id="range"), args=args) if 1 <= len(args) <= 2:
                for item in args:
                    self.expect(item, INT)
                    self.in_order(item)
                self.counter(target)
            case ast.Call(func=ast.Name(id="enumerate"), args=[items]) if isinstance(target, ast.Tuple):
                self.counter(target.elts[0])
                self.entry_of(target.elts[1], items)
            case _:
                self.entry_of(target, node.iter)
        counters = {item.id for item in ast.walk(target) if isinstance(item, ast.Name)}
        for name in (name for item in node.body for name in ast.walk(item)):
            if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store) and name.id in counters:
                raise self.source.refused(name, "is counted by the loop")
        if counters & before:
            raise self.source.refused(target, "has another meaning before the loop")
        self.block(node.body)
        self.assigned = before

    def counter(self, target: ast.expr) -> None:
        assert isinstance(target, ast.Name)
        self.declare(target, INT, target)

    def entry_of(self, target: ast.expr, items: ast.expr) -> None:
        kind = self.kind(items)
        if not isinstance(kind, ListKind) or not isinstance(target, ast.Name):
            raise self.source.refused(items, "loops are printed over range, enumerate and lists")
        self.known_length(items)
        self.declare(target, kind.item, items)

    def returns(self, node: ast.Return) -> None:
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

    # ------------------------------------------------------------------ what is written, and when

    def wrote(self, place: ast.expr) -> None:
        """Note that a record or list is written to, and so all that it is reached through."""
        match place:
            case ast.Name(id=name):
                if name not in self.function.written:
                    self.function.written.add(name)
                    for value in self.function.aliases.get(name, ()):
                        self.wrote(value)
            case ast.Attribute(value=base, attr=name):
                kind = self.function.kinds[base]
                assert isinstance(kind, RecordKind)
                self.functions.mutable.add((kind.record, name))
                self.wrote(base)
            case ast.Subscript(value=base):
                self.wrote(base)
            case _:
                raise self.source.refused(place, "what is written to has to have one name")

    def in_order(self, value: ast.expr, target: ast.expr | None = None) -> None:
        """Refuse an expression whose value depends on what C evaluates first."""
        writing = [item for item in ast.walk(value) if item in self.function.calls]
        writing = [item for item in writing if self.function.calls[item].writes]
        if not writing:
            return
        inside = set(ast.walk(writing[0]))
        around = [*ast.walk(value), *(ast.walk(target) if target else ())]
        for item in around:
            reads = isinstance(item, (ast.Attribute, ast.Subscript)) and isinstance(item.ctx, ast.Load)
            reads = reads and isinstance(self.function.kinds.get(item), Scalar)
            if item not in inside and (reads or isinstance(item, ast.Call)):
                raise self.source.refused(
                    writing[0], "changes records beside what else is read; name its result"
                )

    # ------------------------------------------------------------------ expressions

    def kind(self, node: ast.expr) -> Kind:
        """Kind of an expression."""
        found = self.function.kinds[node] = self._kind(node)
        return found

    def expect(self, node: ast.expr, kind: Kind) -> None:
        self.fits(node, self.kind(node), kind)

    def numbers(self, nodes: Sequence[ast.expr]) -> Scalar:
        """The kind that holds several numbers."""
        kinds = [self.kind(node) for node in nodes]
        for node, kind in zip(nodes, kinds, strict=True):
            if not isinstance(kind, Scalar):
                raise self.source.refused(node, "is no number")
        return REAL if REAL in kinds else INT if INT in kinds else BOOL

    def _kind(self, node: ast.expr) -> Kind:
        match node:
            case ast.Constant():
                return self.literal(node, node.value)
            case ast.Name():
                return self.name(node)
            case ast.Attribute():
                return self.attribute(node)
            case ast.Subscript(value=base, slice=place):
                self.expect(place, INT)
                kind = self.kind(base)
                if not isinstance(kind, ListKind) or isinstance(place, ast.UnaryOp):
                    raise self.source.refused(node, "is no entry of a list, counted from its beginning")
                return kind.item
            case ast.BinOp():
                return self.binary(node)
            case ast.UnaryOp(op=ast.Not()):
                self.expect(node.operand, BOOL)
                return BOOL
            case ast.UnaryOp(op=ast.USub() | ast.Invert()):
                kind = self.numbers([node.operand])
                if kind is BOOL or (kind is REAL and isinstance(node.op, ast.Invert)):
                    raise self.source.refused(node, "is no number with a sign")
                return kind
            case ast.BoolOp():
                for item in node.values:
                    self.expect(item, BOOL)
                return BOOL
            case ast.Compare():
                return self.comparison(node)
            case ast.IfExp():
                self.expect(node.test, BOOL)
                return self.numbers([node.body, node.orelse])
            case ast.Call():
                return self.call(node)
            case ast.Tuple():
                for item in node.elts:
                    self.numbers([item])
                return TupleKind(tuple(self.numbers([item]) for item in node.elts))
        raise self.source.refused(node, "an expression that is not printed")

    def literal(self, node: ast.expr, value: Any) -> Scalar:
        kind = scalar_of(value)
        if kind is None:
            raise self.source.refused(node, "is no number")
        if kind is INT and not -INT_LIMIT <= value < INT_LIMIT:
            raise self.source.refused(node, f"{value} does not fit into 32 bits")
        if kind is REAL and LARGEST_SINGLE < abs(value) < math.inf:
            raise self.source.refused(node, f"{value} does not fit into a float")
        return kind

    def name(self, node: ast.Name) -> Kind:
        if node.id in self.function.params or node.id in self.function.locals:
            if node.id not in self.assigned:
                raise self.source.refused(node, "may be read before it is assigned")
            return self.function.params.get(node.id) or self.function.locals[node.id]
        value = self.functions.sources.found(node.id, self.source.scope)
        if scalar_of(value) is None:
            raise self.source.refused(node, "is no constant number")
        self.function.constants[node.id] = value
        return self.literal(node, value)

    def attribute(self, node: ast.Attribute) -> Kind:
        if isinstance(node.value, ast.Name) and node.value.id not in {
            *self.function.params,
            *self.function.locals,
        }:
            module = self.functions.sources.found(node.value.id, self.source.scope)
            value = constant_in(module, node.attr)
            if value is None:
                raise self.source.refused(node, "is no constant number")
            if module is not math:
                self.function.constants[node.attr] = value
            return self.literal(node, value)
        base = self.kind(node.value)
        if not isinstance(base, RecordKind):
            raise self.source.refused(node, "is no field of a record")
        found = self.functions.shapes.fields.get(base.record, {}).get(node.attr)
        if found is None:
            raise self.source.refused(node, f"no sample of {base.record.__name__} has {node.attr}")
        self.functions.used.add((base.record, node.attr))
        return found

    def binary(self, node: ast.BinOp) -> Scalar:
        kind = self.numbers([node.left, node.right])
        if isinstance(node.op, ast.Div):
            return REAL
        if isinstance(node.op, ARITHMETIC):
            return INT if kind is BOOL else kind
        if isinstance(node.op, (*BITWISE, *WHOLE)) and kind is not REAL:
            shifts = isinstance(node.op, (ast.LShift, ast.RShift, *WHOLE))
            return INT if shifts else kind
        raise self.source.refused(node, "arithmetic that is not printed")

    def comparison(self, node: ast.Compare) -> Scalar:
        self.numbers([node.left, *node.comparators])
        for item in node.ops:
            if not isinstance(item, COMPARISONS):
                raise self.source.refused(node, "a comparison that is not printed")
        return BOOL

    def call(self, node: ast.Call) -> Kind:
        if node.keywords:
            raise self.source.refused(node, "arguments are given by place")
        match node.func:
            case ast.Name(id=name) if name in BUILT_IN and name not in self.source.scope:
                return self.built_in(node, name)
            case ast.Attribute(value=ast.Name(id="math"), attr="floor" | "isfinite" as name):
                self.expect(node.args[0], REAL)
                return REAL if name == "floor" else BOOL
            case ast.Name(id=name):
                source = self.functions.sources.found(name, self.source.scope)
                if isinstance(source, Source):
                    return self.call_of(node, source)
        raise self.source.refused(node, "a function that is not printed")

    def built_in(self, node: ast.Call, name: str) -> Kind:
        if name == "len" and len(node.args) == 1:
            self.kind(node.args[0])
            self.known_length(node.args[0])
            return INT
        kind = self.numbers(node.args)
        count = 2 if name in ("max", "min") else 1
        if len(node.args) != count or (name == "int" and kind is REAL) or (kind is BOOL and name == "abs"):
            raise self.source.refused(node, "a function that is not printed")
        return {"float": REAL, "int": INT}.get(name, INT if kind is BOOL else kind)

    def call_of(self, node: ast.Call, source: Source) -> Kind:
        missing = len(source.tree.args.args) - len(node.args)
        defaults = source.tree.args.defaults
        if not 0 <= missing <= len(defaults) or any(isinstance(item, ast.Starred) for item in node.args):
            raise self.source.refused(node, f"{source.name} takes other arguments")
        node.args += defaults[len(defaults) - missing :]
        given = [self.kind(item) for item in node.args]
        called = self.function.calls[node] = self.functions.called(source, given)
        for item, kind, (name, wanted) in zip(node.args, given, called.params.items(), strict=True):
            self.fits(item, kind, wanted)
            if name in called.written:
                self.wrote(item)
        return called.returns

    def known_length(self, node: ast.expr) -> None:
        """Refuse a list of unknown length, and note that its length matters."""
        kind = self.function.kinds[node]
        if not isinstance(kind, ListKind) or kind.length is None:
            raise self.source.refused(node, "is no list of one known length")
        for name in _roots(node, self.function):
            self.function.lengths.add(name)


def _roots(node: ast.expr, function: Function) -> Iterator[str]:
    """Argument that a list itself is, under whichever names."""
    if isinstance(node, ast.Name):
        yield node.id
        for value in function.aliases.get(node.id, ()):
            yield from _roots(value, function)


def _pair(kind: Kind, wanted: Kind) -> bool:
    return (
        isinstance(kind, TupleKind) and isinstance(wanted, TupleKind) and len(kind.items) == len(wanted.items)
    )


def _named(kind: Kind) -> str:
    match kind:
        case Scalar(name=name):
            return name
        case RecordKind(record=record):
            return record.__name__
        case ListKind(item=item):
            return f"a list of {_named(item)}"
        case TupleKind(items=items):
            return f"{len(items)} numbers"
    return "nothing"
