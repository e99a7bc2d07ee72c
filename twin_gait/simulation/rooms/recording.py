"""The row of a tick in the log, but for what the controller writes itself."""

from __future__ import annotations

from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import (
    ANKLES,
    PELVIS,
    POINTS_PER_FOOT,
    SHIFT,
    log_row,
    observe,
)
from twin_gait.simulation.log import LogRow
from twin_gait.simulation.rooms.motion import acceleration
from twin_gait.simulation.rooms.sensors import normal_force


def record(e: Episode, tick: int, battery_power: float) -> None:
    """Write everything that is not a controller's, at the state before integration."""
    e.time = tick * e.rates.period
    acceleration(e, 0.0, e.q, e.v)
    row = log_row(e, tick)
    _record_legs(e, row)
    kinetic, potential, force, moment = observe(e.q, e.v, e.a, e.bodies, e.gravity, e.points)
    if PELVIS >= 0:
        pelvis, hung = row.pelvis, e.plant[PELVIS + SHIFT]
        pelvis.pelvis_height = e.q[PELVIS]
        pelvis.pelvis_velocity = e.v[PELVIS]
        pelvis.support_force = hung.spring_torque + hung.stop_torque
        pelvis.guide_force = force
        pelvis.guide_moment = moment
    row.bus_voltage = e.supply.bus_voltage
    row.battery_power = battery_power
    row.kinetic_energy = kinetic
    row.potential_energy = potential
    row.works.motor_work = e.works.motor_work
    row.works.friction_work = e.works.friction_work
    row.works.stop_work = e.works.stop_work
    row.works.spring_work = e.works.spring_work
    row.works.contact_work = e.works.contact_work
    row.works.patient_work = e.works.patient_work
    row.safety_state = 1.0 if e.trip.tick >= 0 else 0.0
    row.trip_cause = float(e.trip.cause)
    if SHIFT > 0:
        _record_braces(e, row)


def _record_legs(e: Episode, row: LogRow) -> None:
    """Write phases, joints, ankles and feet."""
    for number, joint in enumerate(e.joints):
        place, out = joint.place, row.joints[number]
        out.angle = e.q[place]
        out.velocity = e.v[place]
        out.friction_torque = e.plant[place].friction_torque
        out.stop_torque = e.plant[place].stop_torque
        imposed = e.imposed_motion.torque if e.imposed_motion.place == place else 0.0
        out.patient_torque = imposed + e.external[place]
        if SHIFT > 0:
            out.patient_torque += e.external[place + SHIFT]
    for number, leg in enumerate(e.legs):
        row.phases[number] = float(leg.phase)
        if ANKLES:
            ankle = row.ankles[number]
            ankle.angle = e.q[leg.ankle]
            ankle.velocity = e.v[leg.ankle]
            ankle.orthosis_torque = e.plant[leg.ankle].spring_torque
        if POINTS_PER_FOOT > 0:
            foot, first = row.feet[number], number * POINTS_PER_FOOT
            friction, lowest = 0.0, e.points[first].height
            for place in range(first, first + POINTS_PER_FOOT):
                friction += e.points[place].forward
                lowest = min(lowest, e.points[place].height)
            foot.normal_force = normal_force(e, number)
            foot.friction_force = friction
            foot.clearance = lowest


def _record_braces(e: Episode, row: LogRow) -> None:
    """Write the wearer's own motion and the torque of the device on them; the pelvis comes last."""
    row.brace_work.brace_work = e.brace_work
    for number in range(len(row.braces)):
        place, out = e.braced[number], row.braces[number]
        out.wearer_angle = e.q[place + SHIFT]
        out.wearer_velocity = e.v[place + SHIFT]
        out.brace_torque = e.braces[place].torque
    if PELVIS >= 0:
        row.pelvis_brace.wearer_pelvis_height = e.q[PELVIS + SHIFT]
        row.pelvis_brace.wearer_pelvis_velocity = e.v[PELVIS + SHIFT]
        row.pelvis_brace.pelvis_brace_force = e.braces[PELVIS].torque
