"""Controllers of the joint test bench: duty-based transparency control, and torque control."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from twin_gait.core.actuator import Motor, saturate
from twin_gait.core.elementary import sine_cosine
from twin_gait.parameters import quantities
from twin_gait.parameters.friction import FrictionParameters
from twin_gait.vocabulary import JointName

DUTIES = quantities.Range(0.0, 1.0, exclusive_minimum=True, words="above 0 and at most 1")
GAINS = quantities.Range(0.0, 10.0, reason="a loop that compensates ten times the effect is unstable")
AMPLITUDES = quantities.Range(0.0, 2.0**24, reason="full duty of the finest timers")
BRAKING = quantities.Range(0.0, 1e3, reason="the largest torque at 1 rad/s")
TRANSPARENCY_STEPS = 1000.0  # steps of the sine in a second, which are the ticks of the firmware
# ω_min of (2.1) in [rad/s], which the thesis does not print: the velocity at which A = 140 to 195 counts
# just break the joint away. A count is 0.099 N·m on the knee at rest and 0.064 N·m on the hip; the two values
# have the same ratio.
LOWEST_VELOCITIES: Mapping[JointName, float] = {JointName.KNEE: 0.11, JointName.HIP: 0.07}
_LOWEST = LOWEST_VELOCITIES[JointName.KNEE]


@dataclass(frozen=True, kw_only=True)
class DutyControl(quantities.Parameters):
    """Duty-based transparency control, equations (2.1a) and (2.1b) of the thesis.

    K, A and f are the thesis's. It prints neither p0, p1, p2 nor ω_min; they are assumptions, chosen so that
    the falls agree with its appendix B: with K = 1 the joint creeps and may stick, with 1.15 it runs freely
    and stays near 0.6 rad/s. With counts of 6000, A from 140 to 195 compensates the difference between 3 kg
    and 1 kg: 55 counts are 5.4 N·m at the knee, the weights 5.9 N·m.

    Attributes:
        amplitude: Amplitude A of the breakaway sine in counts.
        frequency: Frequency f of the breakaway sine in [Hz].
        transparency_gain: Gain K.
        lowest_velocity: Velocity ω_min in [rad/s], below which the breakaway sine acts.
        static_voltage: Voltage p0 in [V].
        back_emf_share: Coefficient p1 divided by the back-EMF constant at the joint.
        braking_torque: Coefficient p2 as torque on the motor at rest, in [N·m·s²/rad²].
        duty_limit: Limit of the duty as a share of full duty.
    """

    amplitude: Annotated[float, quantities.QuantityUnits("counts"), AMPLITUDES] = 170.0
    frequency: Annotated[quantities.Frequency, quantities.POSITIVE] = 3.0
    transparency_gain: Annotated[quantities.Ratio, GAINS] = 1.10
    lowest_velocity: Annotated[quantities.AngularVelocity, quantities.POSITIVE] = _LOWEST
    static_voltage: Annotated[quantities.Voltage, quantities.NOT_NEGATIVE] = 0.05
    back_emf_share: Annotated[quantities.Ratio, GAINS] = 0.9
    braking_torque: Annotated[float, quantities.QuantityUnits("Nms2_per_rad2"), BRAKING] = 18.0
    duty_limit: Annotated[quantities.Ratio, DUTIES] = 0.9


def breakaway_duty(control: DutyControl, tick: float) -> float:
    r"""Compute the duty in counts that shakes the joint at rest in tick n, equation (2.1a) of the thesis.

    :math:`d = A \sin\frac{2\pi f\,n}{N}` with N :data:`TRANSPARENCY_STEPS`, the ``steps`` of the thesis.
    """
    sine, _ = sine_cosine(2.0 * math.pi * control.frequency * tick / TRANSPARENCY_STEPS)
    return control.amplitude * sine


def viscous_duty(
    control: DutyControl, motor: Motor, velocity: float, bus_voltage: float, counts: float
) -> float:
    r"""Compute the duty in counts that follows the moving joint, equation (2.1b) of the thesis.

    .. math::

        d = \frac{PWM}{V_{bus}} \left\{p_0\,\mathrm{sgn}\,\omega
            + K\,[p_1\,\omega - p_2\,\mathrm{sgn}(\omega)\,\omega^2]\right\}

    ``counts``: PWM, the counts of full duty; p1 in [V·s/rad] and p2 in [V·s²/rad²] follow from the
    parameters of the motor.
    """
    torque_per_current = motor.torque_constant * motor.gear_ratio
    linear = control.back_emf_share * torque_per_current
    quadratic = control.braking_torque * motor.resistance / torque_per_current
    sign = (velocity > 0.0) * 1.0 - (velocity < 0.0) * 1.0
    following = linear * velocity - quadratic * sign * velocity * velocity
    return counts / bus_voltage * (control.static_voltage * sign + control.transparency_gain * following)


def transparency_duty(
    control: DutyControl, motor: Motor, tick: float, velocity: float, bus_voltage: float, counts: float
) -> float:
    """Compute the duty in counts of transparency control, equations (2.1a) and (2.1b) of the thesis."""
    if abs(velocity) < control.lowest_velocity:
        duty = breakaway_duty(control, tick)
    else:
        duty = viscous_duty(control, motor, velocity, bus_voltage, counts)
    return saturate(duty, control.duty_limit * counts)


@dataclass(frozen=True, kw_only=True)
class OldFrictionModel(quantities.Parameters):
    """TWIN's old friction model, equation (2.5) of the thesis.

    Attributes:
        coulomb: Torque T_c in [N·m], F_s in the thesis; an assumption, b of table 3.1 for the knee.
        viscous: Coefficient d (F_v in the thesis) in [N·m·s/rad]; an assumption, from the same table.
        steepness: Steepness κ in [s/rad]; 40 in the thesis.
    """

    coulomb: Annotated[quantities.Torque, quantities.NOT_NEGATIVE] = 3.193
    viscous: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 2.06
    steepness: Annotated[quantities.RotaryDissipation, quantities.POSITIVE] = 40.0


@dataclass(frozen=True, kw_only=True)
class CosinePath(quantities.Parameters):
    """Cosine path of the equilibrium angle, there and back.

    Attributes:
        start_angle: Angle at the start in [rad].
        amplitude: Peak-to-peak amplitude in [rad].
        frequency: Frequency in [Hz].
    """

    start_angle: quantities.Angle
    amplitude: quantities.Angle
    frequency: Annotated[quantities.Frequency, quantities.POSITIVE]


def cosine_path(path: CosinePath, time: float) -> tuple[float, float, float]:
    r"""Compute the path :math:`\theta_s + \tfrac{A}{2}(1 - \cos 2\pi f t)`, its velocity and acceleration.

    Returns angle in [rad], velocity in [rad/s] and acceleration in [rad/s²] at a time in [s].
    """
    pulsation, half = 2.0 * math.pi * path.frequency, 0.5 * path.amplitude
    fastest = half * pulsation
    sine, cosine = sine_cosine(pulsation * time)
    return path.start_angle + half * (1.0 - cosine), fastest * sine, fastest * pulsation * cosine


@dataclass(frozen=True, kw_only=True)
class TorqueControl(quantities.Parameters):
    """Torque control, equations (2.7), (2.16) and (2.18) of the thesis.

    With stiffness and damping of zero it is friction compensation with a target torque (2.16); with a
    stiffness, it is impedance control (2.18); with the old model and an inertia compensation of 1, it is
    (2.7).

    Attributes:
        friction_model: The compensator's own friction model.
        old_model: Old friction model that replaces the friction model, or None.
        friction_compensation_gain: Gain G of the friction compensation.
        follows_path: Whether friction is compensated at the velocity of the path, so that nothing is fed
            back; otherwise at the slow velocity estimate, equation (2.16).
        dead_zone: Speed in [rad/s] below which friction is not compensated; it is subtracted from the
            speeds above it.
        target_torque: Target torque in [N·m].
        stiffness: Stiffness k in [N·m/rad].
        damping: Damping b in [N·m·s/rad].
        equilibrium_angle: Equilibrium angle θ0 in [rad].
        inertia_compensation: Share of the known inertia times the measured acceleration that is added.
        path: Path of the equilibrium angle with the torque that its acceleration needs, or None.
    """

    friction_model: FrictionParameters
    old_model: OldFrictionModel | None = None
    friction_compensation_gain: Annotated[quantities.Ratio, GAINS] = 0.35
    follows_path: bool = False
    dead_zone: Annotated[quantities.AngularVelocity, quantities.NOT_NEGATIVE] = 0.0
    target_torque: quantities.Torque = 0.0
    stiffness: Annotated[quantities.RotaryStiffness, quantities.NOT_NEGATIVE] = 0.0
    damping: Annotated[quantities.RotaryDamping, quantities.NOT_NEGATIVE] = 0.0
    equilibrium_angle: quantities.Angle = 0.0
    inertia_compensation: Annotated[quantities.Ratio, GAINS] = 0.0
    path: CosinePath | None = None
