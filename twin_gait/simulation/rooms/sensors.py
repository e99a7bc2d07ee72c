"""What the sensors read in a tick: encoders with their velocity estimates, and the loads of the feet."""

from __future__ import annotations

from twin_gait.core.control_tick import measure_joint
from twin_gait.core.faults import faulty_angle, faulty_load
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import FAULTY, POINTS_PER_FOOT, contact_forces, noise_row


def measure(e: Episode, tick: int) -> None:
    """Encoders, velocity estimates and foot loads."""
    noise, rates = noise_row(e, tick), e.rates
    for number, joint in enumerate(e.joints):
        reading = e.q[joint.place] + noise[number]
        if FAULTY:
            if tick >= e.first_fault:
                reading = faulty_angle(number, tick, rates.period, e.faults, reading, joint.reading)
        joint.reading = reading
        measure_joint(joint.encoder, tick, reading, rates.period, rates.fast_gain, rates.decimation)
        if tick % rates.decimation == 0:  # it changes only with the slow velocity
            law = joint.friction_model
            joint.model_friction = rotational_friction_torque(
                joint.encoder.velocity_slow,
                law.breakaway_torque,
                law.coulomb_friction,
                law.breakaway_velocity,
                law.viscous_friction,
            )
    if POINTS_PER_FOOT > 0:
        contact_forces(e.q, e.v, e.bodies, e.ground, e.points)
        for number, leg in enumerate(e.legs):
            load = normal_force(e, number) / e.body_weight
            leg.last_load = leg.load
            if FAULTY:
                if tick >= e.first_fault:
                    load = faulty_load(number, tick, e.faults, load, leg.last_load)
            leg.load = load


def normal_force(e: Episode, leg: int) -> float:
    """Sum of the upward forces on the points of a foot in [N]."""
    total = 0.0
    for number in range(leg * POINTS_PER_FOOT, (leg + 1) * POINTS_PER_FOOT):
        total += e.points[number].upward
    return total
