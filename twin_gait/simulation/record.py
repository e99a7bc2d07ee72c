"""One definition of a record: its class for mypy, a dtype of it for NumPy and numba, plain instances.

A record is a dataclass with slots whose fields are ``float``, ``int``, ``bool``, other records, or lists of
them, all entries of a list alike; parameters that do not change may stand in it as they are declared. A field
that is an ``object`` holds a record of any class. An instance gives the lengths of the lists, and so the
dtype; a list that is empty, or a field that is :data:`ABSENT` or of another kind, is left out of it, and only
code that a constant rules out may name it. Records are never assigned as a whole: that copies in compiled
code and aliases in plain Python.
"""

from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

Record = TypeVar("Record")

ABSENT: Any = None  # what stands in a field that an episode does not have
_CODES = {float: "f8", int: "i8", bool: "i8"}


def kinds_of(kind: Any) -> tuple[tuple[str, type], ...]:
    """Name and type of each field of a record that holds numbers or records; of a list, of its entries."""
    if kind not in _known:
        hints, result = get_type_hints(kind), []
        for item in fields(kind):
            hint = hints[item.name]
            while get_args(hint):
                hint = get_args(hint)[0]
            if hint in _CODES or is_dataclass(hint) or hint is object:
                result.append((item.name, hint))
        _known[kind] = tuple(result)
    return _known[kind]


_known: dict[type, tuple[tuple[str, type], ...]] = {}  # reading hints takes longer than writing a record


def dtype_of(sample: Any) -> np.dtype[Any]:
    """The dtype of a record, aligned as C would; lists have the lengths of those of the instance."""
    layout = []
    for name, kind in kinds_of(type(sample)):
        value, shape = getattr(sample, name), []
        while isinstance(value, (list, tuple)):
            shape.append(len(value))
            value = value[0] if value else ABSENT
        if value is not ABSENT:
            layout.append((name, _CODES.get(kind) or dtype_of(value), tuple(shape)))
    return np.dtype(layout, align=True)


def stored(sample: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """An instance as a NumPy record, the entry of an array of shape ``(1,)``."""
    return np.array([entries(sample)], dtype_of(sample))


def entries(sample: Any) -> tuple[Any, ...]:
    """Values of an instance in the order of its dtype, as NumPy takes them for a record."""
    result = []
    for name, kind in kinds_of(type(sample)):
        value = getattr(sample, name)
        if value is ABSENT or value == [] or value == ():
            continue
        if kind not in _CODES:
            value = [entries(item) for item in value] if isinstance(value, list) else entries(value)
        result.append(value)
    return tuple(result)


def is_record(sample: Any) -> bool:
    """Whether all of something can stand in a record."""
    try:
        stored(sample)
        names = [name for name, _ in kinds_of(type(sample))]
        return hasattr(sample, "__slots__") and names == [item.name for item in fields(sample)]
    except (TypeError, ValueError, NameError, AttributeError, IndexError):
        return False


def float_in(sample: Any) -> str | None:
    """Name of a field of a record, or list of them, that is declared as whole and holds a float, or None."""
    if isinstance(sample, (list, tuple)):
        return next(filter(None, map(float_in, sample)), None)
    for name, kind in () if sample is ABSENT else kinds_of(type(sample)):
        value = getattr(sample, name)
        if kind in (int, bool) and np.asarray(value).dtype.kind == "f":
            return name
        found = None if kind in _CODES else float_in(value)
        if found is not None:
            return found
    return None


def copied(sample: Record | None) -> Record:
    """A copy that shares nothing with a record, or a list of them; what is absent stays so."""
    copy: Any = sample
    if isinstance(sample, (list, tuple)):
        copy = [copied(item) for item in sample]
    elif hasattr(copy, "__slots__"):
        copy = type(copy)(**{item.name: copied(getattr(copy, item.name)) for item in fields(copy)})
    found: Record = copy
    return found
