"""Episodes in lockstep: a field of the record is a vector over the lanes of a block.

For numba a block (:mod:`twin_gait.simulation.block`), a lane of it, and every record or list in them are
views with the fields of the record, so that rooms and laws compile over a block as they stand. A loop over
``lanes`` is marked for LLVM's vectoriser as one whose passes share no memory: its body may write fields of
its own lane only, which is all that it is handed.

Three rules make a body vector code. Fields that are alike in all lanes (``block.SHARED``) are read before any
condition, since LLVM moves no conditional read out of a loop, and what they lead to would be gathered. A loop
that sums up a flag reads it from memory, or LLVM makes two loops of it, one for each value. And there is no
loop of unknown length, no ``continue`` and no call that is not inlined in it.

Outside a loop over lanes only what is alike in all of them can be read; numba refuses any other field.
tests/simulation/test_lanes.py compares lanes and single episodes bit for bit.
"""

# numba and llvmlite have no types.
# mypy: disable-error-code="misc, untyped-decorator, name-defined, attr-defined, no-untyped-def"

from __future__ import annotations

import hashlib
import operator
import re
from functools import lru_cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, lowering, types
from numba.core.compiler_machinery import register_pass
from numba.core.errors import TypingError
from numba.core.imputils import RefType, iternext_impl
from numba.core.typed_passes import NativeLowering
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    lower_setattr_generic,
    models,
    overload,
    register_model,
)

from twin_gait.simulation.block import SHARED, WIDTH
from twin_gait.simulation.compiling import Manner, Pruning, distinct, jit, numbers_at

# Tests set this: LLVM then says on the standard error of which loop over lanes it makes no vectors. Without
# it the loops are as fast, and nothing is written to a user's terminal.
INSISTING = False
_OWNERS = frozenset(name.split(".")[0] for name in SHARED)
_WORD = 8
_INTEGER = ir.IntType(64)


@lru_cache(maxsize=1024)
def _short(item: Any) -> str:
    """Name of a type; that of a record would be a page, in the name of every function that takes it."""
    return hashlib.blake2b(str(item).encode(), digest_size=6).hexdigest()


class View(types.Type):
    """What stands at a place of a block.

    Attributes:
        item: numba's type of the record, or of an entry of the list.
        field: Name of the field that it stands in, as far as that matters.
        whole: Whether it is that of all lanes.
        count: Entries of a list.
    """

    def __init__(self, item: Any, field: str, whole: bool, count: int = 0) -> None:
        """Name the type by all that it depends on."""
        self.item, self.field, self.whole, self.count = item, field, whole, count
        super().__init__(f"{type(self).__name__}({_short(item)}, {field}, {whole}, {count})")

    @property
    def shared(self) -> bool:
        """Whether it is a list of numbers that are alike in all lanes."""
        return self.field in SHARED


class RecordView(View):
    """A record."""


class ListView(View, types.IterableType):
    """A list of records or numbers with ``count`` entries."""

    @property
    def iterator_type(self) -> Any:
        """Of its entries."""
        if not _readable(self, _entry(self)):
            raise TypingError(f"{self.field}: unlike in the lanes")
        return ViewIterator(self, _entry(self))


class LanesView(View, types.IterableType):
    """The lanes of a block, one after the other; ``count`` says whether in vectors."""

    @property
    def iterator_type(self) -> Any:
        """Of lanes."""
        return ViewIterator(self, RecordView(self.item, self.field, False))


class ViewIterator(types.SimpleIteratorType):
    """Goes through a list or the lanes."""

    def __init__(self, over: View, entry: Any) -> None:
        """Name it by what it goes through."""
        self.over = over
        super().__init__(f"iter({over.name})", entry)


@register_model(RecordView)
@register_model(ListView)
@register_model(LanesView)
class _ViewModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("base", types.voidptr), ("lane", types.int64)])


@register_model(ViewIterator)
class _IteratorModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("over", kind.over), ("index", types.EphemeralPointer(types.int64))])


def _seen(item: Any, owner: str, name: str, whole: bool) -> Any:
    """Type of what is found in a field: a number as it is, a view of what is larger."""
    if isinstance(item, types.Record):
        return RecordView(item, name if name in _OWNERS else "", whole)
    if isinstance(item, types.NestedArray):
        rest = item.shape[1:]
        entry = types.NestedArray(item.dtype, rest) if rest else item.dtype
        return ListView(
            entry, f"{owner}.{name}" if f"{owner}.{name}" in SHARED else name, whole, item.shape[0]
        )
    return item


def _entry(view: Any) -> Any:
    """Type of an entry of a list."""
    return _seen(view.item, "", view.field, view.whole)


def _readable(view: Any, entry: Any) -> bool:
    """Whether an entry of a list may be read: a number of a lane, or one that is alike in all."""
    return isinstance(entry, View) or not view.whole or view.shared


def _bytes_of(item: Any) -> int:
    if isinstance(item, types.Record):
        return int(item.size)
    return int(item.nitems) * _WORD if isinstance(item, types.NestedArray) else _WORD


# ---------------------------------------------------------------------- typing


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordView

    def generic_resolve(self, kind: Any, name: str) -> Any:
        if name not in kind.item.fields:
            return None
        found = _seen(kind.item.typeof(name), kind.field, name, kind.whole)
        readable = isinstance(found, View) or not kind.whole or f"{kind.field}.{name}" in SHARED
        return found if readable else None


@infer_global(operator.getitem)
class _Entries(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if type(args[0]) is ListView and isinstance(args[1], types.Integer):
            found = _entry(args[0])
            if _readable(args[0], found):
                return signature(found, args[0], types.int64)
        return None


@infer_global(operator.setitem)
class _Stores(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if type(args[0]) is ListView and isinstance(args[1], types.Integer):
            return signature(types.none, args[0], types.int64, args[0].item)
        return None


@overload(len)
def _length(view):  # numba compares this with the signature of what it returns
    if isinstance(view, ListView):
        count = view.count
        return lambda view: count
    return None


# ---------------------------------------------------------------------- machine code


def _view(context: Any, builder: Any, kind: Any, base: Any, lane: Any) -> Any:
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.base, made.lane = base, lane
    return made._getvalue()


def _address(context: Any, builder: Any, kind: Any, view: Any, offset: Any) -> tuple[Any, Any]:
    """Where something stands, ``offset`` bytes of a block from a view, and which lane is meant."""
    view = cgutils.create_struct_proxy(kind)(context, builder, view)
    return builder.gep(view.base, [offset], inbounds=True), view.lane


def _load(
    context: Any, builder: Any, kind: Any, view: Any, found: Any, offset: Any, name: str, shared: bool
) -> Any:
    """A number, or the view of what is larger."""
    base, lane = _address(context, builder, kind, view, offset)
    if isinstance(found, View):
        return _view(context, builder, found, base, lane)
    address = builder.bitcast(base, context.get_data_type(found).as_pointer())
    if not shared:
        address = builder.gep(address, [lane], inbounds=True)
    number = builder.load(address, align=_WORD)
    _label(builder, number, name)
    if shared:  # read in the first lane, once
        number.set_metadata("invariant.load", builder.module.add_metadata([]))
    return number


def _store(
    context: Any, builder: Any, kind: Any, view: Any, value: Any, item: Any, offset: Any, name: str
) -> None:
    base, lane = _address(context, builder, kind, view, offset)
    address = builder.bitcast(base, context.get_data_type(item).as_pointer())
    _label(builder, builder.store(value, builder.gep(address, [lane], inbounds=True), align=_WORD), name)


def _label(builder: Any, access: Any, name: str) -> None:
    """Fields of different names lie apart: LLVM need not compare their places, which are too many for it."""
    note = builder.module.add_metadata
    label = note([name, note(["lanes"]), _INTEGER(0)])
    access.set_metadata("tbaa", note([label, label, _INTEGER(0)]))


def _in_block(kind: Any, name: str) -> Any:
    return _INTEGER(kind.item.offset(name) * WIDTH)


def _stride(builder: Any, kind: Any, index: Any) -> Any:
    return builder.mul(index, _INTEGER(_bytes_of(kind.item) * WIDTH), flags=("nsw",))


@lower_getattr_generic(RecordView)
def _get_field(context: Any, builder: Any, kind: Any, view: Any, name: str) -> Any:
    found = _seen(kind.item.typeof(name), kind.field, name, kind.whole)
    shared = f"{kind.field}.{name}" in SHARED
    return _load(context, builder, kind, view, found, _in_block(kind, name), name, shared)


@lower_setattr_generic(RecordView)
def _set_field(context: Any, builder: Any, sig: Any, args: Any, name: str) -> None:
    kind, item = sig.args[0], sig.args[0].item.typeof(name)
    assert not kind.whole and f"{kind.field}.{name}" not in SHARED, f"{name}: alike in all lanes"
    assert not isinstance(item, (types.Record, types.NestedArray)), f"{name}: copy it number by number"
    _store(context, builder, kind, args[0], args[1], item, _in_block(kind, name), name)


@lower_builtin(operator.getitem, ListView, types.Integer)
def _get_entry(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0]
    offset = _stride(builder, kind, args[1])
    return _load(context, builder, kind, args[0], _entry(kind), offset, kind.field, kind.shared)


@lower_builtin(operator.setitem, ListView, types.Integer, types.Any)
def _set_entry(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0]
    assert not kind.whole and not kind.shared, f"{kind.field}: alike in all lanes"
    _store(context, builder, kind, args[0], args[2], kind.item, _stride(builder, kind, args[1]), kind.field)
    return context.get_dummy_value()


@lower_builtin("getiter", ListView)
@lower_builtin("getiter", LanesView)
def _begin(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    made.over, made.index = args[0], cgutils.alloca_once_value(builder, _INTEGER(0))
    return made._getvalue()


@lower_builtin("iternext", ViewIterator)
@iternext_impl(RefType.UNTRACKED)
def _next(context: Any, builder: Any, sig: Any, args: Any, result: Any) -> None:
    kind = sig.args[0]
    over, header = kind.over, builder.block
    state = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    index = builder.load(state.index)
    count = WIDTH if isinstance(over, LanesView) else over.count
    more = builder.icmp_signed("<", index, _INTEGER(count))
    result.set_valid(more)
    loops = builder.function.__dict__.setdefault("view_loops", [])
    loops.append((header, state.index, over))
    if isinstance(
        over, LanesView
    ):  # without a branch: a lane kept from before would tie one pass to the next
        block = cgutils.create_struct_proxy(over)(context, builder, state.over)
        result.yield_(_view(context, builder, kind.yield_type, block.base, index))
        return
    with builder.if_then(more):
        offset = _stride(builder, over, index)
        result.yield_(
            _load(context, builder, over, state.over, _entry(over), offset, over.field, over.shared)
        )


# ---------------------------------------------------------------------- loops over lanes


def _number(block: Any) -> int:
    """Place of a basic block in the function's text."""
    found = re.match(r"B(\d+)", block.name)
    return int(found[1]) if found else -1


class _Marking(lowering.Lower):
    """Marks loops over lanes for the vectoriser, and those over lists to be unrolled."""

    def post_lower(self) -> None:
        super().post_lower()
        for header, index, over in self.function.__dict__.get("view_loops", ()):
            latches = [
                block
                for block in self.function.blocks
                if _number(block) >= _number(header) and header in getattr(block.terminator, "operands", ())
            ]
            self._mark(header, latches, over)
            for latch in latches:  # counted here, the last block of the loop keeps its mark
                builder = ir.IRBuilder(latch)
                builder.position_before(latch.terminator)
                builder.store(builder.add(builder.load(index), _INTEGER(1), flags=("nsw",)), index)

    def _mark(self, header: Any, latches: list[Any], over: Any) -> None:
        note = self.module.add_metadata
        in_vectors = isinstance(over, LanesView) and over.count
        group, loop = distinct(self.module), distinct(self.module)
        if in_vectors:
            parallel = note(["llvm.loop.parallel_accesses", group])
            loop.operands = (loop, parallel, note(["llvm.loop.unroll.disable"]))
            if INSISTING:
                loop.operands += (note(["llvm.loop.vectorize.enable", ir.IntType(1)(1)]),)
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
class _MarkingPass(NativeLowering):
    _name = "marking"
    lowering_class = _Marking


class InLanes(Pruning):
    """The passes of a single episode's loop, with loops over lanes marked."""

    def define_pipelines(self) -> list[Any]:
        """Passes of the one pipeline."""
        (manager,) = super().define_pipelines()
        manager.passes = [
            (_MarkingPass if item is NativeLowering else item, why) for item, why in manager.passes
        ]
        manager._finalized = False
        manager.finalize()
        return [manager]


# ---------------------------------------------------------------------- what rooms are bound to


def block_at(dtype: np.dtype[Any]) -> Any:
    """Compiled function from an address to the block there."""
    block = RecordView(numba.from_dtype(dtype), "episode", True)

    @intrinsic
    def block_at(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return _view(context, builder, block, builder.inttoptr(args[0], cgutils.voidptr_t), _INTEGER(0))

        return block(types.int64), generate

    return block_at


def _through(in_vectors: bool) -> Any:
    @intrinsic
    def through(typing: Any, e: Any) -> Any:
        if not (isinstance(e, RecordView) and e.whole):
            return None
        every = LanesView(e.item, e.field, False, int(in_vectors))

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            block = cgutils.create_struct_proxy(e)(context, builder, args[0])
            return _view(context, builder, every, block.base, block.lane)

        return every(e), generate

    return through


def rows_beside(dtype: np.dtype[Any]) -> Any:
    """Compiled function from an address, a number and a lane to that lane's part of the row of that number.

    Rows of all lanes stand side by side, as their records do.
    """
    row = RecordView(numba.from_dtype(dtype), "log", False)

    @intrinsic
    def row_beside(typing: Any, address: Any, number: Any, one: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            place = builder.mul(args[1], _INTEGER(dtype.itemsize * WIDTH))
            base = builder.inttoptr(builder.add(args[0], place), cgutils.voidptr_t)
            lane = cgutils.create_struct_proxy(one)(context, builder, args[2]).lane
            return _view(context, builder, row, base, lane)

        return row(types.int64, types.int64, one), generate

    return row_beside


IN_LOCKSTEP = Manner(InLanes, 3, True)


def bound_in_lanes(episode: np.dtype[Any], row: np.dtype[Any]) -> dict[str, Any]:
    """What a loop over a block is bound to in place of what that of a single episode is."""
    row_of, tables = rows_beside(row), numbers_at(episode["joints"].shape[0])

    def log_row(e: Any, tick: int) -> Any:
        return row_of(e.recording.log, tick - e.recording.first_row, e)

    # No run of a block is longer than its table, in which a modulo would look for the row.
    def noise_row(e: Any, tick: int) -> Any:
        return tables(e.recording.noise, min(tick, e.recording.n_noise - 1))

    def effort_noise_row(e: Any, tick: int) -> Any:
        return tables(e.efforts.noise, min(tick, e.efforts.n_noise - 1))

    found = {item.__name__: jit(item, manner=IN_LOCKSTEP) for item in (log_row, noise_row, effort_noise_row)}
    return {"episode_at": block_at(episode), "lanes": _through(True), "each": _through(False), **found}
