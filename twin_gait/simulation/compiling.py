"""Compile generated modules with numba.

The functions of :mod:`twin_gait.core` are registered with numba from here, so that core stays free of it.
What is compiled is kept by :mod:`twin_gait.simulation.loops`, under a key that covers every source; numba's
own cache alone would miss an edit in a callee and silently run the old law.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
from functools import lru_cache
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numba
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.extending import register_jitable

from twin_gait import core
from twin_gait.control.controller import (
    EXPECTED_TORQUES,
    ControllerFunction,
    name_of,
    require_arguments,
)
from twin_gait.exceptions import ParameterError
from twin_gait.simulation.keeping import CORE_MODULES
from twin_gait.simulation.machine_code import MachineCode, NativeFunction, function_at


@lru_cache(maxsize=1)
def register_core() -> None:
    """Make every function of core callable from compiled code."""
    for name in CORE_MODULES:
        module = importlib.import_module(f"{core.__name__}.{name}")
        for function in vars(module).values():
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                register_jitable(function)


# ------------------------------------------------------------------ the episode loop

# Optimisation level of LLVM: 3, numba's own, takes a third longer here and runs no faster.
OPTIMISATION = 1


class CompiledLoop(NamedTuple):
    """The episode loop, compiled in this process.

    Attributes:
        function: Its ``run_ticks``.
        arrays: Names of the loose arrays that it takes.
        code: What can be kept of it, or None if it needs more than the C library.
    """

    function: NativeFunction
    arrays: tuple[str, ...]
    code: MachineCode | None


def compile_loop(text: str, controller: ControllerFunction | None = None) -> CompiledLoop:
    """Compile a generated module."""
    register_core()
    module = ModuleType("twin_gait_episode")
    exec(compile(text, module.__name__, "exec"), module.__dict__)
    if controller is not None:
        if not compiles(controller):
            raise ParameterError(f"{name_of(controller)}: numba cannot compile it")
        module.__dict__["controller_torques"] = _jitted(controller)
    loop, arrays = module.__dict__["run_ticks"], tuple(module.__dict__["LOOSE_ARRAYS"])
    signature = (numba.intp,) * loop.py_func.__code__.co_argcount
    kept, collects = numba.config.OPT, gc.isenabled()
    numba.config.OPT = type(kept)(OPTIMISATION)
    gc.disable()  # looking through the compiler's millions of small objects takes a tenth of the time
    try:
        loop.compile(signature)
    finally:
        numba.config.OPT = kept
        if collects:
            gc.enable()
    result = loop.overloads[signature]
    symbol = result.fndesc.llvm_func_name
    address = result.library.get_pointer_to_function(symbol)
    code = MachineCode(result.library._get_compiled_object(), symbol, arrays)
    standalone = controller is None and _stands_alone(result.library)
    function = function_at(address, len(signature), loop, None if controller is None else name_of(controller))
    return CompiledLoop(function, arrays, code if standalone else None)


def _stands_alone(library: Any) -> bool:
    """Whether compiled code calls the C library only; LLVM ends the process if it cannot find a name."""
    process = ctypes.CDLL(None)
    needed = [item.name for item in library._final_module.functions if item.is_declaration]
    return all(name.startswith("llvm.") or hasattr(process, name) for name in needed)


@lru_cache(maxsize=16)
def _jitted(function: ControllerFunction) -> Any:
    return function if isinstance(function, Dispatcher) else numba.njit(nogil=True)(function)


def compiles(function: ControllerFunction) -> bool:
    """Whether numba can compile a control law.

    Args:
        function: An ``njit`` function, or a Python function.

    Raises:
        ParameterError: If it does not take eight numbers, or gives anything but two.
    """
    register_core()
    require_arguments(function)
    numbers = (numba.float64,) * 8
    try:
        compiled = _jitted(function)
        compiled.compile(numbers)
    except (NumbaError, TypeError, AttributeError):
        return False
    answer = compiled.overloads[numbers].signature.return_type
    pair = answer.types if isinstance(answer, types.BaseTuple) else ()  # type: ignore[attr-defined]
    if len(pair) != 2 or not all(isinstance(item, (types.Integer, types.Float)) for item in pair):
        raise ParameterError(f"{name_of(function)}: {EXPECTED_TORQUES}, got {answer}")
    return True
