"""The supervisor: selects the operating mode of the device, and the command of each mode for the legs.

It runs a table of modes (:mod:`twin_gait.gait.modes`) with the same guard evaluator as the legs use for their
gait table. In each tick it reads the request, if there is one, and the measured signals; it changes the mode,
or marks the request as rejected. After a trip of the safety monitor it is in the hold mode.
"""

from dataclasses import dataclass

from twin_gait.core.guards import NO_TRANSITION, GuardProgram, evaluate_guard, next_transition

NO_REQUEST = 0  # Code for no request; the codes of requests count from 1.
NO_POSTURE = -1


@dataclass(slots=True)
class ModeCommand:
    """Commands that a mode sets."""

    posture: int  # Phase that both legs enter with the mode, ``NO_POSTURE`` for none.
    walk: float  # 1 for the command to walk, 0 to stand.
    step: float  # 1 for the command to take a step, 0 to wait.


@dataclass(slots=True)
class Supervisor:
    """State of the supervisor."""

    program: GuardProgram  # Transitions of the table of modes with their guards.
    modes: list[ModeCommand]  # Commands of each mode.
    hold: int  # Index of the mode after a trip.
    swing: int  # Bit mask of the swing phases of the legs.
    # Signals that the guards read: those of the left leg, of the right leg, then of the device.
    signals: list[float]
    debounce: list[int]  # Consecutive ticks with a true guard, for each transition.
    mode: int = 0  # Index of the present mode.
    entry_tick: int = 0  # Tick in which the mode was entered.
    request: int = NO_REQUEST  # Request in this tick, ``NO_REQUEST`` for none.
    rejected: int = NO_REQUEST  # Request that was rejected in this tick, ``NO_REQUEST`` for none.
    entered: bool = False  # Whether a mode has been entered in this tick.


def choose_mode(supervisor: Supervisor, tick: int, tripped: bool) -> None:
    """Change to another mode if a transition is due, or to the hold; mark a request that is rejected."""
    supervisor.rejected = supervisor.request
    supervisor.entered = False
    if tripped:
        if supervisor.mode != supervisor.hold:
            enter_mode(supervisor, supervisor.hold, tick)
    else:
        advance_mode(supervisor, tick)


def advance_mode(supervisor: Supervisor, tick: int) -> None:
    """Take the transition that is due, if there is one."""
    program, signals, request_index = supervisor.program, supervisor.signals, supervisor.request - 1
    ticks = tick - supervisor.entry_tick
    chosen = next_transition(program, supervisor.mode, ticks, signals, request_index, supervisor.debounce)
    if chosen != NO_TRANSITION:
        rule = program.transitions[chosen]
        # A transition that would also have been taken without the request does not count as its result.
        if not evaluate_guard(program, rule.first_node, rule.end_node, signals, NO_REQUEST - 1):
            supervisor.rejected = NO_REQUEST
        enter_mode(supervisor, rule.target, tick)


def enter_mode(supervisor: Supervisor, mode: int, tick: int) -> None:
    """Set the present mode, and reset the debounce counters."""
    supervisor.mode = mode
    supervisor.entry_tick = tick
    supervisor.entered = True
    for index in range(len(supervisor.debounce)):
        supervisor.debounce[index] = 0
