"""How the parameters of a phase fade into those of the next."""

BLEND_NONE = 0
BLEND_LINEAR = 1
BLEND_MINIMUM_JERK = 2


def blend_share(progress: float, law: int) -> float:
    """Share of the new value, 0 to 1, after a given part of the blending time, which is held at its ends.

    The minimum-jerk law is ``10 s³ - 15 s⁴ + 6 s⁵`` (Flash and Hogan, 1985): zero velocity and acceleration
    at both ends. ``law``: one of the ``BLEND_*`` constants.
    """
    if progress >= 1.0 or law == BLEND_NONE:
        return 1.0
    if progress <= 0.0:
        return 0.0
    if law == BLEND_LINEAR:
        return progress
    return progress * progress * progress * (10.0 + progress * (6.0 * progress - 15.0))


def blend(old: float, new: float, share: float) -> float:
    """``old + share (new - old)``, with a share from :func:`blend_share`."""
    return old + share * (new - old)
