"""Write the module that is compiled: the episode loop with a kernel in place of its interface.

The functions of :mod:`twin_gait.core` on plain numbers are called; the few that take arrays are written into
the module together with the loop, because the places of the arrays are only known there.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from types import FunctionType
from typing import Any

from twin_gait.core import control_tick, faults, guards, integrators, safety
from twin_gait.simulation.flat_episode import LOOSE_INTEGERS
from twin_gait.simulation.flattening import BUNDLE, Place, flatten
from twin_gait.simulation.keeping import episode_rooms, source_of
from twin_gait.simulation.kernel import KERNEL_VERSION


@lru_cache(maxsize=8)
def module_source(
    kernel: str, places: tuple[tuple[str, Place], ...], constants: tuple[tuple[str, int], ...], columns: int
) -> str:
    """Text of the module that is compiled: the loop with a kernel in place of its interface.

    The sources are read once in a process, so that an edit during a long batch changes nothing in it.

    Args:
        kernel: From :func:`twin_gait.simulation.kernel.write_kernel`.
        places: Where the arrays of the episode lie.
        constants: Whole numbers of the episode that are the same for every run of this kernel.
    """
    loop = one_module({name: source_of(name) for name in episode_rooms()})
    loop = loop.replace("_step(acceleration, episode,", "_step(episode,")
    bound = [_bound_integrator(item) for item in (integrators.semi_implicit_euler_step, integrators.rk4_step)]
    bound += [_without_annotations(inspect.getsource(item)) for item in ARRAY_FUNCTIONS]
    text, loose = flatten(
        "\n\n".join([loop, *bound, kernel]),
        dict(places),
        dict(constants),
        {"rows": Place("", 0, (0, columns))},
    )
    names = loose["run_ticks"]
    text = _taking_addresses(text, names)
    # numba compiles at the first call, when all functions of the module exist, whatever their order.
    text = re.sub(r"^def (?!run_ticks)", "@_inlined\ndef ", text, flags=re.MULTILINE)
    text = re.sub(r"^def (?=run_ticks)", "@_jit\ndef ", text, flags=re.MULTILINE)
    text = text.replace("import numpy as np\n", _PREAMBLE + _imports_of(ARRAY_FUNCTIONS), 1)
    return f"{text}\n\nLOOSE_ARRAYS = {names!r}\nKERNEL_VERSION = {KERNEL_VERSION}\n"


def _taking_addresses(text: str, loose: Sequence[str]) -> str:
    """Let ``run_ticks`` take addresses of its arrays, which are whole numbers, and make them pointers."""
    tree = ast.parse(text)
    loop = next(item for item in tree.body if isinstance(item, ast.FunctionDef) and item.name == "run_ticks")
    kinds = {"x": "float_pointer", "k": "integer_pointer", "rows": "float_pointer"}
    kinds |= {name: "integer_pointer" if name in LOOSE_INTEGERS else "float_pointer" for name in loose}
    for argument in loop.args.args:
        argument.annotation = None
        if argument.arg in kinds:
            argument.arg += "_address"
    pointers = "\n".join(f"{name} = {kind}({name}_address)" for name, kind in kinds.items())
    loop.body[1:1] = ast.parse(pointers).body  # after the docstring
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


# Functions of core that take arrays: they are rewritten together with the loop instead of being called.
ARRAY_FUNCTIONS = (
    control_tick.measure_joints,
    control_tick.leg_signals,
    control_tick.blend_phase,
    guards.guard_holds,
    guards.next_transition,
    safety.watch_joint,
    faults.faulty_angle,
    faults.faulty_load,
    faults.runaway_torque,
    faults.drive_fault,
    faults.supply_drop,
)

_PREAMBLE = """import math

import numba
import numpy as np
from numba import carray

from twin_gait.core.contact import ground_contact_force
from twin_gait.core.integrators import RK4_STAGES
from twin_gait.simulation.pointers import float_pointer, integer_pointer, shifted

_jit = numba.njit(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
_inlined = numba.njit(
    forceinline=True,
    nogil=True,
    error_model="numpy",
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    no_rewrites=True,
)
"""


def _imports_of(functions: Sequence[Callable[..., Any]]) -> str:
    """Import statements for the functions and numbers of core that some functions of it use."""
    lines = set()
    values: dict[str, object] = {}
    for function in functions:
        assert isinstance(function, FunctionType)
        for name in function.__code__.co_names:
            value = function.__globals__.get(name)
            if isinstance(value, (FunctionType, int, float)) and value not in functions:
                # All of them end up in one module, where the last one would win.
                assert values.setdefault(name, value) == value, f"two modules of core define {name}"
                lines.add(f"from {function.__module__} import {name}\n")
    return "".join(sorted(lines))


# What the rooms import and the compiled module has of its own, beside the rooms.
_OWN_MODULES = frozenset(
    {"__future__", "twin_gait.core.integrators", "twin_gait.simulation.kernel_interface"}
)


def one_module(rooms: Mapping[str, str]) -> str:
    """Put the rooms of the loop in one module, without what they import from each other and the kernel."""
    homes: dict[str, str] = {}
    imports, functions = set(), []
    for room, text in rooms.items():
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef):
                assert homes.setdefault(node.name, room) == room, f"two things are named {node.name}"
                functions.append(ast.unparse(node))
            elif isinstance(node, ast.ImportFrom) and node.module not in _OWN_MODULES | rooms.keys():
                for item in node.names:
                    home = str(node.module)
                    assert homes.setdefault(item.name, home) == home, f"two things are named {item.name}"
                    imports.add(f"from {home} import {item.name}")
    return "\n\n".join(["import numpy as np", "\n".join(sorted(imports)), *functions])


def _bound_integrator(function: Callable[..., None]) -> str:
    """Source of an integrator that calls this module's acceleration instead of an argument.

    A function handed over as an argument would be fused just as well, but numba does not keep code that
    holds the address of such an object.
    """
    source = inspect.getsource(function)
    source, count = re.subn(r"acceleration: Acceleration,\s*context: Any", f"{BUNDLE}: Any", source)
    assert count == 1, "an integrator no longer takes the acceleration and its context first"
    return _without_annotations(source.replace("acceleration(context,", f"acceleration({BUNDLE},"))


def _without_annotations(source: str) -> str:
    """Source of one function without the types of its arguments, which the generated module does not know."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        if isinstance(node, ast.FunctionDef):
            node.returns = None
    return ast.unparse(tree)
