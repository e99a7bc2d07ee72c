"""Tests of the three internals of numba that compiled loops depend on, and of the compilation of a loop.

Seen in numba 0.61.2, 0.63.1 and 0.68.1. Where a newer release fails here, look at
:mod:`twin_gait.simulation.compiling` before anything else.
"""

from __future__ import annotations

import gc
import re
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import pytest
from errors import raises, states
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import DefaultPassBuilder
from numba.core.dispatcher import Dispatcher
from numba.core.errors import TypingError

from twin_gait.control.controller import NoMemory, UncompiledControllerError
from twin_gait.simulation import compiling
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiling import (
    PruningPipeline,
    compile_loop,
    compile_user_tick,
    compiler_settings,
    jit,
    record_accessor,
    row_accessor,
)
from twin_gait.simulation.record import dtype_of

INSTALLED = tuple(map(int, numba.__version__.split(".")[:2]))
WIDE, COUNT = False, 0
MISSING = (TypingError, KeyError)  # errors of numba for a field that a record does not have


def test_the_installed_numba_is_a_reviewed_version() -> None:
    stated = re.search(r"checked with numba (\d+)\.(\d+) to (\d+)\.(\d+)", compiling.__doc__ or "")
    assert stated
    low, high = (tuple(map(int, stated.group(first, first + 1))) for first in (1, 3))
    assert low <= INSTALLED <= high, f"numba {numba.__version__}: run this file, then state it there"


# ------------------------------------------------------------------ dead branches


def flagged(record: Any) -> float:
    return record.wide if WIDE else record.narrow


def counted(record: Any) -> float:
    total = record.narrow
    if COUNT > 0:
        for index in range(COUNT):
            total += record.many[index]
    return total


def negated(record: Any) -> float:
    if not WIDE:
        return record.narrow
    return record.wide


def joined(record: Any) -> float:
    if WIDE and record.wide > 0.0:
        return record.wide
    return record.narrow


BRANCHES = [flagged, counted, negated, joined]
NARROW = np.dtype([("narrow", "f8")], align=True)
SIGNATURE = (numba.from_dtype(NARROW),)


@pytest.mark.parametrize("law", BRANCHES)
def test_a_branch_disabled_by_a_build_flag_may_access_a_missing_field(law: Any) -> None:
    bound = specialize(law, {"WIDE": False, "COUNT": 0}, jit)
    bound.compile(SIGNATURE)
    assert bound.overloads[SIGNATURE].signature.return_type == types.float64


@pytest.mark.parametrize("law", BRANCHES)
def test_a_branch_that_is_taken_needs_its_fields(law: Any) -> None:
    bound = specialize(law, {"WIDE": True, "COUNT": 2}, jit)
    with pytest.raises(MISSING) as caught:
        bound.compile(SIGNATURE)
    assert states(str(caught.value), "wide") or states(str(caught.value), "many")


class WithoutPruning(PruningPipeline):
    """Pruning pipeline without the pass that it adds."""

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_rewrites = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state, "plain")]


@pytest.mark.parametrize("law", [flagged, counted])
def test_numba_without_its_rewrites_would_type_the_dead_branch(law: Any) -> None:
    """If this no longer fails, the pipeline of compiling.py is not needed any more."""
    options = {**compiling._OPTIONS, "pipeline_class": WithoutPruning}
    bound = specialize(law, {"WIDE": False, "COUNT": 0}, lambda function: numba.njit(**options)(function))
    with pytest.raises(MISSING) as caught:
        bound.compile(SIGNATURE)
    assert states(str(caught.value), "wide") or states(str(caught.value), "many")


def test_calls_in_a_dead_branch_are_not_compiled() -> None:
    made: dict[str, Any] = {}

    def keep(function: Any) -> Any:
        return made.setdefault(function.__name__, jit(function))

    bound = specialize(calls_when_wide, {"WIDE": False}, keep)
    bound.compile(SIGNATURE)
    assert not made["flagged"].overloads and made["negated"].overloads


def calls_when_wide(record: Any) -> float:
    if WIDE:
        return flagged(record)
    return negated(record)


# ------------------------------------------------------------------ literals


def made_for_literals(wrap: Any) -> list[Any]:
    """Return the signatures of a function that is called with three literals and a variable."""
    callee = wrap(lambda values, index: values[index] + 1.0)

    @numba.njit  # type: ignore[untyped-decorator]
    def caller(values: Any) -> float:
        last = len(values) - 1
        return callee(values, 0) + callee(values, 1) + callee(values, -1) + callee(values, last)

    caller.compile((types.float64[::1],))
    return list(callee.overloads)


def test_a_literal_in_a_call_is_not_compiled_again() -> None:
    assert len(made_for_literals(jit)) == 1


def test_numba_alone_would_compile_every_literal_again() -> None:
    """If this no longer holds, the template of compiling.py is not needed any more."""
    found = made_for_literals(lambda function: numba.njit(**compiling._OPTIONS)(function))
    assert len(found) == 4
    assert {str(kind) for _, kind in found} == {"int64", *(f"Literal[int]({value})" for value in (0, 1, -1))}


# ------------------------------------------------------------------ optimisation


def axpy(x: Any, y: Any, n: int) -> int:
    for i in range(n):
        y[i] = y[i] + 2.0 * x[i]
    return 0


def packed_operations(*, quick: bool) -> int:
    """Count vector operations in the machine-independent code of an easily vectorised loop."""
    signature = (types.float64[::1], types.float64[::1], types.intp)
    made = jit(axpy, inline=False)
    if quick:
        with compiler_settings():
            made.compile(signature)
    else:
        made.compile(signature)
    return str(made.overloads[signature].library._final_module).count("x double>")


def test_the_vectoriser_is_off_for_a_loop_and_back_on_after_it() -> None:
    assert packed_operations(quick=False) > 0
    assert packed_operations(quick=True) == 0
    assert packed_operations(quick=False) > 0


def entry(address: int, first: int, end: int) -> int:
    return end - first


def test_a_loop_is_compiled_with_its_own_settings_and_the_users_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[tuple[int, int, bool]] = []
    compile_as_ever = Dispatcher.compile

    def note(self: Any, signature: Any) -> Any:
        seen.append((int(numba.config.OPT), numba.config.LOOP_VECTORIZE, gc.isenabled()))
        return compile_as_ever(self, signature)

    monkeypatch.setattr(Dispatcher, "compile", note)
    before = numba.config.OPT, numba.config.LOOP_VECTORIZE, gc.isenabled()
    loop = compile_loop(entry, {})
    assert seen[0] == (PruningPipeline.level, 0, False) and not PruningPipeline.vectorise
    assert (numba.config.OPT, numba.config.LOOP_VECTORIZE, gc.isenabled()) == before
    assert loop.function(0, 3, 10) == 7


def scaled_at(address: int, first: int, end: int) -> int:
    return scaled(first) + summed(first, end)


def scaled(number: int) -> int:
    return COUNT * number


def summed(first: int, end: int) -> int:
    return first + end


def test_the_next_loop_of_a_process_compiles_only_changed_functions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compiled: list[str] = []
    compile_as_ever = Dispatcher.compile

    def note(self: Any, signature: Any) -> Any:
        if signature not in self.overloads:
            compiled.append(self.py_func.__name__)
        return compile_as_ever(self, signature)

    monkeypatch.setattr(Dispatcher, "compile", note)
    assert compile_loop(scaled_at, {"COUNT": 2}).function(0, 10, 7) == 2 * 10 + 10 + 7
    assert compiled == ["scaled_at", "scaled", "summed"]
    compiled.clear()
    assert compile_loop(scaled_at, {"COUNT": 3}).function(0, 10, 7) == 3 * 10 + 10 + 7
    assert compiled == ["scaled_at", "scaled"]


def test_machine_code_is_made_of_the_loop_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of numba's own, of every function in it."""
    made: list[str] = []
    finalize = JITCodeLibrary._finalize_specific

    def note(self: Any) -> None:
        made.append(self.name)
        finalize(self)

    monkeypatch.setattr(JITCodeLibrary, "_finalize_specific", note)
    assert compile_loop(scaled_at, {"COUNT": 4}).function(0, 10, 7) == 4 * 10 + 10 + 7
    assert made == ["scaled_at"]


def wrong(address: int, first: int, end: int) -> int:
    return address.missing  # type: ignore[attr-defined,no-any-return]


def test_settings_are_restored_after_an_error() -> None:
    before = numba.config.OPT, numba.config.LOOP_VECTORIZE, gc.isenabled()
    with pytest.raises(TypingError):
        compile_loop(wrong, {})
    assert (numba.config.OPT, numba.config.LOOP_VECTORIZE, gc.isenabled()) == before


# ------------------------------------------------------------------ rows behind an address


def test_records_and_rows_are_found_behind_an_address_and_can_be_kept() -> None:
    """A loop over all three, whose code needs the C library alone: no array in it is counted."""
    dtype = np.dtype([("total", "f8"), ("rows", "i8"), ("numbers", "i8")], align=True)
    row = np.dtype([("value", "f8"), ("twice", "f8")], align=True)
    state, table, numbers = np.zeros(1, dtype), np.zeros(5, row), np.arange(10.0).reshape(5, 2)
    table["value"] = [1.0, 2.0, 3.0, 4.0, 5.0]
    state["rows"], state["numbers"] = table.ctypes.data, numbers.ctypes.data
    rows, pairs = row_accessor(row), row_accessor(np.dtype(float), 2)

    def row_of(state: Any, number: int) -> Any:
        return rows(state.rows, number)

    def pair_of(state: Any, number: int) -> Any:
        return pairs(state.numbers, number)

    names = {"state_at": record_accessor(dtype), "row_of": jit(row_of), "pair_of": jit(pair_of)}
    loop = compile_loop(walk_at, names)
    assert loop.code is not None
    assert loop.function(state.ctypes.data, 1, 4) == 3
    assert table["twice"].tolist() == [0.0, 4.0, 6.0, 8.0, 0.0]
    assert state["total"][0] == 3.0 * (2.0 + 3.0 + 4.0)


def state_at(address: int) -> Any: ...
def row_of(state: Any, number: int) -> Any: ...
def pair_of(state: Any, number: int) -> Any: ...


def walk_at(address: int, first: int, end: int) -> int:
    return walk(state_at(address), first, end)


def walk(state: Any, first: int, end: int) -> int:
    share = pair_of(state, first)[1]
    for number in range(first, end):
        item = row_of(state, number)
        item.twice = 2.0 * item.value
        state.total += share * item.value
    return end - first


# Only functions of this package are bound.
for _law in (*BRANCHES, calls_when_wide, walk, scaled, summed):
    _law.__module__ = "twin_gait.module_of_a_test"


# ------------------------------------------------------------------ controllers


@dataclass(slots=True)
class Device:
    """Arguments of a controller that matter here."""

    memory: object


def test_a_controller_that_numba_cannot_compile_is_rejected_for_the_loop() -> None:
    def tick(memory, device, tick, period):  # type: ignore[no-untyped-def]
        return np.fft.nothing(period)

    device = dtype_of(Device(NoMemory()))
    with raises(UncompiledControllerError, "numba", "Mine"):
        compile_user_tick("Mine", tick, False, device)
