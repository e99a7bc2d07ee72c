"""Parameters of the phases and the path to follow, by the mode of the controller."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twin_gait.core.assistance import cycle_place
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.core.impedance import damping_from_ratio
from twin_gait.experiment.control import ControlMode
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.scaling import InertiaAt
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.measures.reference import FASTEST, SLOWEST, reference_curve, reference_cycle_time
from twin_gait.parameters import Patient
from twin_gait.vocabulary import JointName, Side

PATH_SAMPLES = 101  # of a cycle, every percent
_TRAILING_START = 0.5  # of the cycle, where the trailing leg begins

# The path of position tracking. TWIN's own is not published; this one is an assumption: the healthy walk,
# changed until the default wearer walked on it, guided vertically and with an ankle orthosis of 200 Nm/rad
# that is slack at 0°, each number for the reason beside it. With that orthosis the soft harness does as well;
# with the preset's the default wearer walks on it only if guided vertically.
#
# The knee's motor has to accelerate its own rotor, 3.3 kg m² at the joint, with 60 N m: 18 rad/s² at most.
# The healthy knee at 1.5 km/h asks for more than 50; two harmonics of it in a tenth more time ask for 12.
PATH_HARMONICS = 2
PATH_SLOWNESS = 1.1  # of the healthy stride time
HIP_EXCURSION = 1.1  # of the healthy one: the belt is as fast, so that slower steps have to be longer
HIP_OFFSET = math.radians(3.0)  # puts the middle of the step forward, so that the foot clears the belt
# Two harmonics flatten the knee's peak and overextend it. It has to bend far enough for the toe to clear the
# belt, and at its straightest to stay farther from the stop at -4° than the monitor's stop distance.
KNEE_LOWEST, KNEE_HIGHEST = math.radians(8.0), math.radians(55.0)


class Path(NamedTuple):
    """The walk that is followed, or against which the tracking error is measured.

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
    """The reference walk of an experiment, for position tracking or for the tracking error.

    The error is measured against healthy walking at the belt's speed and the wearer's height (Koopman et al.
    2014); :func:`device_walk` of it is followed.
    """
    scenario = experiment.scenario
    height = (experiment.patient or Patient()).height
    walking, leading = scenario.walking, scenario.leading_of(sides)
    speed = SLOWEST if walking is None else min(max(walking.speed, SLOWEST), FASTEST)
    percent = np.linspace(0.0, 100.0, PATH_SAMPLES)
    joints = [JointName(name) for name in experiment.table.joints]
    angles = [reference_curve(joint, percent, speed=speed, height=height) for joint in joints]
    starts = np.array([0.0 if side is leading else _TRAILING_START for side in sides])
    path = Path(np.array(angles).T, round(reference_cycle_time(speed, height) / TICK), starts)
    return device_walk(path) if experiment.control.mode is ControlMode.POSITION else path


def device_walk(healthy: Path) -> Path:
    """A walk that the motors can follow, made of the healthy one; see the constants of this module."""
    hip, knee = _few_harmonics(healthy.angles).T
    middle = hip[:-1].mean()
    hip = middle + HIP_OFFSET + HIP_EXCURSION * (hip - middle)
    share = (knee - knee.min()) / (knee.max() - knee.min())
    knee = KNEE_LOWEST + share * (KNEE_HIGHEST - KNEE_LOWEST)
    return Path(np.column_stack((hip, knee)), round(PATH_SLOWNESS * healthy.cycle_ticks), healthy.starts)


def _few_harmonics(curves: np.ndarray) -> np.ndarray:
    """The first harmonics of curves that close, shape ``(PATH_SAMPLES, n)``."""
    spectrum = np.fft.rfft(curves[:-1], axis=0)
    spectrum[PATH_HARMONICS + 1 :] = 0.0
    smooth = np.fft.irfft(spectrum, n=len(curves) - 1, axis=0)
    return np.vstack((smooth, smooth[:1]))


def starting_on_path(experiment: Experiment) -> Experiment:
    """In position tracking the legs begin where the path does, whatever the scenario says.

    Anything else is a step of the command as large as the spring is stiff, at which the monitor trips.

    Returns:
        The experiment with the joint angles of the path at the start; itself in the other modes.
    """
    if experiment.control.mode is not ControlMode.POSITION:
        return experiment
    sides = tuple(experiment.leg.legs)
    path = reference_path(experiment, sides)
    begin = {side: _posture(path, start) for side, start in zip(sides, path.starts, strict=True)}
    return replace(experiment, scenario=experiment.scenario.starting_in(begin))


def _posture(path: Path, start: float) -> dict[JointName, float]:
    before, share = cycle_place(start, len(path.angles))
    hip, knee = path.angles[before] + share * (path.angles[before + 1] - path.angles[before])
    return {JointName.HIP: float(hip), JointName.KNEE: float(knee)}


def driven_rows(
    experiment: Experiment, table: GaitTable, rows: np.ndarray, inertia: InertiaAt, side: Side
) -> np.ndarray:
    """Parameters of the phases of one leg in the mode of the controller.

    Args:
        rows: What the table says: k, b, θ0, G of each joint and the gravity share, shape
            ``(n_phases, n_columns)``.
        inertia: Effective inertia of a joint, for the damping of the path.

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
