"""What acts from outside in a tick: the belt, the command to walk, the harness, a push, and the wearer."""

import math

from twin_gait.control.gait_controller import SUPERVISED, hear_command
from twin_gait.control.supervisor import NO_REQUEST, hear_request
from twin_gait.core.belt import treadmill_speed, walk_command
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.plant import Stop
from twin_gait.core.wearer import passive_hip_torque, passive_knee_torque, posture_place, spastic_torque
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import (
    ANKLES,
    PELVIS,
    PITCH,
    SHIFT,
    WEARER,
    effort_noise_row,
    effort_row,
    lanes,
)

LIMBS_PER_LEG = 2  # thigh and shank: hip and knee, controlled or not


def command(e: Episode, tick: int) -> None:
    """Let the belt follow its profile or come to rest after a trip; say what is asked for."""
    time = tick * e.rates.period
    trip_time = e.controller.trip.tick * e.rates.period if e.controller.trip.tick >= 0 else math.inf
    e.ground.belt_speed = treadmill_speed(e.belt, time, trip_time)
    if e.belt.ramp > 0.0:
        hear_command(e.controller, walk_command(time, e.belt.start, e.belt.stop), tick)
    if SUPERVISED:
        request = NO_REQUEST
        for number in range(len(e.requests)):
            if e.requests[number].tick == tick:
                request = e.requests[number].request
        hear_request(e.controller.supervisor, request)


def catch(e: Episode, tick: int) -> None:
    """In the tick of a trip the harness locks at the height of the wearer's pelvis, a stop from below."""
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


def push(e: Episode, tick: int) -> None:
    """Torques from outside for this tick: a push, and what the wearer does."""
    if WEARER:
        for number in range(len(e.limbs)):
            for one in lanes(e):
                one.external[one.limbs[number].place + SHIFT] = 0.0
    for number in range(len(e.joints)):
        for one in lanes(e):
            one.external[one.joints[number].place] = one.joints[number].push
    if WEARER:
        for number in range(len(e.controller.legs)):
            for one in lanes(e):
                _push_leg(one, number, tick)


def _push_leg(e: Episode, number: int, tick: int) -> None:
    """What the wearer does on hip and knee of a leg."""
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
    """Add the wearer's torque on hip or knee; the effort comes with a delay."""
    limb, phase = e.limbs[number], e.controller.legs[number // LIMBS_PER_LEG].phase
    condition, place = limb.condition, limb.place + SHIFT
    moments = limb.moments[phase]
    below, share = posture_place(hip, e.efforts.lowest_posture, e.efforts.posture_step, len(moments))
    moment = moments[below] + share * (moments[below + 1] - moments[below])
    effort_row(e, tick)[number] = condition.effort * moment
    effort = effort_row(e, tick + 1)[number]  # the oldest one
    effort *= 1.0 + effort_noise_row(e, tick)[number]
    reflex = spastic_torque(e.v[place], condition.stretch_reflex_threshold, condition.stretch_reflex_gain)
    e.external[place] += condition.passive_share * passive + reflex + effort
