"""Lay one mapping of parameters over another, and read ``--set key=value``."""

import copy
import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.parameters.quantities import EXCHANGEABLE
from twin_gait.vocabulary import JointName

# Keys that name the same quantity in another unit, or as a ratio; the longest suffix wins.
_UNIT_SUFFIX = re.compile(f"_(ratio|{'|'.join(sorted(EXCHANGEABLE))})$")
# "friction_ratio" is a name, not "friction" in another unit; only damping has a ratio as unit.
_NO_UNIT = frozenset({"friction_ratio"})
_JOINTS = frozenset(JointName)


def quantity_of(key: str) -> str:
    """Name of a key without its unit: ``damping_ratio`` and ``damping_Nms_per_rad`` are one quantity."""
    return key if key.rpartition(".")[2] in _NO_UNIT else _UNIT_SUFFIX.sub("", key)


def refuse_two_units(data: Mapping[str, Any], source: str) -> None:
    """Refuse a mapping that gives one quantity in two units: it is ambiguous."""
    seen: set[int] = set()  # aliases are looked at once

    def visit(node: Any, place: str) -> None:
        if not isinstance(node, (Mapping, list)) or id(node) in seen:
            return
        seen.add(id(node))
        if isinstance(node, list):
            for index, item in enumerate(node):
                visit(item, f"{place}[{index}]")
            return
        first: dict[str, str] = {}
        for key, value in node.items():
            if not isinstance(key, str):
                continue  # the schema refuses it
            other = first.setdefault(quantity_of(key), key)
            if other != key:
                problem = f"expected exactly one of {other} or {key}, got both; leave one out"
                raise ParameterFileError(source, place, problem)
            visit(value, f"{place}.{key}" if place else key)

    visit(data, "")


def merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Lay changes over a mapping; a quantity given in another unit replaces the old one.

    Neither is changed; what no change touches is the same object in both. A friction law of a joint that is
    named where none was has other keys and takes the place of the old one.
    """
    merged = dict(base)
    for key, value in changes.items():
        if key not in merged:
            for other in [name for name in merged if quantity_of(name) == quantity_of(key)]:
                del merged[other]
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping) and not _another_law(key, old, value):
            merged[key] = merge(old, value)
        else:
            merged[key] = copy.deepcopy(value)
    return merged


def _another_law(key: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    return key in _JOINTS and "law" in new and "law" not in old


_DIGITS, _SHOWN = 9, 100  # of a list position, no list is longer; of a text in a message
_STEP = re.compile(r"([A-Za-z_][\w]*)((?:\[\d+\])*)")


def parse_assignment(text: str) -> tuple[list[str | int], Any]:
    """Split ``patient.mass_kg=80`` into a path and a value."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise ParameterError(f"--set {text!r}: expected key=value, for example patient.mass_kg=80")
    path: list[str | int] = []
    for part in key.strip().split("."):
        match = _STEP.fullmatch(part)
        if not match:
            raise ParameterError(f"--set {text!r}: {part!r} is not a key; write names joined by dots")
        path.append(match.group(1))
        path += [int(number[:_DIGITS]) for number in re.findall(r"\d+", match.group(2))]
    try:
        return path, yaml.safe_load(value)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        shown = text if len(text) < _SHOWN else f"{text[:_SHOWN]}…"
        raise ParameterError(f"--set {shown!r}: the value is not valid YAML") from error


def parse_assignments(texts: Sequence[str]) -> list[tuple[list[str | int], Any]]:
    """Split the assignments of one command line; of those with the same key the last one counts."""
    assignments = [parse_assignment(text) for text in texts]
    keys = [text.partition("=")[0].strip() for text in texts]
    refuse_two_units({key: value for key, (_, value) in zip(keys, assignments, strict=True)}, "--set")
    return assignments


def assign(mapping: Mapping[str, Any], path: Sequence[str | int], value: Any) -> dict[str, Any]:
    """Set one value deep inside a mapping."""
    changed = dict(mapping)
    place: Any = changed
    for position, step in enumerate(path[:-1]):
        if isinstance(step, str) and isinstance(place, dict):
            inner = place.get(step)
            inner = inner if isinstance(inner, (dict, list)) else {}
        else:
            inner = _element(place, step, path[: position + 1])
        place[step] = copy.copy(inner)  # only what lies on the path; the rest is shared and stays as it is
        place = place[step]
    last = path[-1]
    if isinstance(last, str) and isinstance(place, dict):
        merged = merge(place, {last: value})
        place.clear()
        place.update(merged)
    else:
        _element(place, last, path)
        place[last] = value
    return changed


def _element(place: Any, step: str | int, path: Sequence[str | int]) -> Any:
    if isinstance(place, list) and isinstance(step, int) and step < len(place):
        return place[step]
    shown = "".join(f"[{item}]" if isinstance(item, int) else f".{item}" for item in path).lstrip(".")
    raise ParameterError(f"--set {shown}: there is no such place")
