"""From what the gait controller wants to the current set points of the drives."""

from twin_gait.control.gait_controller import (
    INERTIA_WANTED,
    demand,
    estimate_acceleration,
    pose,
    trip,
    wants_gravity,
)
from twin_gait.control.joint_board import ask, check, copy_demand, demand_rest, refuse, set_current, sum_up
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.faults import runaway_torque
from twin_gait.core.safety import NO_TRIP
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.interface import control_gravity, control_inertia, each, lanes
from twin_gait.simulation.rooms.network import hear_setpoint
from twin_gait.simulation.structure import DELAYED, FAULTY, NETWORKED


def feed_forward(e: Episode) -> None:
    """Gravity and inertia torques of the controller's model, where a share of them is wanted."""
    wanted = False
    for one in lanes(e):
        wanted |= wants_gravity(one.controller)
    if wanted:
        for number in range(len(e.joints)):
            for one in lanes(e):
                pose(one.controller, number)
        for one in lanes(e):
            if wants_gravity(one.controller):
                model = one.controller.model
                control_gravity(model.q, model.bodies, model.gravity, model.gravity_torque)
    if INERTIA_WANTED:
        for number in range(len(e.joints)):
            for one in lanes(e):
                estimate_acceleration(one.controller, one.rates, number)
        for one in lanes(e):
            model = one.controller.model
            control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def control(e: Episode, tick: int) -> None:
    """Command joint after joint: a trip on one of them is heard before the next one's command is known."""
    for number in range(len(e.joints)):
        implausible = False
        for one in lanes(e):
            board = one.joints[number].board
            demand(one.controller, one.limits, number, tick)
            if NETWORKED:
                hear_setpoint(one, number, tick)
            else:
                copy_demand(one.controller.joints[number].demand, board.demand)
            ask(board)
            if FAULTY and tick >= one.first_fault and not board.demand.held:
                board.command.impedance += runaway_torque(number, tick, one.rates.period, one.faults)
            check(board, one.watching)
        for one in lanes(e):
            implausible |= one.joints[number].board.command.cause != NO_TRIP
        if implausible:
            for one in each(e):
                _refuse(one, number, tick)
        for one in lanes(e):
            _command(one, number, tick)


def _refuse(e: Episode, number: int, tick: int) -> None:
    """Hold instead of commanding what is wild: the joint alone over a bus, which is slow, otherwise all."""
    board = e.joints[number].board
    if not NETWORKED:
        trip(e.controller, tick, board.command.cause, number)
    elif board.command.cause != NO_TRIP:
        refuse(board, e.limits)


def _command(e: Episode, number: int, tick: int) -> None:
    """Current set point of a drive, of the command or in the hold."""
    joint = e.joints[number]
    board = joint.board
    if not NETWORKED and board.command.cause != NO_TRIP:
        # What was asked was a walk, whose weight is not carried in this tick.
        held = e.controller.joints[number]
        demand_rest(held.demand, e.limits, held.hold_angle, 0.0, 0.0)
        copy_demand(held.demand, board.demand)
        ask(board)
        sum_up(board)
    set_current(board, e.limits, joint.due if DELAYED else board.command.torque)
    if DELAYED:
        joint.due = delayed_sample(joint.line, tick, board.command.torque)
    if NETWORKED and joint.off:
        board.command.target_current = 0.0
