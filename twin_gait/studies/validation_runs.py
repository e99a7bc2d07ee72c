"""Checks of whole runs: engine against engine, a MuJoCo plant in the loop, and the energy books."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from twin_gait.configuration import load_experiment
from twin_gait.exceptions import SimulationDiverged
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.measures.energy import energy_balance
from twin_gait.simulation import Run, RunStatus, simulate
from twin_gait.simulation.columns import WORK_SOURCES
from twin_gait.simulation.pinocchio_engine import PinocchioEngine
from twin_gait.simulation.problem import build_problem
from twin_gait.studies.mujoco_witness import MujocoPlant
from twin_gait.studies.validation_check import CheckPlan, Finding

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
