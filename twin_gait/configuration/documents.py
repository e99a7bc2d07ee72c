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
from twin_gait.gait import GaitTable, ModeTable
from twin_gait.parameters.quantities import Parameters


def dump_yaml(mapping: dict[str, Any]) -> str:
    """Write a mapping as YAML, keys in their own order."""
    return yaml.safe_dump(mapping, sort_keys=False, allow_unicode=True, width=110)


def content_hash(mapping: dict[str, Any]) -> str:
    """SHA-256 of a mapping's content, whatever its layout in the file."""
    return hashlib.sha256(json.dumps(mapping, sort_keys=True).encode()).hexdigest()


def table_document(table: GaitTable | ModeTable) -> dict[str, Any]:
    """A table of gait or of modes as its file's mapping; reading it gives an equal table."""
    rest: dict[str, Any] = {"waive": [_document(item) for item in table.waivers]}
    if isinstance(table, ModeTable):
        own = {"requests": list(table.requests), "hold": table.hold, "modes": _by_name(table.phases)}
    else:
        own = {"blending": _document(table.blending), "scaling": _document(table.scaling)}
        own["phases"] = _by_name(table.phases)
        sides = {str(side): _by_name(phases) for side, phases in table.side_phases.items()}
        cycles = [list(cycle) for cycle in table.cycles]
        rest = {"cycles": cycles, "postures": list(table.postures), **rest, "sides": sides}
    return {
        "schema_version": SCHEMA_VERSION,
        "name": table.name,
        "description": table.description,
        "joints": list(table.joints),
        **own,
        "transitions": [_document(item) for item in table.transitions],
        **{key: value for key, value in rest.items() if value},
    }


def _document(item: Parameters) -> dict[str, Any]:
    document: dict[str, Any] = section_of(type(item)).document(item)
    return document


def _by_name(items: Mapping[str, Parameters]) -> dict[str, Any]:
    return {name: _document(item) for name, item in items.items()}


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """An experiment as its file's mapping, everything resolved; reading it gives an equal experiment."""
    document = _document(experiment)
    if experiment.network is None:
        del document["network"]
    lists = {name: listed for name in ("faults", "requests") if (listed := document.pop(name))}
    modes = {} if experiment.modes is None else {"modes": table_document(experiment.modes)}
    return {
        "schema_version": SCHEMA_VERSION,
        **document,
        **lists,
        **modes,
        "patient": document.get("patient"),
        "table": table_document(experiment.table),
    }
