"""The belt, the command to walk and the harness, tick by tick."""

from __future__ import annotations

import math

from twin_gait.control.gait_controller import SUPERVISED, hear_command
from twin_gait.control.supervisor import NO_REQUEST, hear_request
from twin_gait.core.belt import treadmill_speed, walk_command
from twin_gait.core.elementary import sine_cosine
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import PELVIS, PITCH, SHIFT


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
            harness.stop.lower = e.q[PELVIS] + harness.height * cosine
            harness.stop.upper = math.inf
            harness.stop.stiffness = e.catch_stiffness
            harness.stop.dissipation = e.catch_dissipation
    elif PELVIS >= 0:
        if e.controller.trip.tick == tick:
            stop = e.plant[PELVIS + SHIFT].stop
            stop.lower = e.q[PELVIS + SHIFT]
            stop.upper = math.inf
            stop.stiffness = e.catch_stiffness
            stop.dissipation = e.catch_dissipation
