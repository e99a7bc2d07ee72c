"""The belt, the command to walk and the harness, tick by tick."""

from __future__ import annotations

import numpy as np

from twin_gait.core.belt import (
    BELT_CRUISE,
    BELT_DELAY,
    BELT_RAMP,
    BELT_START,
    BELT_STOP,
    BELT_STOP_RAMP,
    treadmill_speed,
    walk_command,
)
from twin_gait.core.plant import STOP_DISSIPATION, STOP_LOWER, STOP_STIFFNESS, STOP_UPPER
from twin_gait.simulation.episode_arrays import (
    CATCH_DISSIPATION,
    CATCH_STIFFNESS,
    PELVIS_INDEX,
    PERIOD,
    TRIP_TICK,
    WEARER_SHIFT,
    Episode,
)


def command(episode: Episode, tick: int) -> None:
    """Let the belt follow its profile or come to rest after a trip; tell the legs to walk or to stand."""
    inputs, state = episode.inputs, episode.state
    time = tick * inputs.numbers[PERIOD]
    trip = state.safety[TRIP_TICK]
    inputs.contact[0] = treadmill_speed(
        time,
        trip * inputs.numbers[PERIOD] if trip >= 0 else np.inf,
        inputs.belt[BELT_CRUISE],
        inputs.belt[BELT_START],
        inputs.belt[BELT_STOP],
        inputs.belt[BELT_RAMP],
        inputs.belt[BELT_DELAY],
        inputs.belt[BELT_STOP_RAMP],
    )
    if inputs.belt[BELT_RAMP] > 0.0:
        walk = walk_command(time, inputs.belt[BELT_START], inputs.belt[BELT_STOP])
        state.signals[state.signals.shape[0] - 1] = walk
        if walk == 0.0:
            state.counters[2] = tick


def catch(episode: Episode, tick: int) -> None:
    """In the tick of a trip the harness locks at the height of the wearer's pelvis, a stop from below."""
    inputs, state = episode.inputs, episode.state
    if inputs.integers[PELVIS_INDEX] >= 0 and state.safety[TRIP_TICK] == tick:
        pelvis = inputs.integers[PELVIS_INDEX] + inputs.integers[WEARER_SHIFT]
        inputs.plant_rows[pelvis, STOP_LOWER] = state.q[pelvis]
        inputs.plant_rows[pelvis, STOP_UPPER] = np.inf
        inputs.plant_rows[pelvis, STOP_STIFFNESS] = inputs.numbers[CATCH_STIFFNESS]
        inputs.plant_rows[pelvis, STOP_DISSIPATION] = inputs.numbers[CATCH_DISSIPATION]
