"""The supervisor: which operating mode the device is in, and what a mode has the legs do.

It runs a table of modes (:mod:`twin_gait.gait.modes`) by the same evaluator as the legs run their gait
table. In a tick it takes the request that is made, if any, and what is measured; it goes to another mode, or
notes that the request is refused. After a trip of the safety monitor it is in the mode of the hold.
"""

from dataclasses import dataclass

from twin_gait.core.guards import NO_TRANSITION, GuardProgram, guard_holds, next_transition

NO_REQUEST = 0  # of requests, whose codes count from 1
NO_POSTURE = -1


@dataclass(slots=True)
class ModeCommand:
    """What a mode sets."""

    posture: int  # Phase that both legs enter with it, ``NO_POSTURE`` for none.
    walk: float  # 1 if the legs are told to walk, 0 to stand.
    step: float  # 1 if they are told to take a step, 0 to wait.


@dataclass(slots=True)
class Supervisor:
    """Everything that the supervisor keeps."""

    program: GuardProgram  # Transitions of the table of modes with their guards.
    modes: list[ModeCommand]  # What each sets.
    hold: int  # Mode after a trip.
    swing: int  # Bit mask of the legs' phases in swing.
    signals: list[float]  # What the guards read: of the left leg, of the right one, then of the device.
    debounce: list[int]  # Consecutive ticks with an open guard, by transition.
    mode: int = 0  # Present mode.
    entry_tick: int = 0  # Tick in which it was entered.
    request: int = NO_REQUEST  # That is made in this tick, ``NO_REQUEST`` for none.
    refused: int = NO_REQUEST  # The same if nothing has answered it.
    entered: bool = False  # Whether a mode has been entered in this tick.


def choose_mode(supervisor: Supervisor, tick: int, tripped: bool) -> None:
    """Go to another mode if a transition is due, or to the hold; note a request that is refused."""
    supervisor.refused = supervisor.request
    supervisor.entered = False
    if tripped:
        if supervisor.mode != supervisor.hold:
            enter_mode(supervisor, supervisor.hold, tick)
    else:
        advance_mode(supervisor, tick)


def advance_mode(supervisor: Supervisor, tick: int) -> None:
    """Take the transition that is due, if there is one."""
    program, signals, asked = supervisor.program, supervisor.signals, supervisor.request - 1
    ticks = tick - supervisor.entry_tick
    chosen = next_transition(program, supervisor.mode, ticks, signals, asked, supervisor.debounce)
    if chosen != NO_TRANSITION:
        rule = program.transitions[chosen]
        # What would have been taken anyway is no answer.
        if not guard_holds(program, rule.first_node, rule.end_node, signals, NO_REQUEST - 1):
            supervisor.refused = NO_REQUEST
        enter_mode(supervisor, rule.target, tick)


def enter_mode(supervisor: Supervisor, mode: int, tick: int) -> None:
    """Be in a mode from now on."""
    supervisor.mode = mode
    supervisor.entry_tick = tick
    supervisor.entered = True
    for index in range(len(supervisor.debounce)):
        supervisor.debounce[index] = 0
