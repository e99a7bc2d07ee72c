"""Blending of the parameters of one phase into those of the next."""

BLEND_NONE = 0
BLEND_LINEAR = 1
BLEND_MINIMUM_JERK = 2


def blend_share(progress: float, law: int) -> float:
    """Compute the share of the new value, 0 to 1, at a given progress of the blending.

    The minimum-jerk law is ``10 s³ - 15 s⁴ + 6 s⁵`` (Flash and Hogan, 1985): velocity and acceleration are
    zero at both ends. ``progress``: elapsed part of the blending time; the share is constant outside 0 to 1.
    ``law``: one of the ``BLEND_*`` constants.
    """
    if progress >= 1.0 or law == BLEND_NONE:
        return 1.0
    if progress <= 0.0:
        return 0.0
    if law == BLEND_LINEAR:
        return progress
    return progress * progress * progress * (10.0 + progress * (6.0 * progress - 15.0))


def blend(old: float, new: float, share: float) -> float:
    """Compute ``old + share (new - old)`` with a share from :func:`blend_share`."""
    return old + share * (new - old)
