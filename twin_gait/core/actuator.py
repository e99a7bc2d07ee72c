"""Motor, gear and battery as seen from the joint.

Currents in [A] and voltages in [V] are those of the DC equivalent of the block-commutated motor (the
convention of the motor's data sheet); torques in [N·m] are those of the motor times the gear ratio τ, motor
turns per joint turn. K_t in [N·m/A] is K_e in SI units; R, line to line, is in [Ω]; ω is the velocity of
the joint in [rad/s].
"""

from dataclasses import dataclass


@dataclass(slots=True)
class Motor:
    """Motor and gear of a joint."""

    torque_constant: float  # K_t in [N·m/A].
    gear_ratio: float  # Motor turns per joint turn.
    resistance: float  # Resistance of winding, switches and shunt, line to line, in [Ω].


def saturate(value: float, limit: float) -> float:
    """Limit a value symmetrically to ``[-limit, limit]``; NaN passes through to later checks."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


def dead_zone(value: float, half_width: float) -> float:
    r"""Compute the part of a value x that lies outside a zone of half width δ about zero.

    :math:`\begin{cases} x - \delta & x > \delta \\ 0 & |x| \le \delta \\ x + \delta & x < -\delta
    \end{cases}` with δ (``half_width``) 0 or more.

    The function is continuous and odd; a law of its result has no slope at rest.
    """
    if value > half_width:
        return value - half_width
    if value < -half_width:
        return value + half_width
    return 0.0


def torque_to_current(joint_torque: float, torque_constant: float, gear_ratio: float) -> float:
    r"""Convert a joint torque to motor current, equation (2.16) of the thesis: :math:`I = T / (K_t\,\tau)`.

    The firmware does not model the loss of the gear (:func:`twin_gait.core.friction.gear_loss_torque`).
    """
    return joint_torque / (torque_constant * gear_ratio)


def current_to_torque(current: float, torque_constant: float, gear_ratio: float) -> float:
    """Convert current to motor torque at the joint, before gear losses; inverts :func:`torque_to_current`."""
    return current * torque_constant * gear_ratio


def voltage_limited_current(motor: Motor, current: float, joint_velocity: float, bus_voltage: float) -> float:
    r"""Limit a current to the range that the bus voltage can drive against the back-EMF.

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


def shorted_current(motor: Motor, joint_velocity: float, inductive_time: float) -> float:
    r"""Compute the steady current in [A] of a motor whose three terminals are connected to each other.

    .. math::

        I = -\frac{K_e\,\tau\,\omega}{R\,(1 + x^2)}, \qquad x = T_L\,\omega, \quad T_L = \frac{p\,\tau\,L}{R}

    I is the part that makes torque, :math:`-(K_t \tau)^2 \omega / R` for x = 0. x is the ratio of reactance
    to resistance at the electrical frequency :math:`p\,\tau\,\omega` with p pole pairs. The torque is highest
    at x = 1, and the current of a phase is :math:`K_e \tau \omega / (R \sqrt{1 + x^2})`. This is the steady
    state of a synchronous machine without saliency, which is reached within some L/R (computed; the current
    of a phase agrees with Roboteq, Calculating the motor dynamic braking 3-phase short current).

    Args:
        motor: Motor and gear.
        joint_velocity: ω in [rad/s].
        inductive_time: T_L in [s]; 0 to neglect the inductance. L and R are both line to line.
    """
    ratio = inductive_time * joint_velocity
    back_emf = motor.torque_constant * motor.gear_ratio * joint_velocity
    return -back_emf / (motor.resistance * (1.0 + ratio * ratio))


def winding_voltage(motor: Motor, current: float, joint_velocity: float) -> float:
    r"""Compute the voltage on a winding with a steady current: :math:`U = R I + K_e\,\tau\,\omega`."""
    return motor.resistance * current + motor.torque_constant * motor.gear_ratio * joint_velocity


def motor_electrical_power(motor: Motor, current: float, joint_velocity: float) -> float:
    r"""Compute the electrical power in [W] that a motor draws: copper loss and back-EMF power.

    :math:`P = R I^2 + K_e\,\tau\,\omega\,I`, negative while the motor brakes and feeds the bus.
    """
    mechanical = motor.torque_constant * motor.gear_ratio * joint_velocity * current
    return motor.resistance * current * current + mechanical


def battery_power(motor_power: float, constant_power: float, regeneration: float) -> float:
    r"""Compute the power in [W] that a battery delivers to a bus with motors; negative charges it.

    :math:`P = P_m + P_0, \qquad P_{bat} = \begin{cases} P & P \ge 0 \\ \rho\,P & P < 0 \end{cases}`

    The power that braking motors feed into the bus (P_m below 0) supplies the other motors and the
    electronics (P_0) first; the share ρ of the rest returns to the battery, and a brake chopper dissipates
    the remainder.
    """
    power = motor_power + constant_power
    return power if power >= 0.0 else regeneration * power


def sagged_bus_voltage(
    open_circuit_voltage: float, internal_resistance: float, battery_power: float, bus_voltage: float
) -> float:
    """Compute the bus voltage under load from the voltage and the power of the previous tick.

    ``V = V_oc - R_i P / V_before``: the current is calculated with the previous voltage, so that no algebraic
    loop has to be solved; at 1 kHz the difference is far below the sag itself.
    """
    return open_circuit_voltage - internal_resistance * battery_power / bus_voltage
