"""Deviation of the command of a joint from its setpoint, computed from the columns of a log."""

from __future__ import annotations

from itertools import product

import numpy as np

from twin_gait import JointName, Run, Side
from twin_gait.core.friction import rotational_friction_torque

TICK = 1e-3  # [s]
FED_FORWARD = ("gravity_compensation", "inertia_compensation", "target")  # words of the columns
Values = np.ndarray


def deviations(run: Run, side: Side, joint: JointName) -> Values:
    """Compute the deviation that the monitor of a joint reads in each tick, in [N·m].

    The command of a tick is compared with the torque that the setpoint of the same tick gives for the angle
    and the velocities that are measured in the next tick. The first tick has no command before it.
    """

    def column(name: str) -> Values:
        values: Values = run.log[f"{side}_{joint}_{name}"].to_numpy()
        return values

    stretch = column("measured_angle_rad")[1:] - column("equilibrium_rad")[:-1]
    spring = column("stiffness_Nm_per_rad")[:-1] * stretch
    damper = column("damping_Nms_per_rad")[:-1] * column("velocity_fast_rad_per_s")[1:]
    slow, inverse = np.unique(column("velocity_slow_rad_per_s")[1:], return_inverse=True)
    law = run.experiment.control.friction_model[joint]
    parameters = law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity, law.viscous_friction
    torques = [rotational_friction_torque(float(velocity), *parameters) for velocity in slow]
    forward = sum(column(f"{part}_torque_Nm")[:-1] for part in FED_FORWARD)
    expected = (
        -(spring + damper) + column("friction_compensation_gain")[:-1] * np.array(torques)[inverse] + forward
    )
    return np.concatenate([[0.0], column("motor_command_torque_Nm")[:-1] - expected])


def filtered(values: Values, time_constant: float) -> Values:
    """Filter a column of a log with a first-order filter whose time constant is given in [s]."""
    gain, state = min(1.0, TICK / time_constant), 0.0
    found = np.empty(len(values))
    for tick, value in enumerate(values.tolist()):
        state += gain * (value - state)
        found[tick] = state
    return found


def largest_deviation(run: Run) -> float:
    """Compute the largest filtered deviation of all joints before a trip, in [N·m].

    It is the smallest bound with which the commands of the run cause no trip.
    """
    time_constant = run.experiment.control.safety.command_time_constant
    end = None if run.trip is None else run.trip.tick
    joints = product(run.sides, run.table.joints)
    every = [filtered(deviations(run, side, JointName(name))[:end], time_constant) for side, name in joints]
    return max(float(np.abs(values).max(initial=0.0)) for values in every)
