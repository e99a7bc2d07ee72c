"""From what the gait controller wants to the torques of the motors and the voltage of the battery."""

from twin_gait.control.gait_controller import (
    INERTIA_WANTED,
    demand,
    estimate_acceleration,
    pose,
    trip,
    wants_gravity,
)
from twin_gait.control.joint_board import (
    ask,
    check,
    copy_demand,
    demand_rest,
    note_drive,
    refuse,
    set_current,
    sum_up,
)
from twin_gait.core.actuator import battery_power, motor_electrical_power, sagged_bus_voltage, winding_voltage
from twin_gait.core.control_tick import driven_motor, target_current
from twin_gait.core.estimation import delayed_sample
from twin_gait.core.faults import (
    MOTOR_STUCK,
    NO_FAULT,
    dipped_bus_voltage,
    drive_fault,
    runaway_torque,
    supply_drop,
)
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


def drive(e: Episode, tick: int) -> None:
    """Let the motors follow their set points, and draw power from the battery."""
    for one in lanes(e):
        one.supply.power = 0.0
    for number in range(len(e.joints)):
        for one in lanes(e):
            _drive(one, number)
            if FAULTY and tick >= one.first_fault and not one.joints[number].board.command.drive_off:
                _drive_faulty(one, number, tick)
            _note_drive(one, number)
    for one in lanes(e):
        battery = one.supply
        battery.power = battery_power(battery.power, battery.constant_power, battery.regeneration)


def _drive(e: Episode, number: int) -> None:
    joint = e.joints[number]
    asked, place = joint.board.command, joint.place
    current, torque = driven_motor(joint.motor, asked.target_current, e.v[place], e.supply.bus_voltage)
    off = asked.drive_off or joint.off
    joint.current = 0.0 if off else current
    joint.current_deviation = 0.0
    e.motor[place] = 0.0 if off else torque


def _drive_faulty(e: Episode, number: int, tick: int) -> None:
    joint, row = e.joints[number], drive_fault(number, tick, e.faults)
    if row != NO_FAULT:
        motor, place, fault, expected = joint.motor, joint.place, e.faults[row], joint.current
        wrong = fault.magnitude if fault.kind == MOTOR_STUCK else 0.0
        asked = target_current(motor, wrong, e.limits.torque, e.limits.current)
        joint.current, e.motor[place] = driven_motor(motor, asked, e.v[place], e.supply.bus_voltage)
        joint.current_deviation = joint.current - expected


def _note_drive(e: Episode, number: int) -> None:
    """What the board sees of its drive, and what the motor draws."""
    joint = e.joints[number]
    motor, velocity, current = joint.motor, e.v[joint.place], joint.current
    joint.voltage = winding_voltage(motor, current, velocity)
    note_drive(joint.board, joint.voltage, current, joint.current_deviation)
    e.supply.power += motor_electrical_power(motor, current, velocity)


def supply(e: Episode, tick: int) -> None:
    """Bus voltage of the next tick."""
    for one in lanes(e):
        battery = one.supply
        battery.bus_voltage = sagged_bus_voltage(
            battery.voltage, battery.resistance, battery.power, battery.bus_voltage
        )
        if FAULTY and tick >= one.first_fault:
            _dip(one, tick)


def _dip(e: Episode, tick: int) -> None:
    """Let a fault of the supply lower its voltage."""
    drop, highest = supply_drop(tick, e.faults), 0.0
    if drop > 0.0:
        for joint in e.joints:
            highest = max(highest, joint.board.bounds.emf_constant * abs(e.v[joint.place]))
        e.supply.bus_voltage = dipped_bus_voltage(e.supply.bus_voltage, drop, highest)
