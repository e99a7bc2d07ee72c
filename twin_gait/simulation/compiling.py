"""Compilation of a bound loop with numba.

The module uses four internals of numba, checked with numba 0.61 to 0.68: a custom pipeline of passes, the
template that types a call, the result of lowering a function, and the types of its variables. A change of the
first three fails tests/simulation/test_compiling.py, one of the last tests/simulation/test_controllers.py.
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
# Functions that few episodes need. The loop of a single episode calls them, because inlining them would make
# the other episodes up to 3 % slower.
CALLED = frozenset(
    "add_wearer_torques faulty_angle faulty_load add_runaway_torque _drive_faulty _dip".split()
)
_ENDLESS = 1 << 40  # Upper bound of the number of rows at an address; the caller has the real number.


class _Inlined(JITCodeLibrary):  # type: ignore[misc]  # numba has no types
    """Code of a function that is inlined into its callers and never runs by itself."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(NativeLowering):  # type: ignore[misc]
    """Lowering pass of numba that emits machine code for the loop only.

    With machine code of every function of the loop, a compilation takes a fifth longer.
    """

    _name = "lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower a function."""
        if not state.flags.forceinline:
            return bool(super().run_pass(state))
        state.library = _Inlined(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        key = list[None]().append  # key for the callers: a built-in function that is equal to no other one
        state.targetctx.insert_user_function(key, state["cr"].fndesc, [state.library])
        state["cr"] = state["cr"]._replace(cfunc=key)
        return True


class PruningPipeline(CompilerBase):  # type: ignore[misc]
    """Pipeline of numba without its rewrites of array expressions, but with removal of dead branches."""

    lowering: type[NativeLowering] = Lowering  # Pass that generates the code of LLVM.
    # Level 3 of LLVM, the default of numba, takes a third longer here and does not give faster code. Its
    # vectorizer treats loops over the coordinates as long loops and makes the treadmill 15 to 20 % slower.
    level, vectorise = 1, False

    def define_pipelines(self) -> list[Any]:
        """Return a list with the one pipeline and its passes."""
        self.state.flags.no_rewrites = True  # this flag alone would also leave out the pruning
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state, "pruning")
        manager.add_pass_after(DeadBranchPrune, ReconstructSSA)
        replacements = {NativeLowering: self.lowering}
        manager.passes = [(replacements.get(item, item), why) for item, why in manager.passes]
        manager.finalize()
        return [manager]


# Compiled functions of the loops of this process; the next loop compiles only the functions that differ.
_made: dict[type[PruningPipeline], dict[Hashable, Any]] = {}

_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class _Distinct(ir.values.MDValue):  # type: ignore[misc]  # llvmlite has no types
    def descr(self, buffer: Any) -> None:
        buffer += ("distinct !{ ", ", ".join(item.get_reference() for item in self.operands), " }\n")

    def __eq__(self, other: object) -> bool:
        return self is other  # otherwise llvmlite would merge metadata with equal operands

    __hash__ = ir.values.MDValue.__hash__


def distinct(module: Any) -> Any:
    """Return metadata that is equal only to itself, as LLVM requires for loops and access groups."""
    return _Distinct(module, (), name=str(len(module.metadata)))


def _instruction(argument_type: Any, result_type: Any, build: Callable[[Any, Any], Any]) -> Any:
    """Return a function of one number that is compiled to one or two instructions of the processor."""

    @intrinsic  # type: ignore[untyped-decorator]
    def instruction(typing: Any, number: Any) -> Any:
        return result_type(argument_type), lambda context, builder, signature, arguments: build(
            builder, arguments[0]
        )

    return instruction


def _shifted_to_exponent(builder: Any, number: Any) -> Any:
    exponent = builder.shl(builder.add(builder.bitcast(number, _BITS), _BITS(1023)), _BITS(52))
    return builder.bitcast(exponent, ir.DoubleType())


# Three conversions: an integer to a pointer; the lowest bits of a sum with 1.5 2^52 to the exponent of a
# number; and a number to an integer with the same bits.
_pointer = _instruction(types.int64, types.voidptr, lambda builder, n: builder.inttoptr(n, cgutils.voidptr_t))
_power_of_two = _instruction(types.float64, types.float64, _shifted_to_exponent)
_whole_number = _instruction(types.float64, types.int64, lambda builder, n: builder.bitcast(n, _BITS))
# Replacements of functions of :mod:`twin_gait.core.elementary` by name, ready to be bound. Compiled by numba,
# the originals would be a call of the C library and a conversion to integers and back.
BIT_FUNCTIONS = {"power_of_two": _power_of_two, "whole_number": _whole_number}


def jit(function: Any, *, inline: bool = True, pipeline: type[PruningPipeline] = PruningPipeline) -> Any:
    """Return a function of a loop that numba compiles for the argument types of its callers."""
    made = numba.njit(**_OPTIONS, pipeline_class=pipeline, forceinline=inline)(function)
    template = made.get_call_template
    # Otherwise every literal 0, 1, -1 in a call has its own type and causes another compilation.
    plain = types.unliteral  # type: ignore[attr-defined]  # numba has no types
    made.get_call_template = lambda args, kws: template(tuple(map(plain, args)), kws)
    return made


def record_accessor(dtype: np.dtype[Any]) -> Any:
    """Return a compiled function that maps an address to the record at it."""
    return jit(lambda address: numba.carray(_pointer(address), 1, dtype)[0])


def row_accessor(dtype: np.dtype[Any], *shape: int) -> Any:
    """Return a compiled function that maps an address and a number to that record, or row of a shape."""
    rows = (_ENDLESS, *shape)
    return jit(lambda address, number: numba.carray(_pointer(address), rows, dtype)[number])


def compile_loop(
    entry: Callable[..., int],
    names: Mapping[str, Any],
    user_controller: str = "",
    pipeline: type[PruningPipeline] = PruningPipeline,
) -> CompiledLoop:
    """Bind an entry, which takes and returns integers, to names, and compile it.

    ``user_controller``: name of the user's controller for messages; empty if no function of ``names`` is the
    user's.
    """
    called = {entry.__name__} if pipeline.vectorise else {entry.__name__, *CALLED}

    def made(function: FunctionType) -> Any:
        return jit(function, inline=function.__name__ not in called, pipeline=pipeline)

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
    """Compile the code in this context with the optimization settings of a pipeline."""
    config, collects = numba.config, gc.isenabled()
    kept = config.OPT, config.LOOP_VECTORIZE
    config.OPT, config.LOOP_VECTORIZE = type(config.OPT)(pipeline.level), int(pipeline.vectorise)
    gc.disable()  # garbage collection of the compiler's millions of small objects takes a tenth of the time
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE = kept
        if collects:
            gc.enable()


def _needs_only_libc(library: Any) -> bool:
    """Return whether compiled code calls only the C library; LLVM aborts if it cannot resolve a name."""
    process = ctypes.CDLL(None)
    needed = [item.name for item in library._final_module.functions if item.is_declaration]
    return all(name.startswith("llvm.") or hasattr(process, name) for name in needed)


@lru_cache(maxsize=16)
def compile_user_tick(controller: str, tick: Any, assisted: bool, device: np.dtype[Any]) -> Any:
    """Compile a function of the user that is a part of a controller.

    ``assisted``: whether its memory is the one next to that of the assistance. ``device``: layout of the
    record that the function receives, with its memory. Raises UncompiledControllerError if numba cannot
    compile it, ParameterError if it returns a value or writes a float into an integer field.
    """
    memory = device["memory"]["other"] if assisted else device["memory"]
    kinds = (numba.from_dtype(memory), numba.from_dtype(device), numba.int64, numba.float64)
    try:
        checked = numba.njit(nogil=True, boundscheck=True)  # otherwise a wrong index writes into the record
        compiled = tick if isinstance(tick, Dispatcher) else specialize(tick, BIT_FUNCTIONS, checked)
        compiled.compile(kinds)
    except (*_REFUSED, TypeError, AttributeError, KeyError, AssertionError) as error:
        raise UncompiledControllerError(f"numba cannot compile the controller {controller!r}") from error
    answer = compiled.overloads[kinds].signature.return_type
    require_no_result(controller, None if answer == types.none else answer)
    require_whole_numbers(controller, next(_cut(compiled.overloads[kinds]), None))
    return compiled


def _cut(made: Any) -> Iterator[str]:
    """Yield the integer fields into which a compiled function, or a function that it calls, writes a float.

    Machine code would truncate the float without an error, but Python keeps it.
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
