"""Functional mock-up units (FMI 2.0 for co-simulation) of printed units: variables and archive."""

import hashlib
import math
import platform
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import twin_gait
from twin_gait.firmware.cross import compile_library
from twin_gait.firmware.kinds import BOOL, INT, REAL, SCALARS, Scalar
from twin_gait.firmware.layout import attributes_of, identifier, strip_markup
from twin_gait.firmware.printer import Program
from twin_gait.firmware.values import number
from twin_gait.gait.table import TICK
from twin_gait.simulation.record import field_types
from twin_gait.templates import make_template_environment

_FILES = make_template_environment(
    Path(__file__).with_name("fmu_files"),
    keep_trailing_newline=True,
    autoescape=lambda name: name.endswith(".xml"),
)
_TYPES = {REAL: "Real", INT: "Integer", BOOL: "Boolean"}  # Types of FMI by the kinds of the printer.
_PLATFORMS = {"Linux": ("linux64", "so"), "Darwin": ("darwin64", "dylib")}
# Names of FMI with parts, without quotes.
_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)
# Exponents of the base units by unit.
_BASE_UNITS = {
    **{unit: {unit: 1} for unit in ("rad", "s", "m", "kg", "A")},
    "N": {"kg": 1, "m": 1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}
_DISPLAY_UNITS = {"rad": "deg", "rad/s": "deg/s"}


class FmuVariable(NamedTuple):
    """Variable of an FMU, which is a number in the records of its unit."""

    name: str  # Name for the user, such as ``left_hip.angle``.
    path: str  # Expression in C, such as ``inputs.boards[0].angle``.
    kind: Scalar
    causality: str  # ``input``, ``output`` or ``parameter``, which is tunable.
    start: bool | int | float  # Value at the start; of an output it has no meaning.
    unit: str  # Unit; empty if it has none.
    description: str
    sign: float = 1.0  # -1 if the record contains the negative of the variable.
    reference: int = -1  # Value reference.
    most: int | None = None  # Largest value of an input that is an index, from 0; None for no limits.

    @property
    def type(self) -> str:
        """Type of FMI."""
        return _TYPES[self.kind]

    @property
    def variability(self) -> str:
        """Variability of FMI."""
        return (
            "tunable" if self.causality == "parameter" else "continuous" if self.kind is REAL else "discrete"
        )

    @property
    def is_output(self) -> bool:
        """Whether the unit computes the variable."""
        return self.causality == "output"

    @property
    def c_start(self) -> str:
        """Start value as a literal in C."""
        return number(self.start, self.kind)


@dataclass(frozen=True)
class FmuUnit:
    """Printed unit from which an FMU is made.

    Its C has the functions ``<prefix>_init(unit)``, ``<prefix>_step(unit, inputs, outputs)`` and
    ``<prefix>_update(unit, outputs)``, which makes the outputs valid after a change of parameters.
    """

    name: str  # Name of the FMU and of the file of the unit.
    prefix: str  # Prefix of the functions of the unit.
    description: str  # Description for the user.
    program: Program  # Printed program, in which no record is a constant table.
    records: Mapping[str, Any]  # Samples of ``unit``, ``inputs`` and ``outputs`` at tick 0, by these names.

    def variable(self, name: str, path: str, causality: str, **more: Any) -> Iterator[FmuVariable]:
        """Yield the variable at a path in the records; nothing for a field that the C does not have.

        Unit and description come from the comment of the field; ``more`` replaces fields of the variable.
        """
        root, *parts = re.findall(r"\w+", path)
        value, text = self.records[root], ""
        for part in parts:
            if part.isdigit():
                value = value[int(part)]
                continue
            if (type(value), part) not in self.program.records.functions.used:
                return
            text = attributes_of(type(value)).get(part, part)
            value = getattr(value, part)
        kind, unit = SCALARS[type(value)], re.search(r"\[([^\]]+)\]", text)
        shown = unit[1].replace("·", ".").replace("²", "2") if unit and kind is REAL else ""
        where = name.rpartition(".")[0].replace("_", " ").replace(".", ", ")
        text = strip_markup(f"{where}: {text}" if where else text)
        path = re.sub(r"[A-Za-z]\w*", lambda part: identifier(part[0]), path)
        yield FmuVariable(name, path, kind, causality, value, shown, text)._replace(**more)

    def exchanged(self, causality: str, labels: Mapping[str, Sequence[str]]) -> Iterator[FmuVariable]:
        """Yield all inputs or outputs; ``labels``: names of the entries of each list, by its field."""
        root = f"{causality}s"
        for name, path in _numbers(self.records[root], root, "", labels):
            yield from self.variable(name, path, causality)


def _numbers(
    record: Any, path: str, name: str, labels: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, str]]:
    """Yield name and path of each number in a record."""
    for field, _ in field_types(type(record)):
        value, inner = getattr(record, field), f"{path}.{field}"
        if isinstance(value, list):
            for index, (item, label) in enumerate(zip(value, labels[field], strict=True)):
                if type(item) in SCALARS:
                    yield f"{label}.{field.removesuffix('s')}", f"{inner}[{index}]"
                else:
                    yield from _numbers(item, f"{inner}[{index}]", f"{label}.", labels)
        elif type(value) in SCALARS:
            yield f"{name}{field}", inner
        else:
            yield from _numbers(value, inner, name, labels)


def pad_lists(record: Any, kind: type) -> None:
    """Pad the lists of all records of a class in a record in place, because C has one length for all of them.

    ``kind``: class whose functions do not use the lengths of its lists.
    """
    found = [item for item in _records(record) if type(item) is kind]
    for name, _ in field_types(kind):
        lists = [value for item in found if isinstance(value := getattr(item, name), list)]
        longest = max(map(len, lists), default=0)
        for items in lists:
            items.extend(items[-1:] * (longest - len(items)))


def _records(record: Any) -> Iterator[Any]:
    """Yield a record and all records in it."""
    yield record
    for name, _ in field_types(type(record)):
        value = getattr(record, name)
        for item in value if isinstance(value, list) else [value]:
            if is_dataclass(item):
                yield from _records(item)


def write_fmu(
    unit: FmuUnit, variables: Sequence[FmuVariable], path: Path, files: Mapping[str, str], stop_time: float
) -> None:
    """Write an FMU with the sources, and the binary of this platform.

    Args:
        unit: Printed unit.
        variables: Its variables; a name that occurs again gets a number.
        path: Archive to write.
        files: Texts to add, by their paths in the archive.
        stop_time: End of the default experiment in [s].

    Raises:
        MissingToolError: If gcc is not installed.
        FirmwareError: If gcc rejects a source.
    """
    named, count = list[FmuVariable](), dict[str, int]()
    for reference, item in enumerate(variables):
        count[item.name] = count.get(item.name, 0) + 1
        again = f"_{count[item.name]}" if count[item.name] > 1 else ""
        named.append(item._replace(name=item.name + again, reference=reference))
    content = {
        "unit": unit,
        "variables": named,
        "guid": hashlib.sha256(repr((unit.program.source_hash, named)).encode()).hexdigest()[:32],
        "version": twin_gait.__version__,
        "convention": "structured" if all(_STRUCTURED.fullmatch(name) for name in count) else "flat",
        "units": {name: base_units(name) for name in sorted({item.unit for item in named} - {""})},
        "display_units": _DISPLAY_UNITS,
        "degrees": 180.0 / math.pi,
        "period": TICK,
        "stop_time": stop_time,
        **{f"{name}_type": type(record).__name__ for name, record in unit.records.items()},
    }
    folder, suffix = _PLATFORMS[platform.system()]
    texts = {name: _FILES.get_template(name).render(content) for name in _FILES.list_templates()}
    contents: dict[str, str | bytes] = {"modelDescription.xml": texts.pop("modelDescription.xml"), **files}
    with TemporaryDirectory() as build, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {**unit.program.files, **texts}.items():
            Path(build, name).write_text(text, encoding="utf-8")
            contents[f"sources/{name}"] = text
        binary = compile_library([Path(build, "fmu.c")], flags=["-fvisibility=hidden"], libraries=["-lm"])
        contents[f"binaries/{folder}/{unit.name}.{suffix}"] = binary.read_bytes()
        for name, data in contents.items():
            entry = zipfile.ZipInfo(name)  # without a date, so that equal units give equal archives
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, data)


def base_units(unit: str) -> dict[str, int]:
    """Return the exponents of the base units of a unit such as ``N.m.s/rad``."""
    powers: dict[str, int] = {}
    for place, part in enumerate(unit.split("/")):
        for name in part.split("."):
            for base, power in _BASE_UNITS[name].items():
                powers[base] = powers.get(base, 0) + (-power if place else power)
    return powers
