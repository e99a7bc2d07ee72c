"""The compiled episode loop of an experiment: loaded if it is kept, compiled if not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin_gait.control import ControllerFunction
from twin_gait.simulation import episode_arrays
from twin_gait.simulation.flat_episode import FlatEpisode, fields_of
from twin_gait.simulation.keeping import cache_folder, source_key
from twin_gait.simulation.machine_code import (
    MachineCode,
    NativeFunction,
    load_function,
    prepare_linking,
    read_code,
    write_code,
)
from twin_gait.simulation.module_text import module_source

RunTicks = Callable[[int, int, np.ndarray], int]

# Whole numbers of an episode that are the same in most runs: loops over them are unrolled, and branches that
# they rule out are not compiled.
STRUCTURE = (
    "N_LEGS",
    "JOINTS_PER_LEG",
    "POINTS_PER_FOOT",
    "PELVIS_INDEX",
    "N_ANKLES",
    "USE_RK4",
    "FAULTY",
    "INERTIA_WANTED",
    "WEARER",
    "FOLLOWS",
    "ASSISTS",
    "ADAPTS",
    "WEARER_SHIFT",
)
_FLAT_ARRAYS, _MORE_ARGUMENTS = 2, 3  # x and k; first tick, end and the log


class Loop(NamedTuple):
    """A compiled loop.

    Attributes:
        function: Takes the addresses of the flat and the loose arrays, first tick, end, address of the log.
        arrays: Names of the loose arrays.
    """

    function: NativeFunction
    arrays: tuple[str, ...]


def loop_of(
    flat: FlatEpisode,
    kernel: str,
    columns: int,
    controller: ControllerFunction | None = None,
    on_compile: Callable[[], None] | None = None,
) -> RunTicks:
    """The compiled loop of an episode: ``run_ticks`` of :mod:`twin_gait.simulation.episode.tick` bound to it.

    Args:
        flat: The episode that it runs and changes.
        kernel: From :func:`twin_gait.simulation.kernel.write_kernel`.
        controller: Control law that takes the place of the thesis's. The loop is then compiled once in this
            process and not kept on disk, because the sources that the function depends on are unknown.
        on_compile: Called if the loop has to be compiled, which takes 10 to 20 s.
    """
    ingredients = kernel, flat.places, _constants(flat.episode), columns
    if controller is None:
        loop = kept_loop(source_key(repr(ingredients)), lambda: module_source(*ingredients), on_compile)
    else:
        loop = loop_with(module_source(*ingredients), controller, on_compile)
    return bound(loop, flat.numbers, flat.integers, fields_of(flat.episode))


def bound(
    loop: Loop, numbers: np.ndarray, integers: np.ndarray, fields: Mapping[str, np.ndarray]
) -> RunTicks:
    """A compiled loop bound to the arrays that it reads and changes.

    Returns:
        The loop: first tick, one past the last, log; returns the ticks run since tick 0.
    """
    arrays = [numbers, integers, *(fields[name] for name in loop.arrays)]

    def run_ticks(first: int, end: int, rows: np.ndarray) -> int:
        addresses = [item.ctypes.data for item in arrays]
        return loop.function(*addresses, first, end, rows.ctypes.data)

    return run_ticks


def _constants(whole: episode_arrays.Episode) -> tuple[tuple[str, int], ...]:
    return tuple((name, int(whole.inputs.integers[getattr(episode_arrays, name)])) for name in STRUCTURE)


# What this process has loaded or compiled; all episodes of a batch mostly share one loop.
_loops: dict[str, Loop] = {}


def kept_loop(key: str, write: Callable[[], str], on_compile: Callable[[], None] | None) -> Loop:
    """The loop of a key, from this process, from the cache folder, or compiled and put there."""
    if key not in _loops:
        folder = cache_folder()
        path = None if folder is None else folder / f"twin_gait_{key}.loop"
        code = None if path is None else read_code(path)
        _loops[key] = _compiled_loop(path, write(), on_compile) if code is None else _linked(code)
    return _loops[key]


def _linked(code: MachineCode) -> Loop:
    prepare_linking()
    return Loop(load_function(code, _FLAT_ARRAYS + len(code.arrays) + _MORE_ARGUMENTS), code.arrays)


def _compiled_loop(path: Path | None, text: str, on_compile: Callable[[], None] | None) -> Loop:
    """Compile a loop and keep it, if there is a place for it."""
    from twin_gait.simulation.compiling import compile_loop

    if on_compile is not None:
        on_compile()
    compiled = compile_loop(text)
    if compiled.code is not None and path is not None:
        # Two processes may do this at once: the file is put in place in one step, and both are as good.
        write_code(path, compiled.code)
    return Loop(compiled.function, compiled.arrays)


def loop_with(text: str, controller: ControllerFunction, on_compile: Callable[[], None] | None) -> Loop:
    """A loop with a control law of the user's, compiled once in this process and not kept."""
    if on_compile is not None:
        on_compile()
    return _loop_with(text, controller)


@lru_cache(maxsize=16)
def _loop_with(text: str, controller: ControllerFunction) -> Loop:
    from twin_gait.simulation.compiling import compile_loop

    compiled = compile_loop(text, controller)
    return Loop(compiled.function, compiled.arrays)
