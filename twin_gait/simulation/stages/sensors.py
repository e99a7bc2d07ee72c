"""What the sensors read in a tick: encoders with their velocity estimates, loads of the feet, the trunk."""

from twin_gait.control.joint_board import model_friction
from twin_gait.core.contact import along_slope
from twin_gait.core.control_tick import measure_angle, sample_slowly
from twin_gait.core.faults import faulty_angle, faulty_load
from twin_gait.core.inertial import follow_pitch, trunk_specific_force
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import contact_forces, each, lanes, noise_row
from twin_gait.simulation.structure import FAULTY, FORWARD, INERTIAL, PELVIS, PITCH, POINTS_PER_FOOT, SLOPED


def measure(e: Episode, tick: int) -> None:
    """Encoders, velocity estimates, foot loads, and the trunk, whose sensor is the gait controller's own."""
    for number in range(len(e.joints)):
        for one in lanes(e):
            rates, joint = one.rates, one.joints[number]
            joint.reading = _reading(one, number, tick)
            measure_angle(joint.board.encoder, tick == 0, joint.reading, rates.period, rates.fast_gain)
    if tick % e.rates.decimation == 0:
        _measure_slowly(e, tick)
    if POINTS_PER_FOOT > 0:
        _measure_loads(e, tick)
    if INERTIAL:
        for one in lanes(e):
            _measure_pitch(one, tick)
    for one in lanes(e):
        one.controller.common.trunk_pitch = trunk_pitch(one)


def trunk_pitch(one: Episode) -> float:
    """Pitch of the trunk as it is known in [rad], forwards positive; none if the pelvis is guided."""
    if INERTIAL:
        return one.trunk_unit.pitch
    if PITCH >= 0:
        return one.q[PITCH]
    return 0.0


def _measure_pitch(one: Episode, tick: int) -> None:
    """Let the inertial unit of the trunk feel the last accelerations; at rest at the start."""
    unit, noise, first = one.trunk_unit, noise_row(one, tick), len(one.joints) + len(one.limbs)
    rate, a = one.v[PITCH], one.a
    ahead, up = trunk_specific_force(unit, one.q[PITCH], rate, a[PITCH], a[FORWARD], a[PELVIS], one.gravity)
    follow_pitch(unit, rate + noise[first], ahead + noise[first + 1], up + noise[first + 2], one.rates.period)


def _reading(one: Episode, number: int, tick: int) -> float:
    """What an encoder reads in [rad]."""
    joint = one.joints[number]
    reading = one.q[joint.place] + noise_row(one, tick)[number]
    if FAULTY and tick >= one.first_fault:
        return faulty_angle(number, tick, one.rates.period, one.faults, reading, joint.reading)
    return reading


def _measure_slowly(e: Episode, tick: int) -> None:
    """The slow velocity estimate, and the friction of the compensator's model, which changes only with it."""
    for number in range(len(e.joints)):
        if tick > 0:
            for one in each(e):
                rates, encoder = one.rates, one.joints[number].board.encoder
                sample_slowly(encoder, tick // rates.decimation, rates.decimation * rates.period)
        for one in lanes(e):
            model_friction(one.joints[number].board)


def _measure_loads(e: Episode, tick: int) -> None:
    for one in lanes(e):
        contact_forces(one.q, one.v, one.bodies, one.ground, one.points)
    for number in range(len(e.soles)):
        for one in lanes(e):
            sole = one.soles[number]
            load = normal_force(one, number) / one.body_weight
            if FAULTY and tick >= one.first_fault:
                load = faulty_load(number, tick, one.faults, load, sole.load)
            sole.load = load


def normal_force(e: Episode, leg: int) -> float:
    """Sum of the normal forces on the points of a foot in [N]."""
    total = 0.0
    for number in range(leg * POINTS_PER_FOOT, (leg + 1) * POINTS_PER_FOOT):
        _, normal = point_force(e, number)
        total += normal
    return total


def point_force(e: Episode, number: int) -> tuple[float, float]:
    """Force of the ground on a point of a sole along the ground and at right angles to it, in [N]."""
    point, ground = e.points[number], e.ground
    if SLOPED:
        return along_slope(ground.slope_sine, ground.slope_cosine, point.forward, point.upward)
    return point.forward, point.upward
