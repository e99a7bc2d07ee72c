"""Write gait tables and experiments as the mappings that their YAML files hold.

Angles and stiffnesses are written per radian, so that reading the file back gives exactly the same
numbers: a conversion from degrees could differ in the last bit.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import Any

import yaml

from twin_gait.configuration.control_modes import assistance_document, path_document
from twin_gait.configuration.control_section import safety_keys
from twin_gait.configuration.gait_table_file import SCHEMA_VERSION
from twin_gait.configuration.interface import interface_document
from twin_gait.configuration.people import patient_document
from twin_gait.experiment import Experiment, Integration
from twin_gait.gait.guards import AllOf, AnyOf, Guard
from twin_gait.gait.table import (
    SCALING_EXPONENTS,
    TICK,
    DrivenBy,
    GaitTable,
    PhaseParameters,
    Scaling,
    Transition,
    Waiver,
)
from twin_gait.leg_model import LegJoints
from twin_gait.parameters import BeltProfile, FrictionParameters
from twin_gait.scenario import BenchLegScenario, TreadmillScenario


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
        document["waive"] = [_waiver(item) for item in table.waivers]
    return {**document, "sides": sides} if sides else document


def _waiver(waiver: Waiver) -> dict[str, Any]:
    document = {
        "rule": waiver.rule,
        "phase": waiver.phase,
        "transition": waiver.transition,
        "reason": waiver.reason,
    }
    return {key: value for key, value in document.items() if value is not None}


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
    asked = experiment.integration
    return {
        "schema_version": SCHEMA_VERSION,
        "name": experiment.name,
        "duration_s": experiment.duration,
        "engine": str(experiment.engine),
        **({} if asked is None else {"integration": integration_document(asked)}),
        "seed": experiment.seed,
        **({"faults": [str(item) for item in experiment.faults]} if experiment.faults else {}),
        "patient": None if experiment.patient is None else patient_document(experiment.patient),
        "interface": interface_document(experiment.interface),
        "scenario": _scenario(experiment.scenario),
        "leg": _leg(experiment),
        "control": _control(experiment),
        "plant": _plant(experiment),
        "sensors": _sensors(experiment),
        "table": table_document(experiment.table),
    }


def integration_document(integration: Integration) -> dict[str, Any]:
    """Integrator and step as a mapping."""
    return {"method": str(integration.method), "step_s": integration.step}


def _angles(angles: tuple[float, float]) -> dict[str, float]:
    return {"hip_rad": angles[0], "knee_rad": angles[1]}


def _scenario(scenario: TreadmillScenario | BenchLegScenario) -> dict[str, Any]:
    if isinstance(scenario, BenchLegScenario):
        hand = scenario.hand
        document: dict[str, Any] = {
            "kind": "bench_leg",
            "start": _angles(scenario.start_angles),
            "start_phase": scenario.initial_phase,
        }
        if hand is not None:
            document["hand"] = {
                "joint": str(hand.joint),
                "amplitude_rad": hand.amplitude,
                "frequency_Hz": hand.frequency,
                "stiffness_Nm_per_rad": hand.stiffness,
                "damping_Nms_per_rad": hand.damping,
                "release_s": None if math.isinf(hand.release_time) else hand.release_time,
            }
        return document
    contact = scenario.contact
    return {
        "kind": "treadmill",
        "belt_speed_m_per_s": scenario.belt_speed,
        **({} if scenario.belt is None else {"belt": _belt(scenario.belt)}),
        "stop_ramp_s": None if math.isinf(scenario.stop_ramp) else scenario.stop_ramp,
        "support": {
            "share": scenario.support.share,
            "damping_Ns_per_m": scenario.support.damping,
            "catch_stiffness_N_per_m": scenario.support.catch_stiffness,
            "catch_dissipation_s_per_m": scenario.support.catch_dissipation,
        },
        "contact": {
            "stiffness_N_per_m1p5": contact.stiffness,
            "dissipation_s_per_m": contact.dissipation,
            "friction_coefficient": contact.friction_coefficient,
            "transition_velocity_m_per_s": contact.transition_velocity,
        },
        "leading": str(scenario.leading),
        "leading_start": _angles(scenario.leading_angles),
        "trailing_start": _angles(scenario.trailing_angles),
        "leading_phase": scenario.initial_phases[0],
        "trailing_phase": scenario.initial_phases[1],
    }


def _belt(belt: BeltProfile) -> dict[str, float | None]:
    stop = None if math.isinf(belt.stop) else belt.stop
    return {"start_s": belt.start, "stop_s": stop, "ramp_s": belt.ramp, "delay_s": belt.delay}


def _leg(experiment: Experiment) -> dict[str, Any]:
    source = experiment.leg
    document: dict[str, Any] = {"urdf": source.urdf}
    document |= {str(side): _joints(leg) for side, leg in source.legs.items()}
    return {**document, "fit_device": source.fit_device, "up_axis": source.up_axis}


def _joints(leg: LegJoints) -> dict[str, Any]:
    return {
        "hip": leg.hip,
        "knee": leg.knee,
        "ankle": leg.ankle,
        "contact_frames": list(leg.contact_frames),
    }


def _friction(law: FrictionParameters) -> dict[str, float]:
    return {
        "breakaway_torque_Nm": law.breakaway_torque,
        "coulomb_friction_Nm": law.coulomb_friction,
        "breakaway_velocity_rad_per_s": law.breakaway_velocity,
        "viscous_friction_Nms_per_rad": law.viscous_friction,
    }


def _control(experiment: Experiment) -> dict[str, Any]:
    control = experiment.control
    return {
        "mode": str(control.mode),
        "assistance": assistance_document(control.assistance),
        "path": path_document(control.path),
        "friction_model": {str(joint): _friction(law) for joint, law in control.friction_model.items()},
        "inertia_compensation": control.inertia_compensation,
        "target_torque_Nm": {str(joint): value for joint, value in control.target_torque.items()},
        "limits": {"torque_Nm": control.limits.torque, "current_A": control.limits.current},
        "safety": {key: getattr(control.safety, name) for name, key in safety_keys().items()},
        "patient": None if control.patient is None else patient_document(control.patient),
    }


def _plant(experiment: Experiment) -> dict[str, Any]:
    plant = experiment.plant
    battery = plant.battery
    return {
        "friction_ratio": {str(joint): value for joint, value in plant.friction_ratio.items()},
        "friction": {str(joint): _friction(law) for joint, law in plant.friction.items()},
        "load_friction": {str(joint): value for joint, value in plant.load_friction.items()},
        "actuators": {
            str(joint): {
                "torque_constant_Nm_per_A": item.torque_constant,
                "resistance_Ohm": item.resistance,
                "rotor_inertia_kgm2": item.rotor_inertia,
                "gear_ratio": item.gear_ratio,
                "gear_inertia_kgm2": item.gear_inertia,
                "gear_efficiency": item.gear_efficiency,
                "continuous_torque_Nm": item.continuous_torque,
            }
            for joint, item in plant.actuators.items()
        },
        "battery": {
            "voltage_V": battery.voltage,
            "internal_resistance_Ohm": battery.internal_resistance,
            "continuous_power_W": battery.continuous_power,
            "energy_J": battery.energy,
        },
        "stops": {
            "stiffness_Nm_per_rad": plant.stops.stiffness,
            "dissipation_s_per_rad": plant.stops.dissipation,
        },
        "ankle": {
            "stiffness_Nm_per_rad": plant.ankle.stiffness,
            "damping_Nms_per_rad": plant.ankle.damping,
        },
        "gravity_m_per_s2": plant.gravity,
    }


def _sensors(experiment: Experiment) -> dict[str, Any]:
    sensors = experiment.sensors
    return {
        "ideal": sensors.ideal,
        "encoder_counts": sensors.encoder_counts,
        "angle_noise_rad": sensors.angle_noise,
        "fast_time_constant_s": sensors.fast_time_constant,
        "decimation": sensors.decimation,
        "window": sensors.window,
    }
