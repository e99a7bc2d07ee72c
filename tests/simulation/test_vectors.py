"""Calls of a kernel for several things at once: one by one in plain Python, vectors when compiled."""

from __future__ import annotations

import re
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import types

from twin_gait.core.contact import Ground
from twin_gait.core.friction import rotational_friction_and_share, rotational_friction_torque
from twin_gait.kernels.generated import MERGED_FUNCTIONS, write_merged_functions
from twin_gait.kernels.tracing import merge_calls
from twin_gait.simulation.backend import vector_map
from twin_gait.simulation.binding import kernel_functions, specialize
from twin_gait.simulation.compiling import compile_loop, compiler_settings, jit, record_accessor
from twin_gait.simulation.record import to_array
from twin_gait.simulation.vectors import vector_functions

SINES, FORCES = MERGED_FUNCTIONS
GROUND = Ground(0.9, 4e6, 1.5, 0.8, 0.05)
# The whole of a vector, one and a bit, two and a bit.
COUNTS = (4, 6, 8, 12)


def functions(count: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Those for so many things in plain Python, and what takes their place."""
    text = "\n".join(write_merged_functions(f"{SINES.name}_{count}( {FORCES.name}_{count}("))
    plain = kernel_functions(text, {item.name: item.function for item in MERGED_FUNCTIONS})
    return plain, vector_functions(plain)


def states(count: int, rng: np.random.Generator) -> list[float]:
    """Stiffness, dissipation and motion of heels and forefeet; some are in the air, some are leaving."""
    moved = rng.normal(size=(count, 3)) * (0.01, 1.0, 1.0)
    softness = [[4e6, 1.5], [1e6, 0.7]] * (count // 2)
    return np.column_stack([softness, moved]).ravel().tolist()


def test_calls_are_merged_at_the_last_one_and_dependent_code_follows() -> None:
    lines = [
        "t0, t1 = force(ground, q[0], v[0])",
        "t2 = t1 * v[1]",
        "t3 = q[1] + 1.0",
        "t4, t5 = force(ground, t3, v[1])",
        "t6, t7 = force(ground, q[2], v[2])",
        "t8 = t2 + t3",
        "t9, t10 = force(ground, q[3], v[3])",
        "t11 = t8 + t10",
    ]
    assert merge_calls(lines, "force", 1) == [
        "t3 = q[1] + 1.0",
        "t0, t1, t4, t5, t6, t7, t9, t10 = force_4(ground, q[0], v[0], t3, v[1], q[2], v[2], q[3], v[3])",
        "t2 = t1 * v[1]",
        "t8 = t2 + t3",
        "t11 = t8 + t10",
    ]
    fewer = lines[:6]
    assert merge_calls(fewer, "force", 1) == fewer


@pytest.mark.compile
@pytest.mark.parametrize("count", COUNTS)
def test_vectors_equal_single_calls_bit_for_bit(count: int, rng: np.random.Generator) -> None:
    plain, vectors = functions(count)
    sines, forces = (vectors[f"{item.name}_{count}"] for item in MERGED_FUNCTIONS)
    ground = to_array(GROUND)
    found_ground = record_accessor(ground.dtype)
    angles = [f"given[{index}]" for index in range(count)]
    points = [f"given[{index}]" for index in range(count, 6 * count)]
    text = f"def entry(address, given):\n    return sines({', '.join(angles)}), "
    text += f"forces(ground(address), {', '.join(points)})"
    scope = {"sines": sines, "forces": forces, "ground": found_ground}
    exec(compile(text, "entry", "exec"), scope)
    compiled = numba.njit(scope["entry"])
    upward: list[float] = []
    for _ in range(20):
        turns, moved = rng.uniform(-10.0, 10.0, count).tolist(), states(count, rng)
        expected = plain[f"{SINES.name}_{count}"](*turns), plain[f"{FORCES.name}_{count}"](GROUND, *moved)
        assert compiled(ground.ctypes.data, np.array(turns + moved)) == expected
        upward += expected[1][1::2]
    assert 0.0 < np.mean(np.array(upward) > 0.0) < 1.0  # some touch the ground, some do not


@pytest.mark.compile
@pytest.mark.parametrize("item", MERGED_FUNCTIONS, ids=lambda item: item.name)
def test_llvm_vectorises_calls_although_its_vectoriser_is_off(item: Any) -> None:
    """Where this fails, the loop has something that LLVM does not take: it is slow, not wrong."""
    each = functions(8)[1][f"{item.name}_8"]
    given = ["ground(address)"] * item.shared + [f"given[{index}]" for index in range(8 * item.arguments)]
    scope = {"each": each, "ground": record_accessor(to_array(GROUND).dtype)}
    exec(compile(f"def entry(address, given):\n    return each({', '.join(given)})", "entry", "exec"), scope)
    made, signature = jit(scope["entry"], inline=False), (types.intp, types.float64[::1])
    with compiler_settings():
        made.compile(signature)
    code = str(made.overloads[signature].library._final_module)
    multiplied = re.findall(r"fmul (<8 x double>|double) ", code)
    assert multiplied.count("<8 x double>") > 10
    assert multiplied.count("double") < 4


INDICES = (0, 2, 5)
STATE = np.dtype([("velocity", "f8", (6,)), ("friction", "f8", (6,)), ("share", "f8", (6,))], align=True)


def sliding(state: Any, index: int, staged: bool) -> tuple[float, float, float, float, float]:
    return state.velocity[index], 8.0, 10.0, 0.1, 2.0


def sliding_under_load(state: Any, index: int, staged: bool) -> tuple[float, ...]:
    return state.velocity[index], 8.0, 10.0, 0.1, 2.0, -1.0, 0.85


def keep(state: Any, index: int, torque: float) -> None:
    state.friction[index] = torque


def keep_both(state: Any, index: int, found: tuple[float, float]) -> None:
    state.friction[index] += found[0]
    state.share[index] = found[1]


def rub(address: int, first: int, end: int) -> int:
    vector_map(state_at(address), INDICES, False, sliding, rotational_friction_torque, keep)
    law = rotational_friction_and_share
    vector_map(state_at(address), INDICES, False, sliding_under_load, law, keep_both)
    return 0


def state_at(address: int) -> Any:
    raise NotImplementedError


@pytest.mark.compile
def test_a_law_at_several_indices_equals_single_calls_bit_for_bit(rng: np.random.Generator) -> None:
    own = {
        "sliding": jit(sliding),
        "keep": jit(keep),
        "keep_both": jit(keep_both),
        "sliding_under_load": jit(sliding_under_load),
        "state_at": record_accessor(STATE),
    }
    compiled = compile_loop(rub, {**vector_functions({}), **own})
    states = np.zeros(2, STATE).view(np.recarray)
    plain = specialize(rub, {"state_at": lambda address: states[1]})
    for _ in range(20):
        states.velocity[:] = rng.normal(size=6)
        states.friction[:] = states.share[:] = 0.0
        plain(0, 0, 0)
        compiled.function(states.ctypes.data, 0, 0)
        assert states[0].tobytes() == states[1].tobytes()
        for found in (states.friction[0], states.share[0]):
            assert np.flatnonzero(found).tolist() == list(INDICES)
