"""Conversion of gait tables and experiments to the mappings of their YAML files.

Angles and stiffnesses are written per radian, so that reading the file back gives exactly the same
numbers: a conversion from degrees could differ in the last bit.
"""

import hashlib
import json
from typing import Any

from twin_gait.configuration.custom_sections import user_controller_document
from twin_gait.configuration.events import events_document
from twin_gait.configuration.gait_table_file import SCHEMA_VERSION
from twin_gait.configuration.reference_file import reference_document
from twin_gait.configuration.sections import section_of, to_yaml
from twin_gait.experiment.experiment import Experiment
from twin_gait.experiment.own_gait import OwnGait
from twin_gait.gait.table import StateTable
from twin_gait.yaml12 import dump_yaml as dump_yaml


def content_hash(mapping: dict[str, Any]) -> str:
    """Compute the SHA-256 hash of a mapping's content, which does not depend on its layout in the file."""
    return hashlib.sha256(json.dumps(mapping, sort_keys=True).encode()).hexdigest()


# Fields of tables in the order of their files; table_document gives the keys that differ from the field's
# name.
_FIELDS = (
    "name", "description", "joints", "requests", "hold", "blending", "scaling", "phases", "transitions",
    "cycles", "postures", "waivers", "side_phases",
)  # fmt: skip


def table_document(table: StateTable) -> dict[str, Any]:
    """Convert a table of gait or of modes to its file's mapping; reading it gives an equal table."""
    keys = {"phases": f"{table.kind}s", "waivers": "waive", "side_phases": "sides"}
    given = {keys.get(name, name): getattr(table, name, ()) for name in _FIELDS}
    content = {key: to_yaml(value) for key, value in given.items() if value}
    return {"schema_version": SCHEMA_VERSION, **content}


def own_gait_document(own_gait: OwnGait) -> dict[str, Any]:
    """Convert a wearer's own gait to the mapping of a file, in SI."""
    return {"table": table_document(own_gait.table), **section_of(OwnGait).document(own_gait)}


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """Convert an experiment to its file's mapping, fully resolved; reading it gives an equal experiment."""
    document = to_yaml(experiment)
    if experiment.modes is not None:
        document["modes"] = table_document(experiment.modes)
    if experiment.own_gait is not None:
        document["own_gait"] = own_gait_document(experiment.own_gait)
    if experiment.controller is not None:
        document["controller"] = user_controller_document(experiment.controller)
    if experiment.reference is not None:
        document["reference"] = reference_document(experiment.reference)
    if experiment.events:
        document["events"] = events_document(experiment)
    return {
        "schema_version": SCHEMA_VERSION,
        **{key: value for key, value in document.items() if value != []},
        "patient": document.get("patient"),
        "table": table_document(experiment.table),
    }
