"""A zone about zero in which nothing is answered."""


def dead_zone(value: float, half_width: float) -> float:
    r"""Part of a value that lies outside a zone about zero.

    .. math::

        \begin{cases} x - \delta & x > \delta \\ 0 & |x| \le \delta \\ x + \delta & x < -\delta \end{cases}

    Continuous and odd; a law behind it has no slope at rest.

    ``value``: :math:`x`. ``half_width``: :math:`\delta`, 0 or more, same unit; 0 leaves the value as it is.
    Returns the part outside, same unit.
    """
    if value > half_width:
        return value - half_width
    if value < -half_width:
        return value + half_width
    return 0.0
