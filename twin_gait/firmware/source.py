"""The functions to be printed, read and simplified: excluded branches are removed, pairs are unpacked.

A constant excludes a branch. Names are looked up as :mod:`twin_gait.simulation.binding` binds them: first the
given names, then the globals of the function.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from types import FunctionType
from typing import Any, TypeAlias, get_type_hints

from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.kinds import SCALARS

# Function that rewrites the tree of a function with its scope.
Rewrite: TypeAlias = Callable[[ast.FunctionDef, Mapping[str, Any]], ast.FunctionDef]


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A function to be printed."""

    name: str  # name in Python
    module: str  # module that contains it
    text: str  # original text
    first_line: int  # number of its first line in the file
    tree: ast.FunctionDef  # simplified syntax tree
    scope: Mapping[str, Any]  # values of its global names
    hints: Mapping[str, Any]  # annotations of its arguments and its result

    def print_error(self, node: ast.AST, problem: str) -> FirmwareError:
        """Return the error for a construct that cannot be printed; it names function, line and construct."""
        line = self.first_line - 1 + getattr(node, "lineno", 1)
        shown = " ".join(ast.unparse(node).split()) if isinstance(node, (ast.expr, ast.stmt)) else ""
        shown = f"{shown[:60]}…" if len(shown) > 60 else shown
        return FirmwareError(f"{self.module}.{self.name}, line {line}: {shown}: {problem}")


class Sources:
    """All functions by name or by the function itself, each read once."""

    def __init__(self, names: Mapping[str, Any], text: str, rewrite: Rewrite | None = None) -> None:
        """Store ``names``, which replace globals, and the functions of ``text``, which replace them, too.

        ``rewrite``: returns the tree of a function in constructs that the printer has.
        """
        self.names, self._text, self._rewrite = names, text, rewrite
        self._texts = {item.name: item for item in ast.parse(text).body if isinstance(item, ast.FunctionDef)}
        self._read: dict[Any, Source] = {}

    def resolve(self, name: str, scope: Mapping[str, Any]) -> Any:
        """Return the value of a global name: a :class:`Source`, a number, a module; None if there is none."""
        if name in self._texts:
            return self._source(name, scope.get(name))
        value = self.names.get(name, scope.get(name))
        return self.source_of(value) if isinstance(value, FunctionType) else value

    def source_of(self, function: Callable[..., Any]) -> Source:
        """Return the source of a function, or of its replacement."""
        return self._source(function.__name__, function)

    def _source(self, name: str, function: Any) -> Source:
        """Return the source of a function, from the text if it is there.

        In this case ``function``, the replaced one, gives the annotations of the arguments.
        """
        key = name if name in self._texts else function
        if key not in self._read:
            hints = {} if function is None else get_type_hints(function)
            if name in self._texts:
                tree = self._texts[name]
                text = ast.get_source_segment(self._text, tree) or ""
                source = Source(name, "generated", text, 1, tree, {}, hints)
            else:
                lines, first = inspect.getsourcelines(function)
                text = textwrap.dedent("".join(lines))
                (tree,) = (item for item in ast.parse(text).body if isinstance(item, ast.FunctionDef))
                source = Source(name, function.__module__, text, first, tree, function.__globals__, hints)
            if self._rewrite is not None:
                tree = self._rewrite(tree, source.scope)
            names = (node for node in ast.walk(tree) if isinstance(node, ast.Name))
            assigned = {node.id for node in names if isinstance(node.ctx, ast.Store)}
            assigned |= {item.arg for item in tree.args.args}
            _Folding(self, source, assigned).generic_visit(tree)
            self._read[key] = source
        return self._read[key]


class _Folding(ast.NodeTransformer):
    """Transformer that evaluates constant conditions, and assigns pairs one after the other."""

    def __init__(self, sources: Sources, source: Source, assigned: set[str]) -> None:
        self.sources, self.source, self.own = sources, source, assigned

    def value(self, node: ast.expr) -> Any:
        """Return the value of an expression of constants only; None for any other expression."""
        constants = {}
        for item in ast.walk(node):
            if isinstance(item, (ast.Call, ast.Attribute, ast.Subscript)):
                return None
            if isinstance(item, ast.Name):
                found = None if item.id in self.own else self.sources.resolve(item.id, self.source.scope)
                if type(found) not in SCALARS:
                    return None
                constants[item.id] = found
        # The expression is part of a function of this package or of a generated kernel, and every name in it
        # is a number. No text of a user is evaluated (tests/firmware/test_hostile_names.py).
        return eval(compile(ast.Expression(node), "constants", "eval"), {}, constants)

    def visit_If(self, node: ast.If) -> Any:
        self.generic_visit(node)
        value = self.value(node.test)
        return node if value is None else (node.body if value else node.orelse) or _at(node, ast.Pass())

    def visit_IfExp(self, node: ast.IfExp) -> Any:
        self.generic_visit(node)
        value = self.value(node.test)
        return node if value is None else node.body if value else node.orelse

    def visit_BoolOp(self, node: ast.BoolOp) -> Any:
        self.generic_visit(node)
        decisive, values = isinstance(node.op, ast.Or), list(map(self.value, node.values))
        if any(value is not None and bool(value) is decisive for value in values):
            return _at(node, ast.Constant(decisive))
        kept = [item for item, value in zip(node.values, values, strict=True) if value is None]
        if len(kept) < 2:
            return kept[0] if kept else _at(node, ast.Constant(not decisive))
        return _at(node, ast.BoolOp(node.op, kept))

    def visit_AugAssign(self, node: ast.AugAssign) -> Any:
        read = copy(node.target)
        read.ctx = ast.Load()
        return self.visit(_at(node, ast.Assign([node.target], ast.BinOp(read, node.op, node.value))))

    def visit_Assign(self, node: ast.Assign) -> Any:
        self.generic_visit(node)
        target, value = node.targets[0], node.value
        calls = any(isinstance(item, ast.Call) for item in ast.walk(value))
        if len(node.targets) > 1 and not calls and not any(_touches(item, value) for item in node.targets):
            return [_at(node, ast.Assign([target], value)) for target in node.targets]
        if not (isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)):
            return node
        if len(target.elts) != len(value.elts):
            raise self.source.print_error(node, "the number of names differs from the number of values")
        for index, item in enumerate(target.elts):
            if any(_touches(item, later) for later in value.elts[index + 1 :]):
                raise self.source.print_error(node, "values are exchanged; assign them one by one")
        pairs = zip(target.elts, value.elts, strict=True)
        return [_at(node, ast.Assign([left], right)) for left, right in pairs]


def _at(node: ast.AST, made: ast.AST) -> ast.AST:
    """Return a replacement of a node, at the same line."""
    return ast.fix_missing_locations(ast.copy_location(made, node))


def _touches(target: ast.expr, value: ast.expr) -> bool:
    """Return whether a value may change when a name, a field or an entry is assigned."""
    for item in ast.walk(value):
        called = isinstance(item, ast.Call) and not isinstance(target, ast.Name)
        if called or (type(item) is type(target) and _last_name(item) == _last_name(target)):
            return True
    return False


def _last_name(node: ast.AST) -> str:
    """Return the name of a name or a field; empty for the entry of a list, which may be any entry."""
    return getattr(node, "id", getattr(node, "attr", ""))
