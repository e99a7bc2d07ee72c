"""Tables of operating modes as YAML; transitions are written as in gait tables."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from twin_gait.configuration.gait_table_file import TransitionEntry, load_gait_table, transition_of
from twin_gait.configuration.readers import section_of
from twin_gait.configuration.table_inheritance import gait_table_path
from twin_gait.configuration.validation import Strict, converting, packaged, read_yaml, validate
from twin_gait.exceptions import ParameterError
from twin_gait.gait.guards import MODE_WORDS
from twin_gait.gait.modes import Mode, ModeTable
from twin_gait.gait.table import GaitTable, Waiver

_Mode, _Waiver = section_of(Mode), section_of(Waiver)


class ModeTableFile(Strict):
    """A file of operating modes."""

    schema_version: Literal[1]
    name: str | None = None
    description: str = ""
    joints: list[str] = Field(default=["hip", "knee"], min_length=1)
    requests: list[str]
    hold: str
    modes: dict[str, _Mode] = Field(min_length=2)  # type: ignore[valid-type]
    transitions: list[TransitionEntry]
    waive: list[_Waiver] = Field(default_factory=list)  # type: ignore[valid-type]


def mode_table_from_mapping(data: dict[str, Any], source: str, name: str) -> ModeTable:
    """Turn parsed YAML of the file ``source`` into a table of modes, ``name`` if it gives none.

    Raises ParameterFileError if the file has a mistake; the message names file, key and value.
    """
    entry: Any = validate(ModeTableFile, data, source)
    joints, requests = tuple(entry.joints), tuple(entry.requests)
    transitions = tuple(
        transition_of(item, joints, requests, source, f"transitions[{index}]", MODE_WORDS)
        for index, item in enumerate(entry.transitions)
    )
    modes = {key: converting(source, f"modes.{key}", mode.convert) for key, mode in entry.modes.items()}
    return converting(
        source,
        "",
        lambda: ModeTable(
            name=entry.name or name,
            joints=joints,
            phases=modes,
            requests=requests,
            hold=entry.hold,
            transitions=transitions,
            description=entry.description,
            waivers=tuple(item.convert() for item in entry.waive),
        ),
    )


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
