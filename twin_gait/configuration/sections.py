"""Sections of a file, made from the declarations of frozen parameters: keys with units, both ways.

A quantity may be given in one of its units, ``amplitude_deg`` or ``amplitude_rad``. A key that is left out,
or null, keeps what is underneath: the default of the parameters that the section is a part of.
"""

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, replace
from functools import cache, partial, reduce
from operator import or_
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, create_model

from twin_gait.configuration.validation import Count, Number, Strict
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import quantities

_PLAIN = {float: Number, int: Count}
# Null in a file.
_ENDLESS = AfterValidator(lambda value: math.inf if value is None else value)


class Section(Strict):
    """A section whose keys are the declared fields of a frozen dataclass with their units.

    Subclasses are made by :func:`section_of`; a field that is :class:`AsInFile` is read and written by the
    class that is registered with :func:`reads`.
    """

    parameters: ClassVar[type[Any]]

    def value_of(self, item: quantities.Declaration, beneath: Any, *, named: bool = True) -> Any:
        """Value of a declared field in SI over what is ``beneath``; ``MISSING`` where none is given.

        ``named``: whether its key stands in front of what is wrong inside it.
        """
        if item.mark(quantities.AsInFile):
            return MISSING
        form, keys = form_of(item), item.keys
        if item.mark(quantities.Inline):
            given: Any = {key: getattr(self, key) for key in form.keys if key in self.model_fields_set}
            return form.read_keys(given, beneath)
        found = [key for key in keys if key in self.model_fields_set and getattr(self, key) is not None]
        if len(found) > 1:
            raise ParameterError(f"expected exactly one of {' or '.join(keys)}, got {found}")
        if not found:
            return MISSING
        key = found[0] if named else ""
        return within(key, form.read, getattr(self, found[0]), keys[found[0]], beneath)

    def values(self, default: Any = None) -> dict[str, Any]:
        """Fields that are given, in SI; parts of ``default`` beneath may stay as they are."""
        found = {}
        for item in quantities.declarations(self.parameters):
            beneath = item.default if default is None else getattr(default, item.name)
            found[item.name] = self.value_of(item, None if beneath is MISSING else beneath)
        return {name: value for name, value in found.items() if value is not MISSING}

    def convert(self, default: Any = None) -> Any:
        """The parameters in SI, over those underneath, if there are any."""
        if default is not None and type(default) is self.parameters:
            return replace(default, **self.values(default))
        values = self.values()
        for item in quantities.declarations(self.parameters):
            if item.default is MISSING and item.name not in values:
                raise ParameterError(f"{next(iter(item.keys))}: is missing")
        return self.parameters(**values)

    @classmethod
    def document(cls, parameters: Any) -> dict[str, Any]:
        """Parameters as the mapping of a file, in SI; reading it gives the same."""
        named = cls.parameters.kind and not cls.parameters.implied
        found: dict[str, Any] = {cls.parameters.tag: cls.parameters.kind} if named else {}
        for item in quantities.declarations(cls.parameters):
            value = getattr(parameters, item.name)
            if item.mark(quantities.Inline):
                found |= form_of(item).write(value)
            elif not item.mark(quantities.AsInFile) and (value is not None or item.mark(quantities.Word)):
                found[next(iter(item.keys))] = form_of(item).write(value)
        return found


def within(key: str, read: Any, *arguments: Any) -> Any:
    """What a function gives; in front of what it complains about stands a key."""
    try:
        return read(*arguments)
    except ParameterError as error:
        joint = "" if not key or str(error).startswith("[") else "."
        raise ParameterError(f"{key}{joint}{error}") from error


class Form:
    """How a number, a word or a truth value stands in a file."""

    def __init__(self, kind: Any) -> None:
        """Take what pydantic checks a value against."""
        self.kind = kind

    def read(self, value: Any, factor: float, beneath: Any) -> Any:
        """A checked value in SI, by the ``factor`` of its key's unit, over what is ``beneath``."""
        return value if factor == 1.0 else factor * value

    def write(self, value: Any) -> Any:
        """A value as YAML holds it, in SI."""
        if isinstance(value, float) and math.isinf(value):
            return None  # a time that never comes is no number of YAML
        return str(value) if isinstance(value, str) else value


class ListForm(Form):
    """A list of texts, each the notation of a value or the value itself."""

    def __init__(self, notation: quantities.Notation | None) -> None:
        """Take the notation, if there is one."""
        super().__init__(tuple[str, ...])
        self._notation = notation

    def read(self, value: Any, factor: float, beneath: Any) -> Any:
        """The values."""
        if self._notation is None:
            return value
        return tuple(_noted(self._notation, number, text) for number, text in enumerate(value))

    def write(self, value: Any) -> Any:
        """The texts."""
        return [str(item) for item in value]


def _noted(notation: quantities.Notation, number: int, text: str) -> Any:
    try:
        return notation.read(text)
    except ParameterError as error:
        raise ParameterError(f"[{number}]: {error}") from error


class SectionForm(Form):
    """A section of one of some kinds, told apart by their tag; the first may be implied."""

    def __init__(self, kinds: tuple[type[Any], ...]) -> None:
        """Take the classes of the parameters."""
        tag, first = kinds[0].tag, kinds[0]

        def with_tag(value: Any) -> Any:
            return {tag: first.kind, **value} if isinstance(value, Mapping) and first.implied else value

        sections = [section_of(kind) for kind in kinds]
        several = Annotated[reduce(or_, sections), Field(discriminator=tag), BeforeValidator(with_tag)]  # type: ignore[valid-type]
        super().__init__(several if len(kinds) > 1 else sections[0])

    def read(self, value: Any, factor: float, beneath: Any) -> Any:
        """The parameters."""
        return value.convert(beneath)

    def write(self, value: Any) -> Any:
        """The section."""
        return section_of(type(value)).document(value)


class WordForm(SectionForm):
    """A section, or a word for it or for its absence; ``kind`` has that word inside the section."""

    def __init__(self, parameters: type[Any], word: quantities.Word) -> None:
        """Take the class of the parameters and the words."""
        choices: Any = Literal[word.without, word.kind]
        self._word = word
        model: Any = create_model(parameters.__name__, __base__=section_of(parameters), kind=(choices, ...))
        model.parameters, self._standard = parameters, parameters()

        def as_mapping(value: Any) -> Any:
            if isinstance(value, str):
                return {"kind": value}
            if not isinstance(value, Mapping):
                kinds = f"{word.without}, {word.kind}"
                raise ValueError(f"expected {kinds} or a mapping with a kind, got {value!r}")
            return {"kind": word.kind, **value} if word.implied else value

        def alone(section: Any) -> Any:
            given = sorted(section.model_fields_set - {"kind"})
            if section.kind == word.without and given:
                raise ValueError(
                    f"{word.without} has no {given[0]}: set kind to {word.kind}, or it all to {word.without}"
                )
            return section

        self.kind = Annotated[model, BeforeValidator(as_mapping), AfterValidator(alone)]

    def read(self, value: Any, factor: float, beneath: Any) -> Any:
        """The parameters, or None."""
        return None if value.kind == self._word.without else value.convert(self._standard)

    def write(self, value: Any) -> Any:
        """The section."""
        if value is None:
            return {"kind": self._word.without}
        return {"kind": self._word.kind, **super().write(value)}


class MappingForm(Form):
    """A value by name, each with a unit of its own if the mapping has none."""

    def __init__(self, item: quantities.Declaration, kind: Any) -> None:
        """Take the declaration, and the mapping itself or one inside it."""
        names, inner = get_args(kind)
        named = item.mark(quantities.Named)
        self._names = dict.fromkeys(named.names) if named else {str(name): name for name in names}
        self.inner = _form(item, inner)
        ends = item.unit.factors if item.unit and item.mark(quantities.UnitInside) else {"": 1.0}
        ends = {"": 1.0} if isinstance(self.inner, MappingForm) else ends
        self.keys = {
            f"{name}_{end}" if end else name: (name, factor)
            for name in self._names
            for end, factor in ends.items()
        }
        self._sparse = named is not None  # what is zero is not kept
        fields: dict[str, Any] = {key: (Union[self.inner.kind, None], None) for key in self.keys}  # noqa: UP007
        groups = [[f"{name}_{end}" for end in ends] for name in self._names if len(ends) > 1]
        model = create_model(f"{item.name}_by_name", __base__=Strict, **fields)
        super().__init__(_with_schema(model, groups))

    def read(self, value: Any, factor: float, beneath: Any) -> Any:
        """What is given by name, laid over what is beneath."""
        given = {key: getattr(value, key) for key in self.keys if key in value.model_fields_set}
        return self.read_keys(given, beneath, factor)

    def read_keys(self, given: Mapping[str, Any], beneath: Any, factor: float = 1.0) -> Any:
        """As :meth:`read`, of what stands under the keys."""
        found = {}
        for key, value in given.items():
            name, own = self.keys[key]
            place = self._names[name] or name
            if place in found:
                raise ParameterError(f"expected {name} in one unit, got two")
            if value is not None and not (self._sparse and value == 0.0):
                under = (beneath or {}).get(place)
                found[place] = within(name, self.inner.read, value, factor * own, under)
        both = {**(beneath or {}), **found}
        return {place: both[place] for place in (*self._places, *both) if place in both}

    @property
    def _places(self) -> list[Any]:
        return [place or name for name, place in self._names.items()]

    def write(self, value: Any) -> Any:
        """The mapping in SI."""
        first = {name: key for key, (name, factor) in self.keys.items() if factor == 1.0}
        return {first[str(name)]: self.inner.write(item) for name, item in value.items()}


@cache
def form_of(item: quantities.Declaration) -> Any:
    """How the values of a field stand in a file."""
    return _form(item, item.kind)


def _form(item: quantities.Declaration, kind: Any) -> Form:
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    origin = get_origin(kind)
    if origin is tuple:
        return ListForm(item.mark(quantities.Notation))
    if origin in (Union, types.UnionType):
        return SectionForm(get_args(kind))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return MappingForm(item, kind)
    if isinstance(kind, type) and issubclass(kind, quantities.Parameters):
        word = item.mark(quantities.Word)
        return WordForm(kind, word) if word else SectionForm((kind,))
    return Form(_PLAIN.get(kind, kind))


def reads(parameters: type[Any]) -> Any:
    """Make a class the base of the section of some parameters, for keys beside those of declared fields."""

    def register(section: type[Section]) -> type[Section]:
        _readers[parameters] = section
        return section

    return register


_readers: dict[type[Any], type[Section]] = {}
_known: dict[type[Any], type[Section]] = {}


def section_of(parameters: type[Any]) -> Any:
    """The section of a dataclass of parameters."""
    if parameters not in _known:
        base = next((_readers[kind] for kind in parameters.__mro__ if kind in _readers), Section)
        fields: dict[str, Any] = {}
        if parameters.kind:
            fields[parameters.tag] = (Literal[parameters.kind], parameters.kind)
        groups = []
        for item in quantities.declarations(parameters):
            if item.mark(quantities.Inline):
                fields |= {key: (Union[form_of(item).inner.kind, None], None) for key in form_of(item).keys}  # noqa: UP007
            elif not item.mark(quantities.AsInFile):
                fields |= {key: _field(item, key, factor) for key, factor in item.keys.items()}
                groups += [list(item.keys)] if len(item.keys) > 1 else []
        model = create_model(parameters.__name__, __base__=base, **fields)
        model.parameters = parameters
        model.__doc__ = (parameters.__doc__ or "").splitlines()[0]
        _known[parameters] = _with_schema(model, groups)
    return _known[parameters]


def _with_schema(model: Any, groups: list[list[str]]) -> Any:
    """A model whose JSON Schema says that of the keys of a quantity in several units one at most is given."""
    pairs = [[first, second] for keys in groups for n, first in enumerate(keys) for second in keys[n + 1 :]]
    said: Any = {"allOf": [{"not": {"required": pair}} for pair in pairs]} if pairs else {}
    model.model_config = ConfigDict(**{**Strict.model_config, "json_schema_extra": said})
    model.model_rebuild(force=True)
    return model


def _field(item: quantities.Declaration, key: str, factor: float) -> tuple[Any, Any]:
    """Type of a key, with its range, its default and what a JSON Schema says of it."""
    plain = not isinstance(item.default, (Mapping, quantities.Parameters, tuple)) and len(item.keys) == 1
    default = item.default if plain and item.default is not MISSING else None
    kind = form_of(item).kind
    said: dict[str, Any] = {}
    if item.range is not None and item.kind in (int, float):
        unit = key.removeprefix(item.key).replace("_", " ", 1) if factor != 1.0 else ""
        kind = Annotated[kind, AfterValidator(partial(_in_range, item.range, factor, unit))]
        if math.isfinite(item.range.least):
            limit = "exclusiveMinimum" if item.range.above else "minimum"
            said[limit] = _rounded(item.range.least / factor)
        if math.isfinite(item.range.most):
            said["maximum"] = _rounded(item.range.most / factor)
    if item.range is not None and item.range.endless:
        kind = Annotated[Union[kind, None], _ENDLESS]  # noqa: UP007
    elif default is None and not (item.unit is None and item.default is MISSING and not item.optional):
        kind = Union[kind, None]  # noqa: UP007
    else:
        default = default if item.default is not MISSING else ...
    if isinstance(item.default, float) and math.isfinite(item.default):
        said["default"] = _rounded(item.default / factor)
    return kind, Field(default, description=item.meaning or None, json_schema_extra=said or None)


def _in_range(limits: quantities.Range, factor: float, unit: str, value: float) -> float:
    """A value of a key, in range by the ``factor`` of its unit."""
    if not limits.holds(factor * value):
        scaled = replace(limits, least=limits.least / factor, most=limits.most / factor)
        raise ValueError(f"expected {scaled.expected}, got {value:g}{unit}")
    return value


def _rounded(value: float) -> float:
    """A number without what a change of its unit adds to its last digits."""
    return float(f"{value:.12g}")
