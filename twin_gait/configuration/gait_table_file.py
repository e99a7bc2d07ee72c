"""Gait tables, and tables of operating modes, as YAML: units in the keys there, SI in the tables."""

import re
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, create_model

from twin_gait.configuration.readers import section_of, type_of
from twin_gait.configuration.table_inheritance import TableMapping, gait_table_path, read_gait_table
from twin_gait.configuration.validation import Strict, converting, merge, packaged, read_yaml, short, validate
from twin_gait.exceptions import GaitTableError, ParameterFileError
from twin_gait.gait import GaitTable, Mode, ModeTable, table
from twin_gait.gait.guards import LEG_WORDS, MODE_WORDS, AllOf, AnyOf, Guard, GuardWords, parse_guard
from twin_gait.parameters.quantities import taken_from
from twin_gait.vocabulary import GaitPhase, Side

SCHEMA_VERSION = 1


@lru_cache
def phase_section(joints: tuple[str, ...]) -> Any:
    """The section of a phase of a table for some joints."""
    fields: dict[str, Any] = dict.fromkeys(joints, (type_of(table.JointImpedance), ...))
    section: Any = create_model("Phase", __base__=section_of(table.PhaseParameters), **fields)
    section.joints = joints
    return section


class _TableFile(Strict):
    """What both kinds of files have."""

    schema_version: Literal[1]
    name: str | None = None
    description: str = ""
    transitions: tuple[section_of(table.Transition), ...] = ()  # type: ignore[valid-type]
    waive: tuple[type_of(table.Waiver), ...] = ()  # type: ignore[valid-type]


class GaitTableFile(_TableFile):
    """A gait table file."""

    joints: tuple[str, ...] = Field(min_length=1)
    blending: type_of(table.Blending) = table.Blending()  # type: ignore[valid-type]
    scaling: type_of(table.Scaling) = table.Scaling()  # type: ignore[valid-type]
    phases: dict[str, dict[str, Any]] = Field(min_length=1)
    cycles: tuple[tuple[str, ...], ...] = ()
    postures: tuple[str, ...] = ()
    sides: dict[Side, dict[str, dict[str, Any]]] = Field(default_factory=dict)


class ModeTableFile(_TableFile):
    """A file of operating modes."""

    joints: tuple[str, ...] = Field(default=("hip", "knee"), min_length=1)
    requests: tuple[str, ...] = ()
    hold: str
    modes: dict[str, type_of(Mode)] = Field(min_length=2)  # type: ignore[valid-type]


def _shared(entry: Any, name: str, words: GuardWords, source: str) -> dict[str, Any]:
    """What both kinds of tables have, in SI; ``words`` are what guards may read."""
    transitions: dict[tuple[str, ...], table.Transition] = {}
    for index, written in enumerate(entry.transitions):
        place = f"transitions[{index}]"
        item = converting(source, place, partial(_transition, written, words))
        if transitions.setdefault((item.source, item.target, item.cause), item) is not item:
            problem = "the same from, to and cause as another one; leave one out, or give it another cause"
            raise ParameterFileError(source, place, problem)
    return {"name": entry.name or name, "transitions": tuple(transitions.values()), "waivers": entry.waive}


def load_gait_table(source: str | Path) -> table.GaitTable:
    """Read a gait table from a YAML file, or by the name of one that ships, such as ``treadmill``.

    Raises ParameterError if there is no such table, ParameterFileError if the file has a mistake (file, key,
    value).
    """
    path = source if isinstance(source, Path) else gait_table_path(source)
    return checked_table(read_gait_table(path), str(path), path.stem)


def checked_table(found: TableMapping, source: str, name: str) -> table.GaitTable:
    """As :func:`gait_table_from_mapping`; mistakes in an entry of a list name file and entry as written."""
    try:
        return gait_table_from_mapping(found.data, source, name)
    except ParameterFileError as error:
        text = f"{error.key}: {error.problem}".removeprefix(": ")
        entry = re.match(r"\w+\[\d+\]", text)
        place = found.places.get(entry[0]) if entry else None
        if entry is None or place is None:
            raise
        raise ParameterFileError(place.source, "", place.key + text[entry.end() :]) from error


def gait_table_from_mapping(data: dict[str, Any], source: str, name: str) -> table.GaitTable:
    """Turn parsed YAML of the file ``source`` into a gait table, ``name`` if it gives none."""
    entry: Any = validate(GaitTableFile, data, source)
    phases = {
        name: _phase(values, entry.joints, source, f"phases.{name}") for name, values in entry.phases.items()
    }
    # Some of the five phases are a mistake, unless the table says how it goes round without the others.
    if set(phases) < set(GaitPhase) and not entry.cycles:
        missing = ", ".join(phase for phase in GaitPhase if phase not in phases)
        problem = f"missing {missing}; a cycle without them goes under cycles"
        raise ParameterFileError(source, "phases", problem)
    side_phases: dict[Side, dict[str, table.PhaseParameters]] = {}
    for side, differences in entry.sides.items():
        for phase, values in differences.items():
            key = f"sides.{side}.{phase}"
            if phase not in phases:
                raise ParameterFileError(source, key, f"no such phase; there are {', '.join(phases)}")
            merged = merge(entry.phases[phase], values)  # over the common values
            side_phases.setdefault(side, {})[phase] = _phase(merged, entry.joints, source, key)
    shared = _shared(entry, name, LEG_WORDS, source)
    more = {**shared, "phases": phases, "side_phases": side_phases}
    return converting(source, "", lambda: taken_from(table.GaitTable, entry, **more))


def _phase(values: dict[str, Any], joints: tuple[str, ...], source: str, key: str) -> table.PhaseParameters:
    """What a phase sets, of all joints of the table and no others."""
    entry: Any = validate(phase_section(joints), values, source, key)
    phase: table.PhaseParameters = converting(source, key, entry.convert)
    return phase


def _transition(entry: Any, words: GuardWords) -> table.Transition:
    given = [{kind: guards} for kind in ("all", "any") if (guards := getattr(entry, kind))]
    guard = _guard(given[0], words) if given else AllOf(guards=())
    return table.Transition(**entry.values(), guard=guard)


def _guard(item: Any, words: GuardWords) -> Guard:
    if isinstance(item, str):
        return parse_guard(item, words)
    if isinstance(item, dict) and len(item) == 1:
        ((kind, inner),) = item.items()
        if kind in ("all", "any") and isinstance(inner, list) and inner:
            guards = tuple(_guard(part, words) for part in inner)
            return AllOf(guards=guards) if kind == "all" else AnyOf(guards=guards)
    expected = "expected a text such as 'hip.angle_deg < -8', or all: / any: with a list"
    raise GaitTableError(f"guard {short(item)}: {expected}")


def mode_table_from_mapping(data: dict[str, Any], source: str, name: str) -> ModeTable:
    """Turn parsed YAML of the file ``source`` into a table of modes, ``name`` if it gives none.

    Raises ParameterFileError if the file has a mistake; the message names file, key and value.
    """
    entry: Any = validate(ModeTableFile, data, source)
    shared = _shared(entry, name, MODE_WORDS, source)
    return converting(source, "", lambda: taken_from(ModeTable, entry, **shared, phases=entry.modes))


def packaged_mode_tables() -> list[str]:
    """Names of the tables of modes that ship with the package."""
    return list(packaged("modes"))


def mode_table_path(name: str | Path, folder: Path | None = None) -> Path:
    """File of a table of modes; raises ParameterError if there is none."""
    return gait_table_path(name, folder, "modes", "table of modes")


def load_mode_table(source: str | Path) -> ModeTable:
    """Read a table of modes from a YAML file, or by the name of one that ships, such as ``twin``.

    Raises ParameterError if there is no such table, ParameterFileError if the file has a mistake.
    """
    path = source if isinstance(source, Path) else mode_table_path(source)
    return mode_table_from_mapping(read_yaml(path), str(path), path.stem)


def load_state_table(source: str | Path) -> GaitTable | ModeTable:
    """Read a gait table or a table of modes, whichever it is; as those two, with their errors."""
    if source in packaged_mode_tables():
        source = mode_table_path(source)
    path = source if isinstance(source, Path) else gait_table_path(source)
    return load_mode_table(path) if "modes" in read_yaml(path) else load_gait_table(path)
