"""Editors check files by the JSON Schemas: what ships passes, mistakes are found at their keys."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from twin_gait.cli import main
from twin_gait.configuration.documents import experiment_document
from twin_gait.configuration.experiments import load_experiment
from twin_gait.configuration.schema import comment_for, json_schema
from twin_gait.configuration.validation import parse_assignment

FOLDER = Path(str(files("twin_gait.configuration")))
PRESETS, DEVICES, TABLES, MODES = (
    sorted((FOLDER / name).glob("*.yaml")) for name in ("presets", "devices", "tables", "modes")
)
OWN_GAITS = sorted((FOLDER / "own_gaits").glob("*.yaml"))
KINDS = {"experiment": PRESETS, "device": DEVICES, "table": [*TABLES, *OWN_GAITS], "modes": MODES}
VALIDATORS = {kind: Draft202012Validator(json_schema(kind)) for kind in KINDS}


def mistakes(kind: str, document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Place and message of every mistake, those inside of alternatives as well."""
    found, waiting = [], list(VALIDATORS[kind].iter_errors(document))
    while waiting:
        error = waiting.pop()
        found.append((".".join(map(str, error.absolute_path)), error.message))
        waiting += error.context or []
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_schemas_are_valid_json_schemas(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets", "--schema", kind]) == 0
    Draft202012Validator.check_schema(json.loads(capsys.readouterr().out))


@pytest.mark.parametrize(
    ("kind", "path"),
    [(kind, path) for kind, paths in KINDS.items() for path in paths],
    ids=lambda item: getattr(item, "stem", item),
)
def test_shipped_files_match_their_schema_and_name_it(kind: str, path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.splitlines()[0] == comment_for(kind)
    assert mistakes(kind, yaml.safe_load(text)) == []


@pytest.mark.parametrize("name", [path.stem for path in PRESETS])
def test_complete_written_documents_match_the_schema(name: str) -> None:
    law = "{law: lugre, coulomb_friction_Nm: 4, bristle_stiffness_Nm_per_rad: 900}"
    boards = [] if name == "treadmill_ankle" else ["network=can"]  # there is none for an ankle
    loaded = load_experiment(name, [f"plant.friction.hip={law}", *boards])
    for document in (loaded.document, experiment_document(loaded.experiment)):
        assert mistakes("experiment", json.loads(json.dumps(document))) == []


# Kind of file, what is planted, and the key at which it has to be found.
PLANTED = [
    ("experiment", "patient.mass=80", "patient"),
    ("experiment", "patient.mass_kg=heavy", "patient.mass_kg"),
    ("experiment", "patient.mass_kg=200", "patient.mass_kg"),
    ("experiment", "patient.height_cm=175", "patient"),
    ("experiment", "patient.sex=other", "patient.sex"),
    ("experiment", "scenario.belt_speed_mph=1", "scenario"),
    ("experiment", "scenario.belt_speed_km_per_h=9", "scenario.belt_speed_km_per_h"),
    ("experiment", "scenario.support.share=1.2", "scenario.support.share"),
    ("experiment", "scenario.kind=moon", "scenario"),
    ("experiment", "plant.actuators.hip.gear_efficiency=0.2", "plant.actuators.hip.gear_efficiency"),
    ("experiment", "plant.friction.knee={law: lugr}", "plant.friction.knee"),
    ("experiment", "plant.ankle.rest_deg=40", "plant.ankle.rest_deg"),
    ("experiment", "control.limits.torque_Nm=-150", "control.limits.torque_Nm"),
    ("experiment", "control.mode=relaxed", "control.mode"),
    ("experiment", "control.safety.drive_time=0.02", "control.safety"),
    ("experiment", "sensors.encoder_counts=0", "sensors.encoder_counts"),
    ("experiment", "seed=1.5", "seed"),
    ("experiment", "network={kind: can, loss: 2}", "network.loss"),
    ("experiment",
     "table={extends: treadmill_guided, phases: {late_stance: {hip: {stifness_Nm_per_deg: 2}}}}",
     "table.phases.late_stance.hip"),
    ("table", "phases.early_stance.hip.stiffness_Nm_per_deg=-2",
     "phases.early_stance.hip.stiffness_Nm_per_deg"),
    ("table", "phases.early_stance.hip.stiffness_Nm_per_rad=80", "phases.early_stance.hip"),
    ("table", "phases.early_stance.hip.friction_compensation_gain=1.5",
     "phases.early_stance.hip.friction_compensation_gain"),
    ("table", "phases.early_stance.minimum_duration_s=1", "phases.early_stance"),
    ("table", "transitions[0].debounce_ms=0", "transitions.0.debounce_ms"),
    ("table", "transitions[0].all=[hip.angle_deg = 3]", "transitions.0.all.0"),
    ("table", "transitions[0].form=late_stance", "transitions.0"),
    ("table", "blending.law=sudden", "blending.law"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "planted", "location"), PLANTED, ids=[item[1] for item in PLANTED])
def test_a_planted_mistake_is_found_at_its_key(kind: str, planted: str, location: str) -> None:
    path = FOLDER / ("presets" if kind == "experiment" else "tables") / "treadmill_guided.yaml"
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert mistakes(kind, document) == []
    keys, value = parse_assignment(planted)
    inner: Any = document
    for key in keys[:-1]:
        inner = inner.setdefault(key, {}) if isinstance(inner, dict) else inner[key]
    inner[keys[-1]] = value
    assert location in [found_at for found_at, _ in mistakes(kind, document)]
