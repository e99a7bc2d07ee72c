"""People: the wearer as YAML, inside an experiment, in a file of its own, or by the name of a preset.

What holds for both sides stands under ``both``; ``left`` and ``right`` are laid over it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, create_model

from twin_gait.configuration.overrides import merge
from twin_gait.configuration.readers import section_of
from twin_gait.configuration.validation import converting, descriptions, packaged, read_yaml, validate
from twin_gait.exceptions import ParameterError
from twin_gait.parameters import Patient

_HEADER = ("schema_version", "name", "description")
_Person = create_model(
    "Person",
    __base__=section_of(Patient),
    schema_version=(Literal[1], 1),
    name=(str, Field("", max_length=80)),
    description=(str, ""),
)
_Person.parameters = Patient


def people() -> dict[str, str]:
    """Names of the people that ship with their one-line descriptions."""
    return descriptions(packaged("people"))


def person_text(name: str) -> str:
    """File of a person that ships, with its sources, ready to be edited."""
    return packaged("people")[name].read_text(encoding="utf-8")


def names_a_person(value: Any) -> bool:
    """Whether a ``patient`` of a file names a person instead of stating everything itself."""
    return isinstance(value, str) or (isinstance(value, Mapping) and "preset" in value)


def person_document(value: str | Mapping[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """Look a named person up, as the ``patient`` of an experiment file.

    ``value``: name of a person that ships, path of a file, or a mapping with such a name under ``preset`` and
    changes beside it. ``folder``: folder that a relative path starts from; the working folder comes next.
    Raises ParameterError if there is no such person. Raises ParameterFileError if the file has a mistake.
    """
    name = value if isinstance(value, str) else value["preset"]
    changes = {} if isinstance(value, str) else {key: item for key, item in value.items() if key != "preset"}
    path = _find(name, folder)
    data = read_yaml(path)
    converting(str(path), "", validate(_Person, data, str(path)).convert)
    return merge({key: item for key, item in data.items() if key not in _HEADER}, changes)


def _find(name: Any, folder: Path) -> Path:
    if isinstance(name, str) and name:
        beside = (path for path in (folder / name, Path(name).expanduser()) if path.is_file())
        found = packaged("people").get(name) or next(beside, None)
        if found is not None:
            return found
    raise ParameterError(f"no person {name!r}: neither a file nor one of {', '.join(people())}")
