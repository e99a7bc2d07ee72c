"""Single definition of a record: a class for mypy, its dtype for NumPy and numba, and plain instances.

A record is a dataclass with slots whose fields are ``float``, ``int``, ``bool``, other records, or lists of
them with entries of one kind. It may contain frozen dataclasses of parameters, which do not change. A field
of type ``object`` contains a record of any class. An instance determines the lengths of the lists, and so the
dtype. The dtype leaves out empty lists and fields that are :data:`ABSENT` or have another type; only code
that a build flag removes may access them. Records are never assigned as a whole, because an assignment copies
in compiled code but creates an alias in plain Python.
"""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from operator import attrgetter
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

from twin_gait.parameters.quantities import field_names

Record = TypeVar("Record")

ABSENT: Any = None  # Value of a field that an episode does not have.
# Lists by phase are padded to a multiple of this length, so that gait tables share one compiled loop.
_PHASE_CAPACITY = 8
_CODES = {float: "f8", int: "i8", bool: "i8"}


def pad_phases(entries: list[Record]) -> list[Record]:
    """Pad a list by phase with copies of its last entry, which no phase reads."""
    return entries + entries[-1:] * (-len(entries) % _PHASE_CAPACITY)


def field_types(kind: Any) -> tuple[tuple[str, type], ...]:
    """Return name and type of each field of a record class with numbers or records; of lists, of entries."""
    if kind not in _known:
        hints, result = get_type_hints(kind), []
        for item in fields(kind):
            hint = hints[item.name]
            while get_args(hint):
                hint = get_args(hint)[0]
            if hint in _CODES or is_dataclass(hint) or hint is object:
                result.append((item.name, hint))
        _known[kind] = tuple(result)
        if len(result) > 1 and all(hints[name] in _CODES for name, _ in result):
            pattern = tuple((name, _CODES[hint], ()) for name, hint in result)
            _numbers[kind] = pattern, attrgetter(*(name for name, _ in result))
    return _known[kind]


# Cache of the fields of each class, because reading the type hints takes longer than writing a record.
_known: dict[type, tuple[tuple[str, type], ...]] = {}
_numbers: dict[type, tuple[Any, Callable[[Any], tuple[Any, ...]]]] = {}  # Cache of records of single numbers.

Pattern = tuple[tuple[str, Any, tuple[int, ...]], ...]  # Name, code or pattern, and shape of each field.


def describe(sample: Any) -> tuple[Pattern, tuple[Any, ...]]:
    """Return the pattern of a record, which determines its dtype, and its values as nested tuples."""
    if type(sample) in _numbers:
        whole, read = _numbers[type(sample)]
        return whole, read(sample)
    pattern, values = [], []
    for name, kind in _known.get(type(sample)) or field_types(type(sample)):
        value = first = getattr(sample, name)
        shape: tuple[int, ...] = ()
        while isinstance(first, (list, tuple)):
            shape, first = (*shape, len(first)), first[0] if first else ABSENT
        if first is ABSENT:
            continue
        inner: Any = _CODES.get(kind)
        if inner is None and shape:
            entries_of = [describe(item) for item in value]
            inner, value = entries_of[0][0], [item for _, item in entries_of]
        elif inner is None:
            inner, value = describe(value)
        pattern.append((name, inner, shape))
        values.append(value)
    return tuple(pattern), tuple(values)


@lru_cache(maxsize=1024)  # an episode has about 50 patterns
def _dtype(pattern: Pattern) -> np.dtype[Any]:
    """Return the dtype of a pattern, with the alignment of C."""
    fields_of = [
        (name, inner if isinstance(inner, str) else _dtype(inner), shape) for name, inner, shape in pattern
    ]
    return np.dtype(fields_of, align=True)


def dtype_of(sample: Any) -> np.dtype[Any]:
    """Return the dtype of a record; the lengths of lists are those of the instance."""
    return _dtype(describe(sample)[0])


def to_array(sample: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """Return an instance as a NumPy record, the entry of an array of shape ``(1,)``."""
    pattern, values = describe(sample)
    return np.array([values], _dtype(pattern))


def entries(sample: Any) -> tuple[Any, ...]:
    """Return the values of an instance in the order of its dtype, for an assignment to a NumPy record."""
    return describe(sample)[1]


def is_record(sample: Any) -> bool:
    """Return whether an object is a record, all of whose fields can be stored in a NumPy record."""
    try:
        to_array(sample)
        names = [name for name, _ in field_types(type(sample))]
        return hasattr(sample, "__slots__") and (*names,) == field_names(type(sample))
    except (TypeError, ValueError, NameError, AttributeError, IndexError):
        return False


def find_float(sample: Any) -> str | None:
    """Return the name of an integer field with a float in a record or list of records, or None."""
    if isinstance(sample, (list, tuple)):
        return next(filter(None, map(find_float, sample)), None)
    for name, kind in () if sample is ABSENT else field_types(type(sample)):
        value = getattr(sample, name)
        if kind in (int, bool) and np.asarray(value).dtype.kind == "f":
            return name
        found = None if kind in _CODES else find_float(value)
        if found is not None:
            return found
    return None


def deep_copy(sample: Record | None) -> Record:
    """Return a deep copy of a record or of a list of records; absent fields stay absent."""
    copy: Any = sample
    if isinstance(sample, (list, tuple)):
        copy = [deep_copy(item) for item in sample]
    elif hasattr(copy, "__slots__"):
        copy = type(copy)(**{name: deep_copy(getattr(copy, name)) for name in field_names(type(copy))})
    found: Record = copy
    return found
