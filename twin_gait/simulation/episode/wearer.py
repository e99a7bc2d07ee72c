"""What acts on the joints from outside in a tick: a push, and the wearer."""

from __future__ import annotations

from twin_gait.core.wearer import (
    CONTRACTURE,
    EFFORT,
    PASSIVE_SHARE,
    STRETCH_REFLEX_GAIN,
    STRETCH_REFLEX_THRESHOLD,
    passive_hip_torque,
    passive_knee_torque,
    posture_place,
    spastic_torque,
)
from twin_gait.simulation.episode_arrays import (
    JOINTS_PER_LEG,
    LOWEST_POSTURE,
    N_ANKLES,
    N_LEGS,
    POSTURE_STEP,
    WEARER,
    WEARER_SHIFT,
    Episode,
)


def push(episode: Episode, tick: int) -> None:
    """Torques from outside for this tick: a push, and what the wearer does."""
    inputs, state = episode.inputs, episode.state
    for joint in range(inputs.coordinates.shape[0]):
        state.external[inputs.coordinates[joint]] = inputs.push[joint]
    if inputs.integers[WEARER] != 0:
        per_leg, shift = inputs.integers[JOINTS_PER_LEG], inputs.integers[WEARER_SHIFT]
        if inputs.integers[WEARER_SHIFT] != 0:
            for joint in range(inputs.coordinates.shape[0]):
                state.external[inputs.coordinates[joint] + shift] = 0.0
        for leg in range(inputs.integers[N_LEGS]):
            hip = state.q[inputs.coordinates[leg * per_leg] + shift]
            knee = state.q[inputs.coordinates[leg * per_leg + 1] + shift]
            ankle = 0.0
            if inputs.integers[N_ANKLES] > 0:
                ankle = state.q[inputs.ankles[leg] + shift]
            passive = passive_hip_torque(
                hip - inputs.conditions[leg * per_leg, CONTRACTURE],
                knee - inputs.conditions[leg * per_leg + 1, CONTRACTURE],
            )
            _wear(episode, tick, leg * per_leg, passive, hip)
            passive = passive_knee_torque(
                hip - inputs.conditions[leg * per_leg, CONTRACTURE],
                knee - inputs.conditions[leg * per_leg + 1, CONTRACTURE],
                ankle,
            )
            _wear(episode, tick, leg * per_leg + 1, passive, hip)


def _wear(episode: Episode, tick: int, joint: int, passive: float, hip: float) -> None:
    """Add the wearer's torque on one joint; the effort comes with a delay."""
    inputs, state = episode.inputs, episode.state
    ring = state.efforts.shape[0]
    phase = state.phase[joint // inputs.integers[JOINTS_PER_LEG]]
    below, share = posture_place(
        hip, inputs.numbers[LOWEST_POSTURE], inputs.numbers[POSTURE_STEP], inputs.effort_moments.shape[2]
    )
    lower = inputs.effort_moments[joint, phase, below]
    moment = lower + share * (inputs.effort_moments[joint, phase, below + 1] - lower)
    state.efforts[tick % ring, joint] = inputs.conditions[joint, EFFORT] * moment
    effort = state.efforts[(tick + 1) % ring, joint]
    effort *= 1.0 + inputs.effort_noise[tick % inputs.effort_noise.shape[0], joint]
    index = inputs.coordinates[joint] + inputs.integers[WEARER_SHIFT]
    reflex = spastic_torque(
        state.v[index],
        inputs.conditions[joint, STRETCH_REFLEX_THRESHOLD],
        inputs.conditions[joint, STRETCH_REFLEX_GAIN],
    )
    state.external[index] += inputs.conditions[joint, PASSIVE_SHARE] * passive + reflex + effort
