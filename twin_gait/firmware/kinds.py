"""Kind of a value in C: a number, a record, a list of them, or several numbers that a function returns.

Nothing is guessed: the kinds of the fields of a record come from its class and a sample instance, which
determines the lengths of its lists.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, is_dataclass
from enum import StrEnum
from typing import Any, TypeAlias, get_args, get_origin

from twin_gait.exceptions import FirmwareError
from twin_gait.simulation.record import ABSENT, field_types


class Scalar(StrEnum):
    """A number, by its type in C."""

    REAL = "real"
    INT = "int32_t"
    BOOL = "bool"


REAL, INT, BOOL = Scalar
SCALARS = {float: REAL, int: INT, bool: BOOL}
INT_LIMIT = 2**31
LARGEST_SINGLE = (2.0 - 2.0**-23) * 2.0**127  # largest number of float


@dataclass(frozen=True, slots=True)
class ListKind:
    """A list with entries of one kind."""

    item: Kind  # kind of an entry
    length: int | None  # number of entries; None if it depends on the caller


# A number; a record, by its class, which C passes by its address; a list; several numbers that a function
# returns; nothing.
Kind: TypeAlias = "Scalar | type | ListKind | tuple[Scalar, ...] | None"


def entry_of(kind: Kind) -> Kind:
    """Return the kind of the entries of a list, also of nested lists; any other kind itself."""
    return entry_of(kind.item) if isinstance(kind, ListKind) else kind


def type_name(kind: Kind) -> str:
    """Return the type in C of a number or a record, or of the entries of a list."""
    entry = entry_of(kind)
    return entry.__name__ if isinstance(entry, type) else str(entry)


def joined(first: Kind, second: Kind) -> Kind:
    """Return the common kind of two kinds.

    For lists of two lengths it is a list without length; for two other different kinds it is None.
    """
    if isinstance(first, ListKind) and isinstance(second, ListKind) and first.item == second.item:
        return first if first == second else ListKind(first.item, None)
    return first if first == second else None


class Shapes:
    """Kinds of the fields of all records in samples.

    Attributes:
        fields: Kinds by class and name; a list has no length if two instances differ in it.
    """

    def __init__(self, samples: Iterable[Any]) -> None:
        """Collect the kinds from samples."""
        self.fields: dict[type, dict[str, Kind]] = {}
        self._visited: set[int] = set()
        for sample in samples:
            self._visit(sample)

    def _visit(self, record: Any) -> None:
        kind = type(record)
        if id(record) in self._visited:
            return
        self._visited.add(id(record))
        known = self.fields.setdefault(kind, {})
        for name, entry in field_types(kind):
            value = getattr(record, name)
            if value is not ABSENT and value != [] and value != ():
                found = self._kind(value, entry)
                known[name] = joined(known.get(name, found), found)
                if known[name] is None:
                    where = f"{kind.__name__}.{name}"
                    raise FirmwareError(f"{where}: has different types in two samples")

    def _kind(self, value: Any, entry: type) -> Kind:
        if isinstance(value, (list, tuple)):
            items = [self._kind(item, entry) for item in value]
            if any(item != items[0] for item in items):
                raise FirmwareError(f"a list of {entry.__name__} has entries of different shapes")
            return ListKind(items[0], len(items))
        if entry in SCALARS:
            return SCALARS[entry]
        self._visit(value)
        return type(value)


def kind_of_hint(hint: Any) -> Kind:
    """Return the kind of an annotation; raise TypeError if there is none; lists have no length."""
    if hint in SCALARS:
        return SCALARS[hint]
    if is_dataclass(hint) and isinstance(hint, type):
        return hint
    inner = get_args(hint)
    if get_origin(hint) is tuple and inner and all(item in SCALARS for item in inner):
        return tuple(SCALARS[item] for item in inner)
    if get_origin(hint) in (list, Sequence):
        return ListKind(kind_of_hint(inner[0]), None)
    if hint in (None, type(None), tuple[float, ...]):  # numbers are counted where they are returned
        return None
    raise TypeError(hint)
