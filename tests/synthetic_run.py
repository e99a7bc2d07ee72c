"""Synthetic walk without a simulation: every column is given, so that every measure is known.

Both legs make strides of 1.2 s; the right leg follows half a stride later. Each leg enters early
stance 0.3 s before its heel strikes. Hip and knee follow the reference curve of the walk plus a
known error.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np
from table_builder import JOINTS, phase, transition

from twin_gait import load_experiment
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.reference import reference_curve
from twin_gait.simulation.log import log_layout
from twin_gait.simulation.run import Run, RunStatus, log_table
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.vocabulary import GaitPhase, JointName, Side
from twin_gait.worlds.treadmill import Treadmill

STRIDE = 1200  # [ticks], like all durations below
LAG = 300
SWING = 450
N_STRIDES = 6
LENGTH = N_STRIDES * STRIDE
SHIFT = {Side.LEFT: 0, Side.RIGHT: STRIDE // 2}
PHASE_TICKS = (300, 250, 200, 200, 250)

HIP_OFFSET = 0.1  # [rad]
KNEE_AMPLITUDE = 0.05  # [rad]
CLEARANCE = 0.03  # [m]
DIP = 0.012  # [m] clearance in the middle of swing
ENERGY_SLIP = 0.25  # [J] error at one instant

PHASES = tuple(GaitPhase)
CYCLE = tuple(zip(PHASES, (*PHASES[1:], PHASES[0]), strict=True))


def five_phase_table() -> GaitTable:
    """Return five phases in a ring, with a timeout in addition to the guard out of swing flexion."""
    ring = [transition(source, target, "hip.angle_deg > 0") for source, target in CYCLE]
    late = transition(GaitPhase.SWING_FLEXION, GaitPhase.SWING_EXTENSION, timeout_ticks=1000)
    return GaitTable(
        name="ring",
        joints=JOINTS,
        phases={name: phase() for name in PHASES},
        transitions=(*ring, late),
    )


def synthetic_experiment() -> Experiment:
    return replace(
        load_experiment("treadmill_guided").experiment,
        name="synthetic",
        table=five_phase_table(),
        duration=LENGTH * TICK,
    )


def phase_codes(side: Side) -> np.ndarray:
    """Return the phase of every tick: early stance begins at 0, 1200, … (left) and 600, 1800, … (right)."""
    cycle = np.repeat(np.arange(len(PHASES)), PHASE_TICKS)
    return cycle[(np.arange(LENGTH) - SHIFT[side]) % STRIDE]


def ticks_since_strike(side: Side) -> np.ndarray:
    """Return the ticks since the last heel strike, as if the walk had begun before the start."""
    return (np.arange(LENGTH) - SHIFT[side] - LAG) % STRIDE


def switches(side: Side, table: GaitTable, timed_out: Collection[int]) -> list[PhaseSwitch]:
    codes = phase_codes(side)
    found = []
    for tick in (np.flatnonzero(np.diff(codes)) + 1).tolist():
        source, target = PHASES[codes[tick - 1]], PHASES[codes[tick]]
        index = len(CYCLE) if tick in timed_out else codes[tick - 1]
        found.append(PhaseSwitch(tick, side, source, target, table.transitions[index].cause, int(index)))
    return found


def swing_clearance(side: Side) -> np.ndarray:
    """Return −5 mm in stance, and 30 mm in swing with a dip in the middle and 1 mm in both end tenths."""
    swung = (ticks_since_strike(side) - (STRIDE - SWING)) / SWING
    clearance = np.full(LENGTH, -0.005)
    clearance[swung >= 0.0] = CLEARANCE
    clearance[(swung >= 0.0) & (np.abs(swung - 0.5) > 0.4)] = 0.001
    clearance[np.abs(swung - 0.5) < 0.02] = DIP
    return clearance


def synthetic_run(*, timed_out: Collection[int] = ()) -> Run:
    """Return the walk; ``timed_out``: ticks of the switches that are timeouts."""
    experiment = synthetic_experiment()
    layout = log_layout(build_setup(experiment))
    columns = {name: np.zeros(LENGTH) for name in layout.names}
    for side in Side:
        columns.update(_leg_columns(side, experiment))
    columns.update(_common_columns(), belt_speed_m_per_s=np.full(LENGTH, experiment.scenario.belt_speed))
    found = [item for side in Side for item in switches(side, experiment.table, timed_out)]
    return Run(
        experiment=experiment,
        table=experiment.table,
        log=log_table(np.column_stack([columns[name] for name in layout.names]), layout, experiment.table),
        switches=tuple(sorted(found, key=lambda item: item.tick)),
        status=RunStatus.COMPLETED,
        reason="",
        wall_s=3.6,
        body_weight=880.0,
    )


def _leg_columns(side: Side, experiment: Experiment) -> dict[str, np.ndarray]:
    scenario, patient = experiment.scenario, experiment.patient
    assert isinstance(scenario, Treadmill) and patient is not None
    progress = ticks_since_strike(side) / STRIDE
    errors = {
        JointName.HIP: np.full(LENGTH, HIP_OFFSET),
        JointName.KNEE: KNEE_AMPLITUDE * np.sin(2.0 * math.pi * progress),
    }
    columns = {f"{side}_phase": phase_codes(side).astype(float)}
    for joint, error in errors.items():
        curve = reference_curve(joint, 100.0 * progress, speed=scenario.belt_speed, height=patient.height)
        columns[f"{side}_{joint}_angle_rad"] = curve + error
        columns[f"{side}_{joint}_velocity_rad_per_s"] = np.gradient(curve + error, TICK)
        columns[f"{side}_{joint}_impedance_torque_Nm"] = 20.0 * np.sin(2.0 * math.pi * progress)
        columns[f"{side}_{joint}_motor_command_torque_Nm"] = 20.0 * np.sin(2.0 * math.pi * progress)
        columns[f"{side}_{joint}_motor_torque_Nm"] = 20.0 * np.sin(2.0 * math.pi * progress)
    in_stance = ticks_since_strike(side) < STRIDE - SWING
    columns[f"{side}_foot_normal_force_N"] = np.where(in_stance, 400.0, 0.0)
    columns[f"{side}_foot_clearance_m"] = swing_clearance(side)
    return columns


def _common_columns() -> dict[str, np.ndarray]:
    half = np.arange(LENGTH) < LENGTH // 2
    energy = np.linspace(0.0, 10.0, LENGTH)
    slip = np.where(np.arange(LENGTH) == 1000, ENERGY_SLIP, 0.0)
    return {
        "battery_power_W": np.where(half, 100.0, -20.0),
        "guide_force_N": np.linspace(-30.0, 40.0, LENGTH),
        "guide_moment_Nm": np.linspace(5.0, -15.0, LENGTH),
        "kinetic_energy_J": 3.0 + energy + slip,
        "potential_energy_J": 700.0 - 3.0 * energy,
        "motor_work_J": 2.0 * energy,
        "friction_work_J": -4.0 * energy,
    }
