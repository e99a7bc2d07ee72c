"""Steps of the environment: belt, requests, harness, pushes, seat, crutches, and torques of the wearer."""

import math

from twin_gait.control.gait_controller import SUPERVISED, hear_command
from twin_gait.control.supervisor import NO_REQUEST
from twin_gait.core.arms import Arm, anchored_friction_force, arm_force, dragged_anchor
from twin_gait.core.belt import treadmill_speed, walk_command
from twin_gait.core.contact import contact_normal_force
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.plant import Stop, harness_pull, pitching_moment, seat_the_hips, seat_the_thigh
from twin_gait.core.wearer import passive_hip_torque, passive_knee_torque, posture_place, spastic_torque
from twin_gait.simulation.episode import LOWEST_POSTURE, POSTURE_STEP, Episode
from twin_gait.simulation.interface import noise_row
from twin_gait.simulation.structure import ANKLES, CRUTCHES, FORWARD, PELVIS, PITCH, SEATED, SHIFT
from twin_gait.worlds.arm_policy import REACHES, move_arm

LIMBS_PER_LEG = 2  # Thigh and shank, which move hip and knee, controlled or not.


def command(e: Episode, tick: int) -> None:
    """Set the belt speed by its profile, or to rest after a trip, and the requests of the tick."""
    time = tick * e.rates.period
    trip_time = e.controller.trip.tick * e.rates.period if e.controller.trip.tick >= 0 else math.inf
    e.ground.belt_speed = treadmill_speed(e.belt, time, trip_time)
    if e.belt.ramp > 0.0:
        hear_command(e.controller, walk_command(time, e.belt.start, e.belt.stop), tick)
    if SUPERVISED:
        supervisor = e.controller.supervisor
        supervisor.request = NO_REQUEST
        for number in range(len(e.requests)):
            if e.requests[number].tick == tick:
                supervisor.request = e.requests[number].request


def catch(e: Episode, tick: int) -> None:
    """Lock the harness in the tick of a trip, as a stop from below at the height of the wearer's pelvis."""
    if PITCH >= 0:
        if e.controller.trip.tick == tick:
            harness = e.trunk.harness
            _, cosine = sine_cosine(e.q[PITCH])
            _lock(e, harness.stop, e.q[PELVIS] + harness.height * cosine)
    elif PELVIS >= 0:
        if e.controller.trip.tick == tick:
            _lock(e, e.plant[PELVIS + SHIFT].stop, e.q[PELVIS + SHIFT])


def _lock(e: Episode, stop: Stop, height: float) -> None:
    stop.lower = height
    stop.upper = math.inf
    stop.stiffness = e.catch_stiffness
    stop.dissipation = e.catch_dissipation


def free_limb(e: Episode, number: int) -> None:
    """Reset the sum of the external torques on a hip or knee of the wearer."""
    e.external[e.limbs[number].place + SHIFT] = 0.0


def push(e: Episode, number: int) -> None:
    """Set the external torque on a joint to the torque of a push."""
    e.external[e.joints[number].place] = e.joints[number].push


def push_leg(e: Episode, number: int, tick: int) -> None:
    """Add the wearer's torques on hip and knee of a leg to the external torques."""
    first = number * LIMBS_PER_LEG
    thigh, shank = e.limbs[first], e.limbs[first + 1]
    hip, knee, ankle = e.q[thigh.place + SHIFT], e.q[shank.place + SHIFT], 0.0
    if ANKLES:
        ankle = e.q[e.ankles[number] + SHIFT]
    bent_hip = hip - thigh.condition.contracture
    bent_knee = knee - shank.condition.contracture
    _wear(e, tick, first, passive_hip_torque(bent_hip, bent_knee), hip)
    _wear(e, tick, first + 1, passive_knee_torque(bent_hip, bent_knee, ankle), hip)


def _wear(e: Episode, tick: int, number: int, passive: float, hip: float) -> None:
    """Add the wearer's passive torque and the delayed voluntary effort on a hip or knee, in [N·m]."""
    limb, phase = e.limbs[number], e.controller.legs[number // LIMBS_PER_LEG].phase
    condition, place = limb.condition, limb.place + SHIFT
    moments = limb.moments[phase]
    below, share = posture_place(hip, LOWEST_POSTURE, POSTURE_STEP, len(moments))
    moment = moments[below] + share * (moments[below + 1] - moments[below])
    effort = delayed_sample(limb.effort_line, tick, condition.effort * condition.strength * moment)
    effort *= 1.0 + noise_row(e, tick)[len(e.joints) + number]
    reflex = spastic_torque(e.v[place], condition.stretch_reflex_threshold, condition.stretch_reflex_gain)
    e.passive_moment[place] = condition.passive * passive + reflex
    e.voluntary[place] = effort
    e.external[place] += e.passive_moment[place] + effort


def hold_trunk(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the forces of harness and seat to the torques."""
    if PITCH >= 0:
        pull_harness(e, q, v)
    if SEATED:
        press_seat(e, q, v)


def pull_harness(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the force and the moment of the harness to the torques of the pelvis."""
    sine, cosine = sine_cosine(q[PITCH])
    harness = e.trunk.harness
    ahead, up = harness.height * sine, harness.height * cosine
    pull = harness_pull(harness, q[PELVIS] + up, v[PELVIS] - ahead * v[PITCH])
    moment = pitching_moment(ahead, up, 0.0, pull)
    e.plant[PELVIS].spring_torque += pull
    e.plant[PITCH].spring_torque += moment
    e.torque[PELVIS] += pull
    e.torque[PITCH] += moment


def press_seat(e: Episode, q: list[float], v: list[float]) -> None:
    """Add the forces of the seat on buttocks and thighs to the torques."""
    seat = e.seat
    forward, upward, moment = seat_the_hips(seat, q[FORWARD], q[PELVIS], v[FORWARD], v[PELVIS], v[PITCH])
    for hip in seat.hips:
        sine, cosine = sine_cosine(q[hip] - q[PITCH])
        fx, fz, lift = seat_the_thigh(
            seat, sine, cosine, q[FORWARD], q[PELVIS], v[FORWARD], v[PELVIS], v[hip] - v[PITCH]
        )
        e.torque[hip] += lift
        forward += fx
        upward += fz
        moment -= lift
    e.torque[FORWARD] += forward
    e.torque[PELVIS] += upward
    e.torque[PITCH] += moment


def place_chair(e: Episode, tick: int) -> None:
    """Set the position of the chair behind a standing wearer when the device announces sitting down."""
    leg, seat = e.controller.legs[0], e.seat
    announced = e.chair_phases[leg.phase] == REACHES and leg.entry_tick == tick
    if announced and e.q[PELVIS] > seat.height + 2.0 * seat.buttocks.thickness:
        seat.forward = e.q[FORWARD] - seat.behind


def push_tips(e: Episode, q: list[float], v: list[float]) -> None:
    """Set the forces of the arms as external torques on trunk and tips."""
    sine, cosine = sine_cosine(q[PITCH])
    shoulder_ahead, shoulder_up = e.trunk.shoulder * sine, e.trunk.shoulder * cosine
    on_forward, on_pelvis, on_pitch = 0.0, 0.0, 0.0
    for number in range(CRUTCHES):
        arm = e.arms[number]
        ahead, up = q[arm.place] - q[FORWARD], q[arm.place + 1] - q[PELVIS]
        # Velocity of the tip relative to the trunk, which rotates about the hips.
        forward = v[arm.place] - v[FORWARD] - up * v[PITCH]
        upward = v[arm.place + 1] - v[PELVIS] + ahead * v[PITCH]
        fx, fz = arm_force(arm, sine, cosine, ahead - shoulder_ahead, up - shoulder_up, forward, upward)
        on_forward -= fx
        on_pelvis -= fz
        on_pitch -= pitching_moment(ahead, up, fx, fz)
        e.external[arm.place] = fx
        e.external[arm.place + 1] = fz
    e.external[FORWARD] = on_forward
    e.external[PELVIS] = on_pelvis
    e.external[PITCH] = on_pitch


def move_tips(e: Episode, q: list[float], v: list[float]) -> None:
    """Compute the accelerations of the tips of the crutches and the power of their contact forces."""
    for number in range(CRUTCHES):
        arm, ground = e.arms[number], e.ground
        place, tip = arm.place, arm.tip
        tip.height = q[place + 1]
        tip.upward = contact_normal_force(-tip.height, -v[place + 1], ground.stiffness, ground.dissipation)
        tip.forward = anchored_friction_force(
            arm, q[place], v[place], tip.upward, ground.friction_coefficient
        )
        e.a[place] = (e.torque[place] + tip.forward) / arm.mass
        e.a[place + 1] = (e.torque[place + 1] + tip.upward) / arm.mass - e.gravity
        e.contact_power += tip.forward * v[place] + tip.upward * v[place + 1]


def drag_tips(e: Episode) -> None:
    """Move the anchor of the friction of each sliding tip at the end of an integration step."""
    for number in range(CRUTCHES):
        arm = e.arms[number]
        arm.anchor = dragged_anchor(arm, e.q[arm.place], arm.tip.upward, e.ground.friction_coefficient)


def use_crutches(e: Episode, tick: int) -> None:
    """Compute the delayed perception of the wearer, and move the arms with it."""
    sense = e.sense
    stepping, chair = 0.0, 0.0
    for leg in e.controller.legs:
        stepping = max(stepping, e.swing_phases[leg.phase])
        chair = max(chair, e.chair_phases[leg.phase])
    sense.lean = delayed_sample(sense.felt_lean, tick, e.q[PITCH])
    sense.lean_rate = delayed_sample(sense.felt_rate, tick, e.v[PITCH])
    sense.stepping = delayed_sample(sense.felt_stepping, tick, stepping)
    sense.still = 0 if sense.stepping > 0.0 else sense.still + 1
    sense.chair = delayed_sample(sense.felt_chair, tick, chair)
    sine, _ = sine_cosine(e.q[PITCH])
    shoulder = e.q[FORWARD] + e.trunk.shoulder * sine
    for number in range(CRUTCHES):
        arm = e.arms[number]
        ahead = delayed_sample(arm.felt_ahead, tick, e.q[arm.place] - shoulder)
        load = delayed_sample(arm.felt_load, tick, arm.tip.upward)
        move_arm(e.policy, sense, arm, e.arms[CRUTCHES - 1 - number], ahead, load)


def tip_energy(e: Episode) -> tuple[float, float]:
    """Return the kinetic and potential energy of the tips in [J]."""
    kinetic, potential = 0.0, 0.0
    for number in range(CRUTCHES):
        arm: Arm = e.arms[number]
        forward, upward = e.v[arm.place], e.v[arm.place + 1]
        kinetic += 0.5 * arm.mass * (forward * forward + upward * upward)
        potential += arm.mass * e.gravity * e.q[arm.place + 1]
    return kinetic, potential
