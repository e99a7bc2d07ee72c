"""The row of a tick in the log of the Pinocchio engine, but for what the controller writes itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_gait.control import SafetyState
from twin_gait.core.plant import FRICTION, SPRING, STOP
from twin_gait.simulation.columns import BRACE_COLUMNS, PELVIS_BRACE_COLUMNS, LogLayout
from twin_gait.simulation.pinocchio.plant import PinocchioPlant
from twin_gait.simulation.problem import Problem
from twin_gait.vocabulary import JointName


class RowOfTick:
    """Writes rows of the log."""

    def __init__(self, problem: Problem, layout: LogLayout) -> None:
        """Know where everything goes."""
        self.problem, self.layout = problem, layout

    def write(self, row: np.ndarray, plant: PinocchioPlant, phases: Sequence[int]) -> None:
        """Write phases and joints, at the state before integration.

        Args:
            row: Of the log; changed in place.
            plant: Whose state is written; its torques are brought up to date.
        """
        world, layout = self.problem.world, self.layout
        plant.evaluate()
        row[: len(phases)] = phases
        for joint in self.problem.joints:
            name = f"{joint.side}_{joint.joint}"
            first = layout.first(f"{name}_angle_rad")
            row[first : first + 2] = plant.q[joint.coordinate], plant.v[joint.coordinate]
            first = layout.first(f"{name}_friction_torque_Nm")
            held = world.hand is not None and world.hand.index == joint.coordinate
            row[first : first + 3] = (
                plant.passive[joint.coordinate, FRICTION],
                plant.passive[joint.coordinate, STOP],
                (plant.hand if held else 0.0) + plant.wearer[joint.coordinate + world.wearer_shift],
            )
        for side in layout.ankles:
            index = world.model.index(side, JointName.ANKLE)
            first = layout.first(f"{side}_ankle_angle_rad")
            row[first : first + 3] = plant.q[index], plant.v[index], plant.passive[index, SPRING]

    def write_surroundings(
        self,
        row: np.ndarray,
        plant: PinocchioPlant,
        bus_voltage: float,
        battery_power: float,
        trip: tuple[int, int, int] | None,
    ) -> None:
        """Write feet, pelvis, supply and monitor.

        Args:
            row: Of the log; changed in place.
            bus_voltage: In [V].
            battery_power: In [W].
            trip: Tick, cause and place, or None.
        """
        world, layout = self.problem.world, self.layout
        for side in layout.feet:
            first = layout.first(f"{side}_foot_normal_force_N")
            row[first : first + 3] = (
                plant.normal_force[side],
                plant.friction_force[side],
                plant.clearance[side],
            )
        pelvis = world.model.pelvis_index
        if pelvis is not None:
            first = layout.first("pelvis_height_m")
            row[first : first + 5] = (
                plant.q[pelvis],
                plant.v[pelvis],
                plant.passive[pelvis + world.wearer_shift, SPRING]
                + plant.passive[pelvis + world.wearer_shift, STOP],
                *plant.guide_wrench(),
            )
        first = layout.first("bus_voltage_V")
        row[first : first + 4] = (
            bus_voltage,
            battery_power,
            *plant.energy(),
        )
        row[first + 4 : first + 4 + len(plant.works)] = plant.works
        if trip is not None:
            row[layout.first("safety_state")] = SafetyState.HOLD.code
            row[layout.first("trip_cause")] = trip[1]
        if world.braces is not None:
            self._write_braces(row, plant)

    def _write_braces(self, row: np.ndarray, plant: PinocchioPlant) -> None:
        """Write the wearer's own motion and the torque of the device on them."""
        model, layout = self.problem.world.model, self.layout
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                first = layout.first(f"{side}_{joint}_{BRACE_COLUMNS[0]}")
                self._write_brace(row, plant, first, model.index(side, joint))
        if model.pelvis_index is not None:
            first = layout.first(PELVIS_BRACE_COLUMNS[0])
            self._write_brace(row, plant, first, model.pelvis_index)

    def _write_brace(self, row: np.ndarray, plant: PinocchioPlant, first: int, index: int) -> None:
        shift = self.problem.world.wearer_shift
        row[first : first + 3] = plant.q[index + shift], plant.v[index + shift], plant.brace[index]
