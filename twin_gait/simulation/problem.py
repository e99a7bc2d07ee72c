"""An experiment laid out as the arrays that every engine steps through."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twin_gait.control.controller import Controller, Plan, checked_setpoints, require_controller
from twin_gait.core.estimation import first_order_gain
from twin_gait.core.guards import GuardProgram
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.program import compile_guards
from twin_gait.gait.scaling import InertiaAt, resolve_phases, scale_table
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.leg_model import LegModel
from twin_gait.measures.reference import FASTEST, SLOWEST
from twin_gait.parameters import ActuatorParameters, Patient
from twin_gait.simulation.episode import UNIT_READINGS
from twin_gait.simulation.wearer import Wearer, wearer_of
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.world import World


class ActuatedJoint(NamedTuple):
    """A joint that is controlled."""

    side: Side  # Leg.
    joint: JointName  # Hip, knee or ankle.
    coordinate: int  # Position in ``q`` and ``v`` of the plant.
    control_coordinate: int  # Position in ``q`` of the controller's model.


@dataclass(frozen=True)
class Problem:
    """What an engine needs, beside the experiment."""

    experiment: Experiment  # The experiment.
    world: World  # Plant and surroundings.
    control_model: LegModel  # The controller's rigid-body model.
    table: GaitTable  # The gait table after scaling.
    program: GuardProgram  # Its guards.
    joints: tuple[ActuatedJoint, ...]  # Controlled joints, leg by leg in the order of the table.
    # k, b, θ0, G per joint and gravity share: shape ``(n_legs, n_phases, n_columns)``.
    phase_rows: np.ndarray
    offset: np.ndarray  # Calibration error of each encoder in [rad], shape ``(n_joints,)``.
    # What an encoder reads in excess of the angle in every tick, noise and offset, in [rad], shape
    # ``(n_ticks, n_joints)`` or ``(1, n_joints)``; with an inertial unit 3 more columns of its noise.
    noise: np.ndarray
    resolution: np.ndarray  # Encoder resolution in [rad], shape ``(n_joints,)``.
    fast_gain: float  # Gain of the fast velocity filter.
    wearer: Wearer  # What the wearer does at the joints.
    controller: Controller  # What decides on the demands.
    plan: Plan  # What it knows.

    @property
    def sides(self) -> tuple[Side, ...]:
        """Legs in the order of the arrays."""
        return self.world.model.sides

    @property
    def joints_per_leg(self) -> int:
        """Controlled joints of a leg."""
        return len(self.table.joints)

    @property
    def passive(self) -> tuple[tuple[Side, JointName], ...]:
        """Joints that are not controlled, leg by leg."""
        legs, controlled = self.world.model.legs, self.experiment.joints
        return tuple(
            (side, joint) for side, leg in legs.items() for joint, _ in leg.items() if joint not in controlled
        )

    def actuator(self, joint: ActuatedJoint) -> ActuatorParameters:
        """Motor and gear of a joint."""
        return self.experiment.plant.actuators[joint.joint]


def build_problem(experiment: Experiment, own: Controller | None = None) -> Problem:
    """Lay an experiment out.

    ``own``: controller that takes the place of the mode's. Raises ParameterError if the controller is none,
    or what it gives cannot be used.
    """
    if own is not None:
        require_controller(own)
    control_model, controller = experiment.build_control_model(), experiment.control.controller(own)
    inertia = _inertia_of(control_model)
    plan = plan_of(experiment, control_model.sides, inertia)
    begin = controller.start(plan)  # angles of the legs that it wants, whatever the scenario says
    placed = replace(experiment, scenario=experiment.scenario.starting_in(begin)) if begin else experiment
    world = placed.build_world()
    table = scaled_table(experiment, world)
    joints = tuple(
        ActuatedJoint(side, joint, world.model.index(side, joint), control_model.index(side, joint))
        for side in world.model.sides
        for joint in experiment.joints
    )
    rows = [
        checked_setpoints(controller, plan, side, resolve_phases(table, side, inertia))
        for side in world.model.sides
    ]
    sensors = experiment.sensors
    ratio = np.array([experiment.plant.actuators[item.joint].gear_ratio for item in joints])
    counts = sensors.encoder_counts * ratio
    offset = np.array([sensors.offset.get(item.side, {}).get(item.joint, 0.0) for item in joints])
    return Problem(
        experiment=experiment,
        world=world,
        control_model=control_model,
        table=table,
        program=compile_guards(table),
        joints=joints,
        phase_rows=np.array(rows),
        offset=offset,
        noise=_noise(experiment, offset),
        resolution=np.zeros(len(joints)) if sensors.ideal else 2.0 * np.pi / counts,
        fast_gain=first_order_gain(TICK, sensors.fast_time_constant),
        wearer=wearer_of(experiment, table, world.model.sides),
        controller=controller,
        plan=plan,
    )


def plan_of(experiment: Experiment, sides: tuple[Side, ...], inertia: InertiaAt) -> Plan:
    """What the controller of an experiment knows."""
    scenario = experiment.scenario
    walking = scenario.walking
    return Plan(
        sides=sides,
        joints=tuple(experiment.table.joints),
        phases=tuple(experiment.table.phase_names),
        leading=scenario.leading_of(sides),
        speed=SLOWEST if walking is None else min(max(walking.speed, SLOWEST), FASTEST),
        height=(experiment.patient or Patient()).height,
        inertia=inertia,
    )


def scaled_table(experiment: Experiment, world: World) -> GaitTable:
    """Gait table adapted to carried mass, belt speed and the height that the controller knows."""
    walking = experiment.scenario.walking
    if walking is None:
        return experiment.table
    carried = world.model.total_mass * walking.carried_share
    known = experiment.control.patient or experiment.patient
    return scale_table(
        experiment.table,
        carried_mass=carried,
        speed=walking.speed,
        height=None if known is None else known.height,
    )


def _inertia_of(model: LegModel) -> InertiaAt:
    def inertia(side: Side, posture: Mapping[str, float], joint: str) -> float:
        q = np.zeros(model.nv)
        for name, angle in posture.items():
            q[model.index(side, JointName(name))] = angle
        return model.effective_inertia(q, model.index(side, JointName(joint)))

    return inertia


def has_inertial_unit(experiment: Experiment) -> bool:
    """Whether the pitch of the trunk is found by an inertial unit, not known exactly."""
    return experiment.scenario.pelvis is PelvisGuide.FREE and not experiment.sensors.ideal


def _noise(experiment: Experiment, offset: np.ndarray) -> np.ndarray:
    sensors, n_ticks = experiment.sensors, experiment.n_ticks
    encoders = offset[None, :]
    if not sensors.ideal and sensors.angle_noise > 0.0:
        generator = np.random.default_rng(experiment.seed)
        encoders = sensors.angle_noise * generator.standard_normal((n_ticks, len(offset))) + offset
    if not has_inertial_unit(experiment):
        return encoders
    # A stream of its own: the encoders' noise stays what it is without the unit.
    unit, generator = sensors.trunk, np.random.default_rng((experiment.seed, 2))
    scale = unit.gyroscope_noise, unit.accelerometer_noise, unit.accelerometer_noise
    readings = scale * generator.standard_normal((n_ticks, UNIT_READINGS))
    return np.hstack([np.broadcast_to(encoders, (n_ticks, len(offset))), readings])
