"""The engine that steps through the laws in Python on Pinocchio's forward dynamics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_gait.control import Controller, ControllerFunction, JointMeasurement, JointSetpoint
from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.control_tick import (
    COLUMNS_PER_JOINT,
    blend_phase,
    controller_torques,
    drive_motor,
    leg_signals,
    measure_joints,
)
from twin_gait.core.estimation import first_order_step
from twin_gait.core.plant import FRICTION, SPRING, STOP
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.simulation.columns import WORK_SOURCES
from twin_gait.simulation.engine import (
    DIVERGED_VELOCITY,
    EngineResult,
    diverged_reason,
    fell_reason,
    log_layout,
    stopped_reason,
)
from twin_gait.simulation.pinocchio_plant import PinocchioPlant
from twin_gait.simulation.problem import ActuatedJoint, Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.vocabulary import JointName

PROGRESS_TICKS = 100


class PinocchioEngine:
    """Runs one problem from start to end."""

    def __init__(self, problem: Problem, controller: ControllerFunction | None = None) -> None:
        """Set everything to time 0.

        Args:
            problem: The experiment as arrays.
            controller: Control law of the joints; the thesis's by default.
        """
        self.problem = problem
        experiment = problem.experiment
        models = experiment.control.friction_model
        law = controller or controller_torques
        self.controllers = [Controller(models[joint.joint], law) for joint in problem.joints]
        self.plant = PinocchioPlant(problem.world)
        self.machines = {
            side: GaitStateMachine(
                problem.table,
                side,
                initial_phase=problem.world.initial_phases[side],
                program=problem.program,
            )
            for side in problem.sides
        }
        n_joints, n_legs = len(problem.joints), len(problem.sides)
        window = experiment.sensors.window
        self._measured = np.zeros((n_joints, 3))
        self._decimated_angle = np.zeros(n_joints)
        self._ring = np.zeros((window, n_joints))
        self._acceleration_estimate = np.zeros(n_joints)
        self._last_fast = np.zeros(n_joints)
        self._blend_start = np.array(
            [
                problem.phase_rows[leg, machine.phase_index]
                for leg, machine in enumerate(self.machines.values())
            ]
        )
        self._blended = self._blend_start.copy()
        self._signals = np.full(2 * problem.signals_per_leg, np.nan)
        self._foot_load = np.zeros(n_legs)
        self._bus_voltage = experiment.plant.battery.voltage
        self._index = np.array([joint.coordinate for joint in problem.joints])
        self._control_index = np.array([joint.control_coordinate for joint in problem.joints])
        self.layout = log_layout(problem)
        self.switches: list[PhaseSwitch] = []

    def run(
        self,
        progress: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> EngineResult:
        """Run to the end of the experiment, or to a fall, divergence or a request to stop.

        Args:
            progress: Called with ticks done and ticks in all, now and then.
            should_stop: Asked now and then; True ends the run.

        Returns:
            The log up to there and how it ended.
        """
        total = self.problem.experiment.n_ticks
        rows = np.zeros((total, len(self.layout.names)))
        for tick in range(total):
            if tick % PROGRESS_TICKS == 0:
                if progress is not None:
                    progress(tick, total)
                if should_stop is not None and should_stop():
                    return self._result(rows[:tick], RunStatus.INTERRUPTED, stopped_reason(tick))
            self._tick(tick, rows[tick])
            ending = self._ending(tick)
            if ending is not None:
                return self._result(rows[: tick + 1], *ending)
        if progress is not None:
            progress(total, total)
        return self._result(rows, RunStatus.COMPLETED, "")

    def _result(self, rows: np.ndarray, status: RunStatus, reason: str) -> EngineResult:
        return EngineResult(rows, tuple(self.switches), status, reason)

    def _ending(self, tick: int) -> tuple[RunStatus, str] | None:
        plant, world = self.plant, self.problem.world
        if not (np.isfinite(plant.q).all() and np.abs(plant.v).max() < DIVERGED_VELOCITY):
            return RunStatus.DIVERGED, diverged_reason(tick + 1)
        if world.fall_height is not None and plant.q[world.model.pelvis_index] < world.fall_height:
            return RunStatus.FELL, fell_reason(tick + 1, world.fall_height)
        return None

    # ------------------------------------------------------------------ one tick

    def _tick(self, tick: int, row: np.ndarray) -> None:
        """Measure, decide, control, record, integrate."""
        self.plant.time = tick * TICK
        self.plant.look()
        self._measure(tick)
        self._decide(tick)
        feed_forward = self._feed_forward()
        battery_power = 0.0
        for number, joint in enumerate(self.problem.joints):
            battery_power += self._control(number, joint, feed_forward, row)
        self._record(row, battery_power)
        battery = self.problem.experiment.plant.battery
        self._bus_voltage = sagged_bus_voltage(
            battery.voltage, battery.internal_resistance, battery_power, self._bus_voltage
        )
        self._integrate()

    def _measure(self, tick: int) -> None:
        problem = self.problem
        noise = problem.noise[tick if len(problem.noise) > 1 else 0]
        self._last_fast[:] = self._measured[:, 1]
        measure_joints(
            tick,
            self.plant.q[self._index],
            noise,
            problem.resolution,
            TICK,
            problem.fast_gain,
            problem.experiment.sensors.decimation,
            self._measured,
            self._decimated_angle,
            self._ring,
        )
        if self.plant.feet:
            for leg, side in enumerate(problem.sides):
                self._foot_load[leg] = self.plant.normal_force[side] / problem.world.body_weight

    def _decide(self, tick: int) -> None:
        """Advance both legs on one snapshot, then blend their parameters."""
        problem = self.problem
        machines = list(self.machines.values())
        ticks = np.array([tick - machine.entry_tick for machine in machines])
        before = [machine.phase_index for machine in machines]
        half = problem.signals_per_leg
        for leg, machine in enumerate(machines):
            self._write_signals(leg, ticks, 0)
            other_phase = -1
            if len(machines) == 2:
                self._write_signals(1 - leg, ticks, half)
                other_phase = before[1 - leg]
            switch = machine.advance(tick, self._signals, other_phase)
            if switch is not None:
                self._blend_start[leg] = self._blended[leg]
                self.switches.append(switch)
        blending = problem.table.blending
        for leg, machine in enumerate(machines):
            blend_phase(
                leg,
                tick - machine.entry_tick,
                blending.duration_ticks,
                blending.law.code,
                self._blend_start,
                problem.phase_rows[leg, machine.phase_index],
                self._blended,
            )

    def _write_signals(self, leg: int, ticks: np.ndarray, offset: int) -> None:
        leg_signals(
            leg,
            self.problem.joints_per_leg,
            self._measured,
            self._foot_load,
            ticks,
            TICK,
            self._signals,
            offset,
        )

    def _feed_forward(self) -> np.ndarray:
        """Gravity and inertia torques per joint, shape ``(n_joints, 2)``, before their shares."""
        problem = self.problem
        result = np.zeros((len(problem.joints), 2))
        inertia_gain = problem.experiment.control.inertia_compensation
        if not self._blended[:, -1].any() and inertia_gain == 0.0:
            return result
        q = np.zeros(problem.control_model.nv)
        q[self._control_index] = self._measured[:, 0]
        result[:, 0] = problem.control_model.gravity_torque(q)[self._control_index]
        if inertia_gain > 0.0:
            rate = (self._measured[:, 1] - self._last_fast) / TICK
            for number in range(len(rate)):
                self._acceleration_estimate[number] = first_order_step(
                    self._acceleration_estimate[number], rate[number], problem.fast_gain
                )
            a = np.zeros(problem.control_model.nv)
            a[self._control_index] = self._acceleration_estimate
            result[:, 1] = inertia_gain * problem.control_model.inertia_torque(q, a)[self._control_index]
        return result

    def _control(self, number: int, joint: ActuatedJoint, feed_forward: np.ndarray, row: np.ndarray) -> float:
        """Torque of one motor for this tick; returns its electrical power in [W]."""
        problem = self.problem
        control = problem.experiment.control
        leg, position = divmod(number, problem.joints_per_leg)
        column = COLUMNS_PER_JOINT * position
        setpoint = JointSetpoint(*self._blended[leg, column : column + COLUMNS_PER_JOINT].tolist())
        measurement = JointMeasurement(*self._measured[number].tolist())
        impedance, friction = self.controllers[number].torques(measurement, setpoint)
        gravity = self._blended[leg, -1] * feed_forward[number, 0]
        inertia = feed_forward[number, 1]
        target = control.target_torque.get(joint.joint, 0.0)
        command = impedance + friction + gravity + inertia + target
        actuator = problem.actuator(joint)
        velocity = float(self.plant.v[joint.coordinate])
        target_current, current, torque = drive_motor(
            command,
            velocity,
            self._bus_voltage,
            control.limits.torque,
            control.limits.current,
            actuator.torque_constant,
            actuator.gear_ratio,
            actuator.gear_efficiency,
            actuator.resistance,
        )
        self.plant.motor[joint.coordinate] = torque
        first = self.layout.first(f"{joint.side}_{joint.joint}_measured_angle_rad")
        row[first : first + 10] = (
            *measurement,
            impedance,
            friction,
            gravity,
            inertia,
            target,
            command,
            torque,
        )
        electrical = self.layout.first(f"{joint.side}_{joint.joint}_target_current_A")
        row[electrical : electrical + 6] = (target_current, current, *setpoint)
        return motor_electrical_power(
            current, velocity, actuator.resistance, actuator.torque_constant, actuator.gear_ratio
        )

    def _integrate(self) -> None:
        integration = self.problem.experiment.stepping
        start = self.plant.time
        for substep in range(integration.substeps):
            self.plant.time = start + substep * integration.step
            self.plant.step(integration.step, integration.method)

    # ------------------------------------------------------------------ recording

    def _record(self, row: np.ndarray, battery_power: float) -> None:
        """Write everything that is not a controller's, at the state before integration."""
        plant, world, layout = self.plant, self.problem.world, self.layout
        plant.evaluate()
        for leg, machine in enumerate(self.machines.values()):
            row[leg] = machine.phase_index
        for joint in self.problem.joints:
            name = f"{joint.side}_{joint.joint}"
            first = layout.first(f"{name}_angle_rad")
            row[first : first + 2] = plant.q[joint.coordinate], plant.v[joint.coordinate]
            first = layout.first(f"{name}_friction_torque_Nm")
            held = world.hand is not None and world.hand.index == joint.coordinate
            row[first : first + 3] = (
                plant.passive[joint.coordinate, FRICTION],
                plant.passive[joint.coordinate, STOP],
                plant.hand if held else 0.0,
            )
        for side in layout.ankles:
            index = world.model.index(side, JointName.ANKLE)
            first = layout.first(f"{side}_ankle_angle_rad")
            row[first : first + 3] = plant.q[index], plant.v[index], plant.passive[index, SPRING]
        self._record_surroundings(row, battery_power)

    def _record_surroundings(self, row: np.ndarray, battery_power: float) -> None:
        plant, world, layout = self.plant, self.problem.world, self.layout
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
                plant.passive[pelvis, SPRING],
                *plant.guide_wrench(),
            )
        first = layout.first("bus_voltage_V")
        row[first : first + 4] = (
            self._bus_voltage,
            battery_power,
            world.model.kinetic_energy(plant.q, plant.v),
            world.model.potential_energy(plant.q),
        )
        row[first + 4 : first + 4 + len(WORK_SOURCES)] = plant.works
