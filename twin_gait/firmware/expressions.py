"""Expressions in C, every operation in the order of Python."""

import ast
import math
from collections.abc import Sequence
from typing import NamedTuple

from twin_gait.firmware.expression_kinds import is_floor
from twin_gait.firmware.function import Function, Functions
from twin_gait.firmware.kinds import BOOL, INT, REAL, Kind, ListKind, RecordKind, Scalar
from twin_gait.firmware.layout import TAKEN, identifier

# How strongly operators bind in C; what is stronger needs no brackets.
PRIMARY, UNARY, PRODUCT, SUM, SHIFT, RELATION, EQUALITY, BIT_AND, BIT_XOR, BIT_OR, AND, OR, CHOICE = range(
    13, 0, -1
)
BINARY: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", SUM),
    ast.Sub: ("-", SUM),
    ast.Mult: ("*", PRODUCT),
    ast.Div: ("/", PRODUCT),
    ast.LShift: ("<<", SHIFT),
    ast.RShift: (">>", SHIFT),
    ast.BitAnd: ("&", BIT_AND),
    ast.BitXor: ("^", BIT_XOR),
    ast.BitOr: ("|", BIT_OR),
}
# Those that C does otherwise than Python: functions of real.h.
WHOLE = {ast.FloorDiv: "int_divide", ast.Mod: "int_modulo"}
RELATIONS: dict[type[ast.cmpop], tuple[str, int]] = {
    ast.Lt: ("<", RELATION),
    ast.LtE: ("<=", RELATION),
    ast.Gt: (">", RELATION),
    ast.GtE: (">=", RELATION),
    ast.Eq: ("==", EQUALITY),
    ast.NotEq: ("!=", EQUALITY),
}


class Text(NamedTuple):
    """An expression in C, and how strongly its last operator binds."""

    text: str
    binds: int

    def inside(self, binds: int) -> str:
        """As an operand, in brackets where they are needed."""
        return self.text if self.binds >= binds else f"({self.text})"


class Naming:
    """Names of functions and constants in C.

    Attributes:
        functions: By function.
        taken: Names that no local name may have.
    """

    def __init__(self, functions: Sequence[Function]) -> None:
        """Name all functions."""
        self.functions: dict[Function, str] = {}
        for function in functions:
            name = identifier(function.source.name)
            if name in self.functions.values():
                raise function.source.refused(function.source.tree.args, "another function has the same name")
            self.functions[function] = name
        self.taken = TAKEN | set(self.functions.values())

    def of(self, function: Function) -> str:
        """Name of a function, of real.h too."""
        return self.functions.get(function, function.source.name)

    @staticmethod
    def result(function: Function) -> str:
        """Name of the structure of several numbers that a function returns."""
        return "".join(word.capitalize() for word in function.source.name.split("_")) + "Result"


def number(value: bool | int | float, kind: Scalar) -> str:
    """A literal."""
    if kind is BOOL:
        return "true" if value else "false"
    if kind is INT:
        return str(int(value))
    value = float(value)
    if math.isnan(value):
        return "NAN"
    sign = "-" if math.copysign(1.0, value) < 0.0 else ""
    return f"{sign}INFINITY" if math.isinf(value) else f"{sign}REAL({abs(value)!r})"


class Expressions:
    """Prints the expressions of one function."""

    def __init__(self, functions: Functions, function: Function, naming: Naming) -> None:
        """Keep what is known of the function."""
        self.functions, self.function, self.naming = functions, function, naming

    def local(self, name: str) -> str:
        """An argument or a name of the function."""
        return identifier(name, self.naming.taken)

    def place(self, node: ast.expr) -> tuple[str, bool]:
        """Where a record or a list is, and whether that is its address."""
        match node:
            case ast.Name(id=name):
                return self.local(name), True
            case ast.Attribute(value=base, attr=name):
                kind = self.function.kinds[base]
                assert isinstance(kind, RecordKind)
                return self.field(node), (kind.record, name) not in self.functions.mutable
            case ast.Subscript(value=base, slice=number):
                return f"{self.place(base)[0]}[{self.value(number, INT)}]", False
        raise self.function.source.refused(node, "is no place in a record")

    def field(self, node: ast.Attribute) -> str:
        """A field of a record."""
        text, is_address = self.place(node.value)
        return f"{text}{'->' if is_address else '.'}{identifier(node.attr)}"

    def address(self, node: ast.expr) -> str:
        """Of a record or a list."""
        text, is_address = self.place(node)
        return text if is_address or isinstance(self.function.kinds[node], ListKind) else f"&{text}"

    def value(self, node: ast.expr, wanted: Kind) -> str:
        """An expression as a value of some kind."""
        return self.text(node, wanted).text

    def text(self, node: ast.expr, wanted: Kind) -> Text:
        """As :meth:`value`, with how strongly it binds."""
        kind = self.function.kinds[node]
        if not isinstance(kind, Scalar):
            return Text(self.address(node), UNARY)
        if wanted is REAL and kind is not REAL:
            if isinstance(node, ast.Constant):
                return Text(number(node.value, REAL), PRIMARY)  # type: ignore[arg-type]
            return Text(f"(real){self.plain(node, kind).inside(UNARY)}", UNARY)
        return self.plain(node, kind)

    def plain(self, node: ast.expr, kind: Scalar) -> Text:
        """An expression of its own kind."""
        match node:
            case ast.Constant(value=value):
                return Text(number(value, kind), PRIMARY)  # type: ignore[arg-type]
            case ast.Name(id=name):
                constant = name in self.function.constants
                return Text(identifier(name) if constant else self.local(name), PRIMARY)
            case ast.Attribute(attr=name):
                return Text(self.of_module(node) or self.field(node), PRIMARY)
            case ast.Subscript(value=base, slice=place):
                return Text(f"{self.place(base)[0]}[{self.value(place, INT)}]", PRIMARY)
            case ast.UnaryOp(op=op, operand=operand):
                inner = self.text(operand, kind).inside(UNARY)
                sign = {ast.USub: "-", ast.Invert: "~", ast.Not: "!"}[type(op)]
                return Text(f"{sign}({inner})" if inner[0] == sign == "-" else sign + inner, UNARY)
            case ast.BinOp():
                return self.binary(node, kind)
            case ast.BoolOp(op=op, values=values):
                sign, binds = ("&&", AND) if isinstance(op, ast.And) else ("||", OR)
                parts = [self.text(item, BOOL) for item in values]
                # What binds less strongly, and an "and" within an "or", where compilers warn.
                return Text(f" {sign} ".join(item.inside(BIT_OR) for item in parts), binds)
            case ast.Compare():
                return self.comparison(node)
            case ast.IfExp(test=test, body=body, orelse=other):
                texts = (self.text(test, BOOL), self.text(body, kind), self.text(other, kind))
                given, yes, no = (item.inside(CHOICE + 1) for item in texts)
                return Text(f"{given} ? {yes} : {no}", CHOICE)
            case ast.Call():
                return Text(self.call(node, kind), PRIMARY)
        raise self.function.source.refused(node, "an expression that is not printed")

    def of_module(self, node: ast.Attribute) -> str:
        """A constant of a module; nothing if it is a field of a record."""
        if node.value in self.function.kinds:
            return ""
        value = getattr(math, node.attr, None) if node.attr not in self.function.constants else None
        return identifier(node.attr) if value is None else number(value, REAL)

    def binary(self, node: ast.BinOp, kind: Scalar) -> Text:
        """Arithmetic."""
        left, right = (self.text(item, kind) for item in (node.left, node.right))
        if type(node.op) in WHOLE:
            return Text(f"{WHOLE[type(node.op)]}({left.text}, {right.text})", PRIMARY)
        sign, binds = BINARY[type(node.op)]
        if binds <= SHIFT:  # compilers warn without brackets
            return Text(f"{left.inside(UNARY)} {sign} {right.inside(UNARY)}", binds)
        return Text(f"{left.inside(binds)} {sign} {right.inside(binds + 1)}", binds)

    def comparison(self, node: ast.Compare) -> Text:
        """Comparisons, in a chain too."""
        parts, items = [], [node.left, *node.comparators]
        for left, op, right in zip(items, node.ops, items[1:], strict=False):
            kind = REAL if REAL in (self.function.kinds[left], self.function.kinds[right]) else INT
            sign, binds = RELATIONS[type(op)]
            parts.append(
                f"{self.text(left, kind).inside(SHIFT)} {sign} {self.text(right, kind).inside(SHIFT)}"
            )
        return Text(parts[0], binds) if len(parts) == 1 else Text(" && ".join(parts), AND)

    def call(self, node: ast.Call, kind: Kind) -> str:
        """A call of a function, of real.h or printed."""
        called = self.function.calls.get(node)
        if called is not None:
            wanted = called.params.values()
            given = ", ".join(self.value(item, part) for item, part in zip(node.args, wanted, strict=True))
            return f"{self.naming.of(called)}({given})"
        name = ast.unparse(node.func)
        if name in ("math.floor", "math.isfinite"):
            return f"real_{name.removeprefix('math.')}({self.value(node.args[0], REAL)})"
        if name == "len":
            length = self.function.kinds[node.args[0]]
            assert isinstance(length, ListKind)
            return str(length.length)
        if name == "int" and is_floor(node.args[0]):
            return f"int_floor({self.value(node.args[0].args[0], REAL)})"  # type: ignore[attr-defined]
        if name in ("float", "int"):
            return f"({kind.name})({self.value(node.args[0], kind)})"  # type: ignore[union-attr]
        prefix = "real" if kind is REAL else "int"
        return f"{prefix}_{name}({', '.join(self.value(item, kind) for item in node.args)})"
