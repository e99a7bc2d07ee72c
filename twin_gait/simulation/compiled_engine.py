"""The engine that runs a whole episode in compiled code, from the same laws as the Pinocchio engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from twin_gait.control import ControllerFunction, Trip
from twin_gait.core import safety
from twin_gait.experiment import ControlMode, IntegrationMethod
from twin_gait.gait.machine import PhaseSwitch
from twin_gait.gait.table import TICK
from twin_gait.leg_model import LegModel
from twin_gait.leg_model.bodies import BodyArrays, ContactPoint, contact_points, export_bodies
from twin_gait.simulation import episode_arrays
from twin_gait.simulation.engine import (
    DIVERGED_VELOCITY,
    EngineResult,
    diverged_reason,
    fell_reason,
    log_layout,
    stopped_reason,
)
from twin_gait.simulation.flat_episode import lay_out
from twin_gait.simulation.kernel import body_values, write_kernel
from twin_gait.simulation.loops import loop_of
from twin_gait.simulation.problem import Problem
from twin_gait.simulation.run import RunStatus
from twin_gait.simulation.watching import (
    fault_arrays,
    phase_time_out_ticks,
    start_angles,
    ticks,
    trip_of,
    watch_bounds,
)
from twin_gait.simulation.wearing import LOWEST_POSTURE, POSTURE_STEP
from twin_gait.vocabulary import JointName

CHUNK_TICKS = 2000  # between two looks at progress and interruption
MOST_SWITCHES_PER_SECOND = 200


class CompiledEngine:
    """Runs one problem from start to end in compiled code.

    Attributes:
        problem: The experiment as arrays.
        layout: Names and positions of the log's columns.
        episode: Inputs and state, which change as the loop runs.
        run_ticks: The loop: first tick, one past the last, log; returns the ticks run since the start.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        controller: ControllerFunction | None = None,
        record: bool = True,
        on_compile: Callable[[], None] | None = None,
    ) -> None:
        """Lay the problem out and get the compiled loop.

        Args:
            controller: Control law that takes the place of the thesis's; numba must be able to compile it.
            record: Whether to keep the log; without it only the switches and the last state remain.
            on_compile: Called if the loop has to be compiled first.
        """
        self.problem = problem
        self.layout = log_layout(problem)
        world = problem.world
        frames = [name for side in problem.sides for name in world.contact_frames.get(side, ())]
        bodies, points = _forest(world.chains, frames)
        control_bodies = export_bodies(problem.control_model.model)
        guides = range(0, len(bodies), world.model.nv)  # the first joint of each chain
        kernel = write_kernel(bodies, points, control_bodies, world.model.up_axis, guides)
        inputs = self._inputs(bodies, points, control_bodies, record)
        flat = lay_out(episode_arrays.Episode(inputs, self._state(len(points))))
        self.episode = flat.episode
        self.run_ticks = loop_of(flat, kernel, len(self.layout.names), controller, on_compile)
        self._record = record

    def _inputs(
        self,
        bodies: list[BodyArrays],
        points: list[ContactPoint],
        control_bodies: list[BodyArrays],
        record: bool,
    ) -> episode_arrays.EpisodeInputs:
        problem = self.problem
        experiment, world = problem.experiment, problem.world
        legs = len(problem.sides)
        blending, integration = problem.table.blending, experiment.stepping
        pelvis = world.model.pelvis_index
        ankles = [
            world.model.index(side, JointName.ANKLE)
            for side, leg in world.model.legs.items()
            if leg.ankle is not None
        ]
        braced = [joint.coordinate for joint in problem.joints] + ankles
        braced += [] if pelvis is None else [pelvis]
        integers = np.zeros(episode_arrays.INTEGER_COUNT, dtype=np.int64)
        integers[episode_arrays.N_LEGS] = legs
        integers[episode_arrays.JOINTS_PER_LEG] = problem.joints_per_leg
        integers[episode_arrays.POINTS_PER_FOOT] = len(points) // legs
        integers[episode_arrays.DECIMATION] = experiment.sensors.decimation
        integers[episode_arrays.BLEND_LAW] = blending.law.code
        integers[episode_arrays.BLEND_TICKS] = blending.duration_ticks
        integers[episode_arrays.SUBSTEPS] = integration.substeps
        integers[episode_arrays.USE_RK4] = integration.method is IntegrationMethod.RK4
        integers[episode_arrays.PELVIS_INDEX] = -1 if pelvis is None else pelvis
        integers[episode_arrays.IMPOSED_MOTION_INDEX] = (
            -1 if world.imposed_motion is None else world.imposed_motion.index
        )
        integers[episode_arrays.N_ANKLES] = len(ankles)
        integers[episode_arrays.RECORD] = record
        integers[episode_arrays.INERTIA_WANTED] = experiment.control.inertia_compensation > 0.0
        integers[episode_arrays.WEARER] = problem.wearer.acts
        control, path = experiment.control, problem.path
        integers[episode_arrays.FOLLOWS] = control.mode is ControlMode.POSITION
        integers[episode_arrays.ASSISTS] = not control.assistance.is_full
        integers[episode_arrays.ADAPTS] = control.assistance.adaptive
        integers[episode_arrays.CYCLE_TICKS] = 1 if path is None else path.cycle_ticks
        integers[episode_arrays.WEARER_SHIFT] = world.wearer_shift
        faults = fault_arrays(problem)
        settings = experiment.control.safety
        integers[episode_arrays.WATCHING] = settings.enabled
        integers[episode_arrays.FAULTY] = len(faults.faults) > 0
        integers[episode_arrays.FIRST_FAULT] = faults.first_tick
        integers[episode_arrays.PHASE_TIME_OUT_TICKS] = phase_time_out_ticks(problem)
        integers[episode_arrays.FROZEN_LOAD_TICKS] = ticks(settings.frozen_load_time)
        integers[episode_arrays.VOLTAGE_TICKS] = ticks(settings.voltage_time)
        integers[episode_arrays.LOWERING_TICKS] = ticks(settings.lowering_time)
        return episode_arrays.EpisodeInputs(
            integers=integers,
            numbers=self._numbers(),
            bodies=np.array(body_values(bodies, points)),
            control_bodies=np.array(body_values(control_bodies)),
            contact=self._contact(),
            belt=np.array(world.belt),
            plant_rows=np.ascontiguousarray(world.plant_rows),
            coordinates=np.array([joint.coordinate for joint in problem.joints], dtype=np.int64),
            control_coordinates=np.array(
                [joint.control_coordinate for joint in problem.joints], dtype=np.int64
            ),
            ankles=np.array(ankles, dtype=np.int64),
            braces=np.zeros((1, 2)) if world.braces is None else world.braces.rows,
            braced=np.array(braced, dtype=np.int64),
            transitions=problem.program.transitions,
            nodes=problem.program.nodes,
            comparisons=problem.program.comparisons,
            minimum_ticks=problem.program.minimum_ticks,
            phase_rows=problem.phase_rows,
            noise=problem.noise,
            resolution=problem.resolution,
            friction_model=self._friction_model(),
            actuators=self._actuators(),
            target_torque=np.array(
                [experiment.control.target_torque.get(joint.joint, 0.0) for joint in problem.joints]
            ),
            push=np.zeros(len(problem.joints)),
            conditions=problem.wearer.conditions,
            effort_moments=problem.wearer.moments,
            effort_noise=problem.wearer.noise,
            path=np.zeros((2, problem.joints_per_leg)) if path is None else path.angles,
            path_starts=np.zeros(legs) if path is None else path.starts,
            imposed_motion=self._imposed_motion(),
            bounds=watch_bounds(problem),
            faults=faults.faults,
            magnitudes=faults.magnitudes,
        )

    def _numbers(self) -> np.ndarray:
        experiment, world = self.problem.experiment, self.problem.world
        battery, limits = experiment.plant.battery, experiment.control.limits
        numbers = np.zeros(episode_arrays.NUMBER_COUNT)
        numbers[episode_arrays.PERIOD] = TICK
        numbers[episode_arrays.FAST_GAIN] = self.problem.fast_gain
        numbers[episode_arrays.GRAVITY] = experiment.plant.gravity
        numbers[episode_arrays.STEP] = experiment.stepping.step
        numbers[episode_arrays.TORQUE_LIMIT] = limits.torque
        numbers[episode_arrays.CURRENT_LIMIT] = limits.current
        numbers[episode_arrays.BATTERY_VOLTAGE] = battery.voltage
        numbers[episode_arrays.BATTERY_RESISTANCE] = battery.internal_resistance
        numbers[episode_arrays.BODY_WEIGHT] = world.body_weight
        numbers[episode_arrays.FALL_HEIGHT] = -np.inf if world.fall_height is None else world.fall_height
        numbers[episode_arrays.DIVERGED_VELOCITY] = DIVERGED_VELOCITY
        numbers[episode_arrays.INERTIA_GAIN] = experiment.control.inertia_compensation
        numbers[episode_arrays.LEAST_VOLTAGE] = (
            experiment.control.safety.least_voltage_share * battery.voltage
        )
        numbers[episode_arrays.HOLD_DAMPING] = experiment.control.safety.hold_damping
        numbers[episode_arrays.LOWEST_POSTURE] = LOWEST_POSTURE
        numbers[episode_arrays.POSTURE_STEP] = POSTURE_STEP
        assistance = experiment.control.assistance
        numbers[episode_arrays.FORGETTING] = assistance.forgetting
        numbers[episode_arrays.ASSISTANCE_GAIN] = assistance.gain
        numbers[episode_arrays.ALLOWANCE] = assistance.allowance
        numbers[episode_arrays.LEAST_ASSISTANCE] = assistance.least
        numbers[episode_arrays.CATCH_STIFFNESS] = world.catch_stiffness
        numbers[episode_arrays.CATCH_DISSIPATION] = world.catch_dissipation
        return numbers

    def _contact(self) -> np.ndarray:
        contact = self.problem.world.contact
        if contact is None:
            return np.zeros(5)
        return np.array(
            [
                self.problem.world.belt_speed,
                contact.stiffness,
                contact.dissipation,
                contact.friction_coefficient,
                contact.transition_velocity,
            ]
        )

    def _friction_model(self) -> np.ndarray:
        models = self.problem.experiment.control.friction_model
        laws = [models[joint.joint] for joint in self.problem.joints]
        return np.array(
            [
                [law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity, law.viscous_friction]
                for law in laws
            ]
        )

    def _actuators(self) -> np.ndarray:
        items = [self.problem.actuator(joint) for joint in self.problem.joints]
        return np.array(
            [[item.torque_constant, item.gear_ratio, item.gear_efficiency, item.resistance] for item in items]
        )

    def _imposed_motion(self) -> np.ndarray:
        imposed_motion = self.problem.world.imposed_motion
        if imposed_motion is None:
            return np.zeros(6)
        return np.array(
            [
                imposed_motion.start_angle,
                imposed_motion.amplitude,
                imposed_motion.frequency,
                imposed_motion.stiffness,
                imposed_motion.damping,
                imposed_motion.release_time,
            ]
        )

    def _state(self, n_points: int) -> episode_arrays.EpisodeState:
        problem = self.problem
        world, experiment = problem.world, problem.experiment
        n, legs, joints = len(world.start_q), len(problem.sides), len(problem.joints)
        phases = np.array(
            [
                0 if name is None else problem.table.phase_index(name)
                for name in (world.initial_phases[side] for side in problem.sides)
            ],
            dtype=np.int64,
        )
        start = problem.phase_rows[np.arange(legs), phases]
        changing = np.zeros(episode_arrays.CHANGING_COUNT)
        changing[episode_arrays.BUS_VOLTAGE] = experiment.plant.battery.voltage
        n_control = problem.control_model.nv
        measured = np.zeros((joints, 3))
        measured[:, 0] = start_angles(problem)
        watched = np.zeros(episode_arrays.SAFETY_COUNT, dtype=np.int64)
        watched[episode_arrays.TRIP_TICK] = -1
        capacity = max(100, int(MOST_SWITCHES_PER_SECOND * experiment.duration))
        return episode_arrays.EpisodeState(
            q=world.start_q.copy(),
            v=world.start_v.copy(),
            a=np.zeros(n),
            measured=measured,
            decimated_angle=np.zeros(joints),
            ring=np.zeros((experiment.sensors.window, joints)),
            rate=np.zeros(joints),
            phase=phases,
            entry_tick=np.zeros(legs, dtype=np.int64),
            debounce=np.zeros(legs * len(problem.program.transitions), dtype=np.int64),
            blend_start=start.copy(),
            blended=start.copy(),
            signals=problem.first_signals(),
            motor=np.zeros(n),
            external=np.zeros(n),
            assistance=problem.first_assistance(),
            lead=np.zeros(joints),
            stride_start=np.zeros(legs, dtype=np.int64),
            stride_ticks=np.full(legs, 1 if problem.path is None else problem.path.cycle_ticks),
            tracking=np.zeros(joints),
            efforts=np.zeros((problem.wearer.delay + 1, joints)),
            torque=np.zeros(n),
            passive=np.zeros((n, 3)),
            points=np.zeros((max(n_points, 1), 3)),
            brace=np.zeros(max(world.wearer_shift, 1)),
            works=np.zeros(len(self.layout.work_sources)),
            changing=changing,
            stage_q=np.zeros(n),
            stage_v=np.zeros(n),
            sum_v=np.zeros(n),
            sum_a=np.zeros(n),
            mean_v=np.zeros(n),
            angles=start_angles(problem),
            last_angle=np.zeros(joints),
            last_fast=np.zeros(joints),
            model_friction=np.zeros(joints),
            control_q=np.zeros(n_control),
            control_a=np.zeros(n_control),
            gravity_torque=np.zeros(n_control),
            inertia_torque=np.zeros(n_control),
            legs=np.zeros(legs),
            leg_ticks=np.zeros(legs, dtype=np.int64),
            before=np.zeros(legs, dtype=np.int64),
            switches=np.zeros((capacity, 5), dtype=np.int64),
            counters=np.zeros(3, dtype=np.int64),
            watch_memory=np.zeros((joints, safety.MEMORY_COUNT)),
            watch_streaks=np.zeros((joints, safety.STREAK_COUNT), dtype=np.int64),
            load_streaks=np.zeros(legs, dtype=np.int64),
            last_load=np.zeros(legs),
            safety=watched,
            drive_off=np.zeros(joints, dtype=np.int64),
            hold_angle=np.zeros(joints),
        )

    def warm_up(self) -> None:
        """Load or compile the loop without taking a tick, so that a clock started afterwards is right."""
        self.run_ticks(0, 0, np.zeros((1, len(self.layout.names))))

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
        rows = np.zeros((total if self._record else 1, len(self.layout.names)))
        done = 0
        status, reason = RunStatus.COMPLETED, ""
        while done < total and status is RunStatus.COMPLETED:
            if progress is not None:
                progress(done, total)
            if should_stop is not None and should_stop():
                status, reason = RunStatus.INTERRUPTED, stopped_reason(done)
                break
            done = int(self.run_ticks(done, min(done + CHUNK_TICKS, total), rows))
            status, reason = self.ending(done)
        if progress is not None:
            progress(done, total)
        rows = rows[:done] if self._record else rows[:0]
        return EngineResult(rows, self.switches(), status, reason, self.trip())

    def trip(self) -> Trip | None:
        """What the safety monitor has tripped on, or None."""
        watched = self.episode.state.safety
        places = [episode_arrays.TRIP_TICK, episode_arrays.TRIP_CAUSE, episode_arrays.TRIP_PLACE]
        return trip_of(self.problem, *watched[places].tolist())

    def ending(self, done: int) -> tuple[RunStatus, str]:
        """How the run stands after some ticks, and why; completed as long as nothing has ended it."""
        code = int(self.episode.state.counters[1])
        if code == episode_arrays.DIVERGED:
            return RunStatus.DIVERGED, diverged_reason(done)
        if code == episode_arrays.FELL:
            return RunStatus.FELL, fell_reason(done, self.problem.world.fall_height)
        return RunStatus.COMPLETED, ""

    def switches(self, first: int = 0) -> tuple[PhaseSwitch, ...]:
        """Switches of the phases so far, from one of them on."""
        names, sides = self.problem.table.phase_names, self.problem.sides
        state = self.episode.state
        causes = [item.cause for item in self.problem.table.transitions]
        return tuple(
            PhaseSwitch(tick, sides[leg], names[source], names[target], causes[chosen], chosen)
            for tick, leg, source, target, chosen in state.switches[first : state.counters[0]].tolist()
        )


def _forest(chains: Sequence[LegModel], frames: Sequence[str]) -> tuple[list[BodyArrays], list[ContactPoint]]:
    """Bodies of models that share nothing but the ground, one after the other; the last has the feet."""
    bodies: list[BodyArrays] = []
    for chain in chains:
        first = len(bodies)
        bodies += [
            body._replace(parent=body.parent + first if body.parent >= 0 else body.parent)
            for body in export_bodies(chain.model)
        ]
    points = [point._replace(body=point.body + first) for point in contact_points(chains[-1].model, frames)]
    return bodies, points
