"""JSON Schemas of experiment and gait-table files, which editors use to complete and check them."""

from collections.abc import Callable
from functools import reduce
from itertools import combinations
from operator import or_
from typing import Annotated, Any

from pydantic import Field, create_model

from twin_gait.configuration.custom_sections import section_of
from twin_gait.configuration.device_file import SECTIONS, DeviceFile
from twin_gait.configuration.gait_table_file import GaitTableFile, ModeTableFile, phase_section
from twin_gait.configuration.reference_file import ReferenceFiles, ReferenceSection
from twin_gait.configuration.validation import quantity_of
from twin_gait.experiment.device import DeviceIdentity
from twin_gait.experiment.experiment import Experiment
from twin_gait.experiment.own_gait import OwnGait
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.registry import find_world, world_kinds

DIALECT = "https://json-schema.org/draft/2020-12/schema"
# Pattern of the text of a guard; the available signals depend on the table.
_GUARD = r"^[^<>]+[<>]\s*[-+.\d][^<>]*$|^\s*(other\.phase|request)\s+in\s*\[[^\]]+\]\s*$"


def comment_for(kind: str) -> str:
    """Return the first line of a YAML file by which editors find its schema in the same folder."""
    return f"# yaml-language-server: $schema={kind}.schema.json"


def json_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of the files of a :data:`KINDS`; no key is required."""
    schema: dict[str, Any] = _lenient(KINDS[kind]().model_json_schema())
    if kind == "device":
        return {"$schema": DIALECT, **schema, "title": "device of twin_gait"}
    if kind == "experiment":  # a policy may also be named
        policy = schema["$defs"]["ControlParameters"]["properties"]["policy"]
        policy["anyOf"].insert(0, {"type": "string", "minLength": 1})
    guards = {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/Guard"}}
    nested = {"type": "object", "properties": {"all": guards, "any": guards}, "maxProperties": 1}
    text = {"type": "string", "pattern": _GUARD}
    schema["$defs"]["Guard"] = {"anyOf": [text, {**nested, "additionalProperties": False}]}
    schema["$defs"]["Transition"]["properties"] |= {"all": guards, "any": guards}
    return {"$schema": DIALECT, **schema, "title": f"{kind} of twin_gait"}


def _device() -> Any:
    """Return the model of a device with explicit sections; null removes an inherited entry."""
    sections: Any = {key: (dict[str, Any] | section_of(kind), {}) for key, kind in SECTIONS.items()}
    return create_model("Device", __base__=DeviceFile, **sections)


def _table() -> Any:
    """Return the model of a gait table with explicit phases, for all joints that may have a drive."""
    phases: Any = dict[str, phase_section(tuple(map(str, JointName)))]  # type: ignore[misc]
    more: dict[str, Any] = {"phases": (phases, ...), "sides": (dict[Side, phases], {})}
    return create_model("GaitTable", __base__=GaitTableFile, extends=(str, ""), **more)


def _experiment() -> Any:
    """Return the model of an experiment with explicit sections for all parts that may be named instead."""
    name: Any = Annotated[str, Field(min_length=1)]
    own_gait = create_model("OwnGait", __base__=section_of(OwnGait), table=(name | _table(), ...))
    person = create_model(
        "Person", __base__=section_of(Patient), preset=(name, ""), own_gait=(name | own_gait | None, None)
    )
    worlds = reduce(or_, (section_of(find_world(kind)) for kind in world_kinds()))
    return create_model(
        "Experiment",
        __base__=section_of(Experiment),
        preset=(name, ""),
        scenario=(name | worlds, ...),
        device=(name | section_of(DeviceIdentity), ...),
        patient=(name | person | None, None),
        own_gait=(name | own_gait | _table() | None, None),
        table=(name | _table(), ...),
        modes=(name | ModeTableFile | None, None),
        reference=(name | list[name] | ReferenceFiles | ReferenceSection | None, None),
    )


def _lenient(schema: Any) -> Any:
    """Remove required keys, and allow at most one of the keys of a quantity with several units."""
    if isinstance(schema, list):
        return [_lenient(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    found = {key: _lenient(value) for key, value in schema.items() if key != "required"}
    keys = schema.get("properties", {})
    pairs = [list(pair) for pair in combinations(keys, 2) if len(set(map(quantity_of, pair))) == 1]
    return found | ({"allOf": [{"not": {"required": pair}} for pair in pairs]} if pairs else {})


# Models of the files, by their kind.
KINDS: dict[str, Callable[[], Any]] = {
    "experiment": _experiment,
    "device": _device,
    "table": _table,
    "modes": lambda: ModeTableFile,
}
