"""Compile the episode loop together with the kernel of a model, and keep the result.

The functions of :mod:`twin_gait.core` are registered with numba from here, so that core stays free of it.
A compiled module is kept under a key that is a hash over every source it depends on: the generated text,
all of core, the loop, and the versions of numba, llvmlite and Python. numba's own cache alone would miss an
edit in a callee and silently run the old law.
"""

from __future__ import annotations

import atexit
import hashlib
import importlib.util
import inspect
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.extending import register_jitable

from twin_gait import core
from twin_gait.control import ControllerFunction
from twin_gait.files import write_atomically
from twin_gait.simulation import columns, episode, episode_arrays, flattening, module_text, pointers
from twin_gait.simulation.flat_episode import FlatEpisode, fields_of
from twin_gait.simulation.module_text import module_source

CACHE_VARIABLE = "TWIN_GAIT_CACHE"
CORE_MODULES = (
    "articulated_body",
    "actuator",
    "blending",
    "contact",
    "control_tick",
    "estimation",
    "faults",
    "friction",
    "friction_models",
    "guards",
    "hyperbolic",
    "impedance",
    "integrators",
    "motor_drive",
    "plant",
    "safety",
)

RunTicks = Callable[..., int]


def cache_folder() -> Path:
    """Folder of the compiled modules: ``$TWIN_GAIT_CACHE``, or twin_gait in the user's cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "twin_gait"


def usable_folder(wanted: Path) -> Path:
    """The wanted folder, made if needed, or a private temporary one where it cannot be written.

    The temporary one lasts as long as the process: compiled code is not kept where others could write.

    Args:
        wanted: From :func:`cache_folder`.

    Returns:
        A folder that can be written.
    """
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        if os.access(wanted, os.W_OK):
            return wanted
    except OSError:
        pass
    return _private_folder()


@lru_cache(maxsize=1)
def _private_folder() -> Path:
    folder = tempfile.mkdtemp(prefix="twin_gait_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@lru_cache(maxsize=1)
def register_core() -> None:
    """Make every function of core callable from compiled code."""
    for name in CORE_MODULES:
        module = importlib.import_module(f"{core.__name__}.{name}")
        for function in vars(module).values():
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                register_jitable(function)


@lru_cache(maxsize=8)
def source_key(what: str) -> str:
    """Hash over what is compiled and every source and package that it is made of or made by.

    Args:
        what: Text that tells one compiled loop from another.

    Returns:
        The hash; the sources are read once in a process, so that an edit during a long batch changes nothing.
    """
    digest = hashlib.sha256(what.encode())
    core_modules = [importlib.import_module(f"{core.__name__}.{name}") for name in CORE_MODULES]
    for module in (columns, episode, episode_arrays, flattening, module_text, pointers, *core_modules):
        digest.update(inspect.getsource(module).encode())
    for package in ("numba", "llvmlite", "numpy"):
        digest.update(f"{package} {metadata.version(package)}".encode())
    digest.update(f"{platform.python_version()} {platform.machine()}".encode())
    return digest.hexdigest()[:24]


def load_module(key: str, write: Callable[[], str]) -> ModuleType:
    """Import the generated module of a key from the cache folder, writing it there first if needed.

    Two processes may do this at once: the file is put in place in one step and both write the same.

    Args:
        key: From :func:`source_key`.
        write: Gives the text of the module.

    Returns:
        The module.
    """
    register_core()
    name = _module_name(key)
    if name in sys.modules:
        return sys.modules[name]
    path = usable_folder(cache_folder()) / f"{name}.py"
    if not path.is_file():
        write_atomically(path, write())
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # a .py file always has a loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[name] = module
    return module


def _module_name(key: str) -> str:
    return f"twin_gait_episode_{key}"


def compiled_before(key: str) -> bool:
    """Whether numba has kept the compiled loop of a generated module."""
    return any((cache_folder() / "__pycache__").glob(f"{_module_name(key)}.run_ticks-*.nbi"))


def loop_of(
    flat: FlatEpisode,
    kernel: str,
    columns: int,
    controller: ControllerFunction | None = None,
    on_compile: Callable[[], None] | None = None,
) -> RunTicks:
    """The compiled loop of an episode: ``run_ticks`` of :mod:`twin_gait.simulation.episode` bound to it.

    Args:
        flat: The episode that it runs and changes.
        kernel: From :func:`twin_gait.simulation.kernel.write_kernel`.
        columns: Of the log.
        controller: Control law that takes the place of the thesis's. The loop is then compiled once in this
            process and not kept on disk, because the sources that the function depends on are unknown.
        on_compile: Called if the loop has to be compiled, which takes 10 to 20 s.

    Returns:
        The loop.
    """
    ingredients = kernel, flat.places, _constants(flat.episode), columns
    key = source_key(repr(ingredients))
    if on_compile is not None and (controller is not None or not compiled_before(key)):
        on_compile()
    if controller is None:
        module = load_module(key, lambda: module_source(*ingredients))
    else:
        module = _module_with(module_source(*ingredients), controller)
    fields = fields_of(flat.episode)
    arrays = [flat.numbers, flat.integers, *(fields[name] for name in module.LOOSE_ARRAYS)]
    _compile(module.run_ticks, len(arrays) + 3)

    def run_ticks(first: int, end: int, rows: np.ndarray) -> int:
        addresses = [item.ctypes.data for item in arrays]
        return int(module.run_ticks(*addresses, first, end, rows.ctypes.data))

    return run_ticks


# Optimisation level of LLVM: 3, numba's own, takes a third longer here and runs no faster.
OPTIMISATION = 1


def _compile(loop: Any, n_arguments: int) -> None:
    """Compile the loop, or load what numba has kept of it; all its arguments are whole numbers."""
    kept = numba.config.OPT
    numba.config.OPT = type(kept)(OPTIMISATION)
    try:
        loop.compile((numba.intp,) * n_arguments)
    finally:
        numba.config.OPT = kept


def _constants(whole: episode_arrays.Episode) -> tuple[tuple[str, int], ...]:
    """Whole numbers that are the same in most runs: loops over them are unrolled, dead branches left out."""
    return tuple((name, int(whole.inputs.integers[getattr(episode_arrays, name)])) for name in STRUCTURE)


STRUCTURE = (
    "N_LEGS",
    "JOINTS_PER_LEG",
    "POINTS_PER_FOOT",
    "PELVIS_INDEX",
    "N_ANKLES",
    "USE_RK4",
    "FAULTY",
    "INERTIA_WANTED",
)


@lru_cache(maxsize=16)
def _module_with(text: str, controller: ControllerFunction) -> ModuleType:
    """Generated module with a controller of the user's, compiled for this process only."""
    register_core()
    module = ModuleType("twin_gait_episode_with_controller")
    exec(compile(text.replace("cache=True, ", ""), module.__name__, "exec"), module.__dict__)
    module.__dict__["controller_torques"] = _jitted(controller)
    return module


@lru_cache(maxsize=16)
def _jitted(function: ControllerFunction) -> Any:
    return function if isinstance(function, Dispatcher) else numba.njit(nogil=True)(function)


def compiles(function: ControllerFunction) -> bool:
    """Whether numba can compile a control law.

    Args:
        function: An ``njit`` function, or a Python function.

    Returns:
        True if it gives two numbers for eight.
    """
    register_core()
    try:
        _jitted(function).compile((numba.float64,) * 8)
    except (NumbaError, TypeError, AttributeError):
        return False
    return True
