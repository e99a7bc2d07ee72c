"""The loop of the joint bench as one module, compiled or as plain Python."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import lru_cache
from types import ModuleType
from typing import Any

import numba
import numpy as np

from twin_gait.control import ControllerFunction
from twin_gait.core.control_tick import controller_torques
from twin_gait.simulation.bench_joint import tick
from twin_gait.simulation.bench_joint.arrays import BenchArrays
from twin_gait.simulation.compiling import compiled_before, load_module, register_core
from twin_gait.simulation.keeping import source_key, source_of
from twin_gait.simulation.module_text import one_module

RunTicks = Callable[[BenchArrays, int, int, np.ndarray], int]
ROOMS = ("tick", "sensing", "command", "winding", "mechanics")  # modules that the loop is written in
_PACKAGE = __name__.rpartition(".")[0]


def plain_loop(law: ControllerFunction) -> RunTicks:
    """The loop as plain Python.

    Args:
        law: Of the controller.

    Returns:
        Its ``run_ticks``.
    """
    if law is controller_torques:
        return tick.run_ticks
    module = ModuleType("twin_gait_bench_as_python")
    exec(compile(_text(), module.__name__, "exec"), module.__dict__)
    module.__dict__["controller_torques"] = law
    run_ticks: RunTicks = module.__dict__["run_ticks"]
    return run_ticks


def compiled_loop(law: ControllerFunction, on_compile: Callable[[], None] | None) -> RunTicks:
    """The loop, compiled and kept; with a law of the user's compiled for this process only.

    Args:
        law: Of the controller.
        on_compile: Called if it has to be compiled.

    Returns:
        Its ``run_ticks``.
    """
    if law is not controller_torques:
        run_ticks: RunTicks = _module_with(law).__dict__["run_ticks"]
        return run_ticks
    text = loop_text()
    key = source_key(text)
    if on_compile is not None and not compiled_before(key):
        on_compile()
    kept: RunTicks = load_module(key, lambda: text).run_ticks
    return kept


@lru_cache(maxsize=1)
def loop_text() -> str:
    """The loop as it is compiled: the rooms' text with decorators; its hash is part of the cache's key."""
    text = _text().replace("import numpy as np\n", _PREAMBLE, 1)
    # compiling.compiled_before looks for what numba has kept under this name.
    text = text.replace("def run_ticks(", "@_kept\ndef run_ticks(", 1)
    # numba compiles at the first call, when all functions of the module exist, whatever their order.
    text = re.sub(r"^(?<!@_kept\n)def ", "@_jit\ndef ", text, flags=re.MULTILINE)
    # What is imported from there is compiled too, and numba does not look whether it has changed.
    return f"{text}\n\n# arrays: {hashlib.sha256(source_of(f'{_PACKAGE}.arrays').encode()).hexdigest()}\n"


def _text() -> str:
    names = [f"{_PACKAGE}.{room}" for room in ROOMS]
    return one_module({name: source_of(name) for name in names})


_PREAMBLE = """import numba
import numpy as np

_kept = numba.njit(cache=True, nogil=True, error_model="numpy")
_jit = numba.njit(nogil=True, error_model="numpy")
"""


@lru_cache(maxsize=8)
def _module_with(law: ControllerFunction) -> ModuleType:
    """Generated module with a controller of the user's, compiled for this process only."""
    register_core()
    module = ModuleType("twin_gait_bench_with_controller")
    exec(compile(loop_text().replace("cache=True, ", ""), module.__name__, "exec"), module.__dict__)
    module.__dict__["controller_torques"] = _jitted(law)
    return module


def _jitted(law: Any) -> Any:
    return law if isinstance(law, numba.core.dispatcher.Dispatcher) else numba.njit(nogil=True)(law)
