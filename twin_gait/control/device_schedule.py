"""Schedule of the device: the steps of boards and gait controller in a tick, in their order.

The simulation runs it with sensors, bus and motors in between (:mod:`twin_gait.simulation.schedule`); the
units of the firmware are printed from it (:mod:`twin_gait.firmware.units`).
"""

from twin_gait.control import gait_controller
from twin_gait.control.gait_controller import (
    N_LEGS,
    ControlledLeg,
    ControllerState,
    begin_tick,
    blend_parameters,
    compute_setpoint,
    enter_phase,
    estimate_acceleration,
    has_cause,
    monitor_leg,
    monitor_supply,
    needs_gravity,
    required_posture,
    run_controller,
    run_supervisor,
    set_model_angle,
    trip,
    trip_on_causes,
    write_signals,
)
from twin_gait.control.joint_board import (
    BoardState,
    Limits,
    SamplingConfig,
    check_command,
    compute_torque,
    copy_joint_setpoint,
    monitor_drive,
    set_current,
    set_hold_setpoint,
    update_model_friction,
    update_total_torque,
)
from twin_gait.control.supervisor import NO_POSTURE
from twin_gait.core.control_tick import measure_angle, update_slow_velocity
from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.core.safety import NO_TRIP
from twin_gait.core.schedule import joints, legs, scalar_branch, scalar_steps, vector_branch, when

# Build flags that conditions of this schedule may use.
FLAGS = {
    name: getattr(gait_controller, name)
    for name in ("N_LEGS", "WITH_INERTIA_COMPENSATION", "WITH_CONTROLLER", "WITH_SUPERVISOR")
}


def control_gravity(q: list[float], bodies: list[float], gravity: float, torque: list[float]) -> None:
    """Compute the controller model's gravity torques into ``torque``; replaced by the kernel."""
    raise NotImplementedError


def control_inertia(q: list[float], a: list[float], bodies: list[float], torque: list[float]) -> None:
    """Compute the model's inertia torques, armature included, into ``torque``; replaced by the kernel."""
    raise NotImplementedError


def measure_position(board: BoardState, rates: SamplingConfig, reading: float, tick: int) -> None:
    """Measure the angle of a joint, and estimate its fast velocity."""
    measure_angle(board.encoder, tick == 0, reading, rates.period, rates.fast_gain)


def sample_velocity(board: BoardState, rates: SamplingConfig, tick: int) -> None:
    """Take a sample of the slow velocity of a joint."""
    update_slow_velocity(board.encoder, tick // rates.decimation, rates.decimation * rates.period)


def has_not_tripped(controller: ControllerState) -> bool:
    """Check that the monitor has not tripped."""
    return controller.trip.tick < 0


def choose_transition(controller: ControllerState, number: int) -> None:
    """Choose the transition that a leg takes in this tick."""
    leg, other_phase = controller.legs[number], -1
    if N_LEGS == 2:
        other_phase = controller.legs[1 - number].start_phase
    leg.chosen = next_transition(
        controller.program, leg.start_phase, leg.ticks, controller.signals, other_phase, leg.debounce
    )


def has_chosen(leg: ControlledLeg) -> bool:
    """Check whether a leg takes a transition in this tick."""
    return leg.chosen != NO_TRANSITION


def apply_transition(controller: ControllerState, number: int, tick: int) -> None:
    """Enter the phase to which the chosen transition of a leg leads."""
    chosen = controller.legs[number].chosen
    enter_phase(controller, number, controller.program.transitions[chosen].target, tick)


def apply_posture(controller: ControllerState, number: int, tick: int) -> None:
    """Enter the phase of a leg that a new mode requires, if there is one."""
    posture = required_posture(controller, number)
    if posture != NO_POSTURE:
        enter_phase(controller, number, posture, tick)


def is_blending(leg: ControlledLeg, tick: int) -> bool:
    """Check whether the parameters of a leg are still being blended into those of its phase."""
    return tick - leg.entry_tick <= leg.blend_ticks[leg.phase]


def compute_gravity(controller: ControllerState) -> None:
    """Compute the gravity torques of the model."""
    if needs_gravity(controller):
        model = controller.model
        control_gravity(model.q, model.bodies, model.gravity, model.gravity_torque)


def compute_inertia(controller: ControllerState) -> None:
    """Compute the inertia torques of the model."""
    model = controller.model
    control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def copy_setpoint_to_board(controller: ControllerState, board: BoardState, number: int) -> None:
    """Copy the gait controller's setpoint to the board of a joint."""
    copy_joint_setpoint(controller.joints[number].setpoint, board.setpoint)


def is_implausible(board: BoardState) -> bool:
    """Check whether the command of a board is implausible, so that it must not be sent to its drive."""
    return board.command.cause != NO_TRIP


def hold_on_implausible_command(
    controller: ControllerState, board: BoardState, limits: Limits, number: int, tick: int
) -> None:
    """Trip on an implausible command, and hold the joint instead.

    The setpoint of this tick was computed for walking, so no weight is carried in this tick.
    """
    joint = controller.joints[number]
    trip(controller, tick, board.command.cause, number)
    set_hold_setpoint(joint.setpoint, limits, joint.hold_angle, 0.0, 0.0)
    copy_joint_setpoint(joint.setpoint, board.setpoint)
    compute_torque(board)
    update_total_torque(board)


def command_current(board: BoardState) -> None:
    """Set the target current of a drive from its command."""
    set_current(board, board.command.torque)


# ------------------------------------------------------------------ the order of a tick

# Board: angle and fast velocity, at the slow rate also the slow velocity and the friction model.
MEASURE = (
    joints(measure_position),
    when(
        "tick % decimation == 0",
        joints(when("tick > 0", scalar_steps(sample_velocity)), update_model_friction),
    ),
)
# Board: the monitor of joint and drive.
MONITOR_DRIVES = when("watching", joints(monitor_drive))
# Gait controller: the monitor.
MONITOR = when("watching", monitor_supply, legs(monitor_leg), scalar_branch(has_cause, trip_on_causes))
# Gait controller: the operating modes.
SUPERVISE = when("WITH_SUPERVISOR", scalar_steps(run_supervisor, legs(apply_posture)))
# Gait controller: the state machines of both legs on one snapshot, and the blending of their parameters.
STATE_MACHINES = vector_branch(
    has_not_tripped,
    legs(begin_tick),
    legs(write_signals, choose_transition, scalar_branch(has_chosen, apply_transition)),
    legs(vector_branch(is_blending, blend_parameters)),
)
# Gait controller: torques of the model.
FEED_FORWARD = (
    vector_branch(needs_gravity, joints(set_model_angle), compute_gravity),
    when("WITH_INERTIA_COMPENSATION", joints(estimate_acceleration), compute_inertia),
)
# Gait controller: the controller that changes the setpoints.
CHANGE = when("WITH_CONTROLLER", scalar_branch(has_not_tripped, run_controller))
DECIDE = (MONITOR, SUPERVISE, STATE_MACHINES, *FEED_FORWARD, CHANGE)
# Board and gait controller, joint after joint: a trip on one command takes effect before the next command.
HOLD = scalar_branch(is_implausible, hold_on_implausible_command)
COMMAND = (
    joints(compute_setpoint, copy_setpoint_to_board, compute_torque, check_command, HOLD, command_current),
)
