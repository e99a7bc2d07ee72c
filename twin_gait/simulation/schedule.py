"""A tick of the episode and its order: sensors; watch, decide and control; drives, record and motion."""

import math

from twin_gait.control.gait_controller import CONTROLLED, SUPERVISED, change_demands
from twin_gait.simulation.episode import COMPLETED, DIVERGED, FELL, LET_GO, TIPPED, Episode
from twin_gait.simulation.interface import each, lanes
from twin_gait.simulation.rooms.commands import control, feed_forward
from twin_gait.simulation.rooms.drives import drive, supply
from twin_gait.simulation.rooms.monitor import watch, watch_drives
from twin_gait.simulation.rooms.motion import integrate, record
from twin_gait.simulation.rooms.network import exchange, tell
from twin_gait.simulation.rooms.phases import choose_modes, decide
from twin_gait.simulation.rooms.sensors import measure
from twin_gait.simulation.rooms.surroundings import catch, command, place_chair, push, use_crutches
from twin_gait.simulation.structure import CRUTCHES, NETWORKED, PELVIS, PITCH, SEATED, SHIFT


def run_ticks(e: Episode, first: int, end: int) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the wearer falls or the state diverges.

    ``e``: the episode, or those that run in lockstep. Returns the ticks that have been run since the start;
    ``e.status`` says how it stands.
    """
    for tick in range(first, end):
        sense(e, tick)
        think(e, tick)
        if act(e, tick):
            return tick + 1
    return end


def sense(e: Episode, tick: int) -> None:
    """What the belt does, what the legs are told, and what the sensors read."""
    for one in lanes(e):
        command(one, tick)
    measure(e, tick)


def think(e: Episode, tick: int) -> None:
    """What boards and gait controller do between sensors and drives."""
    if e.watching:
        watch_drives(e)
    tell(e, tick)
    if e.watching:
        watch(e, tick)
    if SUPERVISED:
        choose_modes(e, tick)
    walking = False
    for one in lanes(e):
        walking |= one.controller.trip.tick < 0
    if walking:
        decide(e, tick)
    feed_forward(e)
    if CONTROLLED:
        for one in each(e):
            if one.controller.trip.tick < 0:
                change_demands(one.controller, one.rates, tick)
    control(e, tick)


def act(e: Episode, tick: int) -> bool:
    """Drives, all else that acts on the legs, and their motion; whether the run ends with it."""
    drive(e, tick)
    if NETWORKED:
        exchange(e, tick)
    push(e, tick)
    if CRUTCHES > 0:
        for one in each(e):
            use_crutches(one, tick)
    if SEATED:
        for one in lanes(e):
            place_chair(one, tick)
    for one in lanes(e):
        catch(one, tick)
    if e.recording.on:
        record(e, tick)
    supply(e, tick)
    integrate(e, tick)
    ended = False
    for one in lanes(e):
        status = status_of(one)
        one.status = status
        ended |= status != COMPLETED
    return ended


def status_of(e: Episode) -> int:
    """Whether the run goes on."""
    status = COMPLETED
    if PELVIS >= 0 and e.q[PELVIS + SHIFT] < e.fall_height:
        status = FELL
    if PITCH >= 0 and abs(e.q[PITCH]) > e.fall_pitch:
        status = TIPPED
    if CRUTCHES > 0:
        for number in range(CRUTCHES):
            if e.arms[number].length > e.longest_reach:
                status = LET_GO
    for i in range(len(e.q)):
        if not (math.isfinite(e.q[i]) and abs(e.v[i]) < e.diverged_velocity):
            status = DIVERGED
    return status
