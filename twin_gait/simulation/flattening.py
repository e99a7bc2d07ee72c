"""Rewrite functions that share one bundle of arrays so that each takes the arrays it uses.

The episode loop hands an :class:`~twin_gait.simulation.episode.Episode` from function to function, which
reads well. Compiled so, every function copies a structure of fifty arrays. This module turns
``inputs.name`` and ``state.name`` into arguments ``inputs_name`` and ``state_name``, for each function
those that it or the functions it calls use.
"""

from __future__ import annotations

import ast

BUNDLE = "episode"
PARTS = ("inputs", "state")


def flatten_bundle(text: str) -> tuple[str, dict[str, list[str]]]:
    """Rewrite every function of a source text whose first parameter is the bundle.

    Args:
        text: Python source of functions.

    Returns:
        The rewritten source, and for every rewritten function the names of its array arguments in
        order.
    """
    tree = ast.parse(text)
    functions = {
        node.name: node
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.args.args and node.args.args[0].arg == BUNDLE
    }
    used = _transitive({name: _direct(node) for name, node in functions.items()}, functions)
    arguments = {name: sorted(fields) for name, fields in used.items()}
    for name, node in functions.items():
        node.args.args[:1] = [ast.arg(arg=item) for item in arguments[name]]
        _Rewriter(arguments).visit(node)
        node.body = [statement for statement in node.body if not _unpacks(statement)]
        left = [item for item in ast.walk(node) if isinstance(item, ast.Name) and item.id == BUNDLE]
        assert not left, f"{name} uses {BUNDLE} other than in '{_UNPACKING}' or as a first argument"
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n", arguments


def _is_field(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in PARTS


def _direct(function: ast.FunctionDef) -> set[str]:
    """Arrays that a function names itself."""
    return {
        f"{node.value.id}_{node.attr}"
        for node in ast.walk(function)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in PARTS
    }


def _transitive(direct: dict[str, set[str]], functions: dict[str, ast.FunctionDef]) -> dict[str, set[str]]:
    """Arrays that a function or anything it calls names."""
    used = {name: set(fields) for name, fields in direct.items()}
    grown = True
    while grown:
        grown = False
        for name, function in functions.items():
            for node in ast.walk(function):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                    more = used.get(node.func.id, set()) - used[name]
                    used[name] |= more
                    grown = grown or bool(more)
    return used


_UNPACKING = "inputs, state = (episode.inputs, episode.state)"


def _unpacks(statement: ast.stmt) -> bool:
    """Whether a statement is the line that takes the bundle apart."""
    return ast.unparse(statement) == _UNPACKING


class _Rewriter(ast.NodeTransformer):
    """Replaces fields by names and the bundle in calls by the arrays that the callee takes."""

    def __init__(self, arguments: dict[str, list[str]]) -> None:
        self._arguments = arguments

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """``state.q`` becomes ``state_q``."""
        if _is_field(node):
            assert isinstance(node.value, ast.Name)  # _is_field saw it
            return ast.copy_location(ast.Name(id=f"{node.value.id}_{node.attr}", ctx=node.ctx), node)
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """``f(episode, x)`` becomes ``f(state_q, …, x)``."""
        self.generic_visit(node)
        takes = self._arguments.get(node.func.id) if isinstance(node.func, ast.Name) else None
        if (
            takes is not None
            and node.args
            and isinstance(node.args[0], ast.Name)
            and node.args[0].id == BUNDLE
        ):
            node.args[:1] = [ast.Name(id=item, ctx=ast.Load()) for item in takes]
        return node
