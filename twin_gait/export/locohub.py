"""Strides of a walk in the format of LocoHub, which :mod:`twin_gait.measures.locohub` describes."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait.exceptions import ParameterError
from twin_gait.export.inverse_dynamics import device_moment, joint_moments
from twin_gait.files import write_parquet
from twin_gait.gait.table import TICK
from twin_gait.measures import locohub
from twin_gait.measures.ground_strides import ground_speeds
from twin_gait.measures.leg_record import wearer_column
from twin_gait.measures.locohub import CONTRA, IPSI, MOTIONS, PHASE, POINTS
from twin_gait.measures.strides import PERCENT, normalise_strides, stride_times
from twin_gait.simulation.run import Run
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.world import World

LEVEL, INCLINE, DECLINE = "level_walking", "incline_walking", "decline_walking"
_SIGNAL = "{}_{}_{{}}_{}"  # motion, quantity, limb, unit
Limbs = Mapping[Side, Mapping[str, np.ndarray]]  # signals of a limb by column, with {} for the limb


def export_locohub(run: Run, path: str | Path) -> None:
    """Write all strides of a run from heel strike to heel strike, those of the left limb first.

    The file has angles and velocities of the wearer's joints, joint moments and moments of the device per
    mass of the wearer, and ground forces over the weight of the wearer; without a wearer, mass and weight are
    those of the device. Raises ParameterError if the legs do not walk on ground, or make no whole stride.
    """
    records = run.leg_records()
    if any(record.contacts is None for record in records):
        text = "expected a walk on ground, because strides of LocoHub begin at heel strikes"
        raise ParameterError(f"{run.experiment.name}: {text}")
    experiment, world = run.experiment, run.experiment.build_world()
    patient, walking = experiment.patient, experiment.scenario.walking
    mass = run.body_weight / experiment.plant.gravity if patient is None else patient.mass
    bounds = {record.side: record.strides(skip=0) for record in records}
    height = {} if patient is None else {"height_m": f"{patient.height:g}"}
    slope = 0.0 if walking is None else math.degrees(walking.slope)
    spans = np.concatenate(list(bounds.values()))
    speeds = ground_speeds(run.columns, spans, TICK)
    speed = np.average(speeds, weights=np.diff(spans)[:, 0]) if len(spans) else math.nan
    facts = {
        "speed_m_s": f"{speed:.3f}",
        "treadmill": str(experiment.scenario.kind == "treadmill").lower(),
        "incline_deg": f"{slope:g}",
    }
    table = stride_table(
        {record.side: _limb_signals(run, world, record.side, mass) for record in records},
        bounds,
        subject=experiment.name if patient is None or patient.name is None else patient.name,
        metadata={**height, "weight_kg": f"{mass:g}"},
        task=LEVEL if slope == 0.0 else INCLINE if slope > 0.0 else DECLINE,
        facts=facts,
    )
    if table.empty:
        raise ParameterError(f"{experiment.name}: has no whole stride; expected a longer walk")
    write_parquet(Path(path), table)


def stride_table(
    limbs: Limbs, bounds: Mapping[Side, np.ndarray], *, subject: str, metadata: Mapping[str, str], task: str,
    facts: Mapping[str, str],
) -> pd.DataFrame:  # fmt: skip
    """Return strides as a table of LocoHub with 150 rows for each stride.

    ``limbs``: signals of each limb at every tick. ``bounds``: first tick of each stride of a limb and of the
    next one, shape ``(n, 2)``. ``facts``: parameters of the task, to which the side is added.
    """
    parts = []
    for side, strides in bounds.items():
        count = len(strides) * POINTS
        columns: dict[str, Any] = {
            locohub.SUBJECT: [subject] * count,
            locohub.METADATA: [_pairs(metadata)] * count,
            locohub.TASK: [task] * count,
            locohub.TASK_ID: [task] * count,
            locohub.TASK_INFO: [_pairs({"leg": str(side)[0], **facts})] * count,
            locohub.STEP: np.repeat(np.arange(1, len(strides) + 1), POINTS),
            locohub.PHASE_COLUMN: np.tile(PHASE, len(strides)),
            locohub.PHASE_RATE: np.repeat(PERCENT[-1] / stride_times(strides, TICK), POINTS),
        }
        for limb_side, signals in limbs.items():
            limb = IPSI if limb_side is side else CONTRA
            for name, signal in signals.items():
                columns[name.format(limb)] = normalise_strides(signal, strides, PHASE).ravel()
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def _pairs(values: Mapping[str, str]) -> str:
    """Return ``key:value`` pairs in one cell."""
    return ",".join(f"{key}:{value}" for key, value in values.items())


def angle_signals(angles: Mapping[JointName, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the angles of the joints of a limb in [rad] by column."""
    return {locohub.angle_column(joint, "{}"): angle for joint, angle in angles.items()}


def _limb_signals(run: Run, world: World, side: Side, mass: float) -> dict[str, np.ndarray]:
    """Return angles, velocities, moments and ground forces of a limb of a run."""
    log, weight = run.columns, mass * run.experiment.plant.gravity
    moments, found = joint_moments(run, world), dict[str, np.ndarray]()
    for joint, motion in MOTIONS.items():
        angle, velocity = (
            wearer_column(log, side, joint, name) for name in ("angle_rad", "velocity_rad_per_s")
        )
        if angle not in log:
            continue
        found |= angle_signals({joint: np.asarray(log[angle])})
        found[_SIGNAL.format(motion, "velocity", "rad_s")] = np.asarray(log[velocity])
        found[_SIGNAL.format(motion, "moment", "Nm_kg")] = moments[side, joint] / mass
        if f"{side}_{joint}_motor_torque_Nm" in log:
            brace = f"{side}_{joint}_brace_torque_Nm"
            torque = log[brace] if brace in log else device_moment(run, world, side, joint)
            found[_SIGNAL.format(motion, "assistance_moment", "Nm_kg")] = np.asarray(torque) / mass
    normal, along = (
        np.asarray(log[f"{side}_foot_{name}"]) for name in ("normal_force_N", "friction_force_N")
    )
    ground = world.ground()
    sine, cosine = ground.slope_sine, ground.slope_cosine
    found[locohub.load_column("{}")] = (normal * cosine + along * sine) / weight
    found["grf_anterior_{}_BW"] = (along * cosine - normal * sine) / weight
    return found
