"""A tick of the episode and its order: command, measure, watch, decide, control, record, integrate."""

from __future__ import annotations

import numpy as np

from twin_gait.simulation.episode.monitor import watch
from twin_gait.simulation.episode.motion import integrate
from twin_gait.simulation.episode.motors import control, feed_forward, supply
from twin_gait.simulation.episode.path import follow, track
from twin_gait.simulation.episode.phases import decide
from twin_gait.simulation.episode.record import record
from twin_gait.simulation.episode.sensors import measure
from twin_gait.simulation.episode.surroundings import catch, command
from twin_gait.simulation.episode.wearer import push
from twin_gait.simulation.episode_arrays import (
    ADAPTS,
    COMPLETED,
    DIVERGED,
    DIVERGED_VELOCITY,
    FALL_HEIGHT,
    FELL,
    FOLLOWS,
    PELVIS_INDEX,
    RECORD,
    TRIP_TICK,
    WATCHING,
    WEARER_SHIFT,
    Array,
    Episode,
)


def run_ticks(episode: Episode, first: int, end: int, rows: Array) -> int:
    """Run ticks ``first`` to ``end - 1``, or until the wearer falls or the state diverges.

    Args:
        episode: Inputs and state; the state is changed in place.
        rows: Log, shape ``(n_rows, n_columns)``; if the episode records, a tick is written to row
            ``tick - FIRST_ROW``.

    Returns:
        Ticks that have been run since the start of the episode; ``state.counters[1]`` is the status.
    """
    inputs, state = episode.inputs, episode.state
    recording = inputs.integers[RECORD] != 0
    for tick in range(first, end):
        command(episode, tick)
        measure(episode, tick)
        if inputs.integers[WATCHING] != 0:
            watch(episode, tick)
        if state.safety[TRIP_TICK] < 0:
            decide(episode, tick)
            if inputs.integers[FOLLOWS] != 0:
                follow(episode, tick)
            if inputs.integers[ADAPTS] != 0:
                track(episode, tick)
        feed_forward(episode)
        battery_power = 0.0
        for joint in range(inputs.coordinates.shape[0]):
            battery_power += control(episode, joint, tick, rows)
        push(episode, tick)
        catch(episode, tick)
        if recording:
            record(episode, tick, battery_power, rows)
        supply(episode, tick, battery_power)
        integrate(episode, tick)
        status = _status(episode)
        if status != COMPLETED:
            state.counters[1] = status
            return tick + 1
    return end


def _status(episode: Episode) -> int:
    """Whether the run goes on."""
    inputs, state = episode.inputs, episode.state
    for i in range(state.q.shape[0]):
        if not (np.isfinite(state.q[i]) and abs(state.v[i]) < inputs.numbers[DIVERGED_VELOCITY]):
            return DIVERGED
    pelvis = inputs.integers[PELVIS_INDEX]
    if pelvis >= 0 and state.q[pelvis + inputs.integers[WEARER_SHIFT]] < inputs.numbers[FALL_HEIGHT]:
        return FELL
    return COMPLETED
