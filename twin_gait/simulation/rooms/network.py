"""What boards, soles and gait controller tell each other in a tick: at once, or over the bus.

Over the bus the gait controller hears measurements, and the boards set points, as they came last, rounded to
the steps of their frames. Load sensors are wired to the boards of the knees, the sensor of the bus voltage to
the gait controller.
"""

from __future__ import annotations

from twin_gait.control.gait_controller import JOINTS_PER_LEG, hear_board, hear_load
from twin_gait.control.joint_board import report
from twin_gait.core.can_bus import REBOOT, advance, is_due
from twin_gait.core.can_codec import pack_frame, unpack_frame
from twin_gait.core.impedance import impedance_torque
from twin_gait.core.safety import DRIVE_TRIP, NO_TRIP
from twin_gait.simulation.episode import Episode, Wire
from twin_gait.simulation.interface import CENTRAL, NETWORKED, POINTS_PER_FOOT, each, lanes

# Numbers of a measurement, and of a set point (twin_gait.network.messages).
ANGLE, VELOCITY, CURRENT, FOOT_LOAD, CAUSE, COUNTER = range(6)
STIFFNESS, DAMPING, EQUILIBRIUM, GAIN, TORQUE, STATE, NUMBER = range(7)
HOLD, RUN = 1.0, 2.0  # states of a set point
_COUNTS = 4  # of a frame's counter


def tell(e: Episode, tick: int) -> None:
    """Let the gait controller hear of joints, feet and supply."""
    for number in range(len(e.joints)):
        for one in lanes(e):
            _tell(one, number, tick)
    if POINTS_PER_FOOT > 0 and not NETWORKED:
        for number in range(len(e.soles)):
            for one in lanes(e):
                hear_load(one.controller, number, one.soles[number].load)
    for one in lanes(e):
        one.controller.supply.voltage = one.supply.bus_voltage


def _tell(e: Episode, number: int, tick: int) -> None:
    """Let the gait controller hear of a joint."""
    if NETWORKED:
        _hear_measurement(e, number, tick)
    else:
        report(e.joints[number].board, e.controller.joints[number].measurement)


def _heard(e: Episode, wire: Wire, tick: int) -> int:
    """Place of what a receiver hears of a frame in this tick, -1 for nothing."""
    place = (tick - e.network.delay) % len(wire.lately)
    return place if tick > 0 and wire.lately[place].tick == tick - e.network.delay else -1


def _hear_measurement(e: Episode, number: int, tick: int) -> None:
    """What the gait controller hears of a board, if anything."""
    network, controller = e.network, e.controller
    wire, measured = network.measurements[number], controller.joints[number].measurement
    place = _heard(e, wire, tick)
    if place >= 0:
        numbers = network.numbers
        unpack_frame(network.measurement_layout, wire.lately[place].halves, numbers)
        measured.last_angle, measured.last_velocity = measured.angle, measured.velocity
        measured.angle, measured.velocity = numbers[ANGLE], numbers[VELOCITY]
        measured.motor_speed = numbers[VELOCITY]  # the frame has no room for the speed that the drive infers
        if measured.cause == NO_TRIP:
            measured.cause = int(numbers[CAUSE])
        if POINTS_PER_FOOT > 0 and (number + 1) % JOINTS_PER_LEG == 0:
            hear_load(controller, number // JOINTS_PER_LEG, numbers[FOOT_LOAD])
    hear_board(controller, e.limits, number, place >= 0)


def hear_setpoint(e: Episode, number: int, tick: int) -> bool:
    """What a board hears, if anything; it stands in ``demand`` of the joint then."""
    network, wire, heard = e.network, e.network.setpoints[number], e.joints[number].heard
    place = _heard(e, wire, tick)
    if place >= 0:
        numbers = network.numbers
        unpack_frame(network.setpoint_layout, wire.lately[place].halves, numbers)
        heard.stiffness, heard.damping = numbers[STIFFNESS], numbers[DAMPING]
        heard.equilibrium, heard.gain = numbers[EQUILIBRIUM], numbers[GAIN]
        heard.held = numbers[STATE] != RUN
        given = CENTRAL and not heard.held
        heard.gravity = 0.0 if given else numbers[TORQUE]
        heard.target = numbers[TORQUE] if given else 0.0
    return place >= 0


def exchange(e: Episode, tick: int) -> None:
    """Write what is due to be sent, and let the bus carry it until the next tick."""
    for one in each(e):
        for number in range(len(one.joints)):
            _send_setpoint(one, number, tick)
            _send_measurement(one, number, tick)
        advance(one.network.bus, tick)
        for number in range(len(one.joints)):
            _arrive(one, one.network.setpoints[number], tick + 1)
            _arrive(one, one.network.measurements[number], tick + 1)


def _arrive(e: Episode, wire: Wire, tick: int) -> None:
    """Keep what came, for when it is used."""
    frame, lately = e.network.bus.frames[wire.frame], wire.lately[tick % len(wire.lately)]
    came = frame.arrived == tick
    lately.tick = tick if came else -1
    if came:
        lately.halves[0], lately.halves[1] = frame.received.halves[0], frame.received.halves[1]


def _send_setpoint(e: Episode, number: int, tick: int) -> None:
    """Write the frame to a board, if it is due."""
    network, joint = e.network, e.controller.joints[number]
    frame = network.bus.frames[network.setpoints[number].frame]
    if is_due(network.bus, frame, tick):
        asked, numbers = joint.demand, network.numbers
        stiffness, damping, torque = (
            asked.stiffness,
            asked.damping,
            asked.gravity + asked.inertia + asked.target,
        )
        if CENTRAL and not asked.held:
            angle, velocity = joint.measurement.angle, joint.measurement.velocity
            torque += impedance_torque(angle, velocity, stiffness, damping, asked.equilibrium)
            stiffness, damping = 0.0, 0.0
        numbers[STIFFNESS], numbers[DAMPING], numbers[EQUILIBRIUM] = stiffness, damping, asked.equilibrium
        numbers[GAIN], numbers[TORQUE] = asked.gain, torque
        numbers[STATE] = HOLD if asked.held else RUN
        numbers[NUMBER] = frame.event // frame.period % _COUNTS
        pack_frame(network.setpoint_layout, numbers, frame.outgoing.halves)


def _send_measurement(e: Episode, number: int, tick: int) -> None:
    """Write the frame of a board, if it is due."""
    network, joint = e.network, e.joints[number]
    frame = network.bus.frames[network.measurements[number].frame]
    if is_due(network.bus, frame, tick):
        encoder, numbers = joint.board.encoder, network.numbers
        numbers[ANGLE], numbers[VELOCITY] = encoder.angle, encoder.velocity_fast
        numbers[CURRENT], numbers[CAUSE] = joint.current, joint.board.cause
        numbers[FOOT_LOAD] = 0.0
        if POINTS_PER_FOOT > 0 and (number + 1) % JOINTS_PER_LEG == 0:
            numbers[FOOT_LOAD] = e.soles[number // JOINTS_PER_LEG].load
        numbers[COUNTER] = frame.event // frame.period % _COUNTS
        pack_frame(network.measurement_layout, numbers, frame.outgoing.halves)


def reboot(e: Episode, number: int, tick: int) -> None:
    """Note whether a board is off; when it is back it holds its joint and tells so as a drive that failed.

    Encoders are absolute, and their filters go on: what they would take to settle is not simulated.
    """
    joint, bus = e.joints[number], e.network.bus
    now, sender = tick * bus.tick, bus.frames[e.network.measurements[number].frame].sender
    joint.off = False
    for outage in bus.outages:
        if outage.kind == REBOOT and outage.node == sender and outage.start <= now < outage.end:
            joint.off = True
            joint.board.cause = DRIVE_TRIP
