"""Compilation of a loop over a block of episodes, in which a field of the record is a vector over the lanes.

Steps and laws compile for a block (:mod:`twin_gait.simulation.views`) without a change. A loop over ``lanes``
is marked for the vectorizer of LLVM as a loop whose iterations share no memory: its body receives only its
own lane and may write only to the fields of this lane.

LLVM vectorizes a body under three conditions. Fields that are equal in all lanes (``block.SHARED``) are read
before any condition, because LLVM moves no conditional read out of a loop, and an access that depends on such
a field would become a gather. A loop that combines a flag over the lanes reads the flag from memory, because
LLVM would otherwise make two loops, one for each value. The body has no loop of unknown length, no
``continue`` and no call that is not inlined.

Outside of a loop over lanes, only fields that are equal in all lanes can be read; numba rejects other fields.
Most of these loops are in the driver of a schedule (:mod:`twin_gait.simulation.executors`).
tests/simulation/test_lanes.py compares lanes and single episodes bit for bit.
"""

# numba and llvmlite have no types.
# mypy: disable-error-code="misc, untyped-decorator, attr-defined"

import re
from functools import lru_cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, lowering, types
from numba.core.compiler_machinery import register_pass
from numba.extending import intrinsic

from twin_gait.simulation.block import WIDTH
from twin_gait.simulation.compiling import Lowering, PruningPipeline, distinct, jit, row_accessor
from twin_gait.simulation.views import INTEGER, WORD, LanesView, ListView, RecordView, make_view


def _number(block: Any) -> int:
    """Return the number of a basic block in the function, -1 for any other block."""
    found = re.match(r"B(\d+)", block.name)
    return int(found[1]) if found else -1


def _jumps(block: Any, targets: list[Any]) -> bool:
    """Return whether a basic block ends with a jump to one of the targets."""
    return any(target in getattr(block.terminator, "operands", ()) for target in targets)


class _Marking(lowering.Lower):
    """Lowering that marks loops over lanes for the vectorizer, and loops over lists for unrolling."""

    def post_lower(self) -> None:
        super().post_lower()
        for header, index, over in self.function.__dict__.get("view_loops", ()):
            latches = self._latches(header)
            self._mark(header, latches, over)
            for latch in latches:  # the index is advanced here, so that the last block keeps its mark
                builder = ir.IRBuilder(latch)
                builder.position_before(latch.terminator)
                builder.store(builder.add(builder.load(index), INTEGER(1), flags=("nsw",)), index)

    def _latches(self, header: Any) -> list[Any]:
        """Return the blocks that end the body of a loop.

        They jump to the header. A body of more than 255 instructions jumps to an empty block before it,
        that of the EXTENDED_ARG of the bytecode.
        """
        blocks, first = self.function.blocks, _number(header)
        empty = [
            block
            for block in blocks
            if _number(block) < first and len(block.instructions) == 1 and _jumps(block, [header])
        ]
        return [block for block in blocks if _number(block) >= first and _jumps(block, [header, *empty])]

    def _mark(self, header: Any, latches: list[Any], over: Any) -> None:
        note = self.module.add_metadata
        in_vectors = isinstance(over, LanesView) and over.count
        group, loop = distinct(self.module), distinct(self.module)
        if in_vectors:
            parallel = note(["llvm.loop.parallel_accesses", group])
            loop.operands = (loop, parallel, note(["llvm.loop.unroll.disable"]))
        elif isinstance(over, LanesView):
            loop.operands = (loop, note(["llvm.loop.unroll.disable"]))
        else:
            loop.operands = (loop, note(["llvm.loop.unroll.full"]))
        for latch in latches:
            latch.terminator.set_metadata("llvm.loop", loop)
        last = max(map(_number, latches))
        for block in self.function.blocks if in_vectors else ():
            if _number(header) <= _number(block) <= last:
                for line in block.instructions:
                    if isinstance(line, ir.CallInstr) or "tbaa" in line.metadata:
                        line.set_metadata("llvm.access.group", group)


@register_pass(mutates_CFG=True, analysis_only=False)
class _MarkingPass(Lowering):
    _name = "marking"
    lowering_class = _Marking


class LanePipeline(PruningPipeline):
    """Pipeline of the loop of a single episode, with a pass that marks loops over lanes."""

    lowering = _MarkingPass
    level, vectorise = 3, True


def block_at(dtype: np.dtype[Any]) -> Any:
    """Return a compiled function that maps an address to the block at it."""
    block = RecordView(numba.from_dtype(dtype), "episode", True)

    @intrinsic
    def block_at(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            base = builder.inttoptr(args[0], cgutils.voidptr_t)
            return make_view(context, builder, block, base, INTEGER(0))

        return block(types.int64), generate

    return block_at


def lane_iterator(in_vectors: bool) -> Any:
    """Create the intrinsic that iterates over the lanes, by vectors or one by one."""

    @intrinsic
    def through(typing: Any, e: Any) -> Any:
        if not (isinstance(e, RecordView) and e.whole):
            return None
        every = LanesView(e.item, e.field, False, int(in_vectors))

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            block = cgutils.create_struct_proxy(e)(context, builder, args[0])
            return make_view(context, builder, every, block.base, block.lane)

        return every(e), generate

    return through


def lane_row_accessor(width: int) -> Any:
    """Return a compiled function that maps an address, a number and a lane to the lane's part of that row.

    The rows of all lanes are interleaved, like their records. ``width``: numbers in a row.
    """
    row = ListView(types.float64, "log", False, width)

    @intrinsic
    def row_beside(typing: Any, address: Any, number: Any, one: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            offset = builder.mul(args[1], INTEGER(width * WORD * WIDTH))
            base = builder.inttoptr(builder.add(args[0], offset), cgutils.voidptr_t)
            lane = cgutils.create_struct_proxy(one)(context, builder, args[2]).lane
            return make_view(context, builder, row, base, lane)

        return row(types.int64, types.int64, one), generate

    return row_beside


@lru_cache(maxsize=32)
def lane_names(episode: np.dtype[Any], width: int, noises: int) -> dict[str, Any]:
    """Return the functions for a block that replace those of a single episode in the bound names of a loop.

    ``width`` and ``noises``: numbers in a row of the log and in a row of the noise.
    """
    row_of, readings = lane_row_accessor(width), row_accessor(np.dtype(float), noises)

    def log_row(e: Any, tick: int) -> Any:
        return row_of(e.recording.log, tick - e.recording.first_row, e)

    # A run of a block is never longer than its noise table, so that a minimum replaces the modulo.
    def noise_row(e: Any, tick: int) -> Any:
        return readings(e.recording.noise, min(tick, e.recording.n_noise - 1))

    found = {item.__name__: jit(item, pipeline=LanePipeline) for item in (log_row, noise_row)}
    return {
        "episode_at": block_at(episode),
        "vector_lanes": lane_iterator(True),
        "scalar_lanes": lane_iterator(False),
        **found,
    }
