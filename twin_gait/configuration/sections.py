"""Sections of a file, made from the declarations of frozen parameters: keys with units, both ways.

A quantity may be given in one of its units, ``amplitude_deg`` or ``amplitude_rad``. A key that is left out,
or null, keeps what is underneath: the default of the parameters that the section is a part of.
"""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, replace
from enum import StrEnum
from functools import reduce
from operator import or_
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, create_model

from twin_gait.configuration.validation import Count, Number, Strict
from twin_gait.exceptions import ParameterError
from twin_gait.parameters.quantities import (
    AsInFile,
    Declaration,
    Named,
    Notation,
    Parameters,
    UnitInside,
    declarations,
)

_WORDS = {"gt": "exclusiveMinimum", "ge": "minimum", "le": "maximum"}  # of a JSON Schema
_PLAIN = {float: Number, int: Count, bool: bool, str: str}
# A time that never comes is no number of YAML: null stands for it.
_ENDLESS = AfterValidator(lambda value: math.inf if value is None else value)


class Section(Strict):
    """A section whose keys are the declared fields of a frozen dataclass with their units.

    Subclasses are made by :func:`section_of`; a field that is :class:`AsInFile` is read and written by the
    class that :data:`READERS` has for its dataclass.
    """

    parameters: ClassVar[type[Any]]
    bounded: ClassVar[bool] = False  # whether values out of range are refused at the key, before all others

    def given(self, keys: Mapping[str, float]) -> tuple[str, Any] | None:
        """The one of the keys of a quantity that is given, with its value; None if none is."""
        found = [key for key in keys if key in self.model_fields_set and getattr(self, key) is not None]
        if len(found) > 1:
            raise ParameterError(f"expected exactly one of {' or '.join(keys)}, got {found}")
        return (found[0], getattr(self, found[0])) if found else None

    def values(self, default: Any = None) -> dict[str, Any]:
        """Fields that are given, in SI.

        Args:
            default: Parameters underneath, parts of which may stay as they are.
        """
        found = {}
        for item in declarations(self.parameters):
            given = None if item.mark(AsInFile) else self.given(item.keys)
            if given is not None:
                key, value = given
                beneath = item.default if default is None else getattr(default, item.name)
                found[item.name] = _converted(item, key, value, None if beneath is MISSING else beneath)
        return found

    def convert(self, default: Any = None) -> Any:
        """The parameters in SI.

        Args:
            default: Parameters underneath, if there are any.
        """
        if default is not None and type(default) is self.parameters:
            return replace(default, **self.values(default))
        values = self.values()
        for item in declarations(self.parameters):
            if item.default is MISSING and item.name not in values:
                raise ParameterError(f"{next(iter(item.keys))}: is missing")
        return self.parameters(**values)

    @classmethod
    def document(cls, parameters: Any) -> dict[str, Any]:
        """Parameters as the mapping of a file, in SI; reading it gives the same."""
        tag = () if cls.parameters.implied or not cls.parameters.kind else (cls.parameters.tag,)
        found: dict[str, Any] = dict.fromkeys(tag, cls.parameters.kind)
        for item in declarations(cls.parameters):
            value = getattr(parameters, item.name)
            if not item.mark(AsInFile) and (value is not None or not item.optional):
                found[next(iter(item.keys))] = _plain(item, value)
        return found


# Sections with keys beside those of the declared fields.
READERS: dict[type[Any], type[Section]] = {}


def reads(parameters: type[Any]) -> Any:
    """Make a class the base of the section of some parameters."""

    def register(section: type[Section]) -> type[Section]:
        READERS[parameters] = section
        return section

    return register


def section_of(parameters: type[Any]) -> type[Section]:
    """The section of a dataclass of parameters."""
    if parameters not in _known:
        base = next((READERS[kind] for kind in parameters.__mro__ if kind in READERS), Section)
        keys: dict[str, Any] = {}
        if parameters.kind:
            keys[parameters.tag] = (Literal[parameters.kind], parameters.kind)  # type: ignore[name-defined]
        groups = []
        for item in declarations(parameters):
            if not item.mark(AsInFile):
                keys |= {key: _field(item, factor, base.bounded) for key, factor in item.keys.items()}
                groups += [list(item.keys)] if len(item.keys) > 1 else []
        model = create_model(parameters.__name__, __base__=base, __module__=__name__, **keys)
        model.parameters = parameters
        model.__doc__ = (parameters.__doc__ or "").splitlines()[0]
        model.model_config = ConfigDict(**Strict.model_config, json_schema_extra=one_unit_each(groups))
        model.model_rebuild(force=True)
        _known[parameters] = model
    return _known[parameters]


_known: dict[type[Any], type[Section]] = {}


def one_unit_each(groups: list[list[str]]) -> Any:
    """For a JSON Schema: of the keys of a quantity in several units one at most."""
    pairs = [[first, second] for keys in groups for n, first in enumerate(keys) for second in keys[n + 1 :]]
    return {"allOf": [{"not": {"required": pair}} for pair in pairs]} if pairs else {}


def _field(item: Declaration, factor: float, bounded: bool) -> tuple[Any, Any]:
    """Type of a key, with its default and what a JSON Schema says of it."""
    single = len(item.keys) == 1 and item.default is not MISSING and item.kind in _PLAIN
    endless = item.range is not None and item.range.endless
    kind = _annotation(item, item.kind)
    if not single or item.default is None or endless:
        kind = kind | None if isinstance(kind, type) else Union[kind, None]  # noqa: UP007
    if endless:
        kind = Annotated[kind, _ENDLESS]
    extra: dict[str, Any] = {}
    bounds = item.range
    default = item.default if single else None
    if item.default is MISSING and item.unit is None and not item.optional:
        default = ...
    if bounds is not None and item.kind in (int, float):
        if math.isfinite(bounds.least):
            extra["gt" if bounds.above else "ge"] = bounds.least / factor
        if math.isfinite(bounds.most):
            extra["le"] = bounds.most / factor
    if bounded:
        return kind, Field(default, description=item.meaning or None, **extra)
    said = {_WORDS[name]: value for name, value in extra.items()}
    return kind, Field(default, description=item.meaning or None, json_schema_extra=said or None)


def _annotation(item: Declaration, kind: Any) -> Any:
    """What pydantic checks a value against."""
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in (Union, types.UnionType):
        return one_of_kinds(get_args(kind))
    if get_origin(kind) is tuple:
        return tuple[str, ...]
    if isinstance(get_origin(kind), type) and issubclass(get_origin(kind), Mapping):
        names, inner = get_args(kind)
        marked = item.mark(Named)
        known = marked.names if marked else tuple(str(name) for name in names)
        fields: dict[str, Any] = {}
        ends = item.unit.factors if item.mark(UnitInside) and item.unit else {"": 1.0}
        for name in known:
            for end in ends:
                fields[f"{name}_{end}" if end else name] = (Union[_annotation(item, inner), None], None)  # noqa: UP007
        groups = [[f"{name}_{end}" for end in ends] for name in known] if len(ends) > 1 else []
        model = create_model(f"{item.name.title()}Mapping", __base__=Strict, __module__=__name__, **fields)
        model.model_config = ConfigDict(**Strict.model_config, json_schema_extra=one_unit_each(groups))
        return model
    if isinstance(kind, type) and dataclasses.is_dataclass(kind) and issubclass(kind, Parameters):
        return section_of(kind)
    return _PLAIN.get(kind, kind)


def one_of_kinds(kinds: tuple[type[Any], ...]) -> Any:
    """One of several sections, told apart by their tag; where the first is implied, it need not be named."""
    tag, first = kinds[0].tag, kinds[0]

    def with_tag(value: Any) -> Any:
        return {tag: first.kind, **value} if isinstance(value, Mapping) and first.implied else value

    return Annotated[
        reduce(or_, (section_of(kind) for kind in kinds)), Field(discriminator=tag), BeforeValidator(with_tag)
    ]


def _converted(item: Declaration, key: str, value: Any, beneath: Any) -> Any:
    """A value of a file in SI."""
    unit = item.keys.get(key, 1.0)
    try:
        if isinstance(value, Section):
            return value.convert(beneath)
        if notation := item.mark(Notation):
            return tuple(_noted(notation, index, text) for index, text in enumerate(value))
    except ParameterError as error:
        place = str(error) if str(error).startswith("[") else f".{error}"
        raise ParameterError(f"{key}{place}") from error
    if isinstance(value, Strict):
        return {**(beneath or {}), **_by_name(item, key, value, unit, beneath or {})}
    return value if unit == 1.0 or isinstance(value, (bool, str)) else value * unit


def _noted(notation: Notation, index: int, text: str) -> Any:
    try:
        return notation.read(text)
    except ParameterError as error:
        raise ParameterError(f"[{index}]: {error}") from error


def _by_name(
    item: Declaration, key: str, given: Strict, unit: float, beneath: Mapping[Any, Any]
) -> dict[Any, Any]:
    """What a mapping has for each name, in SI."""
    names, _ = get_args(item.kind)
    found = {}
    for written in given.model_fields_set:
        value, name, factor = getattr(given, written), written, unit
        if value is None or (item.mark(Named) and value == 0.0):
            continue
        if item.mark(UnitInside) and item.unit:
            name, factor = next(
                (written.removesuffix(f"_{end}"), own)
                for end, own in item.unit.factors.items()
                if written.endswith(f"_{end}")
            )
        place = names(name) if issubclass(names, StrEnum) else name
        try:
            found[place] = (
                value.convert(beneath.get(place))
                if isinstance(value, Section)
                else (value if factor == 1.0 else factor * value)
            )
        except ParameterError as error:
            raise ParameterError(f"{key}.{name}.{error}") from error
    return {name: found[name] for name in (*beneath, *found) if name in found} if beneath else found


def _plain(item: Declaration, value: Any) -> Any:
    """A value as YAML holds it."""
    if isinstance(value, Parameters):
        return section_of(type(value)).document(value)
    if isinstance(value, Mapping):
        end = f"_{next(iter(item.unit.factors))}" if item.mark(UnitInside) and item.unit else ""
        return {f"{name}{end}": _plain(item, inner) for name, inner in value.items()}
    if isinstance(value, tuple):
        return [str(inner) if item.mark(Notation) else inner for inner in value]
    if isinstance(value, str):
        return str(value)
    return None if isinstance(value, float) and math.isinf(value) else value
