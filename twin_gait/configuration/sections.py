"""Sections of a file, generated from the declarations of frozen parameters, for reading and writing.

Keys contain units: a quantity may be given as ``amplitude_deg`` or ``amplitude_rad``. A key that is left out,
or null, keeps its default; a section or mapping is merged with its default.
"""

import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING
from functools import partial, reduce
from operator import or_
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from pydantic import AfterValidator, Field, WrapValidator, create_model, model_validator

from twin_gait.configuration.validation import Count, Flag, Number, Strict, merge
from twin_gait.docstrings import summary_of
from twin_gait.exceptions import MissingParameterError
from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import Declaration, LiteralAlias, Parameters, declarations, is_mapping
from twin_gait.vocabulary import JointName

_PLAIN = {float: Number, int: Count}


class Section(Strict):
    """Section whose keys are the declared fields of a frozen dataclass with their units.

    Subclasses are created by :func:`section_of`; validated values of their fields are in SI. A field marked
    with :class:`~twin_gait.parameters.quantities.CustomSerialized` is read and written by the class that is
    registered with :func:`register_section`.
    """

    parameters: ClassVar[type[Any]]
    defaults: ClassVar[Mapping[str, Any]] = {}  # values with which sections and mappings inside are merged
    inline: ClassVar[Mapping[str, Callable[[Any], Any]]] = {}  # readers of fields marked ``Inline``
    # names of the fields by their keys, without CustomSerialized fields
    keys: ClassVar[Mapping[str, str]] = {}
    required: ClassVar[Mapping[str, str]] = {}  # keys of the fields without a default by their names

    @model_validator(mode="before")
    @classmethod
    def _over_defaults(cls, data: Any) -> Any:
        if not isinstance(data, (dict, Mapping)):
            return data
        given = {key: data[key] for key in cls.defaults if isinstance(data.get(key), (dict, Mapping))}
        return {**data, **{key: merge(cls.defaults[key], value, key) for key, value in given.items()}}

    def values(self) -> dict[str, Any]:
        """Return the fields that are given, in SI."""
        found = {name: read(self) for name, read in self.inline.items()}
        for key in self.model_fields_set:
            if key in self.keys and (value := getattr(self, key)) is not MISSING:
                found[self.keys[key]] = value
        return found

    def convert(self) -> Any:
        """Convert the section to its parameters in SI."""
        values = self.values()
        for name, key in self.required.items():
            if name not in values:
                raise MissingParameterError(key)
        return self.parameters(**values)

    @classmethod
    def document(cls, parameters: Any) -> dict[str, Any]:
        """Convert parameters to the mapping of a file, in SI; reading it gives the same."""
        found: dict[str, Any] = {cls.parameters.tag: cls.parameters.kind} if cls.parameters.kind else {}
        for item in declarations(cls.parameters):
            value, word = getattr(parameters, item.name), item.find_annotation(LiteralAlias)
            if item.find_annotation(quantities.Inline):
                found |= to_yaml(value, item)
            elif word:
                section = {"kind": word.kind, **to_yaml(value, item)} if value is not None else word.null_word
                found[item.key] = section
            elif value is not None and not item.find_annotation(quantities.CustomSerialized):
                found[next(iter(item.keys))] = to_yaml(value, item)
        return found


def known_sections(data: Mapping[str, Any], previous: Mapping[str, Any], parameters: Any) -> dict[str, Any]:
    """Return the sections of a mapping that are identical objects in another one, in their converted form.

    ``previous``: the other mapping; ``parameters``: the parameters that it was converted to, or such values
    by name. A section that differs is in the result too, with the converted values of its own identical
    sections.
    """
    values = parameters
    if isinstance(parameters, Parameters):
        if data.get(parameters.tag) != previous.get(parameters.tag):
            return {}  # another kind has other sections
        named = ((item.key, item.name) for item in declarations(type(parameters)))
        values = {key: getattr(parameters, name) for key, name in named}
    found: dict[str, Any] = {}
    for key, section in data.items():
        value, other = values.get(key), previous.get(key)
        if isinstance(value, Parameters) and section is other:
            found[key] = value
        elif isinstance(value, (Parameters, dict)) and isinstance(section, dict) and isinstance(other, dict):
            if isinstance(value, dict) and _common_values(section) != _common_values(other):
                continue  # every entry of the mapping has changed
            found[key] = {**section, **known_sections(section, other, value)}
    return found


def _common_values(section: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a mapping of sections that are no sections."""
    return {key: value for key, value in section.items() if not isinstance(value, Mapping)}


def to_yaml(value: Any, item: Declaration | None = None) -> Any:
    """Convert a value to its form in YAML, in SI; ``item``: its field, which may put units in inner keys."""
    if isinstance(value, Parameters):
        return section_of(type(value)).document(value)
    if isinstance(value, Mapping):
        if item is not None and _is_common_to_all(value, item):
            return to_yaml(next(iter(value.values())))
        found = {}
        unit = item.unit if item is not None and item.find_annotation(quantities.UnitInKeys) else None
        for name, inner in value.items():
            end = f"_{next(iter(unit.factors))}" if unit and not isinstance(inner, Mapping) else ""
            found[f"{name}{end}"] = to_yaml(inner, item)
        return found
    if isinstance(value, tuple):
        return [to_yaml(one) for one in value]
    if isinstance(value, float) and math.isinf(value):
        return None  # YAML has no number for a time that never comes
    return value if value is None or type(value) in (bool, int, float) else str(value)


def _is_common_to_all(value: Mapping[Any, Any], item: Declaration) -> bool:
    """Check whether a file can give the entries of a mapping at once: there are all, and they are equal."""
    if item.find_annotation(quantities.CommonValues) is None:
        return False
    entries = list(value.values())
    return list(value) == list(get_args(item.kind)[0]) and all(entry == entries[0] for entry in entries)


def type_of(parameters: type[Any]) -> Any:
    """Return the type of a section that is validated as its parameters, and accepts these as they are."""

    def read(value: Any, section: Callable[[Any], Section]) -> Any:
        return value if isinstance(value, parameters) else section(value).convert()

    return Annotated[section_of(parameters), WrapValidator(read)]


def _one_of(kinds: tuple[type[Any], ...]) -> Any:
    """Return the type of a section of one of several kinds with a tag; the first is the default."""
    tag, first = kinds[0].tag, kinds[0].kind

    def with_tag(value: Any) -> Any:
        return {tag: first, **value} if isinstance(value, Mapping) else value

    def read(value: Any, section: Callable[[Any], Section]) -> Any:
        return value if isinstance(value, kinds) else section(with_tag(value)).convert()

    return Annotated[reduce(or_, map(section_of, kinds)), Field(discriminator=tag), WrapValidator(read)]


def _section_or_literal(parameters: type[Any], word: LiteralAlias) -> Any:
    """Return the type of a section, or of a word for its presence or absence (its ``kind``)."""
    words: Any = Literal[word.null_word, word.kind]
    model: Any = create_model(parameters.__name__, __base__=section_of(parameters), kind=(words, word.kind))

    def read(value: Any, section: Callable[[Any], Any]) -> Any:
        if isinstance(value, parameters):
            return value
        found = section({"kind": value} if isinstance(value, str) else value)
        if found.kind == word.kind:
            return found.convert()
        if found.model_fields_set > {"kind"}:
            remedy = f"leave them out, or set kind to {word.kind}"
            raise ValueError(f"{word.null_word} has no parameters; {remedy}")
        return None

    return Annotated[model | words, WrapValidator(read)]


def _section_or_name(parameters: type[Any], sets: Mapping[str, Any]) -> Any:
    """Return the type of a section, or of a word that stands for one of several sets of parameters."""
    words: Any = Literal[tuple(sets)]

    def read(value: Any, either: Callable[[Any], Any]) -> Any:
        if not isinstance(value, str):
            return either(value)
        if value not in sets:
            raise ValueError(f"expected {' or '.join(sets)}, or keys and values, got {value!r}")
        return sets[value]

    return Annotated[type_of(parameters) | words, WrapValidator(read)]


def _number(item: Declaration, kind: type[Any], factor: float) -> Any:
    """Return the type of a number in a unit, validated in SI."""
    return Annotated[_PLAIN[kind], AfterValidator(partial(to_si, item, factor))]


def to_si(item: Declaration, factor: float, value: Any) -> Any:
    """Convert a number in a unit to SI; raise ValueError if it is out of range."""
    found = value if factor == 1.0 else factor * value
    if item.range is not None and not item.range.contains(found):
        names = item.unit.factors.items() if item.unit and factor != 1.0 else ()
        unit = "".join(f" {end.replace('_per_', '/')}" for end, size in names if size == factor)
        raise ValueError(f"expected {item.range.convert_unit(factor).expected}, got {value:g}{unit}")
    return found


def _mapping_fields(
    item: Declaration, kind: Any, factor: float
) -> tuple[dict[str, Any], Callable[[Any], Any]]:
    """Return the fields of a mapping, each with its own unit if the mapping has none, and their reader."""
    names, inner = get_args(kind)
    named = item.find_annotation(quantities.AllowedKeys)
    inside = item.unit is not None and item.find_annotation(quantities.UnitInKeys) and not is_mapping(inner)
    ends = item.unit.factors if item.unit is not None and inside else {"": factor}
    keys = {
        f"{name}_{end}" if end else str(name): (name, unit)
        for name in (named.names if named else names)
        for end, unit in ends.items()
    }
    fields = {key: (_nullable(_type(item, inner, unit)), None) for key, (_, unit) in keys.items()}
    whole = kind is not item.kind or item.find_annotation(quantities.AllEntries)
    beneath = item.default if not whole and isinstance(item.default, Mapping) else {}

    def read(section: Any) -> dict[Any, Any]:
        given = {keys[key][0]: getattr(section, key) for key in keys if key in section.model_fields_set}
        return {**beneath, **{name: value for name, value in given.items() if value is not MISSING}}

    return fields, read


def _optional(about: Any) -> Any:
    """Return the description of a key for a JSON Schema, with null as its default."""
    return Field(None, description=about.description, json_schema_extra=about.json_schema_extra)


class _WithCommonValues(Strict):
    """Mapping of sections that accepts values for all of them.

    See :class:`~twin_gait.parameters.quantities.CommonValues`. An entry that is not named exists if the
    common values alone are complete.
    """

    section: ClassVar[Any]  # section of an entry

    @model_validator(mode="before")
    @classmethod
    def _spread(cls, data: Any) -> Any:
        if not isinstance(data, (dict, Mapping)):
            return data
        names = [name for name in JointName if name in cls.model_fields]
        common = {key: value for key, value in data.items() if key in cls.section.keys and value is not None}
        if not common:
            return data
        complete = {cls.section.keys[key] for key in common} >= set(cls.section.required)
        spread: dict[str, Any] = {name: {} for name in names} if complete else {}
        spread |= {key: value for key, value in data.items() if key not in common and value is not None}
        return {
            name: merge(common, value, name) if isinstance(value, Mapping) and name in names else value
            for name, value in spread.items()
        }


def _type(item: Declaration, kind: Any, factor: float) -> Any:
    """Return the type of a value in a file, validated as the value in SI."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) is tuple:
        if item.unit is not None:
            number = _type(item, get_args(kind)[0], factor)
            return tuple[tuple(one if one is ... else number for one in get_args(kind))]  # type: ignore[misc]
        notation = item.find_annotation(quantities.Notation)
        text: Any = Annotated[str, AfterValidator(notation.read)] if notation else str
        return tuple[text, ...]
    if get_origin(kind) in (Union, types.UnionType):
        return _one_of(get_args(kind))
    if is_mapping(kind):
        fields, read = _mapping_fields(item, kind, factor)
        base: type[Strict] = Strict
        if item.find_annotation(quantities.CommonValues):
            base, inner = _WithCommonValues, declarations(get_args(kind)[1])
            common = {key: _field(one, size) for one in inner for key, size in one.keys.items()}
            fields = {
                key: (_nullable(of_key), _optional(about)) for key, (of_key, about) in common.items()
            } | fields
        model: Any = create_model(f"{item.name}_by_name", __base__=base, **fields)
        if base is _WithCommonValues:
            model.section = section_of(get_args(kind)[1])
        return Annotated[model, AfterValidator(read)]
    if isinstance(kind, type) and issubclass(kind, Parameters):
        word = item.find_annotation(LiteralAlias)
        named = item.find_annotation(quantities.NamedSets)
        if named:
            return _section_or_name(kind, named.sets)
        return _section_or_literal(kind, word) if word else type_of(kind)
    if kind is bool:
        return Flag
    return _number(item, kind, factor) if kind in _PLAIN else kind


def _nullable(kind: Any, null: Any = MISSING) -> Any:
    """Return a type that accepts null as another value, for keys that are usually left out."""
    return Annotated[
        Union[kind, None],  # noqa: UP007
        WrapValidator(lambda value, read: null if value is None else read(value)),
    ]


def register_section(parameters: type[Any]) -> Any:
    """Register a class as the base of the section of some parameters, for keys other than declared fields."""

    def register(section: type[Section]) -> type[Section]:
        _base_sections[parameters] = section
        return section

    return register


_base_sections: dict[type[Any], type[Section]] = {}
_sections: dict[type[Any], Any] = {}


def section_of(parameters: type[Any]) -> Any:
    """Return the section of a dataclass of parameters."""
    if parameters not in _sections:
        _sections[parameters] = _section(parameters)
    return _sections[parameters]


def _section(parameters: type[Any]) -> Any:
    """Create the section of a dataclass of parameters."""
    base = next((_base_sections[kind] for kind in parameters.__mro__ if kind in _base_sections), Section)
    fields: dict[str, Any] = {}
    if parameters.kind:
        fields[parameters.tag] = (Literal[parameters.kind], parameters.kind)
    defaults, inline = {}, {}
    for item in declarations(parameters):
        if item.find_annotation(quantities.CustomSerialized) or item.key in base.model_fields:
            continue
        if item.find_annotation(quantities.Inline):
            more, inline[item.name] = _mapping_fields(item, item.kind, 1.0)
            fields |= more
        else:
            fields |= {key: _field(item, factor) for key, factor in item.keys.items()}
            if (
                isinstance(item.default, (Mapping, Parameters))
                and item.default
                and not item.find_annotation(LiteralAlias)
                and not item.find_annotation(quantities.AllEntries)
            ):
                defaults[next(iter(item.keys))] = _default_document(item)
    model: Any = create_model(parameters.__name__, __base__=base, **fields)
    model.parameters, model.defaults, model.inline = parameters, defaults, inline
    declared = [
        item for item in declarations(parameters) if not item.find_annotation(quantities.CustomSerialized)
    ]
    model.keys = {key: item.name for item in declared for key in item.keys}
    without = [item for item in declarations(parameters) if item.default is MISSING]
    model.required = {item.name: next(iter(item.keys)) for item in without}
    model.__doc__ = summary_of(parameters)
    return model


def _default_document(item: Declaration) -> Any:
    """Return the default of a field in the form of YAML, without mappings that a file gives as a whole."""
    document = to_yaml(item.default, item)
    if isinstance(item.default, Parameters):
        for inner in declarations(type(item.default)):
            if inner.find_annotation(quantities.AllEntries):
                del document[inner.key]
    return document


def _field(item: Declaration, factor: float) -> tuple[Any, Any]:
    """Return the type of a key, with its default and its description in a JSON Schema."""
    kind = _type(item, item.kind, factor)
    limits: dict[str, Any] = {}
    if item.range is not None and item.kind in _PLAIN:
        limits = _limits(item.range.convert_unit(factor))
    about: dict[str, Any] = {"description": item.meaning or None, "json_schema_extra": limits or None}
    if item.default is MISSING and not item.optional and len(item.keys) == 1:
        return kind, Field(**about)
    endless = item.range is not None and item.range.allows_infinity
    return _nullable(kind, math.inf if endless else MISSING), Field(None, **about)


def _limits(bounds: quantities.Range) -> dict[str, Any]:
    """Express a range in the keywords of JSON Schema."""
    ends = {
        "exclusiveMinimum" if bounds.exclusive_minimum else "minimum": bounds.minimum,
        "maximum": bounds.maximum,
    }
    return {name: rounded(end) for name, end in ends.items() if math.isfinite(end)}


def rounded(value: float) -> float:
    """Round a number so that a conversion of its unit leaves no trace in its last digits."""
    return float(f"{value:.12g}")
