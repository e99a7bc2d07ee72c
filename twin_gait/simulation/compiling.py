"""Compile a bound loop with numba.

Four internals of numba are leaned on, as seen in numba 0.61 to 0.68; tests/simulation/test_compiling.py says
when one of the first three changes, tests/simulation/test_controllers.py of the last: a pipeline of passes of
one's own, the template that types a call, what is made of a function once it is lowered, and its types.
"""

import ctypes
import gc
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from itertools import chain
from types import FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core import ir as numba_ir
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError, UnsupportedBytecodeError
from numba.core.typed_passes import NativeLowering
from numba.core.untyped_passes import DeadBranchPrune, ReconstructSSA
from numba.extending import intrinsic

from twin_gait.control.controller import UncompiledControllerError, require_no_result, require_whole_numbers
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.code_cache import ARGUMENTS, CompiledLoop, wrap_native_function

_BITS = ir.IntType(64)
_REFUSED = NumbaError, UnsupportedBytecodeError
_ENDLESS = 1 << 40  # rows behind an address, whose number the caller knows


class _Inlined(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Code of a function that becomes a part of its callers', and is never run by itself."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(NativeLowering):  # type: ignore[misc]
    """numba's, but machine code is made of the loop alone; with that of its parts it takes a fifth longer."""

    _name = "lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower a function."""
        if not state.flags.forceinline:
            return bool(super().run_pass(state))
        state.library = _Inlined(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        key = list[None]().append  # callers find it by any built-in function that is equal to no other
        state.targetctx.insert_user_function(key, state["cr"].fndesc, [state.library])
        state["cr"] = state["cr"]._replace(cfunc=key)
        return True


class PruningPipeline(CompilerBase):  # type: ignore[misc]
    """numba's passes without its rewrites of array expressions, but with dead branches taken out."""

    lowering: type[NativeLowering] = Lowering  # The pass that makes LLVM's code.
    # LLVM's level 3, numba's own, takes a third longer here and runs no faster; its vectoriser takes loops
    # over the coordinates for long ones and makes the treadmill 15 to 20 % slower.
    level, vectorise = 1, False

    def define_pipelines(self) -> list[Any]:
        """Passes of the one pipeline."""
        self.state.flags.no_rewrites = True  # would leave out the pruning as well
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state, "pruning")
        manager.add_pass_after(DeadBranchPrune, ReconstructSSA)
        own = {NativeLowering: self.lowering}
        manager.passes = [(own.get(item, item), why) for item, why in manager.passes]
        manager.finalize()
        return [manager]


# Functions of the loops of this process: the next one compiles only what is different in it.
_made: dict[type[PruningPipeline], dict[Hashable, Any]] = {}

_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class _Distinct(ir.values.MDValue):  # type: ignore[misc]  # llvmlite has no types
    def descr(self, buffer: Any) -> None:
        buffer += ("distinct !{ ", ", ".join(item.get_reference() for item in self.operands), " }\n")

    def __eq__(self, other: object) -> bool:
        return self is other  # llvmlite would take metadata with equal operands for one

    __hash__ = ir.values.MDValue.__hash__


def distinct(module: Any) -> Any:
    """Metadata that is equal to itself only, as LLVM wants its loops and groups of accesses."""
    return _Distinct(module, (), name=str(len(module.metadata)))


def _instruction(argument_type: Any, result_type: Any, build: Callable[[Any, Any], Any]) -> Any:
    """A function of a number that is an instruction or two of the processor's."""

    @intrinsic  # type: ignore[untyped-decorator]
    def instruction(typing: Any, number: Any) -> Any:
        return result_type(argument_type), lambda context, builder, signature, arguments: build(
            builder, arguments[0]
        )

    return instruction


def _shifted_to_exponent(builder: Any, number: Any) -> Any:
    exponent = builder.shl(builder.add(builder.bitcast(number, _BITS), _BITS(1023)), _BITS(52))
    return builder.bitcast(exponent, ir.DoubleType())


# A pointer from a whole number. Of a sum with 1.5 2^52, its lowest bits moved to where the exponent of a
# number lies, and all its bits.
_pointer = _instruction(types.int64, types.voidptr, lambda builder, n: builder.inttoptr(n, cgutils.voidptr_t))
_power_of_two = _instruction(types.float64, types.float64, _shifted_to_exponent)
_whole_number = _instruction(types.float64, types.int64, lambda builder, n: builder.bitcast(n, _BITS))
# What :mod:`twin_gait.core.elementary` leaves to machine code, by name, to be bound: as numba compiles them,
# the functions there are a call of the C library and a round trip through integers.
BIT_FUNCTIONS = {"power_of_two": _power_of_two, "whole_number": _whole_number}


def jit(function: Any, *, inline: bool = True, pipeline: type[PruningPipeline] = PruningPipeline) -> Any:
    """A function of a loop, to be compiled with its callers' types."""
    made = numba.njit(**_OPTIONS, pipeline_class=pipeline, forceinline=inline)(function)
    template = made.get_call_template
    # Otherwise every literal 0, 1, -1 in a call is a type of its own, and compiled anew.
    plain = types.unliteral  # type: ignore[attr-defined]  # numba has no types
    made.get_call_template = lambda args, kws: template(tuple(map(plain, args)), kws)
    return made


def record_accessor(dtype: np.dtype[Any]) -> Any:
    """Compiled function from an address to the record there."""
    return jit(lambda address: numba.carray(_pointer(address), 1, dtype)[0])


def row_accessor(dtype: np.dtype[Any], *shape: int) -> Any:
    """Compiled function from an address and a number to that record, or to that row of some shape."""
    rows = (_ENDLESS, *shape)
    return jit(lambda address, number: numba.carray(_pointer(address), rows, dtype)[number])


def compile_loop(
    entry: Callable[..., int],
    names: Mapping[str, Any],
    user_controller: str = "",
    pipeline: type[PruningPipeline] = PruningPipeline,
) -> CompiledLoop:
    """Bind an entry, which takes and returns whole numbers, to names, and compile it.

    ``own``: what messages call functions of the user's among the names; empty without any.
    """

    def made(function: FunctionType) -> Any:
        return jit(function, inline=function.__name__ != entry.__name__, pipeline=pipeline)

    loop = specialize(entry, {**BIT_FUNCTIONS, **names}, made, _made.setdefault(pipeline, {}))
    signature = (numba.intp,) * ARGUMENTS
    with compiler_settings(pipeline):
        loop.compile(signature)
    result = loop.overloads[signature]
    symbol = result.fndesc.llvm_func_name
    address = result.library.get_pointer_to_function(symbol)
    function = wrap_native_function(
        address, loop, f"controller {user_controller!r}" if user_controller else None
    )
    standalone = not user_controller and _needs_only_libc(result.library)
    code = symbol.encode() + b"\n" + result.library._get_compiled_object()
    return CompiledLoop(function, code if standalone else None)


@contextmanager
def compiler_settings(pipeline: type[PruningPipeline] = PruningPipeline) -> Iterator[None]:
    """Whatever is compiled in here is compiled as the loops of these passes are."""
    config, collects = numba.config, gc.isenabled()
    kept = config.OPT, config.LOOP_VECTORIZE
    config.OPT, config.LOOP_VECTORIZE = type(config.OPT)(pipeline.level), int(pipeline.vectorise)
    gc.disable()  # looking through the compiler's millions of small objects takes a tenth of the time
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE = kept
        if collects:
            gc.enable()


def _needs_only_libc(library: Any) -> bool:
    """Whether compiled code calls the C library only; LLVM ends the process if it cannot find a name."""
    process = ctypes.CDLL(None)
    needed = [item.name for item in library._final_module.functions if item.is_declaration]
    return all(name.startswith("llvm.") or hasattr(process, name) for name in needed)


@lru_cache(maxsize=16)
def compile_user_tick(controller: str, tick: Any, assisted: bool, device: np.dtype[Any]) -> Any:
    """A function of the user's that is a part of a controller, compiled.

    ``assisted``: whether its memory is that beside the assistance. ``device``: layout of the record that it
    is handed, with its memory in it. Raises UncompiledControllerError if numba cannot compile it,
    ParameterError if it returns something, or keeps a float in a field of whole numbers.
    """
    memory = device["memory"]["other"] if assisted else device["memory"]
    kinds = (numba.from_dtype(memory), numba.from_dtype(device), numba.int64, numba.float64)
    try:
        checked = numba.njit(nogil=True, boundscheck=True)  # else a wrong index writes into the record
        compiled = tick if isinstance(tick, Dispatcher) else specialize(tick, BIT_FUNCTIONS, checked)
        compiled.compile(kinds)
    except (*_REFUSED, TypeError, AttributeError, KeyError, AssertionError) as error:
        raise UncompiledControllerError(f"numba cannot compile the controller {controller!r}") from error
    answer = compiled.overloads[kinds].signature.return_type
    require_no_result(controller, None if answer == types.none else answer)
    require_whole_numbers(controller, next(_cut(compiled.overloads[kinds]), None))
    return compiled


def _cut(made: Any) -> Iterator[str]:
    """Fields of whole numbers into which a compiled function, or one that it calls, writes a float.

    Machine code would cut it without a word, where Python keeps it.
    """
    kinds, calls = made.type_annotation.typemap, made.type_annotation.calltypes
    lists: dict[str, str] = {}
    for statement in chain.from_iterable(block.body for block in made.type_annotation.blocks.values()):
        value: Any = getattr(statement, "value", None)
        if isinstance(statement, numba_ir.SetAttr):
            name, kind = statement.attr, calls[statement].args[1]
        elif isinstance(statement, (numba_ir.SetItem, numba_ir.StaticSetItem)):
            name, kind = lists.get(statement.target.name, "a list"), calls[statement].args[0].dtype
        elif not isinstance(value, numba_ir.Expr):
            continue
        elif value.op == "getattr":
            lists[statement.target.name] = value.attr
            continue
        elif value.op == "call" and isinstance(kinds[value.func.name], types.Dispatcher):
            called = kinds[value.func.name].dispatcher.overloads
            yield from _cut(called[calls[value].args]) if calls[value].args in called else ()
            continue
        else:
            continue
        if isinstance(kind, types.Integer) and isinstance(kinds[value.name], types.Float):
            yield name
