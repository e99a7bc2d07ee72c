"""Give plain functions other globals, all the way down.

The steps of a loop name what they stand on: structure, kernel, rows. Bound, every function that a loop calls
is a copy whose globals of these names are the real ones. Compiled, a branch on a constant that is 0 or False
is never typed; uncompiled, the same functions are plain Python. No text is rewritten.
"""

import dis
from collections.abc import Callable, Hashable, Mapping
from functools import lru_cache
from itertools import chain
from types import CodeType, FunctionType
from typing import Any

PACKAGE_PREFIX = "twin_gait."  # modules whose functions are bound; all others are called as they are

Wrap = Callable[[FunctionType], Any]


def specialize(
    entry: Callable[..., Any],
    names: Mapping[str, Any],
    wrap: Wrap = lambda function: function,
    cache: dict[Hashable, Any] | None = None,
) -> Any:
    """A function with other globals, and so every function of this package that it calls.

    ``entry``: where the loop begins; it stays as it is. ``names``: what takes the place of globals of the
    same name. ``wrap``: what is made of every copy, for example its compiled form. ``made``: what was made by
    earlier calls with the same ``wrap``: a function whose code and names are the same is taken from there.
    Changed in place. Returns what was made of the copy of the entry.
    """
    done: dict[FunctionType, Any] = {}

    def visit(function: FunctionType) -> Any:
        if function in done:
            return done[function]
        scope, code = dict(function.__globals__), function.__code__
        copy = FunctionType(code, scope, function.__name__, function.__defaults__, function.__closure__)
        copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
        copy.__kwdefaults__ = function.__kwdefaults__
        bound = done[function] = wrap(copy)  # before what it calls, so that it may call itself
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
    """Whether something is a function of this package."""
    return isinstance(function, FunctionType) and (function.__module__ or "").startswith(PACKAGE_PREFIX)


def _identity(function: FunctionType) -> Hashable:
    """What a function does: its code, and all that it names."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    defaults = [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).items()]
    named = [function.__globals__.get(name) for name in _names_in(function.__code__)]
    return function.__code__, tuple(_same(value) for value in (*cells, *defaults, *named))


def _same(value: Any) -> Hashable:
    """Equal for one and the same object, and for equal numbers (0, 0.0, -0.0 and False are four)."""
    if isinstance(value, tuple):
        return type(value), tuple(map(_same, value))
    return (type(value), repr(value)) if isinstance(value, (int, float)) else id(value)


@lru_cache(maxsize=1024)
def _names_in(code: CodeType) -> tuple[str, ...]:
    """Globals that code reads, with those of the comprehensions and functions within it."""
    own = [item.argval for item in dis.get_instructions(code) if item.opname == "LOAD_GLOBAL"]
    inner = (_names_in(constant) for constant in code.co_consts if isinstance(constant, CodeType))
    return tuple(dict.fromkeys(chain(own, *inner)))


def kernel_functions(text: str, called: Mapping[str, Any]) -> dict[str, Any]:
    """Functions of a generated kernel by name, to be bound; ``called``: what they call."""
    scope = {"__name__": f"{PACKAGE_PREFIX}generated_kernel", **called}
    # The texts are written from numbers and from literals of this package: rigid bodies by index, columns as
    # simulation/log.py declares them. No text of a user is run (tests/firmware/test_hostile_names.py).
    exec(compile(text, "generated kernel", "exec"), scope)
    return {name: item for name, item in scope.items() if is_package_function(item) and name not in called}
