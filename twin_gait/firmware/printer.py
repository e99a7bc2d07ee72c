"""Printer of Python functions as readable C99, and of the records on which they operate.

The printed functions are the ones that the simulation runs: typed, on numbers and records, without recursion,
allocation and calls of the C library. Built with double numbers (``-DREAL_DOUBLE``) their results equal those
of Python bit for bit; a microcontroller uses float.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import twin_gait
from twin_gait.core.elementary_single import SINGLE
from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.function import ELEMENTARY, Function, Functions
from twin_gait.firmware.kinds import SCALARS, Shapes
from twin_gait.firmware.layout import RESERVED_WORDS, comment, identifier, wrapped
from twin_gait.firmware.records import Records, Tables
from twin_gait.firmware.source import Rewrite, Sources
from twin_gait.firmware.statements import Statements, result_struct
from twin_gait.firmware.values import number


class TranslationUnit(NamedTuple):
    """Contents of one C file."""

    name: str  # name of the file
    entries: Sequence[Callable[..., Any]]  # functions that are called from other files
    # records at tick 0, by name. A record to which functions write gets a function ``<name>_init``; any other
    # record is a constant
    samples: Mapping[str, Any]


class Program(NamedTuple):
    """The printed program."""

    files: dict[str, str]  # text of each file by name
    source_hash: str  # hash of all its sources
    records: Records  # layout of the records
    entries: list[Function]  # functions that are called from other files


def print_units(
    units: Sequence[TranslationUnit],
    names: Mapping[str, Any] | None = None,
    text: str = "",
    shapes: Sequence[Any] = (),
    rewrite: Rewrite | None = None,
) -> Program:
    """Print units of firmware.

    Args:
        units: Contents of one C file each.
        names: Constants and functions by the names of the globals that they replace, as in
            :func:`~twin_gait.simulation.binding.specialize`. A branch that a constant excludes is not
            printed.
        text: Source of more functions, which replace globals, too; the functions that they call are looked up
            in ``names``.
        shapes: Samples of records that are passed in from outside: they have no tables, and are complete.
        rewrite: Returns the tree of a function in constructs that the printer has.

    Returns:
        Files by name: ``real.h``, ``types.h``, and a header and a source of each unit.

    Raises:
        FirmwareError: If a construct cannot be printed; it names function, line and construct.
    """
    samples = [item for unit in units for item in unit.samples.values()]
    functions = Functions(sources := Sources(names or {}, text, rewrite), Shapes([*samples, *shapes]), _read)
    entries = {
        unit.name: [functions.entry(sources.source_of(item)) for item in unit.entries] for unit in units
    }
    every = [item for found in entries.values() for item in found]
    outside = Shapes(shapes).fields.items()  # code outside may write to all of these
    functions.mutable |= {(record, name) for record, fields in outside for name in fields}
    records = Records(functions, every)
    body = {"types.h": _header("types", ["real.h"], records.structures())}
    for unit in units:
        body |= _files_of(unit, entries[unit.name], records)
    # The hash covers the functions as they are written in Python, and all tables and constants.
    hashed = [item.source.text for item in functions.order] + ["\n".join(lines) for lines in body.values()]
    source_hash = hashlib.sha256("\0".join(hashed).encode()).hexdigest()
    modules = ", ".join(sorted({item.source.module for item in functions.order}))
    first = comment(
        f"Printed by twin_gait {twin_gait.__version__} from {modules}; source {source_hash[:16]}. "
        "Edit these modules, not this file. Not a medical device."
    )
    texts = {name: "\n".join([*first, "", *lines, ""]) for name, lines in body.items()}
    real = (files("twin_gait.firmware") / "include" / "real.h").read_text()
    return Program({"real.h": real, **texts}, source_hash, records, every)


def _read(functions: Functions, function: Function) -> None:
    """Analyse the statements of a function and record its calls, reads and writes."""
    Statements(functions, function).definition(exported=False)


def _files_of(unit: TranslationUnit, entries: Sequence[Function], records: Records) -> dict[str, list[str]]:
    """Return header and source of a unit without their first lines."""
    reached = set(_reached(entries))
    order = [item for item in records.functions.order if item in reached]
    taken = RESERVED_WORDS | {item.name for item in order}  # names that are not available for local variables
    printed = {item: Statements(records.functions, item, taken) for item in order}
    header, source, tables = list[str](), list[str](), Tables(records)
    for item in entries:
        header += result_struct(item)
    for name, sample in unit.samples.items():
        declared, defined = _sample(name, sample, tables)
        header += [*declared, ""]
        source += defined
    for item in entries:
        header += [*wrapped(f"{printed[item].signature()};", 0), ""]
    for item in order:
        source += [] if item in entries else result_struct(item)
    for item in order:
        source += [*printed[item].definition(exported=item in entries), ""]
    name, flash = unit.name, [*tables.lines, ""] if tables.lines else []
    source = [f'#include "{name}.h"', "", *_constants(order), *flash, *source[:-1]]
    return {f"{name}.h": _header(name, ["types.h"], header), f"{name}.c": source}


def _sample(name: str, sample: Any, tables: Tables) -> tuple[list[str], list[str]]:
    """Return the lines of the header and of the source that define a record at tick 0."""
    kind, contents = type(sample).__name__, tables.initialiser(sample, name)
    if type(sample) not in tables.records.in_ram:
        tables.add(f"const {kind} {name}", contents)
        return [f"extern const {kind} {name};"], []
    tables.add(f"static const {kind} {name}_at_start", contents)
    head = f"void {name}_init({kind} *record)"
    source = [f"{head} {{", f"    *record = {name}_at_start;", "}", ""]
    return [*comment("State at tick 0."), f"{head};"], source


def _constants(functions: Sequence[Function]) -> list[str]:
    found: dict[str, str] = {}
    for function, name, value in ((item, *pair) for item in functions for pair in item.constants.items()):
        text = number(value, SCALARS[type(value)])
        if isinstance(value, float) and function.source.module == ELEMENTARY and name in SINGLE:
            text = f"REAL_OR({value!r}, {SINGLE[name]!r})"
        text = f"({text})" if text[0] == "-" else text
        if found.setdefault(identifier(name), text) != text:
            raise FirmwareError(f"{name}: two constants of this name have different values")
    return [*(f"#define {name} {text}" for name, text in found.items()), ""] if found else []


def _reached(entries: Iterable[Function]) -> Iterator[Function]:
    """Yield the entry functions and all functions that they call."""
    for item in entries:
        yield item
        yield from _reached(item.calls.values())


def _header(name: str, included: Sequence[str], lines: Sequence[str]) -> list[str]:
    guard = f"TWIN_GAIT_{name.upper()}_H"
    includes = [f'#include "{item}"' for item in included]
    first, last = (["#ifdef __cplusplus", brace, "#endif", ""] for brace in ('extern "C" {', "}"))
    return [f"#ifndef {guard}", f"#define {guard}", "", *includes, "", *first, *lines, *last, "#endif"]
