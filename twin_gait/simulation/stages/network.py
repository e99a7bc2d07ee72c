"""Steps of the network: messages between boards, soles and gait controller, immediate or over the bus.

Over the bus the gait controller receives measurements, and the boards receive setpoints. Both use the values
received last, rounded to the resolution of the frames. Load sensors are connected to the lowest board of each
leg, the sensor of the bus voltage to the gait controller. At the start the gait controller has the angles of
the legs; a board that has not received a setpoint yet commands no torque.
"""

from twin_gait.control.gait_controller import N_JOINTS_PER_LEG, check_board_timeout, receive_load, trip
from twin_gait.control.joint_board import receive
from twin_gait.core.can_bus import REBOOT, Frame, is_release_due
from twin_gait.core.can_bus import advance as carry  # a name of its own in the schedule
from twin_gait.core.can_codec import pack_frame, unpack_frame
from twin_gait.core.impedance import impedance_torque
from twin_gait.core.safety import BUS_TRIP, DRIVE_TRIP, NO_TRIP
from twin_gait.network.messages import CODES, COUNTS, MEASUREMENT, SETPOINT
from twin_gait.simulation.build_flags import N_POINTS_PER_FOOT, WITH_CENTRAL_IMPEDANCE
from twin_gait.simulation.episode import CanChannel, Episode

# Indices of the signals of a measurement and of a setpoint, and codes of the state in a setpoint.
ANGLE, VELOCITY, CURRENT, FOOT_LOAD, CAUSE, COUNTER = map(
    list(MEASUREMENT).index, ("angle", "velocity", "current", "foot_load", "trip_cause", "counter")
)
STIFFNESS, DAMPING, EQUILIBRIUM, GAIN, TORQUE, STATE, NUMBER = map(
    list(SETPOINT).index, ("stiffness", "damping", "equilibrium", "gain", "torque", "state", "counter")
)
HOLD, RUN = (float(CODES["state"].index(state)) for state in ("hold", "run"))
_CCU = 0  # Number of the node of the central unit.


def receive_foot_load(e: Episode, number: int) -> None:
    """Pass the load of the foot of a leg to the gait controller."""
    receive_load(e.controller, number, e.feet[e.soles[number]].load)


def receive_bus_voltage(e: Episode) -> None:
    """Pass the bus voltage to the gait controller."""
    e.controller.supply.voltage = e.supply.bus_voltage


def _receive(e: Episode, channel: CanChannel, tick: int) -> bool:
    """Return whether a receiver receives a frame in this tick, and unpack the frame into the buffer.

    The age of the values that the receiver uses is counted.
    """
    arrival = tick - e.network.delay
    received = channel.received[arrival % len(channel.received)]
    arrived = arrival > 0 and received.tick == arrival
    if arrived:
        unpack_frame(channel.layout, received.halves, e.network.numbers)
        channel.written_tick = received.written
    channel.age_sum += tick - channel.written_tick
    channel.max_age = max(channel.max_age, tick - channel.written_tick)
    return arrived


def receive_measurement(e: Episode, number: int, tick: int) -> None:
    """Receive the measurement of a board over the bus, if there is one in this tick."""
    controller, numbers = e.controller, e.network.numbers
    measured = controller.joints[number].measurement
    arrived = _receive(e, e.network.measurements[number], tick)
    measured.last_angle, measured.last_velocity = measured.angle, measured.velocity
    if arrived:
        measured.angle, measured.velocity = numbers[ANGLE], numbers[VELOCITY]
        measured.motor_speed = numbers[VELOCITY]  # the frame has no signal for the speed from the drive
        if measured.cause == NO_TRIP:
            measured.cause = int(numbers[CAUSE])
        if N_POINTS_PER_FOOT > 0 and (number + 1) % N_JOINTS_PER_LEG == 0:
            receive_load(controller, number // N_JOINTS_PER_LEG, numbers[FOOT_LOAD])
    check_board_timeout(controller, e.limits, number, arrived)


def receive_setpoint(e: Episode, number: int, tick: int) -> None:
    """Receive the setpoint of a board over the bus, if there is one in this tick, and execute it."""
    numbers, setpoint = e.network.numbers, e.joints[number].received_setpoint
    arrived = _receive(e, e.network.setpoints[number], tick)
    if arrived:
        setpoint.stiffness, setpoint.damping = numbers[STIFFNESS], numbers[DAMPING]
        setpoint.equilibrium, setpoint.gain = numbers[EQUILIBRIUM], numbers[GAIN]
        setpoint.held = numbers[STATE] != RUN
        # If the board computes the spring, the torque of the frame is the whole feed-forward.
        given = WITH_CENTRAL_IMPEDANCE and not setpoint.held
        setpoint.gravity = 0.0 if given else numbers[TORQUE]
        setpoint.target = numbers[TORQUE] if given else 0.0
    receive(e.joints[number].board, e.limits, setpoint, arrived)


def send_frames(e: Episode, number: int, tick: int) -> None:
    """Write the frames that are due, to and from a board."""
    _send_setpoint(e, number, tick)
    _send_measurement(e, number, tick)


def carry_frames(e: Episode, tick: int) -> None:
    """Simulate the transmission of frames on the bus until the next tick."""
    carry(e.network.bus, tick)


def store_frames(e: Episode, number: int, tick: int) -> None:
    """Store the frames to and from a board that arrive until the next tick."""
    _store_frame(e, e.network.setpoints[number], tick + 1)
    _store_frame(e, e.network.measurements[number], tick + 1)


def _store_frame(e: Episode, channel: CanChannel, tick: int) -> None:
    """Store an arrived frame in the ring buffer of its channel until it is used."""
    frame, received = e.network.bus.frames[channel.frame], channel.received[tick % len(channel.received)]
    received.tick = 0
    if frame.arrived == tick:
        received.tick, received.written = tick, frame.received.tick
        received.halves[0], received.halves[1] = frame.received.halves[0], frame.received.halves[1]


def _count(frame: Frame) -> float:
    return float(frame.event // frame.period % COUNTS)


def _send_setpoint(e: Episode, number: int, tick: int) -> None:
    """Write the setpoint frame of a board, if it is due."""
    network, joint, wire = e.network, e.controller.joints[number], e.network.setpoints[number]
    frame = network.bus.frames[wire.frame]
    if is_release_due(network.bus, frame, tick):
        setpoint, numbers = joint.setpoint, network.numbers
        stiffness, damping = setpoint.stiffness, setpoint.damping
        torque = setpoint.gravity + setpoint.inertia + setpoint.target
        if WITH_CENTRAL_IMPEDANCE and not setpoint.held:
            angle, velocity = joint.measurement.angle, joint.measurement.velocity
            torque += impedance_torque(angle, velocity, stiffness, damping, setpoint.equilibrium)
            stiffness, damping = 0.0, 0.0
        numbers[STIFFNESS], numbers[DAMPING], numbers[EQUILIBRIUM] = stiffness, damping, setpoint.equilibrium
        numbers[GAIN], numbers[TORQUE] = setpoint.gain, torque
        numbers[STATE] = HOLD if setpoint.held else RUN
        numbers[NUMBER] = _count(frame)
        pack_frame(wire.layout, numbers, frame.outgoing.halves)


def _send_measurement(e: Episode, number: int, tick: int) -> None:
    """Write the measurement frame of a board, if it is due."""
    network, joint, wire = e.network, e.joints[number], e.network.measurements[number]
    frame = network.bus.frames[wire.frame]
    if is_release_due(network.bus, frame, tick):
        encoder, numbers = joint.board.encoder, network.numbers
        numbers[ANGLE], numbers[VELOCITY] = encoder.angle, encoder.velocity_fast
        numbers[CURRENT], numbers[CAUSE] = joint.current, joint.board.cause
        numbers[FOOT_LOAD] = 0.0
        if N_POINTS_PER_FOOT > 0 and (number + 1) % N_JOINTS_PER_LEG == 0:
            numbers[FOOT_LOAD] = e.feet[e.soles[number // N_JOINTS_PER_LEG]].load
        numbers[COUNTER] = _count(frame)
        pack_frame(wire.layout, numbers, frame.outgoing.halves)


def reboot(e: Episode, tick: int) -> None:
    """Mark the boards that are rebooting; a board that restarted stays in the safe hold.

    A board that reboots holds its joint and reports a failed drive; a reboot of the central unit is a trip.
    Encoders are absolute, and their filters continue: the time in which they settle is not simulated.
    """
    bus = e.network.bus
    for index in range(bus.next_outage):
        outage = bus.outages[index]
        if outage.kind == REBOOT and outage.node == _CCU:
            trip(e.controller, tick, BUS_TRIP, -1)
        elif outage.kind == REBOOT:
            for number in range(len(e.joints)):
                joint = e.joints[number]
                if bus.frames[e.network.measurements[number].frame].sender == outage.node:
                    joint.off = tick * bus.tick < outage.end
                    joint.board.cause = DRIVE_TRIP if joint.board.cause == NO_TRIP else joint.board.cause
