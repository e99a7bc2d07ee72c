"""The safety monitor of a tick, and the trip that ends the walk in a safe hold."""

from __future__ import annotations

from twin_gait.core.safety import LOAD_TRIP, NO_TRIP, PHASE_TIME_OUT_TRIP, SUPPLY_TRIP, watch_joint
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import JOINTS_PER_LEG, POINTS_PER_FOOT


def watch(e: Episode, tick: int) -> None:
    """Let the safety monitor look at measurements, phases and the drives' last tick."""
    for number, joint in enumerate(e.joints):
        cause = watch_joint(joint.bounds, joint.watched, joint.encoder, e.rates.period)
        if cause != NO_TRIP:
            trip(e, tick, cause, number)
            if joint.watched.drive_streak >= joint.bounds.drive_ticks:
                joint.drive_off = True
    for number, leg in enumerate(e.legs):
        if tick - max(leg.entry_tick, e.last_rest) > e.limits.phase_ticks:
            trip(e, tick, PHASE_TIME_OUT_TRIP, len(e.joints) + number)
    if POINTS_PER_FOOT > 0:
        for number in range(len(e.legs)):
            _watch_foot(e, tick, number)
    low = e.supply.bus_voltage < e.supply.least_voltage
    e.supply.low_streak = e.supply.low_streak + 1 if low else 0
    if e.supply.low_streak >= e.supply.low_ticks:
        trip(e, tick, SUPPLY_TRIP, -1)


def _watch_foot(e: Episode, tick: int, number: int) -> None:
    """Trip if the load of a foot stands still while the hip above it turns."""
    leg, hip = e.legs[number], e.joints[number * JOINTS_PER_LEG]
    still = leg.load == leg.last_load and leg.load > 0.0
    turning = abs(hip.watched.motor_speed) > hip.bounds.frozen_speed
    leg.load_streak = leg.load_streak + 1 if still and turning else 0
    if leg.load_streak >= e.limits.frozen_load_ticks:
        trip(e, tick, LOAD_TRIP, len(e.joints) + number)


def trip(e: Episode, tick: int, cause: int, place: int) -> None:
    """Go to the safe hold; the first cause is kept."""
    if e.trip.tick >= 0:
        return
    e.trip.tick = tick
    e.trip.cause = cause
    e.trip.place = place
    for joint in e.joints:
        # The angles of this tick may be what the monitor tripped on.
        joint.hold_angle = joint.encoder.last_angle
