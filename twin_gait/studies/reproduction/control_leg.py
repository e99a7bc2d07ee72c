"""Gains of hip and knee on the bench leg: where it becomes unstable, and how much it takes to let it swing.

The leg hangs on its stand, pelvis fixed, without a wearer, in the compiled engine. A table of one phase
without springs leaves friction compensation and gravity. The stops are taken away: the knee hangs 4° beside
its own, which would take energy from every swing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from twin_gait.checking.finding import Subject
from twin_gait.checking.hanging_leg import HangingLeg, hanging_legs
from twin_gait.checking.linear_loop import spectral_radius, transition_matrix
from twin_gait.configuration import load_experiment
from twin_gait.core.impedance import damping_from_ratio
from twin_gait.experiment import ControlMode, Experiment
from twin_gait.gait.table import GaitTable, JointImpedance, PhaseParameters
from twin_gait.parameters import StopParameters
from twin_gait.scenario import BenchLegScenario
from twin_gait.simulation import Run, RunStatus, simulate
from twin_gait.studies.reproduction.control_bench import FRICTION_RATIO
from twin_gait.studies.reproduction.control_limits import bisect
from twin_gait.vocabulary import MOTOR_JOINTS, JointName, Side

SWINGING, FALLING = 60.0, 5.0  # [s]; of a run that looks for growth, or for a passage
GROWN = math.radians(2.0)  # a swing smaller than this is rest
STAYS = 0.95  # of a swing that is left after a quarter of a run, below which it dies out
_HIGHEST = 1.0  # G is a share
_ROUNDING = 1e-7


class Pair(NamedTuple):
    """A number for the hip and one for the knee.

    Attributes:
        hip: Of the hip.
        knee: Of the knee.
    """

    hip: float
    knee: float


NEITHER = Pair(0.0, 0.0)
EQUAL = Pair(FRICTION_RATIO, FRICTION_RATIO)
RAISED = Pair(math.radians(20.0), math.radians(20.0))  # [rad] at the start; both joints hang at 0


@cache
def _base() -> Experiment:
    return load_experiment("bench_leg").experiment


def hanging_experiment(
    gains: Pair, ratios: Pair = EQUAL, *, raised: Pair = RAISED, duration: float = SWINGING
) -> Experiment:
    """The bench leg, let go with hip and knee raised, on friction compensation alone.

    Args:
        gains: G of hip and knee.
        ratios: s of hip and knee.
        raised: Angles at the start in [rad].
        duration: In [s].

    Returns:
        The experiment, without stops and without the safety monitor, which would end what is looked for.
    """
    base = _base()
    joints = {
        str(joint): JointImpedance(
            stiffness=0.0, damping=0.0, equilibrium_angle=0.0, friction_compensation_gain=gain
        )
        for joint, gain in zip(MOTOR_JOINTS, gains, strict=True)
    }
    table = GaitTable(
        name="hanging",
        joints=base.table.joints,
        phases={"hanging": PhaseParameters(joints=joints)},
        transitions=(),
    )
    return replace(
        base,
        name="hanging",
        table=table,
        scenario=BenchLegScenario(start_angles=raised),
        control=replace(
            base.control,
            mode=ControlMode.TRANSPARENT,
            safety=replace(base.control.safety, enabled=False),
        ),
        plant=replace(
            base.plant,
            friction_ratio=dict(zip(MOTOR_JOINTS, ratios, strict=True)),
            stops=StopParameters(stiffness=0.0, dissipation=0.0),
        ),
        duration=duration,
    )


def joint_angles(run: Run) -> np.ndarray:
    """Angles of hip and knee in [rad], shape ``(n_ticks, 2)``."""
    return np.asarray(run.log[[f"{Side.RIGHT}_{joint}_angle_rad" for joint in MOTOR_JOINTS]].to_numpy())


def leg_swing_stays(run: Run) -> bool:
    """Whether the swing of a leg that was let go grows or stays.

    Args:
        run: The run.

    Returns:
        True if hip or knee swings in the last quarter of the run about as far as in the one before, or the
        run diverged.
    """
    if run.status is RunStatus.DIVERGED:
        return True
    angles = joint_angles(run)
    half, quarter = len(angles) // 2, len(angles) // 4
    before, last = (np.ptp(part, axis=0) for part in (angles[half:-quarter], angles[-quarter:]))
    return bool(((last >= STAYS * before) & (last > GROWN)).any())


def swing_limit(direction: Pair, ratios: Pair = EQUAL, *, fixed: Pair = NEITHER) -> float:
    """Gain at which the swing of the leg no longer dies out.

    Args:
        direction: Which gains are raised: (1, 0) the hip's, (0, 1) the knee's, (1, 1) both alike.
        ratios: s of hip and knee.
        fixed: Gains that are added and stay.

    Returns:
        The gain; near 1 if it never grows.
    """

    def stays(gain: float) -> bool:
        gains = Pair(fixed.hip + gain * direction.hip, fixed.knee + gain * direction.knee)
        return leg_swing_stays(simulate(hanging_experiment(gains, ratios)))

    return bisect(stays, 0.5 * min(ratios), _HIGHEST)


@cache
def _hanging_leg() -> HangingLeg:
    experiment = hanging_experiment(EQUAL)
    (leg,) = hanging_legs(Subject(table=experiment.table, experiment=experiment, limits={}))
    return leg


def linear_limit(
    direction: Pair, *, velocity: float = 0.0, stiffness: float = 0.0, damping: Pair = NEITHER
) -> float:
    """The same gain by the eigenvalues of the coupled linear loop of the hanging leg, s equal at both joints.

    Args:
        direction: As above.
        velocity: Where the friction laws are linearised in [rad] / [s].
        stiffness: k of both joints in [N m] / [rad].
        damping: b of hip and knee in [N m s] / [rad].

    Returns:
        The gain, looked for up to 3.
    """
    loop = _hanging_leg().linear_loop(0, velocity)
    loop = replace(loop, stiffness=np.full(2, stiffness), damping=np.array(damping))

    def grows(gain: float) -> bool:
        return (
            spectral_radius(transition_matrix(replace(loop, gain=gain * np.array(direction))))
            > 1.0 + _ROUNDING
        )

    return bisect(grows, 0.1, 3.0, steps=18)


def gait_damping(stiffness: float, damping_ratio: float) -> Pair:
    """Damping of hip and knee for a damping ratio, leg hanging, in [N m s] / [rad].

    Args:
        stiffness: k of both joints in [N m] / [rad].
        damping_ratio: ζ.

    Returns:
        b of hip and knee.
    """
    inertia = np.diag(_hanging_leg().mass(np.zeros(2)))
    return Pair(*(damping_from_ratio(damping_ratio, stiffness, float(value)) for value in inertia))


def _alone(joint: JointName, value: float) -> Pair:
    return Pair(*(value if each is joint else 0.0 for each in MOTOR_JOINTS))


def weight_torque(joint: JointName, angle: float) -> float:
    """Torque of gravity on a joint that alone is raised, in [N m].

    Args:
        joint: Hip or knee.
        angle: In [rad].

    Returns:
        The torque that holds it.
    """
    return float(_hanging_leg().gravity(np.array(_alone(joint, angle)))[MOTOR_JOINTS.index(joint)])


def least_gain(joint: JointName, angle: float, ratios: Pair = EQUAL) -> float:
    """Least gain with which a joint, let go, falls through the vertical under its own weight in 5 s.

    Args:
        joint: Hip or knee; it alone is raised and compensated.
        angle: By how much in [rad].
        ratios: s of hip and knee.

    Returns:
        The gain; 0 if it needs none.
    """

    def passes(gain: float) -> bool:
        gains, raised = _alone(joint, gain), _alone(joint, angle)
        run = simulate(hanging_experiment(gains, ratios, raised=raised, duration=FALLING))
        return bool((joint_angles(run)[:, MOTOR_JOINTS.index(joint)] <= 0.0).any())

    return 0.0 if passes(0.0) else bisect(passes, 0.0, _HIGHEST)
