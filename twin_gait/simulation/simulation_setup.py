"""Simulation setup: arrays that every engine needs, computed from an experiment."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from twin_gait.control.controller import Controller, Plan, checked_setpoints, require_controller
from twin_gait.control.user_controller import record_controller, restore_controller
from twin_gait.core.estimation import first_order_gain
from twin_gait.core.faults import FaultRecord
from twin_gait.core.guards import GuardProgram
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.program import compile_guards
from twin_gait.gait.scaling import InertiaAt, resolve_phases, scale_table
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.measures.reference import FASTEST, SLOWEST
from twin_gait.parameters.drives import ActuatorParameters
from twin_gait.parameters.quantities import require
from twin_gait.parameters.wearer import Patient
from twin_gait.simulation.episode import Limb
from twin_gait.simulation.wearer import limbs_of
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.world import World

NEVER = int(np.iinfo(np.int64).max)  # Tick that is never reached.


class ActuatedJoint(NamedTuple):
    """Controlled joint with its positions in the models."""

    side: Side  # Leg.
    joint: JointName  # Hip, knee or ankle.
    coordinate: int  # Position in ``q`` and ``v`` of the plant.
    control_coordinate: int  # Position in ``q`` of the controller's model.


@dataclass(frozen=True)
class SimulationSetup:
    """Simulation setup: an experiment and all that an engine computes from it before the first tick."""

    experiment: Experiment  # Experiment, with the record of its controller.
    world: World  # Plant and environment.
    control_model: LegModel  # Rigid-body model of the controller.
    table: GaitTable  # Gait table after scaling.
    program: GuardProgram  # Compiled guards of the gait table.
    joints: tuple[ActuatedJoint, ...]  # Controlled joints, leg by leg in the order of the table.
    # Values of k, b, θ0, G per joint and the gravity share, shape ``(n_legs, n_phases, n_columns)``.
    phase_rows: np.ndarray
    offset: np.ndarray  # Calibration error of each encoder in [rad], shape ``(n_joints,)``.
    fast_gain: float  # Gain of the fast velocity filter.
    limbs: list[Limb]  # Hips and knees of the wearer.
    controller: Controller  # Controller that computes the setpoints.
    plan: Plan  # Data that the controller receives before the start.

    @cached_property
    def noise(self) -> np.ndarray:
        """Noise of every tick, shape ``(n_ticks or 1, n)``, drawn when it is first read.

        The columns are noise plus offset of each encoder in [rad], the relative noise of each of the wearer's
        efforts and, if the trunk is free, the noise of its inertial unit. The noise of an hour takes 0.3 GB
        and some seconds.
        """
        experiment, sensors, patient = self.experiment, self.experiment.sensors, self.experiment.patient

        def drawn(scale: Any, width: int, *stream: int) -> np.ndarray:  # each stream has its own generator
            generator = np.random.default_rng((experiment.seed, *stream) if stream else experiment.seed)
            return np.asarray(scale * generator.standard_normal((experiment.n_ticks, width)))

        encoders, efforts = self.offset[None, :], np.zeros((1, len(self.limbs)))
        readings = np.zeros((1, 0 if self.world.model.pitch_index is None else 3))
        if not sensors.ideal and sensors.angle_noise > 0.0:
            encoders = drawn(sensors.angle_noise, len(self.offset)) + self.offset
        if patient is not None and patient.effort_noise > 0.0:
            efforts = drawn(patient.effort_noise, len(self.limbs), 1)
        if self.inertial:
            unit = sensors.trunk
            scale = unit.gyroscope_noise, unit.accelerometer_noise, unit.accelerometer_noise
            readings = drawn(scale, len(scale), 2)
        parts = [encoders, efforts, readings]
        rows = max(len(part) for part in parts)
        return np.hstack([np.broadcast_to(part, (rows, part.shape[1])) for part in parts])

    @property
    def inertial(self) -> bool:
        """Whether an inertial unit estimates the pitch of the trunk; otherwise it is measured exactly."""
        return self.experiment.scenario.pelvis is PelvisGuide.FREE and not self.experiment.sensors.ideal

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs in the order of the arrays."""
        return self.world.model.sides

    @property
    def joints_per_leg(self) -> int:
        """Number of controlled joints of a leg."""
        return len(self.table.joints)

    @property
    def bus_delay(self) -> int:
        """Ticks between the arrival of a frame of the bus and its use."""
        network = self.experiment.network
        return 0 if network is None else round(network.delay / TICK)

    @property
    def passive(self) -> tuple[tuple[Side, JointName], ...]:
        """Joints that are not controlled, leg by leg."""
        legs, controlled = self.world.model.legs, self.experiment.joints
        every = ((side, joint) for side, leg in legs.items() for joint, _ in leg.items())
        return tuple((side, joint) for side, joint in every if joint not in controlled)

    def actuator(self, joint: ActuatedJoint) -> ActuatorParameters:
        """Return the parameters of motor and gear of a joint."""
        return self.experiment.plant.actuators[joint.joint]


def build_setup(experiment: Experiment, user_controller: Controller | None = None) -> SimulationSetup:
    """Compute the simulation setup of an experiment.

    ``user_controller``: controller that replaces the one of the control mode, by default the one in the
    experiment's record; the experiment of the result has its record. Raises ParameterError if
    ``user_controller`` is no controller, cannot be restored from its record, or returns values that cannot
    be used.
    """
    given = user_controller
    if user_controller is None and experiment.controller is not None:
        user_controller = restore_controller(experiment.controller)
    require_controller(experiment.control.controller() if user_controller is None else user_controller)
    if given is not None:
        experiment = replace(experiment, controller=record_controller(given))
    control_model = experiment.build_control_model()
    controller = experiment.control.controller(user_controller)
    inertia = _inertia_of(control_model)
    plan = controller_plan(experiment, control_model.sides, inertia)
    begin = controller.initial_angles(plan)  # angles that the controller sets, whatever the scenario has
    placed = (
        replace(experiment, scenario=experiment.scenario.replace_postures(begin)) if begin else experiment
    )
    world = placed.build_world()
    table = scaled_table(experiment, world)
    for side, phase in world.initial_phases.items():
        keys = [
            f"scenario.{name}" for name, start in experiment.scenario.start_phases.items() if start == phase
        ]
        known = f"a phase of gait table {table.name!r}, {', '.join(table.phases)}"
        name = " and ".join(keys) or f"scenario: phase of the {side} leg"
        require(phase in (None, *table.phases), name, known, phase)
    sides = world.model.sides
    joints = tuple(
        ActuatedJoint(side, joint, world.model.index(side, joint), control_model.index(side, joint))
        for side in sides
        for joint in experiment.joints
    )
    rows = [checked_setpoints(controller, plan, side, resolve_phases(table, side, inertia)) for side in sides]
    sensors, limbs = experiment.sensors, limbs_of(experiment, table, world.model)
    offset = np.array([sensors.offset.get(item.side, {}).get(item.joint, 0.0) for item in joints])
    return SimulationSetup(
        experiment=experiment,
        world=world,
        control_model=control_model,
        table=table,
        program=compile_guards(table),
        joints=joints,
        phase_rows=np.array(rows),
        offset=offset,
        fast_gain=first_order_gain(TICK, sensors.fast_time_constant),
        limbs=limbs,
        controller=controller,
        plan=plan,
    )


def controller_plan(experiment: Experiment, sides: tuple[Side, ...], inertia: InertiaAt) -> Plan:
    """Return the data that the controller of an experiment receives before the start."""
    scenario = experiment.scenario
    walking = scenario.walking
    return Plan(
        sides=sides,
        joints=tuple(experiment.table.joints),
        phases=tuple(experiment.table.phase_names),
        leading=scenario.leading_side(sides),
        speed=SLOWEST if walking is None else min(max(walking.speed, SLOWEST), FASTEST),
        height=(experiment.patient or Patient()).height,
        inertia=inertia,
    )


def scaled_table(experiment: Experiment, world: World) -> GaitTable:
    """Return the gait table scaled to carried mass, belt speed and the height in ``assumed_patient``."""
    walking = experiment.scenario.walking
    if walking is None:
        return experiment.table
    carried = world.model.total_mass * walking.carried_share
    height = None if experiment.assumed_patient is None else experiment.assumed_patient.height
    return scale_table(experiment.table, carried_mass=carried, speed=walking.speed, height=height)


def _inertia_of(model: LegModel) -> InertiaAt:
    def inertia(side: Side, posture: Mapping[str, float], joint: str) -> float:
        q = np.zeros(model.nv)
        for name, angle in posture.items():
            q[model.index(side, JointName(name))] = angle
        return model.effective_inertia(q, model.index(side, JointName(joint)))

    return inertia


def fault_records(setup: SimulationSetup) -> list[FaultRecord]:
    """Return the faults of an experiment as records for :mod:`twin_gait.core.faults`."""
    numbers: dict[tuple[Side | None, JointName | None], int]
    numbers = {(side, None): number for number, side in enumerate(setup.sides)}  # numbers of feet
    numbers |= {(joint.side, joint.joint): number for number, joint in enumerate(setup.joints)}
    return [
        FaultRecord(
            item.kind.code,
            numbers.get((item.side, item.joint), -1),
            to_ticks(item.time),
            float(item.magnitude_or_default),
        )
        for item in setup.experiment.faults
    ]


def to_ticks(time: float) -> int:
    """Return the number of ticks in a time in [s]: 0 for 0, otherwise at least 1."""
    return 0 if time == 0.0 else max(1, round(time / TICK))


def phase_timeout_ticks(setup: SimulationSetup) -> int:
    """Return the timeout of a phase in ticks; ``NEVER`` without control by phases or without transitions."""
    control = setup.experiment.control
    if not setup.controller.phase_driven or not setup.table.transitions:
        return NEVER
    return to_ticks(control.safety.phase_timeout)
