"""One frozen value that says everything a run needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.leg_model import Bodies, LegModel, PelvisGuide
from twin_gait.parameters import (
    HIP_ACTUATOR,
    HIP_FRICTION,
    KNEE_ACTUATOR,
    KNEE_FRICTION,
    ActuatorParameters,
    AnkleParameters,
    BatteryParameters,
    BraceParameters,
    FrictionLaw,
    FrictionParameters,
    LimitParameters,
    Patient,
    SafetyParameters,
    SensorParameters,
    StopParameters,
    require,
    require_non_negative,
    require_share,
)
from twin_gait.scenario.bench_leg import BenchLegScenario
from twin_gait.scenario.bracing import brace_world, carries, rk4_growth, semi_implicit_euler_growth
from twin_gait.scenario.faults import Fault, FaultKind, check_faults
from twin_gait.scenario.treadmill import TreadmillScenario
from twin_gait.scenario.world import LegSource, World, build_leg_model
from twin_gait.vocabulary import MOTOR_JOINTS, JointName

# A log keeps about 1 kB a millisecond in memory; an hour of walking is 3 GB.
LONGEST_RUN = 3600.0  # [s]


class Engine(StrEnum):
    """What steps through the episode: the same laws, as Python on Pinocchio or compiled."""

    PINOCCHIO = "pinocchio"
    COMPILED = "compiled"


class IntegrationMethod(StrEnum):
    """Fixed-step integrator of the plant."""

    SEMI_IMPLICIT_EULER = "semi_implicit_euler"
    RK4 = "rk4"


class ControlMode(StrEnum):
    """Where k, b, θ0, G and the gravity share come from."""

    IMPEDANCE = "impedance"  # the phases of the gait table
    TRANSPARENT = "transparent"  # G and gravity shares of the table, no impedance
    GRAVITY = "gravity"  # gravity carried in full and G of the table, no impedance (TWIN's gravity mode)
    CONSTANT = "constant"  # one impedance for the whole stride: the mean of the table's
    POSITION = "position"  # a stiff spring that follows a predetermined path (TWIN's walk mode)


# In [s]. Finer steps gain nothing: rounding outgrows the integrator's error, and a second takes minutes.
FINEST_STEP = 1e-7


@dataclass(frozen=True, kw_only=True)
class Integration:
    """Integrator and step.

    Attributes:
        method: The integrator.
        step: In [s]; a whole number of steps must fill a tick of 1 ms.
    """

    method: IntegrationMethod = IntegrationMethod.SEMI_IMPLICIT_EULER
    step: float = 0.25e-3

    def __post_init__(self) -> None:
        """Check that steps fill a tick."""
        require(
            FINEST_STEP <= self.step <= TICK,
            "integration step",
            f"{FINEST_STEP:g} to {TICK:g} s",
            self.step,
        )
        ratio = TICK / self.step
        require(
            abs(ratio - round(ratio)) < 1e-9 * ratio,
            "integration step",
            f"a whole number of steps in {TICK:g} s, such as {TICK / max(1, round(ratio)):g} s",
            self.step,
        )

    @property
    def substeps(self) -> int:
        """Steps in a tick."""
        return round(TICK / self.step)


@dataclass(frozen=True, kw_only=True)
class AssistanceParameters:
    """How much of the impedance the legs are given.

    Attributes:
        share: Of k and b per joint, 0 to 1 (TwinCare's assistance); where adaptive, at the start.
        adaptive: Whether the share of each joint changes from stride to stride, see
            :func:`twin_gait.core.assistance.adapted_assistance`.
        forgetting: f (assumption: assistance halves in seven strides without an error).
        gain: g in 1 / [rad] (assumption: an error of 10° beyond the allowance keeps full assistance).
        allowance: e_0 in [rad] (assumption: somewhat below the error of the shipped gait).
        least: α_min (assumption).
    """

    share: Mapping[JointName, float] = field(
        default_factory=lambda: {JointName.HIP: 1.0, JointName.KNEE: 1.0}
    )
    adaptive: bool = False
    forgetting: float = 0.9
    gain: float = 0.6
    allowance: float = math.radians(4.0)
    least: float = 0.2

    def __post_init__(self) -> None:
        """Check the ranges."""
        for joint, share in self.share.items():
            require_share(f"assistance share of the {joint}", share)
        require_share("assistance forgetting", self.forgetting)
        require_non_negative("assistance gain", self.gain)
        require_non_negative("assistance allowance", self.allowance)
        require_share("assistance least", self.least)

    @property
    def is_full(self) -> bool:
        """Whether the impedance is given as it is."""
        return not self.adaptive and all(share == 1.0 for share in self.share.values())


@dataclass(frozen=True, kw_only=True)
class PathParameters:
    """Spring and damper that follow the predetermined path in the mode ``position``.

    Attributes:
        stiffness: In [N m] / [rad], per joint (assumption: the hip stiffer than in any phase of the shipped
            table, so that the default wearer follows to 2°; the knee to 6° with 4 N m/deg, where the limits
            cut 2 % of the ticks; with 7 it would be 4° and four times as many).
        damping_ratio: ζ of the joint on this spring.
        friction_compensation_gain: G.
        gravity_compensation: Share of gravity compensation.
    """

    stiffness: Mapping[JointName, float] = field(
        default_factory=lambda: {JointName.HIP: math.degrees(9.0), JointName.KNEE: math.degrees(4.0)}
    )
    damping_ratio: float = 0.7
    friction_compensation_gain: float = 0.35
    gravity_compensation: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for joint, stiffness in self.stiffness.items():
            require_non_negative(f"path stiffness of the {joint}", stiffness)
        require_non_negative("path damping_ratio", self.damping_ratio)
        require_share("path friction_compensation_gain", self.friction_compensation_gain)
        require_share("path gravity_compensation", self.gravity_compensation)


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """What the controller knows and may do.

    Attributes:
        mode: Where the parameters of the joints come from.
        assistance: How much of the impedance the legs are given.
        path: Of the mode ``position``.
        friction_model: The compensator's own friction model (thesis, table 3.1).
        inertia_compensation: Gain g_in of the inertia term; off by default, because a differentiated
            encoder is noisy (thesis 2.4.2).
        target_torque: Added to the command in [N m] (thesis, equation 2.16).
        limits: Of torque and current.
        safety: The monitor between controller and motor.
        patient: The wearer that gravity compensation assumes; None takes the true one.
    """

    mode: ControlMode = ControlMode.IMPEDANCE
    assistance: AssistanceParameters = field(default_factory=AssistanceParameters)
    path: PathParameters = field(default_factory=PathParameters)
    friction_model: Mapping[JointName, FrictionParameters] = field(
        default_factory=lambda: {JointName.HIP: HIP_FRICTION, JointName.KNEE: KNEE_FRICTION}
    )
    inertia_compensation: float = 0.0
    target_torque: Mapping[JointName, float] = field(default_factory=lambda: dict.fromkeys(MOTOR_JOINTS, 0.0))
    limits: LimitParameters = field(default_factory=LimitParameters)
    safety: SafetyParameters = field(default_factory=SafetyParameters)
    patient: Patient | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_share("inertia_compensation", self.inertia_compensation)


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


Scenario = TreadmillScenario | BenchLegScenario


def default_integration(engine: Engine, scenario: Scenario, *, braced: bool = False) -> Integration:
    """Integrator and step where none is asked for.

    The compiled engine can afford what the accuracy of the solution calls for: Runge-Kutta at 1 ms, and at
    0.1 ms where stiff contacts open and close or braces bind a light foot. The Pinocchio engine steps in
    Python and takes the largest step at which it still runs the contacts stably and faster than real time.

    Args:
        braced: Whether braces bind the wearer to the device.

    Returns:
        Integrator and step.
    """
    if engine is Engine.PINOCCHIO:
        return Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3)
    step = 0.1e-3 if braced or isinstance(scenario, TreadmillScenario) else 1e-3
    return Integration(method=IntegrationMethod.RK4, step=step)


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Everything that a run needs; two runs of equal experiments give equal logs.

    Attributes:
        name: Name of the preset or file.
        scenario: The world.
        leg: URDF and joint names.
        table: The gait table, before scaling.
        duration: In [s], a whole number of ticks.
        patient: The wearer, or None for the empty device.
        control: The controller.
        plant: The leg.
        sensors: Encoders and filters.
        integration: Integrator and step; None takes those of :func:`default_integration`.
        engine: What computes the forward dynamics.
        seed: Of every random draw.
        faults: What breaks on the way.
        interface: Braces between wearer and device, or None if the two are one body.
    """

    name: str
    scenario: Scenario
    leg: LegSource
    table: GaitTable
    duration: float = 20.0
    patient: Patient | None = field(default_factory=Patient)
    control: ControlParameters = field(default_factory=ControlParameters)
    plant: PlantParameters = field(default_factory=PlantParameters)
    sensors: SensorParameters = field(default_factory=SensorParameters)
    integration: Integration | None = None
    engine: Engine = Engine.COMPILED
    seed: int = 0
    faults: tuple[Fault, ...] = ()
    interface: BraceParameters | None = None

    def __post_init__(self) -> None:
        """Check the duration, the joints of the table, the seed and the faults."""
        require(
            math.isfinite(self.duration) and TICK <= self.duration <= LONGEST_RUN,
            "duration",
            f"a number of seconds from {TICK:g} to {LONGEST_RUN:g}",
            self.duration,
        )
        require(self.seed >= 0, "seed", "a whole number of 0 or more", self.seed)
        if tuple(self.table.joints) != (JointName.HIP, JointName.KNEE):
            raise ParameterError(
                f"gait table {self.table.name!r} is for {', '.join(self.table.joints)}; "
                "this device drives hip, knee"
            )
        check_faults(self.faults, self.leg.legs, isinstance(self.scenario, TreadmillScenario), self.duration)
        missing = [item for item in self.faults if item.kind is FaultKind.ENCODER_MISSING]
        if missing and not self.control.safety.enabled:
            raise ParameterError(f"fault {missing[0]}: no gait without angles; switch control.safety on")
        if self.interface is not None and self.patient is None:
            raise ParameterError("interface: braces need a wearer; give a patient, or interface: rigid")

    @property
    def stepping(self) -> Integration:
        """Integrator and step that are used."""
        braced = self.interface is not None
        return self.integration or default_integration(self.engine, self.scenario, braced=braced)

    @property
    def n_ticks(self) -> int:
        """Length of the run in ticks."""
        return round(self.duration / TICK)

    @property
    def steady(self) -> tuple[float, float]:
        """From when to when in [s] the legs are to walk evenly."""
        return self.scenario.steady if isinstance(self.scenario, TreadmillScenario) else (0.0, math.inf)

    def build_world(self) -> World:
        """Build the world with its rigid-body model.

        Returns:
            The world.

        Raises:
            ModelError: If the URDF cannot be used.
            ParameterError: If something does not fit together, or the step does not carry braces or bristles.
        """
        world = self.scenario.build(
            self._plant_model(Bodies.BOTH),
            friction=self.plant.true_friction(),
            load_friction=self.plant.load_friction,
            stops=self.plant.stops,
            ankle=self.plant.ankle,
            gravity=self.plant.gravity,
        )
        if self.interface is not None:
            device, wearer = self._plant_model(Bodies.DEVICE), self._plant_model(Bodies.WEARER)
            world = brace_world(world, device, wearer, self.interface)
        stiff = {} if self.interface is None else {"interface": "braces"}
        if any(plant.friction.bristle_stiffness > 0.0 for plant in world.plant):
            stiff["plant.friction"] = "bristles"
        if stiff:
            self._require_step_for(world, " or ".join(stiff), " or ".join(stiff.values()))
        return world

    def _plant_model(self, bodies: Bodies) -> LegModel:
        return build_leg_model(
            self.leg,
            patient=self.patient,
            actuators=self.plant.actuators,
            pelvis=self.scenario.pelvis,
            gravity=self.plant.gravity,
            bodies=bodies,
        )

    def _require_step_for(self, world: World, keys: str, what: str) -> None:
        """Refuse what would oscillate more from step to step."""
        runge_kutta = self.stepping.method is IntegrationMethod.RK4
        growth = rk4_growth if runge_kutta else semi_implicit_euler_growth
        if carries(world, growth, self.stepping.step):
            return
        finer = (TICK / self.stepping.substeps / factor for factor in (2, 5, 10, 20, 50, 100))
        enough = next((step for step in finer if carries(world, growth, step)), None)
        way_out = "take" if enough is None else f"set integration.step_ms to {1e3 * enough:g} or take"
        raise ParameterError(
            f"{keys}: the {what} are too stiff or too strongly damped for a step of "
            f"{1e3 * self.stepping.step:g} ms ({self.stepping.method}); {way_out} softer {what}"
        )

    def build_control_model(self) -> LegModel:
        """Model of the controller: pelvis fixed, the wearer as it assumes them.

        Returns:
            The model.
        """
        return build_leg_model(
            self.leg,
            patient=self.patient if self.control.patient is None else self.control.patient,
            actuators=self.plant.actuators,
            pelvis=PelvisGuide.FIXED,
            gravity=self.plant.gravity,
        )
