"""The belt and the command to walk, tick by tick."""

from __future__ import annotations

from twin_gait.core.belt import (
    BELT_CRUISE,
    BELT_DELAY,
    BELT_RAMP,
    BELT_START,
    BELT_STOP,
    belt_speed,
    walk_command,
)
from twin_gait.simulation.episode_arrays import PERIOD, Episode


def command(episode: Episode, tick: int) -> None:
    """Let the belt follow its profile, and tell the legs to walk or to stand."""
    inputs, state = episode.inputs, episode.state
    if inputs.belt[BELT_RAMP] > 0.0:
        time = tick * inputs.numbers[PERIOD]
        inputs.contact[0] = belt_speed(
            time - inputs.belt[BELT_DELAY],
            inputs.belt[BELT_CRUISE],
            inputs.belt[BELT_START],
            inputs.belt[BELT_STOP],
            inputs.belt[BELT_RAMP],
        )
        walk = walk_command(time, inputs.belt[BELT_START], inputs.belt[BELT_STOP])
        state.signals[state.signals.shape[0] - 1] = walk
        if walk == 0.0:
            state.counters[2] = tick
