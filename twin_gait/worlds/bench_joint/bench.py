"""One test on the joint bench, and the bench of each joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from twin_gait.parameters import (
    HIP_ACTUATOR,
    HIP_FRICTION,
    KNEE_ACTUATOR,
    KNEE_FRICTION,
    ActuatorParameters,
    BatteryParameters,
    FrictionParameters,
    LimitParameters,
    SensorParameters,
)
from twin_gait.parameters.quantities import (
    LATER,
    NOT_NEGATIVE,
    Acceleration,
    Angle,
    AngularVelocity,
    Parameters,
    Range,
    Time,
    require,
)
from twin_gait.vocabulary import JointName
from twin_gait.worlds.bench_joint.control import DutyControl, TorqueControl
from twin_gait.worlds.bench_joint.link import (
    HORIZONTAL,
    BenchFriction,
    CatalogueEfficiency,
    DriveParameters,
    InertialUnit,
    LinkParameters,
    Torsion,
)
from twin_gait.worlds.bench_leg import ImposedMotionParameters

BENCH_ACTUATORS: Mapping[JointName, ActuatorParameters] = {
    JointName.KNEE: KNEE_ACTUATOR,
    JointName.HIP: HIP_ACTUATOR,
}
BENCH_FRICTION: Mapping[JointName, FrictionParameters] = {
    JointName.KNEE: KNEE_FRICTION,
    JointName.HIP: HIP_FRICTION,
}
# L of the 24 V winding from the data sheet. That of the 36 V winding scales with the square of K_t, as its R
# does: 0.264 (0.109/0.0705)² = 0.63 mH (computed).
BENCH_INDUCTANCE: Mapping[JointName, float] = {
    JointName.KNEE: 0.264e-3,
    JointName.HIP: 0.264e-3 * (HIP_ACTUATOR.torque_constant / KNEE_ACTUATOR.torque_constant) ** 2,
}


@dataclass(frozen=True, kw_only=True)
class BenchJoint(Parameters):
    """One test on the joint bench.

    Attributes:
        actuator: Motor and gear.
        drive: Winding, inverter, current loop.
        friction: True friction.
        control: Controller; None leaves the winding open.
        link: Link, weight and stops.
        battery: Its voltage is the bus voltage at rest.
        efficiency: Losses of the gear under load beyond the friction law; None, because equation (3.1)
            already holds what was measured.
        torsion: Compliance of the gear; None for a rigid one.
        sensors: Encoder and velocity estimates.
        inertial_unit: On the link, for the inertia compensation; None for the differentiated encoder.
        limits: Of torque and current.
        imposed_motion: Imposed motion of the link, or None.
        start_angle: In [rad].
        start_velocity: In [rad] / [s].
        gravity: In [m] / [s²].
        duration: In [s].
        rest_at_stop: The test ends so long after the upper stop was reached, in [s]; infinite for never.
    """

    actuator: ActuatorParameters
    drive: DriveParameters
    friction: BenchFriction
    control: DutyControl | TorqueControl | None
    link: LinkParameters = field(default_factory=LinkParameters)
    battery: BatteryParameters = field(default_factory=BatteryParameters)
    efficiency: CatalogueEfficiency | None = None
    torsion: Torsion | None = None
    sensors: SensorParameters = field(default_factory=lambda: SensorParameters(ideal=False))
    inertial_unit: InertialUnit | None = None
    limits: LimitParameters = field(default_factory=LimitParameters)
    imposed_motion: ImposedMotionParameters | None = None
    start_angle: Angle = HORIZONTAL
    start_velocity: AngularVelocity = 0.0
    gravity: Annotated[Acceleration, NOT_NEGATIVE] = 9.81
    duration: Annotated[Time, Range(1e-3, 3600.0, words="0.001 to 3600 s")] = 5.0
    rest_at_stop: Annotated[Time, LATER] = math.inf

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        require(not self.sensors.offset, "sensors offset", "none on the joint bench", self.sensors.offset)


def bench_joint(joint: JointName, **changes: object) -> BenchJoint:
    """The bench with the motor and friction of a joint.

    ``joint``: knee or hip. ``changes``: attributes of :class:`BenchJoint` that differ; without ``control``
    the winding is open. Raises ParameterError if there is no such joint on the bench, or a value is out of
    its range.
    """
    require(joint in BENCH_ACTUATORS, "joint", "knee or hip", str(joint))
    chosen: dict[str, object] = {
        "actuator": BENCH_ACTUATORS[joint],
        "drive": DriveParameters(inductance=BENCH_INDUCTANCE[joint]),
        "friction": BenchFriction(law=BENCH_FRICTION[joint]),
        "control": None,
        **changes,
    }
    return BenchJoint(**chosen)  # type: ignore[arg-type]
