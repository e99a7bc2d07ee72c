"""Loading of experiments from presets and files, merged with changes, and of wearers.

Values for both sides of a wearer are under ``both``; ``left`` and ``right`` override them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from pydantic import create_model

from twin_gait.configuration import gait_table_file, validation
from twin_gait.configuration.custom_sections import (
    SIDES,
    convert_user_controller,
    section_of,
    type_of,
    user_controller_document,
)
from twin_gait.configuration.device_file import Device, list_devices, load_device, without_device
from twin_gait.configuration.documents import content_hash, experiment_document
from twin_gait.configuration.events import events_of, faults_and_requests
from twin_gait.configuration.policy_file import read_policy
from twin_gait.configuration.reference_file import convert_reference, resolve_reference
from twin_gait.configuration.sections import known_sections
from twin_gait.configuration.validation import (
    convert_with_context,
    descriptions,
    merge,
    packaged,
    read_yaml,
    validate,
)
from twin_gait.control.controller import Controller
from twin_gait.control.user_controller import record_controller
from twin_gait.exceptions import ParameterError, ParameterFileError
from twin_gait.experiment.experiment import Engine, Experiment, default_integration
from twin_gait.experiment.own_gait import OwnGait
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.network.dbc import find_dbc
from twin_gait.parameters.wearer import Patient
from twin_gait.worlds.registry import describe_entry_point, find_world, load_plugin

_HEADER = ("schema_version", "description")  # keys in the file of a person that are not parameters
# Keys whose value may be the name of a file that replaces the whole section, each with the folder of its
# shipped files.
_NAMED = {"patient": "patients", "table": "tables", "modes": "modes", "scenario": "presets"}
DEFAULT_PRESET = "treadmill"  # preset of a command that names none
GROUP = "twin_gait.presets"  # group of entry points; each refers to a package that contains YAML files


@dataclass(frozen=True)
class LoadedExperiment:
    """Experiment and the resolved mapping from which it was created."""

    experiment: Experiment  # the experiment
    document: dict[str, Any]  # mapping with all values resolved, units as typed


def experiment_from_mapping(
    data: dict[str, Any], source: str, folder: Path, previous: LoadedExperiment | None = None
) -> Experiment:
    """Convert a resolved mapping (presets merged, table inline) to an experiment.

    ``source``: name of the mapping in messages. ``folder``: folder to which relative paths refer.
    ``previous``: an experiment converted before; sections that are identical objects in both are not
    converted again, because conversion takes most of the time. Raises ParameterFileError if the mapping has a
    mistake.
    """
    known, table = {}, None
    if previous is not None:
        known = known_sections(data, previous.document, previous.experiment)
        known.pop("own_gait", None)  # because it is converted with its table below
        known.pop("integration", None)  # because it is merged with the default of engine and world below
        table = gait_table_file.ConvertedTable(previous.document["table"], previous.experiment.table)
    entry: Any = validate(_experiment_section(data.get("scenario"), source), {**data, **known}, source)
    found: dict[str, Any] = entry.values()
    # A table without a name gets the name of the experiment.
    if (
        previous is None
        or entry.name != previous.experiment.name
        or data["table"] is not previous.document["table"]
    ):
        found["table"] = gait_table_file.gait_table_from_mapping(
            data["table"], f"{source}: table", entry.name, table
        )
    else:
        found["table"] = previous.experiment.table
    if entry.modes is not None:
        found["modes"] = gait_table_file.mode_table_from_mapping(entry.modes, f"{source}: modes", entry.name)
    if entry.own_gait is not None:
        if previous is not None and data["own_gait"] is previous.document.get("own_gait"):
            found["own_gait"] = previous.experiment.own_gait
        else:
            found["own_gait"] = _own_gait(entry.own_gait, source)
    if entry.reference is not None:
        found["reference"] = convert_reference(entry.reference, source)
    if entry.controller is not None:
        found["controller"] = convert_user_controller(entry.controller)
    if entry.integration is not None:
        braced, engine = found.get("interface") is not None, found.get("engine", Engine.COMPILED)
        given = entry.integration.values()
        method = {"method": given["method"]} if "method" in given else {}
        standard = default_integration(engine, entry.scenario, braced=braced, **method)
        found["integration"] = convert_with_context(source, "integration", lambda: replace(standard, **given))
    if data.get("patient") is None:
        found["patient"] = None
    if previous is None or found["leg"] is not previous.experiment.leg:
        leg = found["leg"] = replace(
            found["leg"], urdf=gait_table_file.resolve_path(folder, found["leg"].urdf)
        )
        convert_with_context(source, "leg", lambda: find_urdf(leg.urdf))
    given = found.get("network")
    if given is not None and given.dbc and (previous is None or given is not previous.experiment.network):
        network = found["network"] = replace(given, dbc=gait_table_file.resolve_path(folder, given.dbc))
        find_dbc(network.dbc)
    urdf, recorded_hash = found["leg"].urdf, (entry.provenance or {}).get("urdf_sha256")
    if recorded_hash is not None and recorded_hash != urdf_hash(find_urdf(urdf)):
        problem = f"{urdf} is not the file that this experiment was made with; restore it, or remove this key"
        raise ParameterFileError(source, "provenance.urdf_sha256", problem)
    if not entry.events:
        return convert_with_context(source, "", lambda: Experiment(**found))
    for key, more in zip(("faults", "requests"), faults_and_requests(entry.events, source), strict=True):
        found[key] = (*found.get(key, ()), *more)
    plain = convert_with_context(source, "", lambda: Experiment(**found))
    events = events_of(entry.events, plain, source)
    return convert_with_context(source, "", lambda: replace(plain, events=events))


def _own_gait(data: Mapping[str, Any], source: str) -> OwnGait:
    """Convert the section of a wearer's own gait, with its table inline."""
    table, name = data.get("table"), f"{source}: own_gait"
    if not isinstance(table, Mapping):
        known = ", ".join(packaged("own_gaits"))
        raise ParameterFileError(
            source, "own_gait.table", f"expected a gait table, or the name of one of {known}, got {table!r}"
        )
    converted = gait_table_file.gait_table_from_mapping({**table}, f"{name}.table", "own_gait")
    others = {key: value for key, value in data.items() if key != "table"}
    section = validate(section_of(OwnGait), others, source, "own_gait")
    own: OwnGait = convert_with_context(source, "", lambda: OwnGait(table=converted, **section.values()))
    return own


def _resolved_own_gait(value: Any, path: Path) -> dict[str, Any] | None:
    """Return the section of a wearer's own gait with its table inline; ``value``: a section or a table."""
    if value is None:
        return None
    section = {**value} if isinstance(value, Mapping) and "phases" not in value else {"table": value}
    named = section.get("table")
    if isinstance(named, Mapping):
        table = load_named_document("table", named, path)
        return section if table is None else {**section, "table": table}
    find = partial(gait_table_file.named_file, named, "own_gaits", path.parent)
    found = convert_with_context(str(path), "own_gait.table", find)
    written = gait_table_file.read_gait_table(found)
    gait_table_file.checked_table(written, str(found), found.stem)
    return {**section, "table": {**written.data, "name": written.data.get("name") or found.stem}}


def _experiment_section(scenario: Any, source: str) -> Any:
    """Return the schema of an experiment in the world of a scenario."""
    if scenario is None:
        return section_of(Experiment)  # whose validation reports the missing key
    kind = scenario.get("kind") if isinstance(scenario, Mapping) else scenario
    name = kind if isinstance(kind, str) else validation.short(kind)
    return _section_in(convert_with_context(source, "scenario.kind", lambda: find_world(name)))


@cache
def _section_in(world: type[Any]) -> Any:
    return create_model("Experiment", __base__=section_of(Experiment), scenario=(type_of(world), ...))


def list_patients() -> dict[str, str]:
    """Return the names of the patients that ship with the package, with their one-line descriptions."""
    return descriptions(packaged("patients"))


def load_named_document(key: str, value: Any, path: Path, source: str = "") -> dict[str, Any] | None:
    """Return the document that replaces the whole section ``patient``, ``table``, ``modes`` or ``scenario``.

    Returns None if the value only changes the section. The document is checked here, so that a message can
    name the file that contains the mistake.

    ``value``: name of a shipped document, or path of a file; for a person also a mapping with such a name
    under ``preset`` and changes to it; for a table also a complete one, with ``schema_version`` or
    ``extends``; for a scenario the name of a preset or the path of an experiment file, whose scenario is
    taken. For the key ``device`` the document has all sections of the device. ``path``: file that contains
    the value, to whose folder a relative path refers; the working folder is searched next. ``source``: name
    of this file in messages. Raises ParameterFileError if there is no document of that name, or if it has a
    mistake.
    """
    name, changes = value, {}
    if key in ("device", "scenario"):
        if not isinstance(value, str):
            return None
        if key == "device":
            device = _named_device(value, path, source)
            return {**device.sections, "device": {"name": device.name}}
        return _scenario_of(value, path, source or str(path))
    if isinstance(value, Mapping):
        if key == "table" and "extends" in value:
            inline = gait_table_file.merge_extended_table({**value}, path, f"{path}: table")
            gait_table_file.checked_table(inline, f"{path}: table", path.stem)
            return inline.data
        if key != "patient":
            return {**value} if "schema_version" in value else None
        name, changes = value.get("preset"), {item: value[item] for item in value if item != "preset"}
    if name is None:
        return None
    find = partial(gait_table_file.named_file, name, _NAMED[key], path.parent)
    found = convert_with_context(source or str(path), key, find)
    if key == "table":
        written = gait_table_file.read_gait_table(found)
        gait_table_file.checked_table(written, str(found), found.stem)
        return {**written.data, "name": written.data.get("name") or found.stem}
    data = read_yaml(found)
    if key == "modes":
        gait_table_file.mode_table_from_mapping(data, str(found), found.stem)
        return {"name": found.stem, **data}
    read_patient(found)
    person = _person(data, found)
    if "own_gait" in person:  # its path refers to the folder of the person's file
        person["own_gait"] = _resolved_own_gait(person["own_gait"], found)
    return merge(person, changes)


def _scenario_of(name: str, path: Path, source: str) -> dict[str, Any]:
    """Return the scenario of a preset, or of an experiment file next to ``path`` or in the working folder."""
    beside = path.parent / name
    found, _ = convert_with_context(source, "scenario", lambda: _find(beside if beside.is_file() else name))
    scenario = _resolved(read_yaml(found), found).get("scenario")
    if not isinstance(scenario, Mapping):
        raise ParameterFileError(found, "scenario", "is missing; name another preset or experiment file")
    return {**scenario}


def replace_device(document: Mapping[str, Any], device: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document of an experiment with another device, given by all its sections."""
    return merge(device, without_device(document))


def read_patient(path: Path) -> Patient:
    """Read the file of a person. Raises ParameterFileError if it has a mistake."""
    person = _person(read_yaml(path), path)
    own_gait = _resolved_own_gait(person.pop("own_gait", None), path)
    if own_gait is not None:
        _own_gait(own_gait, str(path))
    section = validate(section_of(Patient), person, str(path))
    patient: Patient = convert_with_context(str(path), "", section.convert)
    return patient


def sections_of_person(person: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sections of an experiment that a person gives: ``patient`` and, if present, ``own_gait``."""
    own_gait = {"own_gait": person["own_gait"]} if "own_gait" in person else {}
    return {"patient": {key: value for key, value in person.items() if key != "own_gait"}, **own_gait}


def _person(data: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return the parameters in a person's file; without ``name``, the name is that of the file.

    Raises ParameterFileError if the file is an experiment.
    """
    if "scenario" in data:
        problem = "is a key of an experiment, not of a person; give the file as the experiment instead"
        raise ParameterFileError(path, "scenario", problem)
    gait_table_file.require_schema_version(data, str(path))
    person = {item: data[item] for item in data if item not in _HEADER}
    return {**person, "name": data.get("name") or path.stem}


def list_own_gaits() -> dict[str, str]:
    """Return the names of the own gaits that ship with the package, with their one-line descriptions."""
    return descriptions(packaged("own_gaits"))


def presets() -> dict[str, str]:
    """Return the names of the presets with their one-line descriptions, those of other packages last."""
    shipped = packaged("presets")
    return descriptions(
        shipped | {name: path for name, path in _plugin_presets().items() if name not in shipped}
    )


def load_experiment(source: str | Path = DEFAULT_PRESET, settings: Sequence[str] = ()) -> LoadedExperiment:
    """Load a preset or an experiment file.

    A file may name a ``preset`` with which it is merged, and a gait ``table``, a ``patient`` and ``modes``,
    by the name of a packaged document or by path; all are resolved here. ``settings`` override everything; a
    document that they name replaces the whole section.

    ``source``: name of a preset, or path of a YAML file. ``settings``: assignments such as
    ``patient.mass_kg=80``; keys of the table begin with ``table.``. Returns the experiment with its resolved
    mapping. Raises ParameterFileError if the file has a mistake. Raises ParameterError if there is no such
    preset or file, or if an assignment cannot be read.
    """
    path, where = _find(source)
    assignments = validation.parse_assignments(settings)
    device, others = None, [item for item in assignments if item[0] != ["device"]]
    for _, value in (item for item in assignments if item[0] == ["device"]):
        device = _named_device(value, Path.cwd() / "settings", f"{where} with --set")
    data, changes = _resolved(read_yaml(path), path, device), []
    where = f"{where} with --set" if settings else where
    for keys, value in others:
        key = str(keys[0])
        if keys in (["own_gait"], ["own_gait", "table"]) and value is not None:
            below = data.get("own_gait") or {}
            data["own_gait"] = {**below, **(_resolved_own_gait(value, path) or {})}
            continue
        if keys == ["reference"]:
            data["reference"] = resolve_reference(value, path, where)
            continue
        if keys == ["control", "policy"] and isinstance(value, str):
            value = read_policy(value, path, where)
        whole = load_named_document(key, value, path, where) if keys == [key] and key in _NAMED else None
        if whole is None:
            changes.append((keys, value))
            continue
        data |= sections_of_person(whole) if key == "patient" else {key: whole}
    paths = [keys for keys, _ in changes]
    if data.get("controller") is not None and ["control", "mode"] in paths and ["controller"] not in paths:
        raise ParameterFileError(
            where, "control.mode", "the section controller replaces it; set controller=null, too"
        )
    if "device" not in data and "extends" not in data:  # a table's key, which has an error of its own
        _named_device(None, path)  # raises the error of a missing device
    document = _complete_document(data, where, path.parent)
    for keys, value in changes:
        document = validation.assign(document, keys, value)
    return LoadedExperiment(experiment_from_mapping(document, where, path.parent), document)


def with_controller(loaded: LoadedExperiment, controller: Controller) -> LoadedExperiment:
    """Return an experiment with a controller of the user's own."""
    record = record_controller(controller)
    return replace(
        loaded,
        experiment=replace(loaded.experiment, controller=record),
        document={**loaded.document, "controller": user_controller_document(record)},
    )


def _complete_document(data: dict[str, Any], source: str, folder: Path) -> dict[str, Any]:
    """Return a mapping with the defaults of all values that it leaves out; given values keep their units."""
    # Events and requests have no default, and a setting may replace those that fit other modes.
    plain = {key: value for key, value in data.items() if key not in ("events", "requests")}
    experiment = experiment_from_mapping(plain, source, folder)
    defaults = experiment_document(experiment)
    for wearer in (defaults["patient"], defaults["control"].get("patient")):
        for side in SIDES if wearer is not None else ():
            wearer.pop(side, None)  # effort and stiffness of a wearer's joints have no default
    named = ("table", "modes", "own_gait", "controller", "reference")
    whole = {key: data[key] for key in named if data.get(key) is not None}
    typed = {
        key: value
        for key, value in data.items()
        if key not in (*whole, "modes", "own_gait", "reference", "provenance", "leg")
    }
    document = {**merge(defaults, typed), **whole}
    if experiment.network is not None and isinstance(document["network"], dict):
        document["network"]["dbc"] = experiment.network.dbc  # an absolute path
    return document


# Keys of the files that an experiment refers to, by their sections.
FILE_KEYS = {"leg": "urdf", "network": "dbc"}


def resolved_document(
    experiment: Experiment,
    typed: dict[str, Any] | None,
    versions: dict[str, str],
    files: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return the mapping that reproduces an experiment, for ``experiment.yaml``.

    ``typed``: mapping from which the experiment was loaded, or None. It is kept if it still gives exactly
    this experiment; otherwise, because the experiment was created or changed in Python, all values are in SI.
    Integrator and step are always explicit. ``versions``: versions of the software, for the provenance.
    ``files``: names of the files of the experiment by section, instead of their absolute paths.
    """
    document = experiment_document(experiment)
    table_hash = content_hash(document["table"])
    if typed is not None:  # its file names may be relative to a folder that is unknown here
        both = (name for name in FILE_KEYS if typed.get(name) and isinstance(document.get(name), dict))
        located = _with_files(typed, {name: document[name][FILE_KEYS[name]] for name in both})
        if experiment_from_mapping(located, "experiment", Path()) == experiment:
            document = located
    document = _with_files(document, files or {})
    return {
        "integration": section_of(type(experiment.resolved_integration)).document(
            experiment.resolved_integration
        ),
        **document,
        "provenance": {
            "urdf_sha256": urdf_hash(find_urdf(experiment.leg.urdf)),
            "table_sha256": table_hash,
            "versions": versions,
        },
    }


def _with_files(document: dict[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return a document with other names of its files, given by section."""
    for section, name in names.items():
        given = document.get(section) or {}
        given = given if isinstance(given, dict) else {"kind": given}
        document = {**document, section: {**given, FILE_KEYS[section]: name}}
    return document


def _plugin_presets() -> dict[str, Path]:
    """Return the presets of packages that are registered under the entry point ``twin_gait.presets``."""
    found: dict[str, Path] = {}
    for entry in entry_points(group=GROUP):
        folders = getattr(load_plugin(entry), "__path__", ())
        if not folders:
            raise ParameterError(
                f"{describe_entry_point(entry)}: expected a package with presets; repair or uninstall it"
            )
        found |= validation.yaml_files(Path(folders[0]))
    return found


def _preset(name: str) -> Path | None:
    """Return the file of a preset; other packages are searched only if no shipped preset has the name."""
    return packaged("presets").get(name) or _plugin_presets().get(name)


def _find(source: str | Path) -> tuple[Path, str]:
    """Return the file of an experiment, and its name in messages."""
    path = Path(source).expanduser()
    preset = _preset(source) if isinstance(source, str) and path.name == source and not path.suffix else None
    if preset is not None:
        return preset, f"preset {source}"
    if path.is_dir() and (path / "experiment.yaml").is_file():
        path = path / "experiment.yaml"
    if path.is_file():
        return path, str(path)
    expected = f"expected a preset ({', '.join(presets())}) or the path of an experiment file"
    raise ParameterError(f"{source}: there is no such preset or file; {expected}")


def _resolved(data: dict[str, Any], path: Path, device: Device | None = None) -> dict[str, Any]:
    """Replace the names of documents in a file by their contents, and merge it with its preset and device.

    ``device``: device instead of the one that the file or its preset names.
    """
    given = {key: value for key, value in data.items() if key != "preset"}
    if isinstance(given.get("device"), Mapping):  # the values of the device are in this file
        given = given if device is None else without_device(given)
    elif (name := given.pop("device", None)) is not None and device is None:
        device = _named_device(name, path)
    found = {key: load_named_document(key, given.get(key), path) for key in _NAMED}
    whole = {key: document for key, document in found.items() if document is not None}
    if (person := whole.get("patient")) is not None:
        given = sections_of_person(person) | given
        whole["patient"] = sections_of_person(person)["patient"]
    if "own_gait" in given:
        given["own_gait"] = _resolved_own_gait(given["own_gait"], path)
    if "reference" in given:
        given["reference"] = resolve_reference(given["reference"], path)
    if isinstance(control := given.get("control"), Mapping) and isinstance(control.get("policy"), str):
        given["control"] = {**control, "policy": read_policy(control["policy"], path)}
    base: dict[str, Any] = {}
    if (preset := data.get("preset")) is not None:
        below = _preset(preset) if isinstance(preset, str) else None
        if below is None:
            known = ", ".join(presets())
            raise ParameterFileError(
                path, "preset", f"there is no preset {preset!r}; expected one of {known}"
            )
        base = {**_resolved(read_yaml(below), below, device), "name": path.stem}
    elif device is not None:
        base = {**device.sections, "device": {"name": device.name}}
    # A whole section is not merged with that of the preset.
    return merge(base | dict.fromkeys(whole), given | whole)


def _named_device(name: Any, path: Path, source: str = "") -> Device:
    """Read the device that the file at ``path`` names; raise ParameterFileError if there is none."""
    source = source or str(path)
    if not isinstance(name, str) or not name:
        known = ", ".join(list_devices())
        problem = f"expected the path of a file, or one of {known}, got {validation.short(name)}"
        raise ParameterFileError(source, "device", problem)
    return convert_with_context(source, "device", lambda: load_device(name, path.parent))
