"""Steps of the commands: a fault and the delays that the simulation adds to the commands of the boards."""

from twin_gait.control.joint_board import set_current
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.faults import runaway_torque
from twin_gait.simulation.build_flags import WITH_DELAY, WITH_NETWORK
from twin_gait.simulation.episode import Episode


def add_runaway_torque(e: Episode, number: int, tick: int) -> None:
    """Add the torque of a runaway controller to the command of a board."""
    board = e.joints[number].board
    if tick >= e.first_fault and not board.setpoint.held:
        board.command.impedance += runaway_torque(number, tick, e.rates.period, e.faults)


def set_drive(e: Episode, number: int, tick: int) -> None:
    """Set the target current of a drive, with a delayed command or, if its board reboots, 0."""
    joint = e.joints[number]
    board = joint.board
    set_current(board, joint.due_command if WITH_DELAY else board.command.torque)
    if WITH_DELAY:
        joint.due_command = delayed_sample(joint.line, tick, board.command.torque)
    if WITH_NETWORK and joint.off:
        board.command.target_current = 0.0
