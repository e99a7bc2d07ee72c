"""Gait tables and tables of operating modes as YAML files, with units in the keys; the tables are in SI.

A gait table may extend another one.
"""

import re
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, WrapValidator, create_model

from twin_gait.configuration.custom_sections import section_of, type_of
from twin_gait.configuration.sections import known_sections
from twin_gait.configuration.validation import (
    Strict,
    convert_with_context,
    merge,
    packaged,
    read_yaml,
    short,
    validate,
)
from twin_gait.exceptions import GaitTableError, ParameterError, ParameterFileError
from twin_gait.gait import table
from twin_gait.gait.guards import (
    LEG_VOCABULARY,
    MODE_VOCABULARY,
    AllOf,
    AnyOf,
    Guard,
    GuardVocabulary,
    parse_guard,
)
from twin_gait.gait.modes import Mode, ModeTable
from twin_gait.gait.table import GaitTable
from twin_gait.parameters.quantities import from_attributes
from twin_gait.vocabulary import GaitPhase, Side

SCHEMA_VERSION = 2
# Lists of a table that another one extends, with the keys that identify an entry of each.
_LISTS = {"transitions": ("from", "to", "cause"), "waive": ("rule", "phase", "transition")}


@lru_cache
def phase_section(joints: tuple[str, ...]) -> Any:
    """Return the schema of a phase of a table that controls some joints."""
    fields: dict[str, Any] = dict.fromkeys(joints, (type_of(table.JointImpedance), ...))
    section: Any = create_model("Phase", __base__=section_of(table.PhaseParameters), **fields)
    section.joints = joints
    return section


def _as_converted(value: Any, read: Callable[[Any], Any]) -> Any:
    return value if isinstance(value, (table.Transition, table.PhaseParameters)) else read(value)


_TransitionEntry: Any = Annotated[section_of(table.Transition), WrapValidator(_as_converted)]
_PhaseEntry: Any = Annotated[dict[str, Any], WrapValidator(_as_converted)]


class _TableFile(Strict):
    """Common keys of both kinds of table files."""

    schema_version: Literal[2]
    name: str | None = None
    description: str = ""
    transitions: tuple[_TransitionEntry, ...] = ()
    waive: tuple[type_of(table.Waiver), ...] = ()  # type: ignore[valid-type]


class GaitTableFile(_TableFile):
    """Gait table file."""

    joints: tuple[str, ...] = Field(min_length=1)
    blending: type_of(table.Blending) = table.Blending()  # type: ignore[valid-type]
    scaling: type_of(table.Scaling) = table.Scaling()  # type: ignore[valid-type]
    phases: dict[str, _PhaseEntry] = Field(min_length=1)
    cycles: tuple[tuple[str, ...], ...] = ()
    postures: tuple[str, ...] = ()
    sides: dict[Side, dict[str, dict[str, Any]]] = Field(default_factory=dict)


class ModeTableFile(_TableFile):
    """File of operating modes."""

    joints: tuple[str, ...] = Field(default=("hip", "knee"), min_length=1)
    requests: tuple[str, ...] = ()
    hold: str
    modes: dict[str, type_of(Mode)] = Field(min_length=2)  # type: ignore[valid-type]


def _shared(entry: Any, name: str, words: GuardVocabulary, source: str) -> dict[str, Any]:
    """Convert the values that both kinds of tables have; ``words``: signals that the guards may read."""
    transitions: dict[tuple[str, ...], table.Transition] = {}
    for index, written in enumerate(entry.transitions):
        location = f"transitions[{index}]"
        item = convert_with_context(source, location, partial(_transition, written, words))
        if transitions.setdefault((item.source, item.target, item.cause), item) is not item:
            problem = "has the same from, to and cause as another one; leave one out, or change its cause"
            raise ParameterFileError(source, location, problem)
    return {"name": entry.name or name, "transitions": tuple(transitions.values()), "waivers": entry.waive}


# Kind of the documents in each folder of this package, for messages.
_KINDS = {
    "tables": "gait table",
    "modes": "table of modes",
    "patients": "person",
    "devices": "device",
    "own_gaits": "own gait",
    "policies": "policy",
}


def named_file(name: Any, kind: str = "tables", folder: Path | None = None) -> Path:
    """Find the file of a gait table, a table of modes or a person, by path or by the name of a shipped one.

    ``folder``: folder to which a relative path refers; the working folder is searched next. Raises
    ParameterError if there is no such file.
    """
    shipped = packaged(kind)
    if isinstance(name, str | Path):
        in_folder = [] if folder is None else [folder / name]
        for candidate in (*in_folder, Path(name).expanduser(), shipped.get(str(name))):
            if candidate is not None and candidate.is_file():
                return candidate
    shown = short(name) if isinstance(name, list | dict) else repr(str(name))
    expected = f"expected the path of a file, or one of {', '.join(shipped)}"
    raise ParameterError(f"there is no {_KINDS[kind]} {shown}; {expected}")


def require_schema_version(data: Mapping[str, Any], source: str) -> None:
    """Raise ParameterFileError if a file, in which the version is optional, states another version."""
    if (version := data.get("schema_version", SCHEMA_VERSION)) != SCHEMA_VERSION:
        raise ParameterFileError(source, "schema_version", f"expected {SCHEMA_VERSION}, got {short(version)}")


def resolve_path(folder: Path, name: str) -> str:
    """Return the absolute path of a file in ``folder`` or the working folder; without it, the given name."""
    paths = (folder / name, Path(name).expanduser())
    return next((str(path.resolve()) for path in paths if path.is_file()), name)


def packaged_gait_tables() -> list[str]:
    """Return the names of the gait tables that ship with the package."""
    return list(packaged("tables"))


class MergedTable(NamedTuple):
    """Gait table as a mapping, merged with the tables that it extends."""

    data: dict[str, Any]  # the merged mapping, without ``extends``
    files: tuple[tuple[str, dict[str, Any]], ...]  # name and mapping of each file, the extending one first


def read_gait_table(path: Path) -> MergedTable:
    """Read a gait table file as a mapping, merged with the table that it extends."""
    return merge_extended_table(read_yaml(path), path, str(path))


def merge_extended_table(
    data: dict[str, Any], path: Path, source: str, ancestors: tuple[Path, ...] = ()
) -> MergedTable:
    """Merge a table with the table that its key ``extends`` names; a table without the key stays as it is.

    Mappings are merged key by key, as presets are. A transition with the same from, to and cause replaces the
    inherited one, or removes it with ``remove: true``. A waiver of the same rule, phase and transition
    replaces the inherited one. All other entries follow the inherited ones, which therefore take precedence
    if two exits are due in the same tick. The name is not inherited.

    ``path``: file of the table, to whose folder a relative path refers. ``source``: name of the table in
    messages. ``ancestors``: files of the tables that extend this one. Raises ParameterFileError if a table
    cannot be read, or extends itself.
    """
    lists = {key: data.get(key) or [] for key in _LISTS}
    for key, entries in lists.items():
        if not isinstance(entries, list):
            raise ParameterFileError(source, key, f"expected a list, got {short(entries)}")
    if "extends" not in data:
        return MergedTable(data, ((source, data),))
    name = data["extends"]
    found = convert_with_context(source, "extends", lambda: named_file(name, folder=path.parent))
    chain = (*ancestors, path.resolve())
    if found.resolve() in chain:
        problem = f"{name!r} is this table, or one that extends it; expected another table"
        raise ParameterFileError(source, "extends", problem)
    base = merge_extended_table(read_yaml(found), found, str(found), chain)
    merged = merge({**base.data, "name": None}, {key: data[key] for key in data if key != "extends"})
    for key, entries in lists.items():
        merged[key] = _merge_lists(base.data.get(key) or [], entries, key, source, name)
    return MergedTable(merged, ((source, data), *base.files))


def _merge_lists(below: list[Any], entries: list[Any], key: str, source: str, base: str) -> list[Any]:
    """Merge an inherited list with own entries; an own entry replaces the inherited one of equal identity.

    ``base``: name of the table with the list ``below``, for messages.
    """

    def identity(item: Any) -> tuple[Any, ...] | None:
        """Return the identifying values of an entry; None for an entry that the schema rejects."""
        names = tuple(item.get(name) for name in _LISTS[key]) if isinstance(item, dict) else (0,)
        return names if all(name is None or isinstance(name, str) for name in names) else None

    replacements: dict[Any, list[Any]] = {}
    for item in entries:
        replacements.setdefault(identity(item), []).append(item)
    merged = [entry for item in below for entry in replacements.pop(identity(item), [item])]
    added = [entry for items in replacements.values() for entry in items]
    removed = [item for item in entries if identity(item) and "from" in item and item.get("remove") is True]
    for item in removed:
        more = [name for name in item if name not in (*_LISTS[key], "remove")]
        allowed = "an entry with remove has only from, to and cause"
        problem = f"{more[0]}: leave it out, because {allowed}" if more else ""
        if item in added:
            start, end, cause = map(item.get, _LISTS[key])
            problem = f"there is nothing to remove: {base} has no transition {start} → {end} ({cause})"
        if problem:
            raise ParameterFileError(source, f"{key}[{entries.index(item)}]", problem)
    return [item for item in merged + added if item not in removed]


def load_gait_table(source: str | Path) -> table.GaitTable:
    """Read a gait table from a YAML file, or by the name of one that ships, such as ``treadmill``.

    Raises ParameterError if there is no such table, and ParameterFileError with file, key and value if the
    file has a mistake.
    """
    path = source if isinstance(source, Path) else named_file(source)
    return checked_table(read_gait_table(path), str(path), path.stem)


def checked_table(found: MergedTable, source: str, name: str) -> table.GaitTable:
    """Convert a merged table like :func:`gait_table_from_mapping`; an error names the file of its entry."""
    try:
        return gait_table_from_mapping(found.data, source, name)
    except ParameterFileError as error:
        text = f"{error.key}: {error.problem}".removeprefix(": ")
        merged = re.match(rf"({'|'.join(_LISTS)})\[(\d+)\]", text)
        if merged is None:
            raise
        key, entry = merged[1], found.data[merged[1]][int(merged[2])]
        file, index = next(
            (file, index)
            for file, data in found.files
            for index, item in enumerate(data.get(key) or ())
            if item is entry
        )
        raise ParameterFileError(file, "", f"{key}[{index}]{text[merged.end() :]}") from error


class ConvertedTable(NamedTuple):
    """Gait table and the mapping from which it was converted."""

    data: Mapping[str, Any]
    table: table.GaitTable

    def apply_to(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return a mapping in which the parts that it shares with ``data`` are replaced by their values."""
        own, found = self.table, dict[str, Any]()
        parts = {"blending": own.blending, "scaling": own.scaling, "waive": own.waivers}
        for key, value in (parts | {"transitions": own.transitions}).items():
            if key in data and data[key] is self.data.get(key):
                found[key] = value
        if data.get("joints") == self.data["joints"] and isinstance(data.get("phases"), dict):
            same = known_sections(data["phases"], self.data["phases"], own.phases)
            found["phases"] = data["phases"] | same
        return data | found


def gait_table_from_mapping(
    data: dict[str, Any], source: str, name: str, previous: ConvertedTable | None = None
) -> table.GaitTable:
    """Convert parsed YAML of the file ``source`` to a gait table, called ``name`` if it gives no name.

    ``previous``: a table converted before; parts that are identical objects in both are not converted again.
    Raises ParameterFileError with file, key and value if there is a mistake.
    """
    entry: Any = validate(GaitTableFile, data if previous is None else previous.apply_to(data), source)
    phases = {
        name: _phase(values, entry.joints, source, f"phases.{name}") for name, values in entry.phases.items()
    }
    # A table with only some of the five usual phases must declare a cycle without the others.
    if set(phases) < set(GaitPhase) and not entry.cycles:
        missing = ", ".join(phase for phase in GaitPhase if phase not in phases)
        problem = f"missing {missing}; add them, or declare a cycle without them under cycles"
        raise ParameterFileError(source, "phases", problem)
    side_phases: dict[Side, dict[str, table.PhaseParameters]] = {}
    for side, differences in entry.sides.items():
        for phase, values in differences.items():
            key = f"sides.{side}.{phase}"
            if phase not in phases:
                problem = f"there is no such phase; expected one of {', '.join(phases)}"
                raise ParameterFileError(source, key, problem)
            merged = merge(data["phases"][phase], values)  # over the common values
            side_phases.setdefault(side, {})[phase] = _phase(merged, entry.joints, source, key)
    shared = _shared(entry, name, LEG_VOCABULARY, source)
    more = {**shared, "phases": phases, "side_phases": side_phases}
    return convert_with_context(source, "", lambda: from_attributes(table.GaitTable, entry, **more))


def _phase(values: Any, joints: tuple[str, ...], source: str, key: str) -> table.PhaseParameters:
    """Convert the settings of a phase, which must have exactly the joints of the table."""
    if isinstance(values, table.PhaseParameters):
        return values
    entry: Any = validate(phase_section(joints), values, source, key)
    phase: table.PhaseParameters = convert_with_context(source, key, entry.convert)
    return phase


def _transition(entry: Any, words: GuardVocabulary) -> table.Transition:
    if isinstance(entry, table.Transition):
        return entry
    given = [{kind: guards} for kind in ("all", "any") if (guards := getattr(entry, kind))]
    guard = _guard(given[0], words) if given else AllOf(guards=())
    return table.Transition(**entry.values(), guard=guard)


def _guard(item: Any, words: GuardVocabulary) -> Guard:
    if isinstance(item, str):
        return parse_guard(item, words)
    if isinstance(item, dict) and len(item) == 1:
        ((kind, inner),) = item.items()
        if kind in ("all", "any") and isinstance(inner, list) and inner:
            guards = tuple(_guard(part, words) for part in inner)
            return AllOf(guards=guards) if kind == "all" else AnyOf(guards=guards)
    expected = "expected a text such as 'hip.angle_deg < -8', or all: or any: with a list of guards"
    raise GaitTableError(f"guard {short(item)}: {expected}")


def mode_table_from_mapping(data: dict[str, Any], source: str, name: str) -> ModeTable:
    """Convert parsed YAML of the file ``source`` to a table of modes, called ``name`` if it gives no name.

    Raises ParameterFileError with file, key and value if there is a mistake.
    """
    entry: Any = validate(ModeTableFile, data, source)
    shared = _shared(entry, name, MODE_VOCABULARY, source)
    return convert_with_context(
        source, "", lambda: from_attributes(ModeTable, entry, **shared, phases=entry.modes)
    )


def packaged_mode_tables() -> list[str]:
    """Return the names of the tables of modes that ship with the package."""
    return list(packaged("modes"))


def load_mode_table(source: str | Path) -> ModeTable:
    """Read a table of modes from a YAML file, or by the name of one that ships, such as ``twin``.

    Raises ParameterError if there is no such table, ParameterFileError if the file has a mistake.
    """
    path = source if isinstance(source, Path) else named_file(source, "modes")
    return mode_table_from_mapping(read_yaml(path), str(path), path.stem)


def load_state_table(source: str | Path) -> GaitTable | ModeTable:
    """Read a gait table or a table of modes from a YAML file, or by the name of one that ships.

    :func:`load_gait_table` and :func:`load_mode_table` state the errors.
    """
    if source in packaged_mode_tables():
        source = named_file(source, "modes")
    path = source if isinstance(source, Path) else named_file(source)
    return load_mode_table(path) if "modes" in read_yaml(path) else load_gait_table(path)
