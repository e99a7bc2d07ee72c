"""A tick of the episode and its order: command, measure, watch, decide, control, record, integrate."""

from __future__ import annotations

import math

from twin_gait.simulation.episode import COMPLETED, DIVERGED, FELL, Episode
from twin_gait.simulation.interface import ADAPTS, FOLLOWS, PELVIS, SHIFT
from twin_gait.simulation.rooms.monitor import watch
from twin_gait.simulation.rooms.motion import integrate
from twin_gait.simulation.rooms.motors import control, feed_forward, supply
from twin_gait.simulation.rooms.path import follow, track
from twin_gait.simulation.rooms.phases import decide
from twin_gait.simulation.rooms.recording import record
from twin_gait.simulation.rooms.sensors import measure
from twin_gait.simulation.rooms.surroundings import catch, command
from twin_gait.simulation.rooms.wearer import push


def run_ticks(e: Episode, first: int, end: int) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the wearer falls or the state diverges.

    Args:
        e: The episode; changed in place.

    Returns:
        Ticks that have been run since the start of the episode; ``e.status`` says how it stands.
    """
    for tick in range(first, end):
        command(e, tick)
        measure(e, tick)
        if e.watching:
            watch(e, tick)
        if e.trip.tick < 0:
            decide(e, tick)
            if FOLLOWS:
                follow(e, tick)
            if ADAPTS:
                track(e, tick)
        feed_forward(e)
        battery_power = 0.0
        for number in range(len(e.joints)):
            battery_power += control(e, number, tick)
        push(e, tick)
        catch(e, tick)
        if e.recording.on:
            record(e, tick, battery_power)
        supply(e, tick, battery_power)
        integrate(e, tick)
        status = status_of(e)
        if status != COMPLETED:
            e.status = status
            return tick + 1
    return end


def status_of(e: Episode) -> int:
    """Whether the run goes on."""
    for i in range(len(e.q)):
        if not (math.isfinite(e.q[i]) and abs(e.v[i]) < e.limits.diverged_velocity):
            return DIVERGED
    if PELVIS >= 0:
        if e.q[PELVIS + SHIFT] < e.limits.fall_height:
            return FELL
    return COMPLETED
