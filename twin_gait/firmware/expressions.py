"""Expressions: their kind, the records that they change, and their text in C, in the order of Python."""

import ast
import math
from collections.abc import Sequence
from dataclasses import replace

from twin_gait.firmware.function import Function, Functions
from twin_gait.firmware.kinds import BOOL, INT, REAL, SCALARS, Kind, ListKind, Scalar, joined
from twin_gait.firmware.layout import RESERVED_WORDS, identifier
from twin_gait.firmware.source import Source
from twin_gait.firmware.values import (
    AND,
    BIT_AND,
    BIT_OR,
    BIT_XOR,
    CHOICE,
    EQUALITY,
    OR,
    PRIMARY,
    PRODUCT,
    RELATION,
    SHIFT,
    SUM,
    UNARY,
    Value,
    number,
)

# Text in C, precedence, and accepted kinds. Integer division differs in C, and is a function of real.h.
OPERATORS: dict[type[ast.operator], tuple[str, int, tuple[Scalar, ...]]] = {
    ast.Add: ("+", SUM, (INT, REAL)),
    ast.Sub: ("-", SUM, (INT, REAL)),
    ast.Mult: ("*", PRODUCT, (INT, REAL)),
    ast.Div: ("/", PRODUCT, (REAL,)),
    ast.FloorDiv: ("int_divide", PRIMARY, (INT,)),
    ast.Mod: ("int_modulo", PRIMARY, (INT,)),
    ast.LShift: ("<<", SHIFT, (INT,)),
    ast.RShift: (">>", SHIFT, (INT,)),
    ast.BitAnd: ("&", BIT_AND, (INT, BOOL)),
    ast.BitXor: ("^", BIT_XOR, (INT, BOOL)),
    ast.BitOr: ("|", BIT_OR, (INT, BOOL)),
}
SIGNS: dict[type[ast.unaryop], tuple[str, tuple[Scalar, ...]]] = {
    ast.USub: ("-", (INT, REAL)),
    ast.Invert: ("~", (INT,)),
    ast.Not: ("!", (BOOL,)),
}
RELATIONS: dict[type[ast.cmpop], tuple[str, int]] = {
    ast.Lt: ("<", RELATION),
    ast.LtE: ("<=", RELATION),
    ast.Gt: (">", RELATION),
    ast.GtE: (">=", RELATION),
    ast.Eq: ("==", EQUALITY),
    ast.NotEq: ("!=", EQUALITY),
}
BUILT_IN = {"abs": 1, "max": 2, "min": 2, "len": 1, "float": 1, "int": 1}  # number of arguments by name


class Expressions:
    """Analyses and prints the expressions of one function."""

    def __init__(
        self, functions: Functions, function: Function, taken: frozenset[str] = RESERVED_WORDS
    ) -> None:
        """Store the analysed function, and names that are not available for its variables."""
        self.functions, self.function, self.source = functions, function, function.source
        self.taken = taken
        self.alone: ast.expr | None = None  # expression that is its whole statement

    def local(self, name: str) -> str:
        """Return the name in C of an argument or a variable of the function."""
        return identifier(name, self.taken)

    def kind_of_name(self, name: str) -> Kind:
        """Return the kind of an argument or a variable of the function; None for any other name."""
        return self.function.params.get(name) or self.function.locals.get(name)

    def fit(self, node: ast.AST, value: Value, expected: Kind) -> Value:
        """Convert a value to a kind; raise FirmwareError if the kind cannot represent it."""
        kind = value.kind
        widened = (kind in (INT, BOOL) and expected is REAL) or (kind is BOOL and expected is INT)
        if kind != expected and not widened and joined(kind, expected) is None:
            raise self.source.print_error(node, f"is {kind} where {expected} is expected")
        return value.in_kind(expected)

    def expect(self, node: ast.expr, expected: Kind) -> Value:
        """Return an expression of a given kind."""
        return self.fit(node, self.value(node), expected)

    def mark_written(self, value: Value) -> None:
        """Record that a record or list is written to, and so all records through which it is reached."""
        self.functions.mutable.update(field for field in value.fields if field is not None)
        if value.name not in self.function.written:
            self.function.written.add(value.name)
            for other in self.function.aliases.get(value.name, ()):
                self.mark_written(other)

    def length(self, node: ast.AST, value: Value) -> int:
        """Return the length of a list and record that it is relevant; raise FirmwareError if unknown."""
        if not isinstance(value.kind, ListKind) or value.kind.length is None:
            raise self.source.print_error(node, "is not a list with one known length")
        self._note_length(value)
        return value.kind.length

    def _note_length(self, value: Value) -> None:
        if not value.fields:
            self.function.lengths.add(value.name)
            for other in self.function.aliases.get(value.name, ()):
                self._note_length(other)

    def numbers(self, nodes: Sequence[ast.expr]) -> tuple[list[Value], Scalar]:
        """Return several numbers, and the kind that can represent all of them."""
        values = [self.value(node) for node in nodes]
        kinds = [value.kind for value in values]
        for node, kind in zip(nodes, kinds, strict=True):
            if not isinstance(kind, Scalar):
                raise self.source.print_error(node, "is not a number")
        return values, REAL if REAL in kinds else INT if INT in kinds else BOOL

    def statement_value(self, node: ast.expr) -> Value:
        """Return an expression that is a whole statement, in which it may change records."""
        self.alone = node
        return self.value(node)

    def value(self, node: ast.expr) -> Value:
        """Return an expression."""
        match node:
            case ast.Constant(value=bool() | int() | float() as value):
                kind = SCALARS[type(value)]
                return Value(kind, number(value, kind))
            case ast.Name(id=name) if self.kind_of_name(name) is not None:
                return Value(self.kind_of_name(name), self.local(name), is_address=True, name=name)
            case ast.Name():
                return self._constant(node)
            case ast.Attribute(value=ast.Name(id="math"), attr=name):
                return Value(REAL, number(getattr(math, name), REAL))
            case ast.Attribute():
                return self._field(node)
            case ast.Subscript():
                return self._entry_of(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BinOp():
                return self._binary(node)
            case ast.BoolOp(op=op, values=items):
                sign, binds = ("&&", AND) if isinstance(op, ast.And) else ("||", OR)
                parts = [self.expect(item, BOOL) for item in items]
                # Brackets are added for operands of lower precedence, and for an "and" within an "or",
                # because compilers warn without them.
                text = f" {sign} ".join(part.inside(BIT_OR) for part in parts)
                return Value(BOOL, text, binds)
            case ast.Compare():
                return self._comparison(node)
            case ast.IfExp(test=test, body=body, orelse=other):
                values, kind = self.numbers([body, other])
                parts = [self.expect(test, BOOL), *(item.in_kind(kind) for item in values)]
                given, yes, no = (part.inside(CHOICE + 1) for part in parts)
                return Value(kind, f"{given} ? {yes} : {no}", CHOICE)
            case ast.Call():
                return self.call(node)
        raise self.source.print_error(node, "this kind of expression cannot be printed")

    def _field(self, node: ast.Attribute) -> Value:
        """Return a field of a record, which may be written to."""
        record = self.value(node.value)
        if not isinstance(record.kind, type):
            raise self.source.print_error(node, "is not a field of a record")
        field = (record.kind, node.attr)
        kind = self.functions.shapes.fields.get(field[0], {}).get(node.attr)
        if kind is None:
            raise self.source.print_error(node, f"no sample of {field[0].__name__} has the field {node.attr}")
        self.functions.used.add(field)
        text = f"{record.text}{'->' if record.is_address else '.'}{identifier(node.attr)}"
        reached, address = (*record.fields, field), field not in self.functions.mutable
        return replace(record, kind=kind, text=text, is_address=address, fields=reached)

    def _entry_of(self, node: ast.Subscript) -> Value:
        """Return an entry of a list, which may be written to."""
        items, at = self.value(node.value), self.expect(node.slice, INT)
        if not isinstance(items.kind, ListKind) or isinstance(node.slice, ast.UnaryOp):
            raise self.source.print_error(node, "is not an entry of a list, counted from its beginning")
        kind, text, reached = items.kind.item, f"{items.text}[{at.text}]", (*items.fields, None)
        return replace(items, kind=kind, text=text, is_address=False, fields=reached)

    def _constant(self, node: ast.Name) -> Value:
        value = self.functions.sources.resolve(node.id, self.source.scope)
        kind = SCALARS.get(type(value))
        if kind is None:
            raise self.source.print_error(node, "is not a constant number")
        self.function.constants[node.id] = value
        return Value(kind, identifier(node.id))

    def _unary(self, node: ast.UnaryOp) -> Value:
        (inner,), kind = self.numbers([node.operand])
        sign, kinds = SIGNS.get(type(node.op), ("", ()))
        if kind not in kinds:
            raise self.source.print_error(node, f"this operator cannot be printed for {kind}")
        text = inner.inside(UNARY)
        text = f"{sign}({text})" if text[0] == sign == "-" else sign + text
        return Value(inner.kind, text, UNARY)

    def _binary(self, node: ast.BinOp) -> Value:
        operands, kind = self.numbers([node.left, node.right])
        kind = REAL if isinstance(node.op, ast.Div) else kind
        sign, binds, kinds = OPERATORS.get(type(node.op), ("", PRIMARY, ()))
        if kind not in kinds:
            raise self.source.print_error(node, "this kind of arithmetic cannot be printed")
        left, right = (operand.in_kind(kind) for operand in operands)
        if binds == PRIMARY:
            return Value(kind, f"{sign}({left.text}, {right.text})")
        # Operands of an operator on bits are in brackets, because compilers warn without them.
        beside = (UNARY, UNARY) if binds <= SHIFT else (binds, binds + 1)
        return Value(kind, f"{left.inside(beside[0])} {sign} {right.inside(beside[1])}", binds)

    def _comparison(self, node: ast.Compare) -> Value:
        """Return comparisons, also in a chain."""
        items, _ = self.numbers([node.left, *node.comparators])
        parts, binds = [], AND
        for left, op, right in zip(items, node.ops, items[1:], strict=False):
            if type(op) not in RELATIONS:
                raise self.source.print_error(node, "this kind of comparison cannot be printed")
            sign, binds = RELATIONS[type(op)]
            kind = REAL if REAL in (left.kind, right.kind) else INT
            parts.append(f"{left.in_kind(kind).inside(SHIFT)} {sign} {right.in_kind(kind).inside(SHIFT)}")
        return Value(BOOL, " && ".join(parts), binds if len(parts) == 1 else AND)

    def call(self, node: ast.Call) -> Value:
        """Return a call of a function of real.h or of a printed function."""
        match node:
            case ast.Call(keywords=[_, *_]):
                raise self.source.print_error(node, "arguments must be given by position")
            case ast.Call(func=ast.Name(id="int"), args=[ast.Call(ast.Attribute(attr="floor")) as inner]):
                floor = self.call(inner)
                return replace(floor, kind=INT, text=floor.text.replace("real", "int", 1))
            case ast.Call(func=ast.Name(id=name)) if name in BUILT_IN and name not in self.source.scope:
                return self._built_in(node, name)
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr="floor" | "isfinite" as name)):
                given = self.expect(node.args[0], REAL)
                return Value(REAL if name == "floor" else BOOL, f"real_{name}({given.text})")
            case ast.Call(func=ast.Name(id=name)):
                source = self.functions.sources.resolve(name, self.source.scope)
                if isinstance(source, Source):
                    return self._call_of(node, source)
        raise self.source.print_error(node, "this function cannot be printed")

    def _built_in(self, node: ast.Call, name: str) -> Value:
        if name in ("max", "min") and len(node.args) > 2:
            first = ast.copy_location(ast.Call(node.func, node.args[:-1], []), node)
            return self._built_in(
                ast.copy_location(ast.Call(node.func, [first, node.args[-1]], []), node), name
            )
        if len(node.args) != BUILT_IN[name]:
            raise self.source.print_error(node, "this function cannot be printed")
        if name == "len":
            return Value(INT, str(self.length(node.args[0], self.value(node.args[0]))))
        values, kind = self.numbers(node.args)
        if (name == "int" and kind is REAL) or (name == "abs" and kind is BOOL):
            raise self.source.print_error(node, "this function cannot be printed")
        kind = {"float": REAL, "int": INT}.get(name, INT if kind is BOOL else kind)
        called = f"({kind})" if name in ("float", "int") else f"{'real' if kind is REAL else 'int'}_{name}"
        return Value(kind, f"{called}({', '.join(value.in_kind(kind).text for value in values)})")

    def _call_of(self, node: ast.Call, source: Source) -> Value:
        arguments, defaults = source.tree.args.args, source.tree.args.defaults
        node.args += defaults[len(defaults) - len(arguments) + len(node.args) :]
        given = [self.value(item) for item in node.args]
        called = self.function.calls[node] = self.functions.called(source, [item.kind for item in given])
        texts = []
        for item, value, (name, expected) in zip(node.args, given, called.params.items(), strict=True):
            texts.append(self.fit(item, value, expected).text)
            if name in called.written:
                self.mark_written(value)
            if name in called.lengths:
                self.length(item, value)
        if called.writes and node is not self.alone:  # C may evaluate other operands before or after it
            problem = "changes records in an expression that reads other values; assign its result to a name"
            raise self.source.print_error(node, problem)
        return Value(called.returns, f"{called.name}({', '.join(texts)})")
