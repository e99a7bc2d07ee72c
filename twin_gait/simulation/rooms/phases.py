"""The state machine of both legs, and the fade into the parameters of a new phase."""

from __future__ import annotations

from twin_gait.core.blending import blend, blend_share
from twin_gait.core.control_tick import blend_setpoint, copy_setpoint, joint_signals, leg_signals
from twin_gait.core.guards import (
    NO_TRANSITION,
    OP_COMPARE,
    OP_PHASE,
    is_above,
    is_among,
    is_due,
    joined,
    least_ticks_of,
)
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import JOINTS_PER_LEG, LEGS, each, lanes, switch_row


def decide(e: Episode, tick: int) -> None:
    """Advance both legs on one snapshot, then blend their parameters."""
    for number in range(LEGS):
        for one in lanes(e):
            leg = one.legs[number]
            leg.ticks = tick - leg.entry_tick
            leg.before = leg.phase
    for number in range(LEGS):
        for one in lanes(e):
            _write_signals(one, number, 0)
            if LEGS == 2:
                _write_signals(one, 1 - number, len(one.signals) // 2)
        advance(e, number, tick)
        switching = False
        for one in lanes(e):
            switching |= one.legs[number].chosen != NO_TRANSITION
        if switching:
            for one in each(e):
                if one.legs[number].chosen != NO_TRANSITION:
                    _switch(one, number, tick)
    for number in range(LEGS):
        _blend(e, number, tick)


def advance(e: Episode, number: int, tick: int) -> None:
    """Choose the transition that a leg takes now: :func:`twin_gait.core.guards.next_transition` node by node.

    The reference engine asks its machine instead.
    """
    occupied, program = 0, e.program
    for one in lanes(e):
        leg = one.legs[number]
        leg.chosen = NO_TRANSITION
        occupied |= 1 << leg.before
    for index in range(program.n_transitions):
        rule = program.transitions[index]
        if (occupied >> rule.source) & 1 == 1:  # elsewhere nothing is counted
            for one in lanes(e):
                one.legs[number].results = 0
            for node in range(rule.first_node, rule.end_node):
                _evaluate(e, number, node)
            least_ticks = least_ticks_of(program, index)
            for one in lanes(e):
                _count(one, number, index, rule.source, rule.debounce_ticks, least_ticks)


def _evaluate(e: Episode, number: int, index: int) -> None:
    """One step of :func:`twin_gait.core.guards.guard_holds`."""
    node = e.program.nodes[index]
    operation, operand = node.operation, node.operand
    if operation == OP_COMPARE:
        comparison = e.program.comparisons[operand]
        first, second = comparison.signal_a, comparison.signal_b
        for one in lanes(e):
            leg, own = one.legs[number], one.program.comparisons[operand]
            leg.results = (leg.results << 1) | is_above(own, one.signals[first], one.signals[second])
    elif operation == OP_PHASE:
        for one in lanes(e):
            leg = one.legs[number]
            other = one.legs[LEGS - 1 - number].before if LEGS == 2 else -1
            leg.results = (leg.results << 1) | is_among(operand, other)
    else:
        for one in lanes(e):
            leg = one.legs[number]
            leg.results = joined(leg.results, operation, operand)


def _count(one: Episode, number: int, index: int, source: int, debounce_ticks: int, least_ticks: int) -> None:
    """Count the ticks in which a transition's guard has been open; choose it if it is the first one due."""
    leg = one.legs[number]
    is_open = leg.before == source and (leg.results & 1) == 1 and one.trip.tick < 0
    open_ticks = leg.debounce[index] + 1 if is_open else 0
    leg.debounce[index] = open_ticks
    due = is_open and is_due(open_ticks, debounce_ticks, leg.ticks, least_ticks)
    leg.chosen = index if due and leg.chosen == NO_TRANSITION else leg.chosen


def _write_signals(e: Episode, number: int, place: int) -> None:
    """Write what is measured on a leg where the guards read it."""
    for position in range(JOINTS_PER_LEG):
        encoder = e.joints[number * JOINTS_PER_LEG + position].encoder
        joint_signals(encoder, e.signals, place + 2 * position)
    leg = e.legs[number]
    leg_signals(leg.load, leg.ticks, e.rates.period, e.signals, place + 2 * JOINTS_PER_LEG)


def _blend(e: Episode, number: int, tick: int) -> None:
    """Fade the parameters of a leg towards those of its phase, unless they have arrived."""
    fading, ticks = False, e.rates.blend_ticks
    for one in lanes(e):
        fading |= tick - one.legs[number].entry_tick <= ticks
    if fading:
        for one in lanes(e):
            leg = one.legs[number]
            since = tick - leg.entry_tick
            if since <= ticks and one.trip.tick < 0:
                share = blend_share(1.0 if ticks <= 0 else since / ticks, one.rates.blend_law)
                for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
                    joint = one.joints[place]
                    blend_setpoint(joint.blend_start, joint.setpoints[leg.phase], share, joint.blended)
                leg.gravity = blend(leg.gravity_start, leg.gravity_shares[leg.phase], share)


def _switch(e: Episode, number: int, tick: int) -> None:
    """Enter a phase and note it."""
    leg = e.legs[number]
    target = e.program.transitions[leg.chosen].target
    if e.recording.n_switches < e.recording.most_switches:
        row = switch_row(e, e.recording.n_switches)
        row.tick = tick
        row.leg = number
        row.source = leg.phase
        row.target = target
        row.transition = leg.chosen
    e.recording.n_switches += 1
    leg.phase = target
    leg.entry_tick = tick
    for index in range(len(leg.debounce)):
        leg.debounce[index] = 0
    for place in range(number * JOINTS_PER_LEG, (number + 1) * JOINTS_PER_LEG):
        copy_setpoint(e.joints[place].blended, e.joints[place].blend_start)
    leg.gravity_start = leg.gravity
