"""The reference walk: path of position tracking, or measure of the tracking error."""

from __future__ import annotations

from twin_gait.core.assistance import adapted_assistance, cycle_place
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, EQUILIBRIUM
from twin_gait.simulation.episode_arrays import (
    ALLOWANCE,
    ASSISTANCE_GAIN,
    CYCLE_TICKS,
    FORGETTING,
    JOINTS_PER_LEG,
    LEAST_ASSISTANCE,
    N_LEGS,
    PERIOD,
    Episode,
)


def follow(episode: Episode, tick: int) -> None:
    """Move the equilibrium angles along the path, and let the dampers move with it."""
    inputs, state = episode.inputs, episode.state
    per_leg, cycle = inputs.integers[JOINTS_PER_LEG], inputs.integers[CYCLE_TICKS]
    spacing = cycle * inputs.numbers[PERIOD] / (inputs.path.shape[0] - 1)
    for leg in range(inputs.integers[N_LEGS]):
        before, share = cycle_place(inputs.path_starts[leg] + tick / cycle, inputs.path.shape[0])
        for number in range(per_leg):
            start = inputs.path[before, number]
            change = inputs.path[before + 1, number] - start
            column = COLUMNS_PER_JOINT * number
            state.blended[leg, column + EQUILIBRIUM] = start + share * change
            state.lead[leg * per_leg + number] = state.blended[leg, column + DAMPING] * change / spacing


def track(episode: Episode, tick: int) -> None:
    """Sum up the tracking error, and adapt the assistance level at the end of a stride."""
    inputs, state = episode.inputs, episode.state
    per_leg = inputs.integers[JOINTS_PER_LEG]
    for leg in range(inputs.integers[N_LEGS]):
        if tick > 0 and state.phase[leg] == 0 and state.entry_tick[leg] == tick:
            _end_stride(episode, leg, tick)
        progress = (tick - state.stride_start[leg]) / state.stride_ticks[leg]
        if state.stride_start[leg] == 0:
            progress += inputs.path_starts[leg]
        before, share = cycle_place(progress, inputs.path.shape[0])
        for number in range(per_leg):
            start = inputs.path[before, number]
            wanted = start + share * (inputs.path[before + 1, number] - start)
            joint = leg * per_leg + number
            state.tracking[joint] += abs(state.measured[joint, 0] - wanted)


def _end_stride(episode: Episode, leg: int, tick: int) -> None:
    """Adapt the assistance level of one leg to the errors of the stride that has ended."""
    inputs, state = episode.inputs, episode.state
    per_leg = inputs.integers[JOINTS_PER_LEG]
    duration = tick - state.stride_start[leg]
    for joint in range(leg * per_leg, (leg + 1) * per_leg):
        state.assistance[joint] = adapted_assistance(
            state.assistance[joint],
            state.tracking[joint] / duration,
            inputs.numbers[FORGETTING],
            inputs.numbers[ASSISTANCE_GAIN],
            inputs.numbers[ALLOWANCE],
            inputs.numbers[LEAST_ASSISTANCE],
        )
        state.tracking[joint] = 0.0
    if state.stride_start[leg] > 0:  # the first stride may have begun half-way
        state.stride_ticks[leg] = duration
    state.stride_start[leg] = tick
