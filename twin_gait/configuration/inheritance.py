"""Values of the device that the components of a user inherit from a preset or a default."""

from collections.abc import Iterator, Mapping
from typing import Any

from twin_gait.configuration.validation import quantity_of
from twin_gait.vocabulary import JointName

Path = tuple[str, ...]  # keys that lead to a value in an experiment

# Sections of an experiment whose sections are the components of the device.
DEVICE = (("plant",), ("control", "limits"))


def inherited_values(document: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the numbers of the device that are in the same components as given values but were not given.

    A component is the innermost section of a value; a section with one number for each joint belongs to
    every component of the joint.

    Args:
        document: A resolved experiment.
        given: The part of it that the user specified.

    Returns:
        Numbers by key, for each dotted path of a section.
    """
    given_quantities = {_quantity(path) for path, _ in _leaves(given)}
    touched = {path[:-1] for path in given_quantities if _is_device(path)}
    scaled = {section[-1] for section in touched if section[-1] in list(JointName)}
    found: dict[str, dict[str, Any]] = {}
    for path, value in _leaves(document):
        if not _is_device(path) or isinstance(value, bool) or not isinstance(value, int | float):
            continue
        in_component = path[:-1] in touched and path[-1] not in list(JointName)
        if (in_component or path[-1] in scaled) and _quantity(path) not in given_quantities:
            found.setdefault(".".join(path[:-1]), {})[path[-1]] = value
    return found


def _is_device(path: Path) -> bool:
    """Check whether a value belongs to a component of the device."""
    return len(path) > 2 and any(path[: len(section)] == section for section in DEVICE)


def _quantity(path: Path) -> Path:
    return (*path[:-1], quantity_of(path[-1]))


def _leaves(mapping: Mapping[str, Any], below: Path = ()) -> Iterator[tuple[Path, Any]]:
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, (*below, key))
        else:
            yield (*below, key), value
