"""Types of numba that present a block of episodes like the record of one episode.

A block (:func:`~twin_gait.simulation.block.interleave`), a lane of it, and every record or list in them are
views: an address and a lane, with the fields of the record. Fields that are equal in all lanes are read once,
in the first lane; other fields of a block as a whole cannot be read, and none can be written.
"""

# numba and llvmlite have no types.
# mypy: disable-error-code="misc, untyped-decorator, name-defined, attr-defined, no-untyped-def"

import hashlib
import operator
from functools import lru_cache
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.imputils import RefType, iternext_impl
from numba.core.typing import templates

from twin_gait.simulation.block import SHARED, WIDTH

_OWNERS = frozenset(name.split(".")[0] for name in SHARED)
WORD = 8
INTEGER = ir.IntType(64)


@lru_cache(maxsize=1024)
def _short(item: Any) -> str:
    """Return a short name of a type; the full name of a record would make all function names too long."""
    return hashlib.blake2b(str(item).encode(), digest_size=6).hexdigest()


class View(types.Type):
    """Type of a record, a list or the lanes at an address in a block.

    Attributes:
        item: numba's type of the record, or of an entry of the list.
        field: Name of the field that contains the view; see :func:`_field`.
        whole: Whether the view is of all lanes.
        count: Number of entries of a list.
    """

    def __init__(self, item: Any, field: str, whole: bool, count: int = 0) -> None:
        """Name the type by all values that it depends on."""
        self.item, self.field, self.whole, self.count = item, field, whole, count
        super().__init__(f"{type(self).__name__}({_short(item)}, {field}, {whole}, {count})")


class RecordView(View):
    """View of a record."""


class ListView(View, types.IterableType):
    """View of a list of records or numbers with ``count`` entries."""

    @property
    def iterator_type(self) -> Any:
        """Type of the iterator over the entries."""
        entry = _found(self, self.item, self.field)
        if entry is None:
            raise TypingError(f"{self.field}: unlike in the lanes")
        return ViewIterator(self, entry)


class LanesView(View, types.IterableType):
    """View of the lanes of a block in order; ``count`` is 1 if the loop over them is vectorized, else 0."""

    @property
    def iterator_type(self) -> Any:
        """Type of the iterator over the lanes."""
        return ViewIterator(self, RecordView(self.item, self.field, False))


class ViewIterator(types.SimpleIteratorType):
    """Iterator over a list or over the lanes."""

    def __init__(self, over: View, entry: Any) -> None:
        """Name the type by the view that it iterates over."""
        self.over = over
        super().__init__(f"iter({over.name})", entry)


@extending.register_model(RecordView)
@extending.register_model(ListView)
@extending.register_model(LanesView)
class _ViewModel(extending.models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("base", types.voidptr), ("lane", types.int64)])


@extending.register_model(ViewIterator)
class _IteratorModel(extending.models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("over", kind.over), ("index", types.EphemeralPointer(types.int64))])


def _field(owner: str, name: str) -> str:
    """Return the name of a field, with the name of its record as a prefix if all lanes share the field."""
    return f"{owner}.{name}" if f"{owner}.{name}" in SHARED else name


def _found(view: Any, item: Any, field: str) -> Any:
    """Return the type of an item of a view: a number, a view, or None if the item must not be read."""
    if isinstance(item, types.Record):
        return RecordView(item, field if field in _OWNERS else "", view.whole)
    if isinstance(item, types.NestedArray):
        rest = item.shape[1:]
        entry = types.NestedArray(item.dtype, rest) if rest else item.dtype
        return ListView(entry, field, view.whole, item.shape[0])
    return item if field in SHARED or not view.whole else None


def _bytes_of(item: Any) -> int:
    if isinstance(item, types.Record):
        return int(item.size)
    return int(item.nitems) * WORD if isinstance(item, types.NestedArray) else WORD


# ---------------------------------------------------------------------- typing


@templates.infer_getattr
class _Fields(templates.AttributeTemplate):
    key = RecordView

    def generic_resolve(self, kind: Any, name: str) -> Any:
        if name not in kind.item.fields:
            return None
        return _found(kind, kind.item.typeof(name), _field(kind.field, name))


@templates.infer_global(operator.getitem)
class _Entries(templates.AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if type(args[0]) is ListView and isinstance(args[1], types.Integer):
            found = _found(args[0], args[0].item, args[0].field)
            if found is not None:
                return templates.signature(found, args[0], types.int64)
        return None


@templates.infer_global(operator.setitem)
class _Stores(templates.AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if type(args[0]) is ListView and isinstance(args[1], types.Integer):
            return templates.signature(types.none, args[0], types.int64, args[0].item)
        return None


@extending.overload(len)
def _length(view):  # numba compares this signature with that of the returned function
    if isinstance(view, ListView):
        count = view.count
        return lambda view: count
    return None


# ---------------------------------------------------------------------- machine code


def make_view(context: Any, builder: Any, kind: Any, base: Any, lane: Any) -> Any:
    """Generate a view from the address of its data in the first lane and the number of its lane."""
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.base, made.lane = base, lane
    return made._getvalue()


def _address(context: Any, builder: Any, kind: Any, view: Any, offset: Any) -> tuple[Any, Any]:
    """Generate the address of an item, ``offset`` bytes of a block from a view, and its lane."""
    view = cgutils.create_struct_proxy(kind)(context, builder, view)
    return builder.gep(view.base, [offset], inbounds=True), view.lane


def _load(context: Any, builder: Any, kind: Any, view: Any, item: Any, field: str, offset: Any) -> Any:
    """Generate the read of a number, or the view of a record or list."""
    base, lane = _address(context, builder, kind, view, offset)
    found, shared = _found(kind, item, field), field in SHARED
    if isinstance(found, View):
        return make_view(context, builder, found, base, lane)
    address = builder.bitcast(base, context.get_data_type(found).as_pointer())
    if not shared:
        address = builder.gep(address, [lane], inbounds=True)
    number = builder.load(address, align=WORD)
    _label(builder, number, field)
    if shared:  # the value of the first lane is read once
        number.set_metadata("invariant.load", builder.module.add_metadata([]))
    return number


def _store(
    context: Any, builder: Any, kind: Any, view: Any, item: Any, field: str, offset: Any, value: Any
) -> None:
    assert not kind.whole and field not in SHARED, f"{field}: alike in all lanes"
    assert not isinstance(item, (types.Record, types.NestedArray)), f"{field}: copy it number by number"
    base, lane = _address(context, builder, kind, view, offset)
    address = builder.bitcast(base, context.get_data_type(item).as_pointer())
    _label(builder, builder.store(value, builder.gep(address, [lane], inbounds=True), align=WORD), field)


def _label(builder: Any, access: Any, name: str) -> None:
    """Mark an access by the name of its field, because fields of different names never overlap.

    LLVM then does not compare the addresses, which are too many for its analysis.
    """
    note = builder.module.add_metadata
    label = note([name, note(["lanes"]), INTEGER(0)])
    access.set_metadata("tbaa", note([label, label, INTEGER(0)]))


def _part(kind: Any, name: str) -> tuple[Any, str, Any]:
    """Return type, name and offset in bytes of a field of a record."""
    return kind.item.typeof(name), _field(kind.field, name), INTEGER(kind.item.offset(name) * WIDTH)


def _entry(builder: Any, kind: Any, index: Any) -> tuple[Any, str, Any]:
    """Return type, name and offset in bytes of an entry of a list."""
    offset = builder.mul(index, INTEGER(_bytes_of(kind.item) * WIDTH), flags=("nsw",))
    return kind.item, kind.field, offset


@extending.lower_getattr_generic(RecordView)
def _get_field(context: Any, builder: Any, kind: Any, view: Any, name: str) -> Any:
    return _load(context, builder, kind, view, *_part(kind, name))


@extending.lower_setattr_generic(RecordView)
def _set_field(context: Any, builder: Any, sig: Any, args: Any, name: str) -> None:
    _store(context, builder, sig.args[0], args[0], *_part(sig.args[0], name), args[1])


@extending.lower_builtin(operator.getitem, ListView, types.Integer)
def _get_entry(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _load(context, builder, sig.args[0], args[0], *_entry(builder, sig.args[0], args[1]))


@extending.lower_builtin(operator.setitem, ListView, types.Integer, types.Any)
def _set_entry(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    _store(context, builder, sig.args[0], args[0], *_entry(builder, sig.args[0], args[1]), args[2])
    return context.get_dummy_value()


@extending.lower_builtin("getiter", ListView)
@extending.lower_builtin("getiter", LanesView)
def _begin(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    made.over, made.index = args[0], cgutils.alloca_once_value(builder, INTEGER(0))
    return made._getvalue()


@extending.lower_builtin("iternext", ViewIterator)
@iternext_impl(RefType.UNTRACKED)
def _next(context: Any, builder: Any, sig: Any, args: Any, result: Any) -> None:
    kind = sig.args[0]
    over, header = kind.over, builder.block
    state = cgutils.create_struct_proxy(kind)(context, builder, args[0])
    index = builder.load(state.index)
    count = WIDTH if isinstance(over, LanesView) else over.count
    more = builder.icmp_signed("<", index, INTEGER(count))
    result.set_valid(more)
    loops = builder.function.__dict__.setdefault("view_loops", [])
    loops.append((header, state.index, over))
    if isinstance(over, LanesView):
        # There is no branch, because a lane from the last iteration would make the iterations dependent.
        block = cgutils.create_struct_proxy(over)(context, builder, state.over)
        result.yield_(make_view(context, builder, kind.yield_type, block.base, index))
        return
    with builder.if_then(more):
        result.yield_(_load(context, builder, over, state.over, *_entry(builder, over, index)))
