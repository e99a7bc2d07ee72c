"""The safety monitor of the Pinocchio engine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_gait.core.safety import (
    COMMAND_TRIP,
    COMMANDED,
    CURRENT_DEVIATION,
    DRIVE_STREAK,
    DRIVE_TICKS,
    EMF_CONSTANT,
    FROZEN_SPEED,
    HIGHEST_COMMAND,
    LOAD_TRIP,
    MEMORY_COUNT,
    MODEL_RESISTANCE,
    MOTOR_CURRENT,
    MOTOR_SPEED,
    NO_TRIP,
    PHASE_TIME_OUT_TRIP,
    STREAK_COUNT,
    SUPPLY_TRIP,
    command_is_plausible,
    motor_speed,
    watch_joint,
)
from twin_gait.gait.table import TICK
from twin_gait.simulation.pinocchio.sensors import SensorsOfLegs
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.watching import phase_time_out_ticks, ticks, watch_bounds


class MonitorOfLegs:
    """Watches measurements, phases and drives, and remembers why it tripped.

    Attributes:
        trip: Tick, cause and place of the trip, or None.
        hold_angle: Angles that the safe hold keeps, shape ``(n_joints,)``.
        drive_off: Whether the drive of each joint was switched off.
        emf_constants: Of the motors as the monitor knows them, shape ``(n_joints,)``.
    """

    def __init__(self, problem: Problem, sensors: SensorsOfLegs) -> None:
        """Begin without a trip."""
        self.problem, self._sensors = problem, sensors
        n_joints = len(problem.joints)
        self._bounds = watch_bounds(problem)
        self._bound_rows = self._bounds.tolist()  # Python numbers are faster one by one
        self._phase_time_out_ticks = phase_time_out_ticks(problem)
        self._memory = np.zeros((n_joints, MEMORY_COUNT))
        self._streaks = np.zeros((n_joints, STREAK_COUNT), dtype=np.int64)
        self._load_streaks = [0] * len(problem.sides)
        self._low_voltage_streak = 0
        self.emf_constants = self._bounds[:, EMF_CONSTANT]
        self.drive_off = [False] * n_joints
        self.hold_angle = np.zeros(n_joints)
        self.trip: tuple[int, int, int] | None = None

    def watch(self, tick: int, stays: Sequence[int], has_feet: bool, bus_voltage: float) -> None:
        """Look at measurements, phases and the drives' last tick.

        Args:
            stays: Ticks that each leg has been in its phase since it was told to walk.
            bus_voltage: In [V].
        """
        problem, sensors, joints = self.problem, self._sensors, len(self.problem.joints)
        for number in range(joints):
            cause = watch_joint(
                number,
                TICK,
                self._bounds,
                sensors.measured,
                sensors.last_angle,
                self._memory,
                self._streaks,
            )
            if cause != NO_TRIP:
                self._note(tick, cause, number)
                if self._streaks[number, DRIVE_STREAK] >= self._bounds[number, DRIVE_TICKS]:
                    self.drive_off[number] = True
        for leg, stay in enumerate(stays):
            if stay > self._phase_time_out_ticks:
                self._note(tick, PHASE_TIME_OUT_TRIP, joints + leg)
        if has_feet:
            self._watch_feet(tick)
        settings = problem.experiment.control.safety
        least = settings.least_voltage_share * problem.experiment.plant.battery.voltage
        self._low_voltage_streak = self._low_voltage_streak + 1 if bus_voltage < least else 0
        if self._low_voltage_streak >= ticks(settings.voltage_time):
            self._note(tick, SUPPLY_TRIP, -1)

    def _watch_feet(self, tick: int) -> None:
        """Trip if the load of a foot stands still while the hip above it turns."""
        sensors = self._sensors
        longest = ticks(self.problem.experiment.control.safety.frozen_load_time)
        for leg, load in enumerate(sensors.foot_load):
            hip = leg * self.problem.joints_per_leg
            still = load == sensors.last_load[leg] and load > 0.0
            turning = abs(self._memory[hip, MOTOR_SPEED]) > self._bounds[hip, FROZEN_SPEED]
            self._load_streaks[leg] = self._load_streaks[leg] + 1 if still and turning else 0
            if self._load_streaks[leg] >= longest:
                self._note(tick, LOAD_TRIP, len(self.problem.joints) + leg)

    def check_command(self, tick: int, number: int, command: float) -> None:
        """Trip on a command that no controller of this device gives.

        Args:
            command: In [N m].
        """
        if not command_is_plausible(command, self._bound_rows[number][HIGHEST_COMMAND]):
            self._note(tick, COMMAND_TRIP, number)

    def speed_of(self, number: int) -> float:
        """Speed of a joint in [rad] / [s] by its motor's back-EMF in the tick before."""
        return float(self._memory[number, MOTOR_SPEED])

    def remember(
        self, number: int, command: float, current: float, expected: float, velocity: float, resistance: float
    ) -> None:
        """Keep of a drive what the next tick is checked against.

        Args:
            command: In [N m].
            current: Measured, in [A].
            expected: That the drive should have given, in [A].
            velocity: True one of the joint in [rad] / [s], which the back-EMF shows.
            resistance: Of the winding, in [Ohm].
        """
        bounds, memory = self._bound_rows[number], self._memory[number]
        speed = motor_speed(current, velocity, resistance, bounds[EMF_CONSTANT], bounds[MODEL_RESISTANCE])
        memory[COMMANDED], memory[MOTOR_CURRENT] = command, current
        memory[CURRENT_DEVIATION], memory[MOTOR_SPEED] = current - expected, speed

    def _note(self, tick: int, cause: int, place: int) -> None:
        """Go to the safe hold; the first cause is kept."""
        if self.trip is None:
            self.trip = (tick, cause, place)
            # The angles of this tick may be what the monitor tripped on.
            self.hold_angle[:] = self._sensors.last_angle
