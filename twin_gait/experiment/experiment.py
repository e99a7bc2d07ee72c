"""One frozen value that says everything a run needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from twin_gait.exceptions import ParameterError
from twin_gait.experiment.control import PATH_JOINTS, ControlMode, ControlParameters
from twin_gait.experiment.integration import (
    Engine,
    Integration,
    IntegrationMethod,
    Scenario,
    default_integration,
)
from twin_gait.experiment.plant import PlantParameters
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.leg_model import Bodies, LegModel
from twin_gait.parameters import (
    BraceParameters,
    NetworkParameters,
    Patient,
    SensorParameters,
    require,
)
from twin_gait.vocabulary import JointName, PelvisGuide
from twin_gait.worlds.bracing import brace_world, carries, rk4_growth, semi_implicit_euler_growth
from twin_gait.worlds.faults import Fault, FaultKind, check_faults
from twin_gait.worlds.treadmill import Treadmill
from twin_gait.worlds.world import LegSource, World, build_leg_model

# A log keeps about 1 kB a millisecond in memory; an hour of walking is 3 GB.
LONGEST_RUN = 3600.0  # [s]


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
        network: The CAN bus between central unit and boards, or None where nothing is late.
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
    network: NetworkParameters | None = None

    def __post_init__(self) -> None:
        """Check the duration, the joints of the table, the seed and the faults."""
        require(
            math.isfinite(self.duration) and TICK <= self.duration <= LONGEST_RUN,
            "duration",
            f"a number of seconds from {TICK:g} to {LONGEST_RUN:g}",
            self.duration,
        )
        require(self.seed >= 0, "seed", "a whole number of 0 or more", self.seed)
        self._check_joints()
        feet = isinstance(self.scenario, Treadmill)
        check_faults(self.faults, self.leg.legs, feet, self.duration, self.joints)
        for side, joint in self.sensors.offset:
            require(side in self.leg.legs, "sensors offset", "a leg of the experiment", str(side))
            require(joint in self.joints, "sensors offset", f"one of {', '.join(self.joints)}", str(joint))
        missing = [item for item in self.faults if item.kind is FaultKind.ENCODER_MISSING]
        if missing and not self.control.safety.enabled:
            raise ParameterError(f"fault {missing[0]}: no gait without angles; switch control.safety on")
        if self.network is not None:
            self.network.require_fit(self.leg.legs, self.joints, self.duration)
        if self.interface is not None and self.patient is None:
            raise ParameterError("interface: braces need a wearer; give a patient, or interface: rigid")

    def _check_joints(self) -> None:
        """Every joint that the table controls is one of the legs' and has a drive, friction and a path."""
        table = f"gait table {self.table.name!r}"
        names = ", ".join(self.table.joints)
        if [joint for joint in JointName if joint in self.table.joints] != list(self.table.joints):
            expected = f"expected some of {', '.join(JointName)}, in this order"
            raise ParameterError(f"{table} controls {names}; {expected}")
        for joint in self.joints:
            controls = f"{table} controls the {joint}"
            for side, leg in self.leg.legs.items():
                if joint not in dict(leg.items()):
                    way_out = f"give its name in the URDF as leg.{side}.{joint}"
                    raise ParameterError(f"{controls}, which the {side} leg has not; {way_out}")
            if joint not in self.plant.actuators:
                raise ParameterError(f"{controls}, which has no drive; give plant.actuators.{joint}")
            if joint not in self.control.friction_model:
                raise ParameterError(f"control.friction_model.{joint}: {controls}; give its friction")
        if self.control.mode is not ControlMode.POSITION:
            return
        if self.joints != PATH_JOINTS:
            paths = f"position has a path for {', '.join(PATH_JOINTS)}"
            raise ParameterError(f"control.mode: {paths}, {table} controls {names}; take another mode")
        for joint in self.joints:
            if joint not in self.control.path.stiffness:
                spring = f"control.path.stiffness.{joint}"
                raise ParameterError(f"{spring}: the {joint} follows a path; give its spring")

    @property
    def joints(self) -> tuple[JointName, ...]:
        """Controlled joints of a leg, in the order of the chain."""
        return tuple(JointName(name) for name in self.table.joints)

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
        return self.scenario.steady if isinstance(self.scenario, Treadmill) else (0.0, math.inf)

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
            actuators=self.plant.actuators,
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
