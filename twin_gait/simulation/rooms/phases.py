"""The state machine of both legs, and the fade into the parameters of a new phase."""

from __future__ import annotations

from twin_gait.core.blending import blend, blend_share
from twin_gait.core.control_tick import blend_setpoint, copy_setpoint, joint_signals, leg_signals
from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import JOINTS_PER_LEG, LEGS, switch_row


def decide(e: Episode, tick: int) -> None:
    """Advance both legs on one snapshot, then blend their parameters."""
    half = len(e.signals) // 2
    for leg in e.legs:
        leg.ticks = tick - leg.entry_tick
        leg.before = leg.phase
    for number in range(LEGS):
        other = -1
        _write_signals(e, number, 0)
        if LEGS == 2:
            _write_signals(e, 1 - number, half)
            other = e.legs[1 - number].before
        chosen = advance(e, number, tick, other)
        if chosen != NO_TRANSITION:
            _switch(e, number, tick, chosen)
    for number in range(LEGS):
        _blend(e, number, tick)


def advance(e: Episode, number: int, tick: int, other: int) -> int:
    """Transition that a leg takes now, or ``NO_TRANSITION``; the reference engine asks its machine."""
    leg = e.legs[number]
    return next_transition(e.program, leg.before, leg.ticks, e.signals, other, leg.debounce)


def _write_signals(e: Episode, number: int, place: int) -> None:
    """Write what is measured on a leg where the guards read it."""
    for position in range(JOINTS_PER_LEG):
        encoder = e.joints[number * JOINTS_PER_LEG + position].encoder
        joint_signals(encoder, e.signals, place + 2 * position)
    leg = e.legs[number]
    leg_signals(leg.load, leg.ticks, e.rates.period, e.signals, place + 2 * JOINTS_PER_LEG)


def _blend(e: Episode, number: int, tick: int) -> None:
    """Fade the parameters of a leg towards those of its phase, unless they have arrived."""
    leg, ticks = e.legs[number], e.rates.blend_ticks
    since = tick - leg.entry_tick
    if since <= ticks:
        share = blend_share(1.0 if ticks <= 0 else since / ticks, e.rates.blend_law)
        for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
            joint = e.joints[place]
            blend_setpoint(joint.blend_start, joint.setpoints[leg.phase], share, joint.blended)
        leg.gravity = blend(leg.gravity_start, leg.gravity_shares[leg.phase], share)


def _switch(e: Episode, number: int, tick: int, chosen: int) -> None:
    """Enter a phase and note it."""
    leg, target = e.legs[number], e.program.transitions[chosen].target
    if e.recording.n_switches < e.recording.most_switches:
        row = switch_row(e, e.recording.n_switches)
        row.tick = tick
        row.leg = number
        row.source = leg.phase
        row.target = target
        row.transition = chosen
    e.recording.n_switches += 1
    leg.phase = target
    leg.entry_tick = tick
    for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
        copy_setpoint(e.joints[place].blended, e.joints[place].blend_start)
    leg.gravity_start = leg.gravity
