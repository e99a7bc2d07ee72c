"""Laws for several independent objects of one episode, as loops that LLVM vectorizes.

The vectorizer is off for a single episode, because it treats loops over the coordinates as long loops; it
still processes loops with the marks of this module. Vectors have 2, 4 or 8 lanes, and a loop continues until
they are full. Every number undergoes the same operations in the same order as without vectors.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from twin_gait.kernels.generated import MERGED_FUNCTIONS, MergedFunction
from twin_gait.simulation.binding import specialize
from twin_gait.simulation.compiling import BIT_FUNCTIONS, distinct, jit

_COUNT, _NUMBER = ir.IntType(64), ir.DoubleType()
_WIDTHS = (2, 4, 8)
_CACHE_LINE = 64  # Size of a cache line in bytes.


def _width(count: int) -> int:
    return next((width for width in _WIDTHS if count <= width), _WIDTHS[-1])


def _passes(count: int) -> int:
    return -(-count // _width(count)) * _width(count)


def _loop(builder: Any, count: int, body: Callable[[Any], None]) -> None:
    """Generate a loop whose iterations share no memory, from 0 to the next full vector."""
    before, inside, after = builder.block, *(builder.append_basic_block(name) for name in ("pass", "done"))
    builder.branch(inside)
    builder.position_at_end(inside)
    index = builder.phi(_COUNT)
    index.add_incoming(_COUNT(0), before)
    body(index)
    following = builder.add(index, _COUNT(1), flags=("nuw", "nsw"))
    index.add_incoming(following, builder.block)
    more = builder.icmp_signed("<", following, _COUNT(_passes(count)))
    note = builder.module.add_metadata
    loop = distinct(builder.module)
    loop.operands = (
        loop,
        note(["llvm.loop.vectorize.enable", ir.IntType(1)(1)]),
        note(["llvm.loop.vectorize.width", ir.IntType(32)(_width(count))]),
        note(["llvm.loop.interleave.count", ir.IntType(32)(1)]),
        note(["llvm.loop.unroll.disable"]),
    )
    builder.cbranch(more, inside, after).set_metadata("llvm.loop", loop)
    builder.position_at_end(after)


def _law(typing: Any, function: Any, given: Sequence[Any]) -> tuple[Any, Any]:
    """Return the type of a compiled function and its signature for the argument types ``given``."""
    kind = types.Dispatcher(function)
    signature = kind.get_call_type(typing, tuple(given), {})
    assert signature is not None  # the function has just been compiled
    return kind, signature


def _call_vectorized(
    context: Any, builder: Any, law: tuple[Any, Any], common: Sequence[Any], rows: Sequence[Sequence[Any]]
) -> list[list[Any]]:
    """Generate calls of a law for each of several objects in a loop that can be vectorized.

    ``law``: type and signature. ``common``: first arguments, which are the same for all objects. ``rows``:
    further arguments of each object. Returns the results of each object.
    """
    kind, signature = law
    count, passes, arguments = len(rows), _passes(len(rows)), len(rows[0])
    answer = signature.return_type
    results = len(answer) if isinstance(answer, types.BaseTuple) else 1  # type: ignore[attr-defined]
    # One array for each argument and result: LLVM searches at most 100 uses of an array for its address.
    row_type = ir.ArrayType(_NUMBER, passes)
    arrays = [cgutils.alloca_once(builder, row_type) for _ in range(arguments + results)]
    for array in arrays:
        array.align = _CACHE_LINE

    def at(row: int, number: Any) -> Any:
        return cgutils.gep_inbounds(builder, arrays[row], 0, number)

    for number in range(passes):  # the last object is repeated until the vectors are full
        for row, value in enumerate(rows[min(number, count - 1)]):
            builder.store(value, at(row, _COUNT(number)))

    def body(index: Any) -> None:
        numbers = [builder.load(at(row, index)) for row in range(arguments)]
        found = context.get_function(kind, signature)(builder, (*common, *numbers))
        found = cgutils.unpack_tuple(builder, found) if results > 1 else [found]
        for row, value in enumerate(found):
            builder.store(value, at(arguments + row, index))

    _loop(builder, count, body)
    result_rows = range(arguments, arguments + results)
    return [[builder.load(at(row, _COUNT(number))) for row in result_rows] for number in range(count)]


@lru_cache(maxsize=8)
def _compile_vectorized(item: MergedFunction) -> Any:
    """Return a compiled function that calls another one for each of several objects.

    Its arguments are those that all objects share, then the arguments of the first object, the second, etc.
    """
    function, shared, arguments = specialize(item.function, BIT_FUNCTIONS, jit), item.shared, item.arguments

    @intrinsic  # type: ignore[untyped-decorator]
    def each(typing: Any, *given: Any) -> Any:
        law = _law(typing, function, given[: shared + arguments])
        firsts = range(shared, len(given), arguments)

        def generate(context: Any, builder: Any, signature: Any, packed: Any) -> Any:
            values = cgutils.unpack_tuple(builder, packed[0])
            rows = [values[first : first + arguments] for first in firsts]
            found = _call_vectorized(context, builder, law, values[:shared], rows)
            return context.make_tuple(builder, signature.return_type, list(chain(*found)))

        taken = types.StarArgTuple.from_types(given)  # type: ignore[attr-defined]
        results = len(law[1].return_type) * len(firsts)
        return types.UniTuple(types.float64, results)(taken), generate  # type: ignore[attr-defined]

    return each


@intrinsic  # type: ignore[untyped-decorator]
def vector_map(
    typing: Any, e: Any, indices: Any, staged: Any, read_arguments: Any, law: Any, write_result: Any
) -> Any:
    """Generate the vectorized version of :func:`twin_gait.simulation.backend.vector_map`."""
    taken = _law(typing, read_arguments.dispatcher, (e, types.int64, staged))
    ruled = _law(typing, law.dispatcher, taken[1].return_type.types)
    given = _law(typing, write_result.dispatcher, (e, types.int64, ruled[1].return_type))

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        episode, numbers = arguments[0], cgutils.unpack_tuple(builder, arguments[1])
        read, put = (context.get_function(*item) for item in (taken, given))
        taking = (read(builder, (episode, number, arguments[2])) for number in numbers)
        rows = [cgutils.unpack_tuple(builder, item) for item in taking]
        answer = ruled[1].return_type
        for number, found in zip(numbers, _call_vectorized(context, builder, ruled, (), rows), strict=True):
            one = context.make_tuple(builder, answer, found) if len(found) > 1 else found[0]
            put(builder, (episode, number, one))
        return context.get_dummy_value()

    return types.none(e, indices, staged, read_arguments, law, write_result), generate


def vector_functions(kernel: Mapping[str, Any]) -> dict[str, Any]:
    """Return the functions that vectorize laws in the loop of one episode, by the names that they replace.

    ``kernel``: functions of the kernel by name.
    """
    found = {"vector_map": vector_map}
    for item in MERGED_FUNCTIONS:
        each = _compile_vectorized(item)
        found.update({name: each for name in kernel if name.rpartition("_")[0] == item.name})
    return found
