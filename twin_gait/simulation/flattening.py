"""Rewrite the episode loop so that all its arrays of fixed shape are places in two flat arrays.

The loop hands an :class:`~twin_gait.simulation.episode_arrays.Episode` of fifty arrays from function to
function, which reads well. Compiled so, half of the run time goes into counting references to arrays at
every call.
This module turns ``state.measured[joint, 1]`` into ``x[17 + 3 * joint + 1]``, where 17 is the place of
``measured`` among all numbers of the episode, and an array that is handed to a function into its place:

* ``x`` is a pointer to all floating-point numbers, ``k`` to all whole ones;
* an array whose length depends on the gait table or the duration (``loose``) is a pointer of its own;
  every function takes those that it or the functions it calls use, and its length is a number in ``k``.

Nothing is computed differently; only where numbers lie changes.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

BUNDLE = "episode"
PARTS = ("inputs", "state")
FLAT = ("x", "k")


class Place(NamedTuple):
    """Where an array lies.

    Attributes:
        array: ``x`` or ``k``; empty for a loose array, which is a pointer of its own.
        start: Position of its first element; of a loose array, the position of its length in ``k``.
        shape: Its shape; the first number is of no meaning for a loose array.
    """

    array: str
    start: int
    shape: tuple[int, ...]

    @property
    def loose(self) -> bool:
        """Whether the array is a pointer of its own."""
        return not self.array


def flatten(
    text: str, places: Mapping[str, Place], constants: Mapping[str, int], loose: Mapping[str, Place]
) -> tuple[str, dict[str, list[str]]]:
    """Rewrite all functions of a source text.

    Args:
        text: Python source of functions; array arguments are recognised by what they are handed.
        places: Place of every field, by ``inputs_name`` or ``state_name``.
        constants: Whole numbers of ``inputs.integers`` that are known now, by the name of their position.
        loose: Arguments that are loose arrays wherever their names stand.

    Returns:
        The rewritten source, and for every function that takes the bundle the names of the loose arrays
        that follow ``x`` and ``k`` in its arguments.
    """
    tree = ast.parse(text)
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    taking = _loose_arguments(functions, places)
    views = _views(functions, places, loose)
    for name, node in functions.items():
        first = [ast.arg(arg=item) for item in FLAT]
        if name in taking:
            node.args.args[:1] = first + [ast.arg(arg=item) for item in taking[name]]
        elif views[name]:
            node.args.args[:0] = first
        rewriter = _Rewriter(places, constants, taking, views, views[name])
        node.body = [
            item
            for statement in node.body
            if not _unpacks(statement)
            for item in rewriter.statements(statement)
        ]
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n", taking


def _field(node: ast.AST) -> str | None:
    """Name of the field that an expression such as ``state.q`` is."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in PARTS:
        return f"{node.value.id}_{node.attr}"
    return None


def _is_bundle(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id == BUNDLE


def _takes_bundle(function: ast.FunctionDef) -> bool:
    return bool(function.args.args) and function.args.args[0].arg == BUNDLE


def _unpacks(statement: ast.stmt) -> bool:
    """Whether a statement is the line that takes the bundle apart."""
    return ast.unparse(statement) == "inputs, state = (episode.inputs, episode.state)"


def _calls(node: ast.AST) -> list[tuple[str, ast.Call]]:
    found = [item for item in ast.walk(node) if isinstance(item, ast.Call)]
    return [(item.func.id, item) for item in found if isinstance(item.func, ast.Name)]


def _loose_arguments(
    functions: Mapping[str, ast.FunctionDef], places: Mapping[str, Place]
) -> dict[str, list[str]]:
    """Loose arrays that each function with the bundle, or anything it calls, names."""
    used: dict[str, set[str]] = {}
    for name, node in functions.items():
        if _takes_bundle(node):
            fields = {_field(item) for item in ast.walk(node)} - {None}
            used[name] = {item for item in fields if item is not None and places[item].loose}
    grown = True
    while grown:
        grown = False
        for name in used:
            for callee, _ in _calls(functions[name]):
                more = used.get(callee, set()) - used[name]
                used[name] |= more
                grown = grown or bool(more)
    return {name: sorted(fields) for name, fields in used.items()}


def _views(
    functions: Mapping[str, ast.FunctionDef], places: Mapping[str, Place], loose: Mapping[str, Place]
) -> dict[str, dict[str, Place]]:
    """For every function the names in it that stand for arrays, with their shapes.

    An argument is an array if some call hands it one; shapes travel along the calls until nothing new is
    learnt.
    """
    views: dict[str, dict[str, Place]] = {name: {} for name in functions}
    for name, node in functions.items():
        for item in node.args.args:
            if item.arg in loose:
                views[name][item.arg] = loose[item.arg]
    grown = True
    while grown:
        grown = False
        for name, node in functions.items():
            for target, value in _aliases(node):
                grown = _learn(views[name], target, _view(value, places, views[name])) or grown
            for callee, call in _calls(node):
                if callee in functions:
                    names = [item.arg for item in functions[callee].args.args]
                    for argument, value in zip(names, call.args, strict=False):
                        view = None if _is_bundle(value) else _view(value, places, views[name])
                        grown = _learn(views[callee], argument, view) or grown
    return views


def _aliases(function: ast.FunctionDef) -> list[tuple[str, ast.AST]]:
    """Plain assignments of one name in a function."""
    found: list[tuple[str, ast.AST]] = []
    for node in ast.walk(function):
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            continue
        target = node.targets[0]
        if isinstance(target, ast.Name):
            found.append((target.id, node.value))
    return found


def _learn(views: dict[str, Place], name: str, view: Place | None) -> bool:
    if view is None or name in views:
        return False
    views[name] = view
    return True


def _view(node: ast.AST, places: Mapping[str, Place], views: Mapping[str, Place]) -> Place | None:
    """What an expression is a view of; None if it is no array."""
    field = _field(node)
    if field is not None:
        return places[field]
    if isinstance(node, ast.Name):
        return views.get(node.id)
    if isinstance(node, ast.Subscript):
        base = _view(node.value, places, views)
        given = len(_indices(node))
        if base is not None and given < len(base.shape):
            return base._replace(start=-1, shape=base.shape[given:])
    return None


def _place(start: int) -> ast.expr:
    """A place that is handed on; numba would compile a function anew for every number written as such."""
    return ast.parse(f"np.int64({start})", mode="eval").body


def _plain_integer(node: ast.expr) -> ast.expr:
    """A whole number written out, or the name of one, as a number that numba has compiled for before."""
    written = isinstance(node, ast.Constant) and type(node.value) is int
    named = isinstance(node, ast.Name) and node.id.isupper()
    return ast.parse(f"np.int64({ast.unparse(node)})", mode="eval").body if written or named else node


def _indices(node: ast.Subscript) -> list[ast.expr]:
    return list(node.slice.elts) if isinstance(node.slice, ast.Tuple) else [node.slice]


def _truth(node: ast.expr) -> ast.expr:
    """A condition with what is known of it taken out: a constant if all of it is known."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        left, right = node.left, node.comparators[0]
        kind = _COMPARISONS.get(type(node.ops[0]))
        if kind is not None and isinstance(left, ast.Constant) and isinstance(right, ast.Constant):
            return ast.Constant(kind(left.value, right.value))
    if isinstance(node, ast.BoolOp):
        return _joined_truth(node)
    return node


def _joined_truth(node: ast.BoolOp) -> ast.expr:
    deciding = isinstance(node.op, ast.Or)  # the value of a part that settles the whole
    open_parts: list[ast.expr] = []
    for part in map(_truth, node.values):
        if not isinstance(part, ast.Constant):
            open_parts.append(part)
        elif bool(part.value) is deciding:
            # What stands before it has no effects here: conditions only look.
            return ast.Constant(deciding)
    if not open_parts:
        return ast.Constant(not deciding)
    return open_parts[0] if len(open_parts) == 1 else ast.BoolOp(op=node.op, values=open_parts)


_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class _Rewriter(ast.NodeTransformer):
    """Replaces arrays by places, and the bundle in calls by the flat and loose arrays."""

    def __init__(
        self,
        places: Mapping[str, Place],
        constants: Mapping[str, int],
        taking: Mapping[str, list[str]],
        views: Mapping[str, Mapping[str, Place]],
        own: Mapping[str, Place],
    ) -> None:
        self._places, self._constants = places, constants
        self._taking, self._views, self._own = taking, views, own

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """``state.q`` becomes its place, a loose field a name."""
        field = _field(node)
        if field is None:
            return self.generic_visit(node)
        place = self._places[field]
        return ast.Name(id=field, ctx=ast.Load()) if place.loose else _place(place.start)

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """An element of an array becomes one of ``x`` or ``k``; part of an array becomes its place."""
        shape = self._shape_of(node)
        if shape is not None:
            return shape
        known = self._known_constant(node)
        if known is not None:
            return ast.Constant(known)
        view = _view(node.value, self._places, self._own)
        if view is None and isinstance(node.value, ast.Name) and node.value.id not in self._own:
            view = Place("x", -1, (0,))  # a place handed through a tuple: a vector
        if view is None:
            return self.generic_visit(node)
        place = self._position(node, view)
        if len(_indices(node)) < len(view.shape):
            return place
        array = ast.Name(id=view.array, ctx=ast.Load()) if view.array else self.visit(node.value)
        return ast.Subscript(value=array, slice=place, ctx=node.ctx)

    def _position(self, node: ast.Subscript, view: Place) -> ast.expr:
        place: ast.expr | None = None
        if not view.loose:
            field = _field(node.value)
            place = self.visit(node.value) if field is None else ast.Constant(self._places[field].start)
        for number, index in enumerate(_indices(node)):
            stride = math.prod(view.shape[number + 1 :])
            offset: ast.expr = self.visit(index)
            if stride != 1:
                offset = ast.BinOp(left=ast.Constant(stride), op=ast.Mult(), right=offset)
            place = offset if place is None else ast.BinOp(left=place, op=ast.Add(), right=offset)
        assert place is not None  # there is at least one index
        return place

    def _shape_of(self, node: ast.Subscript) -> ast.expr | None:
        """What ``array.shape[0]`` is: a number, or for a loose array where its length stands."""
        if not (isinstance(node.value, ast.Attribute) and node.value.attr == "shape"):
            return None
        view = _view(node.value.value, self._places, self._own)
        if view is None:
            return None
        assert isinstance(node.slice, ast.Constant)
        axis = int(str(node.slice.value))
        if view.loose and axis == 0:
            return ast.Subscript(
                value=ast.Name(id="k", ctx=ast.Load()), slice=ast.Constant(view.start), ctx=ast.Load()
            )
        return ast.Constant(view.shape[axis])

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        """A branch that a known constant rules out is left out, with all that only it calls."""
        test = _truth(self.visit(node.test))
        if not isinstance(test, ast.Constant):
            node.test = test
            node.body = [item for statement in node.body for item in self.statements(statement)]
            node.orelse = [item for statement in node.orelse for item in self.statements(statement)]
            return node
        taken = node.body if test.value else node.orelse
        return [item for statement in taken for item in self.statements(statement)] or [ast.Pass()]

    def statements(self, statement: ast.stmt) -> list[ast.stmt]:
        """What becomes of a statement: itself, several, or those of one branch."""
        visited = self.visit(statement)
        return visited if isinstance(visited, list) else [visited]

    def _known_constant(self, node: ast.Subscript) -> int | None:
        if _field(node.value) != "inputs_integers" or not isinstance(node.slice, ast.Name):
            return None
        return self._constants.get(node.slice.id)

    def _array(self, place: ast.expr, view: Place) -> ast.expr:
        """An array that begins at a place."""
        assert not view.loose, "only arrays of known shape can be handed to other modules"
        text = f"carray(shifted({view.array}, {ast.unparse(place)}), {view.shape})"
        return ast.parse(text, mode="eval").body

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Calls hand over ``x`` and ``k``, and the loose arrays in place of the bundle.

        A function of another module, ``module.function(q)``, gets arrays.
        """
        if isinstance(node.func, ast.Attribute):
            views = [_view(item, self._places, self._own) for item in node.args]
            node.args = [
                self.visit(item) if view is None else self._array(self.visit(item), view)
                for item, view in zip(node.args, views, strict=True)
            ]
            return node
        self.generic_visit(node)
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        first: list[ast.expr] = [ast.Name(id=item, ctx=ast.Load()) for item in FLAT]
        if node.args and _is_bundle(node.args[0]):
            assert name in self._taking, f"{name} is handed the episode but does not take it first"
            pointers = [ast.Name(id=item, ctx=ast.Load()) for item in self._taking[name]]
            node.args[:1] = [*first, *pointers]
        elif self._views.get(name):
            node.args[:0] = first
        if name in self._views:
            node.args = [_plain_integer(item) for item in node.args]
        return node
