"""Steps of the environment: belt, requests, harness, pushes, seat, crutches, and torques of the wearer."""

import math

from twin_gait.control.gait_controller import WITH_SUPERVISOR, receive_walk_command
from twin_gait.control.supervisor import NO_REQUEST
from twin_gait.core.arms import (
    Arm,
    anchor_position,
    anchored_friction_force,
    arm_force,
    crutch_acceleration,
)
from twin_gait.core.belt import treadmill_speed, walk_command
from twin_gait.core.contact import contact_normal_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.plant import (
    MechanicalStop,
    harness_pull,
    pitching_moment,
    seat_force_on_buttocks,
    seat_force_on_thigh,
    strap_moment,
)
from twin_gait.core.wearer_torques import (
    find_grid_interval,
    passive_hip_torque,
    passive_knee_torque,
    spastic_torque,
)
from twin_gait.simulation.backend import noise_row
from twin_gait.simulation.build_flags import (
    FORWARD_INDEX,
    N_CRUTCHES,
    PELVIS_INDEX,
    PITCH_INDEX,
    WEARER_OFFSET,
    WITH_ANKLES,
    WITH_SEAT,
)
from twin_gait.simulation.episode import HIP_ANGLE_STEP, MIN_HIP_ANGLE, Episode
from twin_gait.worlds.arm_policy import REACHING_BACK, announce_step, move_arm

LIMBS_PER_LEG = 2  # Thigh and shank, which move hip and knee, controlled or not.


def update_commands(e: Episode, tick: int) -> None:
    """Set the belt speed by its profile, or to rest after a trip, and the requests of the tick."""
    time = tick * e.rates.period
    trip_time = e.controller.trip.tick * e.rates.period if e.controller.trip.tick >= 0 else math.inf
    e.ground.belt_speed = treadmill_speed(e.belt, time, trip_time)
    if e.belt.ramp > 0.0:
        receive_walk_command(e.controller, walk_command(time, e.belt.start, e.belt.stop), tick)
    if WITH_SUPERVISOR:
        supervisor = e.controller.supervisor
        supervisor.request = NO_REQUEST
        for number in range(len(e.requests)):
            if e.requests[number].tick == tick:
                supervisor.request = e.requests[number].request


def lock_harness(e: Episode, tick: int) -> None:
    """Lock the harness in the tick of a trip, as a stop from below at the height of the wearer's pelvis."""
    if PITCH_INDEX >= 0:
        if e.controller.trip.tick == tick:
            harness = e.trunk.harness
            _, cosine = sine_cosine(e.q[PITCH_INDEX + WEARER_OFFSET])
            _lock(e, harness.stop, e.q[PELVIS_INDEX + WEARER_OFFSET] + harness.height * cosine)
    elif PELVIS_INDEX >= 0:
        if e.controller.trip.tick == tick:
            _lock(e, e.plant[PELVIS_INDEX + WEARER_OFFSET].stop, e.q[PELVIS_INDEX + WEARER_OFFSET])


def _lock(e: Episode, stop: MechanicalStop, height: float) -> None:
    stop.lower = height
    stop.upper = math.inf
    stop.stiffness = e.lock_stiffness
    stop.dissipation = e.lock_dissipation


def reset_external_torque(e: Episode, number: int) -> None:
    """Reset the sum of the external torques on a hip or knee of the wearer."""
    e.external[e.limbs[number].index + WEARER_OFFSET] = 0.0


def push(e: Episode, number: int) -> None:
    """Set the external torque on a joint to the torque of a push."""
    e.external[e.joints[number].index] = e.joints[number].push


def add_wearer_torques(e: Episode, number: int, tick: int) -> None:
    """Add the wearer's torques on hip and knee of a leg to the external torques."""
    first = number * LIMBS_PER_LEG
    thigh, shank = e.limbs[first], e.limbs[first + 1]
    hip, knee, ankle = e.q[thigh.index + WEARER_OFFSET], e.q[shank.index + WEARER_OFFSET], 0.0
    if WITH_ANKLES:
        ankle = e.q[e.ankles[number] + WEARER_OFFSET]
    bent_hip = hip - thigh.condition.contracture
    bent_knee = knee - shank.condition.contracture
    _add_wearer_torque(e, tick, first, passive_hip_torque(bent_hip, bent_knee), hip)
    _add_wearer_torque(e, tick, first + 1, passive_knee_torque(bent_hip, bent_knee, ankle), hip)


def _add_wearer_torque(e: Episode, tick: int, number: int, passive: float, hip: float) -> None:
    """Add the wearer's passive torque and the delayed voluntary effort on a hip or knee, in [N·m]."""
    limb = e.limbs[number]
    phase = e.controller.legs[limb.leg].phase
    condition, index = limb.condition, limb.index + WEARER_OFFSET
    moments = limb.moments[phase]
    below, share = find_grid_interval(hip, MIN_HIP_ANGLE, HIP_ANGLE_STEP, len(moments))
    moment = moments[below] + share * (moments[below + 1] - moments[below])
    effort = delayed_sample(limb.effort_line, tick, condition.effort * condition.strength * moment)
    effort *= 1.0 + noise_row(e, tick)[len(e.joints) + number]
    reflex = spastic_torque(e.v[index], condition.stretch_reflex_threshold, condition.stretch_reflex_gain)
    e.passive_moment[index] = condition.passive * passive + reflex
    e.voluntary[index] = effort
    e.external[index] += e.passive_moment[index] + effort


def add_trunk_forces(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the forces of harness and seat, and the reactions of the crutches, to the torques."""
    if PITCH_INDEX >= 0:
        add_harness_force(e, q, v)
    if WITH_SEAT:
        add_seat_forces(e, q, v)
    if N_CRUTCHES > 0:
        add_crutch_reactions(e, q, v)


def add_harness_force(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the force and the moment of the harness to the torques of the wearer's pelvis."""
    pelvis, pitch = PELVIS_INDEX + WEARER_OFFSET, PITCH_INDEX + WEARER_OFFSET
    sine, cosine = sine_cosine(q[pitch])
    harness = e.trunk.harness
    ahead, up = harness.height * sine, harness.height * cosine
    pull = harness_pull(harness, q[pelvis] + up, v[pelvis] - ahead * v[pitch])
    moment = pitching_moment(ahead, up, 0.0, pull) + strap_moment(harness, sine, cosine, v[pitch])
    e.plant[pelvis].spring_torque += pull
    e.plant[pitch].spring_torque += moment
    e.torque[pelvis] += pull
    e.torque[pitch] += moment


def add_seat_forces(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the forces of the seat on buttocks and thighs to the torques."""
    seat = e.seat
    forward, upward, moment = seat_force_on_buttocks(
        seat, q[FORWARD_INDEX], q[PELVIS_INDEX], v[FORWARD_INDEX], v[PELVIS_INDEX], v[PITCH_INDEX]
    )
    for hip in seat.hips:
        sine, cosine = sine_cosine(q[hip] - q[PITCH_INDEX])
        fx, fz, lift = seat_force_on_thigh(
            seat,
            sine,
            cosine,
            q[FORWARD_INDEX],
            q[PELVIS_INDEX],
            v[FORWARD_INDEX],
            v[PELVIS_INDEX],
            v[hip] - v[PITCH_INDEX],
        )
        e.torque[hip] += lift
        forward += fx
        upward += fz
        moment -= lift
    e.torque[FORWARD_INDEX] += forward
    e.torque[PELVIS_INDEX] += upward
    e.torque[PITCH_INDEX] += moment


def place_chair(e: Episode, tick: int) -> None:
    """Set the position of the chair behind a standing wearer when the device announces sitting down."""
    leg, seat = e.controller.legs[0], e.seat
    announced = e.chair_phases[leg.phase] == REACHING_BACK and leg.entry_tick == tick
    if announced and e.q[PELVIS_INDEX] > seat.height + 2.0 * seat.buttocks.thickness:
        seat.front_edge = e.q[FORWARD_INDEX] - seat.standing_distance


def add_arm_forces(e: Episode, q: list[float], v: list[float]) -> None:
    """Set the forces of the arms as external torques on trunk and tips."""
    sine, cosine = sine_cosine(q[PITCH_INDEX])
    shoulder_ahead, shoulder_up = e.trunk.shoulder * sine, e.trunk.shoulder * cosine
    on_forward, on_pelvis, on_pitch = 0.0, 0.0, 0.0
    for number in range(N_CRUTCHES):
        arm = e.arms[number]
        ahead, up = q[arm.index] - q[FORWARD_INDEX], q[arm.index + 1] - q[PELVIS_INDEX]
        # Velocity of the tip relative to the trunk, which rotates about the hips.
        forward = v[arm.index] - v[FORWARD_INDEX] - up * v[PITCH_INDEX]
        upward = v[arm.index + 1] - v[PELVIS_INDEX] + ahead * v[PITCH_INDEX]
        fx, fz = arm_force(arm, sine, cosine, ahead - shoulder_ahead, up - shoulder_up, forward, upward)
        on_forward -= fx
        on_pelvis -= fz
        on_pitch -= pitching_moment(ahead, up, fx, fz)
        e.external[arm.index] = fx
        e.external[arm.index + 1] = fz
    e.external[FORWARD_INDEX] = on_forward
    e.external[PELVIS_INDEX] = on_pelvis
    e.external[PITCH_INDEX] = on_pitch


def add_crutch_reactions(e: Episode, q: list[float], v: list[float]) -> None:
    """Compute the forces of the ground on the tips, and add the reactions of the crutches on the shoulders.

    The reaction depends on the acceleration of the shoulder, for which that of the previous evaluation is
    used. It acts on it like an added mass of less than 0.3 kg, so the error is far below that of the step.
    """
    for number in range(N_CRUTCHES):
        arm, ground = e.arms[number], e.ground
        index, tip = arm.index, arm.tip
        tip.height = q[index + 1]
        tip.upward = contact_normal_force(-tip.height, -v[index + 1], ground.stiffness, ground.dissipation)
        tip.forward = anchored_friction_force(
            arm, q[index], v[index], tip.upward, ground.friction_coefficient
        )
        ahead, up = _shoulder_position(e, arm, q)
        _, _, reaction = _crutch_acceleration(e, arm, ahead, up, v)
        forward, upward = -arm.direction_z * reaction, arm.direction_x * reaction
        e.torque[FORWARD_INDEX] += forward
        e.torque[PELVIS_INDEX] += upward
        e.torque[PITCH_INDEX] += pitching_moment(ahead, up, forward, upward)


def _shoulder_position(e: Episode, arm: Arm, q: list[float]) -> tuple[float, float]:
    """Return the position of the shoulder in front of and above the hips in [m]."""
    ahead, up = q[arm.index] - q[FORWARD_INDEX], q[arm.index + 1] - q[PELVIS_INDEX]
    return ahead - arm.length * arm.direction_x, up - arm.length * arm.direction_z


def _crutch_acceleration(
    e: Episode, arm: Arm, ahead: float, up: float, v: list[float]
) -> tuple[float, float, float]:
    """Return :func:`~twin_gait.core.arms.crutch_acceleration` for the last accelerations of the trunk."""
    pitching, squared = e.a[PITCH_INDEX], v[PITCH_INDEX] * v[PITCH_INDEX]
    shoulder_x = e.a[FORWARD_INDEX] + up * pitching - ahead * squared
    shoulder_z = e.a[PELVIS_INDEX] - ahead * pitching - up * squared
    force_x, force_z = e.torque[arm.index] + arm.tip.forward, e.torque[arm.index + 1] + arm.tip.upward
    turning = arm.aside_speed / arm.length - v[PITCH_INDEX]
    forward, upward, reaction = crutch_acceleration(
        arm, turning, force_x, force_z, e.gravity, shoulder_x, shoulder_z
    )
    return forward, upward, reaction


def accelerate_tips(e: Episode, q: list[float], v: list[float]) -> None:
    """Compute the accelerations of the tips of the crutches and the power of their contact forces."""
    for number in range(N_CRUTCHES):
        arm = e.arms[number]
        index, tip = arm.index, arm.tip
        ahead, up = _shoulder_position(e, arm, q)
        forward, upward, _ = _crutch_acceleration(e, arm, ahead, up, v)
        e.a[index] = forward
        e.a[index + 1] = upward
        e.contact_power += tip.forward * v[index] + tip.upward * v[index + 1]


def update_tip_anchors(e: Episode) -> None:
    """Move the anchor of the friction of each sliding tip at the end of an integration step."""
    for number in range(N_CRUTCHES):
        arm = e.arms[number]
        arm.anchor = anchor_position(arm, e.q[arm.index], arm.tip.upward, e.ground.friction_coefficient)


def update_arms(e: Episode, tick: int) -> None:
    """Compute the delayed perception of the wearer, and move the arms with it."""
    sense = e.perception
    left, right = e.limbs[0].index + WEARER_OFFSET, e.limbs[LIMBS_PER_LEG].index + WEARER_OFFSET
    stepping, chair, turn = 0.0, 0.0, 1.0 if e.q[left] > e.q[right] else 2.0
    for number in range(len(e.controller.legs)):
        leg = e.controller.legs[number]
        stepping = max(stepping, e.swing_phases[leg.phase])
        chair = max(chair, e.chair_phases[leg.phase])
        if e.swing_phases[leg.phase] > 0.0:
            turn = float(N_CRUTCHES - e.soles[number])
    if e.controller.device_signals.walk == 0.0:
        turn = 0.0
    sense.lean = delayed_sample(sense.lean_delay, tick, e.q[PITCH_INDEX])
    sense.lean_rate = delayed_sample(sense.lean_rate_delay, tick, e.v[PITCH_INDEX])
    sense.stepping = delayed_sample(sense.stepping_delay, tick, stepping)
    sense.ticks_since_swing = 0 if sense.stepping > 0.0 else sense.ticks_since_swing + 1
    sense.chair_state = delayed_sample(sense.chair_delay, tick, chair)
    sense.turn = delayed_sample(sense.turn_delay, tick, turn)
    sine, _ = sine_cosine(e.q[PITCH_INDEX])
    shoulder = e.q[FORWARD_INDEX] + e.trunk.shoulder * sine
    for number in range(N_CRUTCHES):
        arm = e.arms[number]
        ahead = delayed_sample(arm.distance_delay, tick, e.q[arm.index] - shoulder)
        load = delayed_sample(arm.load_delay, tick, arm.tip.upward)
        move_arm(e.policy, sense, arm, e.arms[N_CRUTCHES - 1 - number], ahead, load)
    announce_step(e.policy, sense, e.arms[0], e.arms[1])
    if not WITH_SUPERVISOR:
        e.controller.device_signals.step = 1.0
        withhold_step(e, tick)


def withhold_step(e: Episode, tick: int) -> None:
    """Let the device wait, as after a command to stand, while a wearer with crutches announces no step."""
    if N_CRUTCHES > 0:
        if e.perception.announcement == 0.0:
            e.controller.device_signals.step = 0.0
            if e.perception.stepping == 0.0:
                e.controller.last_stand_tick = tick


def tip_energy(e: Episode) -> tuple[float, float]:
    """Return the kinetic and potential energy of the crutches in [J]."""
    kinetic, potential = 0.0, 0.0
    for number in range(N_CRUTCHES):
        arm: Arm = e.arms[number]
        turning = arm.aside_speed / arm.length - e.v[PITCH_INDEX]
        away = arm.centre_of_mass * turning
        forward = e.v[arm.index] + away * arm.direction_z
        upward = e.v[arm.index + 1] - away * arm.direction_x
        kinetic += 0.5 * arm.mass * (forward * forward + upward * upward)
        kinetic += 0.5 * arm.inertia * turning * turning
        potential += arm.mass * e.gravity * (e.q[arm.index + 1] - arm.centre_of_mass * arm.direction_z)
    return kinetic, potential
