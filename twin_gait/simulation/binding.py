"""Stand-in for the module of the same name on the branch of the engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any


def bind(
    entry: Callable[..., Any], names: Mapping[str, Any], wrap: Callable[..., Any] = lambda f: f
) -> Callable[..., Any]:
    """A function with other globals, all the way down."""
    done: dict[Any, Any] = {}

    def visit(function: Any) -> Any:
        if function in done:
            return done[function]
        scope = dict(function.__globals__)
        new = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
        bound = done[function] = wrap(new)
        for name in function.__code__.co_names:
            value = names.get(name, scope.get(name))
            if isinstance(value, FunctionType) and (value.__module__ or "").startswith("twin_gait."):
                value = visit(value)
            if name in names or name in scope:
                scope[name] = value
        return bound

    made: Callable[..., Any] = visit(entry)
    return made
