"""Load an experiment from a preset or a file, with changes laid over it, and the people who wear the device.

What holds for both sides of a wearer stands under ``both``; ``left`` and ``right`` are laid over it.
"""

from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from twin_gait.configuration import table_inheritance, validation
from twin_gait.configuration.documents import content_hash, experiment_document
from twin_gait.configuration.experiment_file import LoadedExperiment as LoadedExperiment
from twin_gait.configuration.experiment_file import experiment_from_mapping
from twin_gait.configuration.gait_table_file import checked_table, mode_table_from_mapping, mode_table_path
from twin_gait.configuration.readers import SIDES, section_of
from twin_gait.configuration.validation import converting, descriptions, merge, packaged, read_yaml
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment import Experiment
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.parameters import Patient
from twin_gait.worlds.registry import load_plugin, words

_HEADER = ("schema_version", "name", "description")  # of the file of a person
DEFAULT_PRESET = "treadmill"  # of commands that are given none
GROUP = "twin_gait.presets"  # of entry points, each of a package with YAML files in it


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
    given = {"preset": value} if isinstance(value, str) else value
    changes = {key: item for key, item in given.items() if key != "preset"}
    path = table_inheritance.gait_table_path(given["preset"], folder, "people", "person")
    person = {key: item for key, item in read_yaml(path).items() if key not in _HEADER}
    converting(str(path), "", validation.validate(section_of(Patient), person, str(path)).convert)
    return merge(person, changes)


def named_document(key: str, value: Any, path: Path) -> dict[str, Any] | None:
    """What an experiment file has under ``patient`` or ``table``, where a value names it; else None.

    ``path``: file that names it, from whose folder a relative path starts; the working folder comes next.
    Errors are those of :func:`person_document`.
    """
    if key == "patient" and names_a_person(value):
        return _person(value, path, str(path))
    return _resolve_table(value, path) if key == "table" and isinstance(value, str) else None


def presets() -> dict[str, str]:
    """Names of the presets, those of other packages last, with their one-line descriptions."""
    shipped = packaged("presets")
    return descriptions(shipped | {name: path for name, path in _brought().items() if name not in shipped})


def load_experiment(source: str | Path = DEFAULT_PRESET, settings: Sequence[str] = ()) -> LoadedExperiment:
    """Load a preset or an experiment file.

    A file may name a ``preset`` that it is laid over, a gait ``table`` and a ``patient`` by the name of a
    packaged one or by path; all are resolved here. ``settings`` are laid over everything; a table or patient
    named in them takes the place of the whole one.

    ``source``: name of a preset, or path of a YAML file. ``settings``: assignments such as
    ``patient.mass_kg=80``; keys of the table begin with ``table.``. Returns the experiment with its resolved
    mapping. Raises ParameterFileError if the file has a mistake. Raises ParameterError if there is no such
    preset or file, or an assignment cannot be read.
    """
    path, where = _find(source)
    data = _resolve_preset(read_yaml(path), path)
    changes = []
    for keys, value in validation.parse_assignments(settings):
        if keys in (["table"], ["modes"]):
            data[str(keys[0])] = value
        elif keys == ["patient"] and names_a_person(value):
            data["patient"] = _person(value, path, f"{where} with --set")
        else:
            changes.append((keys, value))
    if "table" in data:
        data["table"] = _resolve_table(data["table"], path)
    if data.get("modes") is not None:
        data["modes"] = _resolve_modes(data["modes"], path)
    document = _complete_document(data, where, path.parent)
    if changes:
        where = f"{where} with --set"
    for keys, value in changes:
        document = validation.assign(document, keys, value)
    return LoadedExperiment(experiment_from_mapping(document, where, path.parent), document)


def _complete_document(data: dict[str, Any], source: str, folder: Path) -> dict[str, Any]:
    """Fill in every value that a mapping leaves to its default, units of the rest as typed."""
    experiment = experiment_from_mapping(data, source, folder)
    defaults = experiment_document(experiment)
    for wearer in (defaults["patient"], defaults["control"].get("patient")):
        for side in SIDES if wearer is not None else ():
            wearer.pop(side, None)  # what a wearer does has no default but nothing
    whole = {key: data[key] for key in ("table", "modes") if data.get(key) is not None}
    typed = {key: value for key, value in data.items() if key not in (*whole, "modes", "provenance", "leg")}
    return {**merge(defaults, typed), **whole}


def resolved_document(
    experiment: Experiment, typed: dict[str, Any] | None, versions: dict[str, str]
) -> dict[str, Any]:
    """Mapping that reproduces an experiment, for ``experiment.yaml``.

    The mapping as typed is kept if it still gives this very experiment; otherwise (the experiment was
    made or changed in Python) everything is written in SI.

    An integrator and step that were left to the engine are written out.
    """
    document = experiment_document(experiment)
    table_hash = content_hash(document["table"])
    if typed is not None and experiment_from_mapping(typed, "experiment", Path()) == experiment:
        document = typed
    return {
        "integration": section_of(type(experiment.stepping)).document(experiment.stepping),
        **document,
        "provenance": {
            "urdf_sha256": urdf_hash(find_urdf(experiment.leg.urdf)),
            "table_sha256": table_hash,
            "versions": versions,
        },
    }


def _brought() -> dict[str, Path]:
    """Those in the packages that others name under the entry point ``twin_gait.presets``."""
    found: dict[str, Path] = {}
    for entry in entry_points(group=GROUP):
        folders = getattr(load_plugin(entry), "__path__", ())
        if not folders:
            raise ParameterError(f"{words(entry)}: expected a package with presets; repair or uninstall it")
        found |= validation.yaml_files(Path(folders[0]))
    return found


def _preset(name: str) -> Path | None:
    """File of a preset; those of other packages are looked for only if none that ships has the name."""
    return packaged("presets").get(name) or _brought().get(name)


def _find(source: str | Path) -> tuple[Path, str]:
    """File of an experiment, and what messages call it."""
    path = Path(source).expanduser()
    preset = _preset(source) if isinstance(source, str) and path.name == source and not path.suffix else None
    if preset is not None:
        return preset, f"preset {source}"
    if path.is_dir() and (path / "experiment.yaml").is_file():
        path = path / "experiment.yaml"
    if path.is_file():
        return path, str(path)
    raise ParameterError(f"{source}: neither a preset ({', '.join(presets())}) nor an experiment file")


def _person(value: Any, path: Path, where: str) -> dict[str, Any]:
    return converting(where, "patient", lambda: person_document(value, path.parent))


def _resolve_preset(data: dict[str, Any], path: Path) -> dict[str, Any]:
    name, named = data.get("preset"), names_a_person(data.get("patient"))
    if named:
        data = {**data, "patient": _person(data["patient"], path, str(path))}
    if name is None:
        return data
    below = _preset(name) if isinstance(name, str) else None
    if below is None:
        known = ", ".join(presets())
        raise ParameterFileError(path, "preset", f"no preset {name!r}; there are {known}")
    base = _resolve_preset(read_yaml(below), below)
    rest = {key: value for key, value in data.items() if key != "preset"}
    table = rest.pop("table", base.get("table"))
    if isinstance(table, dict) and not {"schema_version", "extends"} & set(table):
        table = merge(_resolve_table(base.get("table"), path), table)
    if named:  # takes the place of the preset's wearer, with nothing of it left underneath
        base = {**base, "patient": None}
    return {**merge({**base, "name": path.stem}, rest), "table": table}


def _resolve_modes(modes: Any, path: Path) -> dict[str, Any]:
    if isinstance(modes, dict):
        return modes
    found = converting(str(path), "modes", lambda: mode_table_path(modes, path.parent))
    data = {"name": found.stem, **read_yaml(found)}
    mode_table_from_mapping(data, str(found), found.stem)  # while it is known what was written where
    return data


def _resolve_table(table: Any, path: Path) -> dict[str, Any]:
    if isinstance(table, dict) and "extends" not in table:
        return table
    if isinstance(table, dict):
        source, name = f"{path}: table", path.stem
        found = table_inheritance.extended_table(table, path, source)
    else:
        file = converting(str(path), "table", lambda: table_inheritance.gait_table_path(table, path.parent))
        source, name = str(file), file.stem
        found = table_inheritance.read_gait_table(file)
        found = found._replace(data={**found.data, "name": found.data.get("name") or name})
    checked_table(found, source, name)  # while it is known what was written where
    return found.data
