r"""An arm that holds a crutch, modelled as a strut from the shoulder to the tip of the crutch.

The mass of the crutch is at its tip, or that of a rod along the strut (:func:`crutch_acceleration`). In the
sagittal plane the arm can change the strut's length ℓ (elbow) and turn it against the trunk (shoulder): it
pushes along the strut with the force P and turns it with the moment M, so that the force on the tip is

.. math::

    f = P\,e + \frac{M}{\ell}\,n

with e from the shoulder to the tip and n perpendicular to it, forwards while the arm hangs. The opposite
force acts on the trunk on a line through the tip, which is equivalent to :math:`-f` at the shoulder and
:math:`-M` about it.
"""

import math
from dataclasses import dataclass, field

from twin_gait.core.contact import ContactState
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import DelayLine


@dataclass(slots=True)
class Grip:
    r"""Setpoints of the muscles of an arm, constant between two decisions of the crutch user.

    .. math::

        P = P_0 + k\,(\ell_0 - \ell) - b\,\dot\ell, \qquad
        M = M_0 + \ell\,[\kappa\,\ell_0 \sin(\varphi_0 - \varphi) - \beta\,\ell\,\dot\varphi]

    Attributes:
        axial_force: Tonic force :math:`P_0` in [N].
        shoulder_moment: Tonic moment :math:`M_0` in [N·m].
        length: :math:`\ell_0` in [m].
        angle: :math:`\varphi_0` of the strut against the trunk in [rad]: 0 along it, forwards positive.
        sine: Sine of the angle.
        cosine: Cosine of the angle.
        stiffness: k in [N/m].
        damping: b in [N·s/m].
        transverse_stiffness: κ at the tip in [N/m].
        transverse_damping: β at the tip in [N·s/m].
    """

    axial_force: float
    shoulder_moment: float
    length: float
    angle: float
    stiffness: float
    damping: float
    transverse_stiffness: float
    transverse_damping: float
    sine: float = 0.0
    cosine: float = 1.0


@dataclass(slots=True)
class Arm:
    """State and parameters of an arm and its crutch.

    Attributes:
        number: Number of the crutch, from 1 on.
        index: Index of the tip's forward coordinate; its height is the next coordinate.
        mass: Mass of the crutch in [kg].
        push_limit: Largest force with which the arm pushes the tip away in [N].
        pull_limit: Largest force with which the arm pulls the tip towards the shoulder in [N].
        moment_limit: Largest moment of the shoulder in [N·m].
        max_length: Length of the strut with a straight arm in [m].
        tension_limit: Largest tension of a bent or straight arm in [N]; the hand yields to a larger one.
        centre_of_mass: Distance of the centre of mass from the tip in [m].
        inertia: Moment of inertia about the centre of mass in [kg·m²].
        straight_stiffness: Stiffness of a straight arm, which the hand holds on to, in [N/m].
        tip_stiffness: Shear stiffness of the rubber of the tip in [N/m].
        tip_damping: Shear damping of the rubber of the tip in [N·s/m].
        anchor: Position on the ground where the tip sticks, in [m].
        grip: Setpoints of the muscles.
        length: Last computed length of the strut in [m].
        transverse_deflection: Last computed displacement of the tip from the position that the grip sets,
            against n, in [m].
        direction_x: Forward component of the last computed direction e.
        direction_z: Upward component of the last computed direction e.
        along_speed: Last computed velocity of the tip from the shoulder along e in [m/s].
        aside_speed: Last computed velocity of the tip along n, relative to the turning trunk, in [m/s].
        axial_force: Last computed force along the strut in [N].
        moment: Last computed moment of the shoulder in [N·m], which turns the tip forwards.
        power: Last computed mechanical power of the arm in [W].
        tip: Last computed force of the ground on the tip.
        phase: Phase of the arm, as :mod:`twin_gait.worlds.arm_policy` numbers it.
        phase_ticks: Ticks since this phase began.
        first_angle: Angle of the strut from the vertical at the start of its swing, in [rad].
        reach: Angle from the vertical to which the strut is swung, in [rad].
        first_length: Length of the strut when the person began to push up, in [m].
        perceived_chair_state: Last perceived state of a chair.
        distance_delay: Delayed distance of the tip in front of the shoulder, as the person perceives it.
        load_delay: Delayed load on the tip, as the person perceives it.
        perceived_load: Last perceived load on the tip in [N].
    """

    index: int
    mass: float
    push_limit: float
    pull_limit: float
    moment_limit: float
    grip: Grip
    distance_delay: DelayLine
    load_delay: DelayLine
    number: float = 1.0
    max_length: float = math.inf
    tension_limit: float = math.inf
    centre_of_mass: float = 0.0
    inertia: float = 0.0
    straight_stiffness: float = 0.0
    tip_stiffness: float = 1.0
    tip_damping: float = 0.0
    anchor: float = 0.0
    length: float = 0.0
    transverse_deflection: float = 0.0
    direction_x: float = 0.0
    direction_z: float = -1.0
    along_speed: float = 0.0
    aside_speed: float = 0.0
    axial_force: float = 0.0
    moment: float = 0.0
    power: float = 0.0
    phase: int = 0
    phase_ticks: int = 0
    first_angle: float = 0.0
    reach: float = 0.0
    first_length: float = 0.0
    perceived_chair_state: float = 0.0
    perceived_load: float = 0.0
    tip: ContactState = field(default_factory=ContactState)


def clamp(value: float, low: float, high: float) -> float:
    """Limit a value to the bounds ``low`` and ``high``."""
    return min(max(value, low), high)


def set_grip_angle(grip: Grip, angle: float) -> None:
    """Set the angle of the grip against the trunk in [rad]."""
    grip.angle = angle
    grip.sine, grip.cosine = sine_cosine(angle)


def arm_force(
    arm: Arm, sine: float, cosine: float, ahead: float, up: float, forward: float, upward: float
) -> tuple[float, float]:
    """Compute the force of an arm on the tip of its crutch.

    Args:
        arm: The arm; the computed length, direction, velocities, force, moment and power are stored in it.
        sine: Sine of the pitch of the trunk, forwards positive.
        cosine: Cosine of the pitch of the trunk.
        ahead: Distance of the tip from the shoulder in [m], forwards positive.
        up: Distance of the tip from the shoulder in [m], upwards positive.
        forward: Forward velocity of the tip relative to the turning trunk in [m/s].
        upward: Upward velocity of the tip relative to the turning trunk in [m/s].

    Returns:
        Forward and upward force in [N].
    """
    grip = arm.grip
    length = math.sqrt(ahead * ahead + up * up)
    ex, ez = ahead / length, up / length
    # Direction of the strut that the grip sets: down along the trunk, turned forwards by its angle.
    wanted_x, wanted_z = (cosine * grip.sine - sine * grip.cosine, -(sine * grip.sine + cosine * grip.cosine))
    aside = grip.length * (wanted_z * ex - wanted_x * ez)
    along_speed, aside_speed = forward * ex + upward * ez, upward * ex - forward * ez
    push = grip.axial_force + grip.stiffness * (grip.length - length) - grip.damping * along_speed
    turning = grip.transverse_stiffness * aside - grip.transverse_damping * aside_speed
    arm.length, arm.transverse_deflection = length, aside
    arm.direction_x, arm.direction_z = ex, ez
    arm.along_speed, arm.aside_speed = along_speed, aside_speed
    arm.axial_force = clamp(push, -arm.pull_limit, arm.push_limit)
    if length > arm.max_length:
        arm.axial_force -= arm.straight_stiffness * (length - arm.max_length)
    arm.axial_force = max(arm.axial_force, -arm.tension_limit)
    arm.moment = clamp(grip.shoulder_moment + turning * length, -arm.moment_limit, arm.moment_limit)
    across = arm.moment / length
    arm.power = arm.axial_force * along_speed + across * aside_speed
    return arm.axial_force * ex - across * ez, arm.axial_force * ez + across * ex


def crutch_acceleration(
    arm: Arm,
    turning: float,
    force_x: float,
    force_z: float,
    gravity: float,
    shoulder_x: float,
    shoulder_z: float,
) -> tuple[float, float, float]:
    r"""Compute the acceleration of the tip of a crutch, and the reaction of its inertia on the shoulder.

    The crutch is a rod along the strut with the mass m, whose centre of mass has the distance c from the tip,
    and with the moment of inertia J about it. With :math:`\lambda = c/\ell`, :math:`j = J/(m \ell^2)`, the
    components of forces and accelerations along n, and Coriolis term
    :math:`a = \ddot s_n + 2\dot\ell\dot\varphi` of the shoulder s, Lagrange's equations are

    .. math::

        [(1-\lambda)^2 + j]\,\ddot p_n &= F_n/m + (1-\lambda)\,g_n - [\lambda(1-\lambda) - j]\,a, \\
        \ddot p_e &= F_e/m + g_e - c\,\dot\varphi^2, \\
        R_n &= m\,\{\lambda g_n - [\lambda(1-\lambda) - j]\,\ddot p_n - (\lambda^2 + j)\,a\}

    for the tip p and the reaction R on the shoulder. A point mass at the tip, :math:`c = J = 0`, has no
    reaction.

    Args:
        arm: Arm after :func:`arm_force`.
        turning: Angular velocity of the strut :math:`\dot\varphi` in [rad/s], positive along n.
        force_x: Forward force of arm and ground on the tip in [N].
        force_z: Upward force of arm and ground on the tip in [N].
        gravity: Gravitational acceleration in [m/s²].
        shoulder_x: Forward acceleration of the shoulder in [m/s²].
        shoulder_z: Upward acceleration of the shoulder in [m/s²].

    Returns:
        Forward and upward acceleration of the tip in [m/s²], and :math:`R_n` in [N].
    """
    ex, ez, share = arm.direction_x, arm.direction_z, arm.centre_of_mass / arm.length
    spin = arm.inertia / (arm.mass * arm.length * arm.length)
    free_x, free_z = force_x / arm.mass, force_z / arm.mass - gravity
    coupling, weight = share * (1.0 - share) - spin, -gravity * ex
    moved = ex * shoulder_z - ez * shoulder_x + 2.0 * arm.along_speed * turning
    free = ex * free_z - ez * free_x
    across = (free - share * weight - coupling * moved) / ((1.0 - share) * (1.0 - share) + spin)
    inward = arm.centre_of_mass * turning * turning
    reaction = arm.mass * (share * weight - coupling * across - (share * share + spin) * moved)
    other = across - free
    return free_x - ez * other - ex * inward, free_z + ex * other - ez * inward, reaction


def anchored_friction_force(
    arm: Arm, position: float, slip_velocity: float, normal_force: float, friction_coefficient: float
) -> float:
    r"""Compute the Coulomb friction of a tip that can stick, as a spring to its anchor.

    :math:`F_t = -(k s + c v)`, limited to :math:`\pm\mu F_n`, with the stretch s from the anchor (Cundall and
    Strack 1979); :func:`anchor_position` lets the spring's end slide.

    Args:
        arm: Arm with the shear stiffness k and damping c of the tip.
        position: Position of the tip in [m].
        slip_velocity: Velocity v of the tip relative to the ground in [m/s].
        normal_force: Normal force in [N].
        friction_coefficient: :math:`\mu`.

    Returns:
        Force on the tip in [N], against stretch and slip.
    """
    sheared = -arm.tip_stiffness * (position - arm.anchor) - arm.tip_damping * slip_velocity
    most = friction_coefficient * normal_force
    return clamp(sheared, -most, most)


def anchor_position(arm: Arm, position: float, normal_force: float, friction_coefficient: float) -> float:
    """Compute the anchor after the tip has moved: at most as far away as friction can hold the tip.

    ``position``: position of the tip in [m]; without a normal force in [N] the anchor is this position.
    """
    reach = friction_coefficient * normal_force / arm.tip_stiffness
    return clamp(arm.anchor, position - reach, position + reach)
