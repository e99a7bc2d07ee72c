"""Kinds of expressions, and what is written through them."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from twin_gait.firmware.kinds import (
    BOOL,
    INT,
    REAL,
    Kind,
    ListKind,
    RecordKind,
    Scalar,
    TupleKind,
    scalar_of,
)
from twin_gait.firmware.source import Source, constant_in

if TYPE_CHECKING:
    from twin_gait.firmware.function import Function, Functions

BITWISE = (ast.LShift, ast.RShift, ast.BitAnd, ast.BitOr, ast.BitXor)
ARITHMETIC = (ast.Add, ast.Sub, ast.Mult)
WHOLE = (ast.FloorDiv, ast.Mod)
COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)
BUILT_IN = {"abs", "max", "min", "len", "float", "int"}


class ExpressionKinds:
    """Finds the kinds of the expressions of one function."""

    def __init__(self, functions: Functions, function: Function) -> None:
        """Begin with the arguments."""
        self.functions, self.function, self.source = functions, function, function.source

    def fits(self, node: ast.AST, kind: Kind, wanted: Kind) -> None:
        """Refuse a value of a kind that cannot take the place of the one that is wanted."""
        widened = (kind in (INT, BOOL) and wanted is REAL) or (kind is BOOL and wanted is INT)
        if isinstance(kind, ListKind) and isinstance(wanted, ListKind):
            widened = kind.item == wanted.item
        if kind != wanted and not widened:
            raise self.source.refused(node, f"is {kind} where {wanted} is expected")

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

    def kind(self, node: ast.expr) -> Kind:
        """Kind of an expression."""
        found = self.function.kinds[node] = self._kind(node)
        return found

    def expect(self, node: ast.expr, kind: Kind) -> None:
        """Refuse an expression that is not of a kind."""
        self.fits(node, self.kind(node), kind)

    def _numbers(self, nodes: Sequence[ast.expr]) -> Scalar:
        """The kind that holds several numbers."""
        kinds = [self.kind(node) for node in nodes]
        for node, kind in zip(nodes, kinds, strict=True):
            if not isinstance(kind, Scalar):
                raise self.source.refused(node, "is no number")
        return REAL if REAL in kinds else INT if INT in kinds else BOOL

    def _kind(self, node: ast.expr) -> Kind:
        match node:
            case ast.Constant():
                return self._literal(node, node.value)
            case ast.Name():
                return self._name(node)
            case ast.Attribute():
                return self._attribute(node)
            case ast.Subscript(value=base, slice=place):
                self.expect(place, INT)
                kind = self.kind(base)
                if not isinstance(kind, ListKind) or isinstance(place, ast.UnaryOp):
                    raise self.source.refused(node, "is no entry of a list, counted from its beginning")
                return kind.item
            case ast.BinOp():
                return self._binary(node)
            case ast.UnaryOp(op=ast.Not()):
                self.expect(node.operand, BOOL)
                return BOOL
            case ast.UnaryOp(op=ast.USub() | ast.Invert()):
                kind = self._numbers([node.operand])
                if kind is BOOL or (kind is REAL and isinstance(node.op, ast.Invert)):
                    raise self.source.refused(node, "is no number with a sign")
                return kind
            case ast.BoolOp():
                for item in node.values:
                    self.expect(item, BOOL)
                return BOOL
            case ast.Compare():
                return self._comparison(node)
            case ast.IfExp():
                self.expect(node.test, BOOL)
                return self._numbers([node.body, node.orelse])
            case ast.Call():
                return self._call(node)
            case ast.Tuple():
                for item in node.elts:
                    self._numbers([item])
                return TupleKind(tuple(self._numbers([item]) for item in node.elts))
        raise self.source.refused(node, "an expression that is not printed")

    def _literal(self, node: ast.expr, value: Any) -> Scalar:
        kind = scalar_of(value)
        if kind is None:
            raise self.source.refused(node, "is no number")
        return kind

    def _name(self, node: ast.Name) -> Kind:
        known = self.function.params.get(node.id) or self.function.locals.get(node.id)
        if known is not None:
            return known
        value = self.functions.sources.found(node.id, self.source.scope)
        if scalar_of(value) is None:
            raise self.source.refused(node, "is no constant number")
        self.function.constants[node.id] = value
        return self._literal(node, value)

    def _attribute(self, node: ast.Attribute) -> Kind:
        own = {*self.function.params, *self.function.locals}
        if isinstance(node.value, ast.Name) and node.value.id not in own:
            module = self.functions.sources.found(node.value.id, self.source.scope)
            value = constant_in(module, node.attr)
            if value is None:
                raise self.source.refused(node, "is no constant number")
            if module is not math:
                self.function.constants[node.attr] = value
            return self._literal(node, value)
        base = self.kind(node.value)
        if not isinstance(base, RecordKind):
            raise self.source.refused(node, "is no field of a record")
        found = self.functions.shapes.fields.get(base.record, {}).get(node.attr)
        if found is None:
            raise self.source.refused(node, f"no sample of {base.record.__name__} has {node.attr}")
        self.functions.used.add((base.record, node.attr))
        return found

    def _binary(self, node: ast.BinOp) -> Scalar:
        kind = self._numbers([node.left, node.right])
        if isinstance(node.op, ast.Div):
            return REAL
        if isinstance(node.op, ARITHMETIC):
            return INT if kind is BOOL else kind
        if isinstance(node.op, (*BITWISE, *WHOLE)) and kind is not REAL:
            shifts = isinstance(node.op, (ast.LShift, ast.RShift, *WHOLE))
            return INT if shifts else kind
        raise self.source.refused(node, "arithmetic that is not printed")

    def _comparison(self, node: ast.Compare) -> Scalar:
        self._numbers([node.left, *node.comparators])
        for item in node.ops:
            if not isinstance(item, COMPARISONS):
                raise self.source.refused(node, "a comparison that is not printed")
        return BOOL

    def _call(self, node: ast.Call) -> Kind:
        if node.keywords:
            raise self.source.refused(node, "arguments are given by place")
        match node.func:
            case ast.Name(id="int") if len(node.args) == 1 and is_floor(node.args[0]):
                self.kind(node.args[0])
                return INT
            case ast.Name(id=name) if name in BUILT_IN and name not in self.source.scope:
                return self._built_in(node, name)
            case ast.Attribute(value=ast.Name(id="math"), attr="floor" | "isfinite" as name):
                self.expect(node.args[0], REAL)
                return REAL if name == "floor" else BOOL
            case ast.Name(id=name):
                source = self.functions.sources.found(name, self.source.scope)
                if isinstance(source, Source):
                    return self._call_of(node, source)
        raise self.source.refused(node, "a function that is not printed")

    def _built_in(self, node: ast.Call, name: str) -> Kind:
        if name == "len" and len(node.args) == 1:
            self.kind(node.args[0])
            self.known_length(node.args[0])
            return INT
        kind = self._numbers(node.args)
        count = 2 if name in ("max", "min") else 1
        if len(node.args) != count or (name == "int" and kind is REAL) or (kind is BOOL and name == "abs"):
            raise self.source.refused(node, "a function that is not printed")
        return {"float": REAL, "int": INT}.get(name, INT if kind is BOOL else kind)

    def _call_of(self, node: ast.Call, source: Source) -> Kind:
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
            if name in called.lengths:
                self.known_length(item)
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


def is_floor(node: ast.expr) -> bool:
    """Whether an expression is a call of ``math.floor``."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "math.floor"
