"""Motor, gear and battery as the joint sees them.

Currents in [A] and voltages in [V] are those of the DC equivalent of the block-commutated motor (the
convention of the motor's data sheet); torques in [N m] are those of the motor times the gear ratio τ, motor
turns per joint turn. K_t in [N m] / [A] is K_e in SI units; R, line to line, is in [Ω]; ω of the joint in
[rad] / [s].
"""

from dataclasses import dataclass


@dataclass(slots=True)
class Motor:
    """Motor and gear of a joint."""

    torque_constant: float  # K_t in [N m] / [A].
    gear_ratio: float  # Motor turns per joint turn.
    resistance: float  # Of winding, switches and shunt, line to line, in [Ω].


def saturate(value: float, limit: float) -> float:
    """Limit a value symmetrically to ``[-limit, limit]``; NaN passes through for a guard above to see."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


def dead_zone(value: float, half_width: float) -> float:
    r"""Part of a value x that lies outside a zone of half width δ about zero, 0 or more.

    :math:`\begin{cases} x - \delta & x > \delta \\ 0 & |x| \le \delta \\ x + \delta & x < -\delta
    \end{cases}`

    Continuous and odd; a law behind it has no slope at rest.
    """
    if value > half_width:
        return value - half_width
    if value < -half_width:
        return value + half_width
    return 0.0


def torque_to_current(joint_torque: float, torque_constant: float, gear_ratio: float) -> float:
    r"""Motor current that yields a joint torque, equation (2.16) of the thesis: :math:`I = T / (K_t\,\tau)`.

    The firmware knows nothing of what the gear loses on the way
    (:func:`twin_gait.core.friction.gear_loss_torque`).
    """
    return joint_torque / (torque_constant * gear_ratio)


def current_to_torque(current: float, torque_constant: float, gear_ratio: float) -> float:
    """Motor torque seen at the joint, before the losses of the gear; inverts :func:`torque_to_current`."""
    return current * torque_constant * gear_ratio


def voltage_limited_current(motor: Motor, current: float, joint_velocity: float, bus_voltage: float) -> float:
    r"""Current that the bus voltage can drive through the winding against the back-EMF.

    :math:`\frac{-V_{bus} - K_e\,\tau\,\omega}{R} \le I \le \frac{V_{bus} - K_e\,\tau\,\omega}{R}`
    """
    back_emf = motor.torque_constant * motor.gear_ratio * joint_velocity
    highest = (bus_voltage - back_emf) / motor.resistance
    lowest = (-bus_voltage - back_emf) / motor.resistance
    if current > highest:
        return highest
    if current < lowest:
        return lowest
    return current


def winding_voltage(motor: Motor, current: float, joint_velocity: float) -> float:
    r"""Voltage on a winding that carries a steady current: :math:`U = R I + K_e\,\tau\,\omega`."""
    return motor.resistance * current + motor.torque_constant * motor.gear_ratio * joint_velocity


def motor_electrical_power(motor: Motor, current: float, joint_velocity: float) -> float:
    r"""Electrical power in [W] that a motor draws: copper loss and back-EMF power.

    :math:`P = R I^2 + K_e\,\tau\,\omega\,I`, negative while the motor brakes and feeds the bus.
    """
    mechanical = motor.torque_constant * motor.gear_ratio * joint_velocity * current
    return motor.resistance * current * current + mechanical


def battery_power(motor_power: float, constant_power: float, regeneration: float) -> float:
    r"""Power in [W] that a battery gives to a bus on which motors draw and feed; negative charges it.

    :math:`P = P_m + P_0, \qquad P_{bat} = \begin{cases} P & P \ge 0 \\ \rho\,P & P < 0 \end{cases}`

    What braking motors feed into the bus (P_m below 0) serves the other motors and the electronics (P_0)
    first; of the rest the share ρ comes back to the battery, and a brake chopper burns what does not.
    """
    power = motor_power + constant_power
    return power if power >= 0.0 else regeneration * power


def sagged_bus_voltage(
    open_circuit_voltage: float, internal_resistance: float, battery_power: float, bus_voltage: float
) -> float:
    """Bus voltage under load, from the voltage and the power of the tick before.

    ``V = V_oc - R_i P / V_before``: the current is taken at the last voltage, so that no algebraic loop has
    to be solved; at 1 kHz the difference is far below the sag itself.
    """
    return open_circuit_voltage - internal_resistance * battery_power / bus_voltage
