"""What the leg of an experiment is, beside its rigid bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin_gait.parameters import (
    HIP_ACTUATOR,
    HIP_FRICTION,
    KNEE_ACTUATOR,
    KNEE_FRICTION,
    ActuatorParameters,
    AnkleParameters,
    BatteryParameters,
    FrictionLaw,
    StopParameters,
    require,
    require_non_negative,
)
from twin_gait.vocabulary import MOTOR_JOINTS, JointName


@dataclass(frozen=True, kw_only=True)
class PlantParameters:
    """What the leg really is, beside its rigid bodies.

    Attributes:
        friction_ratio: True friction over the model of table 3.1, per joint.
        friction: The friction law that the ratio scales; any law, the compensator keeps its own.
        load_friction: Friction of the gear over the magnitude of the motor torque, per joint.
        actuators: Motor and gear per joint.
        battery: The pack.
        stops: Mechanical stops.
        ankle: The orthosis.
        gravity: In [m] / [s²].
    """

    friction_ratio: Mapping[JointName, float] = field(
        default_factory=lambda: {JointName.HIP: 0.5, JointName.KNEE: 0.5}
    )
    friction: Mapping[JointName, FrictionLaw] = field(
        default_factory=lambda: {JointName.HIP: HIP_FRICTION, JointName.KNEE: KNEE_FRICTION}
    )
    load_friction: Mapping[JointName, float] = field(default_factory=lambda: dict.fromkeys(MOTOR_JOINTS, 0.0))
    actuators: Mapping[JointName, ActuatorParameters] = field(
        default_factory=lambda: {JointName.HIP: HIP_ACTUATOR, JointName.KNEE: KNEE_ACTUATOR}
    )
    battery: BatteryParameters = field(default_factory=BatteryParameters)
    stops: StopParameters = field(default_factory=StopParameters)
    ankle: AnkleParameters = field(default_factory=AnkleParameters)
    gravity: float = 9.81

    def __post_init__(self) -> None:
        """Check the ranges."""
        for joint, ratio in self.friction_ratio.items():
            require_non_negative(f"friction_ratio of the {joint}", ratio)
        for joint, coefficient in self.load_friction.items():
            name = f"load_friction of the {joint}"
            require(0.0 <= coefficient < 1.0, name, "0 or more and below 1", coefficient)
        require_non_negative("gravity", self.gravity)

    def true_friction(self) -> dict[JointName, FrictionLaw]:
        """Friction of the plant: the law times the ratio, per joint."""
        return {joint: law.scaled(self.friction_ratio[joint]) for joint, law in self.friction.items()}
