"""Safe reading of YAML, merging of mappings and parsing of ``--set key=value``.

The message of every error is one line, which states file, key, value and remedy.
"""

import copy
import difflib
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from twin_gait import yaml12
from twin_gait.exceptions import (
    MissingKeyError,
    MissingParameterError,
    ParameterError,
    ParameterFileError,
    TwinGaitError,
)
from twin_gait.files import read_text
from twin_gait.parameters.quantities import EXCHANGEABLE, Parameters
from twin_gait.vocabulary import JointName, Side

# "friction_ratio" is a name and not "friction" in another unit; only damping has a ratio as unit.
_NO_UNIT = frozenset({"friction_ratio"})
_JOINTS = frozenset(JointName)


def quantity_of(key: str) -> str:
    """Return a key without its unit: ``damping`` for ``damping_ratio`` and ``damping_Nms_per_rad``.

    The longest matching unit is removed. Worlds of other packages may declare more units at any time.
    """
    if key.rpartition(".")[2] in _NO_UNIT:
        return key
    index = key.find("_")
    while index >= 0:
        if key[index + 1 :] == "ratio" or key[index + 1 :] in EXCHANGEABLE:
            return key[:index]
        index = key.find("_", index + 1)
    return key


def reject_duplicate_units(keys: Iterable[Any], prefix: str = "") -> None:
    """Raise ParameterError if the keys of a mapping give one quantity in two units, which is ambiguous.

    ``prefix``: key of the mapping, for the message.
    """
    keys_by_quantity: dict[str, str] = {}
    for key in keys:
        other = keys_by_quantity.setdefault(quantity_of(str(key)), key)
        if other != key:
            problem = f"{prefix}: expected exactly one of {other} or {key}, got both; leave one out"
            raise ParameterError(problem.removeprefix(": "))


def merge(base: Mapping[str, Any], changes: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a mapping merged with changes; a quantity that is given in another unit replaces the old one.

    Neither mapping is modified. Values that do not change are the same objects in the result. If the friction
    law of a joint changes, its whole section is replaced, because another law has other keys. A number beside
    the sections of joints is for all of them, and replaces theirs.

    ``prefix``: key of the mapping, for messages. Raises ParameterError if the changes give one quantity in
    two units.
    """
    reject_duplicate_units(changes, prefix)
    merged = _without_replaced(base, changes)
    # Most changes are of existing keys, whose quantities are not needed.
    same = {} if changes.keys() <= base.keys() else {quantity_of(name): name for name in base}
    for key, value in changes.items():
        if key not in merged:
            merged.pop(same.get(quantity_of(key), key), None)
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping) and not _another_law(key, old, value):
            merged[key] = merge(old, value, f"{prefix}.{key}".removeprefix("."))
        else:
            merged[key] = value if isinstance(value, Parameters) else copy.deepcopy(value)
    return merged


def _without_replaced(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping without the numbers of its joints that changes give for all joints at once."""
    found = dict(base)
    for joint in _JOINTS & base.keys():
        if isinstance(base[joint], Mapping):
            given = {quantity_of(key) for key, value in changes.items() if not isinstance(value, Mapping)}
            kept = {key: value for key, value in base[joint].items() if quantity_of(key) not in given}
            if len(kept) < len(base[joint]):
                found = {key: value for key, value in found.items() if key != joint or kept}
                found |= {joint: kept} if kept else {}
    return found


def _another_law(key: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    return key in _JOINTS and "law" in new and new["law"] != old.get("law")


_DIGITS = 9  # largest number of digits of a list position; no list is longer
_STEP = re.compile(r"([A-Za-z_]\w*)|\[(\d+)\]")
_NAME = r"[A-Za-z_]\w*(?:\[\d+\])*"
_PATH = re.compile(rf"\s*{_NAME}(?:\.{_NAME})*\s*")


def parse_assignment(text: str) -> tuple[list[str | int], Any]:
    """Split ``patient.mass_kg=80`` into a path and a value; raise ParameterError if it cannot be read."""
    key, separator, value = text.partition("=")
    path = parse_path(key if separator else "", text)
    try:
        return path, _loaded(value)
    except ParameterError as error:
        raise ParameterError(f"--set {short(text)}: {error}") from error


def parse_path(key: str, text: str) -> list[str | int]:
    """Split ``table.transitions[3].after_s`` into names and positions; an error quotes ``text``."""
    if not _PATH.fullmatch(key):
        expected = "expected key=value with a key of names joined by dots, for example patient.mass_kg=80"
        raise ParameterError(f"--set {text!r}: {expected}")
    return [int(number[:_DIGITS]) if number else name for name, number in _STEP.findall(key)]


def parse_assignments(texts: Sequence[str]) -> list[tuple[list[str | int], Any]]:
    """Split the assignments of one command line; of two assignments to one key, the last one counts.

    Raises ParameterFileError if two assignments give one quantity in two units.
    """
    assignments = [parse_assignment(text) for text in texts]
    convert_with_context(
        "--set", "", lambda: reject_duplicate_units(_dotted(path) for path, _ in assignments)
    )
    return assignments


def assign(container: Any, path: Sequence[str | int], value: Any, depth: int = 0) -> Any:
    """Return a mapping in which the value at a path is replaced.

    ``container``: the mapping, or the value inside it at some ``depth`` of the path. Containers on the path
    are copied; all others are shared and not modified. Raises ParameterError if there is no such path.
    """
    step, ends = path[depth], depth == len(path) - 1
    if isinstance(step, str) and isinstance(container, dict):
        if ends:
            return merge(container, {step: value})
        inner = container.get(step)
        inner = inner if isinstance(inner, (dict, list)) else {}
        return {**container, step: assign(inner, path, value, depth + 1)}
    if isinstance(container, list) and isinstance(step, int) and step < len(container):
        changed = list(container)
        changed[step] = value if ends else assign(container[step], path, value, depth + 1)
        return changed
    kind = "a mapping, whose values have names" if isinstance(container, dict) else "a single value"
    if isinstance(container, list):
        kind = f"a list with positions [0] to [{len(container) - 1}]" if container else "an empty list"
    parent = _dotted(path[:depth]) or "the experiment"
    raise ParameterError(f"--set {_dotted(path[: depth + 1])}: there is no such key; {parent} is {kind}")


MAXIMUM_FILE_SIZE = 1_000_000  # [bytes]; a gait table has a few thousand bytes

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict = 2, 3, 3
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 57


class Strict(BaseModel):
    """Base class of all file schemas: an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        """Reject unknown keys with a suggestion, before missing keys are reported."""
        if not isinstance(data, (dict, Mapping)):
            return data
        quantities = _quantities(cls)
        for name in data:
            if name not in quantities:
                known = [info.alias or name for name, info in cls.model_fields.items()]
                side, _, joint = str(name).partition("_")
                if cls.__name__.endswith("_by_name") and side in list(Side) and joint in known:
                    problem = (
                        f"unknown key; the same joints have drives in all legs of a device: use {joint}, and "
                        "leg.driven_sides for the legs"
                    )
                    raise PydanticCustomError("unknown_key", "{problem}", {"problem": problem, "key": name})
                near = " or ".join(repr(str(key)) for key in _nearest(str(name), known, cls))
                hint = f"did you mean {near}? " if near else ""
                problem = f"unknown key; {hint}allowed: {', '.join(known)}"
                raise PydanticCustomError("unknown_key", "{problem}", {"problem": problem, "key": name})
        if len({quantities[name] for name in data}) < len(data):
            reject_duplicate_units(data)
        return data


@cache
def _quantities(model: type[Strict]) -> dict[str, str]:
    """Return the quantities of the keys of a section, see :func:`quantity_of`."""
    keys = (name for item in model.model_fields.items() for name in (item[0], item[1].alias or item[0]))
    return {key: quantity_of(key) for key in keys}


def _require_number(value: Any) -> Any:
    """Return a number; reject text, even where Python could convert it."""
    if isinstance(value, bool):
        raise ValueError(f"expected a number, got {str(value).lower()}")
    if isinstance(value, str):
        hint = "; write 1000, 0.5 and 90 for 1_000, 0,5 and 1:30" if value[:1].isdigit() else ""
        raise ValueError(f"expected a number, got {short(value)}{hint}")
    return value


def _require_flag(value: Any) -> Any:
    if not isinstance(value, bool):
        raise ValueError(f"expected true or false, got {short(value)}")
    return value


Number = Annotated[float, BeforeValidator(_require_number), Field(allow_inf_nan=False)]
Count = Annotated[int, BeforeValidator(_require_number)]
Flag = Annotated[bool, BeforeValidator(_require_flag)]

_Model = TypeVar("_Model", bound=BaseModel)
_Result = TypeVar("_Result")


class _Loader(yaml12.Loader):
    """Loader that rejects a key given twice, and a quantity given in two units."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    keys_by_quantity: dict[str, str] = {}
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str):
            hint = ""
            if isinstance(key, int | float):
                hint = "; if it is a number with a decimal comma, write it with a point, such as 0.5"
            problem = f"expected a name as key, got {short(key)}{hint}"
        elif quantity_of(key) in keys_by_quantity:
            other = keys_by_quantity[quantity_of(key)]
            problem = f"{other} is given twice, here as {key}; expected exactly one of them, leave one out"
        else:
            keys_by_quantity[quantity_of(key)] = key
            continue
        mark = key_node.start_mark
        raise ParameterError(f"line {mark.line + 1}, column {mark.column + 1}: {problem}")
    return dict(loader.construct_pairs(node, deep=True))


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def _loaded(text: str) -> Any:
    try:
        return yaml.load(text, Loader=_Loader)  # a subclass of SafeLoader
    except ParameterError:
        raise
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or error
        location = f"line {mark.line + 1}, column {mark.column + 1}: " if mark is not None else ""
        raise ParameterError(f"{location}not valid YAML: {_one_line(str(problem))}") from error
    except (RecursionError, ValueError, OverflowError, AttributeError, TypeError) as error:
        raise ParameterError(f"not valid YAML: {_one_line(str(error))}") from error


def parse_yaml(text: str, source: str) -> dict[str, Any]:
    """Parse YAML text whose outermost element is a mapping.

    ``source``: name of the text in messages. Raises ParameterFileError if the text is not such YAML.
    """
    data = convert_with_context(source, "", lambda: _loaded(text))
    if not isinstance(data, dict):
        got = "nothing" if data is None else short(data)
        raise ParameterFileError(source, "", f"expected keys and values, got {got}")
    return data


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file whose outermost element is a mapping; raise ParameterFileError if this fails."""
    try:
        text = read_text(path, MAXIMUM_FILE_SIZE)
    except (OSError, UnicodeDecodeError) as error:
        problem = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ParameterFileError(path, "", f"cannot be read ({problem}); check the path") from error
    return parse_yaml(text, str(path))


def packaged(folder: str) -> dict[str, Path]:
    """Return the YAML files in a folder of this package, by their names without ending."""
    return yaml_files(Path(__file__).parent / folder)


def yaml_files(folder: Path) -> dict[str, Path]:
    """Return the YAML files in a folder, by their names without ending."""
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def descriptions(found: Mapping[str, Path]) -> dict[str, str]:
    """Return the values of ``description`` in YAML files, in one line each."""
    return {name: _one_line(str(read_yaml(path).get("description", ""))) for name, path in found.items()}


def validate(model: type[_Model], data: Mapping[str, Any], source: str, prefix: str = "") -> _Model:
    """Check a mapping against a schema, and return it as an instance of the schema.

    ``source``: name of its file in messages; ``prefix``: key of the mapping in its file. Raises
    ParameterFileError for the first mistake, with file, key, given value and accepted values.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        mistakes = error.errors(include_url=False)
        # A misspelt key usually causes a missing key as well; the message about the spelling is more useful.
        first: Any = next((item for item in mistakes if item["type"] == "unknown_key"), mistakes[0])
        kind, problem, given = first["type"], first["msg"], short(first.get("input"))
        location, raised = _path_in_file(first["loc"], data), first.get("ctx", {}).get("error")
        if kind == "missing" or isinstance(raised, MissingParameterError):
            key = first["loc"][-1] if raised is None else raised.key
            raise MissingKeyError(source, _key_in_file([*location, key], prefix)) from error
        if kind == "unknown_key":
            location.append(first["ctx"]["key"])
        elif kind in ("model_type", "model_attributes_type", "dict_type"):
            problem = f"expected keys and values, got {given}"
        elif kind == "value_error":
            problem = problem.removeprefix("Value error, ")
            section, _, rest = problem.partition(": ")
            if isinstance(first.get("input"), Mapping) and isinstance(first["input"].get(section), Mapping):
                location, problem = [*location, section], rest  # the mistake is in a section inside
        else:
            problem = problem.replace("valid tuple", "valid list")
            problem = f"{problem[:1].lower()}{problem[1:]}, got {given}"
        raise ParameterFileError(source, _key_in_file(location, prefix), problem) from error


def _key_in_file(location: Sequence[Any], prefix: str) -> str:
    where = _dotted([part if isinstance(part, int) else _short_name(part) for part in location])
    return f"{prefix}.{where}".strip(".")


def convert_with_context(source: str, key: str, convert: Callable[[], _Result]) -> _Result:
    """Run a conversion and add file and key to the beginning of its error messages."""
    try:
        return convert()
    except ParameterFileError:
        raise
    except MissingParameterError as error:
        raise MissingKeyError(source, f"{key}.{error.key}".strip(".")) from error
    except TwinGaitError as error:
        raise ParameterFileError(source, key, str(error)) from error


def _nearest(name: str, known: Sequence[str], model: type[BaseModel]) -> list[str]:
    """Return the keys that an unknown key of a section may stand for.

    A key of the section with nearly the same spelling comes first. Otherwise these are keys of the section or
    below it that contain all words of the unknown one: ``scenario.belt_speed_km_per_h`` for ``speed``.
    """
    misspelt = difflib.get_close_matches(name, known, n=1, cutoff=0.9)
    if misspelt:
        return misspelt
    quantities = {path: quantity_of(path.rpartition(".")[2]).lower() for path in _paths(model)}
    words = set(name.lower().split("_"))
    ranks = {
        path: (len(quantity), path.count("."))
        for path, quantity in quantities.items()
        if words <= set(quantity.split("_"))
    }
    best = [path for path, rank in ranks.items() if rank == min(ranks.values())]
    return best[:2] or difflib.get_close_matches(name, known, n=1, cutoff=0.5)


def _paths(model: type[BaseModel]) -> Iterator[str]:
    """Yield the dotted keys of a schema and of everything below it."""
    for name, info in model.model_fields.items():
        key = info.alias or name
        yield key
        for inner in _models_in(info.annotation):
            yield from (f"{key}.{path}" for path in _paths(inner))


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the schema classes inside an annotation such as ``dict[str, Phase] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _models_in(inner)


def _path_in_file(location: Sequence[Any], data: Any) -> list[Any]:
    """Return the path of a mistake in its file, without the names of schema variants, which no file has."""
    kept = []
    for part in location:
        if part in data if isinstance(data, Mapping) else isinstance(data, list) and part in range(len(data)):
            data = data[part]
            kept.append(part)
    return kept


def _dotted(location: Sequence[Any]) -> str:
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return "".join(parts).removeprefix(".")


def _short_name(name: str) -> str:
    """Return a key of a file or message, shortened to 64 characters."""
    return name if len(name) <= 64 else name[:63] + "…"


def short(value: Any) -> str:
    """Return a value as a text of at most 60 characters.

    Nested aliases of YAML are not expanded, because this could take all memory.
    """
    text = _one_line(_SHORT.repr(value))
    return text if len(text) <= 60 else text[:57] + "…"


def _one_line(text: str) -> str:
    return " ".join(text.split())
