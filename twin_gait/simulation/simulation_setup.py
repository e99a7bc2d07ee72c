"""Simulation setup: arrays that every engine needs, computed from an experiment."""

import warnings
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
from twin_gait.parameters.wearer import JointCondition, Patient
from twin_gait.simulation.episode import Limb
from twin_gait.simulation.wearer import limbs_of
from twin_gait.vocabulary import JointName, Side
from twin_gait.worlds.world import World

NEVER = int(np.iinfo(np.int64).max)  # Tick that is never reached.


class ActuatedJoint(NamedTuple):
    """Controlled joint with its positions in the models."""

    side: Side  # Leg.
    joint: JointName  # Hip, knee or ankle.
    coordinate: int  # Position in ``q`` and ``v`` of the plant.
    control_coordinate: int  # Position in ``q`` of the controller's model.


@dataclass(frozen=True)
class OwnGaitRows:
    """The wearer's own gait as arrays."""

    table: GaitTable  # Gait table of the wearer after scaling.
    program: GuardProgram  # Its compiled guards.
    joints: tuple[tuple[Side, JointName, int], ...]  # Joints with their coordinates, leg by leg.
    highest_torques: tuple[float, ...]  # Largest torque of each joint in [N·m]; 0 for a joint with a drive.
    phase_rows: np.ndarray  # As ``phase_rows`` of :class:`SimulationSetup`, for the legs of the wearer.

    @property
    def moved(self) -> tuple[tuple[int, Side, JointName], ...]:
        """Joints that the wearer moves, each with its number among all joints."""
        numbered = enumerate(zip(self.joints, self.highest_torques, strict=True))
        return tuple((number, side, joint) for number, ((side, joint, _), most) in numbered if most > 0.0)


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
    own_gait: OwnGaitRows | None  # The wearer's own gait, or None.
    controller: Controller  # Controller that computes the setpoints.
    plan: Plan  # Data that the controller receives before the start.

    @cached_property
    def noise(self) -> np.ndarray:
        """Noise of every tick, shape ``(n_ticks or 1, n)``, drawn when it is first read.

        The columns are noise plus offset of each encoder in [rad], the relative noise of each of the wearer's
        efforts, if the trunk is free the noise of its inertial unit, and noise in [rad] of each joint of the
        wearer's own gait. The noise of an hour takes 0.3 GB and some seconds.
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
        if experiment.own_gait is not None and self.own_gait is not None:
            perceived, noise = np.zeros((1, len(self.own_gait.joints))), experiment.own_gait.angle_noise
            parts.append(drawn(noise, perceived.shape[1], 3) if noise > 0.0 else perceived)
        rows = max(len(part) for part in parts)
        return np.hstack([np.broadcast_to(part, (rows, part.shape[1])) for part in parts])

    @property
    def inertial(self) -> bool:
        """Whether an inertial unit estimates the pitch of the trunk; otherwise it is measured exactly."""
        return self.world.model.pitch_index is not None and not self.experiment.sensors.ideal

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs of the device in the order of the arrays."""
        return self.experiment.sides

    @property
    def wearer_sides(self) -> tuple[Side, ...]:
        """Legs of the wearer in the order of the arrays, with or without a device."""
        return self.world.model.sides

    @property
    def own_table(self) -> GaitTable | None:
        """Gait table of the wearer's own gait after scaling, or None."""
        return None if self.own_gait is None else self.own_gait.table

    @property
    def own_phase_names(self) -> tuple[str, ...]:
        """Names of the phases of the wearer's own gait; empty without one."""
        return () if self.own_table is None else self.own_table.phase_names

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
        controlled = {(item.side, item.joint) for item in self.joints}
        every = ((side, joint) for side, leg in self.world.model.legs.items() for joint, _ in leg.items())
        return tuple(key for key in every if key not in controlled)

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
    plan = controller_plan(experiment, experiment.sides, inertia)
    begin = controller.initial_angles(plan)  # angles that the controller sets, whatever the scenario has
    placed = (
        replace(experiment, scenario=experiment.scenario.replace_postures(begin)) if begin else experiment
    )
    world = placed.build_world()
    table = scaled_table(experiment, world)
    own_table = None if experiment.own_gait is None else scaled_table(experiment, world, own=True)
    require_start_phases(experiment, world, table, own_table)
    sides = experiment.sides
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
        own_gait=None if own_table is None else _own_gait(experiment, world, own_table, inertia),
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


class StartPhaseWarning(UserWarning):
    """The gait table of the device lacks the phase in which a leg is to start."""


def require_start_phases(
    experiment: Experiment, world: World, table: GaitTable, own_table: GaitTable | None
) -> None:
    """Raise ParameterError for a phase at the start that neither the device nor the wearer has.

    A leg without the phase starts in its first phase, because tables of device and wearer may name their
    phases differently; a leg of the device does so with a warning.
    """
    tables = [table] if own_table is None else [table, own_table]
    for side, phase in world.initial_phases.items():
        keys = [
            f"scenario.{name}" for name, start in experiment.scenario.start_phases.items() if start == phase
        ]
        known = " or ".join(f"a phase of gait table {one.name!r}, {', '.join(one.phases)}" for one in tables)
        name = " and ".join(keys) or f"scenario: phase of the {side} leg"
        require(any(phase in (None, *one.phases) for one in tables), name, known, phase)
        if side in experiment.sides and phase not in (None, *table.phases):
            text = (
                f"{name}: only the own gait has the phase {phase}; the device starts the {side} leg in "
                f"{table.phase_names[0]}; to choose, set one of {', '.join(table.phases)}"
            )
            warnings.warn(text, StartPhaseWarning, stacklevel=3)


def start_phase(table: GaitTable, phase: str | None) -> int:
    """Return the index of the phase in which a leg starts; see :func:`require_start_phases`."""
    return table.phase_index(phase) if phase in table.phases and phase is not None else 0


def scaled_table(experiment: Experiment, world: World, *, own: bool = False) -> GaitTable:
    """Return a gait table scaled to carried mass, belt speed and height.

    The table is that of the device, scaled to the height in ``assumed_patient``; with ``own`` it is the table
    of the wearer's own gait, scaled to the true height.
    """
    walking, table, wearer = experiment.scenario.walking, experiment.table, experiment.assumed_patient
    if own and experiment.own_gait is not None:
        table, wearer = experiment.own_gait.table, experiment.patient
    if walking is None:
        return table
    carried = world.model.total_mass * walking.carried_share
    height = None if wearer is None else wearer.height
    return scale_table(table, carried_mass=carried, speed=walking.speed, height=height)


def _own_gait(experiment: Experiment, world: World, table: GaitTable, inertia: InertiaAt) -> OwnGaitRows:
    """Return table, guards, joints and impedances of the wearer's own gait."""
    patient, own = experiment.patient, experiment.own_gait
    assert patient is not None and own is not None
    driven = {(side, joint) for side in experiment.sides for joint in experiment.joints}
    keys = [(side, joint) for side in world.model.sides for joint in own.joints]
    strengths = [patient.conditions.get(key, JointCondition()).strength for key in keys]
    return OwnGaitRows(
        table=table,
        program=compile_guards(table),
        joints=tuple((*key, world.model.index(*key)) for key in keys),
        highest_torques=tuple(
            0.0 if key in driven else strength * own.peak_torque[key[1]]
            for key, strength in zip(keys, strengths, strict=True)
        ),
        phase_rows=np.array([resolve_phases(table, side, inertia) for side in world.model.sides]),
    )


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
    numbers = {(side, None): number for number, side in enumerate(setup.wearer_sides)}  # numbers of feet
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
