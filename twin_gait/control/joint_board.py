"""The board of a joint: its firmware in a tick of 1 ms, between encoder, gait controller and drive.

The device has one board for each joint, and one gait controller (:mod:`twin_gait.control.gait_controller`)
for all of them. The simulation and the C firmware run these functions in the order of
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
    MonitorState,
    command_is_plausible,
    hold_torque,
    hold_weight_share,
    monitor_joint,
    motor_speed,
)
from twin_gait.parameters.friction import FrictionParameters


@dataclass(slots=True)
class SamplingConfig:
    """Sampling configuration of the firmware."""

    period: float  # Length of a tick in [s].
    fast_gain: float  # Gain of the fast velocity filter.
    decimation: int  # Number of ticks between two slow samples.
    blend_law: int  # Blending law of the setpoints, see :mod:`twin_gait.core.blending`.


@dataclass(slots=True)
class CommandLimits:
    """Limits of the command of a board."""

    torque: float  # Limit of the torque in [N·m].
    current: float  # Limit of the target current in [A].


@dataclass(slots=True)
class Limits:
    """Timeouts of the gait controller and the boards, and the hold after a trip."""

    phase_ticks: int  # Longest time in a phase in ticks.
    frozen_load_ticks: int  # Longest time in ticks for which a load may be constant in motion.
    controller_timeout: int  # Timeout in ticks for messages of the gait controller at a board.
    board_timeout: int  # Timeout in ticks for messages of a board at the gait controller.
    lowering_ticks: int  # Number of ticks in which a held leg is lowered.
    hold_damping: float  # Damping of a held joint in [N·m·s/rad].


@dataclass(slots=True)
class Measurement:
    """Measurements that a board sends to the gait controller in a tick."""

    angle: float = 0.0  # Measured angle in [rad].
    last_angle: float = 0.0  # Angle of the tick before in [rad].
    velocity: float = 0.0  # Fast velocity estimate in [rad/s].
    last_velocity: float = 0.0  # Fast velocity estimate of the tick before in [rad/s].
    motor_speed: float = 0.0  # Joint speed that the drive estimates in [rad/s].
    cause: int = NO_TRIP  # Cause of a trip that the board has found, see :mod:`twin_gait.core.safety`.


@dataclass(slots=True)
class JointSetpoint:
    """Setpoint of a joint, which the gait controller sends to its board."""

    stiffness: float = 0.0  # k in [N·m/rad].
    damping: float = 0.0  # b in [N·m·s/rad].
    equilibrium: float = 0.0  # θ0 in [rad].
    gain: float = 0.0  # G, gain of the friction compensation.
    gravity: float = 0.0  # Gravity compensation in [N·m]; for a held joint the part that is still carried.
    inertia: float = 0.0  # Inertia compensation in [N·m].
    target: float = 0.0  # Additional torque in [N·m].
    held: bool = False  # Whether the joint is braked and lowered instead.


@dataclass(slots=True)
class Command:
    """Command of a board for its drive in a tick, computed from the setpoint, in the walk or in the hold."""

    impedance: float = 0.0  # Torque of spring and damper, or of the brake, in [N·m].
    friction: float = 0.0  # Friction compensation in [N·m].
    torque: float = 0.0  # Sum of these and of the feed-forward torques, before limits, in [N·m].
    target_current: float = 0.0  # Target current of the drive in [A].
    # Whether the drive is permanently switched off because it did not follow its target.
    drive_off: bool = False
    cause: int = NO_TRIP  # Cause of a trip if the command is implausible.


@dataclass(slots=True)
class BoardState:
    """State of a board."""

    encoder: Encoder  # Encoder with its velocity estimates.
    motor: Motor  # Motor and gear as modelled in the board.
    friction_model: FrictionParameters  # Friction model of the compensator.
    limits: CommandLimits  # Limits of the command.
    bounds: Bounds  # Bounds of the monitor.
    monitor: MonitorState = field(default_factory=MonitorState)  # State of the monitor.
    # Last setpoint received from the gait controller, or that of the hold.
    setpoint: JointSetpoint = field(default_factory=JointSetpoint)
    command: Command = field(default_factory=Command)  # Command of this tick.
    model_friction: float = 0.0  # Torque of the compensator's model at the slow velocity in [N·m].
    cause: int = NO_TRIP  # First cause of a trip that the board has found itself.
    # Ticks for which it has held its joint without the gait controller; this is never reset.
    hold_ticks: int = 0
    hold_gravity_torque: float = 0.0  # Gravity torque in [N·m] at the start of that hold.
    ticks_since_message: int = 0  # Ticks since the last message of the gait controller.


def update_model_friction(board: BoardState) -> None:
    """Update the torque of the compensator's friction model, which changes only with the slow velocity."""
    velocity, law = board.encoder.velocity_slow, board.friction_model
    board.model_friction = rotational_friction_torque(
        velocity, law.breakaway_torque, law.coulomb_friction, law.breakaway_velocity, law.viscous_friction
    )


def monitor_drive(board: BoardState, rates: SamplingConfig) -> None:
    """Store the cause of a trip found on joint and drive; switch off a drive that ignores its target."""
    deviation, gain = command_deviation(board), board.bounds.command_gain
    board.monitor.command_deviation = first_order_step(board.monitor.command_deviation, deviation, gain)
    cause = monitor_joint(board.bounds, board.monitor, board.encoder, rates.period)
    board.cause = cause if board.cause == NO_TRIP else board.cause
    # This is independent of any cause found earlier.
    broken = board.monitor.drive_streak >= board.bounds.drive_ticks
    board.command.drive_off = board.command.drive_off or broken


def command_deviation(board: BoardState) -> float:
    """Compute the deviation in [N·m] of the last command from its setpoint at the present measurement.

    This second computation reads the encoder a tick after the first one, so that it shares no sample with it.
    In normal operation the deviation is the change of the spring and damper torque in a tick; a sudden change
    by ΔT adds at most ΔT times ``command_gain`` to the filtered deviation. A held joint has no setpoint, and
    a deviation of 0.
    """
    if board.setpoint.held:
        return 0.0
    friction = board.setpoint.gain * board.model_friction
    return board.monitor.last_command - total_torque(board.setpoint, spring_torque(board), friction)


def write_measurement(board: BoardState, measurement: Measurement) -> None:
    """Write the measurements and the first cause of a trip to ``measurement``, in place."""
    encoder = board.encoder
    measurement.angle = encoder.angle
    measurement.last_angle = encoder.last_angle
    measurement.velocity = encoder.velocity_fast
    measurement.last_velocity = encoder.last_fast
    measurement.motor_speed = board.monitor.motor_speed
    measurement.cause = board.cause


def copy_measurement(source: Measurement, target: Measurement) -> None:
    """Copy the values of a measurement to ``target``."""
    target.angle = source.angle
    target.last_angle = source.last_angle
    target.velocity = source.velocity
    target.last_velocity = source.last_velocity
    target.motor_speed = source.motor_speed
    target.cause = source.cause


def copy_joint_setpoint(source: JointSetpoint, target: JointSetpoint) -> None:
    """Copy the values of a setpoint to ``target``."""
    target.stiffness = source.stiffness
    target.damping = source.damping
    target.equilibrium = source.equilibrium
    target.gain = source.gain
    target.gravity = source.gravity
    target.inertia = source.inertia
    target.target = source.target
    target.held = source.held


def copy_command(source: Command, target: Command) -> None:
    """Copy the values of a command to ``target``."""
    target.impedance = source.impedance
    target.friction = source.friction
    target.torque = source.torque
    target.target_current = source.target_current
    target.drive_off = source.drive_off
    target.cause = source.cause


def spring_torque(board: BoardState) -> float:
    """Compute the torque of the setpoint's spring and damper at the present measurement in [N·m]."""
    encoder, setpoint = board.encoder, board.setpoint
    return impedance_torque(
        encoder.angle, encoder.velocity_fast, setpoint.stiffness, setpoint.damping, setpoint.equilibrium
    )


def total_torque(setpoint: JointSetpoint, impedance: float, friction: float) -> float:
    """Compute the sum of two torques of a board and of the feed-forward torques, all in [N·m]."""
    return impedance + friction + setpoint.gravity + setpoint.inertia + setpoint.target


def compute_torque(board: BoardState) -> None:
    """Compute impedance torque and friction compensation of the command, or the brake of a held joint."""
    command, setpoint = board.command, board.setpoint
    if setpoint.held:
        command.impedance, command.friction = hold_torque(board.monitor.motor_speed, setpoint.damping), 0.0
    else:
        command.impedance = spring_torque(board)
        command.friction = setpoint.gain * board.model_friction


def update_total_torque(board: BoardState) -> None:
    """Compute the total torque of the command."""
    command = board.command
    command.torque = total_torque(board.setpoint, command.impedance, command.friction)


def check_command(board: BoardState, watching: bool) -> None:
    """Compute the total torque of the command, and set the cause of a trip if it is implausible."""
    update_total_torque(board)
    command = board.command
    wild = watching and not board.setpoint.held
    wild = wild and not command_is_plausible(command.torque, board.bounds.highest_command)
    command.cause = COMMAND_TRIP if wild else NO_TRIP


def receive(board: BoardState, limits: Limits, setpoint: JointSetpoint, received: bool) -> None:
    """Store a setpoint that arrived over the bus; after a timeout or trip, hold the joint without it.

    ``setpoint``: setpoint of the last message. ``received``: whether a message has arrived in this tick.
    """
    board.ticks_since_message = 0 if received else board.ticks_since_message + 1
    if board.ticks_since_message > limits.controller_timeout and board.cause == NO_TRIP:
        board.cause = BUS_TRIP  # The gait controller trips as well when it receives this cause.
    if board.cause != NO_TRIP:
        hold_joint(board, limits)
    elif received:
        copy_joint_setpoint(setpoint, board.setpoint)


def execute(board: BoardState, limits: Limits, watching: bool) -> None:
    """Compute the command from the setpoint; hold the joint at once if the command is implausible."""
    compute_torque(board)
    check_command(board, watching)
    if board.command.cause != NO_TRIP:
        reject_command(board, limits)


def reject_command(board: BoardState, limits: Limits) -> None:
    """Replace an implausible command by the hold of the joint, and set an implausible gravity torque to 0."""
    board.cause = board.command.cause
    if not command_is_plausible(board.setpoint.gravity, board.bounds.highest_command):
        board.setpoint.gravity = 0.0
    hold_joint(board, limits)
    compute_torque(board)
    update_total_torque(board)


def hold_joint(board: BoardState, limits: Limits) -> None:
    """Set the board's own setpoint: brake, and carry a decreasing share of the last gravity torque."""
    if board.hold_ticks == 0:
        board.hold_gravity_torque = board.setpoint.gravity
    share = hold_weight_share(board.hold_ticks, limits.lowering_ticks)
    set_hold_setpoint(board.setpoint, limits, board.encoder.angle, share, board.hold_gravity_torque)
    board.hold_ticks += 1


def set_hold_setpoint(
    setpoint: JointSetpoint, limits: Limits, angle: float, support: float, weight: float
) -> None:
    """Set a setpoint that brakes a joint and lowers it slowly.

    ``angle``: angle of the joint at the start of the hold, in [rad]. ``support``: share of the gravity torque
    that is still compensated, 1 falling to 0. ``weight``: gravity torque in [N·m].
    """
    setpoint.stiffness, setpoint.damping, setpoint.gain = 0.0, limits.hold_damping, 0.0
    setpoint.equilibrium = angle
    setpoint.gravity = support * weight if support != 0.0 else 0.0
    setpoint.inertia, setpoint.target = 0.0, 0.0
    setpoint.held = True


def set_current(board: BoardState, torque: float) -> None:
    """Set the drive's target current for a torque in [N·m], within the limits; NaN gives 0."""
    current = target_current(board.motor, torque, board.limits.torque, board.limits.current)
    board.command.target_current = 0.0 if board.command.drive_off or torque != torque else current


def store_drive_state(board: BoardState, voltage: float, current: float, deviation: float) -> None:
    """Store the state of the drive in this tick for the monitor.

    ``voltage`` of the winding in [V], ``current`` in [A], and ``deviation`` of the current from its expected
    value in [A].
    """
    watched, bounds = board.monitor, board.bounds
    watched.last_command = board.command.torque
    watched.motor_current = current
    watched.current_deviation = deviation
    watched.motor_speed = motor_speed(voltage, current, bounds.emf_constant, bounds.model_resistance)
