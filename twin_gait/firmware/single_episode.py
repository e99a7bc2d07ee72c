"""Rewriting of the steps of the simulation for one episode, so that the printer can read them.

The steps are written for any backend: they loop over lanes and over tuples of indices, and apply laws in
vectors. The rewritten functions have the same operations in the same order.
"""

import ast
import inspect
import math
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from types import FunctionType
from typing import Any, get_args

_LANES = ("vector_lanes", "scalar_lanes")


def real_sqrt(x: float) -> float:
    """Return the square root."""
    return math.sqrt(x)


class SingleEpisode:
    """Rewriting of functions for one episode without a log."""

    def __init__(self, build_flags: Mapping[str, Any]) -> None:
        """Store the build flags; those that are tuples are indices of coordinates."""
        self.build_flags = build_flags

    def __call__(self, tree: ast.FunctionDef, scope: Mapping[str, Any]) -> ast.FunctionDef:
        """Return the rewritten tree of a function with a scope."""
        made: ast.FunctionDef = _Rewriting(self.build_flags, scope).visit(tree)
        return ast.fix_missing_locations(made)


class _Rewriting(ast.NodeTransformer):
    def __init__(self, build_flags: Mapping[str, Any], scope: Mapping[str, Any]) -> None:
        self.indices = {name: value for name, value in build_flags.items() if isinstance(value, tuple)}
        self.stages, self.scope = bool(build_flags["WITH_RK4"]), scope
        self.renamed: dict[str, ast.expr] = {}

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        """Replace an argument that is a tuple by its numbers."""
        arguments = []
        for item in node.args.args:
            hint = item.annotation
            if isinstance(hint, ast.Subscript) and isinstance(hint.slice, ast.Tuple):
                arguments += [ast.arg(f"{item.arg}_{number}") for number in range(len(hint.slice.elts))]
                self.renamed[item.arg] = ast.Constant(None)
            else:
                arguments.append(item)
        node.args.args = arguments
        self.generic_visit(node)
        return node

    def visit_For(self, node: ast.For) -> Any:
        """Replace a loop over lanes by its body, and a loop over indices by a loop over a range."""
        match node:
            case ast.For(target=ast.Name(id=one), iter=ast.Call(func=ast.Name(id=name), args=[episode])) if (
                name in _LANES
            ):
                self.renamed[one] = episode
                return _flat(map(self.visit, node.body))
            case ast.For(target=ast.Name(id=index), iter=ast.Name(id=name)) if name in self.indices:
                return self.visit(_loop(index, self.indices[name], node.body))
            case ast.For(iter=ast.Call(func=ast.Name(id="range"), args=[ast.Attribute() as end])):
                # C would compute the end again after every change of the episode.
                node.iter = _expression("range(end)")
                return [ast.Assign([ast.Name("end", ast.Store())], self.visit(end)), self.generic_visit(node)]
        return self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> Any:
        """Replace the present state or that of a stage, and another name of a function.

        Without a log, the Runge-Kutta method evaluates stages only, and Euler's method none.
        """
        match node:
            case ast.Assign(
                targets=[ast.Tuple(elts=names)], value=ast.Call(func=ast.Name(id="_state"), args=[episode, _])
            ):
                place = f"{ast.unparse(self.visit(episode))}{'.integrator' if self.stages else ''}"
                pairs = zip(names, ("q", "v"), strict=True)
                made = [(name, f"{place}.{field}") for name, field in pairs if ast.unparse(name) != "_"]
                return [ast.Assign([name], _expression(text)) for name, text in made]
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Name(id=law) as value) if isinstance(
                self.scope.get(law), FunctionType
            ):
                self.renamed[name] = value
                return []
        return self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> Any:
        """Replace a law that is applied to vectors by a loop."""
        match node.value:
            case ast.Call(
                func=ast.Name(id="vector_map"), args=[e, ast.Name(id=indices), staged, read, law, write]
            ):
                called = ast.unparse(self.visit(law))
                signature = inspect.signature(self.scope[called])
                taken = _numbered("argument", len(signature.parameters))
                found = _numbered("found", len(get_args(signature.return_annotation)))
                first, last = f"{ast.unparse(e)}, index", ast.unparse(staged)
                lines = [
                    f"{taken} = {ast.unparse(read)}({first}, {last})",
                    f"{found} = {called}({taken})",
                    f"{ast.unparse(write)}({first}, {found})",
                ]
                return _loop("index", self.indices[indices], ast.parse("\n".join(lines)).body)
        return self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> Any:
        """Replace the row of the noise, which is the same in every tick, and functions of Python."""
        match node:
            case ast.Call(func=ast.Name(id="int"), args=[ast.Name(id=name)]):
                return _expression(f"int(math.floor({name}))")  # the steps truncate positive numbers only
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr="sqrt")):
                node.func = ast.Name("real_sqrt", ast.Load())
            case ast.Call(func=ast.Name(id="noise_row"), args=[episode, _]):
                return _expression(f"{ast.unparse(self.visit(episode))}.noise")
        return self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> Any:
        """Replace an entry of an argument that is a tuple."""
        match node:
            case ast.Subscript(value=ast.Name(id=name), slice=ast.Constant(value=number)) if isinstance(
                self.renamed.get(name), ast.Constant
            ):
                return ast.Name(f"{name}_{number!r}", ast.Load())
        return self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> Any:
        """Replace the condition of steps that only the log needs."""
        if ast.unparse(node).endswith(".recording.on"):
            return ast.Constant(False)
        return self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Replace another name of the episode or of a function, and the test whether there are indices."""
        if node.id in self.indices:
            return ast.Constant(bool(self.indices[node.id]))
        return deepcopy(self.renamed.get(node.id, node))


def _loop(index: str, values: Sequence[int], body: list[ast.stmt]) -> ast.For:
    """Return a loop over some integers: over a range, with a test if the range has others between them."""
    first, end = (values[0], values[-1] + 1) if values else (0, 0)
    if len(values) < end - first:
        mask = sum(1 << value for value in values)
        body = [ast.If(_expression(f"({mask} >> {index}) & 1 == 1"), body, [])]
    return ast.For(ast.Name(index, ast.Store()), _expression(f"range({first}, {end})"), body, [])


def _numbered(name: str, count: int) -> str:
    return ", ".join(f"{name}_{number}" for number in range(count))


def _expression(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _flat(items: Iterable[Any]) -> list[ast.stmt]:
    return [one for item in items for one in (item if isinstance(item, list) else [item])]
