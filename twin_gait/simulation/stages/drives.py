"""Steps of the drives: torques of the motors from their target currents, and the bus voltage."""

from twin_gait.control.joint_board import store_drive_state
from twin_gait.core.actuator import (
    battery_power,
    current_to_torque,
    motor_electrical_power,
    sagged_bus_voltage,
    shorted_current,
    winding_voltage,
)
from twin_gait.core.control_tick import drive_motor, target_current
from twin_gait.core.faults import (
    MOTOR_STUCK,
    NO_FAULT,
    SUPPLY_LOSS_SHORTED,
    dipped_bus_voltage,
    drive_fault,
    supply_drop,
    supply_loss,
)
from twin_gait.simulation.build_flags import WITH_FAULTS
from twin_gait.simulation.episode import Episode


def begin_power(e: Episode) -> None:
    """Reset the sum of the power that the motors draw."""
    e.supply.power = 0.0


def drive(e: Episode, number: int, tick: int) -> None:
    """Compute current and torque of a motor from its target current, with faults."""
    _drive(e, number)
    if WITH_FAULTS and tick >= e.first_fault:
        _drive_faulty(e, number, tick)
    _note_drive(e, number)


def draw_power(e: Episode, tick: int) -> None:
    """Compute the power of motors and electronics that the battery delivers; 0 after a loss of the supply."""
    battery = e.supply
    battery.power = battery_power(battery.power, battery.constant_power, battery.regeneration)
    if WITH_FAULTS and tick >= e.first_fault and supply_loss(tick, e.faults) != NO_FAULT:
        battery.power = 0.0


def _drive(e: Episode, number: int) -> None:
    joint = e.joints[number]
    command, index = joint.board.command, joint.index
    current, torque = drive_motor(joint.motor, command.target_current, e.v[index], e.supply.bus_voltage)
    off = command.drive_off or joint.off
    joint.current = 0.0 if off else current
    joint.current_deviation = 0.0
    e.motor[index] = 0.0 if off else torque


def _drive_faulty(e: Episode, number: int, tick: int) -> None:
    joint, row, lost = e.joints[number], drive_fault(number, tick, e.faults), supply_loss(tick, e.faults)
    if lost != NO_FAULT:
        _drive_without_supply(e, number, lost)
    elif row != NO_FAULT and not joint.board.command.drive_off:
        motor, index, fault, expected = joint.motor, joint.index, e.faults[row], joint.current
        wrong = fault.magnitude if fault.kind == MOTOR_STUCK else 0.0
        limits = joint.board.limits
        target = target_current(motor, wrong, limits.torque, limits.current)
        joint.current, e.motor[index] = drive_motor(motor, target, e.v[index], e.supply.bus_voltage)
        joint.current_deviation = joint.current - expected


def _drive_without_supply(e: Episode, number: int, row: int) -> None:
    """Compute current and torque of a motor after a loss of the supply, with shorted or open windings.

    No command has an effect. ``row``: index of the fault.
    """
    joint, fault = e.joints[number], e.faults[row]
    motor, index = joint.motor, joint.index
    shorted = fault.kind == SUPPLY_LOSS_SHORTED
    joint.current = shorted_current(motor, e.v[index], fault.magnitude) if shorted else 0.0
    e.motor[index] = current_to_torque(joint.current, motor.torque_constant, motor.gear_ratio)


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
    """Reduce the bus voltage by a fault of the supply; shorted windings do not charge the bus."""
    drop, highest, lost = supply_drop(tick, e.faults), 0.0, supply_loss(tick, e.faults)
    if drop > 0.0:
        for joint in e.joints:
            highest = max(highest, joint.board.bounds.emf_constant * abs(e.v[joint.index]))
        if lost != NO_FAULT and e.faults[lost].kind == SUPPLY_LOSS_SHORTED:
            highest = 0.0
        e.supply.bus_voltage = dipped_bus_voltage(e.supply.bus_voltage, drop, highest)
