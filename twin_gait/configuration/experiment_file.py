"""Experiments as YAML: the section of an experiment, with its gait table, and its conversion to SI."""

from collections.abc import Mapping
from dataclasses import MISSING, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import create_model

from twin_gait.configuration.gait_table_file import gait_table_from_mapping, mode_table_from_mapping
from twin_gait.configuration.readers import section_of
from twin_gait.configuration.validation import converting, validate
from twin_gait.exceptions import ModelError, ParameterError, ParameterFileError
from twin_gait.experiment import Experiment, default_integration
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.network.dbc import find_dbc
from twin_gait.parameters import NetworkParameters
from twin_gait.parameters.quantities import AsInFile, declarations
from twin_gait.worlds import LegSource, world_kinds, world_of


class Converted(NamedTuple):
    """A mapping and the experiment that it was turned into."""

    document: Mapping[str, Any]
    experiment: Experiment


def experiment_from_mapping(
    data: dict[str, Any], source: str, folder: Path, like: Converted | None = None
) -> Experiment:
    """Turn a resolved mapping (presets merged, table inline) into an experiment.

    ``folder``: where relative paths start. ``like``: one turned before, whose very same sections are not
    converted again, which takes most of the time.
    """
    entry: Any = validate(_file_about(data.get("scenario"), source), data, source)
    # A table without a name has the experiment's.
    named = like if like is not None and entry.name == like.experiment.name else None
    table = (
        named.experiment.table
        if named is not None and data["table"] is named.document["table"]
        else gait_table_from_mapping(entry.table, f"{source}: table", entry.name)
    )
    if like is not None and data["scenario"] is like.document.get("scenario"):
        scenario = like.experiment.scenario
    else:
        scenario = converting(source, "scenario", entry.scenario.convert)
    found: dict[str, Any] = {"table": table, "scenario": scenario}
    if entry.modes is not None:
        found["modes"] = mode_table_from_mapping(entry.modes, f"{source}: modes", entry.name)
    for item in declarations(Experiment):
        key = next((key for key in item.keys if key in data), item.key)
        if item.mark(AsInFile) or key not in data:
            continue
        if like is not None and isinstance(data[key], dict) and data[key] is like.document.get(key):
            found[item.name] = getattr(like.experiment, item.name)
        else:
            found[item.name] = _value(entry, item, found, source, folder)
    provenance = entry.provenance
    if provenance is not None and provenance.urdf_sha256 is not None:
        wanted = provenance.urdf_sha256
        converting(source, "provenance.urdf_sha256", lambda: _check_hash(found["leg"].urdf, wanted))
    if data.get("patient") is None:
        found["patient"] = None
    present = {name: value for name, value in found.items() if value is not MISSING}
    return converting(source, "", lambda: Experiment(**present))


def _file_about(scenario: Any, source: str) -> Any:
    """Section of an experiment in the world that it is about."""
    kind = scenario.get("kind") if isinstance(scenario, Mapping) else None
    if scenario is None:
        return section_of(Experiment)  # which says that it is missing
    if not isinstance(kind, str):
        known = ", ".join(world_kinds())
        key, given = ("scenario.kind", kind) if isinstance(scenario, Mapping) else ("scenario", scenario)
        raise ParameterFileError(source, key, f"expected a kind of world, one of {known}, got {given!r}")
    return _section_in(converting(source, "scenario.kind", lambda: world_of(kind)))


@cache
def _section_in(world: type[Any]) -> Any:
    model: Any = create_model(
        "Experiment", __base__=section_of(Experiment), scenario=(section_of(world), ...)
    )
    model.parameters = Experiment
    return model


def _value(entry: Any, item: Any, found: Mapping[str, Any], source: str, folder: Path) -> Any:
    """Value of a field of the experiment, files that it names looked for beside it."""
    beneath = None if item.default is MISSING else item.default

    def convert() -> Any:
        if item.name == "integration":
            braced = entry.interface is not None and entry.interface.kind == "brace"
            standard = default_integration(entry.engine, found["scenario"], braced=braced)
            return None if entry.integration is None else entry.integration.convert(standard)
        value = entry.value_of(item, beneath, named=False)
        if isinstance(value, LegSource):
            value = replace(value, urdf=_beside(folder, value.urdf))
            find_urdf(value.urdf)
        if isinstance(value, NetworkParameters):
            value = replace(value, dbc=_beside(folder, value.dbc))
            try:
                find_dbc(value.dbc)
            except ParameterFileError as error:
                raise ParameterError(f"dbc: {error}") from error
        return value

    return converting(source, item.key, convert)


def _beside(folder: Path, name: str) -> str:
    """A path from the folder of the file, if there is such a file; else the name as it is."""
    return str((folder / name).resolve()) if (folder / name).is_file() else name


def _check_hash(urdf: str, wanted: str) -> None:
    found = urdf_hash(find_urdf(urdf))
    if found != wanted:
        raise ModelError(
            f"{urdf} is not the file that this experiment was made with (sha256 {found[:12]}…, expected "
            f"{wanted[:12]}…); restore it, or remove this key to run with the file as it is"
        )
