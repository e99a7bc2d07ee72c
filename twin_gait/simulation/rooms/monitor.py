"""The safety monitor of a tick, and the trip that ends the walk in a safe hold.

Causes are looked for everywhere and noted where they are found; only if there is one are they gone through.
"""

from __future__ import annotations

from twin_gait.core.safety import LOAD_TRIP, NO_TRIP, PHASE_TIME_OUT_TRIP, SUPPLY_TRIP, watch_joint
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import JOINTS_PER_LEG, POINTS_PER_FOOT, each, lanes


def watch(e: Episode, tick: int) -> None:
    """Let the safety monitor look at measurements, phases and the drives' last tick."""
    for one in lanes(e):
        watch_supply(one)
    for number in range(len(e.joints)):
        for one in lanes(e):
            watch_drive(one, number)
    for number in range(len(e.legs)):
        for one in lanes(e):
            watch_phase(one, number, tick)
            if POINTS_PER_FOOT > 0:
                watch_foot(one, number)
    found = False
    for one in lanes(e):
        found |= has_cause(one)
    if found:
        for one in each(e):
            trip_on_causes(one, tick)


def has_cause(e: Episode) -> bool:
    """Whether anything has been noted on which the monitor has to trip."""
    causes = e.supply.cause
    for joint in e.joints:
        causes |= joint.watched.cause
    for leg in e.legs:
        causes |= leg.phase_cause | leg.load_cause
    return causes != NO_TRIP


def watch_drive(e: Episode, number: int) -> None:
    """Note the cause of a trip that is found on a joint and its drive."""
    joint = e.joints[number]
    joint.watched.cause = watch_joint(joint.bounds, joint.watched, joint.encoder, e.rates.period)


def watch_phase(e: Episode, number: int, tick: int) -> None:
    """Note whether a leg stays in its phase for too long."""
    leg = e.legs[number]
    late = tick - max(leg.entry_tick, e.last_rest) > e.limits.phase_ticks
    leg.phase_cause = PHASE_TIME_OUT_TRIP if late else NO_TRIP


def watch_foot(e: Episode, number: int) -> None:
    """Note whether the load of a foot stands still while the hip above it turns."""
    leg, hip = e.legs[number], e.joints[number * JOINTS_PER_LEG]
    still = leg.load == leg.last_load and leg.load > 0.0
    turning = abs(hip.watched.motor_speed) > hip.bounds.frozen_speed
    leg.load_streak = leg.load_streak + 1 if still and turning else 0
    leg.load_cause = LOAD_TRIP if leg.load_streak >= e.limits.frozen_load_ticks else NO_TRIP


def watch_supply(e: Episode) -> None:
    """Note whether the bus voltage has been too low for too long."""
    supply = e.supply
    supply.low_streak = supply.low_streak + 1 if supply.bus_voltage < supply.least_voltage else 0
    supply.cause = SUPPLY_TRIP if supply.low_streak >= supply.low_ticks else NO_TRIP


def trip_on_causes(e: Episode, tick: int) -> None:
    """Trip on the first cause that was noted: joints, then phases, feet and supply; cut off broken drives."""
    for number, joint in enumerate(e.joints):
        trip(e, tick, joint.watched.cause, number)
        # Whatever else was found first.
        joint.drive_off = joint.drive_off or joint.watched.drive_streak >= joint.bounds.drive_ticks
    for number, leg in enumerate(e.legs):
        trip(e, tick, leg.phase_cause, len(e.joints) + number)
    for number, leg in enumerate(e.legs):
        trip(e, tick, leg.load_cause, len(e.joints) + number)
    trip(e, tick, e.supply.cause, -1)


def trip(e: Episode, tick: int, cause: int, place: int) -> None:
    """Go to the safe hold if there is a cause; the first one is kept."""
    if cause != NO_TRIP and e.trip.tick < 0:
        e.trip.tick = tick
        e.trip.cause = cause
        e.trip.part = place
        for joint in e.joints:
            # The angles of this tick may be what the monitor tripped on.
            joint.hold_angle = joint.encoder.last_angle
