"""Motion within a tick: forces on the bodies, the row of the log, work, and the integration."""

from twin_gait.core.contact import MIN_NORMAL_FORCE
from twin_gait.core.friction import (
    WITH_OTHER_FRICTION_LAWS,
    advance_deflection,
    rotational_friction_and_share,
)
from twin_gait.core.plant import (
    brace_torque,
    imposed_motion_torque,
    is_sign_wrong,
    passed_torque,
    plant_torque,
    share_loss,
)
from twin_gait.simulation.backend import (
    dynamics,
    log_row,
    observe,
    scalar_lanes,
    vector_lanes,
    vector_map,
    write_row,
)
from twin_gait.simulation.build_flags import (
    FRICTION_INDICES,
    GEAR_INDICES,
    N_CRUTCHES,
    N_POINTS_PER_FOOT,
    PITCH_INDEX,
    WEARER_OFFSET,
    WITH_OWN_GAIT,
    WITH_RK4,
    WITH_SEAT,
)
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.stages.environment import (
    accelerate_tips,
    add_arm_forces,
    add_trunk_forces,
    tip_energy,
    update_tip_anchors,
)
from twin_gait.simulation.stages.own_gait import add_muscle_torques
from twin_gait.simulation.stages.sensors import normal_force, point_force

# Largest number of solutions for the accelerations of one state, in the search for the signs of gear loads.
MOST_SOLUTIONS = 8


def integrate(e: Episode, tick: int) -> None:
    """Integrate all steps of a tick; the first one uses the accelerations of the log, if a row is written."""
    for substep in range(e.substeps):
        time = tick * e.rates.period + substep * e.step
        evaluated = e.recording.on and substep == 0
        if WITH_RK4:
            _runge_kutta_step(e, time, evaluated)
        else:
            _euler_step(e, time, evaluated)
        if N_CRUTCHES > 0:
            for one in vector_lanes(e):
                update_tip_anchors(one)


def compute_accelerations(e: Episode, time: float, staged: bool) -> None:
    """Compute the accelerations of a state under all forces and torques.

    They are the solution of (M + (1 − λ) J) a + h = (1 − λ) τ_m + τ, with the inertia matrix M of the bodies,
    the inertia J of the rotors, the motor torque τ_m, the share λ of its load that a gear loses, gravity and
    velocity terms h, and all other torques τ: friction, stops, springs, wearer, braces and contacts.

    Args:
        e: Episode; its accelerations are changed in place.
        time: Time in [s].
        staged: Whether the state is that of a stage of the integration instead of the present one.
    """
    if FRICTION_INDICES:
        law = rotational_friction_and_share
        vector_map(e, FRICTION_INDICES, staged, _friction_arguments, law, _store_friction)
    if N_CRUTCHES > 0:
        for one in vector_lanes(e):
            q, v = _state(one, staged)
            add_arm_forces(one, q, v)
    for i in range(len(e.q)):
        for one in vector_lanes(e):
            q, v = _state(one, staged)
            plant = one.plant[i]
            passive = plant_torque(plant, one.torque[i], q[i], v[i], q[i] - one.q[i])
            left = 1.0 - plant.loss_share
            one.rotors[i] = left * plant.armature
            one.torque[i] = left * one.motor[i] + one.external[i] + passive
    if e.imposed_motion.index >= 0:
        for one in vector_lanes(e):
            q, v = _state(one, staged)
            motion = one.imposed_motion
            motion.torque = imposed_motion_torque(motion, time, q[motion.index], v[motion.index])
            one.torque[motion.index] += motion.torque
    if WEARER_OFFSET > 0:
        for i in range(WEARER_OFFSET):
            for one in vector_lanes(e):
                q, v = _state(one, staged)
                brace, apart, speed = one.braces[i], q[i] - q[i + WEARER_OFFSET], v[i] - v[i + WEARER_OFFSET]
                if PITCH_INDEX >= 0:
                    apart -= brace.pitch_share * (q[PITCH_INDEX] - q[PITCH_INDEX + WEARER_OFFSET])
                    speed -= brace.pitch_share * (v[PITCH_INDEX] - v[PITCH_INDEX + WEARER_OFFSET])
                brace.torque = brace_torque(brace, apart, speed)
                one.torque[i] -= brace.torque
                one.torque[i + WEARER_OFFSET] += brace.torque
                if PITCH_INDEX >= 0:
                    one.torque[PITCH_INDEX] += brace.pitch_share * brace.torque
                    one.torque[PITCH_INDEX + WEARER_OFFSET] -= brace.pitch_share * brace.torque
    for one in vector_lanes(e):
        q, v = _state(one, staged)
        add_trunk_forces(one, q, v)
        if WITH_OWN_GAIT:
            add_muscle_torques(one, q, v)
    _solve(e, staged)
    for one in vector_lanes(e):
        q, v = _state(one, staged)
        if WITH_SEAT:
            one.contact_power += one.seat.power
        if N_CRUTCHES > 0:
            accelerate_tips(one, q, v)
    if GEAR_INDICES and e.recording.on:
        for i in GEAR_INDICES:
            for one in vector_lanes(e):
                plant = one.plant[i]
                plant.friction_torque -= plant.loss_share * passed_torque(plant, one.motor[i], one.a[i])


def _solve(e: Episode, staged: bool) -> None:
    """Solve for the accelerations until they agree with the assumed sign of the load of every gear.

    The signs of the previous evaluation are assumed first. While one of them is wrong, the first wrong sign
    is changed (least-index method of Murty 1974, which ends because the inertia matrix is positive definite).
    """
    for solution in range(MOST_SOLUTIONS):
        for one in vector_lanes(e):
            q, v = _state(one, staged)
            one.contact_power = dynamics(
                q, v, one.torque, one.rotors, one.bodies, one.gravity, one.ground, one.a, one.points
            )
        wrong = False
        if GEAR_INDICES:
            for i in GEAR_INDICES:
                for one in vector_lanes(e):
                    wrong |= is_sign_wrong(one.plant[i], one.motor[i], one.a[i])
        if not wrong or solution == MOST_SOLUTIONS - 1:
            break
        for one in scalar_lanes(e):
            _change_sign(one, staged)


def _change_sign(one: Episode, staged: bool) -> None:
    """Change the first wrong sign of the load of a gear, and the terms that depend on it."""
    _, v = _state(one, staged)
    if GEAR_INDICES:
        for i in GEAR_INDICES:
            plant = one.plant[i]
            if is_sign_wrong(plant, one.motor[i], one.a[i]):
                before = plant.loss_share
                plant.load_sign = -plant.load_sign
                share_loss(plant, v[i])
                one.rotors[i] = (1.0 - plant.loss_share) * plant.armature
                one.torque[i] += (before - plant.loss_share) * one.motor[i]
                break


def evaluate(e: Episode, tick: int) -> None:
    """Compute the accelerations and forces of the state before the integration, for the log."""
    compute_accelerations(e, tick * e.rates.period, False)


def sum_external_torque(e: Episode, number: int) -> None:
    """Sum up the disturbance torque and the external torque on a joint in [N·m]."""
    index = e.joints[number].index
    imposed = e.imposed_motion.torque if e.imposed_motion.index == index else 0.0
    e.joints[number].disturbance_torque = imposed + e.joints[number].push
    e.joints[number].external_torque = imposed + e.external[index]
    if WEARER_OFFSET > 0:
        e.joints[number].external_torque += e.external[index + WEARER_OFFSET]


def sum_ground_forces(e: Episode, number: int) -> None:
    """Sum up the forces of the ground on a foot, and compute its clearance and centre of pressure.

    The centre of pressure is Σ i F_i / ((n − 1) Σ F_i) over the normal forces F_i of the n points of the sole
    from heel to toe, i = 0 … n − 1.
    """
    foot, first = e.feet[number], number * N_POINTS_PER_FOOT
    friction, pressed, lowest = 0.0, 0.0, e.points[first].height
    for point in range(first, first + N_POINTS_PER_FOOT):
        along, normal = point_force(e, point)
        friction += along
        pressed += normal * (point - first)
        lowest = min(lowest, e.points[point].height)
    foot.normal = normal_force(e, number)
    foot.friction = friction
    foot.clearance = lowest
    loaded = foot.normal > MIN_NORMAL_FORCE and N_POINTS_PER_FOOT > 1
    foot.cop_ratio = pressed / (foot.normal * (N_POINTS_PER_FOOT - 1)) if loaded else 0.0


def observe_energies(e: Episode) -> None:
    """Compute the energies in [J], and force in [N] and pitch moment in [N·m] of the guides of the pelvis."""
    kinetic, potential, force, moment = observe(e.q, e.v, e.a, e.bodies, e.gravity, e.points)
    if N_CRUTCHES > 0:
        tips = tip_energy(e)
        kinetic += tips[0]
        potential += tips[1]
    e.kinetic_energy, e.potential_energy, e.guide_force, e.guide_moment = kinetic, potential, force, moment


def write_log(e: Episode, tick: int) -> None:
    """Write the row of a tick into the log."""
    write_row(e, log_row(e, tick))


def _friction_arguments(one: Episode, index: int, staged: bool) -> tuple[float, ...]:
    """Return the arguments of :func:`~twin_gait.core.friction.rotational_friction_and_share`."""
    _, v = _state(one, staged)
    law = one.plant[index].friction
    return (
        v[index],
        law.breakaway_torque,
        law.coulomb_friction,
        law.stribeck_velocity,
        law.viscous_friction_forward,
        one.plant[index].load_sign,
        law.gear_efficiency,
    )


def _store_friction(one: Episode, index: int, found: tuple[float, float]) -> None:
    """Store the friction torque in ``torque``, to which the other torques are added, and the loss share."""
    one.torque[index] = found[0]
    one.plant[index].loss_share = found[1]


def _state(one: Episode, staged: bool) -> tuple[list[float], list[float]]:
    """Return the coordinates and velocities of the present state or of a stage of the integration."""
    if staged:
        return one.integrator.q, one.integrator.v
    return one.q, one.v


def _euler_step(e: Episode, time: float, evaluated: bool) -> None:
    """Integrate one step by the semi-implicit Euler method, which is of first order.

    ``v ← v + h a(q, v)``, then ``q ← q + h v`` with the new velocity. Work is computed with the mean of the
    old and the new velocity. ``evaluated``: whether the accelerations have already been computed.
    """
    if not evaluated:
        compute_accelerations(e, time, False)
    for i in range(len(e.q)):
        for one in vector_lanes(e):
            velocity = one.v[i]
            one.v[i] = velocity + e.step * one.a[i]
            one.integrator.v[i] = 0.5 * (velocity + one.v[i])
            _move(one, i, e.step * one.v[i])
    if e.recording.on:
        for one in vector_lanes(e):
            contact = 0.5 * (one.contact_power + one.last_contact_power)
            one.last_contact_power = one.contact_power
            one.work.contact += e.step * contact
        _add_work(e, e.step)


def _runge_kutta_step(e: Episode, time: float, evaluated: bool) -> None:
    """Integrate one step by the classical Runge-Kutta method, which is of fourth order.

    ``evaluated``: whether the accelerations of the first stage have already been computed.
    """
    step = e.step
    for i in range(len(e.q)):
        for one in vector_lanes(e):
            stages = one.integrator
            stages.q[i] = one.q[i]
            stages.v[i] = one.v[i]
            stages.sum_v[i] = 0.0
            stages.sum_a[i] = 0.0
    for stage in range(4):
        outer = stage == 0 or stage == 3
        weight = 1.0 / 6.0 if outer else 1.0 / 3.0
        offset = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        if not (evaluated and stage == 0):
            compute_accelerations(e, time + offset * step, True)
        if e.recording.on:
            for one in vector_lanes(e):
                one.work.contact += (weight * step) * one.contact_power
            _add_work(e, weight * step)
        ahead = step if stage == 2 else 0.5 * step
        for i in range(len(e.q)):
            for one in vector_lanes(e):
                stages, speed = one.integrator, one.integrator.v[i]
                stages.sum_v[i] += weight * speed
                stages.sum_a[i] += weight * one.a[i]
                if stage < 3:
                    stages.q[i] = one.q[i] + ahead * speed
                    stages.v[i] = one.v[i] + ahead * one.a[i]
    for i in range(len(e.q)):
        for one in vector_lanes(e):
            one.v[i] += step * one.integrator.sum_a[i]
            _move(one, i, step * one.integrator.sum_v[i])


def _move(e: Episode, index: int, displacement: float) -> None:
    """Move a coordinate and the bristles of its friction at the end of a step, with its new velocity."""
    e.q[index] += displacement
    if WITH_OTHER_FRICTION_LAWS:
        plant = e.plant[index]
        plant.deflection = advance_deflection(plant.friction, displacement, e.v[index], plant.deflection)


def _add_work(e: Episode, duration: float) -> None:
    """Add the work of every source: torque times velocity of the stage times ``duration`` in [s]."""
    for i in range(len(e.q)):
        for one in vector_lanes(e):
            works, plant, v = one.work, one.plant[i], one.integrator.v[i]
            works.motor += duration * one.motor[i] * v
            works.friction += duration * plant.friction_torque * v
            works.stop += duration * plant.stop_torque * v
            works.spring += duration * plant.spring_torque * v
            works.external += duration * one.external[i] * v
            if WITH_OWN_GAIT:
                works.own_gait += duration * one.own_gait.torque[i] * v
    if WEARER_OFFSET > 0:
        for i in range(WEARER_OFFSET):
            for one in vector_lanes(e):
                brace, speeds = one.braces[i], one.integrator.v
                speed = speeds[i + WEARER_OFFSET] - speeds[i]
                if PITCH_INDEX >= 0:
                    speed -= brace.pitch_share * (speeds[PITCH_INDEX + WEARER_OFFSET] - speeds[PITCH_INDEX])
                one.work.brace += duration * brace.torque * speed
    if e.imposed_motion.index >= 0:
        for one in vector_lanes(e):
            motion = one.imposed_motion
            one.work.external += duration * motion.torque * one.integrator.v[motion.index]
