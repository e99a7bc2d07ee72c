r"""Forces on a free trunk, which turns with the pelvis about the axis of the hips.

A point of the trunk h above the hips stands at :math:`h (\sin\theta, \cos\theta)` from them, where θ is the
pitch, forwards positive. A force in a point (x, z) from the hips pitches the trunk with

.. math::

    M = z F_x - x F_z
"""

from dataclasses import dataclass

from twin_gait.core.contact import mechanical_stop_torque
from twin_gait.core.plant import Stop


@dataclass(slots=True)
class Harness:
    """A rope from a rail to the trunk; the trolley on the rail follows, so that the rope stays vertical."""

    height: float  # Of the attachment above the hips, along the trunk, in [m].
    force: float  # Of body-weight support in [N].
    damping: float  # Of the rope's winch in [N s] / [m].
    stop: Stop  # What locks at a trip, from below, in heights of the attachment.
    pull: float = 0.0  # On the trunk in [N], upwards, as it was last.


@dataclass(slots=True)
class Trunk:
    """The trunk of a wearer whose pelvis is free."""

    shoulder: float  # Height of the shoulders above the hips, along the trunk, in [m].
    harness: Harness  # That holds it.


def pitching_moment(ahead: float, up: float, forward: float, upward: float) -> float:
    """Moment in [N m] about the hips, forwards positive, of a force in [N] in a point seen from them."""
    return up * forward - ahead * upward


def harness_pull(harness: Harness, height: float, speed: float) -> float:
    """Upward force in [N] of a rope on the trunk, which the harness keeps.

    ``height``: of the attachment in the world in [m]. ``speed``: of it, upwards.
    """
    stop, locked = harness.stop, 0.0
    if stop.stiffness != 0.0:
        locked = mechanical_stop_torque(
            height, speed, stop.lower, stop.upper, stop.stiffness, stop.dissipation
        )
    harness.pull = harness.force - harness.damping * speed + locked
    return harness.pull
