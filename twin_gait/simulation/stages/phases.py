"""The state machine of both legs, and the fade into the parameters of a new phase."""

from twin_gait.control.gait_controller import (
    LEGS,
    begin_tick,
    enter_phase,
    fade,
    sent_to,
    supervise,
    write_signals,
)
from twin_gait.control.supervisor import NO_POSTURE
from twin_gait.core.guards import NO_TRANSITION, count_open_ticks, evaluate_node
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import each, lanes, switch_row


def decide(e: Episode, tick: int) -> None:
    """Advance both legs on one snapshot, then blend their parameters."""
    for number in range(LEGS):
        for one in lanes(e):
            begin_tick(one.controller, number, tick)
    for number in range(LEGS):
        for one in lanes(e):
            write_signals(one.controller, one.rates, number)
        advance(e, number, tick)
        switching = False
        for one in lanes(e):
            switching |= one.controller.legs[number].chosen != NO_TRANSITION
        if switching:
            for one in each(e):
                chosen = one.controller.legs[number].chosen
                if chosen != NO_TRANSITION:
                    _enter(one, number, tick, one.controller.program.transitions[chosen].target, chosen)
    for number in range(LEGS):
        _blend(e, number, tick)


def choose_modes(e: Episode, tick: int) -> None:
    """Let the supervisor choose the mode, and send the legs into its posture."""
    for one in each(e):
        supervise(one.controller, one.rates, tick)
        for number in range(LEGS):
            posture = sent_to(one.controller, number)
            if posture != NO_POSTURE:
                _enter(one, number, tick, posture, NO_TRANSITION)


def advance(e: Episode, number: int, tick: int) -> None:
    """Choose the transition that each episode's leg takes now.

    This is :func:`twin_gait.core.guards.next_transition` with the loop over the episodes innermost. The
    reference engine replaces it by its state machine.
    """
    occupied, program = 0, e.controller.program
    for one in lanes(e):
        leg = one.controller.legs[number]
        leg.chosen = NO_TRANSITION
        occupied |= 1 << leg.before
    for index in range(program.n_transitions):
        rule = program.transitions[index]
        if (occupied >> rule.source) & 1 == 1:  # elsewhere nothing is counted
            for one in lanes(e):
                one.controller.legs[number].results = 0
            for node in range(rule.first_node, rule.end_node):
                for one in lanes(e):
                    _evaluate(one, number, node)
            for one in lanes(e):
                _count(one, number, index)


def _evaluate(one: Episode, number: int, node: int) -> None:
    """Evaluate one node of a guard of a leg."""
    controller, leg = one.controller, one.controller.legs[number]
    other = controller.legs[LEGS - 1 - number].before if LEGS == 2 else -1
    leg.results = evaluate_node(controller.program, node, controller.signals, other, leg.results)


def _count(one: Episode, number: int, index: int) -> None:
    """Count the ticks for which a transition's guard has been open, and choose it if it is due."""
    controller, leg = one.controller, one.controller.legs[number]
    source = controller.program.transitions[index].source
    is_open = leg.before == source and (leg.results & 1) == 1 and controller.trip.tick < 0
    leg.chosen = count_open_ticks(controller.program, index, is_open, leg.ticks, leg.debounce, leg.chosen)


def _blend(e: Episode, number: int, tick: int) -> None:
    """Fade the parameters of a leg, unless they have arrived in all episodes."""
    fading = False
    for one in lanes(e):
        leg = one.controller.legs[number]
        fading |= tick - leg.entry_tick <= leg.blend_ticks[leg.phase]
    if fading:
        for one in lanes(e):
            fade(one.controller, one.rates, number, tick)


def _enter(e: Episode, number: int, tick: int, target: int, transition: int) -> None:
    """Let a leg enter a phase, and note it."""
    if e.recording.n_switches < e.recording.most_switches:
        row = switch_row(e, e.recording.n_switches)
        row.tick = tick
        row.leg = number
        row.source = e.controller.legs[number].phase
        row.target = target
        row.transition = transition
    e.recording.n_switches += 1
    enter_phase(e.controller, number, target, tick)
