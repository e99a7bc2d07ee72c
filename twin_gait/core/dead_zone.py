"""A zone about zero in which nothing is answered."""


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
