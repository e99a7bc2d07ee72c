"""Parameters of the device of an experiment: controller, and plant of the leg."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

from twin_gait.control.controller import Controller
from twin_gait.control.controllers import CONTROLLERS
from twin_gait.control.controllers.assistance import Assistance, AssistanceParameters
from twin_gait.control.controllers.position import PathParameters
from twin_gait.control.policy_parameters import PolicyParameters
from twin_gait.core.plant import MechanicalStop, Plant, Spring
from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters import quantities
from twin_gait.parameters.drives import (
    ActuatorParameters,
    BatteryParameters,
    ElectronicsParameters,
    LimitParameters,
    SafetyParameters,
)
from twin_gait.parameters.environment import AnkleParameters, StopParameters
from twin_gait.parameters.friction import FrictionLaw, FrictionParameters
from twin_gait.parameters.motor_bus import MotorBusParameters
from twin_gait.parameters.wearer import Patient
from twin_gait.vocabulary import JointName, Side

DELAYS = quantities.Range(0.0, 0.01, words=f"a multiple of {TICK:g} s from 0 to 0.01 s")

FRICTION_RATIOS = quantities.Range(0.0, 10.0, reason="a cold and worn gear has several times the friction")

# Names of the controllers that compute k, b, θ0, G and the gravity share.
ControlMode = StrEnum("ControlMode", {name.upper(): name for name in CONTROLLERS})  # type: ignore[misc]

_USUAL = ControlMode("impedance")


@dataclass(frozen=True, kw_only=True)
class DeviceIdentity(quantities.Parameters):
    """Identity of the device whose values are in the sections of the experiment.

    Attributes:
        name: Name of the file of the device, without its ending.
    """

    name: str = "own"


@dataclass(frozen=True, kw_only=True)
class ControlParameters(quantities.Parameters):
    """Parameters and limits of the controller.

    Attributes:
        mode: Controller that computes the parameters of the joints.
        assistance: Share of the impedance that the legs receive.
        path: Path of the mode ``position``.
        policy: Network of the mode ``policy``; a file may give the name or the path of a policy.
        friction_model: The compensator's own friction model (thesis, table 3.1).
        inertia_compensation: Gain g_in of the inertia term; off by default, because a differentiated
            encoder is noisy (thesis 2.4.2).
        target_torque: Torque in [N·m] that is added to the command (thesis, equation 2.16).
        limits: Limits of each joint; a file may give a value for all joints at once.
        safety: Safety monitor between controller and motor.
        patient: The wearer that gravity compensation assumes; None takes the true one.
        delay: Delay from a measurement to the resulting current in [s], a whole number of ticks; 0 for a
            firmware that responds within the tick. The command to the drives is zero until the first one
            arrives; the hold after a trip is delayed equally.
    """

    mode: ControlMode = _USUAL
    assistance: AssistanceParameters = field(default_factory=AssistanceParameters)
    path: PathParameters = field(default_factory=PathParameters)
    policy: PolicyParameters | None = None
    friction_model: Annotated[Mapping[JointName, FrictionParameters], quantities.AllEntries()]
    inertia_compensation: Annotated[quantities.Ratio, quantities.SHARE] = 0.0
    target_torque: Mapping[JointName, quantities.Torque] = field(
        default_factory=lambda: {JointName.HIP: 0.0, JointName.KNEE: 0.0}
    )
    limits: Annotated[Mapping[JointName, LimitParameters], quantities.AllEntries(), quantities.CommonValues()]
    safety: SafetyParameters
    patient: Patient | None = None
    delay: Annotated[quantities.Time, DELAYS] = 0.0

    def __post_init__(self) -> None:
        """Check the ranges, and that the delay is a whole number of ticks."""
        super().__post_init__()
        whole = abs(self.delay - self.delay_ticks * TICK) < 1e-9
        quantities.require(whole, "delay", DELAYS.expected, self.delay)
        for output in () if self.policy is None else self.policy.outputs:
            limit = self.limits.get(output.joint)
            if output.quantity == "torque_Nm" and limit is not None and output.bound > limit.torque:
                expected = f"a bound of {output.name} up to the torque limit, {limit.torque:g} N·m"
                raise ParameterError(f"policy.outputs: expected {expected}, got {output.bound:g}")

    def controller(self, user_controller: Controller | None = None) -> Controller:
        """Create the controller of the mode, or use one of the user's own, with its assistance.

        The fields of a shipped controller are initialized with the parameters of the same name here.
        """
        kind = CONTROLLERS[self.mode]
        settings = {name: getattr(self, name) for name in getattr(kind, "__dataclass_fields__", ())}
        acting = kind(**settings) if user_controller is None else user_controller
        return acting if self.assistance.is_full else Assistance(self.assistance, acting)

    @property
    def delay_ticks(self) -> int:
        """Delay in ticks."""
        return round(self.delay / TICK)

    def joint_range(self, model: LegModel, side: Side, joint: JointName) -> tuple[float, float]:
        """Return the lowest and highest angle of a joint in [rad]: of its limits or, without, of the URDF."""
        lower, upper = model.position_limits(side, joint)
        limits = self.limits.get(joint)
        if limits is None:
            return lower, upper
        return (
            lower if limits.lowest_angle is None else limits.lowest_angle,
            upper if limits.highest_angle is None else limits.highest_angle,
        )

    def highest_speed(self, model: LegModel, side: Side, joint: JointName) -> float:
        """Return the highest speed of a joint in [rad/s]: of its limits or, without, of the URDF."""
        limits = self.limits.get(joint)
        if limits is None or limits.highest_speed is None:
            return model.velocity_limit(side, joint)
        return limits.highest_speed


@dataclass(frozen=True, kw_only=True)
class PlantParameters(quantities.Parameters):
    """True properties of the leg in addition to its rigid bodies.

    Attributes:
        friction_ratio: True friction divided by the model of table 3.1, per joint; 1 for a joint that is left
            out of a mapping created in Python.
        friction: Friction law that the ratio scales; any law is possible, the compensator keeps its own.
        actuators: Motor and gear per joint.
        battery: Battery pack.
        electronics: Consumers of the pack other than the windings.
        stops: Mechanical stops.
        ankle: Orthosis of the ankle.
        motor_bus: Protocol of the drives on a real bus.
        gravity: Gravitational acceleration in [m/s²].
    """

    friction_ratio: Annotated[Mapping[JointName, quantities.Ratio], FRICTION_RATIOS, quantities.AllEntries()]
    friction: Annotated[Mapping[JointName, FrictionLaw], quantities.AllEntries()]
    actuators: Annotated[Mapping[JointName, ActuatorParameters], quantities.AllEntries()]
    battery: BatteryParameters
    electronics: ElectronicsParameters
    stops: StopParameters
    ankle: AnkleParameters
    motor_bus: MotorBusParameters
    gravity: Annotated[quantities.Acceleration, quantities.NOT_NEGATIVE] = 9.81

    def __post_init__(self) -> None:
        """Check the ranges and that every drive has its friction, and add the ratios that are left out."""
        super().__post_init__()
        left_out = {joint: 1.0 for joint in self.friction if joint not in self.friction_ratio}
        object.__setattr__(self, "friction_ratio", {**self.friction_ratio, **left_out})
        for joint in self.actuators:
            if joint not in self.friction:
                raise ParameterError(f"friction.{joint}: the {joint} has a drive; give its friction")

    def rows(self, model: LegModel, driven_sides: Collection[Side]) -> tuple[Plant, ...]:
        """Return friction, stops and ankle springs of every coordinate of a model.

        ``driven_sides``: legs of the device, whose joints have drives with friction.
        """
        found, friction = tuple(Plant() for _ in range(model.nv)), self.true_friction()
        tall, ankle = 0.0 if model.patient is None else model.patient.height, self.ankle
        stiffness = ankle.stiffness + ankle.relative_stiffness * model.total_mass * self.gravity * tall
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                row = found[model.index(side, joint)]
                actuator = self.actuators.get(joint) if side in driven_sides else None
                row.stop = MechanicalStop(
                    *model.position_limits(side, joint), self.stops.stiffness, self.stops.dissipation
                )
                if joint is JointName.ANKLE and side in (ankle.sides or model.sides):
                    row.spring = Spring(stiffness, ankle.damping, stiffness * ankle.rest)
                if actuator is not None:
                    row.friction = friction[joint].to_plant_friction(actuator.gear_efficiency)
                    row.armature = actuator.armature
        return found

    def true_friction(self) -> dict[JointName, FrictionLaw]:
        """Compute the friction of the plant: the law times the ratio, per joint."""
        return {joint: law.scaled(self.friction_ratio[joint]) for joint, law in self.friction.items()}


def check_limits(limits: Mapping[JointName, LimitParameters], plant: PlantParameters) -> None:
    """Raise ParameterError if a drive has no limits, or a torque limit above the ceiling of the drive."""
    for joint, drive in plant.actuators.items():
        if joint not in limits:
            raise ParameterError(f"control.limits.{joint}: is missing, but the {joint} has a drive; add it")
        torque, ceiling = limits[joint].torque, drive.torque_ceiling(plant.battery.voltage)
        if torque > ceiling:
            section = f"plant.actuators.{joint}"
            stated = "the torque at its peak current"
            if drive.peak_torque is not None:
                stated = f"{section}.peak_torque_Nm"
            elif drive.peak_current is None:
                stated = (
                    f"the stall torque of the drive; {section} states no peak_torque_Nm or peak_current_A"
                )
            problem = f"expected at most {ceiling:.4g} N·m ({stated}), got {torque:g} N·m"
            raise ParameterError(
                f"control.limits.{joint}.torque_Nm: {problem}; lower it, or use another drive"
            )


ROUNDING = 1e-5  # limits of motion may exceed those of a URDF by this [rad, rad/s], which has few decimals


def check_motion_limits(
    control: ControlParameters, model: LegModel, plant: PlantParameters, driven_sides: Collection[Side]
) -> None:
    """Raise ParameterError if the speed or the range of a joint with a drive exceeds that of the URDF.

    ``driven_sides``: legs of the device.
    """
    for side in driven_sides:
        for joint, name in model.legs[side].items():
            limits = control.limits.get(joint)
            if limits is None or joint not in plant.actuators:
                continue
            where = f"joint {name!r} of the URDF"
            spanned, fastest = model.position_limits(side, joint), model.velocity_limit(side, joint)
            for key, value, unit, (lower, upper) in (
                ("highest_speed_rad_per_s", limits.highest_speed, "rad/s", (0.0, fastest)),
                ("lowest_angle_rad", limits.lowest_angle, "rad", spanned),
                ("highest_angle_rad", limits.highest_angle, "rad", spanned),
            ):
                if value is not None and not lower - ROUNDING <= value <= upper + ROUNDING:
                    problem = f"expected {lower:.4g} to {upper:.4g} {unit} as {where}, got {value:g} {unit}"
                    raise ParameterError(
                        f"control.limits.{joint}.{key}: {problem}; narrow it, or leave it out"
                    )
