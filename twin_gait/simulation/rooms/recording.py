"""The row of a tick in the log, and what is found out for it alone."""

from twin_gait.core.contact import LEAST_FORCE
from twin_gait.simulation.episode import Episode, Sole
from twin_gait.simulation.interface import (
    CRUTCHES,
    POINTS_PER_FOOT,
    SHIFT,
    lanes,
    log_row,
    observe,
    write_row,
)
from twin_gait.simulation.rooms.motion import acceleration
from twin_gait.simulation.rooms.sensors import normal_force, point_force
from twin_gait.simulation.rooms.surroundings import energy_of_tips


def record(e: Episode, tick: int) -> None:
    """Write everything, at the state before integration."""
    acceleration(e, tick * e.rates.period, False)
    for number in range(len(e.joints)):
        for one in lanes(e):
            _sum_up_outside(one, number)
    if POINTS_PER_FOOT > 0:
        for number in range(len(e.soles)):
            for one in lanes(e):
                _stand(one, one.soles[number], number)
    for one in lanes(e):
        _observe(one)
        write_row(one, log_row(one, tick))


def _sum_up_outside(e: Episode, number: int) -> None:
    """Torque from outside on a joint."""
    place = e.joints[number].place
    imposed = e.imposed_motion.torque if e.imposed_motion.place == place else 0.0
    e.joints[number].outside = imposed + e.external[place]
    if SHIFT > 0:
        e.joints[number].outside += e.external[place + SHIFT]


def _stand(e: Episode, sole: Sole, number: int) -> None:
    """Forces of the ground on a foot, and where it stands."""
    first = number * POINTS_PER_FOOT
    friction, pressed, lowest = 0.0, 0.0, e.points[first].height
    for place in range(first, first + POINTS_PER_FOOT):
        along, normal = point_force(e, place)
        friction += along
        pressed += normal * (place - first)
        lowest = min(lowest, e.points[place].height)
    sole.normal = normal_force(e, number)
    sole.friction = friction
    sole.clearance = lowest
    loaded = sole.normal > LEAST_FORCE and POINTS_PER_FOOT > 1
    sole.pressure_place = pressed / (sole.normal * (POINTS_PER_FOOT - 1)) if loaded else 0.0


def _observe(e: Episode) -> None:
    """Energies, and what the guides of the pelvis take."""
    kinetic, potential, force, moment = observe(e.q, e.v, e.a, e.bodies, e.gravity, e.points)
    if CRUTCHES > 0:
        of_tips = energy_of_tips(e)
        kinetic += of_tips[0]
        potential += of_tips[1]
    e.kinetic_energy, e.potential_energy, e.guide_force, e.guide_moment = kinetic, potential, force, moment
