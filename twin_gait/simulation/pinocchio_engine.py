"""The engine that steps through the laws in Python on Pinocchio's forward dynamics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_gait.control import (
    Controller,
    ControllerFunction,
    JointMeasurement,
    JointSetpoint,
    SafetyState,
)
from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.belt import belt_speed, walk_command
from twin_gait.core.control_tick import (
    COLUMNS_PER_JOINT,
    blend_phase,
    controller_torques,
    drive_motor,
    leg_signals,
    measure_joints,
)
from twin_gait.core.estimation import first_order_step
from twin_gait.core.faults import (
    KIND,
    MOTOR_STUCK,
    NO_FAULT,
    dipped_bus_voltage,
    drive_fault,
    faulty_angle,
    faulty_load,
    runaway_torque,
    supply_drop,
)
from twin_gait.core.plant import FRICTION, SPRING, STOP
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
    OVERSTAY_TRIP,
    STREAK_COUNT,
    SUPPLY_TRIP,
    command_is_plausible,
    hold_torque,
    motor_speed,
    support_share,
    watch_joint,
)
from twin_gait.experiment import ControlMode
from twin_gait.gait.machine import GaitStateMachine, PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.simulation.columns import BRACE_COLUMNS, PELVIS_BRACE_COLUMNS
from twin_gait.simulation.engine import (
    DIVERGED_VELOCITY,
    EngineResult,
    diverged_reason,
    fell_reason,
    log_layout,
    stopped_reason,
)
from twin_gait.simulation.pinocchio_path import PathOfLegs
from twin_gait.simulation.pinocchio_plant import PinocchioPlant
from twin_gait.simulation.pinocchio_wearer import WearerOfJoints
from twin_gait.simulation.problem import ActuatedJoint, Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.watching import (
    fault_arrays,
    overstay_ticks,
    start_angles,
    ticks,
    trip_of,
    watch_bounds,
)
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
        self._measured[:, 0] = start_angles(problem)
        self._readings = start_angles(problem)
        self._last_angle = np.zeros(n_joints)
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
        self._signals = problem.first_signals()
        self._last_rest = 0
        self._foot_load = np.zeros(n_legs)
        self._last_load = np.zeros(n_legs)
        self._bus_voltage = experiment.plant.battery.voltage
        self._index = np.array([joint.coordinate for joint in problem.joints])
        self._control_index = np.array([joint.control_coordinate for joint in problem.joints])
        self._faults = fault_arrays(problem)
        self._bounds = watch_bounds(problem)
        self._bound_rows = self._bounds.tolist()  # Python numbers are faster one by one
        self._overstay_ticks = overstay_ticks(problem)
        self._memory = np.zeros((n_joints, MEMORY_COUNT))
        self._streaks = np.zeros((n_joints, STREAK_COUNT), dtype=np.int64)
        self._load_streaks = [0] * n_legs
        self._low_voltage_streak = 0
        self._drive_off = [False] * n_joints
        self._hold_angle = np.zeros(n_joints)
        self._trip: tuple[int, int, int] | None = None
        self._path = PathOfLegs(problem)
        self._wearer = WearerOfJoints(problem)
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
        trip = None if self._trip is None else trip_of(self.problem, *self._trip)
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
        self._measure(tick)
        if self.problem.experiment.control.safety.enabled:
            self._watch(tick)
        if self._trip is None:
            self._decide(tick)
            if self.problem.experiment.control.mode is ControlMode.POSITION:
                self._path.follow(tick, self._blended)
            if self.problem.experiment.control.assistance.adaptive:
                self._path.judge(tick, list(self.machines.values()), self._measured)
        feed_forward = self._feed_forward()
        battery_power = 0.0
        for number, joint in enumerate(self.problem.joints):
            battery_power += self._control(tick, number, joint, feed_forward, row)
        phases = [machine.phase_index for machine in self.machines.values()]
        self._wearer.act(tick, self.plant, phases)
        self._record(row, battery_power)
        self._supply(tick, battery_power)
        self._integrate()

    def _command(self, tick: int) -> None:
        """Let the belt follow its profile, and tell the legs to walk or to stand."""
        world = self.problem.world
        if world.belt is None:
            return
        belt, time = world.belt, tick * TICK
        self.plant.belt_speed = belt_speed(
            time - belt.delay, world.belt_speed, belt.start, belt.stop, belt.ramp
        )
        self._signals[-1] = walk_command(time, belt.start, belt.stop)
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
            back_emf = self._bounds[:, EMF_CONSTANT] * np.abs(self.plant.v[self._index])
            voltage = dipped_bus_voltage(voltage, drop, float(back_emf.max()))
        self._bus_voltage = voltage

    def _measure(self, tick: int) -> None:
        problem = self.problem
        noise = problem.noise[tick if len(problem.noise) > 1 else 0]
        self._read(tick, self.plant.q[self._index] + noise)
        self._last_angle[:] = self._measured[:, 0]
        self._last_fast[:] = self._measured[:, 1]
        measure_joints(
            tick,
            self._readings,
            problem.resolution,
            TICK,
            problem.fast_gain,
            problem.experiment.sensors.decimation,
            self._measured,
            self._decimated_angle,
            self._ring,
        )
        if self.plant.feet:
            self._last_load[:] = self._foot_load
            for leg, side in enumerate(problem.sides):
                load = self.plant.normal_force[side] / problem.world.body_weight
                self._foot_load[leg] = faulty_load(leg, tick, self._faults.faults, load, self._last_load[leg])

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

    def _watch(self, tick: int) -> None:
        """Let the safety monitor look at measurements, phases and the drives' last tick."""
        problem, joints = self.problem, len(self.problem.joints)
        for number in range(joints):
            cause = watch_joint(
                number, TICK, self._bounds, self._measured, self._last_angle, self._memory, self._streaks
            )
            if cause != NO_TRIP:
                self._note_trip(tick, cause, number)
                if self._streaks[number, DRIVE_STREAK] >= self._bounds[number, DRIVE_TICKS]:
                    self._drive_off[number] = True
        for leg, machine in enumerate(self.machines.values()):
            if tick - max(machine.entry_tick, self._last_rest) > self._overstay_ticks:
                self._note_trip(tick, OVERSTAY_TRIP, joints + leg)
        if self.plant.feet:
            self._watch_feet(tick)
        settings = problem.experiment.control.safety
        least = settings.least_voltage_share * problem.experiment.plant.battery.voltage
        self._low_voltage_streak = self._low_voltage_streak + 1 if self._bus_voltage < least else 0
        if self._low_voltage_streak >= ticks(settings.voltage_time):
            self._note_trip(tick, SUPPLY_TRIP, -1)

    def _watch_feet(self, tick: int) -> None:
        """Trip if the load of a foot stands still while the hip above it turns."""
        longest = ticks(self.problem.experiment.control.safety.frozen_load_time)
        for leg, load in enumerate(self._foot_load):
            hip = leg * self.problem.joints_per_leg
            still = load == self._last_load[leg] and load > 0.0
            turning = abs(self._memory[hip, MOTOR_SPEED]) > self._bounds[hip, FROZEN_SPEED]
            self._load_streaks[leg] = self._load_streaks[leg] + 1 if still and turning else 0
            if self._load_streaks[leg] >= longest:
                self._note_trip(tick, LOAD_TRIP, len(self.problem.joints) + leg)

    def _note_trip(self, tick: int, cause: int, place: int) -> None:
        """Go to the safe hold; the first cause is kept."""
        if self._trip is None:
            self._trip = (tick, cause, place)
            # The angles of this tick may be what the monitor tripped on.
            self._hold_angle[:] = self._last_angle

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
        holding = self._trip is not None
        if not holding and not self._blended[:, -1].any() and inertia_gain == 0.0:
            return result
        q = np.zeros(problem.control_model.nv)
        q[self._control_index] = self._hold_angle if holding else self._measured[:, 0]
        result[:, 0] = problem.control_model.gravity_torque(q)[self._control_index]
        if inertia_gain > 0.0 and not holding:
            rate = (self._measured[:, 1] - self._last_fast) / TICK
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
        measurement = JointMeasurement(*self._measured[number].tolist())
        support, setpoint, parts = 0.0, self._setpoint(number), (0.0,) * 5
        if self._trip is not None:
            lowering = ticks(problem.experiment.control.safety.lowering_time)
            support = support_share(tick - self._trip[0], lowering)
        else:
            parts = self._walking_torques(tick, number, joint, measurement, setpoint, feed_forward)
            watching = problem.experiment.control.safety.enabled
            if watching and not command_is_plausible(sum(parts), self._bound_rows[number][HIGHEST_COMMAND]):
                self._note_trip(tick, COMMAND_TRIP, number)
        if self._trip is not None:
            damping = problem.experiment.control.safety.hold_damping
            setpoint = JointSetpoint(0.0, damping, float(self._hold_angle[number]), 0.0)
            gravity = support * feed_forward[number, 0] if support != 0.0 else 0.0
            parts = (hold_torque(self._memory[number, MOTOR_SPEED], damping), 0.0, gravity, 0.0, 0.0)
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
        struck = tick >= self._faults.first_tick
        fault = drive_fault(number, tick, self._faults.faults) if struck else NO_FAULT
        if self._drive_off[number]:
            target_current = expected = current = torque = 0.0
        elif fault != NO_FAULT:
            stuck = self._faults.faults[fault, KIND] == MOTOR_STUCK
            _, current, torque = drive_motor(float(self._faults.magnitudes[fault]) if stuck else 0.0, *rest)
        bounds = self._bound_rows[number]
        speed = motor_speed(
            current, velocity, actuator.resistance, bounds[EMF_CONSTANT], bounds[MODEL_RESISTANCE]
        )
        memory = self._memory[number]
        memory[COMMANDED], memory[MOTOR_CURRENT] = command, current
        memory[CURRENT_DEVIATION], memory[MOTOR_SPEED] = current - expected, speed
        return target_current, current, torque

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
                (plant.hand if held else 0.0) + plant.wearer[joint.coordinate + world.wearer_shift],
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
                plant.passive[pelvis + world.wearer_shift, SPRING],
                *plant.guide_wrench(),
            )
        first = layout.first("bus_voltage_V")
        row[first : first + 4] = (
            self._bus_voltage,
            battery_power,
            *plant.energy(),
        )
        row[first + 4 : first + 4 + len(plant.works)] = plant.works
        if self._trip is not None:
            row[layout.first("safety_state")] = SafetyState.HOLD.code
            row[layout.first("trip_cause")] = self._trip[1]
        if world.braces is not None:
            self._record_braces(row)

    def _record_braces(self, row: np.ndarray) -> None:
        """Write the wearer's own motion and what the device does on him."""
        model, layout = self.problem.world.model, self.layout
        for side, leg in model.legs.items():
            for joint, _ in leg.items():
                first = layout.first(f"{side}_{joint}_{BRACE_COLUMNS[0]}")
                self._record_brace(row, first, model.index(side, joint))
        if model.pelvis_index is not None:
            self._record_brace(row, layout.first(PELVIS_BRACE_COLUMNS[0]), model.pelvis_index)

    def _record_brace(self, row: np.ndarray, first: int, index: int) -> None:
        plant, shift = self.plant, self.problem.world.wearer_shift
        row[first : first + 3] = plant.q[index + shift], plant.v[index + shift], plant.brace[index]
