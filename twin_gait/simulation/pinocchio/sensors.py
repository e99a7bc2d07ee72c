"""Encoders and foot load of the Pinocchio engine, with their faults."""

from __future__ import annotations

import numpy as np

from twin_gait.core.control_tick import measure_joints
from twin_gait.core.faults import faulty_angle, faulty_load
from twin_gait.gait.table import TICK
from twin_gait.simulation.pinocchio.plant import PinocchioPlant
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.watching import FaultArrays, start_angles


class SensorsOfLegs:
    """What the firmware knows of joints and feet.

    Attributes:
        measured: Angle, fast and slow velocity of the joints, shape ``(n_joints, 3)``.
        last_angle: Angles of the tick before, shape ``(n_joints,)``.
        last_fast: Fast velocities of the tick before, shape ``(n_joints,)``.
        foot_load: In body weights, shape ``(n_legs,)``.
        last_load: Of the tick before, shape ``(n_legs,)``.
    """

    def __init__(self, problem: Problem, faults: FaultArrays) -> None:
        """Set everything to time 0."""
        self.problem, self._faults = problem, faults
        n_joints, n_legs = len(problem.joints), len(problem.sides)
        self.measured = np.zeros((n_joints, 3))
        self.measured[:, 0] = start_angles(problem)
        self.last_angle, self.last_fast = np.zeros(n_joints), np.zeros(n_joints)
        self.foot_load, self.last_load = np.zeros(n_legs), np.zeros(n_legs)
        self._index = np.array([joint.coordinate for joint in problem.joints])
        self._readings = start_angles(problem)
        self._decimated_angle = np.zeros(n_joints)
        self._ring = np.zeros((problem.experiment.sensors.window, n_joints))

    def measure(self, tick: int, plant: PinocchioPlant) -> None:
        """Read encoders and foot load."""
        problem = self.problem
        noise = problem.noise[tick if len(problem.noise) > 1 else 0]
        self._read(tick, plant.q[self._index] + noise)
        self.last_angle[:] = self.measured[:, 0]
        self.last_fast[:] = self.measured[:, 1]
        measure_joints(
            tick,
            self._readings,
            problem.resolution,
            TICK,
            problem.fast_gain,
            problem.experiment.sensors.decimation,
            self.measured,
            self._decimated_angle,
            self._ring,
        )
        if plant.feet:
            self.last_load[:] = self.foot_load
            for leg, side in enumerate(problem.sides):
                load = plant.normal_force[side] / problem.world.body_weight
                self.foot_load[leg] = faulty_load(leg, tick, self._faults.faults, load, self.last_load[leg])

    def _read(self, tick: int, healthy: np.ndarray) -> None:
        """What the encoders read, noise and faults included, before they quantise."""
        if tick < self._faults.first_tick:
            self._readings[:] = healthy
            return
        for number in range(len(healthy)):
            self._readings[number] = faulty_angle(
                number,
                tick,
                TICK,
                self._faults.faults,
                self._faults.magnitudes,
                float(healthy[number]),
                float(self._readings[number]),
            )
