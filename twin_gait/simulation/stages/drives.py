"""Steps of the drives: torques of the motors from their target currents, and the bus voltage."""

from twin_gait.control.joint_board import note_drive
from twin_gait.core.actuator import battery_power, motor_electrical_power, sagged_bus_voltage, winding_voltage
from twin_gait.core.control_tick import driven_motor, target_current
from twin_gait.core.faults import MOTOR_STUCK, NO_FAULT, dipped_bus_voltage, drive_fault, supply_drop
from twin_gait.simulation.episode import Episode
from twin_gait.simulation.structure import FAULTY


def begin_power(e: Episode) -> None:
    """Reset the sum of the power that the motors draw."""
    e.supply.power = 0.0


def drive(e: Episode, number: int, tick: int) -> None:
    """Compute current and torque of a motor from its target current, with faults."""
    _drive(e, number)
    if FAULTY and tick >= e.first_fault and not e.joints[number].board.command.drive_off:
        _drive_faulty(e, number, tick)
    _note_drive(e, number)


def draw_power(e: Episode) -> None:
    """Compute the power of motors and electronics that the battery delivers."""
    battery = e.supply
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
    """Write the signals that the board measures at its drive, and add the power that the motor draws."""
    joint = e.joints[number]
    motor, velocity, current = joint.motor, e.v[joint.place], joint.current
    joint.voltage = winding_voltage(motor, current, velocity)
    note_drive(joint.board, joint.voltage, current, joint.current_deviation)
    e.supply.power += motor_electrical_power(motor, current, velocity)


def sag(e: Episode, tick: int) -> None:
    """Compute the bus voltage of the next tick."""
    battery = e.supply
    battery.bus_voltage = sagged_bus_voltage(
        battery.voltage, battery.resistance, battery.power, battery.bus_voltage
    )
    if FAULTY and tick >= e.first_fault:
        _dip(e, tick)


def _dip(e: Episode, tick: int) -> None:
    """Reduce the bus voltage by a fault of the supply."""
    drop, highest = supply_drop(tick, e.faults), 0.0
    if drop > 0.0:
        for joint in e.joints:
            highest = max(highest, joint.board.bounds.emf_constant * abs(e.v[joint.place]))
        e.supply.bus_voltage = dipped_bus_voltage(e.supply.bus_voltage, drop, highest)
