"""Position tracking: a stiff spring that follows a predetermined path (TWIN's walk mode)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from twin_gait.control.controller import Controller, Plan, ReferencePath, find_cycle_interval
from twin_gait.control.gait_controller import N_JOINTS_PER_LEG, ControllerState
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, GAIN, STIFFNESS
from twin_gait.core.impedance import damping_from_ratio
from twin_gait.parameters.quantities import (
    NOT_NEGATIVE,
    SHARE,
    Parameters,
    Range,
    Ratio,
    RotaryStiffness,
)
from twin_gait.vocabulary import JointName, Side

# The path of position tracking. TWIN's own path is not published; this one is an assumption: the healthy
# walk, modified until the default wearer walked on it, guided vertically and with an ankle orthosis of
# 200 N·m/rad that is slack at 0°; the reason for each number is given with it. With that orthosis the soft
# harness is sufficient, too; with the preset's orthosis the default wearer walks on this path only if guided
# vertically.
#
# The knee's motor has to accelerate its own rotor, 3.3 kg·m² at the joint, with 60 N·m: 18 rad/s² at most.
# The healthy knee at 1.5 km/h needs more than 50; its first two harmonics with a 10 % longer stride time need
# 12.
PATH_HARMONICS = 2
PATH_SLOWNESS = 1.1  # Ratio to the healthy stride time.
HIP_EXCURSION = 1.1  # Ratio to the healthy excursion: at the same belt speed slower steps have to be longer.
HIP_OFFSET = math.radians(3.0)  # Offset that moves the step forward, so that the foot clears the belt.
# Two harmonics flatten the knee's peak and overextend it. The knee has to bend far enough for the toe to
# clear the belt, and its smallest angle has to be farther from the stop at -4° than the monitor's stop
# distance.
KNEE_LOWEST, KNEE_HIGHEST = math.radians(8.0), math.radians(55.0)

DAMPING_RATIOS = Range(0.0, 10.0, exclusive_minimum=True, reason="a joint without damping oscillates")


@dataclass(frozen=True, kw_only=True)
class PathParameters(Parameters):
    """Spring and damper that follow the predetermined path in the mode ``position``.

    Attributes:
        stiffness: Stiffness k in [N·m/rad], per joint (assumption: the hip stiffer than in any phase of
            the shipped table, so that the default wearer follows to 2°; the knee to 6° with 4 N·m/deg, where
            the limits saturate in 2 % of the ticks; with 7 it would be 4° and four times as many).
        damping_ratio: Damping ratio ζ of the joint on this spring.
        friction_compensation_gain: Gain G of the friction compensation.
        gravity_compensation: Share of gravity compensation.
    """

    stiffness: Annotated[Mapping[JointName, RotaryStiffness], NOT_NEGATIVE] = field(
        default_factory=lambda: {JointName.HIP: math.degrees(9.0), JointName.KNEE: math.degrees(4.0)}
    )
    damping_ratio: Annotated[Ratio, DAMPING_RATIOS] = 0.7
    friction_compensation_gain: Annotated[Ratio, SHARE] = 0.35
    gravity_compensation: Annotated[Ratio, SHARE] = 0.0


def position_tick(memory: ReferencePath, device: ControllerState, tick: int, period: float) -> None:
    """Move the equilibrium angles along the path, and make the dampers act on the velocity relative to it."""
    angles, cycle = memory.angles, memory.cycle_ticks
    spacing = cycle * period / (len(angles) - 1)
    for number in range(len(device.legs)):
        before, share = find_cycle_interval(memory.starts[number] + tick / cycle, len(angles))
        for position in range(N_JOINTS_PER_LEG):
            setpoint = device.joints[number * N_JOINTS_PER_LEG + position].setpoint
            start = angles[before][position]
            change = angles[before + 1][position] - start
            setpoint.equilibrium = start + share * change
            setpoint.target += setpoint.damping * change / spacing


@dataclass(frozen=True)
class Position(Controller):
    """Position tracking."""

    path: PathParameters = field(default_factory=PathParameters)  # Spring and damper.

    mode = "position"
    tick = staticmethod(position_tick)
    phase_driven = False
    unprinted_reason = "control.mode: position is not available in the firmware; set impedance"

    def check_joints(self, joints: tuple[JointName, ...]) -> str:
        """Check that each joint has a path and a spring.

        Returns an error message, empty if the controller can drive the joints.
        """
        if not set(joints) <= PATHS.keys():
            return f"control.mode: position has a path for {', '.join(PATHS)} only; set another mode"
        missing = [joint for joint in joints if joint not in self.path.stiffness]
        problem = "is missing; control.mode position needs a stiffness for every joint"
        return f"control.path.stiffness.{missing[0]}: {problem}" if missing else ""

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Set the same spring in every phase; θ0 changes with the tick."""
        path, posture = self.path, dict.fromkeys(plan.joints, 0.0)
        rows[:] = 0.0
        for number, name in enumerate(plan.joints):
            first, stiffness = COLUMNS_PER_JOINT * number, path.stiffness[JointName(name)]
            inertia = plan.inertia(side, posture, name)
            rows[:, first + STIFFNESS] = stiffness
            rows[:, first + DAMPING] = damping_from_ratio(path.damping_ratio, stiffness, inertia)
            rows[:, first + GAIN] = path.friction_compensation_gain
        rows[:, -1] = path.gravity_compensation
        return rows

    def initial_angles(self, plan: Plan) -> Mapping[Side, Mapping[JointName, float]]:
        """Return the initial angles of the path.

        From any other angle the command would start with a step in proportion to the stiffness, at which the
        monitor trips.
        """
        path = self.reference_path(plan)
        joints = [JointName(name) for name in plan.joints]
        return {
            side: _posture(path, start, joints) for side, start in zip(plan.sides, path.starts, strict=True)
        }

    def reference_path(self, plan: Plan) -> ReferencePath:
        """Return the path of position tracking."""
        return device_walk(plan.reference, plan.joints)

    def initial_memory(self, plan: Plan) -> ReferencePath:
        """Return the path as the memory of the controller."""
        return self.reference_path(plan)


def _shifted(curve: np.ndarray) -> np.ndarray:
    middle = curve[:-1].mean()
    return np.asarray(middle + HIP_OFFSET + HIP_EXCURSION * (curve - middle))


def _spanned(curve: np.ndarray) -> np.ndarray:
    share = (curve - curve.min()) / (curve.max() - curve.min())
    return np.asarray(KNEE_LOWEST + share * (KNEE_HIGHEST - KNEE_LOWEST))


# Functions that change the first harmonics of a healthy joint to the path of this joint.
PATHS = {JointName.HIP: _shifted, JointName.KNEE: _spanned}


def device_walk(healthy: ReferencePath, joints: Sequence[str]) -> ReferencePath:
    """Modify the healthy walk of some joints to one that the motors can follow; see the constants above."""
    curves = _few_harmonics(np.array(healthy.angles)).T
    paths = [PATHS[JointName(name)](curve) for name, curve in zip(joints, curves, strict=True)]
    angles = np.column_stack(paths).tolist()
    return ReferencePath(angles, round(PATH_SLOWNESS * healthy.cycle_ticks), healthy.starts)


def _few_harmonics(curves: np.ndarray) -> np.ndarray:
    """Keep only the first harmonics of closed curves, shape ``(PATH_SAMPLES, n)``."""
    spectrum = np.fft.rfft(curves[:-1], axis=0)
    spectrum[PATH_HARMONICS + 1 :] = 0.0
    smooth = np.fft.irfft(spectrum, n=len(curves) - 1, axis=0)
    return np.vstack((smooth, smooth[:1]))


def _posture(path: ReferencePath, start: float, joints: Sequence[JointName]) -> dict[JointName, float]:
    before, share = find_cycle_interval(start, len(path.angles))
    ends = zip(path.angles[before], path.angles[before + 1], strict=True)
    return {joint: low + share * (high - low) for joint, (low, high) in zip(joints, ends, strict=True)}
