"""The engine that steps through the laws in Python on Pinocchio's forward dynamics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_gait.control import (
    Controller,
    ControllerFunction,
    JointMeasurement,
    JointSetpoint,
)
from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.belt import BELT_RAMP, BELT_START, BELT_STOP, treadmill_speed, walk_command
from twin_gait.core.control_tick import (
    COLUMNS_PER_JOINT,
    blend_phase,
    controller_torques,
    drive_motor,
    leg_signals,
)
from twin_gait.core.estimation import first_order_step
from twin_gait.core.faults import (
    KIND,
    MOTOR_STUCK,
    NO_FAULT,
    dipped_bus_voltage,
    drive_fault,
    runaway_torque,
    supply_drop,
)
from twin_gait.core.safety import (
    hold_torque,
    support_share,
)
from twin_gait.experiment import ControlMode
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.simulation.engine import (
    DIVERGED_VELOCITY,
    EngineResult,
    diverged_reason,
    fell_reason,
    log_layout,
    stopped_reason,
)
from twin_gait.simulation.pinocchio.monitor import MonitorOfLegs
from twin_gait.simulation.pinocchio.plant import PinocchioPlant
from twin_gait.simulation.pinocchio.record import PathOfLegs, RowOfTick
from twin_gait.simulation.pinocchio.sensors import SensorsOfLegs
from twin_gait.simulation.pinocchio.wearer import WearerOfJoints
from twin_gait.simulation.problem import ActuatedJoint, Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.watching import (
    fault_arrays,
    ticks,
    trip_of,
)

PROGRESS_TICKS = 100


class PinocchioEngine:
    """Runs one problem from start to end."""

    def __init__(self, problem: Problem, controller: ControllerFunction | None = None) -> None:
        """Set everything to time 0."""
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
        self._faults = fault_arrays(problem)
        self._sensors = SensorsOfLegs(problem, self._faults)
        self._monitor = MonitorOfLegs(problem, self._sensors)
        self._acceleration_estimate = np.zeros(len(problem.joints))
        self._blend_start = np.array(
            [
                problem.phase_rows[leg, machine.phase_index]
                for leg, machine in enumerate(self.machines.values())
            ]
        )
        self._blended = self._blend_start.copy()
        self._signals = problem.first_signals()
        self._last_rest = 0
        self._bus_voltage = experiment.plant.battery.voltage
        self._index = np.array([joint.coordinate for joint in problem.joints])
        self._control_index = np.array([joint.control_coordinate for joint in problem.joints])
        self._path = PathOfLegs(problem)
        self._wearer = WearerOfJoints(problem)
        self.layout = log_layout(problem)
        self._row = RowOfTick(problem, self.layout)
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
        noted = self._monitor.trip
        trip = None if noted is None else trip_of(self.problem, *noted)
        return EngineResult(rows, tuple(self.switches), status, reason, trip)

    def _ending(self, tick: int) -> tuple[RunStatus, str] | None:
        plant, world = self.plant, self.problem.world
        if not (np.isfinite(plant.q).all() and np.abs(plant.v).max() < DIVERGED_VELOCITY):
            return RunStatus.DIVERGED, diverged_reason(tick + 1)
        pelvis, height = world.model.pelvis_index, world.fall_height
        if pelvis is None or height is None:
            return None
        if plant.q[pelvis + world.wearer_shift] < height:
            return RunStatus.FELL, fell_reason(tick + 1, height)
        return None

    # ------------------------------------------------------------------ one tick

    def _tick(self, tick: int, row: np.ndarray) -> None:
        """Measure, watch, decide, control, record, integrate."""
        self.plant.time = tick * TICK
        self._command(tick)
        self.plant.look()
        self._sensors.measure(tick, self.plant)
        if self.problem.experiment.control.safety.enabled:
            entries = [machine.entry_tick for machine in self.machines.values()]
            stays = [tick - max(entry, self._last_rest) for entry in entries]
            self._monitor.watch(tick, stays, bool(self.plant.feet), self._bus_voltage)
        if self._monitor.trip is None:
            self._decide(tick)
            if self.problem.experiment.control.mode is ControlMode.POSITION:
                self._path.follow(tick, self._blended)
            if self.problem.experiment.control.assistance.adaptive:
                self._path.track(tick, list(self.machines.values()), self._sensors.measured)
        feed_forward = self._feed_forward()
        battery_power = 0.0
        for number, joint in enumerate(self.problem.joints):
            battery_power += self._control(tick, number, joint, feed_forward, row)
        phases = [machine.phase_index for machine in self.machines.values()]
        self._wearer.act(tick, self.plant, phases)
        trip = self._monitor.trip
        if trip is not None and trip[0] == tick:
            self.plant.catch()
        self._row.write(row, self.plant, phases)
        self._row.write_surroundings(row, self.plant, self._bus_voltage, battery_power, trip)
        self._supply(tick, battery_power)
        self._integrate()

    def _command(self, tick: int) -> None:
        """Let the belt follow its profile or come to rest after a trip; tell the legs to walk or to stand."""
        belt, time, trip = self.problem.world.belt, tick * TICK, self._monitor.trip
        tripped = np.inf if trip is None else trip[0] * TICK
        self.plant.belt_speed = treadmill_speed(time, tripped, *belt)
        if belt[BELT_RAMP] == 0.0:
            return
        self._signals[-1] = walk_command(time, belt[BELT_START], belt[BELT_STOP])
        if self._signals[-1] == 0.0:
            self._last_rest = tick

    def _supply(self, tick: int, battery_power: float) -> None:
        """Bus voltage of the next tick."""
        battery = self.problem.experiment.plant.battery
        voltage = sagged_bus_voltage(
            battery.voltage, battery.internal_resistance, battery_power, self._bus_voltage
        )
        drop = supply_drop(tick, self._faults.faults, self._faults.magnitudes)
        if drop > 0.0:
            back_emf = self._monitor.emf_constants * np.abs(self.plant.v[self._index])
            voltage = dipped_bus_voltage(voltage, drop, float(back_emf.max()))
        self._bus_voltage = voltage

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
            self._sensors.measured,
            self._sensors.foot_load,
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
        holding = self._monitor.trip is not None
        if not holding and not self._blended[:, -1].any() and inertia_gain == 0.0:
            return result
        q = np.zeros(problem.control_model.nv)
        q[self._control_index] = self._monitor.hold_angle if holding else self._sensors.measured[:, 0]
        result[:, 0] = problem.control_model.gravity_torque(q)[self._control_index]
        if inertia_gain > 0.0 and not holding:
            rate = (self._sensors.measured[:, 1] - self._sensors.last_fast) / TICK
            for number in range(len(rate)):
                self._acceleration_estimate[number] = first_order_step(
                    self._acceleration_estimate[number], rate[number], problem.fast_gain
                )
            a = np.zeros(problem.control_model.nv)
            a[self._control_index] = self._acceleration_estimate
            result[:, 1] = inertia_gain * problem.control_model.inertia_torque(q, a)[self._control_index]
        return result

    def _control(
        self, tick: int, number: int, joint: ActuatedJoint, feed_forward: np.ndarray, row: np.ndarray
    ) -> float:
        """Torque of one motor for this tick; returns its electrical power in [W]."""
        problem = self.problem
        measurement = JointMeasurement(*self._sensors.measured[number].tolist())
        support, setpoint, parts = 0.0, self._setpoint(number), (0.0,) * 5
        safety, monitor = problem.experiment.control.safety, self._monitor
        if monitor.trip is not None:
            support = support_share(tick - monitor.trip[0], ticks(safety.lowering_time))
        else:
            parts = self._walking_torques(tick, number, joint, measurement, setpoint, feed_forward)
            if safety.enabled:
                monitor.check_command(tick, number, sum(parts))
        if monitor.trip is not None:
            setpoint = JointSetpoint(0.0, safety.hold_damping, float(monitor.hold_angle[number]), 0.0)
            gravity = support * feed_forward[number, 0] if support != 0.0 else 0.0
            held = hold_torque(monitor.speed_of(number), safety.hold_damping)
            parts = (held, 0.0, gravity, 0.0, 0.0)
        impedance, friction, gravity, inertia, target = parts
        command = impedance + friction + gravity + inertia + target
        actuator = problem.actuator(joint)
        velocity = float(self.plant.v[joint.coordinate])
        target_current, current, torque = self._drive(tick, number, joint, command)
        self.plant.motor[joint.coordinate] = torque
        first = self.layout.first(f"{joint.side}_{joint.joint}_measured_angle_rad")
        row[first : first + 10] = (*measurement, *parts, command, torque)
        electrical = self.layout.first(f"{joint.side}_{joint.joint}_target_current_A")
        row[electrical : electrical + 6] = (target_current, current, *setpoint)
        return motor_electrical_power(
            current, velocity, actuator.resistance, actuator.torque_constant, actuator.gear_ratio
        )

    def _setpoint(self, number: int) -> JointSetpoint:
        leg, position = divmod(number, self.problem.joints_per_leg)
        column = COLUMNS_PER_JOINT * position
        stiffness, damping, equilibrium, gain = self._blended[
            leg, column : column + COLUMNS_PER_JOINT
        ].tolist()
        if not self.problem.experiment.control.assistance.is_full:
            stiffness *= float(self._path.assistance[number])
            damping *= float(self._path.assistance[number])
        return JointSetpoint(stiffness, damping, equilibrium, gain)

    def _walking_torques(
        self,
        tick: int,
        number: int,
        joint: ActuatedJoint,
        measurement: JointMeasurement,
        setpoint: JointSetpoint,
        feed_forward: np.ndarray,
    ) -> tuple[float, float, float, float, float]:
        """Impedance, friction and gravity compensation, inertia compensation and target torque."""
        leg = number // self.problem.joints_per_leg
        impedance, friction = self.controllers[number].torques(measurement, setpoint)
        if tick >= self._faults.first_tick:
            impedance += runaway_torque(number, tick, TICK, self._faults.faults, self._faults.magnitudes)
        gravity = self._blended[leg, -1] * feed_forward[number, 0]
        target = self.problem.experiment.control.target_torque.get(joint.joint, 0.0)
        target += float(self._path.lead[number])
        return impedance, friction, gravity, feed_forward[number, 1], target

    def _drive(
        self, tick: int, number: int, joint: ActuatedJoint, command: float
    ) -> tuple[float, float, float]:
        """Target current, measured current and torque of a motor, and what the monitor keeps of them."""
        actuator, limits = self.problem.actuator(joint), self.problem.experiment.control.limits
        velocity = float(self.plant.v[joint.coordinate])
        rest = (
            velocity,
            self._bus_voltage,
            limits.torque,
            limits.current,
            actuator.torque_constant,
            actuator.gear_ratio,
            actuator.gear_efficiency,
            actuator.resistance,
        )
        target_current, current, torque = drive_motor(command, *rest)
        expected = current
        faulty = tick >= self._faults.first_tick
        fault = drive_fault(number, tick, self._faults.faults) if faulty else NO_FAULT
        if self._monitor.drive_off[number]:
            target_current = expected = current = torque = 0.0
        elif fault != NO_FAULT:
            stuck = self._faults.faults[fault, KIND] == MOTOR_STUCK
            _, current, torque = drive_motor(float(self._faults.magnitudes[fault]) if stuck else 0.0, *rest)
        self._monitor.remember(number, command, current, expected, velocity, actuator.resistance)
        return target_current, current, torque

    def _integrate(self) -> None:
        integration = self.problem.experiment.stepping
        start = self.plant.time
        for substep in range(integration.substeps):
            self.plant.time = start + substep * integration.step
            self.plant.step(integration.step, integration.method)
