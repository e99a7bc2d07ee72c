"""The motion within a tick: what acts on the bodies, the row of the log, work, and the integration."""

from twin_gait.core.contact import LEAST_FORCE
from twin_gait.core.friction import OTHER_LAWS, advanced_deflection, geared_friction_torque
from twin_gait.core.plant import brace_torque, gear_load, imposed_motion_torque, passive_torque
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import dynamics, lanes, log_row, observe, side_by_side, write_row
from twin_gait.simulation.stages.sensors import normal_force, point_force
from twin_gait.simulation.stages.surroundings import drag_tips, hold_trunk, move_tips, push_tips, tip_energy
from twin_gait.simulation.structure import CRUTCHES, POINTS_PER_FOOT, RK4, SEATED, SHIFT, WITH_FRICTION


def integrate(e: Episode, tick: int) -> None:
    """All substeps of one tick; what the log has evaluated is where the first one begins."""
    for substep in range(e.substeps):
        time = tick * e.rates.period + substep * e.step
        known = e.recording.on and substep == 0
        if RK4:
            _runge_kutta_step(e, time, known)
        else:
            _euler_step(e, time, known)
        if CRUTCHES > 0:
            for one in lanes(e):
                drag_tips(one)


def acceleration(e: Episode, time: float, staged: bool) -> None:
    """Acceleration of a state with everything that acts on it.

    Args:
        e: Its accelerations are changed in place.
        time: In [s].
        staged: Whether the state is that of a stage of the integration, not the present one.
    """
    if WITH_FRICTION:
        side_by_side(e, WITH_FRICTION, staged, _friction_arguments, geared_friction_torque, _keep_friction)
    if CRUTCHES > 0:
        for one in lanes(e):
            q, v = _state(one, staged)
            push_tips(one, q, v)
    for i in range(len(e.q)):
        for one in lanes(e):
            q, v = _state(one, staged)
            plant, load = one.plant[i], gear_load(one.plant[i], one.motor[i], one.a[i])
            passive = passive_torque(plant, one.torque[i], q[i], v[i], load, q[i] - one.q[i])
            one.torque[i] = one.motor[i] + one.external[i] + passive
    if e.imposed_motion.place >= 0:
        for one in lanes(e):
            q, v = _state(one, staged)
            motion = one.imposed_motion
            motion.torque = imposed_motion_torque(motion, time, q[motion.place], v[motion.place])
            one.torque[motion.place] += motion.torque
    if SHIFT > 0:
        for i in range(SHIFT):
            for one in lanes(e):
                q, v = _state(one, staged)
                brace = one.braces[i]
                brace.torque = brace_torque(brace, q[i], v[i], q[i + SHIFT], v[i + SHIFT])
                one.torque[i] -= brace.torque
                one.torque[i + SHIFT] += brace.torque
    for one in lanes(e):
        q, v = _state(one, staged)
        hold_trunk(one, q, v)
        one.contact_power = dynamics(q, v, one.torque, one.bodies, one.gravity, one.ground, one.a, one.points)
        if SEATED:
            one.contact_power += one.seat.power
        if CRUTCHES > 0:
            move_tips(one, q, v)


def evaluate(e: Episode, tick: int) -> None:
    """Evaluate the motion at the state before integration, which the log has."""
    acceleration(e, tick * e.rates.period, False)


def sum_up_outside(e: Episode, number: int) -> None:
    """Sum the torques from outside on a joint up."""
    place = e.joints[number].place
    imposed = e.imposed_motion.torque if e.imposed_motion.place == place else 0.0
    e.joints[number].pushed = imposed + e.joints[number].push
    e.joints[number].outside = imposed + e.external[place]
    if SHIFT > 0:
        e.joints[number].outside += e.external[place + SHIFT]


def stand(e: Episode, number: int) -> None:
    """Sum the forces of the ground on a foot up, and note where they act."""
    sole, first = e.soles[number], number * POINTS_PER_FOOT
    friction, pressed, lowest = 0.0, 0.0, e.points[first].height
    for place in range(first, first + POINTS_PER_FOOT):
        along, normal = point_force(e, place)
        friction += along
        pressed += normal * (place - first)
        lowest = min(lowest, e.points[place].height)
    sole.normal = normal_force(e, number)
    sole.friction = friction
    sole.clearance = lowest
    loaded = sole.normal > LEAST_FORCE and POINTS_PER_FOOT > 1
    sole.pressure_place = pressed / (sole.normal * (POINTS_PER_FOOT - 1)) if loaded else 0.0


def observe_energies(e: Episode) -> None:
    """Compute the energies, and the load of the guides of the pelvis."""
    kinetic, potential, force, moment = observe(e.q, e.v, e.a, e.bodies, e.gravity, e.points)
    if CRUTCHES > 0:
        of_tips = tip_energy(e)
        kinetic += of_tips[0]
        potential += of_tips[1]
    e.kinetic_energy, e.potential_energy, e.guide_force, e.guide_moment = kinetic, potential, force, moment


def write_log(e: Episode, tick: int) -> None:
    """Write the row of a tick into the log."""
    write_row(e, log_row(e, tick))


def _friction_arguments(one: Episode, place: int, staged: bool) -> tuple[float, ...]:
    """What :func:`~twin_gait.core.friction.geared_friction_torque` is asked for."""
    _, v = _state(one, staged)
    plant = one.plant[place]
    law = plant.friction
    return (
        v[place],
        law.breakaway_torque,
        law.coulomb_friction,
        law.stribeck_velocity,
        law.viscous_friction_forward,
        gear_load(plant, one.motor[place], one.a[place]),
        law.gear_efficiency,
    )


def _keep_friction(one: Episode, place: int, torque: float) -> None:
    """Keep it where the sum of all torques will be."""
    one.torque[place] = torque


def _state(one: Episode, staged: bool) -> tuple[list[float], list[float]]:
    """Coordinates and velocities."""
    if staged:
        return one.stages.q, one.stages.v
    return one.q, one.v


def _euler_step(e: Episode, time: float, known: bool) -> None:
    """One step of the semi-implicit Euler method, of first order.

    ``v ← v + h a(q, v)``, then ``q ← q + h v`` with the new velocity. The torques work on the mean of old and
    new velocity.
    """
    if not known:
        acceleration(e, time, False)
    for i in range(len(e.q)):
        for one in lanes(e):
            velocity = one.v[i]
            one.v[i] = velocity + e.step * one.a[i]
            one.stages.v[i] = 0.5 * (velocity + one.v[i])
            _move(one, i, e.step * one.v[i])
    if e.recording.on:
        for one in lanes(e):
            contact = 0.5 * (one.contact_power + one.last_contact_power)
            one.last_contact_power = one.contact_power
            one.works.contact += e.step * contact
        _add_work(e, e.step)


def _runge_kutta_step(e: Episode, time: float, known: bool) -> None:
    """One step of the classical Runge-Kutta method, of fourth order."""
    step = e.step
    for i in range(len(e.q)):
        for one in lanes(e):
            stages = one.stages
            stages.q[i] = one.q[i]
            stages.v[i] = one.v[i]
            stages.sum_v[i] = 0.0
            stages.sum_a[i] = 0.0
    for stage in range(4):
        outer = stage == 0 or stage == 3
        weight = 1.0 / 6.0 if outer else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        if not (known and stage == 0):
            acceleration(e, time + offset * step, True)
        if e.recording.on:
            for one in lanes(e):
                one.works.contact += (weight * step) * one.contact_power
            _add_work(e, weight * step)
        ahead = step if stage == 2 else 0.5 * step
        for i in range(len(e.q)):
            for one in lanes(e):
                stages, speed = one.stages, one.stages.v[i]
                stages.sum_v[i] += weight * speed
                stages.sum_a[i] += weight * one.a[i]
                if stage < 3:
                    stages.q[i] = one.q[i] + ahead * speed
                    stages.v[i] = one.v[i] + ahead * one.a[i]
    for i in range(len(e.q)):
        for one in lanes(e):
            one.v[i] += step * one.stages.sum_a[i]
            _move(one, i, step * one.stages.sum_v[i])


def _move(e: Episode, place: int, displacement: float) -> None:
    """End a step of a coordinate, its new velocity known; the bristles of its friction go along."""
    e.q[place] += displacement
    if OTHER_LAWS:
        plant = e.plant[place]
        plant.deflection = advanced_deflection(plant.friction, displacement, e.v[place], plant.deflection)


def _add_work(e: Episode, duration: float) -> None:
    """Add the work that every source does on the leg in a short time, at the velocities of the stage."""
    for i in range(len(e.q)):
        for one in lanes(e):
            works, plant, v = one.works, one.plant[i], one.stages.v[i]
            works.motor += duration * one.motor[i] * v
            works.friction += duration * plant.friction_torque * v
            works.stop += duration * plant.stop_torque * v
            works.spring += duration * plant.spring_torque * v
            works.patient += duration * one.external[i] * v
    if SHIFT > 0:
        for i in range(SHIFT):
            for one in lanes(e):
                stages = one.stages
                one.works.brace += duration * one.braces[i].torque * (stages.v[i + SHIFT] - stages.v[i])
    if e.imposed_motion.place >= 0:
        for one in lanes(e):
            motion = one.imposed_motion
            one.works.patient += duration * motion.torque * one.stages.v[motion.place]
