"""Replacement of globals in a plain function and in all functions that it calls.

The steps of a loop import placeholders for build flags, kernel and rows. Binding copies every function that a
loop calls and replaces the globals of these names in the copy. If the copies are compiled, a branch on a
constant that is 0 or False is never typed; if not, they are plain Python. No text is rewritten.
"""

import dis
from collections.abc import Callable, Hashable, Mapping
from functools import lru_cache
from itertools import chain
from types import CodeType, FunctionType
from typing import Any

PACKAGE_PREFIX = "twin_gait."  # Modules whose functions are bound; all others are called without a change.

Wrap = Callable[[FunctionType], Any]


def specialize(
    entry: Callable[..., Any],
    names: Mapping[str, Any],
    wrap: Wrap = lambda function: function,
    cache: dict[Hashable, Any] | None = None,
) -> Any:
    """Copy a function, and every function of this package that it calls, with other globals.

    ``entry``: first function of the loop, which is not changed. ``names``: values that replace the globals of
    the same names. ``wrap``: conversion of every copy, for example its compilation. ``cache``: results of
    earlier calls with the same ``wrap``, from which a function with the same code and names is taken; changed
    in place. Returns the converted copy of the entry.
    """
    done: dict[FunctionType, Any] = {}

    def visit(function: FunctionType) -> Any:
        if function in done:
            return done[function]
        scope, code = dict(function.__globals__), function.__code__
        copy = FunctionType(code, scope, function.__name__, function.__defaults__, function.__closure__)
        copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
        copy.__kwdefaults__ = function.__kwdefaults__
        bound = done[function] = wrap(copy)  # before the functions that it calls, so that it may call itself
        for name in _names_in(code):
            value = names.get(name, scope.get(name))
            if is_package_function(value):
                value = visit(value)
            if name in names or name in scope:
                scope[name] = value
        if cache is not None:
            bound = done[function] = cache.setdefault(_identity(copy), bound)
        return bound

    assert isinstance(entry, FunctionType)
    return visit(entry)


def is_package_function(function: Any) -> bool:
    """Return whether an object is a function of this package."""
    return isinstance(function, FunctionType) and (function.__module__ or "").startswith(PACKAGE_PREFIX)


def _identity(function: FunctionType) -> Hashable:
    """Return a key of the behaviour of a function: its code and the values of all names in it."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    defaults = [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).items()]
    named = [function.__globals__.get(name) for name in _names_in(function.__code__)]
    return function.__code__, tuple(_same(value) for value in (*cells, *defaults, *named))


def _same(value: Any) -> Hashable:
    """Return a key that is equal for one object and for equal numbers (0, 0.0, -0.0 and False differ)."""
    if isinstance(value, tuple):
        return type(value), tuple(map(_same, value))
    return (type(value), repr(value)) if isinstance(value, (int, float)) else id(value)


@lru_cache(maxsize=1024)
def _names_in(code: CodeType) -> tuple[str, ...]:
    """Return the globals that code reads, with those of the comprehensions and functions in it."""
    names = [item.argval for item in dis.get_instructions(code) if item.opname == "LOAD_GLOBAL"]
    inner = (_names_in(constant) for constant in code.co_consts if isinstance(constant, CodeType))
    return tuple(dict.fromkeys(chain(names, *inner)))


def kernel_functions(text: str, called: Mapping[str, Any]) -> dict[str, Any]:
    """Return the functions of a generated kernel by name, ready to be bound.

    ``text``: source of the kernel. ``called``: functions that the kernel calls, by name.
    """
    scope = {"__name__": f"{PACKAGE_PREFIX}generated_kernel", **called}
    # The texts are written from numbers and from literals of this package: rigid bodies by index, columns as
    # simulation/log.py declares them. No text of a user is run (tests/firmware/test_hostile_names.py).
    exec(compile(text, "generated kernel", "exec"), scope)
    return {name: item for name, item in scope.items() if is_package_function(item) and name not in called}
