"""The safety monitor of a tick, and the trip that ends the walk in a safe hold."""

from __future__ import annotations

from twin_gait.core.safety import (
    DRIVE_STREAK,
    DRIVE_TICKS,
    FROZEN_SPEED,
    LOAD_TRIP,
    MOTOR_SPEED,
    NO_TRIP,
    PHASE_TIME_OUT_TRIP,
    SUPPLY_TRIP,
    watch_joint,
)
from twin_gait.simulation.episode_arrays import (
    BUS_VOLTAGE,
    DRIVES_OFF,
    FROZEN_LOAD_TICKS,
    JOINTS_PER_LEG,
    LEAST_VOLTAGE,
    LOW_VOLTAGE_STREAK,
    N_LEGS,
    PERIOD,
    PHASE_TIME_OUT_TICKS,
    POINTS_PER_FOOT,
    TRIP_CAUSE,
    TRIP_PLACE,
    TRIP_TICK,
    VOLTAGE_TICKS,
    Episode,
)


def watch(episode: Episode, tick: int) -> None:
    """Let the safety monitor look at measurements, phases and the drives' last tick."""
    inputs, state = episode.inputs, episode.state
    joints = inputs.coordinates.shape[0]
    for joint in range(joints):
        cause = watch_joint(
            joint,
            inputs.numbers[PERIOD],
            inputs.bounds,
            state.measured,
            state.last_angle,
            state.watch_memory,
            state.watch_streaks,
        )
        if cause != NO_TRIP:
            trip(episode, tick, cause, joint)
            if state.watch_streaks[joint, DRIVE_STREAK] >= inputs.bounds[joint, DRIVE_TICKS]:
                state.drive_off[joint] = 1
                state.safety[DRIVES_OFF] = 1
    for leg in range(inputs.integers[N_LEGS]):
        if tick - max(state.entry_tick[leg], state.counters[2]) > inputs.integers[PHASE_TIME_OUT_TICKS]:
            trip(episode, tick, PHASE_TIME_OUT_TRIP, joints + leg)
    if inputs.integers[POINTS_PER_FOOT] > 0:
        _watch_feet(episode, tick)
    low = state.changing[BUS_VOLTAGE] < inputs.numbers[LEAST_VOLTAGE]
    state.safety[LOW_VOLTAGE_STREAK] = state.safety[LOW_VOLTAGE_STREAK] + 1 if low else 0
    if state.safety[LOW_VOLTAGE_STREAK] >= inputs.integers[VOLTAGE_TICKS]:
        trip(episode, tick, SUPPLY_TRIP, -1)


def _watch_feet(episode: Episode, tick: int) -> None:
    """Trip if the load of a foot stands still while the hip above it turns."""
    inputs, state = episode.inputs, episode.state
    for leg in range(inputs.integers[N_LEGS]):
        hip = leg * inputs.integers[JOINTS_PER_LEG]
        still = state.legs[leg] == state.last_load[leg] and state.legs[leg] > 0.0
        turning = abs(state.watch_memory[hip, MOTOR_SPEED]) > inputs.bounds[hip, FROZEN_SPEED]
        state.load_streaks[leg] = state.load_streaks[leg] + 1 if still and turning else 0
        if state.load_streaks[leg] >= inputs.integers[FROZEN_LOAD_TICKS]:
            trip(episode, tick, LOAD_TRIP, inputs.coordinates.shape[0] + leg)


def trip(episode: Episode, tick: int, cause: int, place: int) -> None:
    """Go to the safe hold; the first cause is kept."""
    inputs, state = episode.inputs, episode.state
    if state.safety[TRIP_TICK] >= 0:
        return
    state.safety[TRIP_TICK] = tick
    state.safety[TRIP_CAUSE] = cause
    state.safety[TRIP_PLACE] = place
    for joint in range(inputs.coordinates.shape[0]):
        # The angles of this tick may be what the monitor tripped on.
        state.hold_angle[joint] = state.last_angle[joint]
