"""How a parameter is declared: once, as an annotated field of a frozen dataclass.

A field says its type, its unit, its range and its default; the docstring of its class says what it means and
where it comes from. Checks of values, the YAML of experiments and gait tables, their JSON Schema and the
reference pages are made from that.

>>> @dataclass(frozen=True, kw_only=True)
... class Spring(Parameters):
...     stiffness: Annotated[RotaryStiffness, NOT_NEGATIVE] = 75.0
"""

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from numbers import Integral, Real
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin, get_type_hints

from twin_gait.exceptions import ParameterError

Record = TypeVar("Record")

DEGREE, KM_PER_H = math.pi / 180.0, 1.0 / 3.6  # in SI

EXCHANGEABLE: set[str] = set()  # ends of keys that stand for one quantity in several units


def require(condition: bool, name: str, expected: str, value: object) -> None:
    """Raise a :class:`ParameterError` unless a condition holds.

    ``condition``: what must be true. ``name``: name of the parameter as the user knows it. ``expected``: what
    would have been right, in words. ``value``: what was given. Raises ParameterError if the condition is
    false.
    """
    if not condition:
        raise ParameterError(f"{name}: expected {expected}, got {value!r}")


class Unit:
    """Units in which a file may give a quantity.

    Attributes:
        factors: SI value of one unit, by the end of the key; the unit of SI first.
    """

    def __init__(self, si: str, **others: float) -> None:
        """Take the unit of SI and what others are in it."""
        self.factors: Mapping[str, float] = {si: 1.0, **others}
        EXCHANGEABLE.update(end for end in self.factors if others and end)


@dataclass(frozen=True)
class Range:
    """Range of a number."""

    least: float = -math.inf  # Least value.
    most: float = math.inf  # Largest value.
    above: bool = False  # Whether the least value itself is outside.
    words: str = ""  # What is expected, for messages; made from the numbers where empty.
    endless: bool = False  # Whether infinity is meant, too: a time that never comes, ``null`` in a file.

    def holds(self, value: float) -> bool:
        """Whether a value lies within."""
        inside = self.least < value <= self.most if self.above else self.least <= value <= self.most
        return inside and (self.endless or math.isfinite(value))

    def in_unit(self, factor: float) -> "Range":
        """The range in a unit, given by its value in SI; words, which say it in SI, stay there."""
        words = self.words if factor == 1.0 else ""
        return dataclasses.replace(self, least=self.least / factor, most=self.most / factor, words=words)

    def require(self, name: str, value: float, *, whole: bool = False) -> None:
        """Raise a :class:`ParameterError` unless a value, or a whole number, lies within."""
        fits = isinstance(value, int if whole else Real)
        require(fits and self.holds(value), name, self.expected, value)

    @property
    def expected(self) -> str:
        """What is expected, in words."""
        if self.words:
            return self.words
        if math.isfinite(self.most):
            return f"a number from {self.least:g} to {self.most:g}"
        if math.isinf(self.least):
            return "a finite number"
        return f"a number above {self.least:g}" if self.above else f"a number of {self.least:g} or more"


POSITIVE, NOT_NEGATIVE, SHARE = Range(0.0, above=True), Range(0.0), Range(0.0, 1.0)
FINITE, COUNT = Range(), Range(1, words="a whole number above 0")
WHOLE = Range(0, words="a whole number of 0 or more")
LATER = Range(0.0, endless=True)


@dataclass(frozen=True)
class Key:
    """Name of a field in a file, without its unit, where that is another."""

    name: str


@dataclass(frozen=True)
class Notation:
    """A value that a file writes as a text, for example ``encoder_freeze:left_knee@4.2s``."""

    read: Callable[[str], Any]  # From the text to the value, whose ``str`` is the text.


@dataclass(frozen=True)
class Named:
    """Names that the keys of a mapping may have."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class UnitInside:
    """A mapping whose unit stands behind each of its keys, ``{hip_deg: 18}``, instead of its own."""


@dataclass(frozen=True)
class Inline:
    """A mapping whose names stand beside the keys of the other fields."""


@dataclass(frozen=True)
class Word:
    """What a file may say by a word instead of a section."""

    without: str  # Word for None.
    kind: str  # Word for the parameters, which a section may have under ``kind``.


@dataclass(frozen=True)
class AsInFile:
    """A field of which a file says more than its type: its section has a reader of its own."""


# Quantities by what they measure. A file may give them in any of the units.
Angle = Annotated[float, Unit("rad", deg=DEGREE)]
AngularVelocity = Annotated[float, Unit("rad_per_s", deg_per_s=DEGREE)]
Acceleration = Annotated[float, Unit("m_per_s2")]
AngularAcceleration = Annotated[float, Unit("rad_per_s2")]
BitRate = Annotated[float, Unit("bit_per_s", kbit_per_s=1e3)]
Current = Annotated[float, Unit("A")]
Drift = Annotated[float, Unit("", ppm=1e-6)]
Energy = Annotated[float, Unit("J")]
Force = Annotated[float, Unit("N")]
Frequency = Annotated[float, Unit("Hz")]
HertzStiffness = Annotated[float, Unit("N_per_m1p5")]
Inertia = Annotated[float, Unit("kgm2")]
Length = Annotated[float, Unit("m")]
LinearDamping = Annotated[float, Unit("Ns_per_m")]
LinearDissipation = Annotated[float, Unit("s_per_m")]
LinearStiffness = Annotated[float, Unit("N_per_m")]
Mass = Annotated[float, Unit("kg")]
PerAngle = Annotated[float, Unit("per_rad")]
PerAngularVelocity = Annotated[float, Unit("s_per_rad")]
Power = Annotated[float, Unit("W")]
Ratio = Annotated[float, Unit("")]
Resistance = Annotated[float, Unit("Ohm")]
RotaryDamping = Annotated[float, Unit("Nms_per_rad", Nms_per_deg=1.0 / DEGREE)]
RotaryDissipation = Annotated[float, Unit("s_per_rad")]
RotaryStiffness = Annotated[float, Unit("Nm_per_rad", Nm_per_deg=1.0 / DEGREE)]
Speed = Annotated[float, Unit("m_per_s", km_per_h=KM_PER_H)]
Time = Annotated[float, Unit("s", ms=1e-3)]
ShortTime = Annotated[float, Unit("s", ms=1e-3, us=1e-6)]
Torque = Annotated[float, Unit("Nm")]
TorqueConstant = Annotated[float, Unit("Nm_per_A")]
Voltage = Annotated[float, Unit("V")]


@dataclass(frozen=True, eq=False)
class Declaration:
    """What is said of a parameter."""

    name: str  # Of the field.
    kind: Any  # Its type without ``None``.
    optional: bool  # Whether it may be None.
    default: Any  # Its default; ``dataclasses.MISSING`` without one.
    unit: Unit | None  # Its units, None for what is no quantity.
    range: Range | None  # Its range, None for what is no number.
    key: str  # Its name in a file, without the unit.
    meaning: str  # From the docstring of its class, in one line.
    marks: tuple[Any, ...]  # What else is said of it.

    @property
    def keys(self) -> Mapping[str, float]:
        """Keys in a file, with their unit in SI."""
        own = self.unit is not None and not self.mark(UnitInside) and not self.mark(Inline)
        factors = self.unit.factors if self.unit is not None and own else {"": 1.0}
        return {f"{self.key}_{end}" if end else self.key: factor for end, factor in factors.items()}

    def mark(self, kind: type[Any]) -> Any:
        """A mark of a kind, or None."""
        return next((item for item in self.marks if isinstance(item, kind)), None)

    def taken(self, value: Any) -> Any:
        """A value as the field has it, or a :class:`~twin_gait.exceptions.ParameterError`.

        Words become members of enumerations, numbers of NumPy those of Python.
        """
        return value if value is None and self.optional else of_kind(self.kind, self.name, value, self.range)


class Parameters:
    """Base of frozen dataclasses of parameters: what their fields declare is checked when one is made."""

    kind: ClassVar[str] = ""  # what a file calls it where there are several kinds
    tag: ClassVar[str] = "kind"  # the key under which the kind is named

    def __post_init__(self) -> None:
        """Take every value as its declaration has it."""
        for item in declarations(type(self)):
            object.__setattr__(self, item.name, item.taken(getattr(self, item.name)))


def of_kind(kind: Any, name: str, value: Any, bounds: Range | None = None) -> Any:
    """A value as a parameter of some type and range has it; ParameterError for what does not fit."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if is_mapping(kind):
        require(isinstance(value, Mapping), name, "a mapping", value)
        of_key, of_item = get_args(kind)
        inside = f"{name} " if " of the " in name else f"{name} of the "
        return {
            of_kind(of_key, name, key): of_kind(of_item, f"{inside}{key}", item, bounds)
            for key, item in value.items()
        }
    if get_origin(kind) is tuple:
        require(isinstance(value, tuple | list), name, "a tuple", value)
        kinds = get_args(kind)
        each = kinds[:1] * len(value) if Ellipsis in kinds else kinds
        require(len(value) == len(each), name, f"a tuple of {len(each)}", value)
        return tuple(of_kind(one, name, item, bounds) for one, item in zip(each, value, strict=True))
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
    """What a dataclass declares of its fields, in their order."""
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
    while get_origin(numbers) is Annotated or is_mapping(numbers):
        marks += get_args(numbers)[1:] if get_origin(numbers) is Annotated else ()
        numbers = get_args(numbers)[0 if get_origin(numbers) is Annotated else -1]
    unit = next((mark for mark in marks if isinstance(mark, Unit)), None)
    bounds = next((mark for mark in marks if isinstance(mark, Range)), None)
    if bounds is None and numbers in (float, int):
        bounds = FINITE
    key = next((mark.name for mark in marks if isinstance(mark, Key)), item.name)
    default = item.default if item.default_factory is dataclasses.MISSING else item.default_factory()
    return Declaration(item.name, kind, optional, default, unit, bounds, key, meaning, tuple(marks))


def is_mapping(kind: Any) -> bool:
    """Whether a type is one of mappings."""
    return isinstance(get_origin(kind), type) and issubclass(get_origin(kind), Mapping)


_ENTRY = re.compile(r"^    (\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)  # and the lines that go on with it
_ROLE = re.compile(r":\w+:`~?([^`]+)`")


def _meanings(parameters: Any) -> dict[str, str]:
    """Meaning of each field: the section ``Attributes`` of the docstrings of a class and its bases."""
    found: dict[str, str] = {}
    for kind in reversed(parameters.__mro__):
        section = inspect.cleandoc(kind.__doc__ or "").partition("Attributes:\n")[2]
        found |= {name: re.sub(r"\n +", " ", text) for name, text in _ENTRY.findall(section)}
    return {name: _ROLE.sub(r"`\1`", text) for name, text in found.items()}


def taken_from(kind: type[Record], source: Any, **more: Any) -> Record:
    """A record whose fields are the attributes of the same name of something else, or among ``more``.

    A field that has a default keeps it where neither says more.
    """
    names = {item.name for item in dataclasses.fields(kind)} - set(more)  # type: ignore[arg-type]
    return kind(**{name: getattr(source, name) for name in names if hasattr(source, name)}, **more)
