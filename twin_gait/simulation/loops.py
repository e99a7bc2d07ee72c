"""Compiled loops: from this process, from the cache folder, or compiled and put there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.simulation.keeping import cache_folder
from twin_gait.simulation.machine_code import NativeFunction, load_function, read_code, write_code

if TYPE_CHECKING:
    from twin_gait.simulation.compiling import CompiledLoop

# What this process has loaded or compiled; all episodes of a batch mostly share one loop.
_loops: dict[tuple[str, tuple[Any, ...]], NativeFunction] = {}


def kept_loop(
    key: str,
    n_arguments: int,
    make: Callable[[], CompiledLoop],
    on_compile: Callable[[], None] | None,
    own: tuple[Any, ...] = (),
) -> NativeFunction:
    """The loop of a key.

    With functions of the user's it is compiled once in this process and not kept on disk, because the sources
    that they depend on are unknown.

    ``key``: from :func:`twin_gait.simulation.keeping.source_key`. ``n_arguments``: of the loop. ``make``:
    compiles it. ``on_compile``: called if it has to be compiled, which takes 10 to 20 s. ``own``: functions
    of the user's.
    """
    if (key, own) not in _loops:
        path = None if own else _path_of(key)
        code = None if path is None else read_code(path)
        if code is not None:
            _loops[key, own] = load_function(code, n_arguments)
        else:
            if on_compile is not None:
                on_compile()
            compiled = make()
            if compiled.code is not None and path is not None:
                # Two processes may do this at once: the file is put in place in one step, both are as good.
                write_code(path, compiled.code)
            _loops[key, own] = compiled.function
    return _loops[key, own]


def is_kept(key: str) -> bool:
    """Whether :func:`kept_loop` would compile nothing, without functions of the user's."""
    path = _path_of(key)
    return (key, ()) in _loops or (path is not None and path.is_file())


def _path_of(key: str) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / f"twin_gait_{key}.loop"
