"""Records in C: a structure for each class, and the values of an instance at tick 0 as tables.

A field to which no printed function writes is a parameter: the structure has its address, and its value is in
flash. All other fields are part of the structure, and are in RAM.
"""

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np

from twin_gait.docstrings import summary_of
from twin_gait.exceptions import FirmwareError
from twin_gait.firmware import kinds
from twin_gait.firmware.function import Function, Functions
from twin_gait.firmware.layout import INDENT, WIDTH, attributes_of, comment, identifier, wrapped
from twin_gait.firmware.values import number
from twin_gait.simulation.simulation_setup import NEVER


class Records:
    """Memory layout of all records of a program."""

    def __init__(self, functions: Functions, entries: Iterable[Function]) -> None:
        """Determine which records are no tables, because the entry functions write to them."""
        self.functions, self.fields = functions, functions.shapes.fields
        self.in_ram: set[type] = set()
        for entry in entries:
            for name in entry.written & entry.params.keys():
                self._embed(entry.params[name])

    def _embed(self, kind: kinds.Kind) -> None:
        """Place a record in RAM, with all its parts."""
        entry = kinds.entry_of(kind)
        if isinstance(entry, type) and entry not in self.in_ram:
            self.in_ram.add(entry)
            for name, inner in self.used(entry):
                if not self.is_table(entry, name):
                    self._embed(inner)

    def used(self, record: type) -> Iterator[tuple[str, kinds.Kind]]:
        """Yield names and kinds of the fields that are read or written, in their order."""
        for name, kind in self.fields.get(record, {}).items():
            if (record, name) in self.functions.used:
                yield name, kind

    def is_table(self, record: type, name: str) -> bool:
        """Return whether a field is the address of a value in flash."""
        kind = self.fields[record][name]
        return not isinstance(kind, kinds.Scalar) and (record, name) not in self.functions.mutable

    def dtype(self, record: type, real: str) -> np.dtype[Any]:
        """Return the layout of a record in C, with a given type of numbers.

        Addresses of tables have 32 bits, as on a Cortex-M.
        """
        codes: dict[kinds.Kind, Any] = {kinds.REAL: real, kinds.INT: "i4", kinds.BOOL: "?"}
        fields: list[Any] = []
        for name, kind in self.used(record):
            shape = []
            while isinstance(kind, kinds.ListKind):
                shape.append(kind.length)
                kind = kind.item
            entry = self.dtype(kind, real) if isinstance(kind, type) else codes[kind]
            fields.append((name, "u4") if self.is_table(record, name) else (name, entry, tuple(shape)))
        return np.dtype(fields, align=True)

    def structures(self) -> list[str]:
        """Return the definitions of all structures, each after the structures that it contains."""
        found: dict[type, list[str]] = {}

        def define(kind: kinds.Kind, is_part: bool) -> None:
            entry = kinds.entry_of(kind)
            if isinstance(entry, type) and not found.get(entry) and (is_part or entry not in found):
                used = dict(self.used(entry))
                for inner in used.values():
                    define(inner, True)
                found[entry] = self._structure(entry, used) if used or is_part else []

        for record in self.fields:
            define(record, False)
        return [line for lines in found.values() for line in lines]

    def _structure(self, record: type, names: Collection[str]) -> list[str]:
        descriptions, summary = attributes_of(record), summary_of(record)
        lines = [*comment(summary), "typedef struct {"]
        for name in names:
            lines += [*comment(descriptions.get(name, ""), INDENT), f"    {self.member(record, name)};"]
        lines += [] if names else ["    char unused;"]  # a structure of C has a member
        return [*lines, f"}} {record.__name__};", ""]

    def member(self, record: type, name: str) -> str:
        """Return the declaration of a field."""
        kind, c_name = self.fields[record][name], identifier(name)
        if isinstance(kind, kinds.Scalar):
            return f"{kind} {c_name}"
        text = kinds.type_name(kind)
        if self.is_table(record, name):
            if isinstance(kind, kinds.ListKind) and isinstance(kind.item, kinds.ListKind):
                raise FirmwareError(f"{record.__name__}.{name}: lists of lists cannot be printed")
            return f"const {text} *{c_name}"
        while isinstance(kind, kinds.ListKind):
            if kind.length is None:
                raise FirmwareError(f"{record.__name__}.{name}: has different lengths in two samples")
            c_name += f"[{kind.length}]"
            kind = kind.item
        return f"{text} {c_name}"


class Tables:
    """Tables of one unit in flash; equal tables are stored once."""

    def __init__(self, records: Records) -> None:
        """Start without tables."""
        self.records = records
        self.lines: list[str] = []
        self._names: dict[tuple[str, str], str] = {}

    def initialiser(self, sample: Any, name: str) -> str:
        """Return the initialiser of a record; its tables are added, with names derived from ``name``."""
        record, parts = type(sample), []
        for field, kind in self.records.used(record):
            value = getattr(sample, field)
            if self.records.is_table(record, field):
                text = self._table(value, kind, f"{name}_{field}")
            else:
                text = self._value(value, kind, f"{name}_{field}", f"{record.__name__}.{field}")
            parts.append(f".{identifier(field)} = {text}")
        return f"{{{', '.join(parts) or '0'}}}"

    def add(self, declaration: str, contents: str) -> None:
        """Define a constant."""
        line = f"{declaration} = {contents};"
        if len(line) <= WIDTH or not contents.startswith("{{"):
            self.lines += wrapped(line, 0)
        else:
            rows = contents[1:-1].replace("}, {", "},\n{").split("\n")
            self.lines.append(f"{declaration} = {{")
            for row in rows:
                self.lines += wrapped(row if row.endswith(",") else f"{row},", INDENT)
            self.lines.append("};")

    def _table(self, value: Any, kind: kinds.Kind, name: str) -> str:
        text = kinds.type_name(kind)
        contents = self._value(value, kind, name, name)
        known = self._names.get((text, contents))
        if known is None:
            known = self._names[text, contents] = name
            size = f"[{len(value)}]" if isinstance(kind, kinds.ListKind) else ""
            self.add(f"static const {text} {name}{size}", contents)
        return known if isinstance(kind, kinds.ListKind) else f"&{known}"

    def _value(self, value: Any, kind: kinds.Kind, name: str, where: str) -> str:
        if isinstance(kind, kinds.ListKind):
            items = [self._value(item, kind.item, f"{name}_{k}", where) for k, item in enumerate(value)]
            return f"{{{', '.join(items)}}}"
        if isinstance(kind, type):
            return self.initialiser(value, name)
        assert isinstance(kind, kinds.Scalar)
        if kind is kinds.INT and value == NEVER:
            return "INT32_MAX"
        largest = kinds.LARGEST_SINGLE if kind is kinds.REAL else kinds.INT_LIMIT - 1
        if abs(value) > largest and value == value and abs(value) != float("inf"):
            raise FirmwareError(f"{where}: {value} does not fit into 32 bits")
        return number(value, kind)
