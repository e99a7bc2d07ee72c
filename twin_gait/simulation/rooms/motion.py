"""The motion of the leg within a tick: everything that acts on it, its work, and the integration."""

from __future__ import annotations

from twin_gait.core.friction import OTHER_LAWS, advanced_deflection
from twin_gait.core.plant import brace_torque, imposed_motion_torque, passive_torque
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import RK4, SHIFT, dynamics


def integrate(e: Episode, tick: int) -> None:
    """All substeps of one tick; what the log has evaluated is where the first one begins."""
    for substep in range(e.substeps):
        e.time = tick * e.rates.period + substep * e.step
        known = e.recording.on and substep == 0
        if RK4:
            _runge_kutta_step(e, known)
        else:
            _euler_step(e, known)


def acceleration(e: Episode, offset: float, q: list[float], v: list[float]) -> None:
    """Acceleration of a state with everything that acts on it.

    Args:
        e: Its accelerations are changed in place.
        offset: Of the stage in steps.
        q: Coordinates of the stage.
        v: Velocities of the stage.
    """
    for i in range(len(e.q)):
        passive = passive_torque(e.plant[i], q[i], v[i], e.motor[i], q[i] - e.q[i])
        e.torque[i] = e.motor[i] + e.external[i] + passive
    motion = e.imposed_motion
    if motion.place >= 0:
        time = e.time + offset * e.step
        motion.torque = imposed_motion_torque(motion, time, q[motion.place], v[motion.place])
        e.torque[motion.place] += motion.torque
    if SHIFT > 0:
        for i in range(SHIFT):
            brace = e.braces[i]
            brace.torque = brace_torque(brace, q[i], v[i], q[i + SHIFT], v[i + SHIFT])
            e.torque[i] -= brace.torque
            e.torque[i + SHIFT] += brace.torque
    e.contact_power = dynamics(q, v, e.torque, e.bodies, e.gravity, e.ground, e.a, e.points)


def _euler_step(e: Episode, known: bool) -> None:
    """One step of the semi-implicit Euler method, of first order.

    ``v ← v + h a(q, v)``, then ``q ← q + h v`` with the new velocity. The torques work on the mean of old and
    new velocity.
    """
    mean = e.stages.mean_v
    for i in range(len(e.q)):
        mean[i] = e.v[i]
    if not known:
        acceleration(e, 0.0, e.q, e.v)
    for i in range(len(e.q)):
        e.v[i] += e.step * e.a[i]
        _move(e, i, e.step * e.v[i])
    if e.recording.on:
        for i in range(len(e.q)):
            mean[i] = 0.5 * (mean[i] + e.v[i])
        contact = 0.5 * (e.contact_power + e.last_contact_power)
        e.last_contact_power = e.contact_power
        _add_work(e, e.step, contact, mean)


def _runge_kutta_step(e: Episode, known: bool) -> None:
    """One step of the classical Runge-Kutta method, of fourth order."""
    stages, n, step = e.stages, len(e.q), e.step
    for i in range(n):
        stages.q[i] = e.q[i]
        stages.v[i] = e.v[i]
        stages.sum_v[i] = 0.0
        stages.sum_a[i] = 0.0
    for stage in range(4):
        outer = stage == 0 or stage == 3
        weight = 1.0 / 6.0 if outer else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        if not (known and stage == 0):
            acceleration(e, offset, stages.q, stages.v)
        if e.recording.on:
            _add_work(e, weight * step, e.contact_power, stages.v)
        ahead = step if stage == 2 else 0.5 * step
        for i in range(n):
            stages.sum_v[i] += weight * stages.v[i]
            stages.sum_a[i] += weight * e.a[i]
            if stage < 3:
                stages.q[i] = e.q[i] + ahead * stages.v[i]
                stages.v[i] = e.v[i] + ahead * e.a[i]
    for i in range(n):
        e.v[i] += step * stages.sum_a[i]
        _move(e, i, step * stages.sum_v[i])


def _move(e: Episode, place: int, displacement: float) -> None:
    """End a step of a coordinate, its new velocity known; the bristles of its friction go along."""
    e.q[place] += displacement
    if OTHER_LAWS:
        plant = e.plant[place]
        plant.deflection = advanced_deflection(
            plant.friction, displacement, e.v[place], plant.deflection, e.motor[place]
        )


def _add_work(e: Episode, duration: float, contact_power: float, v: list[float]) -> None:
    """Add the work that every source does on the leg in a short time."""
    works, motion = e.works, e.imposed_motion
    for i in range(len(e.q)):
        plant = e.plant[i]
        works.motor_work += duration * e.motor[i] * v[i]
        works.friction_work += duration * plant.friction_torque * v[i]
        works.stop_work += duration * plant.stop_torque * v[i]
        works.spring_work += duration * plant.spring_torque * v[i]
        works.patient_work += duration * e.external[i] * v[i]
    works.contact_work += duration * contact_power
    if SHIFT > 0:
        for i in range(SHIFT):
            e.brace_work += duration * e.braces[i].torque * (v[i + SHIFT] - v[i])
    if motion.place >= 0:
        works.patient_work += duration * motion.torque * v[motion.place]
