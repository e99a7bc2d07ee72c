"""Parameters of the phases and the path to follow, by the mode of the controller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import damping_from_ratio
from twin_gait.experiment import ControlMode, Experiment
from twin_gait.gait.scaling import InertiaAt
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.reference import FASTEST, SLOWEST, reference_curve, reference_cycle_time
from twin_gait.parameters import Patient
from twin_gait.scenario.treadmill import TreadmillScenario
from twin_gait.vocabulary import JointName, Side

PATH_SAMPLES = 101  # of a cycle, every percent
_TRAILING_START = 0.5  # of the cycle, where the trailing leg begins


class Path(NamedTuple):
    """The walk that is followed, or against which tracking is judged.

    Attributes:
        angles: Hip and knee over the cycle from foot contact in [rad], shape
            ``(PATH_SAMPLES, joints_per_leg)``.
        cycle_ticks: Ticks of a cycle.
        starts: Share of the cycle at which each leg begins, shape ``(n_legs,)``.
    """

    angles: np.ndarray
    cycle_ticks: int
    starts: np.ndarray


def reference_path(experiment: Experiment, sides: tuple[Side, ...]) -> Path:
    """Healthy walking at the belt's speed and the wearer's height (Koopman et al. 2014).

    Args:
        experiment: The experiment.
        sides: Legs in the order of the arrays.

    Returns:
        The path.
    """
    scenario = experiment.scenario
    height = (experiment.patient or Patient()).height
    speed, leading = SLOWEST, sides[0]
    if isinstance(scenario, TreadmillScenario):
        speed = min(max(scenario.belt_speed, SLOWEST), FASTEST)
        leading = scenario.leading
    percent = np.linspace(0.0, 100.0, PATH_SAMPLES)
    joints = [JointName(name) for name in experiment.table.joints]
    angles = [reference_curve(joint, percent, speed=speed, height=height) for joint in joints]
    starts = np.array([0.0 if side is leading else _TRAILING_START for side in sides])
    return Path(np.array(angles).T, round(reference_cycle_time(speed, height) / TICK), starts)


def driven_rows(
    experiment: Experiment, table: GaitTable, rows: np.ndarray, inertia: InertiaAt, side: Side
) -> np.ndarray:
    """Parameters of the phases of one leg in the mode of the controller.

    Args:
        experiment: The experiment.
        table: The gait table after scaling.
        rows: What the table says: k, b, θ0, G of each joint and the gravity share, shape
            ``(n_phases, n_columns)``.
        inertia: Effective inertia of a joint, for the damping of the path.
        side: The leg.

    Returns:
        The same shape.
    """
    mode, driven = experiment.control.mode, rows.copy()
    last = COLUMNS_PER_JOINT * len(table.joints)
    if mode in (ControlMode.TRANSPARENT, ControlMode.GRAVITY):
        for column in (STIFFNESS, DAMPING):
            driven[:, column:last:COLUMNS_PER_JOINT] = 0.0
    if mode is ControlMode.GRAVITY:
        driven[:, last] = 1.0
    if mode is ControlMode.CONSTANT:
        driven[:] = rows.mean(axis=0)
    if mode is ControlMode.POSITION:
        driven[:] = _path_row(experiment, table, inertia, side)
    return driven


def _path_row(experiment: Experiment, table: GaitTable, inertia: InertiaAt, side: Side) -> np.ndarray:
    path = experiment.control.path
    row = np.zeros(COLUMNS_PER_JOINT * len(table.joints) + 1)
    posture = dict.fromkeys(table.joints, 0.0)
    for number, name in enumerate(table.joints):
        first, stiffness = COLUMNS_PER_JOINT * number, path.stiffness[JointName(name)]
        row[first + STIFFNESS] = stiffness
        row[first + DAMPING] = damping_from_ratio(path.damping_ratio, stiffness, inertia(side, posture, name))
        row[first + EQUILIBRIUM] = 0.0  # the path sets it in every tick
        row[first + GAIN] = path.friction_compensation_gain
    row[-1] = path.gravity_compensation
    return row
