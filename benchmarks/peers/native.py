"""The control loop of a problem as one native callback of MuJoCo, from the laws in :mod:`twin_gait.core`.

A callback of C gets no arguments of ours. Constants and memory of the loop therefore lie in one record, as
they would in a C program, whose address is compiled in. The plant's passive torques are part of the callback,
because MuJoCo calls it at every stage of its integrator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from twin_gait.core.actuator import motor_electrical_power, sagged_bus_voltage
from twin_gait.core.control_tick import (
    COLUMNS_PER_JOINT,
    DAMPING,
    EQUILIBRIUM,
    GAIN,
    STIFFNESS,
    blend_phase,
    controller_torques,
    drive_motor,
    leg_signals,
    measure_joints,
)
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.core.plant import passive_torque
from twin_gait.gait.table import TICK
from twin_gait.leg_model.bodies import export_bodies
from twin_gait.simulation.compiling import register_core
from twin_gait.simulation.kernel import body_values, write_control_gravity
from twin_gait.simulation.problem import Problem


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:
    """A number as the pointer that it is."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


def controller_record(problem: Problem, ticks: int) -> np.ndarray:
    """Constants and memory of the control loop at time 0, one record; ``ticks`` rows keep the coordinates."""
    assert problem.experiment.control.inertia_compensation == 0.0  # left out here, as by default
    experiment, world, program = problem.experiment, problem.world, problem.program
    n, legs, joints = world.model.nv, len(problem.sides), problem.joints
    names = [world.initial_phases[side] for side in problem.sides]
    phase = np.array([0 if name is None else problem.table.phase_index(name) for name in names])
    start = problem.phase_rows[np.arange(legs), phase]
    models = [experiment.control.friction_model[item.joint] for item in joints]
    actuators = [problem.actuator(item) for item in joints]
    n_control = problem.control_model.nv
    fields = {
        "calls": np.array(0),
        "coordinates": np.array([item.coordinate for item in joints]),
        "control_coordinates": np.array([item.control_coordinate for item in joints]),
        "rows": world.plant_rows,
        "phase_rows": problem.phase_rows,
        "transitions": program.transitions,
        "nodes": program.nodes,
        "comparisons": program.comparisons,
        "minimum_ticks": program.minimum_ticks,
        "friction": np.array(
            [
                [law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity, law.viscous_friction]
                for law in models
            ]
        ),
        "actuators": np.array(
            [
                [item.torque_constant, item.gear_ratio, item.gear_efficiency, item.resistance]
                for item in actuators
            ]
        ),
        "model_friction": np.zeros(len(joints)),
        "target": np.array([experiment.control.target_torque.get(item.joint, 0.0) for item in joints]),
        "resolution": problem.resolution,
        "bodies": np.array(body_values(export_bodies(problem.control_model.model))),
        "q": world.start_q,
        "v": world.start_v,
        "motor": np.zeros(n),
        "angles": np.zeros(len(joints)),
        "measured": np.zeros((len(joints), 3)),
        "decimated": np.zeros(len(joints)),
        "ring": np.zeros((experiment.sensors.window, len(joints))),
        "phase": phase,
        "entry": np.zeros(legs, dtype=np.int64),
        "ticks": np.zeros(legs, dtype=np.int64),
        "before": np.zeros(legs, dtype=np.int64),
        "debounce": np.zeros((legs, len(program.transitions)), dtype=np.int64),
        "blend_start": start,
        "blended": start,
        "signals": np.full(2 * problem.signals_per_leg, np.nan),
        "loads": np.zeros(legs),
        "control_q": np.zeros(n_control),
        "gravity": np.zeros(n_control),
        "voltage": np.array(experiment.plant.battery.voltage),
        "trace": np.zeros((ticks, n)),
    }
    layout = [
        (name, "i8" if values.dtype.kind == "i" else "f8", values.shape) for name, values in fields.items()
    ]
    record = np.zeros(1, dtype=np.dtype(layout, align=True))
    for name, values in fields.items():
        record[name][0] = values
    return record


def native_tick(problem: Problem) -> Callable[[Any, int], None]:
    """Compile one tick of the control loop on a record: it measures, decides and sets the motor torques."""
    register_core()
    experiment = problem.experiment
    limits, battery, sensors = experiment.control.limits, experiment.plant.battery, experiment.sensors
    torque_limit, current_limit = limits.torque, limits.current
    open_voltage, resistance = battery.voltage, battery.internal_resistance
    decimation, fast_gain, gravity = sensors.decimation, problem.fast_gain, experiment.plant.gravity
    blend_ticks, blend_law = problem.table.blending.duration_ticks, problem.table.blending.law.code
    legs, per_leg, half = len(problem.sides), problem.joints_per_leg, problem.signals_per_leg
    share = problem.phase_rows.shape[2] - 1
    control_gravity = _gravity_function(problem)

    @numba.njit(error_model="numpy")
    def decide(memory: Any, tick: int) -> None:
        for leg in range(legs):
            memory.ticks[leg] = tick - memory.entry[leg]
            memory.before[leg] = memory.phase[leg]
        for leg in range(legs):
            leg_signals(leg, per_leg, memory.measured, memory.loads, memory.ticks, TICK, memory.signals, 0)
            other = -1
            if legs == 2:
                leg_signals(
                    1 - leg, per_leg, memory.measured, memory.loads, memory.ticks, TICK, memory.signals, half
                )
                other = memory.before[1 - leg]
            chosen = next_transition(
                memory.before[leg],
                memory.ticks[leg],
                memory.minimum_ticks[memory.before[leg]],
                memory.transitions,
                memory.nodes,
                memory.comparisons,
                memory.signals,
                other,
                memory.debounce[leg],
            )
            if chosen != NO_TRANSITION:
                memory.phase[leg] = memory.transitions[chosen].target
                memory.entry[leg] = tick
                for column in range(share + 1):
                    memory.blend_start[leg, column] = memory.blended[leg, column]
        for leg in range(legs):
            blend_phase(
                leg,
                tick - memory.entry[leg],
                blend_ticks,
                blend_law,
                memory.blend_start,
                memory.phase_rows[leg, memory.phase[leg]],
                memory.blended,
            )

    @numba.njit(error_model="numpy")
    def drive(memory: Any, joint: int) -> float:
        leg, column = joint // per_leg, COLUMNS_PER_JOINT * (joint % per_leg)
        impedance, friction = controller_torques(
            memory.measured[joint, 0],
            memory.measured[joint, 1],
            memory.measured[joint, 2],
            memory.blended[leg, column + STIFFNESS],
            memory.blended[leg, column + DAMPING],
            memory.blended[leg, column + EQUILIBRIUM],
            memory.blended[leg, column + GAIN],
            memory.model_friction[joint],
        )
        carried = memory.blended[leg, share] * memory.gravity[memory.control_coordinates[joint]]
        place = memory.coordinates[joint]
        actuator = memory.actuators[joint]
        _, current, torque = drive_motor(
            impedance + friction + carried + memory.target[joint],
            memory.v[place],
            memory.voltage,
            torque_limit,
            current_limit,
            actuator[0],
            actuator[1],
            actuator[2],
            actuator[3],
        )
        memory.motor[place] = torque
        return motor_electrical_power(current, memory.v[place], actuator[3], actuator[0], actuator[1])

    @numba.njit(error_model="numpy")
    def tick_once(memory: Any, tick: int) -> None:
        for joint in range(legs * per_leg):
            memory.angles[joint] = memory.q[memory.coordinates[joint]]
        measure_joints(
            tick,
            memory.angles,
            memory.resolution,
            TICK,
            fast_gain,
            decimation,
            memory.measured,
            memory.decimated,
            memory.ring,
        )
        if tick % decimation == 0:
            # The slow velocity, and so the friction that the controller expects, changes only then.
            for joint in range(legs * per_leg):
                law = memory.friction[joint]
                memory.model_friction[joint] = rotational_friction_torque(
                    memory.measured[joint, 2], law[0], law[1], law[2], law[3]
                )
        decide(memory, tick)
        for joint in range(legs * per_leg):
            memory.control_q[memory.control_coordinates[joint]] = memory.measured[joint, 0]
        control_gravity(memory.control_q, memory.bodies, gravity, memory.gravity)
        power = 0.0
        for joint in range(legs * per_leg):
            power += drive(memory, joint)
        memory.voltage = sagged_bus_voltage(open_voltage, resistance, power, memory.voltage)

    compiled: Callable[[Any, int], None] = tick_once
    return compiled


def _gravity_function(problem: Problem) -> Any:
    """Gravity torques of the controller's model from the kernel that is written for it."""
    names: dict[str, Any] = {"math": math}
    model = problem.control_model
    exec(compile(write_control_gravity(export_bodies(model.model), model.up_axis), "gravity", "exec"), names)
    return numba.njit(error_model="numpy")(names["control_gravity"])


def native_callback(
    problem: Problem,
    record: np.ndarray,
    order: Sequence[int],
    addresses: tuple[int, int, int],
    evaluations: int,
) -> Any:
    """Compile the callback for one set of MuJoCo's arrays.

    Args:
        problem: The problem.
        record: From :func:`controller_record`; it must outlive the callback.
        order: Place of every coordinate in MuJoCo's arrays.
        addresses: Of ``qpos``, ``qvel`` and ``qfrc_applied``.
        evaluations: How often MuJoCo asks in one tick: stages times substeps.

    Returns:
        A ctypes function for ``mujoco.set_mjcb_control``.
    """
    tick_once = native_tick(problem)
    n, size, layout = problem.world.model.nv, max(order) + 1, record.dtype
    home, places = record.ctypes.data, tuple(order)
    q_address, v_address, applied_address = addresses

    @numba.cfunc("void(voidptr, voidptr)", error_model="numpy")
    def control(model: Any, data: Any) -> None:
        memory = numba.carray(_pointer(home), 1, layout)[0]
        q = numba.carray(_pointer(q_address), size, numba.float64)
        v = numba.carray(_pointer(v_address), size, numba.float64)
        applied = numba.carray(_pointer(applied_address), size, numba.float64)
        for i in range(n):
            memory.q[i] = q[places[i]]
            memory.v[i] = v[places[i]]
        if memory.calls % evaluations == 0:
            tick = memory.calls // evaluations
            for i in range(n):
                memory.trace[tick, i] = memory.q[i]
            tick_once(memory, tick)
        memory.calls += 1
        for i in range(n):
            row = memory.rows[i]
            friction, stop, spring = passive_torque(
                memory.q[i],
                memory.v[i],
                memory.motor[i],
                *(row[0], row[1], row[2], row[3], row[4], row[5]),
                *(row[6], row[7], row[8], row[9], row[10], row[11]),
            )
            applied[places[i]] = memory.motor[i] + (friction + stop + spring)

    # numba keeps the compiled code alive as long as its own object; ctypes alone does not.
    control.ctypes.owner = (control, record)
    return control.ctypes
