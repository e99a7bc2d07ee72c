r"""An arm that holds a crutch, as a massless strut from the shoulder to the tip of the crutch.

The tip is a point mass. In the sagittal plane the arm can change the strut's length ℓ (elbow) and turn it
against the trunk (shoulder): it pushes along the strut with P and turns it with the moment M, so that the tip
feels

.. math::

    f = P\,e + \frac{M}{\ell}\,n

with e from the shoulder to the tip and n at right angles to it, forwards while the arm hangs. The trunk feels
the opposite force on a line through the tip, which is :math:`-f` in the shoulder and :math:`-M` about it.
"""

import math
from dataclasses import dataclass, field

from twin_gait.core.contact import Point
from twin_gait.core.elementary import sine_cosine
from twin_gait.core.estimation import DelayLine


@dataclass(slots=True)
class Grip:
    r"""What the muscles of an arm do; between two decisions of its owner it stays.

    .. math::

        P = P_0 + k\,(\ell_0 - \ell) - b\,\dot\ell, \qquad
        M = M_0 + \ell\,[\kappa\,\ell_0 \sin(\varphi_0 - \varphi) - \beta\,\ell\,\dot\varphi]

    Attributes:
        push: Tonic force :math:`P_0` in [N].
        turn: Tonic moment :math:`M_0` in [N m].
        length: :math:`\ell_0` in [m].
        angle: :math:`\varphi_0` of the strut against the trunk in [rad]: 0 along it, forwards positive.
        sine: Of the angle.
        cosine: Of the angle.
        stiffness: k in [N] / [m].
        damping: b in [N s] / [m].
        turning_stiffness: κ at the tip in [N] / [m].
        turning_damping: β at the tip in [N s] / [m].
    """

    push: float
    turn: float
    length: float
    angle: float
    stiffness: float
    damping: float
    turning_stiffness: float
    turning_damping: float
    sine: float = 0.0
    cosine: float = 1.0


@dataclass(slots=True)
class Arm:
    """An arm and its crutch.

    Attributes:
        place: Of the tip's way forwards in the coordinates; its height follows.
        mass: Of the tip in [kg].
        push_limit: Largest force with which the arm pushes the tip away in [N].
        pull_limit: With which it draws it near in [N].
        moment_limit: Largest moment of the shoulder in [N m].
        longest: Length of the strut with a straight arm in [m].
        straight_stiffness: Of a straight arm, which the hand holds on to, in [N] / [m].
        tip_stiffness: Of the rubber of the tip against shear, in [N] / [m].
        tip_damping: Likewise in [N s] / [m].
        anchor: Place on the ground where the tip sticks, in [m].
        grip: What the muscles do.
        length: Of the strut in [m], as it was last.
        aside: Way of the tip from where the grip would have it, against n, in [m].
        push: Force along the strut in [N]; likewise.
        moment: Of the shoulder in [N m], which turns the tip forwards; likewise.
        power: That the arm gives in [W]; likewise.
        tip: Force of the ground on the tip; likewise.
        doing: What the arm is about, as :mod:`twin_gait.worlds.arm_policy` numbers it.
        since: Ticks since it began that.
        first_angle: Angle of the strut from the vertical where a swing of it began, in [rad].
        reach: Angle from the vertical to which it is swung, in [rad].
        first_length: Length of the strut when the person began to push up, in [m].
        felt: What is felt of a chair, as it was last.
        felt_ahead: Way of the tip in front of the shoulder, on its way to the mind.
        felt_load: Load on the tip, likewise.
    """

    place: int
    mass: float
    push_limit: float
    pull_limit: float
    moment_limit: float
    grip: Grip
    felt_ahead: DelayLine
    felt_load: DelayLine
    longest: float = math.inf
    straight_stiffness: float = 0.0
    tip_stiffness: float = 1.0
    tip_damping: float = 0.0
    anchor: float = 0.0
    length: float = 0.0
    aside: float = 0.0
    push: float = 0.0
    moment: float = 0.0
    power: float = 0.0
    doing: int = 0
    since: int = 0
    first_angle: float = 0.0
    reach: float = 0.0
    first_length: float = 0.0
    felt: float = 0.0
    tip: Point = field(default_factory=Point)


def held(value: float, low: float, high: float) -> float:
    """A value within bounds."""
    return min(max(value, low), high)


def turn_grip(grip: Grip, angle: float) -> None:
    """Hold the strut at another angle against the trunk in [rad]."""
    grip.angle = angle
    grip.sine, grip.cosine = sine_cosine(angle)


def arm_force(
    arm: Arm, sine: float, cosine: float, ahead: float, up: float, forward: float, upward: float
) -> tuple[float, float]:
    """Force of an arm on the tip of its crutch.

    Args:
        arm: Changed in place: what it does is kept.
        sine: Of the pitch of the trunk, forwards positive.
        cosine: Likewise.
        ahead: Tip from the shoulder in [m], forwards positive.
        up: Likewise upwards.
        forward: Velocity of the tip as the trunk sees it, which turns, in [m] / [s].
        upward: Likewise upwards.

    Returns:
        Forward and upward force in [N].
    """
    grip = arm.grip
    length = math.sqrt(ahead * ahead + up * up)
    ex, ez = ahead / length, up / length
    # Where the grip would have the strut: down along the trunk, turned forwards by its angle.
    wanted_x, wanted_z = (cosine * grip.sine - sine * grip.cosine, -(sine * grip.sine + cosine * grip.cosine))
    aside = grip.length * (wanted_z * ex - wanted_x * ez)
    along_speed, aside_speed = forward * ex + upward * ez, upward * ex - forward * ez
    push = grip.push + grip.stiffness * (grip.length - length) - grip.damping * along_speed
    turning = grip.turning_stiffness * aside - grip.turning_damping * aside_speed
    arm.length, arm.aside = length, aside
    arm.push = held(push, -arm.pull_limit, arm.push_limit)
    if length > arm.longest:
        arm.push -= arm.straight_stiffness * (length - arm.longest)
    arm.moment = held(grip.turn + turning * length, -arm.moment_limit, arm.moment_limit)
    across = arm.moment / length
    arm.power = arm.push * along_speed + across * aside_speed
    return arm.push * ex - across * ez, arm.push * ez + across * ex


def anchored_friction_force(
    arm: Arm, place: float, slip_velocity: float, normal_force: float, friction_coefficient: float
) -> float:
    r"""Coulomb friction of a tip that can rest: a spring to where it stuck (Cundall and Strack 1979).

    :math:`F_t = -(k s + c v)`, within :math:`\pm\mu F_n`, with the stretch s from the anchor;
    :func:`dragged_anchor` lets the spring's end slide.

    Args:
        arm: Whose rubber has k and c.
        place: Of the tip in [m].
        slip_velocity: Of the tip relative to the ground in [m] / [s].
        normal_force: In [N].
        friction_coefficient: :math:`\mu`.

    Returns:
        Force on the tip in [N], against stretch and slip.
    """
    sheared = -arm.tip_stiffness * (place - arm.anchor) - arm.tip_damping * slip_velocity
    most = friction_coefficient * normal_force
    return held(sheared, -most, most)


def dragged_anchor(arm: Arm, place: float, normal_force: float, friction_coefficient: float) -> float:
    """Where a tip sticks after it has moved: no farther away than friction can hold it from.

    ``place`` of the tip in [m]; without a normal force in [N] the anchor is the place.
    """
    reach = friction_coefficient * normal_force / arm.tip_stiffness
    return held(arm.anchor, place - reach, place + reach)
