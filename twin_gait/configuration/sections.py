"""Sections of a file that hold frozen parameters: each field under its own name with a unit behind it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator

from twin_gait.configuration.validation import DEGREE, Number, Strict, models_in, one_of
from twin_gait.exceptions import ParameterError
from twin_gait.vocabulary import JointName

# Units that are not SI, over SI, by the end of a key; the first that fits counts.
_UNITS = {
    "_km_per_h": 1.0 / 3.6,
    "_deg_per_s": DEGREE,
    "_Nm_per_deg": 1.0 / DEGREE,
    "_Nms_per_deg": 1.0 / DEGREE,
    "_deg": DEGREE,
    "_ms": 1e-3,
    "_us": 1e-6,
    "_kbit_per_s": 1e3,
    "_ppm": 1e-6,
}
# A time that never comes is no number of YAML: null stands for it.
Endless = Annotated[Number | None, AfterValidator(lambda value: math.inf if value is None else value)]


class Section(Strict):
    """A section whose keys are the fields of a frozen dataclass with their units.

    A quantity may be given in one of several units, ``amplitude_deg`` or ``amplitude_rad``. A key that is
    left out or null takes the default of the dataclass; keys that belong to no field are those of the
    section alone.
    """

    parameters: ClassVar[type[Any]]
    # Field of a key that does not begin with its name; None for a key of the section alone.
    renamed: ClassVar[Mapping[str, str | None]] = {}

    @classmethod
    def keys(cls) -> dict[str, dict[str, float]]:
        """Keys of each field, with one unit of each in SI."""
        fields = [field.name for field in dataclasses.fields(cls.parameters)]
        found: dict[str, dict[str, float]] = {}
        for key in cls.model_fields:
            names = [name for name in fields if key == name or key.startswith(f"{name}_")]
            name = cls.renamed.get(key, max(names, key=len, default=None))
            if name is not None:
                unit = next((factor for end, factor in _UNITS.items() if key.endswith(end)), 1.0)
                found.setdefault(name, {})[key] = unit
        return found

    def values(self) -> dict[str, Any]:
        """Fields that are given, in SI."""
        found = {}
        for name, keys in self.keys().items():
            given = [key for key in keys if getattr(self, key) is not None]
            if len(given) > 1:
                one_of(self, keys)
            for key in given:
                value = getattr(self, key)
                found[name] = _in_si(value.convert() if hasattr(value, "convert") else value, keys[key])
        return found

    def convert(self) -> Any:
        """The parameters in SI."""
        return self.parameters(**self.values())

    @classmethod
    def document(cls, parameters: Any) -> dict[str, Any]:
        """Parameters as the mapping of a file, in SI; reading it gives the same."""
        return {
            key: _plain(getattr(parameters, name), cls.model_fields[key].annotation)
            for name, keys in cls.keys().items()
            for key, factor in keys.items()
            if factor == 1.0
        }


class PerJoint(Strict):
    """Something for each joint; a powered ankle has it, too."""

    hip: Any
    knee: Any
    ankle: Any = None

    def convert(self) -> dict[JointName, Any]:
        """By joint, in SI."""
        return {joint: self._of(joint) for joint in JointName if getattr(self, joint) is not None}

    def _of(self, joint: JointName) -> Any:
        item = getattr(self, joint)
        try:
            return item.convert() if hasattr(item, "convert") else item
        except ParameterError as error:
            raise ParameterError(f"{joint}.{error}") from error

    @classmethod
    def document(cls, items: Mapping[JointName, Any]) -> dict[str, Any]:
        """As the mapping of a file."""
        return {str(joint): _plain(item, cls.model_fields[joint].annotation) for joint, item in items.items()}


class JointNumbers(PerJoint):
    """A number for each joint."""

    hip: Number
    knee: Number
    ankle: Number | None = None


def _in_si(value: Any, unit: float) -> Any:
    if unit == 1.0:
        return value
    return {key: unit * item for key, item in value.items()} if isinstance(value, Mapping) else value * unit


def _plain(value: Any, annotation: Any) -> Any:
    """A value as YAML holds it."""
    sections = [item for item in models_in(annotation) if hasattr(item, "document")]
    if sections and value is not None:
        same = [item for item in sections if getattr(item, "parameters", None) is type(value)]
        return (same or sections)[0].document(value)
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, str):
        return str(value)
    return None if isinstance(value, float) and math.isinf(value) else value
