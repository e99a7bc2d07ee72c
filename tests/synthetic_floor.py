"""Synthetic walk on the floor without a simulation: leaning trunk, two crutches, sinusoidal legs.

The pelvis moves at a constant speed, and each crutch is moved forwards while the other one is on the ground.
"""

from __future__ import annotations

import math

import numpy as np

from twin_gait import load_experiment
from twin_gait.gait.table import TICK
from twin_gait.simulation.log import log_layout, state_columns
from twin_gait.simulation.problem import build_problem
from twin_gait.simulation.run import Run, RunStatus, log_table
from twin_gait.vocabulary import Side
from twin_gait.worlds.standing import stand_on_both_feet

SPEED, STRIDE = 0.375, 1.6  # [m/s], [s]
LOAD = 150.0  # [N] load of a crutch on the ground
LOOK = 20  # ticks between two computed heights of the pelvis


def floor_walk(duration: float, *overrides: str) -> Run:
    """Write the log of the walk.

    Args:
        duration: Duration in [s].
        overrides: Settings that replace those of the preset ``overground``.
    """
    experiment = load_experiment("overground", [f"duration_s={duration}", *overrides]).experiment
    model, time = experiment.build_world().model, TICK * np.arange(round(duration / TICK))
    layout = log_layout(build_problem(experiment))
    columns = {name: np.zeros(len(time)) for name in layout.names}
    columns["pelvis_forward_m"] = SPEED * time
    columns["trunk_pitch_rad"] = np.radians(11.5 + 3.5 * np.sin(2.0 * math.pi * time / STRIDE))
    for side, lag in ((Side.LEFT, 0.0), (Side.RIGHT, 0.5)):
        columns |= _leg(side, time / STRIDE + lag) | _crutch(side, time / STRIDE + lag + 0.25)
    q = np.array([columns[name] for name in state_columns(model)[0]]).T
    assert model.pelvis_index is not None
    looks = np.arange(0, len(time), LOOK)
    heights = [stand_on_both_feet(model, posture, 0.0) for posture in q[looks]]
    columns["pelvis_height_m"] = np.interp(time, time[looks], heights)
    return Run(
        experiment=experiment,
        table=experiment.table,
        log=log_table(np.column_stack([columns[name] for name in layout.names]), layout, experiment.table),
        switches=(),
        status=RunStatus.COMPLETED,
        reason="",
        wall_s=1.0,
        body_weight=880.0,
    )


def _leg(side: Side, strides: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of a leg: hip forward at the start of a stride, knee flexed in its second half."""
    turn = 2.0 * math.pi * strides
    swing = np.clip(np.sin(turn + math.pi), 0.0, None)
    stands = strides % 1.0 < 0.55
    return {
        f"{side}_phase": np.floor(5.0 * (strides % 1.0)),
        f"{side}_hip_angle_rad": np.radians(13.0 + 15.0 * np.cos(turn) + 12.0 * swing),
        f"{side}_knee_angle_rad": np.radians(6.0 + 45.0 * swing**2),
        f"{side}_hip_motor_torque_Nm": 20.0 * np.sin(turn),
        f"{side}_foot_normal_force_N": np.where(stands, 500.0, 0.0),
    }


def _crutch(side: Side, strides: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of a crutch: on the ground for 2/3 of a stride, then moved by a stride length."""
    whole, share = np.floor(strides), strides % 1.0
    swing = np.clip((share - 2.0 / 3.0) * 3.0, 0.0, 1.0)
    lag = strides[0] - whole[0]
    way = whole - lag + swing * swing * (3.0 - 2.0 * swing)
    stands = swing == 0.0
    return {
        f"{side}_crutch_forward_m": SPEED * STRIDE * (way + 0.35) + 0.28,
        f"{side}_crutch_height_m": np.where(stands, -0.004, 0.06 * np.sin(math.pi * swing)),
        f"{side}_crutch_normal_force_N": np.where(stands, LOAD * np.sin(1.5 * math.pi * share), 0.0),
        f"{side}_crutch_friction_force_N": np.where(stands, -0.1 * LOAD * np.sin(1.5 * math.pi * share), 0.0),
        f"{side}_arm_push_N": np.where(stands, LOAD, 0.0),
        f"{side}_arm_power_W": np.full(len(strides), 12.0),
    }
