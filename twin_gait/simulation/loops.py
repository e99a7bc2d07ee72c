"""Compiled loops: from this process, from the cache folder, or compiled and put there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from twin_gait.control import ControllerFunction
from twin_gait.simulation.keeping import cache_folder
from twin_gait.simulation.machine_code import NativeFunction, load_function, read_code, write_code

if TYPE_CHECKING:
    from twin_gait.simulation.compiling import CompiledLoop

# What this process has loaded or compiled; all episodes of a batch mostly share one loop.
_loops: dict[tuple[str, ControllerFunction | None], NativeFunction] = {}


def kept_loop(
    key: str,
    n_arguments: int,
    make: Callable[[], CompiledLoop],
    controller: ControllerFunction | None,
    on_compile: Callable[[], None] | None,
) -> NativeFunction:
    """The loop of a key and a control law.

    With a control law of the user's it is compiled once in this process and not kept on disk, because the
    sources that the function depends on are unknown.

    Args:
        key: From :func:`twin_gait.simulation.keeping.source_key`.
        n_arguments: Of the loop.
        make: Compiles it.
        controller: Control law that takes the place of the thesis's.
        on_compile: Called if it has to be compiled, which takes 10 to 20 s.
    """
    if (key, controller) not in _loops:
        path = _path_of(key) if controller is None else None
        code = None if path is None else read_code(path)
        if code is not None:
            _loops[key, controller] = load_function(code, n_arguments)
        else:
            if on_compile is not None:
                on_compile()
            compiled = make()
            if compiled.code is not None and path is not None:
                # Two processes may do this at once: the file is put in place in one step, both are as good.
                write_code(path, compiled.code)
            _loops[key, controller] = compiled.function
    return _loops[key, controller]


def is_kept(key: str) -> bool:
    """Whether :func:`kept_loop` would compile nothing, with the thesis's control law."""
    path = _path_of(key)
    return (key, None) in _loops or (path is not None and path.is_file())


def _path_of(key: str) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / f"twin_gait_{key}.loop"
