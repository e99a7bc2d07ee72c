"""Steps of the state machines of both legs: records of their switches, and guards of a block of episodes."""

from twin_gait.control.gait_controller import LEGS, sent_to
from twin_gait.control.supervisor import NO_POSTURE
from twin_gait.core.guards import NO_TRANSITION, count_open_ticks, evaluate_node
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import lanes, switch_row


def note_switch(e: Episode, number: int, tick: int) -> None:
    """Record the transition that a leg takes."""
    chosen = e.controller.legs[number].chosen
    _note(e, number, tick, e.controller.program.transitions[chosen].target, chosen)


def note_posture(e: Episode, number: int, tick: int) -> None:
    """Record the switch of a leg to the posture of a mode, if there is one."""
    posture = sent_to(e.controller, number)
    if posture != NO_POSTURE:
        _note(e, number, tick, posture, NO_TRANSITION)


def _note(e: Episode, number: int, tick: int, target: int, transition: int) -> None:
    """Record a switch if the buffer is not full, and count it."""
    if e.recording.n_switches < e.recording.most_switches:
        row = switch_row(e, e.recording.n_switches)
        row.tick = tick
        row.leg = number
        row.source = e.controller.legs[number].phase
        row.target = target
        row.transition = transition
    e.recording.n_switches += 1


def choose_in_lanes(e: Episode, number: int) -> None:
    """Choose the transition that a leg of every episode of a block takes in this tick.

    This is :func:`twin_gait.core.guards.next_transition` with the loop over the episodes innermost. A leg
    takes none where the monitor has tripped.
    """
    occupied, program = 0, e.controller.program
    for one in lanes(e):
        leg = one.controller.legs[number]
        leg.chosen = NO_TRANSITION
        occupied |= 1 << leg.before
    for index in range(program.n_transitions):
        rule = program.transitions[index]
        if (occupied >> rule.source) & 1 == 1:  # otherwise no leg is in its source phase
            for one in lanes(e):
                one.controller.legs[number].results = 0
            for node in range(rule.first_node, rule.end_node):
                for one in lanes(e):
                    _evaluate(one, number, node)
            for one in lanes(e):
                _count(one, number, index)


def _evaluate(e: Episode, number: int, node: int) -> None:
    """Evaluate one node of a guard of a leg."""
    controller, leg = e.controller, e.controller.legs[number]
    other = controller.legs[LEGS - 1 - number].before if LEGS == 2 else -1
    leg.results = evaluate_node(controller.program, node, controller.signals, other, leg.results)


def _count(e: Episode, number: int, index: int) -> None:
    """Count the ticks for which the guard of a transition has been true, and choose it if it is due."""
    controller, leg = e.controller, e.controller.legs[number]
    source = controller.program.transitions[index].source
    is_open = leg.before == source and (leg.results & 1) == 1 and controller.trip.tick < 0
    leg.chosen = count_open_ticks(controller.program, index, is_open, leg.ticks, leg.debounce, leg.chosen)
