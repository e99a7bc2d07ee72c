"""Checks of whole runs: engine against engine, a MuJoCo plant in the loop, and the energy books."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from twin_gait.configuration import load_experiment
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.measures.effort import energy_balance
from twin_gait.simulation import RunStatus, simulate
from twin_gait.simulation.columns import WORK_SOURCES
from twin_gait.simulation.pinocchio.engine import PinocchioEngine
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.validation.check import CheckPlan, Finding
from twin_gait.studies.validation.mujoco_witness import MujocoPlant

DURATIONS = {"bench_leg": 5.0, "treadmill": 2.0}  # [s]
LOOP_DURATION = 2.0  # [s]
# MuJoCo has this method too, and the Pinocchio engine steps through two seconds of walking in seconds.
EULER = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3)
RK4 = Integration(method=IntegrationMethod.RK4, step=1e-3)


def _experiment(preset: str, duration: float, engine: Engine, integration: Integration) -> Experiment:
    experiment = load_experiment(preset).experiment
    return replace(
        experiment,
        duration=duration,
        engine=engine,
        integration=integration,
        sensors=replace(experiment.sensors, ideal=True),
    )


# ---------------------------------------------------------------------- engine against engine


def engine_difference(preset: str) -> Finding:
    """Largest difference of any angle between the compiled and the Pinocchio engine.

    Args:
        preset: Key of ``DURATIONS``.

    Returns:
        The difference in [rad]; not sound unless all phase switches are the same and both runs complete.
    """
    ours, theirs = (
        simulate(_experiment(preset, DURATIONS[preset], engine, EULER))
        for engine in (Engine.COMPILED, Engine.PINOCCHIO)
    )
    columns = [name for name in theirs.log.columns if _is_angle(name)]
    complete = ours.status is theirs.status is RunStatus.COMPLETED
    difference = _difference(ours.log[columns].to_numpy(), theirs.log[columns].to_numpy())
    same = ours.switches == theirs.switches
    ending = "" if complete else f", {ours.status} and {theirs.status}"
    note = f"{DURATIONS[preset]:g} s, {_switch_note(ours.switches, same)}{ending}"
    return Finding(difference, note, sound=complete and same and len(ours.switches) > 0)


def _is_angle(column: str) -> bool:
    return column.endswith("_angle_rad") and "measured" not in column


def _difference(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference of two records; not a number if one is longer."""
    return float(np.abs(ours - theirs).max()) if ours.shape == theirs.shape else math.nan


def _switch_note(switches: Sequence[PhaseSwitch], same: bool) -> str:
    return f"{len(switches)} equal switches" if same else "DIFFERENT switches"


# ---------------------------------------------------------------------- MuJoCo in the loop


def closed_loop_difference() -> Finding:
    """Largest difference of an angle when MuJoCo moves the bench leg under the same controller.

    Returns:
        The difference in [rad]; not sound unless all phase switches are the same and the leg keeps off
        the stops, which the witness does not have.

    Raises:
        MissingOptionalDependency: If MuJoCo is not installed.
    """
    experiment = _experiment("bench_leg", LOOP_DURATION, Engine.PINOCCHIO, EULER)
    ours, theirs = (PinocchioEngine(build_problem(experiment)) for _ in range(2))
    theirs.plant = MujocoPlant(theirs.problem.world, experiment)
    a, b = ours.run(), theirs.run()
    positions = ours.layout.positions
    angles = [position for name, position in positions.items() if _is_angle(name)]
    stops = [position for name, position in positions.items() if name.endswith("_stop_torque_Nm")]
    free = not a.rows[:, stops].any()
    same = a.switches == b.switches
    touched = "" if free else ", TOUCHED a stop"
    note = f"bench leg, {LOOP_DURATION:g} s, {_switch_note(a.switches, same)}{touched}"
    difference = _difference(a.rows[:, angles], b.rows[:, angles])
    return Finding(difference, note, sound=free and same and len(a.switches) > 0)


# ---------------------------------------------------------------------- energy


def energy_residual() -> Finding:
    """Part of the energy of a controlled run that the work of all sources does not account for."""
    run = simulate(_experiment("bench_leg", DURATIONS["bench_leg"], Engine.COMPILED, RK4))
    energy = (run.log["kinetic_energy_J"] + run.log["potential_energy_J"]).to_numpy()
    works = np.array([run.log[f"{source}_work_J"].to_numpy() for source in WORK_SOURCES])
    balance = energy_balance(energy, works)
    note = f"bench leg, {run.duration:g} s, {balance.throughput:.0f} J of work in and out"
    return Finding(balance.relative_residual, note, sound=run.status is RunStatus.COMPLETED)


# The same laws in another order of additions: rounding of 1e-16 rad, magnified by some seconds of stiff
# contacts. A switch that comes one tick later moves an angle by 1e-4 rad and more.
SAME_MOTION = 1e-9  # [rad]

RUN_CHECKS = (
    CheckPlan(
        name="engines-bench",
        witness="Pinocchio engine",
        unit="rad",
        tolerance=SAME_MOTION,
        find=partial(engine_difference, "bench_leg"),
    ),
    CheckPlan(
        name="engines-treadmill",
        witness="Pinocchio engine",
        unit="rad",
        tolerance=SAME_MOTION,
        find=partial(engine_difference, "treadmill"),
    ),
    CheckPlan(
        name="closed-loop",
        witness="MuJoCo as the plant",
        unit="rad",
        tolerance=SAME_MOTION,
        find=closed_loop_difference,
    ),
    CheckPlan(
        name="energy-balance",
        witness="conservation of energy",
        unit="1",
        # Runge-Kutta errs by (λh)⁴/120. The fastest rate λ is friction near rest over the drive's inertia,
        # 10 b/c / 3.34 kg m² = 28 /s with half of table 3.1: 5e-9 at 1 ms.
        tolerance=1e-8,
        find=energy_residual,
    ),
)
