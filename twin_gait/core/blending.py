"""How the parameters of a phase fade into those of the next."""

BLEND_NONE = 0
BLEND_LINEAR = 1
BLEND_MINIMUM_JERK = 2


def blend_share(progress: float, law: int) -> float:
    """Share of the new value after a given part of the blending time.

    The minimum-jerk law is ``10 s³ - 15 s⁴ + 6 s⁵`` (Flash and Hogan, 1985): zero velocity and
    acceleration at both ends.

    ``progress``: elapsed part of the blending time; below 0 and above 1 are held. ``law``: one of the
    ``BLEND_*`` constants. Returns the share in [0, 1]: 0 keeps the old value, 1 is the new one.
    """
    if progress >= 1.0 or law == BLEND_NONE:
        return 1.0
    if progress <= 0.0:
        return 0.0
    if law == BLEND_LINEAR:
        return progress
    return progress * progress * progress * (10.0 + progress * (6.0 * progress - 15.0))


def blend(old: float, new: float, share: float) -> float:
    """Value between old and new.

    ``old``: value at the start of the blend. ``new``: value at its end, same unit. ``share``: from
    :func:`blend_share`. Returns ``old + share (new - old)``.
    """
    return old + share * (new - old)
