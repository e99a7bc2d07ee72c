"""Summary of a run in numbers: the content of ``summary.json``."""

import math
import platform
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cache
from importlib import metadata
from typing import Any

import numpy as np
import pandas as pd

import twin_gait
from twin_gait.configuration.identity import identify_parts, identify_wearer
from twin_gait.experiment.experiment import Experiment, IntegrationMethod
from twin_gait.files import to_json_value
from twin_gait.gait.table import TICK
from twin_gait.leg_model.anthropometry import wearer_notes
from twin_gait.measures import effort
from twin_gait.measures.crutches import TRUNK_PITCH, crutch_use, single_support
from twin_gait.measures.strides import SKIPPED_STRIDES, normalise_strides, symmetry_index
from twin_gait.report.formatting import describe
from twin_gait.report.reference import reference_measures, reference_notes
from twin_gait.runs.leg_summary import MeasuredLeg, reference_error, saturated_shares
from twin_gait.runs.stride_table import statistics_summary, stride_table
from twin_gait.simulation.log import BRACE, LOG_SCHEMA_VERSION, PELVIS_BRACE, TRUNK_BRACE, work_sources
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.simulation.simulator import simulate
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.faults import LOSSES_OF_SUPPLY, Fault, FaultKind

# Distributions whose version can change a number of a log, by their usual name.
NUMERIC_LIBRARIES = {"pinocchio": "pin", "numpy": "numpy", "scipy": "scipy", "numba": "numba"}
PELVIS_HEIGHT = "pelvis_height_m"
SYMMETRIES = ("stride_time_mean_s", "swing_share", "early_stance_lag_mean_s")


@cache
def software_versions() -> dict[str, str]:
    """Return the versions of this package, Python and the libraries that determine the numbers."""
    return {
        "twin_gait": twin_gait.__version__,
        "python": platform.python_version(),
        **{name: metadata.version(package) for name, package in NUMERIC_LIBRARIES.items()},
    }


def summarise_run(run: Run, *, skip_strides: int = SKIPPED_STRIDES) -> dict[str, Any]:
    """Summarise a run for JSON: plain values in the units that the keys state, None where not defined.

    ``skip_strides``: number of strides at the start that are not counted.
    """
    walk = run.walk_measures(skip=skip_strides)
    legs = [MeasuredLeg(run, record, skip_strides) for record in run.leg_records()]
    sides = {str(leg.record.side): leg.summary(walk.get(leg.record.side)) for leg in legs}
    table = run.strides if skip_strides == SKIPPED_STRIDES else stride_table(run, skip_strides=skip_strides)
    refused = [answer.text for answer in run.request_results if answer.rejection]
    summary = {
        "log_schema_version": LOG_SCHEMA_VERSION,
        "name": run.experiment.name,
        "engine": str(run.experiment.engine),
        **describe_identity(run.experiment),
        "versions": software_versions(),
        "duration_s": run.duration,
        "wall_s": run.wall_s,
        "realtime_factor": run.duration / run.wall_s if run.wall_s > 0.0 else math.nan,
        "status": str(run.status),
        "reason": run.reason,
        "outcome": run.verdict.outcome,
        "outcome_reason": run.verdict.reason,
        "fell": run.status is RunStatus.FELL,
        "strides_skipped": skip_strides,
        "sides": sides,
        "stride_statistics": statistics_summary(table),
        **_walk_summary(run, walk, skip_strides),
        "symmetry": _symmetry_indices(sides),
        **saturated_shares(legs),
        **battery_summary(run),
        "safety": _safety_summary(run),
        **({} if run.experiment.modes is None else {"requests_rejected": " | ".join(refused)}),
        **({} if run.traffic is None else {"network": run.traffic}),
        **supply_loss_summary(run),
        **crutch_summary(run),
        **guide_summary(run),
        **interaction_summary(run, skip_strides),
        **energy_summary(run),
    }
    found: dict[str, Any] = to_json_value(summary)
    return found


def describe_identity(experiment: Experiment) -> dict[str, Any]:
    """Return the description of an experiment, and wearer, table, device and controller with their hashes.

    A controller of the user also has its module, its class and the hash of its source.
    """
    patient, controller = experiment.patient, experiment.controller
    wearer = None
    if patient is not None:
        wearer = {**asdict(identify_wearer(patient)), "mass_kg": patient.mass, "height_m": patient.height}
        wearer["name"] = patient.name
        notes = wearer_notes(patient, experiment.leg.heaviest_wearer)
        wearer["notes"] = " ".join([*notes, *reference_notes(experiment)])
    parts = {key: asdict(part) for key, part in identify_parts(experiment).items()}
    if controller is not None:
        parts["controller"] |= controller.summary
    return {"description": " · ".join(describe(experiment)), "patient": wearer, **parts}


def _symmetry_indices(sides: Mapping[str, Mapping[str, Any]]) -> dict[str, float] | None:
    """Return the symmetry indices of the two legs, or None for one leg."""
    if len(sides) < 2:
        return None
    left, right = sides[Side.LEFT], sides[Side.RIGHT]
    return {name: symmetry_index(left[name], right[name]) for name in SYMMETRIES if name in left}


def _walk_summary(run: Run, legs: Mapping[Side, Mapping[str, float]], skip: int) -> dict[str, Any]:
    """Return the power of a walk and the measures of healthy walking; empty without a walkway."""
    power = run.walk_power(skip=skip, legs=legs)
    if power is None:
        return {}
    return {"walk_reference": reference_measures(run.experiment), "power": power}


def battery_summary(run: Run) -> dict[str, float]:
    """Compute the use of the battery in a run, and the battery life in [h] at its mean power."""
    battery = run.experiment.plant.battery
    use = effort.battery_use(np.asarray(run.columns["battery_power_W"]), TICK, battery.continuous_power)
    return {
        **{f"battery_{name}": value for name, value in use.items()},
        "battery_capacity_Wh": battery.energy / 3600.0,
        "battery_life_h": effort.battery_life(battery.energy, use["power_mean_W"]) / 3600.0,
    }


def energy_summary(run: Run) -> dict[str, Any]:
    """Compute the balance of the energy of a run with the work of all sources, and judge its step by it.

    ``step_stable`` is false if the residual shows that the step was too large for Runge-Kutta; None for the
    Euler method, whose residual is larger at any step, and for an empty log.
    """
    log, integration = run.columns, run.experiment.resolved_integration
    works = np.array([np.asarray(log[f"{source}_work_J"]) for source in work_sources(log)])
    energy = np.asarray(log["kinetic_energy_J"] + log["potential_energy_J"])
    balance: dict[str, Any] = effort.energy_balance(energy, works)
    residual, runge_kutta = balance["energy_residual_share"], integration.method is IntegrationMethod.RK4
    stable = residual <= effort.LARGEST_RESIDUAL if runge_kutta and math.isfinite(residual) else None
    return {**balance, "step_s": integration.step, "step_stable": stable}


def _safety_summary(run: Run) -> dict[str, Any]:
    """Return the state and the trip of the safety monitor, and the faults of the experiment as text."""
    trip = run.trip
    return {
        "watched": run.experiment.control.safety.enabled,
        "tripped": trip is not None,
        "cause": None if trip is None else str(trip.cause),
        "location": None if trip is None else trip.location,
        "time_s": None if trip is None else trip.time,
        "faults": " ".join(str(item) for item in run.experiment.faults),
    }


def supply_loss_summary(run: Run) -> dict[str, Any]:
    """Compute the descent of the pelvis after a loss of the supply; empty without one or with a fixed pelvis.

    A run with shorted windings is repeated with open ones to measure the effect of the braking.
    """
    losses = [item for item in run.experiment.faults if item.kind in LOSSES_OF_SUPPLY]
    first = min(losses, key=lambda item: item.time, default=None)
    if first is None or PELVIS_HEIGHT not in run.log or first.time >= run.duration:
        return {}
    shorted = first.kind is FaultKind.SUPPLY_LOSS_SHORTED
    return {
        "supply_loss": {
            "windings": "shorted" if shorted else "open",
            "time_s": first.time,
            **_measure_descent(run, first),
            "with_open_windings": _descend_with_open_windings(run, first) if shorted else None,
        }
    }


def _measure_descent(run: Run, loss: Fault) -> dict[str, Any]:
    """Return the highest speed in [m/s] at which the pelvis sinks after a loss, its place, and the end."""
    log = run.log[run.log["time_s"] >= loss.time]
    heights, speeds = log[PELVIS_HEIGHT].to_numpy(), -log["pelvis_velocity_m_per_s"].to_numpy()
    fastest = int(np.argmax(speeds))
    return {
        "status": str(run.status),
        "lasted_s": run.duration - loss.time,
        "sinking_peak_m_per_s": float(speeds[fastest]),
        "sinking_peak_height_m": float(heights[fastest]),
        "pelvis_lowest_m": float(heights.min()),
    }


def _descend_with_open_windings(run: Run, loss: Fault) -> dict[str, Any]:
    """Return the descent of the same run with open windings."""
    opened = Fault(kind=FaultKind.SUPPLY_LOSS_OPEN, time=loss.time)
    faults = tuple(opened if item == loss else item for item in run.experiment.faults)
    return _measure_descent(simulate(replace(run.experiment, faults=faults)), opened)


def interaction_summary(run: Run, skip_strides: int = SKIPPED_STRIDES) -> dict[str, Any]:
    """Compute the loads of the braces between device and wearer, and their relative motion."""
    if run.experiment.interface is None or len(run.log) == 0:
        return {}
    log, interaction = run.log, dict[str, dict[str, float]]()
    angle, *_, torque = BRACE.columns
    height, _, force = PELVIS_BRACE.columns
    for side in run.sides:
        for name in (f"{side}_{joint}" for joint in JointName if f"{side}_{joint}_{torque}" in log):
            rms, peak, apart = _brace_measures(
                log, f"{name}_{torque}", f"{name}_angle_rad", f"{name}_{angle}"
            )
            motion = math.degrees(apart)
            interaction[name] = {"torque_rms_Nm": rms, "torque_peak_Nm": peak, "motion_peak_deg": motion}
        device = run.leg_record(side, device=True)
        for joint, angles in device.angles.items():
            cycles = normalise_strides(angles, device.strides(skip=skip_strides))
            error = reference_error(run, cycles, joint)
            interaction[f"{side}_{joint}"]["rmse_of_device_deg"] = error
    if force in log:
        rms, peak, apart = _brace_measures(log, force, "pelvis_height_m", height)
        interaction["pelvis"] = {"force_rms_N": rms, "force_peak_N": peak, "motion_peak_mm": 1e3 * apart}
    pitch, *_, moment = TRUNK_BRACE.columns
    if moment in log:
        rms, peak, apart = _brace_measures(log, moment, TRUNK_PITCH, pitch)
        motion = math.degrees(apart)
        interaction["trunk"] = {"torque_rms_Nm": rms, "torque_peak_Nm": peak, "motion_peak_deg": motion}
    return {"interaction": interaction}


def _brace_measures(log: pd.DataFrame, load: str, device: str, wearer: str) -> tuple[float, float, float]:
    """Return RMS and peak of a brace's load, and the peak distance of its ends; arguments are columns."""
    values, apart = log[load].to_numpy(), (log[device] - log[wearer]).to_numpy()
    return effort.root_mean_square(values), float(np.abs(values).max()), float(np.abs(apart).max())


def guide_summary(run: Run) -> dict[str, Any]:
    """Compute the moment of guide or harness on a pelvis on the belt, and the pitch of one in straps."""
    pelvis = run.experiment.scenario.pelvis
    if pelvis in (PelvisGuide.FIXED, PelvisGuide.FREE) or len(run.log) == 0:
        return {}
    log = run.log
    found = _extremes("moment", "Nm", log["guide_moment_Nm"].to_numpy())
    if pelvis is PelvisGuide.STRAPS:
        pitch = log.get(next(iter(TRUNK_BRACE.columns)), log[TRUNK_PITCH])
        found |= _extremes("pitch", "deg", np.degrees(pitch.to_numpy()))
    return {"guide": found}


def _extremes(name: str, unit: str, values: np.ndarray) -> dict[str, float]:
    rms, low, high = effort.root_mean_square(values), float(values.min()), float(values.max())
    return {f"{name}_rms_{unit}": rms, f"{name}_lowest_{unit}": low, f"{name}_highest_{unit}": high}


def crutch_summary(run: Run) -> dict[str, Any]:
    """Compute distance, lean and use of the arms for a run with a free trunk; empty for any other pelvis.

    The run is repeated without crutches to measure the contribution of the arms.
    """
    if run.experiment.scenario.pelvis is not PelvisGuide.FREE or len(run.log) == 0:
        return {}
    log = run.log
    way = float(log["pelvis_forward_m"].iloc[-1] - log["pelvis_forward_m"].iloc[0])
    lean = log[TRUNK_PITCH]
    energy = float(log["battery_power_W"].sum()) * TICK
    uses = {str(side): crutch_use(log, side, TICK, run.body_weight) for side in run.sides}
    return {
        "free_trunk": {
            "distance_m": way,
            "speed_m_per_s": way / run.duration,
            "lean_lowest_deg": math.degrees(float(lean.min())),
            "lean_highest_deg": math.degrees(float(lean.max())),
            "battery_energy_per_metre_J": energy / way if way > 0.0 else None,
            "arms": {side: use for side, use in uses.items() if use is not None},
            "single_support": _single_support(run),
            "without_arms": _simulate_without_crutches(run),
        }
    }


def _single_support(run: Run) -> dict[str, float] | None:
    """Return the support by crutches on one foot; None without crutches or a wearer."""
    crutches, patient = getattr(run.experiment.scenario, "crutches", None), run.experiment.patient
    if crutches is None or patient is None:
        return None
    return single_support(
        run.log,
        TICK,
        height=patient.height,
        tip_aside=crutches.tip_aside,
        gravity=run.experiment.plant.gravity,
    )


def _simulate_without_crutches(run: Run) -> dict[str, Any] | None:
    """Return status, reason and duration of the same run without crutches; None without crutches."""
    world = run.experiment.scenario.remove_aids()
    if world is None:
        return None
    bare = simulate(replace(run.experiment, scenario=world))
    return {"status": str(bare.status), "reason": bare.reason, "duration_s": bare.duration}
