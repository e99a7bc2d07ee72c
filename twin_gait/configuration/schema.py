"""JSON Schemas of experiment and gait-table files, by which editors complete and check them."""

from itertools import combinations
from typing import Any

from twin_gait.configuration.gait_table_file import GaitTableFile, ModeTableFile, phase_section
from twin_gait.configuration.readers import section_of
from twin_gait.configuration.validation import quantity_of
from twin_gait.experiment import Experiment
from twin_gait.parameters.quantities import Word, declarations
from twin_gait.vocabulary import JointName
from twin_gait.worlds import world_kinds, world_of

DIALECT = "https://json-schema.org/draft/2020-12/schema"
# What a text of a guard looks like; which signals there are depends on the table.
_GUARD = r"^[^<>]+[<>]\s*[-+.\d][^<>]*$|^\s*(other\.phase|request)\s+in\s*\[[^\]]+\]\s*$"


def comment_for(kind: str) -> str:
    """First line of a YAML file by which editors find its schema, written beside it."""
    return f"# yaml-language-server: $schema={kind}.schema.json"


def json_schema(kind: str) -> dict[str, Any]:
    """JSON Schema of a file of an ``experiment``, a ``table`` or ``modes``; no key is required."""
    table = _table()
    if kind == "table":
        return {"$schema": DIALECT, **table, "title": "gait table of twin_gait"}
    modes = _modes(table["$defs"])
    if kind == "modes":
        return {"$schema": DIALECT, **modes, "title": "operating modes of twin_gait"}
    schema: dict[str, Any] = _lenient(section_of(Experiment).model_json_schema())
    defined = schema["$defs"] | modes.pop("$defs") | table.pop("$defs")
    worlds = []
    for kind_of_world in world_kinds():
        world = _lenient(section_of(world_of(kind_of_world)).model_json_schema())
        defined |= world.pop("$defs", {})
        worlds.append(world)
    name = {"type": "string", "minLength": 1}
    person = defined["Patient"]
    person["properties"]["preset"] = name
    defined["GaitTable"], defined["ModeTable"] = table, modes
    schema["properties"] |= {
        "preset": name,
        "patient": {"anyOf": [name, {"$ref": "#/$defs/Patient"}, {"type": "null"}]},
        "table": {"anyOf": [name, {"$ref": "#/$defs/GaitTable"}]},
        "modes": {"anyOf": [name, {"$ref": "#/$defs/ModeTable"}, {"type": "null"}]},
        "scenario": {"anyOf": worlds},
    }
    for item in declarations(Experiment):
        word = item.mark(Word)
        if word:
            schema["properties"][item.key]["anyOf"].append({"enum": [word.without, word.kind]})
    return {"$schema": DIALECT, **schema, "title": "experiment of twin_gait", "$defs": defined}


def _table() -> dict[str, Any]:
    schema: dict[str, Any] = _lenient(GaitTableFile.model_json_schema())
    phase = _lenient(phase_section(tuple(map(str, JointName))).model_json_schema())
    defined = schema["$defs"] | phase.pop("$defs")
    by_name = {"type": "object", "additionalProperties": {"$ref": "#/$defs/Phase"}}
    guards = {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/Guard"}}
    defined["Phase"] = phase
    defined["Guard"] = {
        "anyOf": [
            {"type": "string", "pattern": _GUARD},
            {"type": "object", "properties": {"all": guards, "any": guards}, "maxProperties": 1,
             "additionalProperties": False},
        ]
    }  # fmt: skip
    defined["Transition"]["properties"] |= {"all": guards, "any": guards}
    sides = {
        "type": "object",
        "properties": {"left": by_name, "right": by_name},
        "additionalProperties": False,
    }
    schema["properties"] |= {"extends": {"type": "string"}, "phases": by_name, "sides": sides}
    return {**schema, "$defs": defined}


def _modes(defined: dict[str, Any]) -> dict[str, Any]:
    """Schema of a table of modes, its guards as those of a gait table."""
    schema: dict[str, Any] = _lenient(ModeTableFile.model_json_schema())
    shared = {name: defined[name] for name in ("Guard", "Transition")}
    return {**schema, "$defs": schema["$defs"] | shared}


def _lenient(schema: Any) -> Any:
    """The same without required keys; of the keys of a quantity in several units one at most may be given."""
    if isinstance(schema, list):
        return [_lenient(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    found = {
        key: _lenient(value)
        for key, value in schema.items()
        if key != "required" or not isinstance(value, list)
    }
    keys = schema.get("properties", {})
    pairs = [list(pair) for pair in combinations(keys, 2) if len(set(map(quantity_of, pair))) == 1]
    return found | ({"allOf": [{"not": {"required": pair}} for pair in pairs]} if pairs else {})
