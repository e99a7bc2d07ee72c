"""Declaration of parameters: each parameter is declared once, as an annotated field of a frozen dataclass.

A field declares type, unit, range and default of a parameter; the docstring of its class states meaning and
source. Checks of values, the YAML of experiments and gait tables, their JSON Schema and the reference pages
are generated from these declarations.

>>> @dataclass(frozen=True, kw_only=True)
... class Spring(Parameters):
...     stiffness: Annotated[RotaryStiffness, NOT_NEGATIVE] = 75.0
"""

import dataclasses
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from numbers import Integral, Real
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin, get_type_hints

from twin_gait.docstrings import docstring_of
from twin_gait.parameters.ranges import FINITE as FINITE
from twin_gait.parameters.ranges import NON_NEGATIVE_OR_INFINITE as NON_NEGATIVE_OR_INFINITE
from twin_gait.parameters.ranges import NOT_NEGATIVE as NOT_NEGATIVE
from twin_gait.parameters.ranges import POSITIVE as POSITIVE
from twin_gait.parameters.ranges import SEEDS as SEEDS
from twin_gait.parameters.ranges import SHARE as SHARE
from twin_gait.parameters.ranges import Range as Range
from twin_gait.parameters.ranges import integer_range as integer_range
from twin_gait.parameters.ranges import require as require
from twin_gait.parameters.ranges import symmetric_range as symmetric_range

Record = TypeVar("Record")

DEGREE, KM_PER_H = math.pi / 180.0, 1.0 / 3.6  # Values in SI.

# Units at the end of keys, of all quantities that files may give in several units. Each ``QuantityUnits``
# adds its own.
EXCHANGEABLE: set[str] = set()


class QuantityUnits:
    """Units in which a file may give a quantity.

    Attributes:
        factors: SI value of one unit, by the suffix of the key; the SI unit is the first.
        plausible_range: Plausible range of the quantity, for the limits that a field does not set.
    """

    def __init__(self, si: str, most: float | None = None, reason: str = "", **others: float) -> None:
        """Store the SI unit, the largest plausible magnitude with its reason, and other units in SI."""
        self.factors: Mapping[str, float] = {si: 1.0, **others}
        self.plausible_range = None if most is None else symmetric_range(most, reason)
        EXCHANGEABLE.update(end for end in self.factors if others and end)


@dataclass(frozen=True)
class Key:
    """Name of a field in a file, without its unit, if it differs from the name of the field."""

    name: str


@dataclass(frozen=True)
class Notation:
    """A value that a file gives as text, for example ``encoder_freeze:left_knee@4.2s``."""

    read: Callable[[str], Any]  # Function that converts the text to the value; ``str`` converts it back.


@dataclass(frozen=True)
class AllowedKeys:
    """Restriction of the keys of a mapping to some names."""

    names: tuple[str, ...]


class AllEntries:
    """Mark of a mapping that a file gives as a whole: entries that it leaves out do not exist."""


class CommonValues:
    """Mark of a mapping whose entries are sections, and whose values a file may give for all entries at once.

    ``{torque_Nm: 60, current_A: 15, hip: {torque_Nm: 40}}``: the value of an entry replaces the common one.
    """


@dataclass(frozen=True)
class UnitInKeys:
    """A mapping with the unit at the end of each of its keys, ``{hip_deg: 18}``, not of the field's key."""


@dataclass(frozen=True)
class Inline:
    """A mapping whose keys are at the same level as the keys of the other fields."""


@dataclass(frozen=True)
class LiteralAlias:
    """Words that a file may contain instead of a section."""

    null_word: str  # Word that stands for None.
    kind: str  # Word that stands for the default parameters; a section may state it under ``kind``.


@dataclass(frozen=True)
class NamedSets:
    """Words that a file may contain instead of a section, each with the parameters for which it stands."""

    sets: Mapping[str, Any]


@dataclass(frozen=True)
class CustomSerialized:
    """A field with its own serialization, which the section of its class in files implements."""


# Quantities with their units in files, and the largest magnitude that is plausible for a device, a wearer and
# their surroundings, with the reason. A field may narrow the range.
Angle = Annotated[float, QuantityUnits("rad", math.pi, "half a turn", deg=DEGREE)]
Age = Annotated[float, QuantityUnits("years", 130.0, "the oldest people")]
AngularVelocity = Annotated[
    float, QuantityUnits("rad_per_s", 50.0, "ten times the no-load speed", deg_per_s=DEGREE)
]
Acceleration = Annotated[float, QuantityUnits("m_per_s2", 30.0, "three times gravity")]
AngularAcceleration = Annotated[float, QuantityUnits("rad_per_s2", 1e3, "100 N·m on a foot of 0.1 kg·m²")]
BitRate = Annotated[float, QuantityUnits("bit_per_s", 1e6, "the largest rate of CAN 2.0", kbit_per_s=1e3)]
Current = Annotated[float, QuantityUnits("A", 100.0, "above the stall current of the motors, 70 A at 24 V")]
Drift = Annotated[float, QuantityUnits("", 0.01, "100 times the drift of a poor oscillator", ppm=1e-6)]
Energy = Annotated[float, QuantityUnits("J", 1e7, "2.8 kWh, 15 kg of lithium cells")]
Force = Annotated[float, QuantityUnits("N", 5e3, "four times the weight of wearer and device")]
Frequency = Annotated[float, QuantityUnits("Hz", 1e5, "the fastest inverters of such drives")]
HertzStiffness = Annotated[float, QuantityUnits("N_per_m1p5", 1e7, "a heel compressed by 1 mm under 316 N")]
Inductance = Annotated[float, QuantityUnits("H", 0.1, "a hundred times the inductance of the motors")]
Inertia = Annotated[float, QuantityUnits("kgm2", 10.0, "a straight leg about its hip has 6")]
Length = Annotated[float, QuantityUnits("m", 3.0, "more than a person with raised arms")]
LinearDamping = Annotated[float, QuantityUnits("Ns_per_m", 9e4, "critical damping of 200 kg on 1e7 N/m")]
LinearDissipation = Annotated[float, QuantityUnits("s_per_m", 100.0, "a force that doubles at 1 cm/s")]
LinearStiffness = Annotated[float, QuantityUnits("N_per_m", 1e7, "a deflection of 0.1 mm under 1000 N")]
Mass = Annotated[float, QuantityUnits("kg", 200.0, "the heaviest wearer with device and load")]
PerAngle = Annotated[float, QuantityUnits("per_rad", 100.0, "the whole effect within 0.6 deg")]
PerAngularVelocity = Annotated[float, QuantityUnits("s_per_rad", 1e3, "the whole effect within 1 mrad/s")]
Power = Annotated[float, QuantityUnits("W", 5e3, "ten times the power of the battery")]
Ratio = Annotated[float, QuantityUnits("", 1e3, "three orders of magnitude")]
Resistance = Annotated[float, QuantityUnits("Ohm", 100.0, "0.3 A at the voltage of the battery")]
# Damping coefficient of a rotation.
RotaryDamping = Annotated[
    float,
    QuantityUnits(
        "Nms_per_rad", 1e4, "ten times critical damping on the gear's spring", Nms_per_deg=1.0 / DEGREE
    ),
]
RotaryDissipation = Annotated[float, QuantityUnits("s_per_rad", 100.0, "a torque that doubles at 10 mrad/s")]
RotaryStiffness = Annotated[
    float, QuantityUnits("Nm_per_rad", 1e6, "a deflection of 0.1 mrad under 100 N·m", Nm_per_deg=1.0 / DEGREE)
]
Speed = Annotated[float, QuantityUnits("m_per_s", 10.0, "faster than people run", km_per_h=KM_PER_H)]
Time = Annotated[float, QuantityUnits("s", 3600.0, "the longest run", ms=1e-3)]
ShortTime = Annotated[float, QuantityUnits("s", 0.1, "the longest cycle of the bus", ms=1e-3, us=1e-6)]
Torque = Annotated[float, QuantityUnits("Nm", 1e3, "ten times the limit of the gear")]
TorqueConstant = Annotated[
    float, QuantityUnits("Nm_per_A", 10.0, "a hundred times the constant of the motors")
]
Voltage = Annotated[float, QuantityUnits("V", 120.0, "the limit of extra-low voltage, IEC 61140")]


@dataclass(frozen=True, eq=False)
class Declaration:
    """Declaration of one parameter."""

    name: str  # Name of the field.
    kind: Any  # Type of the field without ``None``.
    optional: bool  # Whether the value may be None.
    default: Any  # Default value; ``dataclasses.MISSING`` without one.
    unit: QuantityUnits | None  # Units; None if it is not a physical quantity.
    range: Range | None  # Range; None if it is not a number.
    key: str  # Name in a file, without the unit.
    meaning: str  # Meaning from the docstring of the class, in one line.
    annotations: tuple[Any, ...]  # All annotations of the field.

    @property
    def keys(self) -> Mapping[str, float]:
        """Keys in a file, each with the SI value of its unit."""
        in_key = (
            self.unit is not None
            and not self.find_annotation(UnitInKeys)
            and not self.find_annotation(Inline)
        )
        factors = self.unit.factors if self.unit is not None and in_key else {"": 1.0}
        return {f"{self.key}_{end}" if end else self.key: factor for end, factor in factors.items()}

    def find_annotation(self, kind: type[Any]) -> Any:
        """Return the first annotation of a type, or None."""
        return next((item for item in self.annotations if isinstance(item, kind)), None)

    def coerce(self, value: Any) -> Any:
        """Convert a value to the type of the field; raise ParameterError if it is invalid.

        Words become members of enumerations, numbers of NumPy become numbers of Python.
        """
        return value if value is None and self.optional else coerce(self.kind, self.name, value, self.range)


class Parameters:
    """Base of frozen dataclasses of parameters; values are checked against their declarations on creation."""

    kind: ClassVar[str] = ""  # Name in a file if a section has several kinds.
    tag: ClassVar[str] = "kind"  # Key of this name in a file.

    def __post_init__(self) -> None:
        """Convert every value according to its declaration."""
        for item in declarations(type(self)):
            value = getattr(self, item.name)
            # A value of the exact type within its range needs no conversion.
            if type(value) is not item.kind or (item.range is not None and not item.range.contains(value)):
                object.__setattr__(self, item.name, item.coerce(value))


def coerce(kind: Any, name: str, value: Any, bounds: Range | None = None) -> Any:
    """Convert a value to a type and check its range; raise ParameterError if it does not fit."""
    if type(value) is kind and bounds is None:
        return value
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if is_mapping(kind):
        require(isinstance(value, Mapping), name, "a mapping", value)
        of_key, of_item = get_args(kind)
        inside = f"{name} " if " of the " in name else f"{name} of the "
        return {
            coerce(of_key, name, key): coerce(of_item, f"{inside}{key}", item, bounds)
            for key, item in value.items()
        }
    if get_origin(kind) is tuple:
        require(isinstance(value, tuple | list), name, "a tuple", value)
        kinds = get_args(kind)
        each = kinds[:1] * len(value) if Ellipsis in kinds else kinds
        require(len(value) == len(each), name, f"a tuple of {len(each)}", value)
        return tuple(coerce(one, name, item, bounds) for one, item in zip(each, value, strict=True))
    if isinstance(kind, type) and issubclass(kind, Enum):
        require(value in list(kind), name, f"one of {', '.join(map(str, kind))}", value)
        return kind(value)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        require(isinstance(value, kind), name, f"an instance of {kind.__name__}", value)
    if not isinstance(value, bool) and isinstance(value, Real):
        value = int(value) if isinstance(value, Integral) else float(value)
    if bounds is not None:
        bounds.require(name, value, whole=kind is int)
    return value


def declarations(parameters: type[Any]) -> tuple[Declaration, ...]:
    """Return the declarations of the fields of a dataclass, in their order."""
    if parameters not in _declared:
        hints, meanings = get_type_hints(parameters, include_extras=True), _meanings(parameters)
        _declared[parameters] = tuple(
            _declaration(item, hints[item.name], meanings.get(item.name, ""))
            for item in dataclasses.fields(parameters)
        )
    return _declared[parameters]


_declared: dict[type[Any], tuple[Declaration, ...]] = {}


def _declaration(item: dataclasses.Field[Any], hint: Any, meaning: str) -> Declaration:
    kind, marks, optional = hint, [], False
    while get_origin(kind) is Annotated or type(None) in get_args(kind):
        if get_origin(kind) is Annotated:
            kind, *more = get_args(kind)
            marks += more
        else:
            optional = True
            kind = Union[tuple(one for one in get_args(kind) if one is not type(None))]  # noqa: UP007
    numbers = kind
    while get_origin(numbers) is Annotated or is_mapping(numbers) or _is_list_of_quantities(numbers):
        marks += get_args(numbers)[1:] if get_origin(numbers) is Annotated else ()
        numbers = get_args(numbers)[-1 if is_mapping(numbers) else 0]
    unit = next((mark for mark in marks if isinstance(mark, QuantityUnits)), None)
    bounds = next((mark for mark in marks if isinstance(mark, Range)), None)
    if bounds is None and numbers in (float, int):
        bounds = FINITE
    if bounds is not None and unit is not None and unit.plausible_range is not None:
        bounds = bounds.fill_limits(unit.plausible_range)
    key = next((mark.name for mark in marks if isinstance(mark, Key)), item.name)
    default = item.default if item.default_factory is dataclasses.MISSING else item.default_factory()
    return Declaration(item.name, kind, optional, default, unit, bounds, key, meaning, tuple(marks))


def _is_list_of_quantities(kind: Any) -> bool:
    return get_origin(kind) is tuple and get_origin(get_args(kind)[0]) is Annotated


def is_mapping(kind: Any) -> bool:
    """Check whether a type is a mapping."""
    return isinstance(get_origin(kind), type) and issubclass(get_origin(kind), Mapping)


_ENTRY = re.compile(r"^    (\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)  # An entry with its continuation lines.
_ROLE = re.compile(r":\w+:`~?([^`]+)`")


def _meanings(parameters: Any) -> dict[str, str]:
    """Return the meaning of each field from the section ``Attributes`` of the docstrings.

    The docstrings are those of a class and its bases.
    """
    found: dict[str, str] = {}
    for kind in reversed(parameters.__mro__):
        section = docstring_of(kind).partition("Attributes:\n")[2]
        found |= {name: re.sub(r"\n +", " ", text) for name, text in _ENTRY.findall(section)}
    return {name: _ROLE.sub(r"`\1`", text) for name, text in found.items()}


def from_attributes(kind: type[Record], source: Any, **more: Any) -> Record:
    """Create a record from the attributes of another object that have the names of its fields.

    ``more``: values of other fields; they take precedence. A field that is in neither has its default.
    """
    found = {name: getattr(source, name) for name in field_names(kind) if hasattr(source, name)}
    return kind(**(found | more))


def field_names(kind: Any) -> tuple[str, ...]:
    """Return the names of the fields of a dataclass."""
    if kind not in _names:
        _names[kind] = tuple(item.name for item in dataclasses.fields(kind))
    return _names[kind]


_names: dict[Any, tuple[str, ...]] = {}
