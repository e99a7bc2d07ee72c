"""Experiments as YAML: the section of an experiment, with its gait table, and its conversion to SI."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import create_model

from twin_gait.configuration.gait_table_file import gait_table_from_mapping, mode_table_from_mapping
from twin_gait.configuration.readers import section_of, type_of
from twin_gait.configuration.validation import converting, short, validate
from twin_gait.exceptions import ParameterFileError
from twin_gait.experiment import Engine, Experiment, default_integration
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.network.dbc import find_dbc
from twin_gait.parameters.quantities import declarations
from twin_gait.worlds import world_of


@dataclass(frozen=True)
class LoadedExperiment:
    """An experiment and the resolved mapping that it came from."""

    experiment: Experiment  # the experiment
    document: dict[str, Any]  # everything resolved, units as typed


def experiment_from_mapping(
    data: dict[str, Any], source: str, folder: Path, like: LoadedExperiment | None = None
) -> Experiment:
    """Turn a resolved mapping (presets merged, table inline) into an experiment.

    ``folder``: where relative paths start. ``like``: one turned before, whose very same sections are not
    converted again, which takes most of the time.
    """
    known = {} if like is None else _known(data, like)
    entry: Any = validate(_file_about(data.get("scenario"), source), {**data, **known}, source)
    found: dict[str, Any] = entry.values()
    # A table without a name has the experiment's.
    if like is not None and entry.name == like.experiment.name and data["table"] is like.document["table"]:
        found["table"] = like.experiment.table
    else:
        found["table"] = gait_table_from_mapping(entry.table, f"{source}: table", entry.name)
    if entry.modes is not None:
        found["modes"] = mode_table_from_mapping(entry.modes, f"{source}: modes", entry.name)
    if entry.integration is not None:
        braced, engine = found.get("interface") is not None, found.get("engine", Engine.COMPILED)
        standard, own = default_integration(engine, entry.scenario, braced=braced), entry.integration.values()
        found["integration"] = converting(source, "integration", lambda: replace(standard, **own))
    if data.get("patient") is None:
        found["patient"] = None
    _find_files(found, source, folder)
    urdf, wanted = found["leg"].urdf, (entry.provenance or {}).get("urdf_sha256")
    if wanted is not None and wanted != urdf_hash(find_urdf(urdf)):
        problem = f"{urdf} is not the file that this experiment was made with; restore it, or remove this key"
        raise ParameterFileError(source, "provenance.urdf_sha256", problem)
    return converting(source, "", lambda: Experiment(**found))


def _known(data: Mapping[str, Any], like: LoadedExperiment) -> dict[str, Any]:
    """Sections that are the very same as in another mapping, as they were converted there."""
    return {
        item.key: getattr(like.experiment, item.name)
        for item in declarations(Experiment)
        if item.key not in ("table", "modes", "integration")
        and isinstance(data.get(item.key), dict)
        and data[item.key] is like.document.get(item.key)
    }


def _file_about(scenario: Any, source: str) -> Any:
    """Section of an experiment in the world that it is about."""
    if scenario is None:
        return section_of(Experiment)  # which says what is missing
    kind = scenario.get("kind") if isinstance(scenario, Mapping) else scenario
    name = kind if isinstance(kind, str) else short(kind)
    return _section_in(converting(source, "scenario.kind", lambda: world_of(name)))


@cache
def _section_in(world: type[Any]) -> Any:
    return create_model("Experiment", __base__=section_of(Experiment), scenario=(type_of(world), ...))


def _find_files(found: dict[str, Any], source: str, folder: Path) -> None:
    """Look for the files that an experiment names, beside its own file first."""
    leg = found["leg"] = replace(found["leg"], urdf=_beside(folder, found["leg"].urdf))
    converting(source, "leg", lambda: find_urdf(leg.urdf))
    if found.get("network") is not None:
        network = found["network"] = replace(found["network"], dbc=_beside(folder, found["network"].dbc))
        find_dbc(network.dbc)


def _beside(folder: Path, name: str) -> str:
    """A path from the folder of the file, if there is such a file; else the name as it is."""
    return str((folder / name).resolve()) if (folder / name).is_file() else name
