"""Steps of the network: messages between boards, soles and gait controller, immediate or over the bus.

Over the bus the gait controller receives measurements, and the boards receive setpoints. Both use the values
received last, rounded to the resolution of the frames. Load sensors are connected to the boards of the knees,
the sensor of the bus voltage to the gait controller. At the start the gait controller has the angles of the
legs; a board that has not received a setpoint yet commands no torque.
"""

from twin_gait.control.gait_controller import JOINTS_PER_LEG, hear_board, hear_load, trip
from twin_gait.control.joint_board import hear
from twin_gait.core.can_bus import REBOOT, Frame, is_due
from twin_gait.core.can_bus import advance as carry  # every step needs a unique name in the schedule
from twin_gait.core.can_codec import pack_frame, unpack_frame
from twin_gait.core.impedance import impedance_torque
from twin_gait.core.safety import BUS_TRIP, DRIVE_TRIP, NO_TRIP
from twin_gait.network.messages import CODES, COUNTS, MEASUREMENT, SETPOINT
from twin_gait.simulation.episode import Episode, Wire
from twin_gait.simulation.structure import CENTRAL, POINTS_PER_FOOT

# Indices of the signals of a measurement and of a setpoint, and codes of the state in a setpoint.
ANGLE, VELOCITY, CURRENT, FOOT_LOAD, CAUSE, COUNTER = map(
    list(MEASUREMENT).index, ("angle", "velocity", "current", "foot_load", "trip_cause", "counter")
)
STIFFNESS, DAMPING, EQUILIBRIUM, GAIN, TORQUE, STATE, NUMBER = map(
    list(SETPOINT).index, ("stiffness", "damping", "equilibrium", "gain", "torque", "state", "counter")
)
HOLD, RUN = (float(CODES["state"].index(state)) for state in ("hold", "run"))
_CCU = 0  # Number of the node of the central unit.


def hear_sole(e: Episode, number: int) -> None:
    """Pass the load of a foot to the gait controller."""
    hear_load(e.controller, number, e.soles[number].load)


def hear_supply(e: Episode) -> None:
    """Pass the bus voltage to the gait controller."""
    e.controller.supply.voltage = e.supply.bus_voltage


def _receive(e: Episode, wire: Wire, tick: int) -> bool:
    """Return whether a receiver receives a frame in this tick, and unpack the frame into the buffer.

    The age of the values that the receiver uses is counted.
    """
    came = tick - e.network.delay
    received = wire.received[came % len(wire.received)]
    heard = came > 0 and received.tick == came
    if heard:
        unpack_frame(wire.layout, received.halves, e.network.numbers)
        wire.written = received.written
    wire.ages += tick - wire.written
    wire.oldest = max(wire.oldest, tick - wire.written)
    return heard


def hear_measurement(e: Episode, number: int, tick: int) -> None:
    """Receive the measurement of a board over the bus, if there is one in this tick."""
    controller, numbers = e.controller, e.network.numbers
    measured, heard = controller.joints[number].measurement, _receive(e, e.network.measurements[number], tick)
    measured.last_angle, measured.last_velocity = measured.angle, measured.velocity
    if heard:
        measured.angle, measured.velocity = numbers[ANGLE], numbers[VELOCITY]
        measured.motor_speed = numbers[VELOCITY]  # the frame has no signal for the speed from the drive
        if measured.cause == NO_TRIP:
            measured.cause = int(numbers[CAUSE])
        if POINTS_PER_FOOT > 0 and (number + 1) % JOINTS_PER_LEG == 0:
            hear_load(controller, number // JOINTS_PER_LEG, numbers[FOOT_LOAD])
    hear_board(controller, e.limits, number, heard)


def hear_setpoint(e: Episode, number: int, tick: int) -> None:
    """Receive the setpoint of a board over the bus, if there is one in this tick, and execute it."""
    numbers, heard = e.network.numbers, e.joints[number].heard
    came = _receive(e, e.network.setpoints[number], tick)
    if came:
        heard.stiffness, heard.damping = numbers[STIFFNESS], numbers[DAMPING]
        heard.equilibrium, heard.gain = numbers[EQUILIBRIUM], numbers[GAIN]
        heard.held = numbers[STATE] != RUN
        # If the board computes the spring, the torque of the frame is the whole feed-forward.
        given = CENTRAL and not heard.held
        heard.gravity = 0.0 if given else numbers[TORQUE]
        heard.target = numbers[TORQUE] if given else 0.0
    hear(e.joints[number].board, e.limits, heard, came)


def send_frames(e: Episode, number: int, tick: int) -> None:
    """Write the frames that are due, to and from a board."""
    _send_setpoint(e, number, tick)
    _send_measurement(e, number, tick)


def carry_frames(e: Episode, tick: int) -> None:
    """Simulate the transmission of frames on the bus until the next tick."""
    carry(e.network.bus, tick)


def keep_frames(e: Episode, number: int, tick: int) -> None:
    """Store the frames to and from a board that arrive until the next tick."""
    _arrive(e, e.network.setpoints[number], tick + 1)
    _arrive(e, e.network.measurements[number], tick + 1)


def _arrive(e: Episode, wire: Wire, tick: int) -> None:
    """Store an arrived frame in the ring buffer of its channel until it is used."""
    frame, received = e.network.bus.frames[wire.frame], wire.received[tick % len(wire.received)]
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
    if is_due(network.bus, frame, tick):
        asked, numbers = joint.demand, network.numbers
        stiffness, damping = asked.stiffness, asked.damping
        torque = asked.gravity + asked.inertia + asked.target
        if CENTRAL and not asked.held:
            angle, velocity = joint.measurement.angle, joint.measurement.velocity
            torque += impedance_torque(angle, velocity, stiffness, damping, asked.equilibrium)
            stiffness, damping = 0.0, 0.0
        numbers[STIFFNESS], numbers[DAMPING], numbers[EQUILIBRIUM] = stiffness, damping, asked.equilibrium
        numbers[GAIN], numbers[TORQUE] = asked.gain, torque
        numbers[STATE] = HOLD if asked.held else RUN
        numbers[NUMBER] = _count(frame)
        pack_frame(wire.layout, numbers, frame.outgoing.halves)


def _send_measurement(e: Episode, number: int, tick: int) -> None:
    """Write the measurement frame of a board, if it is due."""
    network, joint, wire = e.network, e.joints[number], e.network.measurements[number]
    frame = network.bus.frames[wire.frame]
    if is_due(network.bus, frame, tick):
        encoder, numbers = joint.board.encoder, network.numbers
        numbers[ANGLE], numbers[VELOCITY] = encoder.angle, encoder.velocity_fast
        numbers[CURRENT], numbers[CAUSE] = joint.current, joint.board.cause
        numbers[FOOT_LOAD] = 0.0
        if POINTS_PER_FOOT > 0 and (number + 1) % JOINTS_PER_LEG == 0:
            numbers[FOOT_LOAD] = e.soles[number // JOINTS_PER_LEG].load
        numbers[COUNTER] = _count(frame)
        pack_frame(wire.layout, numbers, frame.outgoing.halves)


def reboot(e: Episode, tick: int) -> None:
    """Mark the boards that are rebooting; a board that restarted stays in the safe hold.

    A board that reboots holds its joint and reports a failed drive; a reboot of the central unit is a trip.
    Encoders are absolute, and their filters continue: the time in which they settle is not simulated.
    """
    bus = e.network.bus
    for place in range(bus.next_outage):
        outage = bus.outages[place]
        if outage.kind == REBOOT and outage.node == _CCU:
            trip(e.controller, tick, BUS_TRIP, -1)
        elif outage.kind == REBOOT:
            for number in range(len(e.joints)):
                joint = e.joints[number]
                if bus.frames[e.network.measurements[number].frame].sender == outage.node:
                    joint.off = tick * bus.tick < outage.end
                    joint.board.cause = DRIVE_TRIP if joint.board.cause == NO_TRIP else joint.board.cause
