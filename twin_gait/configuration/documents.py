"""Write gait tables and experiments as the mappings that their YAML files hold.

Angles and stiffnesses are written per radian, so that reading the file back gives exactly the same
numbers: a conversion from degrees could differ in the last bit.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import yaml

from twin_gait.configuration.gait_table_file import SCHEMA_VERSION
from twin_gait.configuration.readers import section_of
from twin_gait.experiment import Experiment
from twin_gait.gait.modes import Mode, ModeTable
from twin_gait.gait.table import Blending, GaitTable, PhaseParameters, Scaling, Transition, Waiver


def dump_yaml(mapping: dict[str, Any]) -> str:
    """Write a mapping as YAML, keys in their own order."""
    return yaml.safe_dump(mapping, sort_keys=False, allow_unicode=True, width=110)


def content_hash(mapping: dict[str, Any]) -> str:
    """SHA-256 of a mapping's content, whatever its layout in the file."""
    return hashlib.sha256(json.dumps(mapping, sort_keys=True).encode()).hexdigest()


def table_document(table: GaitTable) -> dict[str, Any]:
    """A gait table as its file's mapping; reading it gives an equal table."""
    own: dict[str, Any] = {
        "blending": section_of(Blending).document(table.blending),
        "scaling": section_of(Scaling).document(table.scaling),
        "phases": _phases(table.phases),
    }
    rest: dict[str, Any] = {}
    if table.cycles:
        rest["cycles"] = [list(cycle) for cycle in table.cycles]
    if table.postures:
        rest["postures"] = list(table.postures)
    sides = {str(side): _phases(phases) for side, phases in table.side_phases.items()}
    return _document(table, own, rest) | ({"sides": sides} if sides else {})


def mode_document(table: ModeTable) -> dict[str, Any]:
    """A table of modes as its file's mapping; reading it gives an equal table."""
    modes = {name: section_of(Mode).document(mode) for name, mode in table.phases.items()}
    return _document(table, {"requests": list(table.requests), "hold": table.hold, "modes": modes}, {})


def _document(table: GaitTable | ModeTable, own: dict[str, Any], rest: dict[str, Any]) -> dict[str, Any]:
    """What both kinds of tables have, around what is their own."""
    document = {
        "schema_version": SCHEMA_VERSION,
        "name": table.name,
        "description": table.description,
        "joints": list(table.joints),
        **own,
        "transitions": [section_of(Transition).document(item) for item in table.transitions],
        **rest,
    }
    if table.waivers:
        document["waive"] = [section_of(Waiver).document(item) for item in table.waivers]
    return document


def _phases(phases: Mapping[str, PhaseParameters]) -> dict[str, Any]:
    return {name: section_of(PhaseParameters).document(phase) for name, phase in phases.items()}


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """An experiment as its file's mapping, everything resolved; reading it gives an equal experiment."""
    document = section_of(Experiment).document(experiment)
    if experiment.network is None:
        del document["network"]
    lists = {name: listed for name in ("faults", "requests") if (listed := document.pop(name))}
    modes = {} if experiment.modes is None else {"modes": mode_document(experiment.modes)}
    return {
        "schema_version": SCHEMA_VERSION,
        **document,
        **lists,
        **modes,
        "patient": document.get("patient"),
        "table": table_document(experiment.table),
    }
