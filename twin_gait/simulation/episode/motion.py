"""The motion of the leg within a tick: everything that acts on it, its work, and the integration."""

from __future__ import annotations

from twin_gait.core.integrators import rk4_step, semi_implicit_euler_step
from twin_gait.core.plant import (
    BRACE_WORK,
    CONTACT_WORK,
    FRICTION,
    FRICTION_WORK,
    MOTOR_WORK,
    PATIENT_WORK,
    SPRING,
    SPRING_WORK,
    STOP,
    STOP_WORK,
    brace_torque,
    imposed_motion_torque,
    passive_torque,
)
from twin_gait.simulation.episode_arrays import (
    CONTACT_POWER,
    GRAVITY,
    IMPOSED_MOTION_INDEX,
    IMPOSED_MOTION_TORQUE,
    LAST_CONTACT_POWER,
    PERIOD,
    RECORD,
    STEP,
    SUBSTEPS,
    TIME,
    USE_RK4,
    WEARER_SHIFT,
    Array,
    Episode,
)
from twin_gait.simulation.kernel_interface import dynamics


def acceleration(episode: Episode, offset: float, weight: float, q: Array, v: Array, out: Array) -> None:
    """Acceleration of a state with everything that acts on it; adds the work of Runge-Kutta stages."""
    inputs, state = episode.inputs, episode.state
    for i in range(q.shape[0]):
        friction, stop, spring = passive_torque(
            q[i],
            v[i],
            state.motor[i],
            inputs.plant_rows[i, 0],
            inputs.plant_rows[i, 1],
            inputs.plant_rows[i, 2],
            inputs.plant_rows[i, 3],
            inputs.plant_rows[i, 4],
            inputs.plant_rows[i, 5],
            inputs.plant_rows[i, 6],
            inputs.plant_rows[i, 7],
            inputs.plant_rows[i, 8],
            inputs.plant_rows[i, 9],
            inputs.plant_rows[i, 10],
            inputs.plant_rows[i, 11],
        )
        state.passive[i, FRICTION] = friction
        state.passive[i, STOP] = stop
        state.passive[i, SPRING] = spring
        state.torque[i] = state.motor[i] + state.external[i] + (friction + stop + spring)
    imposed_motion = inputs.integers[IMPOSED_MOTION_INDEX]
    if imposed_motion >= 0:
        state.changing[IMPOSED_MOTION_TORQUE] = imposed_motion_torque(
            state.changing[TIME] + offset * inputs.numbers[STEP],
            q[imposed_motion],
            v[imposed_motion],
            inputs.imposed_motion[0],
            inputs.imposed_motion[1],
            inputs.imposed_motion[2],
            inputs.imposed_motion[3],
            inputs.imposed_motion[4],
            inputs.imposed_motion[5],
        )
        state.torque[imposed_motion] += state.changing[IMPOSED_MOTION_TORQUE]
    if inputs.integers[WEARER_SHIFT] != 0:
        _bind(episode, q, v)
    state.changing[CONTACT_POWER] = dynamics(
        q, v, state.torque, inputs.bodies, inputs.numbers[GRAVITY], inputs.contact, out, state.points
    )
    if inputs.integers[USE_RK4] != 0 and inputs.integers[RECORD] != 0:
        _add_work(episode, weight * inputs.numbers[STEP], state.changing[CONTACT_POWER], v)


def _bind(episode: Episode, q: Array, v: Array) -> None:
    """Torques of the braces, equal and opposite on device and wearer."""
    inputs, state = episode.inputs, episode.state
    shift = inputs.integers[WEARER_SHIFT]
    for i in range(state.brace.shape[0]):
        brace = brace_torque(q[i], v[i], q[i + shift], v[i + shift], inputs.braces[i, 0], inputs.braces[i, 1])
        state.brace[i] = brace
        state.torque[i] -= brace
        state.torque[i + shift] += brace


def integrate(episode: Episode, tick: int) -> None:
    """All substeps of one tick."""
    inputs, state = episode.inputs, episode.state
    step = inputs.numbers[STEP]
    for substep in range(inputs.integers[SUBSTEPS]):
        state.changing[TIME] = tick * inputs.numbers[PERIOD] + substep * step
        if inputs.integers[USE_RK4] != 0:
            room = (state.stage_q, state.stage_v, state.a, state.sum_v, state.sum_a)
            rk4_step(acceleration, episode, state.q, state.v, step, room)
        else:
            _euler_step(episode, step)


def _euler_step(episode: Episode, step: float) -> None:
    """One semi-implicit Euler step; the torques work on the mean of old and new velocity."""
    inputs, state = episode.inputs, episode.state
    n = state.q.shape[0]
    mean = state.mean_v
    for i in range(n):
        mean[i] = state.v[i]
    semi_implicit_euler_step(acceleration, episode, state.q, state.v, step, state.a)
    if inputs.integers[RECORD] != 0:
        for i in range(n):
            mean[i] = 0.5 * (mean[i] + state.v[i])
        contact = 0.5 * (state.changing[CONTACT_POWER] + state.changing[LAST_CONTACT_POWER])
        state.changing[LAST_CONTACT_POWER] = state.changing[CONTACT_POWER]
        _add_work(episode, step, contact, mean)


def _add_work(episode: Episode, duration: float, contact_power: float, v: Array) -> None:
    """Add the work that every source does on the leg in a short time."""
    inputs, state = episode.inputs, episode.state
    for i in range(v.shape[0]):
        state.works[MOTOR_WORK] += duration * state.motor[i] * v[i]
        state.works[FRICTION_WORK] += duration * state.passive[i, FRICTION] * v[i]
        state.works[STOP_WORK] += duration * state.passive[i, STOP] * v[i]
        state.works[SPRING_WORK] += duration * state.passive[i, SPRING] * v[i]
        state.works[PATIENT_WORK] += duration * state.external[i] * v[i]
    state.works[CONTACT_WORK] += duration * contact_power
    if inputs.integers[WEARER_SHIFT] != 0:
        for i in range(state.brace.shape[0]):
            apart = v[i + inputs.integers[WEARER_SHIFT]] - v[i]
            state.works[BRACE_WORK] += duration * state.brace[i] * apart
    imposed_motion = inputs.integers[IMPOSED_MOTION_INDEX]
    if imposed_motion >= 0:
        state.works[PATIENT_WORK] += duration * state.changing[IMPOSED_MOTION_TORQUE] * v[imposed_motion]
