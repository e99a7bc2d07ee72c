"""One leg of an experiment for the physical rules: hanging from a pelvis that is held."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from twin_gait.checking.finding import CheckCase, Finding, Severity, once
from twin_gait.checking.linear_loop import LinearLoop, leg_motion
from twin_gait.core import friction as core
from twin_gait.core.actuator import current_to_torque
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM, GAIN, STIFFNESS
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.signals import ANGLE, VELOCITY
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.friction import FrictionLaw
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.vocabulary import JointName, PelvisGuide, Side

# Steps of central differences; the errors of both are far below the digits that any rule prints.
_VELOCITY_STEP = 1e-5  # [rad/s]; the steepest part of the friction law is 0.02 rad/s wide
_ANGLE_STEP = 1e-4  # [rad]


@lru_cache(maxsize=64)
def plant_friction(law: FrictionLaw) -> core.PlantFriction:
    """Return the parameters of a law in the form of the plant, computed once."""
    return law.to_plant_friction()


@lru_cache(maxsize=4096)  # postures share their velocities
def friction_torque(law: FrictionLaw, velocity: float) -> float:
    """Compute the friction torque of a law in [N·m] at a steady velocity in [rad/s], with its sign."""
    friction = plant_friction(law)
    return core.friction_torque(friction, velocity, core.steady_deflection(friction, velocity))


def friction_slope(law: FrictionLaw, velocity: float) -> float:
    """Compute the slope of a friction law in [N·m·s/rad] at a velocity in [rad/s].

    If the slopes of the two directions differ, the smaller one is returned; at rest, the one with bristles
    held.
    """
    friction = plant_friction(law)

    def torque(speed: float) -> float:
        deflection = core.steady_deflection(friction, speed if velocity else 0.0)
        return core.friction_torque(friction, speed, deflection)

    return min(
        (torque(speed + _VELOCITY_STEP) - torque(speed - _VELOCITY_STEP)) / (2.0 * _VELOCITY_STEP)
        for speed in (velocity, -velocity)
    )


@dataclass(frozen=True, eq=False)
class HangingLeg:
    """One leg of a case; the pelvis is held, and joints that the table does not drive are at zero.

    A joint that the table does not drive is, for example, the one of an orthosis.
    """

    setup: SimulationSetup  # simulation setup with scaled table and resolved damping ratios
    plant: LegModel  # model of the true leg, with the wearer's true mass
    side: Side  # side of the leg
    shown_side: Side | None  # side that findings name: None if both legs have the same numbers

    @cached_property
    def joints(self) -> tuple[JointName, ...]:
        """Joints in the order of all arrays of this class."""
        return tuple(JointName(name) for name in self.setup.table.joints)

    @cached_property
    def phases(self) -> tuple[str, ...]:
        """Names of the phases in the order of :meth:`column`."""
        return self.setup.table.phase_names

    @cached_property
    def gravity_shares(self) -> np.ndarray:
        """Share of gravity compensation in every phase, shape ``(n_phases,)``."""
        return np.asarray(self._rows[:, -1])

    @cached_property
    def _rows(self) -> np.ndarray:
        return np.asarray(self.setup.phase_rows[self.setup.sides.index(self.side)])

    def column(self, index: int) -> np.ndarray:
        """Return ``STIFFNESS``, ``DAMPING``, ``EQUILIBRIUM`` or ``GAIN``, shape ``(n_phases, n_joints)``."""
        return self._rows[:, index : COLUMNS_PER_JOINT * len(self.joints) : COLUMNS_PER_JOINT]

    def torque_limits(self) -> np.ndarray:
        """Return the largest torque of each joint by torque and current limit in [N·m], ``(n_joints,)``."""
        return self._torque_limits

    @cached_property
    def _torque_limits(self) -> np.ndarray:
        limits = self.setup.experiment.control.limits
        motors = [self.setup.experiment.plant.actuators[joint] for joint in self.joints]
        gears = [(motor.torque_constant, motor.gear_ratio) for motor in motors]
        by_current = [
            current_to_torque(limits[joint].current, *gear)
            for joint, gear in zip(self.joints, gears, strict=True)
        ]
        return np.minimum(by_current, [limits[joint].torque for joint in self.joints])

    def no_load_speed(self, joint: JointName) -> float:
        """Compute the speed in [rad/s] at which the back-EMF equals the whole battery voltage."""
        plant = self.setup.experiment.plant
        motor = plant.actuators[joint]
        return plant.battery.voltage / (motor.torque_constant * motor.gear_ratio)

    @cached_property
    def _indices(self) -> list[int]:
        """Indices of the joints in the plant, and in the controller's model, whose pelvis is held, too."""
        return [self.plant.index(self.side, joint) for joint in self.joints]

    def _posture(self, model: LegModel, angles: np.ndarray) -> tuple[np.ndarray, list[int]]:
        q = np.zeros(model.nv)
        q[self._indices] = angles
        return q, self._indices

    def finding(self, phase: str, severity: Severity, reason: str, suggestion: str, **more: Any) -> Finding:
        """Create a finding about a phase of this leg."""
        return Finding(severity, reason, suggestion, phase=phase, side=self.shown_side, **more)

    def signals(self, angles: np.ndarray, velocities: Sequence[float] | np.ndarray = ()) -> dict[str, float]:
        """Convert a posture to the units and digits of a counterexample.

        ``angles``: in [rad]. ``velocities``: in [rad/s].
        """
        held = zip(self.joints, np.degrees(angles).tolist(), strict=True)
        moving = zip(self.joints, np.degrees(velocities).tolist(), strict=False)
        found = {ANGLE.joint_signal_name(joint): round(angle, 2) for joint, angle in held}
        return found | {VELOCITY.joint_signal_name(joint): round(velocity, 1) for joint, velocity in moving}

    def limits(self) -> np.ndarray:
        """Return the stops of the joints in [rad], shape ``(n_joints, 2)``."""
        limits = [self.plant.position_limits(self.side, joint) for joint in self.joints]
        # A continuous joint is limited to one turn.
        return np.clip(limits, -math.pi, math.pi)

    def mass(self, angles: np.ndarray) -> np.ndarray:
        """Compute the inertia of the coupled joints in [kg·m²], shape ``(n_joints, n_joints)``.

        The armature is included.
        """
        q, indices = self._posture(self.plant, angles)
        return self.plant.mass_matrix(q)[np.ix_(indices, indices)]

    def gravity(self, angles: np.ndarray) -> np.ndarray:
        """Compute the torques that hold the leg against gravity in [N·m], shape ``(n_joints,)``."""
        q, indices = self._posture(self.plant, angles)
        return self.plant.gravity_torque(q)[indices]

    def modelled_gravity(self, angles: np.ndarray) -> np.ndarray:
        """Compute the same torques by the controller's model, with the assumed mass of the wearer."""
        model = self.setup.control_model
        q, indices = self._posture(model, angles)
        return model.gravity_torque(q)[indices]

    @cached_property
    def bristles(self) -> np.ndarray:
        """Stiffness of the bristles of joints that stick in [N·m/rad], shape ``(n_joints, n_joints)``."""
        laws = self.setup.experiment.plant.true_friction()
        return np.diag([plant_friction(laws[joint]).bristle_stiffness for joint in self.joints])

    def linear_loop(self, phase: int, velocity: float) -> LinearLoop:
        """Build the loop of a phase at its equilibrium angles, linearised at a velocity in [rad/s]."""
        experiment, angles = self.setup.experiment, self.column(EQUILIBRIUM)[phase]
        true, model = experiment.plant.true_friction(), experiment.control.friction_model
        friction = np.array([friction_slope(true[joint], velocity) for joint in self.joints])
        held = self.bristles if velocity == 0.0 else 0.0  # sliding bristles have no stiffness
        return LinearLoop(
            motion=leg_motion(self.mass(angles), _slope(self.gravity, angles) + held, friction),
            stiffness=self.column(STIFFNESS)[phase],
            damping=self.column(DAMPING)[phase],
            gain=self.column(GAIN)[phase],
            modelled_friction=np.array([friction_slope(model[joint], velocity) for joint in self.joints]),
            feed_forward=self.gravity_shares[phase] * _slope(self.modelled_gravity, angles),
            fast_gain=self.setup.fast_gain,
            decimation=experiment.sensors.decimation,
            window=experiment.sensors.window,
            delay=experiment.control.delay_ticks,
        )


def _slope(torque: Callable[[np.ndarray], np.ndarray], angles: np.ndarray) -> np.ndarray:
    """Compute the Jacobian of torques over angles in [N·m/rad], shape ``(n, n)``."""
    steps = _ANGLE_STEP * np.eye(len(angles))
    columns = [(torque(angles + step) - torque(angles - step)) / (2.0 * _ANGLE_STEP) for step in steps]
    return np.array(columns).T


@once
def hanging_legs(case: CheckCase) -> list[HangingLeg]:
    """Return the legs with different numbers: one if both sides have the same; none without an experiment."""
    return [] if case.experiment is None else _hanging_legs(case.setup)


def _hanging_legs(setup: SimulationSetup) -> list[HangingLeg]:
    experiment, plant = setup.experiment, setup.control_model
    if experiment.assumed_patient != experiment.patient:  # otherwise the controller's model is exact
        plant = experiment.leg_model(experiment.patient, PelvisGuide.FIXED)
    if not setup.table.side_phases:
        return [HangingLeg(setup, plant, setup.sides[0], None)]
    return [HangingLeg(setup, plant, side, side) for side in setup.sides]


def linear_loops(experiment: Experiment, velocity: float = 0.0) -> dict[tuple[Side, str], LinearLoop]:
    """Build the sampled loop of every phase that the stability rules use.

    :func:`~twin_gait.checking.linear_loop.transition_matrix` reads a loop. The leg hangs in the air
    from a pelvis that is held, at the equilibrium angles of the phase.

    ``experiment``: the experiment with its table. ``velocity``: velocity of all joints in [rad/s] at
    which the friction laws are linearised. Returns the loops by side and phase; one side only if both have
    the same numbers.
    """
    return {
        (leg.side, phase): leg.linear_loop(index, velocity)
        for leg in _hanging_legs(build_setup(experiment))
        for index, phase in enumerate(leg.phases)
    }
