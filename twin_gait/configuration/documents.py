"""Write gait tables and experiments as the mappings that their YAML files hold.

Angles and stiffnesses are written per radian, so that reading the file back gives exactly the same
numbers: a conversion from degrees could differ in the last bit.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

import yaml

from twin_gait.configuration.device_sections import ControlEntry, PlantEntry, interface_document
from twin_gait.configuration.experiment_file import IntegrationEntry, SensorsEntry
from twin_gait.configuration.gait_table_file import SCHEMA_VERSION, WaiverEntry
from twin_gait.configuration.network_section import NetworkEntry
from twin_gait.configuration.people import PatientEntry
from twin_gait.configuration.scenario_section import LegEntry, section_of_world
from twin_gait.experiment import Experiment
from twin_gait.gait.guards import AllOf, AnyOf, Guard
from twin_gait.gait.table import (
    SCALING_EXPONENTS,
    TICK,
    DrivenBy,
    GaitTable,
    PhaseParameters,
    Scaling,
    Transition,
)


def dump_yaml(mapping: dict[str, Any]) -> str:
    """Write a mapping as YAML, keys in their own order."""
    return yaml.safe_dump(mapping, sort_keys=False, allow_unicode=True, width=110)


def content_hash(mapping: dict[str, Any]) -> str:
    """SHA-256 of a mapping's content, whatever its layout in the file."""
    return hashlib.sha256(json.dumps(mapping, sort_keys=True).encode()).hexdigest()


def table_document(table: GaitTable) -> dict[str, Any]:
    """A gait table as its file's mapping.

    Args:
        table: The table.

    Returns:
        The mapping; reading it gives an equal table.
    """
    document: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "name": table.name,
        "description": table.description,
        "joints": list(table.joints),
        "blending": {"law": str(table.blending.law), "duration_ms": table.blending.duration_ticks},
        "scaling": _scaling(table),
        "phases": {name: _phase(phase) for name, phase in table.phases.items()},
        "transitions": [_transition(item) for item in table.transitions],
    }
    sides = {
        str(side): {name: _phase(phase) for name, phase in phases.items()}
        for side, phases in table.side_phases.items()
    }
    if table.cycles:
        document["cycles"] = [list(cycle) for cycle in table.cycles]
    if table.waivers:
        document["waive"] = [
            {key: value for key, value in WaiverEntry.document(item).items() if value is not None}
            for item in table.waivers
        ]
    return {**document, "sides": sides} if sides else document


def _scaling(table: GaitTable) -> dict[str, Any]:
    law = table.scaling
    document: dict[str, Any] = {"stance_phases": list(law.stance_phases)}
    if law.carried_mass is not None:
        document["carried_mass_kg"] = law.carried_mass
    if law.height is not None:
        document["height_m"] = law.height
    if law.speed is not None:
        document |= {"speed_m_per_s": law.speed}
    if law.speed is not None or law.height is not None:
        document["hip_centre_rad"] = law.hip_centre
    usual = Scaling()
    for name in SCALING_EXPONENTS:
        if getattr(law, name) != getattr(usual, name):
            document[name] = getattr(law, name)
    return document


def _phase(phase: PhaseParameters) -> dict[str, Any]:
    document: dict[str, Any] = {}
    for name, joint in phase.joints.items():
        entry = {"stiffness_Nm_per_rad": joint.stiffness}
        if joint.damping is not None:
            entry["damping_Nms_per_rad"] = joint.damping
        if joint.damping_ratio is not None:
            entry["damping_ratio"] = joint.damping_ratio
        entry["equilibrium_rad"] = joint.equilibrium_angle
        entry["friction_compensation_gain"] = joint.friction_compensation_gain
        document[name] = entry
    document["gravity_compensation"] = phase.gravity_compensation
    document["minimum_duration_ms"] = phase.minimum_ticks
    return document


def _transition(item: Transition) -> dict[str, Any]:
    document: dict[str, Any] = {"from": item.source, "to": item.target, "cause": item.cause}
    document["debounce_ms"] = item.debounce_ticks
    if isinstance(item.guard, AllOf) and item.guard.guards:
        document["all"] = [_guard(inner) for inner in item.guard.guards]
    elif isinstance(item.guard, AnyOf):
        document["any"] = [_guard(inner) for inner in item.guard.guards]
    elif not isinstance(item.guard, AllOf):
        document["all"] = [_guard(item.guard)]
    if item.time_out_ticks is not None:
        document["after_s"] = round(item.time_out_ticks * TICK, 3)
    if item.driven_by is not DrivenBy.JOINT:
        document["driven_by"] = str(item.driven_by)
    return document


def _guard(guard: Guard) -> Any:
    if isinstance(guard, AllOf):
        return {"all": [_guard(inner) for inner in guard.guards]}
    if isinstance(guard, AnyOf):
        return {"any": [_guard(inner) for inner in guard.guards]}
    return str(guard)


def experiment_document(experiment: Experiment) -> dict[str, Any]:
    """An experiment as its file's mapping, everything resolved.

    Args:
        experiment: The experiment.

    Returns:
        The mapping; reading it gives an equal experiment.
    """
    asked, scenario, patient = experiment.integration, experiment.scenario, experiment.patient
    network = experiment.network
    return {
        "schema_version": SCHEMA_VERSION,
        "name": experiment.name,
        "duration_s": experiment.duration,
        "engine": str(experiment.engine),
        **({} if asked is None else {"integration": IntegrationEntry.document(asked)}),
        "seed": experiment.seed,
        **({"faults": [str(item) for item in experiment.faults]} if experiment.faults else {}),
        **({} if network is None else {"network": NetworkEntry.document(network)}),
        "patient": None if patient is None else PatientEntry.document(patient),
        "interface": interface_document(experiment.interface),
        "scenario": section_of_world(scenario.kind).document(scenario),
        "leg": LegEntry.document(experiment.leg),
        "control": ControlEntry.document(experiment.control),
        "plant": PlantEntry.document(experiment.plant),
        "sensors": SensorsEntry.document(experiment.sensors),
        "table": table_document(experiment.table),
    }
