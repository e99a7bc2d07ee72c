"""What the sensors read in a tick: encoders with their velocity estimates, and the loads of the feet."""

from __future__ import annotations

from twin_gait.core.control_tick import measure_joints
from twin_gait.core.faults import faulty_angle, faulty_load
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.simulation.episode_arrays import (
    BODY_WEIGHT,
    DECIMATION,
    FAST_GAIN,
    FAULTY,
    FIRST_FAULT,
    N_LEGS,
    PERIOD,
    POINTS_PER_FOOT,
    Array,
    Episode,
)
from twin_gait.simulation.kernel_interface import contact_forces


def measure(episode: Episode, tick: int) -> None:
    """Encoders, velocity estimates and foot loads."""
    inputs, state = episode.inputs, episode.state
    noise_row = tick % inputs.noise.shape[0]
    for joint in range(inputs.coordinates.shape[0]):
        reading = state.q[inputs.coordinates[joint]] + inputs.noise[noise_row, joint]
        if inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
            reading = faulty_angle(
                joint,
                tick,
                inputs.numbers[PERIOD],
                inputs.faults,
                inputs.magnitudes,
                reading,
                state.angles[joint],
            )
        state.angles[joint] = reading
        state.last_angle[joint] = state.measured[joint, 0]
        # The estimate of the acceleration needs the last fast velocity.
        state.last_fast[joint] = state.measured[joint, 1]
    measure_joints(
        tick,
        state.angles,
        inputs.resolution,
        inputs.numbers[PERIOD],
        inputs.numbers[FAST_GAIN],
        inputs.integers[DECIMATION],
        state.measured,
        state.decimated_angle,
        state.ring,
    )
    if tick % inputs.integers[DECIMATION] == 0:
        _model_friction(episode)
    if inputs.integers[POINTS_PER_FOOT] > 0:
        contact_forces(state.q, state.v, inputs.bodies, inputs.contact, state.points)
        for leg in range(inputs.integers[N_LEGS]):
            load = foot_sum(state.points, leg, inputs.integers[POINTS_PER_FOOT], 1)
            load /= inputs.numbers[BODY_WEIGHT]
            state.last_load[leg] = state.legs[leg]
            if inputs.integers[FAULTY] != 0 and tick >= inputs.integers[FIRST_FAULT]:
                load = faulty_load(leg, tick, inputs.faults, load, state.last_load[leg])
            state.legs[leg] = load


def _model_friction(episode: Episode) -> None:
    """Friction torque of the compensator's model; it changes only with the slow velocity."""
    inputs, state = episode.inputs, episode.state
    for joint in range(inputs.coordinates.shape[0]):
        state.model_friction[joint] = rotational_friction_torque(
            state.measured[joint, 2],
            inputs.friction_model[joint, 0],
            inputs.friction_model[joint, 1],
            inputs.friction_model[joint, 2],
            inputs.friction_model[joint, 3],
        )


def foot_sum(points: Array, leg: int, points_per_foot: int, column: int) -> float:
    """Sum of one column over the contact points of a foot."""
    total = 0.0
    for number in range(leg * points_per_foot, (leg + 1) * points_per_foot):
        total += points[number, column]
    return total
