"""The board of a joint: what its firmware does in a tick of 1 ms, between encoder, gait controller and drive.

The device has one for each joint, and one gait controller (:mod:`twin_gait.control.gait_controller`) for all
of them. The simulation and the C firmware run these functions in the order of
:mod:`twin_gait.control.device_schedule`.
"""

from dataclasses import dataclass, field

from twin_gait.core.actuator import Motor
from twin_gait.core.control_tick import Encoder, target_current
from twin_gait.core.estimation import first_order_step
from twin_gait.core.friction import rotational_friction_torque
from twin_gait.core.impedance import impedance_torque
from twin_gait.core.safety import (
    BUS_TRIP,
    COMMAND_TRIP,
    NO_TRIP,
    Bounds,
    Watched,
    command_is_plausible,
    hold_torque,
    motor_speed,
    support_share,
    watch_joint,
)
from twin_gait.parameters import FrictionParameters


@dataclass(slots=True)
class Rates:
    """How the firmware samples."""

    period: float  # Length of a tick in [s].
    fast_gain: float  # Of the fast velocity filter.
    decimation: int  # Ticks between two slow samples.
    blend_law: int  # Of the setpoints, see :mod:`twin_gait.core.blending`.


@dataclass(slots=True)
class Limits:
    """What bounds the command, and how long the gait controller bears something."""

    torque: float  # Of the command in [N m].
    current: float  # Of the drives in [A].
    phase_ticks: int  # Longest time in a phase.
    frozen_load_ticks: int  # Longest time for which a load may stand still.
    controller_silence: int  # Longest time in ticks for which a board bears not to hear the gait controller.
    board_silence: int  # For which the gait controller bears not to hear a board.
    lowering_ticks: int  # In which a held leg is lowered.
    hold_damping: float  # Of a held joint in [N m s] / [rad].


@dataclass(slots=True)
class Measurement:
    """What a board tells the gait controller in a tick."""

    angle: float = 0.0  # Measured in [rad].
    last_angle: float = 0.0  # Of the tick before.
    velocity: float = 0.0  # Fast estimate in [rad] / [s].
    last_velocity: float = 0.0  # Of the tick before.
    motor_speed: float = 0.0  # Joint speed that the drive infers in [rad] / [s].
    cause: int = NO_TRIP  # Of a trip that the board has found, see :mod:`twin_gait.core.safety`.


@dataclass(slots=True)
class Demand:
    """What the gait controller asks of a board."""

    stiffness: float = 0.0  # k in [N m] / [rad].
    damping: float = 0.0  # b in [N m s] / [rad].
    equilibrium: float = 0.0  # θ0 in [rad].
    gain: float = 0.0  # G, of the friction compensation.
    gravity: float = 0.0  # Compensation in [N m]; of a held joint what is still carried.
    inertia: float = 0.0  # Compensation in [N m].
    target: float = 0.0  # Torque that is added in [N m].
    held: bool = False  # Whether the joint is braked and let down instead.


@dataclass(slots=True)
class Command:
    """What a board makes of a demand in a tick, in the walk or in the hold, and asks of its drive."""

    impedance: float = 0.0  # Torque of spring and damper, or of the brake, in [N m].
    friction: float = 0.0  # Compensation in [N m].
    torque: float = 0.0  # Sum of these and of what is fed forward, before limits, in [N m].
    target_current: float = 0.0  # That the drive is asked for in [A].
    drive_off: bool = False  # Whether the drive is cut off for good, since it has not obeyed.
    cause: int = NO_TRIP  # Of a trip, if no drive may be asked for what is demanded.


@dataclass(slots=True)
class BoardState:
    """Everything that a board keeps."""

    encoder: Encoder  # With its velocity estimates.
    motor: Motor  # Motor and gear as the board knows them.
    friction_model: FrictionParameters  # Of the compensator.
    bounds: Bounds  # Of the monitor.
    watched: Watched = field(default_factory=Watched)  # What the monitor remembers.
    demand: Demand = field(default_factory=Demand)  # Last heard from the gait controller.
    command: Command = field(default_factory=Command)  # Of this tick.
    model_friction: float = 0.0  # Torque of the compensator's model at the slow velocity in [N m].
    cause: int = NO_TRIP  # First one of a trip that the board has found itself.
    alone_ticks: int = 0  # For how long it has held its joint without the gait controller, then for good.
    carried: float = 0.0  # Torque in [N m] that was fed forward as that began.
    silent_ticks: int = 0  # Since the gait controller was heard.


def model_friction(board: BoardState) -> None:
    """Friction of the compensator's model, which changes only with the slow velocity."""
    velocity, law = board.encoder.velocity_slow, board.friction_model
    board.model_friction = rotational_friction_torque(
        velocity, law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity, law.viscous_friction
    )


def watch_drive(board: BoardState, rates: Rates) -> None:
    """Note the cause of a trip that is found on joint and drive; cut off a drive that does not obey."""
    deviation, gain = command_deviation(board), board.bounds.command_gain
    board.watched.command_deviation = first_order_step(board.watched.command_deviation, deviation, gain)
    cause = watch_joint(board.bounds, board.watched, board.encoder, rates.period)
    board.cause = cause if board.cause == NO_TRIP else board.cause
    # Whatever else was found first.
    broken = board.watched.drive_streak >= board.bounds.drive_ticks
    board.command.drive_off = board.command.drive_off or broken


def command_deviation(board: BoardState) -> float:
    """Compute the deviation of the last command from its set point at the present measurement in [N m].

    This second computation reads the encoder a tick after the first one, so that it shares no sample with it.
    In normal operation the deviation is the change of the spring and damper torque in a tick; a sudden change
    by ΔT adds at most ΔT times ``command_gain`` to the filtered deviation. A held joint has no set point, and
    a deviation of 0.
    """
    if board.demand.held:
        return 0.0
    friction = board.demand.gain * board.model_friction
    return board.watched.commanded - total_torque(board.demand, spring_torque(board), friction)


def report(board: BoardState, measurement: Measurement) -> None:
    """Tell what was measured, and the first cause of a trip; ``measurement`` is changed in place."""
    encoder = board.encoder
    measurement.angle = encoder.angle
    measurement.last_angle = encoder.last_angle
    measurement.velocity = encoder.velocity_fast
    measurement.last_velocity = encoder.last_fast
    measurement.motor_speed = board.watched.motor_speed
    measurement.cause = board.cause


def copy_measurement(source: Measurement, target: Measurement) -> None:
    """Give a measurement the values of another; ``target`` is changed in place."""
    target.angle = source.angle
    target.last_angle = source.last_angle
    target.velocity = source.velocity
    target.last_velocity = source.last_velocity
    target.motor_speed = source.motor_speed
    target.cause = source.cause


def copy_demand(source: Demand, target: Demand) -> None:
    """Give a demand the values of another; ``target`` is changed in place."""
    target.stiffness = source.stiffness
    target.damping = source.damping
    target.equilibrium = source.equilibrium
    target.gain = source.gain
    target.gravity = source.gravity
    target.inertia = source.inertia
    target.target = source.target
    target.held = source.held


def copy_command(source: Command, target: Command) -> None:
    """Give a command the values of another; ``target`` is changed in place."""
    target.impedance = source.impedance
    target.friction = source.friction
    target.torque = source.torque
    target.target_current = source.target_current
    target.drive_off = source.drive_off
    target.cause = source.cause


def spring_torque(board: BoardState) -> float:
    """Compute the torque of the demanded spring and damper at the present measurement in [N m]."""
    encoder, demand = board.encoder, board.demand
    return impedance_torque(
        encoder.angle, encoder.velocity_fast, demand.stiffness, demand.damping, demand.equilibrium
    )


def total_torque(demand: Demand, impedance: float, friction: float) -> float:
    """Compute the sum of two torques of a board and of the torques that are fed forward, all in [N m]."""
    return impedance + friction + demand.gravity + demand.inertia + demand.target


def ask(board: BoardState) -> None:
    """Impedance on friction compensation, or the brake of a held joint."""
    asked, demand = board.command, board.demand
    if demand.held:
        asked.impedance, asked.friction = hold_torque(board.watched.motor_speed, demand.damping), 0.0
    else:
        asked.impedance = spring_torque(board)
        asked.friction = demand.gain * board.model_friction


def sum_up(board: BoardState) -> None:
    """Sum the torques of the command up."""
    asked = board.command
    asked.torque = total_torque(board.demand, asked.impedance, asked.friction)


def check(board: BoardState, watching: bool) -> None:
    """Sum the command up, and note the cause of a trip if the drive may not be asked for it."""
    sum_up(board)
    asked = board.command
    wild = watching and not board.demand.held
    wild = wild and not command_is_plausible(asked.torque, board.bounds.highest_command)
    asked.cause = COMMAND_TRIP if wild else NO_TRIP


def hear(board: BoardState, limits: Limits, demand: Demand, heard: bool) -> None:
    """Take what the gait controller demands over the bus; hold the joint alone where that cannot be."""
    board.silent_ticks = 0 if heard else board.silent_ticks + 1
    if board.silent_ticks > limits.controller_silence and board.cause == NO_TRIP:
        board.cause = BUS_TRIP  # so that the gait controller, if it hears the board, does not walk on
    if board.cause != NO_TRIP:
        hold_alone(board, limits)
    elif heard:
        copy_demand(demand, board.demand)


def obey(board: BoardState, limits: Limits, watching: bool) -> None:
    """Command what is demanded; hold the joint at once if that is wild."""
    ask(board)
    check(board, watching)
    if board.command.cause != NO_TRIP:
        refuse(board, limits)


def refuse(board: BoardState, limits: Limits) -> None:
    """Hold the joint alone instead of commanding what is wild, and carry no weight that is."""
    board.cause = board.command.cause
    if not command_is_plausible(board.demand.gravity, board.bounds.highest_command):
        board.demand.gravity = 0.0
    hold_alone(board, limits)
    ask(board)
    sum_up(board)


def hold_alone(board: BoardState, limits: Limits) -> None:
    """Demand of oneself to brake, and to carry less and less of what was fed forward last."""
    if board.alone_ticks == 0:
        board.carried = board.demand.gravity
    share = support_share(board.alone_ticks, limits.lowering_ticks)
    demand_rest(board.demand, limits, board.encoder.angle, share, board.carried)
    board.alone_ticks += 1


def demand_rest(demand: Demand, limits: Limits, angle: float, support: float, weight: float) -> None:
    """Demand that a joint is braked and let down slowly.

    ``angle``: where it is held, in [rad]. ``support``: share of the weight that is still carried. ``weight``:
    torque in [N m].
    """
    demand.stiffness, demand.damping, demand.gain = 0.0, limits.hold_damping, 0.0
    demand.equilibrium = angle
    demand.gravity = support * weight if support != 0.0 else 0.0
    demand.inertia, demand.target = 0.0, 0.0
    demand.held = True


def set_current(board: BoardState, limits: Limits, torque: float) -> None:
    """Ask the drive for the current of a torque in [N m], within the limits; NaN asks for none."""
    current = target_current(board.motor, torque, limits.torque, limits.current)
    board.command.target_current = 0.0 if board.command.drive_off or torque != torque else current


def note_drive(board: BoardState, voltage: float, current: float, deviation: float) -> None:
    """Keep for the monitor what the drive did in this tick.

    Winding's voltage in [V], current in [A], ``deviation`` of it from what the drive should give in [A].
    """
    watched, bounds = board.watched, board.bounds
    watched.commanded = board.command.torque
    watched.motor_current = current
    watched.current_deviation = deviation
    watched.motor_speed = motor_speed(voltage, current, bounds.emf_constant, bounds.model_resistance)
