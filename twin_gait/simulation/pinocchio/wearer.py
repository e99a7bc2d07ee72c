"""What the wearer does at the joints in the Pinocchio engine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_gait.core.wearer import (
    CONTRACTURE,
    EFFORT,
    PASSIVE_SHARE,
    STRETCH_REFLEX_GAIN,
    STRETCH_REFLEX_THRESHOLD,
    passive_hip_torque,
    passive_knee_torque,
    posture_place,
    spastic_torque,
)
from twin_gait.simulation.pinocchio.plant import PinocchioPlant
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.wearing import LOWEST_POSTURE, POSTURE_STEP
from twin_gait.vocabulary import JointName


class WearerOfJoints:
    """Passive moments, spasticity and an effort with a delay."""

    def __init__(self, problem: Problem) -> None:
        """Begin without an effort."""
        self.problem = problem
        self._efforts = np.zeros((problem.wearer.delay + 1, len(problem.joints)))

    def act(self, tick: int, plant: PinocchioPlant, phases: Sequence[int]) -> None:
        """Give the plant the torques of the wearer in a tick."""
        problem, conditions = self.problem, self.problem.wearer.conditions
        if not problem.wearer.acts:
            return
        model, shift = problem.world.model, problem.world.wearer_shift
        for leg, side in enumerate(problem.sides):
            first = leg * problem.joints_per_leg
            places = [problem.joints[first + number].coordinate + shift for number in range(2)]
            hip, knee = plant.q[places].tolist()
            ankle = 0.0
            if model.legs[side].ankle is not None:
                ankle = float(plant.q[model.index(side, JointName.ANKLE) + shift])
            stretched = hip - conditions[first, CONTRACTURE], knee - conditions[first + 1, CONTRACTURE]
            passive = passive_hip_torque(*stretched), passive_knee_torque(*stretched, ankle)
            for number in range(2):
                self._act_on_joint(tick, plant, first + number, phases[leg], passive[number], hip)

    def _act_on_joint(
        self, tick: int, plant: PinocchioPlant, joint: int, phase: int, passive: float, hip: float
    ) -> None:
        arrays, condition = self.problem.wearer, self.problem.wearer.conditions[joint]
        moments = arrays.moments[joint, phase]
        below, share = posture_place(hip, LOWEST_POSTURE, POSTURE_STEP, len(moments))
        moment = moments[below] + share * (moments[below + 1] - moments[below])
        ring = len(self._efforts)
        self._efforts[tick % ring, joint] = condition[EFFORT] * moment
        noise = arrays.noise[tick % len(arrays.noise), joint]
        effort = self._efforts[(tick + 1) % ring, joint] * (1.0 + noise)
        index = self.problem.joints[joint].coordinate + self.problem.world.wearer_shift
        reflex = spastic_torque(
            float(plant.v[index]), condition[STRETCH_REFLEX_THRESHOLD], condition[STRETCH_REFLEX_GAIN]
        )
        plant.wearer[index] = condition[PASSIVE_SHARE] * passive + reflex + effort
