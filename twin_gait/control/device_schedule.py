"""Schedule of the device: the steps of boards and gait controller in a tick, in their order.

The simulation runs it with sensors, bus and motors in between (:mod:`twin_gait.simulation.schedule`); the
units of the firmware are printed from it (:mod:`twin_gait.firmware.units`).
"""

from twin_gait.control import gait_controller
from twin_gait.control.gait_controller import (
    LEGS,
    ControlledLeg,
    ControllerState,
    begin_tick,
    change_demands,
    demand,
    enter_phase,
    estimate_acceleration,
    fade,
    has_cause,
    pose,
    sent_to,
    supervise,
    trip,
    trip_on_causes,
    wants_gravity,
    watch_leg,
    watch_supply,
    write_signals,
)
from twin_gait.control.joint_board import (
    BoardState,
    Limits,
    Rates,
    ask,
    check,
    copy_demand,
    demand_rest,
    model_friction,
    set_current,
    sum_up,
    watch_drive,
)
from twin_gait.control.supervisor import NO_POSTURE
from twin_gait.core.control_tick import measure_angle, sample_slowly
from twin_gait.core.guards import NO_TRANSITION, next_transition
from twin_gait.core.safety import NO_TRIP
from twin_gait.core.schedule import joints, legs, one_by_one, rare, some, when

# Build flags that conditions of this schedule may use.
FLAGS = {
    name: getattr(gait_controller, name) for name in ("LEGS", "INERTIA_WANTED", "CONTROLLED", "SUPERVISED")
}


def control_gravity(q: list[float], bodies: list[float], gravity: float, torque: list[float]) -> None:
    """Compute the controller model's gravity torques into ``torque``; replaced by the kernel."""
    raise NotImplementedError


def control_inertia(q: list[float], a: list[float], bodies: list[float], torque: list[float]) -> None:
    """Compute the model's inertia torques, armature included, into ``torque``; replaced by the kernel."""
    raise NotImplementedError


def measure_position(board: BoardState, rates: Rates, reading: float, tick: int) -> None:
    """Measure the angle of a joint, and estimate its fast velocity."""
    measure_angle(board.encoder, tick == 0, reading, rates.period, rates.fast_gain)


def sample_velocity(board: BoardState, rates: Rates, tick: int) -> None:
    """Take a sample of the slow velocity of a joint."""
    sample_slowly(board.encoder, tick // rates.decimation, rates.decimation * rates.period)


def walks(controller: ControllerState) -> bool:
    """Check that the monitor has not tripped."""
    return controller.trip.tick < 0


def choose_transition(controller: ControllerState, number: int) -> None:
    """Choose the transition that a leg takes in this tick."""
    leg, other_phase = controller.legs[number], -1
    if LEGS == 2:
        other_phase = controller.legs[1 - number].before
    leg.chosen = next_transition(
        controller.program, leg.before, leg.ticks, controller.signals, other_phase, leg.debounce
    )


def has_chosen(leg: ControlledLeg) -> bool:
    """Check whether a leg takes a transition in this tick."""
    return leg.chosen != NO_TRANSITION


def take_transition(controller: ControllerState, number: int, tick: int) -> None:
    """Enter the phase to which the chosen transition of a leg leads."""
    chosen = controller.legs[number].chosen
    enter_phase(controller, number, controller.program.transitions[chosen].target, tick)


def take_posture(controller: ControllerState, number: int, tick: int) -> None:
    """Enter the phase of a leg that a new mode requires, if there is one."""
    posture = sent_to(controller, number)
    if posture != NO_POSTURE:
        enter_phase(controller, number, posture, tick)


def is_fading(leg: ControlledLeg, tick: int) -> bool:
    """Check whether the parameters of a leg are still being blended into those of its phase."""
    return tick - leg.entry_tick <= leg.blend_ticks[leg.phase]


def compute_gravity(controller: ControllerState) -> None:
    """Compute the gravity torques of the model."""
    if wants_gravity(controller):
        model = controller.model
        control_gravity(model.q, model.bodies, model.gravity, model.gravity_torque)


def compute_inertia(controller: ControllerState) -> None:
    """Compute the inertia torques of the model."""
    model = controller.model
    control_inertia(model.q, model.a, model.bodies, model.inertia_torque)


def take_demand(controller: ControllerState, board: BoardState, number: int) -> None:
    """Copy the gait controller's demand to the board of a joint."""
    copy_demand(controller.joints[number].demand, board.demand)


def is_implausible(board: BoardState) -> bool:
    """Check whether the command of a board is implausible, so that it must not be sent to its drive."""
    return board.command.cause != NO_TRIP


def hold_all(controller: ControllerState, board: BoardState, limits: Limits, number: int, tick: int) -> None:
    """Trip on an implausible command, and hold the joint instead.

    The demand of this tick was computed for walking, so no weight is carried in this tick.
    """
    joint = controller.joints[number]
    trip(controller, tick, board.command.cause, number)
    demand_rest(joint.demand, limits, joint.hold_angle, 0.0, 0.0)
    copy_demand(joint.demand, board.demand)
    ask(board)
    sum_up(board)


def command_current(board: BoardState, limits: Limits) -> None:
    """Set the target current of a drive from its command."""
    set_current(board, limits, board.command.torque)


# ------------------------------------------------------------------ the order of a tick

# Board: angle and fast velocity, at the slow rate also the slow velocity and the friction model.
MEASURE = (
    joints(measure_position),
    when("tick % decimation == 0", joints(when("tick > 0", one_by_one(sample_velocity)), model_friction)),
)
# Board: the monitor of joint and drive.
WATCH_DRIVES = when("watching", joints(watch_drive))
# Gait controller: the monitor.
WATCH = when("watching", watch_supply, legs(watch_leg), rare(has_cause, trip_on_causes))
# Gait controller: the operating modes.
SUPERVISE = when("SUPERVISED", one_by_one(supervise, legs(take_posture)))
# Gait controller: the state machines of both legs on one snapshot, and the blending of their parameters.
WALK = some(
    walks,
    legs(begin_tick),
    legs(write_signals, choose_transition, rare(has_chosen, take_transition)),
    legs(some(is_fading, fade)),
)
# Gait controller: torques of the model.
FEED_FORWARD = (
    some(wants_gravity, joints(pose), compute_gravity),
    when("INERTIA_WANTED", joints(estimate_acceleration), compute_inertia),
)
# Gait controller: the controller that changes the demands.
CHANGE = when("CONTROLLED", rare(walks, change_demands))
DECIDE = (WATCH, SUPERVISE, WALK, *FEED_FORWARD, CHANGE)
# Board and gait controller, joint after joint: a trip on one command takes effect before the next command.
HOLD = rare(is_implausible, hold_all)
COMMAND = (joints(demand, take_demand, ask, check, HOLD, command_current),)
