"""Gains of hip and knee on the hanging leg: limits of stability, and gains with which it falls.

The leg hangs on its stand, pelvis fixed, without a wearer. A table of one phase without springs leaves
friction compensation and gravity. The stops are removed: the knee hangs 4° from its stop, which would
take energy from every swing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from thesis.bench import KNEE, RATIO, STIFFNESS
from thesis.limits import ROUNDING, bisect

from twin_gait import (
    Experiment,
    GaitTable,
    JointName,
    LegModel,
    Run,
    RunStatus,
    Side,
    load_experiment,
    simulate,
)
from twin_gait.checking.hanging_leg import linear_loops
from twin_gait.checking.linear_loop import LinearLoop, spectral_radius, transition_matrix
from twin_gait.configuration.bench_device import BENCH_ACTUATORS
from twin_gait.core.impedance import damping_from_ratio
from twin_gait.gait.table import JointImpedance, PhaseParameters
from twin_gait.leg_model.joints import LegJoints
from twin_gait.worlds.bench_leg import BenchLeg


class Pair(NamedTuple):
    """Pair of numbers for hip and knee."""

    hip: float
    knee: float


JOINTS = (JointName.HIP, KNEE)
HIP_ONLY, KNEE_ONLY, BOTH, NEITHER = Pair(1.0, 0.0), Pair(0.0, 1.0), Pair(1.0, 1.0), Pair(0.0, 0.0)
EQUAL = Pair(RATIO, RATIO)
SOFT_HIP = Pair(0.5, RATIO)  # s of a hip whose model has more friction than the joint
RAISED = Pair(math.radians(20.0), math.radians(20.0))  # [rad] at the start; both joints hang at 0
SWINGING, FALLING = 60.0, 5.0  # [s]; of a run that looks for instability, or for a passage
STILL = math.radians(2.0)  # a swing smaller than this is rest
STAYS = 0.95  # of a swing that is left after a quarter of a run, below which it dies out
LEAST_SHARE = 0.99  # of s: what counts as a swing that stays shrinks a little
SHOWN = (0.1, 0.3, 0.45, 0.55, 0.65, 0.75)  # gains of the map
ANGLES = (5.0, 10.0, 20.0)  # [deg]; raised by so much, does the joint fall by its own weight?
VELOCITIES = (0.0, 0.3, 1.0)  # [rad/s]; where the friction law is linearised, its dip left out
# Of the gait on this leg: 2.5 N·m/deg and a damping ratio of 0.7, as in the swing of its table.
GAIT_STIFFNESS, GAIT_DAMPING_RATIO = math.degrees(2.5), 0.7


@cache
def _base() -> Experiment:
    """Return the bench leg without stops and without the monitor, which would end an unstable run."""
    settings = ["control.mode=transparent", "control.safety.enabled=false"]
    settings += ["plant.stops.stiffness_Nm_per_rad=0", "plant.stops.dissipation_s_per_rad=0"]
    return load_experiment("bench_leg", settings).experiment


def hanging_experiment(
    gains: Pair, ratios: Pair = EQUAL, *, raised: Pair = RAISED, duration: float = SWINGING
) -> Experiment:
    """Return a leg released with raised joints [rad], with friction compensation only: G and s by joint."""
    base = _base()
    joints = {
        str(joint): JointImpedance(
            stiffness=0.0, damping=0.0, equilibrium_angle=0.0, friction_compensation_gain=gain
        )
        for joint, gain in zip(JOINTS, gains, strict=True)
    }
    phases = {"hanging": PhaseParameters(joints=joints)}
    return replace(
        base,
        table=GaitTable(name="hanging", joints=base.table.joints, phases=phases, transitions=()),
        scenario=BenchLeg(start_angles=dict(zip(JOINTS, raised, strict=True))),
        plant=replace(base.plant, friction_ratio=dict(zip(JOINTS, ratios, strict=True))),
        duration=duration,
    )


def joint_angles(run: Run) -> np.ndarray:
    """Return the angles of hip and knee in [rad], shape ``(n_ticks, 2)``."""
    return run.log[[f"right_{joint}_angle_rad" for joint in JOINTS]].to_numpy()


def leg_keeps_swinging(run: Run) -> bool:
    """Return whether hip or knee swings about as far in the last quarter as in the third, or diverges."""
    if run.status is RunStatus.DIVERGED:
        return True
    angles = joint_angles(run)
    half, quarter = len(angles) // 2, len(angles) // 4
    before, last = (np.ptp(part, axis=0) for part in (angles[half:-quarter], angles[-quarter:]))
    return bool(((last >= STAYS * before) & (last > STILL)).any())


def swing_limit(direction: Pair, ratios: Pair = EQUAL) -> float:
    """Return the gain at which the swing of the leg no longer decays; ``direction``: raised gains."""

    def unstable(gain: float) -> bool:
        gains = Pair(gain * direction.hip, gain * direction.knee)
        return leg_keeps_swinging(simulate(hanging_experiment(gains, ratios)))

    return bisect(unstable, 0.5 * min(ratios), 1.0)


@cache
def _loop(velocity: float) -> LinearLoop:
    return linear_loops(hanging_experiment(EQUAL), velocity)[Side.RIGHT, "hanging"]


def linear_limit(
    direction: Pair, *, velocity: float = 0.0, stiffness: float = 0.0, damping: Pair = NEITHER
) -> float:
    """Return this gain from the eigenvalues of the coupled loop of the hanging leg, with equal s.

    Args:
        direction: As above.
        velocity: Where the friction laws are linearised in [rad/s].
        stiffness: k of both joints in [N·m/rad].
        damping: b of hip and knee in [N·m·s/rad].

    Returns:
        The gain, searched up to 3.
    """
    loop = replace(_loop(velocity), stiffness=np.full(2, stiffness), damping=np.array(damping))

    def unstable(gain: float) -> bool:
        with_gain = replace(loop, gain=gain * np.array(direction))
        return spectral_radius(transition_matrix(with_gain)) > 1.0 + ROUNDING

    return bisect(unstable, 0.1, 3.0, steps=18)


@cache
def _leg() -> LegModel:
    armature = {joint: BENCH_ACTUATORS[joint].armature for joint in JOINTS}
    return LegModel(
        "twin_leg.urdf", {Side.RIGHT: LegJoints(hip="right_hip", knee="right_knee")}, armature=armature
    )


def _alone(joint: JointName, value: float) -> Pair:
    return Pair(*(value if each is joint else 0.0 for each in JOINTS))


def weight_torque(joint: JointName, angle: float) -> float:
    """Return the torque [N·m] that holds a joint against gravity if only it is raised by an angle [rad]."""
    leg = _leg()
    posture = np.zeros(leg.nv)
    posture[leg.index(Side.RIGHT, joint)] = angle
    return float(leg.gravity_torque(posture)[leg.index(Side.RIGHT, joint)])


def gait_damping() -> Pair:
    """Return the damping of hip and knee [N·m·s/rad] for the ratio and stiffness of a gait, leg hanging."""
    leg = _leg()
    inertia = np.diag(leg.mass_matrix(np.zeros(leg.nv)))[[leg.index(Side.RIGHT, joint) for joint in JOINTS]]
    return Pair(*(damping_from_ratio(GAIT_DAMPING_RATIO, GAIT_STIFFNESS, float(each)) for each in inertia))


def least_gain(joint: JointName, angle: float) -> float:
    """Return the least gain with which a raised joint falls through the vertical in 5 s; 0 without need.

    It alone is raised, in [rad], and compensated.
    """

    def passes(gain: float) -> bool:
        experiment = hanging_experiment(_alone(joint, gain), raised=_alone(joint, angle), duration=FALLING)
        return bool((joint_angles(simulate(experiment))[:, JOINTS.index(joint)] <= 0.0).any())

    return 0.0 if passes(0.0) else bisect(passes, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class LegFindings:
    """Findings on the leg.

    ``alone`` is the limit of the hip's gain and of the knee's, the other joint without compensation; ``both``
    of both raised alike; ``soft_hip`` of the two alone with that s; ``least`` the least gains by ``ANGLES``;
    ``swings``: whether the leg keeps swinging for hip and knee gains of ``SHOWN``, shape (n_hip, n_knee).
    """

    alone: Pair
    both: float
    soft_hip: Pair
    least: Mapping[float, Pair]
    swings: np.ndarray


def leg_findings() -> LegFindings:
    """Simulate the release of the leg with all these gains."""
    maps = [
        [leg_keeps_swinging(simulate(hanging_experiment(Pair(hip, knee)))) for knee in SHOWN] for hip in SHOWN
    ]
    return LegFindings(
        alone=Pair(swing_limit(HIP_ONLY), swing_limit(KNEE_ONLY)),
        both=swing_limit(BOTH),
        soft_hip=Pair(swing_limit(HIP_ONLY, SOFT_HIP), swing_limit(KNEE_ONLY, SOFT_HIP)),
        least={
            angle: Pair(*(least_gain(joint, math.radians(angle)) for joint in JOINTS)) for angle in ANGLES
        },
        swings=np.array(maps),
    )


def leg_numbers(found: LegFindings) -> dict[str, Any]:
    """Return limits over s with their bands, and the limits of the linear loop with springs and gaits."""
    directions = (HIP_ONLY, KNEE_ONLY, BOTH)
    highest = max(linear_limit(way, velocity=velocity) for way in directions for velocity in VELOCITIES)
    gait = {"stiffness": GAIT_STIFFNESS, "damping": gait_damping()}
    least, raised = found.least[ANGLES[0]], math.radians(ANGLES[0])
    return {
        "hip": found.alone.hip / RATIO,
        "knee": found.alone.knee / RATIO,
        "both": found.both / RATIO,
        "low": LEAST_SHARE,
        "high": highest / RATIO,
        "hip_over_knee": found.alone.hip / found.alone.knee,
        "hip_over_knee_low": RATIO / highest,
        "least_difference": least.hip - least.knee,
        "soft_hip_over_knee": found.soft_hip.hip / found.soft_hip.knee,
        "alone": [*found.alone],
        "both_limit": found.both,
        "soft_hip": [*found.soft_hip],
        "least": [*least],
        "weight": [weight_torque(joint, raised) for joint in JOINTS],
        "spring": [linear_limit(way, stiffness=STIFFNESS) for way in directions[:2]],
        "gait": [linear_limit(way, **gait) for way in directions[:2]],
    }
