"""One joint with a friction compensator, as the friction map sets it."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

from twin_gait.checking.linear_loop import spectral_radius, transition_matrix
from twin_gait.parameters import FrictionParameters, SensorParameters
from twin_gait.scenario.bench_joint import BenchFriction, BenchJoint, CompensationVelocity, TorqueControl
from twin_gait.studies.whatif.rig import LEVEL, MODEL, controlled, holding_torque, linear_loop, rig

DEGREE = math.pi / 180.0
# Decimation and window of the slow velocity: none, half of the thesis's, the thesis's, four times as long.
FILTERS = ((1, 1), (10, 1), (10, 10), (10, 40))
THESIS_FILTER = FILTERS[2]
THESIS_RATIO = 0.55  # about what the true friction was, if its compensator was unstable above G = 0.60
SPRING = 0.5 / DEGREE  # [N m] / [rad] that holds the joint; the softest of the thesis sags under a weight
PUSH = 0.3  # [rad] / [s], half of what a fall of the thesis reaches
DEAD_ZONE = 0.05  # [rad] / [s], past the steep part of the model


class Compensation(StrEnum):
    """Where the compensated velocity comes from."""

    MEASURED = "measured"
    DEAD_ZONE = "dead zone"
    REFERENCE = "reference"


class Law(StrEnum):
    """True friction law, times the ratio."""

    TABLE = "table 3.1"
    NO_DIP = "no dip"  # break-away as large as Coulomb friction
    DEEPER_DIP = "deeper dip"  # half the break-away torque


def true_law(law: Law, ratio: float) -> FrictionParameters:
    """Friction law of the plant.

    Args:
        law: Its shape.
        ratio: s, on all of it.

    Returns:
        The law.
    """
    breakaway = {
        Law.TABLE: MODEL.breakaway_torque,
        Law.NO_DIP: MODEL.coulomb_friction,
        Law.DEEPER_DIP: 0.5 * MODEL.breakaway_torque,
    }
    return replace(MODEL, breakaway_torque=breakaway[law]).scaled(ratio)


class Setting(NamedTuple):
    """One joint, held by a spring, that is pushed and let go.

    Attributes:
        compensation: Where the compensated velocity comes from.
        gain: G.
        ratio: s.
        filter: Decimation and window of the slow velocity.
        load: Weight in [kg].
        push: Speed at which it is let go in [rad] / [s].
        spring: In [N m] / [rad].
        law: Shape of the true friction.
        load_share: Coulomb friction per load.
    """

    compensation: Compensation = Compensation.MEASURED
    gain: float = 0.0
    ratio: float = THESIS_RATIO
    filter: tuple[int, int] = THESIS_FILTER
    load: float = 0.0
    push: float = PUSH
    spring: float = SPRING
    law: Law = Law.TABLE
    load_share: float = 0.0


def bench_of(setting: Setting) -> BenchJoint:
    """The bench as a setting describes it, without a hand.

    Args:
        setting: The setting.

    Returns:
        The test.
    """
    decimation, window = setting.filter
    bench = rig(
        setting.load,
        sensors=SensorParameters(ideal=False, decimation=decimation, window=window),
        friction=BenchFriction(law=true_law(setting.law, setting.ratio), coulomb_per_load=setting.load_share),
    )
    return replace(bench, control=_control(setting, holding_torque(bench)))


def _control(setting: Setting, target_torque: float) -> TorqueControl:
    reference = setting.compensation is Compensation.REFERENCE
    return controlled(
        friction_compensation_gain=setting.gain,
        compensation_velocity=CompensationVelocity.REFERENCE if reference else CompensationVelocity.MEASURED,
        dead_zone=DEAD_ZONE if setting.compensation is Compensation.DEAD_ZONE else 0.0,
        target_torque=target_torque,
        stiffness=setting.spring,
        equilibrium_angle=LEVEL,
    )


def growth_at_rest(setting: Setting) -> float:
    """Rate at which a small motion about rest grows, by the closed-loop transition matrix.

    Args:
        setting: The setting.

    Returns:
        In [1] / [s]; below 0 it decays. A dead zone and a reference that stands feed nothing back.
    """
    fed_back = setting.compensation is Compensation.MEASURED
    test = bench_of(setting if fed_back else setting._replace(gain=0.0))
    loop = linear_loop(test, 0.0, holding_torque(test))
    return math.log(spectral_radius(transition_matrix(loop))) / loop.frame
