"""The row of a tick in the log of the Pinocchio engine, and its reference walk."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_gait.control import SafetyState
from twin_gait.core.assistance import adapted_assistance, cycle_place
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM
from twin_gait.core.plant import FRICTION, SPRING, STOP
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.table import TICK
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
        """Write phases and joints, at the state before integration."""
        world, layout = self.problem.world, self.layout
        plant.evaluate()
        row[: len(phases)] = phases
        for joint in self.problem.joints:
            name = f"{joint.side}_{joint.joint}"
            first = layout.first(f"{name}_angle_rad")
            row[first : first + 2] = plant.q[joint.coordinate], plant.v[joint.coordinate]
            first = layout.first(f"{name}_friction_torque_Nm")
            held = world.imposed_motion is not None and world.imposed_motion.index == joint.coordinate
            row[first : first + 3] = (
                plant.passive[joint.coordinate, FRICTION],
                plant.passive[joint.coordinate, STOP],
                (plant.imposed_motion if held else 0.0) + plant.wearer[joint.coordinate + world.wearer_shift],
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


class PathOfLegs:
    """Moves the joints along the path and adapts the assistance level to the tracking error.

    Attributes:
        assistance: Share of the impedance that each joint is given, shape ``(n_joints,)``.
        lead: Torque in [N m] that lets the dampers follow the path, shape ``(n_joints,)``.
    """

    def __init__(self, problem: Problem) -> None:
        """Set everything to time 0.

        Args:
            problem: The experiment as arrays; its path may be None as long as nothing asks for it.
        """
        self.problem = problem
        legs, joints = len(problem.sides), len(problem.joints)
        cycle = 1 if problem.path is None else problem.path.cycle_ticks
        self.assistance = problem.first_assistance()
        self.lead = np.zeros(joints)
        self._stride_start, self._stride_ticks = [0] * legs, [cycle] * legs
        self._tracking = np.zeros(joints)

    def follow(self, tick: int, blended: np.ndarray) -> None:
        """Move the equilibrium angles along the path, and let the dampers move with it.

        Args:
            blended: k, b, θ0, G of the joints of every leg; θ0 is changed in place.
        """
        path, per_leg = self.problem.path, self.problem.joints_per_leg
        assert path is not None  # the mode asks for it
        samples = len(path.angles)
        spacing = path.cycle_ticks * TICK / (samples - 1)
        for leg, began in enumerate(path.starts):
            before, share = cycle_place(float(began) + tick / path.cycle_ticks, samples)
            for number in range(per_leg):
                start = path.angles[before, number]
                change = path.angles[before + 1, number] - start
                column = COLUMNS_PER_JOINT * number
                blended[leg, column + EQUILIBRIUM] = start + share * change
                self.lead[leg * per_leg + number] = blended[leg, column + DAMPING] * change / spacing

    def track(self, tick: int, machines: Sequence[GaitStateMachine], measured: np.ndarray) -> None:
        """Sum up the tracking error, and adapt the assistance level at the end of a stride.

        Args:
            machines: Of the legs, already advanced in this tick.
            measured: Angle and velocities of the joints, shape ``(n_joints, 3)``.
        """
        path, per_leg = self.problem.path, self.problem.joints_per_leg
        assert path is not None  # the adaptation asks for it
        for leg, machine in enumerate(machines):
            if tick > 0 and machine.phase_index == 0 and machine.entry_tick == tick:
                self._end_stride(leg, tick)
            progress = (tick - self._stride_start[leg]) / self._stride_ticks[leg]
            if self._stride_start[leg] == 0:
                progress += float(path.starts[leg])
            before, share = cycle_place(progress, len(path.angles))
            wanted = path.angles[before] + share * (path.angles[before + 1] - path.angles[before])
            rows = slice(leg * per_leg, (leg + 1) * per_leg)
            self._tracking[rows] += np.abs(measured[rows, 0] - wanted)

    def _end_stride(self, leg: int, tick: int) -> None:
        """Adapt the assistance level of one leg to the errors of the stride that has ended."""
        settings, per_leg = self.problem.experiment.control.assistance, self.problem.joints_per_leg
        duration = tick - self._stride_start[leg]
        for joint in range(leg * per_leg, (leg + 1) * per_leg):
            self.assistance[joint] = adapted_assistance(
                self.assistance[joint],
                self._tracking[joint] / duration,
                settings.forgetting,
                settings.gain,
                settings.allowance,
                settings.least,
            )
            self._tracking[joint] = 0.0
        if self._stride_start[leg] > 0:  # the first stride may have begun half-way
            self._stride_ticks[leg] = duration
        self._stride_start[leg] = tick
