"""What is done to several things that do not touch each other: a loop that LLVM turns into vectors.

Its vectoriser is off for a single episode, because it takes loops over the coordinates for long ones; it
still takes those that are marked as here. Vectors have 2, 4 or 8 lanes, and a loop goes on until they are
full. Every number goes through the same operations in the same order as alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from twin_gait.kernels.generated import SIDE_BY_SIDE
from twin_gait.simulation.binding import bind
from twin_gait.simulation.compiling import ON_BITS, distinct, jit

_COUNT, _NUMBER = ir.IntType(64), ir.DoubleType()
_WIDTHS = (2, 4, 8)
_CACHE_LINE = 64  # [bytes]


def _width(count: int) -> int:
    return next((width for width in _WIDTHS if count <= width), _WIDTHS[-1])


def _passes(count: int) -> int:
    """Passes of a loop over so many things."""
    return -(-count // _width(count)) * _width(count)


def _loop(builder: Any, count: int, body: Callable[[Any], None]) -> None:
    """A loop whose passes share no memory, from 0 to the next full vector."""
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


def _each(function: Any, shared: int, arguments: int) -> Any:
    """Compiled function that calls another one for each of several things.

    Args:
        function: Compiled; takes what all things have in common, then some numbers of one, and returns some.
        shared: What all have in common; it comes first.
        arguments: Numbers of each; those of the first thing come first.
    """

    @intrinsic  # type: ignore[untyped-decorator]
    def each(typing: Any, *given: Any) -> Any:
        common, count = given[:shared], (len(given) - shared) // arguments
        kind, passes = types.Dispatcher(function), _passes(count)
        called = kind.get_call_type(typing, (*common, *(types.float64,) * arguments), {})
        assert called is not None  # it has just been compiled
        results = len(called.return_type)

        def generate(context: Any, builder: Any, signature: Any, packed: Any) -> Any:
            values = cgutils.unpack_tuple(builder, packed[0])
            own = values[shared:]
            room = cgutils.alloca_once(builder, ir.ArrayType(_NUMBER, passes * (arguments + results)))
            room.align = _CACHE_LINE

            def at(row: int, number: Any) -> Any:
                return cgutils.gep_inbounds(builder, room, 0, builder.add(_COUNT(row * passes), number))

            for number in range(passes):  # the last one again and again until the vectors are full
                first = min(number, count - 1) * arguments
                for row in range(arguments):
                    builder.store(own[first + row], at(row, _COUNT(number)))

            def body(index: Any) -> None:
                numbers = [builder.load(at(row, index)) for row in range(arguments)]
                found = context.get_function(kind, called)(builder, (*values[:shared], *numbers))
                for row, value in enumerate(cgutils.unpack_tuple(builder, found)):
                    builder.store(value, at(arguments + row, index))

            _loop(builder, count, body)
            rows = range(arguments, arguments + results)
            found = [builder.load(at(row, _COUNT(number))) for number in range(count) for row in rows]
            return context.make_tuple(builder, signature.return_type, found)

        taken = types.StarArgTuple.from_types(given)  # type: ignore[attr-defined]
        answer = types.UniTuple(types.float64, count * results)  # type: ignore[attr-defined]
        return answer(taken), generate

    return each


def in_vectors(kernel: Mapping[str, Any]) -> dict[str, Any]:
    """What takes the place of those functions of a kernel that call another one for each of several things.

    Args:
        kernel: Its functions by name.
    """
    found = {}
    for item in SIDE_BY_SIDE:
        each = _each(bind(item.function, ON_BITS, jit), item.shared, item.arguments)
        found.update({name: each for name in kernel if name.rpartition("_")[0] == item.name})
    return found
