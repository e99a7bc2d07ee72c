"""Devices as files: everything of the machine, and nothing of its wearer, its world or its walk.

A device has the sections of an experiment that describe the machine, under the same keys. It states every
number of them or inherits it from the device that it ``extends``; a number that is missing has no default.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from twin_gait.configuration.gait_table_file import named_file, resolve_path
from twin_gait.configuration.sections import section_of
from twin_gait.configuration.validation import (
    Strict,
    convert_with_context,
    descriptions,
    merge,
    packaged,
    quantity_of,
    read_yaml,
    validate,
)
from twin_gait.exceptions import MissingKeyError, ParameterFileError
from twin_gait.experiment.device import ControlParameters, PlantParameters, check_limits
from twin_gait.parameters.drives import SensorParameters
from twin_gait.vocabulary import JointName
from twin_gait.worlds.world import LegSource

# Sections of a device; of ``plant`` and ``control`` it has these sections inside.
SECTIONS = {
    "leg": LegSource,
    "plant": PlantParameters,
    "control": ControlParameters,
    "sensors": SensorParameters,
}
PARTS = {
    "plant": (
        "actuators",
        "friction",
        "friction_ratio",
        "battery",
        "electronics",
        "stops",
        "ankle",
        "motor_bus",
    ),
    "control": ("friction_model", "limits", "safety"),
}
BASES = "extends: twin, or extends: ideal for a base without friction and losses"


class DeviceFile(Strict):
    """File of a device."""

    schema_version: Literal[2]
    description: str = ""
    extends: str = ""
    leg: dict[str, Any] | None = None
    plant: dict[str, Any] | None = None
    control: dict[str, Any] | None = None
    sensors: dict[str, Any] | None = None
    network: dict[str, Any] | str | None = None
    sources: dict[str, str] = Field(default_factory=dict)


@dataclass(frozen=True)
class Device:
    """Device as it is merged below an experiment."""

    name: str  # name of the file without its ending
    path: Path  # path of the file
    description: str  # one line
    sections: dict[str, Any]  # sections of an experiment, all values resolved
    origins: dict[str, str]  # device that states each value, by its key
    sources: dict[str, dict[str, str]]  # origin of numbers in literature and catalogues, by device and key

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of each section by its key; raise ParameterFileError for an invalid value."""
        source, found = str(self.path), {}
        for key, kind in SECTIONS.items():
            section = validate(section_of(kind), self.sections.get(key, {}), source, key)
            found[key] = convert_with_context(source, key, section.convert)
        convert_with_context(source, "", lambda: check_limits(found["control"].limits, found["plant"]))
        return found

    def parameters_of_drive(self, joint: JointName) -> dict[str, Any]:
        """Return the parameters of each section; raise ParameterFileError if a joint has no drive."""
        parameters = self.parameters()
        driven = parameters["plant"].actuators
        if joint not in driven:
            others = f"choose a joint with a drive ({', '.join(driven) or 'none'}), or add one"
            problem = f"is missing: the device has no drive at the {joint}; {others}"
            raise ParameterFileError(str(self.path), f"plant.actuators.{joint}", problem)
        return parameters

    def document(self) -> dict[str, Any]:
        """Return the sections with all their values in SI, as in the document of an experiment."""
        return device_sections(self.parameters())

    def stated_by(self, key: str) -> str:
        """Return the name of the device that states a value, by its key in any unit; empty if none does."""
        if key in self.origins:
            return self.origins[key]
        return self._stated_by(key) or self._stated_by(_for_all_joints(key))

    def _stated_by(self, key: str) -> str:
        quantity = quantity_of(key)
        return next((name for own, name in self.origins.items() if quantity_of(own) == quantity), "")

    def source_of(self, key: str) -> str:
        """Return the source of a number in the device that states it; empty if that device gives none.

        ``key``: key of the number, with or without unit.
        """
        keys, sources = (key, _for_all_joints(key)), self.sources.get(self.stated_by(key), {})
        covering = [
            known
            for known in sources
            if known in keys or any(item.startswith((f"{known}.", f"{known}_")) for item in keys)
        ]
        return sources[max(covering, key=len)] if covering else ""


def list_devices() -> dict[str, str]:
    """Return the names of the devices that ship with the package, with their one-line descriptions."""
    return descriptions(packaged("devices"))


def load_device(name: str, folder: Path | None = None) -> Device:
    """Read a device with the devices that it extends.

    Args:
        name: Name of a shipped device, or path of a file.
        folder: Folder to which a relative path refers; the working folder is searched next.

    Returns:
        The device, complete.

    Raises:
        ParameterError: If there is no such device.
        ParameterFileError: If a file has a mistake, or if the device does not state a number.
    """
    path = named_file(name, "devices", folder).resolve()
    shipped = (item.resolve() for item in packaged("devices").values())
    return _read_shipped_device(path) if path in shipped else _read_device(path)


def _read_device(path: Path) -> Device:
    """Read a device and check that it is complete."""
    device = _merged(path, ())
    _require_complete(device)
    return device


_read_shipped_device = cache(_read_device)  # the file of a user may change while the program runs


def _merged(path: Path, extended_by: tuple[Path, ...]) -> Device:
    """Read a device and merge it with the one that it extends, without a check that it is complete."""
    source, data = str(path), read_yaml(path)
    entry = validate(DeviceFile, data, source)
    sections = {key: data[key] for key in (*SECTIONS, "network") if data.get(key) is not None}
    for key, parts in PARTS.items():
        for part in sections.get(key, ()):
            if part not in parts:
                problem = (
                    f"does not belong to a device, which has {', '.join(parts)}; set it in the experiment"
                )
                raise ParameterFileError(source, f"{key}.{part}", problem)
    sections = _with_absolute_paths(sections, path.parent)
    origins = {key: path.stem for key, _ in _leaves(sections)}
    if not entry.extends:
        return Device(path.stem, path, entry.description, sections, origins, {path.stem: entry.sources})
    found = convert_with_context(
        source, "extends", lambda: named_file(entry.extends, "devices", path.parent).resolve()
    )
    chain = (*extended_by, path)
    if found in chain:
        problem = f"{entry.extends!r} is this device, or one that extends it; expected another device"
        raise ParameterFileError(source, "extends", problem)
    base = _merged(found, chain)
    merged = _without_null(merge(base.sections, sections))
    return Device(
        name=path.stem,
        path=path,
        description=entry.description or base.description,
        sections=merged,
        origins={key: {**base.origins, **origins}[key] for key, _ in _leaves(merged)},
        sources={**base.sources, path.stem: entry.sources},
    )


def _with_absolute_paths(sections: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the sections with the paths of files in the folder of the device made absolute."""
    found = dict(sections)
    for section, key in (("leg", "urdf"), ("network", "dbc")):
        inner = found.get(section)
        if isinstance(inner, Mapping) and isinstance(inner.get(key), str):
            found[section] = {**inner, key: resolve_path(folder, inner[key])}
    return found


def _without_null(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping without the entries that are null, by which a device removes what it inherits."""
    return {
        key: _without_null(value) if isinstance(value, Mapping) else value
        for key, value in mapping.items()
        if value is not None
    }


def _for_all_joints(key: str) -> str:
    """Return the key at which a file gives a value of a joint for all joints at once."""
    return ".".join(part for part in key.split(".") if part not in list(JointName))


def _require_complete(device: Device) -> None:
    """Raise ParameterFileError if a device does not state a number of its sections."""
    try:
        numbers = [path for path, value in _leaves(device.document()) if is_number(value)]
        missing = [path for path in numbers if not device.stated_by(path)]
    except MissingKeyError as error:
        missing = [error.key]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        extends = len(device.sources) > 1
        advice = "state it" if extends else f"state it, or begin the file with {BASES}"
        raise MissingKeyError(device.path, missing[0], f"{more}; {advice}")


def _leaves(mapping: Mapping[str, Any], below: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys of all values with the values."""
    for key, value in mapping.items():
        path = f"{below}.{key}".removeprefix(".")
        if isinstance(value, Mapping):
            yield from _leaves(value, path)
        else:
            yield path, value


def is_number(value: Any) -> bool:
    """Check whether a value of a file is a number, which true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def device_sections(experiment: Any) -> dict[str, Any]:
    """Return the sections of an experiment that belong to its device, in the form of a file in SI.

    ``experiment``: an experiment, or the parameters of the sections by their keys.
    """
    found = {}
    for key, kind in SECTIONS.items():
        parameters = experiment[key] if isinstance(experiment, Mapping) else getattr(experiment, key)
        document = section_of(kind).document(parameters)
        found[key] = {part: document[part] for part in PARTS.get(key, document) if part in document}
    return found


def without_device(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document of an experiment without the sections of its device."""
    found = {
        key: value for key, value in document.items() if key not in ("device", "leg", "sensors", "network")
    }
    for key, parts in PARTS.items():
        if isinstance(found.get(key), Mapping):
            found[key] = {part: value for part, value in found[key].items() if part not in parts}
    return found
