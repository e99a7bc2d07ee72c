"""Steps of the commands: a fault and the delays that the simulation adds to the commands of the boards."""

from twin_gait.control.joint_board import set_current
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.faults import runaway_torque
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.structure import DELAYED, NETWORKED


def run_away(e: Episode, number: int, tick: int) -> None:
    """Add the torque of a runaway controller to the command of a board."""
    board = e.joints[number].board
    if tick >= e.first_fault and not board.demand.held:
        board.command.impedance += runaway_torque(number, tick, e.rates.period, e.faults)


def set_drive(e: Episode, number: int, tick: int) -> None:
    """Set the target current of a drive, with a delayed command or, if its board reboots, 0."""
    joint = e.joints[number]
    board = joint.board
    set_current(board, e.limits, joint.due if DELAYED else board.command.torque)
    if DELAYED:
        joint.due = delayed_sample(joint.line, tick, board.command.torque)
    if NETWORKED and joint.off:
        board.command.target_current = 0.0
