"""The reference walk in the Pinocchio engine, for position tracking or the tracking error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_gait.core.assistance import adapted_assistance, cycle_place
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.table import TICK
from twin_gait.simulation.problem import Problem


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
