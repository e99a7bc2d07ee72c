"""Steps of the drives: torques of the motors from their target currents, and the bus voltage."""

from twin_gait.control.joint_board import store_drive_state
from twin_gait.core.actuator import battery_power, motor_electrical_power, sagged_bus_voltage, winding_voltage
from twin_gait.core.control_tick import drive_motor, target_current
from twin_gait.core.faults import MOTOR_STUCK, NO_FAULT, dipped_bus_voltage, drive_fault, supply_drop
from twin_gait.simulation.build_flags import WITH_FAULTS
from twin_gait.simulation.episode import Episode


def begin_power(e: Episode) -> None:
    """Reset the sum of the power that the motors draw."""
    e.supply.power = 0.0


def drive(e: Episode, number: int, tick: int) -> None:
    """Compute current and torque of a motor from its target current, with faults."""
    _drive(e, number)
    if WITH_FAULTS and tick >= e.first_fault and not e.joints[number].board.command.drive_off:
        _drive_faulty(e, number, tick)
    _note_drive(e, number)


def draw_power(e: Episode) -> None:
    """Compute the power of motors and electronics that the battery delivers."""
    battery = e.supply
    battery.power = battery_power(battery.power, battery.constant_power, battery.regeneration)


def _drive(e: Episode, number: int) -> None:
    joint = e.joints[number]
    command, index = joint.board.command, joint.index
    current, torque = drive_motor(joint.motor, command.target_current, e.v[index], e.supply.bus_voltage)
    off = command.drive_off or joint.off
    joint.current = 0.0 if off else current
    joint.current_deviation = 0.0
    e.motor[index] = 0.0 if off else torque


def _drive_faulty(e: Episode, number: int, tick: int) -> None:
    joint, row = e.joints[number], drive_fault(number, tick, e.faults)
    if row != NO_FAULT:
        motor, index, fault, expected = joint.motor, joint.index, e.faults[row], joint.current
        wrong = fault.magnitude if fault.kind == MOTOR_STUCK else 0.0
        limits = joint.board.limits
        target = target_current(motor, wrong, limits.torque, limits.current)
        joint.current, e.motor[index] = drive_motor(motor, target, e.v[index], e.supply.bus_voltage)
        joint.current_deviation = joint.current - expected


def _note_drive(e: Episode, number: int) -> None:
    """Write the signals that the board measures at its drive, and add the power that the motor draws."""
    joint = e.joints[number]
    motor, velocity, current = joint.motor, e.v[joint.index], joint.current
    joint.voltage = winding_voltage(motor, current, velocity)
    store_drive_state(joint.board, joint.voltage, current, joint.current_deviation)
    e.supply.power += motor_electrical_power(motor, current, velocity)


def update_bus_voltage(e: Episode, tick: int) -> None:
    """Compute the bus voltage of the next tick."""
    battery = e.supply
    battery.bus_voltage = sagged_bus_voltage(
        battery.voltage, battery.resistance, battery.power, battery.bus_voltage
    )
    if WITH_FAULTS and tick >= e.first_fault:
        _dip(e, tick)


def _dip(e: Episode, tick: int) -> None:
    """Reduce the bus voltage by a fault of the supply."""
    drop, highest = supply_drop(tick, e.faults), 0.0
    if drop > 0.0:
        for joint in e.joints:
            highest = max(highest, joint.board.bounds.emf_constant * abs(e.v[joint.index]))
        e.supply.bus_voltage = dipped_bus_voltage(e.supply.bus_voltage, drop, highest)
