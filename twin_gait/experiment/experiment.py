"""Experiment: one frozen value that contains everything a run needs."""

import warnings
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Annotated, Any

from twin_gait.control.user_controller import UserController
from twin_gait.exceptions import ParameterError
from twin_gait.experiment.device import (
    ControlParameters,
    DeviceIdentity,
    PlantParameters,
    check_limits,
    check_motion_limits,
)
from twin_gait.experiment.events import HELD_PHASE, Change, Event, Push, Step
from twin_gait.experiment.own_gait import OwnGait
from twin_gait.experiment.reference_gait import ReferenceGait
from twin_gait.gait.modes import ModeTable, TimedRequest, check_requests, parse_request
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.leg_model.joints import BodySelection
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.leg_model.urdf_document import UrdfWarning
from twin_gait.parameters.drives import SensorParameters
from twin_gait.parameters.environment import BraceParameters
from twin_gait.parameters.network import NetworkParameters
from twin_gait.parameters.quantities import (
    SEEDS,
    CustomSerialized,
    LiteralAlias,
    Notation,
    Parameters,
    Range,
    Time,
    require,
)
from twin_gait.parameters.wearer import JointCondition, Patient
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.bracing import brace_world, is_step_stable
from twin_gait.worlds.faults import Fault, FaultKind, parse_fault
from twin_gait.worlds.registry import build_world
from twin_gait.worlds.world import LegSource, Scenario, World


class Engine(StrEnum):
    """Engine that simulates an episode by the same laws: plain Python over Pinocchio, or compiled code."""

    PINOCCHIO = "pinocchio"
    COMPILED = "compiled"


class IntegrationMethod(StrEnum):
    """Fixed-step integrator of the plant."""

    SEMI_IMPLICIT_EULER = "semi_implicit_euler"
    RK4 = "rk4"


# Smallest step in [s]. With a smaller one, rounding exceeds the error of the integrator, and a simulated
# second takes minutes.
FINEST_STEP = 1e-7
STEPS = Range(FINEST_STEP, TICK, words=f"{FINEST_STEP:g} to {TICK:g} s")


@dataclass(frozen=True, kw_only=True)
class Integration(Parameters):
    """Integrator and integration step of the plant.

    Attributes:
        method: Integration method.
        step: Integration step in [s]; a tick of 1 ms must contain a whole number of steps.
    """

    method: IntegrationMethod = IntegrationMethod.SEMI_IMPLICIT_EULER
    step: Annotated[Time, STEPS] = 0.25e-3

    def __post_init__(self) -> None:
        """Check that a tick contains a whole number of steps."""
        super().__post_init__()
        ratio = TICK / self.step
        such = f"a whole number of steps in {TICK:g} s, such as {TICK / max(1, round(ratio)):g} s"
        require(abs(ratio - round(ratio)) < 1e-9 * ratio, "step", such, self.step)

    @property
    def substeps(self) -> int:
        """Number of steps in a tick."""
        return round(TICK / self.step)


def default_integration(
    engine: Engine,
    scenario: Scenario,
    *,
    braced: bool = False,
    method: IntegrationMethod = IntegrationMethod.RK4,
) -> Integration:
    """Return the default integrator and step of an engine.

    The compiled engine is fast enough for the step that an accurate solution requires: Runge-Kutta at the
    step of the world, which is smaller if braces hold a light foot. The semi-implicit Euler method takes
    half of this step, because a damper that is stable with Runge-Kutta for a step h is stable with it for
    0.72 h. The Pinocchio engine runs in Python and uses the largest step with which contacts are stable.

    ``braced``: whether braces connect wearer and device. ``method``: the integrator of the compiled engine.
    """
    if engine is Engine.PINOCCHIO:
        return Integration()
    step = scenario.braced_step if braced else scenario.step
    return Integration(method=method, step=step if method is IntegrationMethod.RK4 else 0.5 * step)


# A log needs about 1 kB of memory per tick, so an hour of walking needs 3 GB.
LONGEST_RUN = 3600.0  # [s]
DURATIONS = Range(TICK, LONGEST_RUN, words=f"a number of seconds from {TICK:g} to {LONGEST_RUN:g}")


@dataclass(frozen=True, kw_only=True)
class Experiment(Parameters):
    """All parameters of a run; two runs of equal experiments give equal logs.

    Attributes:
        name: Name of the preset or file.
        scenario: World in which the legs walk.
        device: Identity of the device, whose values are in ``leg``, ``plant``, ``control`` and ``sensors``.
        leg: URDF and joint names of the legs.
        table: Gait table, before scaling.
        duration: Duration in [s], rounded to whole ticks.
        patient: Wearer, or None for the empty device.
        own_gait: The wearer's own gait, which moves the joints without a drive, or None.
        control: Parameters of the controller.
        plant: True properties of legs and drives.
        sensors: Encoders, filters and the inertial measurement unit.
        integration: Integrator and step; None for those of :func:`default_integration`.
        engine: Engine that simulates the run.
        seed: Seed of every random draw.
        faults: Faults that occur during the run.
        interface: Braces between wearer and device, or None if the two are one body.
        network: CAN bus between central unit and boards, or None for signals without delay.
        modes: Table of operating modes, or None if the legs walk by the gait table alone.
        initial_mode: Mode at the start; None for the first mode of the table.
        requests: Requests to the supervisor, with their times.
        controller: Record of a controller of the user's own, which replaces ``control.mode``, or None.
        events: Changes, pushes, steps by hand and emergency stops, in the order of their times.
        reference: Measured gait with which the run is compared; None for Koopman et al. (2014).
    """

    name: str
    scenario: Scenario
    leg: LegSource
    device: DeviceIdentity = field(default_factory=DeviceIdentity)
    table: Annotated[GaitTable, CustomSerialized()]
    duration: Annotated[Time, DURATIONS] = 20.0
    patient: Patient | None = field(default_factory=Patient)
    own_gait: Annotated[OwnGait | None, CustomSerialized()] = None
    control: ControlParameters
    plant: PlantParameters
    sensors: SensorParameters
    integration: Integration | None = None
    engine: Engine = Engine.COMPILED
    seed: Annotated[int, SEEDS] = 0
    faults: Annotated[tuple[Fault, ...], Notation(parse_fault)] = ()
    interface: Annotated[BraceParameters | None, LiteralAlias("rigid", "brace")] = None
    network: Annotated[NetworkParameters | None, LiteralAlias("ideal", "can")] = None
    modes: Annotated[ModeTable | None, CustomSerialized()] = None
    initial_mode: str | None = None
    requests: Annotated[tuple[TimedRequest, ...], Notation(parse_request)] = ()
    controller: Annotated[UserController | None, CustomSerialized()] = None
    events: Annotated[tuple[Event, ...], CustomSerialized()] = ()
    reference: Annotated[ReferenceGait | None, CustomSerialized()] = None

    def __post_init__(self) -> None:
        """Check the ranges, and that all parts fit each other."""
        super().__post_init__()
        plain = isinstance(self.name, str) and self.name and not set(self.name) & set("/\\\0\n")
        require(bool(plain), "name", "a name without slashes, line breaks and null characters", self.name)
        self._check_joints()
        check_limits(self.control.limits, self.plant)
        for fault in self.faults:
            fault.require_fit(self.sides, self.joints, self.scenario.grounded, self.duration)
        for side, angles in self.sensors.offset.items():
            require(side in self.sides, "sensors offset", "a leg of the device", str(side))
            for joint in angles:
                known = f"one of {', '.join(self.joints)}"
                require(joint in self.joints, "sensors offset", known, str(joint))
        blind = [str(item) for item in self.faults if item.kind is FaultKind.ENCODER_MISSING]
        safe = self.control.safety.enabled or not blind
        expected = "control.safety.enabled: true, because the legs cannot walk without angles"
        require(safe, "faults", expected, ", ".join(blind))
        if self.network is not None:
            self.network.require_fit(self.sides, self.joints, self.duration)
        self._check_modes()
        self._check_events()
        self._check_own_gait()
        bare = self.patient is None or self.scenario.pelvis is PelvisGuide.FREE
        expected = "rigid, because there is no wearer, or one whose trunk is free"
        require(self.interface is None or not bare, "interface", expected, "brace")

    def _check_modes(self) -> None:
        """Check that the modes use joints of two legs, and postures of the gait table."""
        check_requests(self.requests, self.modes)
        if self.modes is None:
            expected = "null without modes, or a table of modes under modes, such as twin"
            require(self.initial_mode is None, "initial_mode", expected, str(self.initial_mode))
            return
        table, modes = f"gait table {self.table.name!r}", f"modes {self.modes.name!r}"
        known = f"one of {', '.join(self.modes.phases)} of {modes}"
        require(self.initial_mode in (None, *self.modes.phases), "initial_mode", known, self.initial_mode)
        require(len(self.sides) == 2, "modes", "a device with two legs", ", ".join(self.sides))
        controlled = f"joints that {table} controls, {', '.join(self.table.joints)}"
        are_controlled = set(self.modes.joints) <= set(self.table.joints)
        require(are_controlled, f"joints of {modes}", controlled, ", ".join(self.modes.joints))
        offered = f"one of the postures of {table} ({', '.join(self.table.postures) or 'none'})"
        for name, mode in self.modes.phases.items():
            is_offered = mode.posture in (None, *self.table.postures)
            require(is_offered, f"posture of {name} in {modes}", offered, mode.posture)

    def _check_events(self) -> None:
        """Sort the events by time; check their times and joints, and that steps by hand are possible."""
        object.__setattr__(self, "events", tuple(sorted(self.events, key=lambda item: item.tick)))
        joints = [f"{side}_{joint}" for side in self.sides for joint in self.joints]
        for item in self.events:
            ends = f"a time before the end of the run at {self.duration:g} s"
            require(item.tick < self.n_ticks, "events", ends, round(item.tick * TICK, 3))
            if isinstance(item, Push):
                require(item.joint in joints, "joint of a push", f"one of {', '.join(joints)}", item.joint)
            if isinstance(item, Step) or (isinstance(item, Change) and item.changes.get("manual")):
                expected = f"a gait table with the phase {HELD_PHASE}, and no modes (then send requests)"
                require(self.stepped_by_hand, "steps by hand", expected, self.table.name)

    def _check_own_gait(self) -> None:
        """Check that the wearer's own gait has a wearer, a world and joints that fit it."""
        own = self.own_gait
        if own is None:
            return
        if self.patient is None:
            raise ParameterError("own_gait: expected null without a patient, who would walk")
        guided = self.scenario.pelvis in (PelvisGuide.VERTICAL, PelvisGuide.HARNESS, PelvisGuide.STRAPS)
        require(
            guided,
            "own_gait",
            "null but on a treadmill, because it is found for a guided pelvis",
            own.table.name,
        )
        require(self.modes is None, "own_gait", "null with modes, which it does not know", own.table.name)
        for side, leg in self.leg.legs.items():
            for joint in own.joints:
                known = f"joints that leg.{side} has, {', '.join(name for name, _ in leg.items())}"
                require(joint in dict(leg.items()), "own_gait.table.joints", known, str(joint))
        driven = {(side, joint) for side in self.sides for joint in self.joints}
        moved = {(side, joint) for side in self.leg.legs for joint in own.joints} - driven
        without = "a joint without a drive, because the device drives all joints of the table"
        require(bool(moved), "own_gait.table.joints", without, ", ".join(own.joints))
        for side, joint in sorted(moved):
            effort = self.patient.conditions.get((side, joint), JointCondition()).effort
            moves = "0, because the wearer's own gait moves this joint"
            require(effort == 0.0, f"patient.{side}.{joint}.effort", moves, effort)

    @property
    def stepped_by_hand(self) -> bool:
        """Whether the legs can wait for steps by hand."""
        return HELD_PHASE in self.table.phases and self.modes is None

    def _check_joints(self) -> None:
        """Check that every joint of the table is in the legs, and has a drive and a friction model."""
        table, names = f"gait table {self.table.name!r}", ", ".join(self.table.joints)
        ordered = [joint for joint in JointName if joint in self.table.joints] == list(self.table.joints)
        require(ordered, f"joints of {table}", f"some of {', '.join(JointName)}, in this order", names)
        needed: dict[str, Any] = {f"leg.{side}": dict(self.leg.legs[side].items()) for side in self.sides}
        needed["plant.actuators"] = self.plant.actuators
        needed["control.friction_model"] = self.control.friction_model
        for joint in self.joints:
            for key, given in needed.items():
                if joint not in given:
                    problem = f"is missing, but {table} controls the {joint}; add it"
                    raise ParameterError(f"{key}.{joint}: {problem}")
        problem = self.control.controller().check_joints(self.joints)
        if problem:
            raise ParameterError(f"{problem}; {table} controls {names}")

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs of the device; the wearer may have another one without a device."""
        return self.leg.driven_sides or tuple(self.leg.legs)

    @cached_property
    def joints(self) -> tuple[JointName, ...]:
        """Controlled joints of a leg, from proximal to distal."""
        return tuple(JointName(name) for name in self.table.joints)

    @property
    def assumed_patient(self) -> Patient | None:
        """Wearer that the controller assumes: ``control.patient`` or, without it, ``patient``."""
        return self.control.patient or self.patient

    @property
    def resolved_integration(self) -> Integration:
        """Integrator and step of the run."""
        braced = self.interface is not None
        return self.integration or default_integration(self.engine, self.scenario, braced=braced)

    @property
    def n_ticks(self) -> int:
        """Length of the run in ticks."""
        return round(self.duration / TICK)

    def build_world(self) -> World:
        """Build the world and its rigid bodies; raise ModelError or ParameterError if a part does not fit."""
        plant, pelvis = self.plant, self.scenario.pelvis
        require(pelvis in list(PelvisGuide), f"world {self.scenario.kind!r}: pelvis", "a PelvisGuide", pelvis)
        model = self.leg_model(self.patient, pelvis)
        check_motion_limits(self.control, model, plant, self.sides)
        self._compare_effort_limits(model)
        world = build_world(
            self.scenario,
            model,
            plant=plant.rows(model, self.sides),
            ankle_rest=plant.ankle.rest,
            gravity=plant.gravity,
        )
        if self.interface is not None:
            device, wearer = (
                self.leg_model(self.patient, pelvis, bodies)
                for bodies in (BodySelection.DEVICE, BodySelection.WEARER)
            )
            world = brace_world(world, device, wearer, self.interface)
        stiff = {} if self.interface is None else {"interface": "braces"}
        if any(plant.friction.bristle_stiffness > 0.0 for plant in world.plant):
            stiff["plant.friction"] = "bristles"
        if stiff:
            self._require_step_for(world, " or ".join(stiff), " or ".join(stiff.values()))
        return world

    def _compare_effort_limits(self, model: LegModel) -> None:
        """Warn if the limit of the command torque is above the effort limit in the URDF of a driven joint."""
        for side in self.sides:
            for joint, name in model.legs[side].items():
                allowed = model.effort_limit(side, joint)
                if joint in self.plant.actuators and (limit := self.control.limits[joint].torque) > allowed:
                    text = (
                        f"joint {name!r} has an effort limit of {allowed:g} N·m, which is not applied: "
                        f"control.limits.{joint}.torque_Nm is {limit:g}; lower it, or correct the URDF"
                    )
                    warnings.warn(f"{self.leg.urdf}: {text}", UrdfWarning, stacklevel=3)

    def leg_model(
        self, patient: Patient | None, pelvis: PelvisGuide, bodies: BodySelection = BodySelection.BOTH
    ) -> LegModel:
        """Build the rigid bodies of the legs with a guide of the pelvis; ``patient``: wearer, or None."""
        return LegModel(
            self.leg.urdf,
            self.leg.legs,
            patient=patient,
            fit_device=self.leg.fit_device,
            manufactured=self.leg.sizes,
            heel_to_forefoot=self.leg.heel_to_forefoot,
            driven_sides=self.sides,
            attachment=self.leg.attachment,
            pelvis=pelvis,
            armature={joint: item.armature for joint, item in self.plant.actuators.items()},
            gravity=self.plant.gravity,
            up_axis=self.leg.up_axis,
            bodies=bodies,
        )

    def _require_step_for(self, world: World, keys: str, parts: str) -> None:
        """Raise ParameterError if the step is too large for stable braces or bristles.

        ``keys``: keys of the parts in a file; ``parts``: their names; both are for the message.
        """
        step = self.resolved_integration.step
        runge_kutta = self.resolved_integration.method is IntegrationMethod.RK4
        if is_step_stable(world, step, runge_kutta=runge_kutta):
            return
        finer = (TICK / self.resolved_integration.substeps / factor for factor in (2, 5, 10, 20, 50, 100))
        enough = next((item for item in finer if is_step_stable(world, item, runge_kutta=runge_kutta)), None)
        remedy = "use" if enough is None else f"set integration.step_ms to {1e3 * enough:g} or use"
        raise ParameterError(
            f"{keys}: the {parts} are too stiff or too strongly damped for a step of "
            f"{1e3 * step:g} ms ({self.resolved_integration.method}); {remedy} softer {parts}"
        )

    def build_control_model(self) -> LegModel:
        """Build the controller's model: with a fixed pelvis, and the wearer that the controller assumes."""
        return self.leg_model(self.assumed_patient, PelvisGuide.FIXED)
