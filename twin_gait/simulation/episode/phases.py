"""The state machine of both legs in a tick, and the fade from phase to phase."""

from __future__ import annotations

from twin_gait.core.control_tick import blend_phase, leg_signals
from twin_gait.core.guards import NO_TRANSITION, TARGET, next_transition
from twin_gait.simulation.episode_arrays import (
    BLEND_LAW,
    BLEND_TICKS,
    JOINTS_PER_LEG,
    N_LEGS,
    PERIOD,
    Episode,
)


def decide(episode: Episode, tick: int) -> None:
    """Advance all legs on one snapshot, then blend their parameters."""
    inputs, state = episode.inputs, episode.state
    legs, per_leg = inputs.integers[N_LEGS], inputs.integers[JOINTS_PER_LEG]
    half = state.signals.shape[0] // 2
    for leg in range(legs):
        state.leg_ticks[leg] = tick - state.entry_tick[leg]
        state.before[leg] = state.phase[leg]
    for leg in range(legs):
        period = inputs.numbers[PERIOD]
        leg_signals(leg, per_leg, state.measured, state.legs, state.leg_ticks, period, state.signals, 0)
        other = -1
        if legs == 2:
            leg_signals(
                1 - leg, per_leg, state.measured, state.legs, state.leg_ticks, period, state.signals, half
            )
            other = state.before[1 - leg]
        chosen = next_transition(
            state.before[leg],
            state.leg_ticks[leg],
            inputs.minimum_ticks[state.before[leg]],
            inputs.transitions,
            inputs.nodes,
            inputs.comparisons,
            state.signals,
            other,
            state.debounce,
            leg * inputs.transitions.shape[0],
        )
        if chosen != NO_TRANSITION:
            _switch(episode, leg, tick, chosen)
    for leg in range(legs):
        ticks = tick - state.entry_tick[leg]
        if ticks > inputs.integers[BLEND_TICKS]:
            continue  # the fade is over
        blend_phase(
            leg,
            ticks,
            inputs.integers[BLEND_TICKS],
            inputs.integers[BLEND_LAW],
            state.blend_start,
            inputs.phase_rows[leg, state.phase[leg]],
            state.blended,
        )


def _switch(episode: Episode, leg: int, tick: int, chosen: int) -> None:
    """Enter a phase and note it."""
    inputs, state = episode.inputs, episode.state
    target = inputs.transitions[chosen, TARGET]
    number = state.counters[0]
    if number < state.switches.shape[0]:
        state.switches[number, 0] = tick
        state.switches[number, 1] = leg
        state.switches[number, 2] = state.phase[leg]
        state.switches[number, 3] = target
        state.switches[number, 4] = chosen
    state.counters[0] = number + 1
    state.phase[leg] = target
    state.entry_tick[leg] = tick
    for column in range(state.blended.shape[1]):
        state.blend_start[leg, column] = state.blended[leg, column]
