"""What the leg of an experiment is, beside its rigid bodies."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from twin_gait import parameters
from twin_gait.core.plant import Plant, Spring, Stop, free_coordinate
from twin_gait.exceptions import ParameterError
from twin_gait.leg_model import LegModel
from twin_gait.parameters.quantities import NOT_NEGATIVE, Acceleration, Parameters, Ratio
from twin_gait.vocabulary import JointName
from twin_gait.worlds import BENCH_ACTUATORS, BENCH_FRICTION


@dataclass(frozen=True, kw_only=True)
class PlantParameters(Parameters):
    """What the leg really is, beside its rigid bodies.

    Attributes:
        friction_ratio: True friction over the model of table 3.1, per joint; 1 for one that is left out of
            a mapping made in Python.
        friction: The friction law that the ratio scales; any law, the compensator keeps its own.
        actuators: Motor and gear per joint.
        battery: The pack.
        electronics: What draws from it beside the windings.
        stops: Mechanical stops.
        ankle: The orthosis.
        gravity: In [m] / [s²].
    """

    friction_ratio: Annotated[Mapping[JointName, Ratio], NOT_NEGATIVE] = field(
        default_factory=lambda: {JointName.HIP: 0.5, JointName.KNEE: 0.5}
    )
    friction: Mapping[JointName, parameters.FrictionLaw] = field(default_factory=lambda: {**BENCH_FRICTION})
    actuators: Mapping[JointName, parameters.ActuatorParameters] = field(default_factory=BENCH_ACTUATORS.copy)
    battery: parameters.BatteryParameters = field(default_factory=parameters.BatteryParameters)
    electronics: parameters.ElectronicsParameters = field(default_factory=parameters.ElectronicsParameters)
    stops: parameters.StopParameters = field(default_factory=parameters.StopParameters)
    ankle: parameters.AnkleParameters = field(default_factory=parameters.AnkleParameters)
    gravity: Annotated[Acceleration, NOT_NEGATIVE] = 9.81

    def __post_init__(self) -> None:
        """Check the ranges, that every drive has its friction, and write out the ratios that are left out."""
        super().__post_init__()
        left_out = {joint: 1.0 for joint in self.friction if joint not in self.friction_ratio}
        object.__setattr__(self, "friction_ratio", {**self.friction_ratio, **left_out})
        for joint in self.actuators:
            if joint not in self.friction:
                raise ParameterError(f"friction.{joint}: the {joint} has a drive; give its friction")

    def rows(self, model: LegModel) -> tuple[Plant, ...]:
        """Friction, stops and ankle springs of every coordinate of a model."""
        found, friction = tuple(free_coordinate() for _ in range(model.nv)), self.true_friction()
        tall, ankle = 0.0 if model.patient is None else model.patient.height, self.ankle
        stiffness = ankle.stiffness + ankle.relative_stiffness * model.total_mass * self.gravity * tall
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                row, actuator = found[model.index(side, joint)], self.actuators.get(joint)
                row.stop = Stop(
                    *model.position_limits(side, joint), self.stops.stiffness, self.stops.dissipation
                )
                if joint is JointName.ANKLE:
                    row.spring = Spring(stiffness, ankle.damping, stiffness * ankle.rest)
                if actuator is not None:
                    row.friction = friction[joint].in_plant(actuator.gear_efficiency)
                    row.armature = actuator.armature
        return found

    def true_friction(self) -> dict[JointName, parameters.FrictionLaw]:
        """Friction of the plant: the law times the ratio, per joint."""
        return {joint: law.scaled(self.friction_ratio[joint]) for joint, law in self.friction.items()}
