"""Printed program as a shared library of this machine, called with the records of Python."""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from twin_gait.firmware.cross import compile_library
from twin_gait.firmware.kinds import BOOL, INT, INT_LIMIT, REAL, Kind, ListKind, Scalar
from twin_gait.firmware.layout import identifier
from twin_gait.firmware.printer import Program
from twin_gait.simulation.problem import NEVER


class Library:
    """Functions of a printed program, compiled for this machine.

    Attributes:
        program: Printed program.
        handle: Handle of the loaded library.
    """

    def __init__(
        self, program: Program, *, double: bool = True, compiler: str = "gcc", flags: Sequence[str] = ()
    ) -> None:
        """Compile and load a program in double numbers, as in Python, or float, as on the device."""
        self.program, self._records = program, program.records
        self._number = ctypes.c_double if double else ctypes.c_float
        self._structures: dict[Any, type[ctypes.Structure]] = {}
        self._functions = {item.source.name: item for item in program.entries}
        with TemporaryDirectory() as folder:
            for name, text in program.files.items():
                Path(folder, name).write_text(text)
            more = ["-DREAL_DOUBLE", *flags] if double else flags
            path = compile_library(sorted(Path(folder).glob("*.c")), compiler=compiler, flags=more)
            self.handle = ctypes.CDLL(str(path))

    def call(self, name: str, *given: Any) -> Any:
        """Call an entry by its name in Python with numbers, and with records and lists that it may change.

        Structures from :meth:`structure` are passed unchanged.
        """
        function = self._functions[name]
        called = self.handle[identifier(name)]
        called.restype = self._result_type(function.returns)
        kinds, taken = list(function.params.values()), []
        for kind, item in zip(kinds, given, strict=True):
            taken.append(item if isinstance(item, ctypes.Structure) else self._taken(kind, item))
        passed = [ctypes.byref(item) if isinstance(item, ctypes.Structure) else item for item in taken]
        result = called(*passed)
        for item, made, kind, param in zip(given, taken, kinds, function.params, strict=True):
            if param in function.written and item is not made:
                self._give_back(kind, made, item)
        if isinstance(function.returns, tuple):
            return tuple(getattr(result, f"value_{k}") for k in range(len(function.returns)))
        return result

    def structure(self, record: Any) -> ctypes.Structure:
        """Return a record as a structure of C, with the tables that it points to."""
        made: ctypes.Structure = self._taken(type(record), record)
        return made

    def read_back(self, structure: ctypes.Structure, record: Any) -> None:
        """Copy the changes of C in a structure to the record from which it was created."""
        self._give_back(type(record), structure, record)

    def _scalar(self, kind: Scalar) -> Any:
        return {REAL: self._number, BOOL: ctypes.c_bool, INT: ctypes.c_int32}[kind]

    def _result_type(self, kind: Kind) -> Any:
        if isinstance(kind, Scalar):
            return self._scalar(kind)
        if isinstance(kind, tuple):
            if kind not in self._structures:
                numbered = enumerate(kind)
                fields = [(f"value_{k}", self._scalar(item)) for k, item in numbered]
                self._structures[kind] = type("Result", (ctypes.Structure,), {"_fields_": fields})
            return self._structures[kind]
        return None

    def _type(self, record: type) -> type[ctypes.Structure]:
        if record not in self._structures:
            fields = []
            for name, kind in self._records.used(record):
                part = self._item(kind.item if isinstance(kind, ListKind) else kind)
                if self._records.is_table(record, name):
                    part = ctypes.POINTER(part)
                elif isinstance(kind, ListKind):
                    assert kind.length is not None
                    part = part * kind.length
                fields.append((name, part))
            self._structures[record] = type(record.__name__, (ctypes.Structure,), {"_fields_": fields})
        return self._structures[record]

    def _item(self, kind: Kind) -> Any:
        return self._scalar(kind) if isinstance(kind, Scalar) else self._type(kind)  # type: ignore[arg-type]

    def _taken(self, kind: Kind, value: Any) -> Any:
        """Return a value as an object of C."""
        if isinstance(kind, Scalar):
            return self._scalar(kind)(value)
        if isinstance(kind, ListKind):
            return (self._item(kind.item) * len(value))(*(self._entry(kind.item, item) for item in value))
        assert isinstance(kind, type)
        made = self._type(kind)()
        for name, inner in self._records.used(kind):
            part = self._entry(inner, getattr(value, name))
            if self._records.is_table(kind, name):
                whole = isinstance(inner, ListKind)
                part = ctypes.cast(part, ctypes.POINTER(part._type_)) if whole else ctypes.pointer(part)
            setattr(made, name, part)
        return made

    def _entry(self, kind: Kind, value: Any) -> Any:
        if kind is INT and value == NEVER:
            return INT_LIMIT - 1
        return value if isinstance(kind, Scalar) else self._taken(kind, value)

    def _give_back(self, kind: Kind, made: Any, value: Any) -> None:
        """Copy the changes of C to a record or a list."""
        if isinstance(kind, ListKind):
            for number, item in enumerate(made):
                if isinstance(kind.item, Scalar):
                    value[number] = item
                else:
                    self._give_back(kind.item, item, value[number])
            return
        assert isinstance(kind, type)
        for name, inner in self._records.used(kind):
            if isinstance(inner, Scalar):
                setattr(value, name, getattr(made, name))
            elif not self._records.is_table(kind, name):
                self._give_back(inner, getattr(made, name), getattr(value, name))
