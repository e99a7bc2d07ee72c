"""Gait tables, and tables of operating modes, as YAML: units in the keys there, SI in the tables."""

from difflib import get_close_matches
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, create_model

from twin_gait.configuration import validation
from twin_gait.configuration.readers import section_of, type_of
from twin_gait.configuration.table_inheritance import (
    check_twice,
    gait_table_path,
    own_entries_named,
    read_gait_table,
)
from twin_gait.configuration.validation import Strict, converting, merge, packaged, read_yaml, validate
from twin_gait.exceptions import GaitTableError, ParameterError, ParameterFileError
from twin_gait.gait import GaitTable, Mode, ModeTable, table
from twin_gait.gait.guards import LEG_WORDS, MODE_WORDS, AllOf, AnyOf, Guard, GuardWords, parse_guard
from twin_gait.vocabulary import GaitPhase, Side

SCHEMA_VERSION = 1


_Blending: Any = type_of(table.Blending)
_Scaling: Any = type_of(table.Scaling)
_Waiver: Any = type_of(table.Waiver)
_Mode: Any = type_of(Mode)
_Transition: Any = section_of(table.Transition)


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
    transitions: list[_Transition]
    waive: list[_Waiver] = Field(default_factory=list)

    def shared(
        self, name: str, joints: tuple[str, ...], members: tuple[str, ...], words: GuardWords, source: str
    ) -> dict[str, Any]:
        """What both kinds of tables have, in SI; ``members`` are what guards may ask for by name."""
        transitions = [
            converting(source, f"transitions[{index}]", partial(_transition, entry, joints, members, words))
            for index, entry in enumerate(self.transitions)
        ]
        return {
            "name": self.name or name,
            "joints": joints,
            "description": self.description,
            "transitions": tuple(transitions),
            "waivers": tuple(self.waive),
        }


class GaitTableFile(_TableFile):
    """A gait table file."""

    joints: list[str] = Field(min_length=1)
    blending: _Blending = table.Blending()
    scaling: _Scaling = table.Scaling()
    phases: dict[str, dict[str, Any]] = Field(min_length=1)
    cycles: list[list[str]] = Field(default_factory=list)
    postures: list[str] = Field(default_factory=list)
    sides: dict[Side, dict[str, dict[str, Any]]] = Field(default_factory=dict)


def load_gait_table(source: str | Path, *, draft: bool = False) -> table.GaitTable:
    """Read a gait table from a YAML file, or by the name of one that ships, such as ``treadmill``.

    ``draft``: whether phases may lack exits or be out of reach, which a check reports itself. Raises
    ParameterError if there is no such table, ParameterFileError if the file has a mistake (file, key, value).
    """
    path = source if isinstance(source, Path) else gait_table_path(source)
    data, places = read_gait_table(path)
    with own_entries_named(places):
        return gait_table_from_mapping(data, str(path), path.stem, draft=draft)


def gait_table_from_mapping(
    data: dict[str, Any], source: str, name: str, *, draft: bool = False
) -> table.GaitTable:
    """Turn parsed YAML into a gait table, or a draft of one, which need not be closed.

    ``source``: file name for messages. ``name``: of the table if the file gives none.
    """
    entry: Any = validate(GaitTableFile, data, source)
    joints = tuple(entry.joints)
    phases = {phase: _phase_of(entry.phases, phase, joints, source) for phase in entry.phases}
    # Some of the five phases are a mistake, unless the table says how it goes round without the others.
    if set(phases) < {str(item) for item in GaitPhase} and not entry.cycles:
        missing = ", ".join(str(item) for item in GaitPhase if item not in phases)
        problem = f"missing {missing}; a cycle without them goes under cycles"
        raise ParameterFileError(source, "phases", problem)
    shared = entry.shared(name, joints, tuple(phases), LEG_WORDS, source)
    side_phases: dict[Side, dict[str, table.PhaseParameters]] = {}
    for side, differences in entry.sides.items():
        for phase, values in differences.items():
            key = f"sides.{side}.{phase}"
            if phase not in entry.phases:
                known = ", ".join(entry.phases)
                raise ParameterFileError(source, key, f"no such phase; there are {known}")
            merged = merge(entry.phases[phase], values)  # over the common values
            side_phases.setdefault(side, {})[phase] = _phase(merged, joints, source, key)
    kind = table.DraftTable if draft else table.GaitTable
    return converting(
        source,
        "",
        lambda: kind(
            **shared,
            phases=phases,
            blending=entry.blending,
            side_phases=side_phases,
            scaling=entry.scaling,
            cycles=tuple(tuple(cycle) for cycle in entry.cycles),
            postures=tuple(entry.postures),
        ),
    )


def _phase(values: dict[str, Any], joints: tuple[str, ...], source: str, key: str) -> table.PhaseParameters:
    """What a phase sets, of all joints of the table and no others."""
    entry: Any = validate(phase_section(joints), values, source, key)
    phase: table.PhaseParameters = converting(source, key, entry.convert)
    return phase


def _phase_of(
    phases: dict[str, dict[str, Any]], name: str, joints: tuple[str, ...], source: str
) -> table.PhaseParameters:
    """A phase; what is missing in one with nearly the name of another is a misspelt name."""
    try:
        return _phase(phases[name], joints, source, f"phases.{name}")
    except ParameterFileError as error:
        near = get_close_matches(name, [other for other in phases if other != name], n=1, cutoff=0.9)
        if not near or not error.problem.endswith("is missing"):
            raise
        problem = f"{error.problem}; did you mean the phase {near[0]}?"
        raise ParameterFileError(source, error.key, problem) from error


def _transition(
    entry: Any, joints: tuple[str, ...], members: tuple[str, ...], words: GuardWords
) -> table.Transition:
    listed = entry.any if entry.all is None else entry.all
    guards = tuple(_guard(item, joints, members, words) for item in listed or ())
    some = entry.all is None and entry.any is not None
    guard = AnyOf(guards=guards) if some else AllOf(guards=guards)
    return table.Transition(**entry.values(), guard=guard)


def _guard(item: Any, joints: tuple[str, ...], members: tuple[str, ...], words: GuardWords) -> Guard:
    if isinstance(item, str):
        return parse_guard(item, joints, members, words)
    if isinstance(item, dict) and len(item) == 1:
        ((kind, inner),) = item.items()
        if kind in ("all", "any") and isinstance(inner, list) and inner:
            guards = tuple(_guard(part, joints, members, words) for part in inner)
            return AllOf(guards=guards) if kind == "all" else AnyOf(guards=guards)
    expected = "expected a text such as 'hip.angle_deg < -8', or all: / any: with a list"
    raise GaitTableError(f"guard {validation.short(item)}: {expected}")


class ModeTableFile(_TableFile):
    """A file of operating modes."""

    joints: list[str] = Field(default=["hip", "knee"], min_length=1)
    requests: list[str]
    hold: str
    modes: dict[str, _Mode] = Field(min_length=2)


def mode_table_from_mapping(data: dict[str, Any], source: str, name: str) -> ModeTable:
    """Turn parsed YAML of the file ``source`` into a table of modes, ``name`` if it gives none.

    Raises ParameterFileError if the file has a mistake; the message names file, key and value.
    """
    entry: Any = validate(ModeTableFile, data, source)
    check_twice(data, source)
    requests = tuple(entry.requests)
    shared = entry.shared(name, tuple(entry.joints), requests, MODE_WORDS, source)
    own = {"phases": entry.modes, "requests": requests, "hold": entry.hold}
    return converting(source, "", lambda: ModeTable(**shared, **own))


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


def load_state_table(source: str | Path, *, draft: bool = False) -> GaitTable | ModeTable:
    """Read a gait table or a table of modes, whichever it is; as those two, with their errors."""
    if not isinstance(source, Path):
        try:
            source = gait_table_path(source)
        except ParameterError as error:
            if source not in packaged_mode_tables():
                known = ", ".join(packaged_mode_tables())
                raise ParameterError(f"{error}; nor is it one of the tables of modes {known}") from None
            source = mode_table_path(source)
    if "modes" in read_yaml(source):
        return load_mode_table(source)
    return load_gait_table(source, draft=draft)
