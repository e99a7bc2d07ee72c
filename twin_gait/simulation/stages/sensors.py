"""Steps of the sensors: encoders, load sensors of the feet, and the inertial unit of the trunk."""

from twin_gait.core.contact import resolve_along_slope
from twin_gait.core.faults import faulty_angle, faulty_load
from twin_gait.core.inertial import trunk_specific_force, update_pitch_estimate
from twin_gait.simulation.backend import contact_forces, noise_row
from twin_gait.simulation.build_flags import (
    FORWARD_INDEX,
    N_POINTS_PER_FOOT,
    PELVIS_INDEX,
    PITCH_INDEX,
    WITH_FAULTS,
    WITH_SLOPE,
)
from twin_gait.simulation.episode import Episode


def read_encoder(e: Episode, number: int, tick: int) -> None:
    """Read the encoder of a joint, with noise, offset and faults."""
    joint = e.joints[number]
    reading = e.q[joint.index] + noise_row(e, tick)[number]
    if WITH_FAULTS and tick >= e.first_fault:
        reading = faulty_angle(number, tick, e.rates.period, e.faults, reading, joint.reading)
    joint.reading = reading


def compute_contact_forces(e: Episode) -> None:
    """Compute the ground reaction forces on the soles."""
    contact_forces(e.q, e.v, e.bodies, e.ground, e.points)


def read_load(e: Episode, number: int, tick: int) -> None:
    """Read the load of a foot as a fraction of body weight, with faults."""
    foot = e.feet[number]
    load = normal_force(e, number) / e.body_weight
    if WITH_FAULTS and tick >= e.first_fault:
        load = faulty_load(number, tick, e.faults, load, foot.load)
    foot.load = load


def read_trunk(e: Episode) -> None:
    """Pass the pitch of the trunk to the gait controller, to which its sensor is connected."""
    e.controller.device_signals.trunk_pitch = trunk_pitch(e)


def trunk_pitch(e: Episode) -> float:
    """Return the measured pitch of the trunk in [rad], positive forwards; 0 if the pelvis is guided."""
    if PITCH_INDEX >= 0:
        return e.trunk_unit.pitch if e.has_inertial_unit else e.q[PITCH_INDEX]
    return 0.0


def measure_pitch(e: Episode, tick: int) -> None:
    """Estimate the pitch of the trunk from the accelerations of the last tick, which are 0 at the start."""
    unit, noise, first = e.trunk_unit, noise_row(e, tick), len(e.joints) + len(e.limbs)
    rate, a = e.v[PITCH_INDEX], e.a
    ahead, up = trunk_specific_force(
        unit, e.q[PITCH_INDEX], rate, a[PITCH_INDEX], a[FORWARD_INDEX], a[PELVIS_INDEX], e.gravity
    )
    update_pitch_estimate(
        unit, rate + noise[first], ahead + noise[first + 1], up + noise[first + 2], e.rates.period
    )


def normal_force(e: Episode, leg: int) -> float:
    """Return the sum of the normal forces on the points of a foot in [N]."""
    total = 0.0
    for number in range(leg * N_POINTS_PER_FOOT, (leg + 1) * N_POINTS_PER_FOOT):
        _, normal = point_force(e, number)
        total += normal
    return total


def point_force(e: Episode, number: int) -> tuple[float, float]:
    """Return the force of the ground on a point of a sole, along the ground and normal to it, in [N]."""
    point, ground = e.points[number], e.ground
    if WITH_SLOPE:
        return resolve_along_slope(ground.slope_sine, ground.slope_cosine, point.forward, point.upward)
    return point.forward, point.upward
