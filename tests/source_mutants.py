"""Single mutations of Python functions, in which one operator, constant or statement differs."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Any

_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Mod: ast.Mult,
}


def _changes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the replacements of one node."""
    if isinstance(node, ast.Compare):
        for other in _COMPARISONS.get(type(node.ops[0]), ()):
            yield ast.Compare(node.left, [other(), *node.ops[1:]], node.comparators)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        yield ast.BinOp(node.left, _OPERATORS[type(node.op)](), node.right)
    elif isinstance(node, ast.UnaryOp):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield ast.Constant(not node.value if isinstance(node.value, bool) else node.value + 1)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Assign | ast.AugAssign | ast.Continue | ast.Raise):
        yield ast.Pass()


def source_mutants(module: ModuleType, functions: set[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Mutate functions of a module one place at a time.

    Args:
        module: The module, which is not changed.
        functions: Names of its functions and methods.

    Yields:
        Description of the change (``function: line: old → new``) and namespace of the changed module.
    """
    source = inspect.getsource(module)
    for site, (*_, node) in enumerate(_find_sites(ast.parse(source), functions)):
        for choice in range(len(list(_changes(node)))):
            yield _mutant(source, module.__name__, functions, site, choice)


def _mutant(
    source: str, module: str, functions: set[str], site: int, choice: int
) -> tuple[str, dict[str, Any]]:
    tree = ast.parse(source)
    name, parent, field, index, node = list(_find_sites(tree, functions))[site]
    changed = list(_changes(node))[choice]
    line = source.splitlines()[node.lineno - 1].strip() if hasattr(node, "lineno") else ""
    text = f"{name}: {line}: {ast.unparse(node)} → {ast.unparse(changed)}"
    _put(parent, field, index, changed)
    namespace: dict[str, Any] = {"__name__": module}
    exec(compile(ast.fix_missing_locations(tree), module, "exec"), namespace)
    return text, namespace


MutationSite = tuple[str, ast.AST, str, int | None, ast.AST]


def _find_sites(tree: ast.AST, functions: set[str]) -> Iterator[MutationSite]:
    for item in ast.walk(tree):
        if isinstance(item, ast.FunctionDef) and item.name in functions:
            for part in ast.walk(item):
                yield from _children(item.name, part)


def _children(name: str, parent: ast.AST) -> Iterator[MutationSite]:
    if isinstance(parent, ast.arguments | ast.JoinedStr | ast.Raise):
        return
    for field, value in ast.iter_fields(parent):
        if field in ("annotation", "returns", "msg"):
            continue
        if isinstance(value, list):
            yield from (
                (name, parent, field, k, item) for k, item in enumerate(value) if isinstance(item, ast.AST)
            )
        elif isinstance(value, ast.AST):
            yield name, parent, field, None, value


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node
