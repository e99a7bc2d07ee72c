"""Torques of the wearer at a joint: passive moments, spasticity and voluntary effort.

All torques act on the joint and are positive in the direction of flexion.
"""

import math

from twin_gait.core.elementary import exponential

_DEGREES = 180.0 / math.pi


def passive_hip_torque(hip: float, knee: float) -> float:
    r"""Compute the passive elastic moment of the hip in [N·m] at flexions in [rad].

    .. math::

        M = e^{1.4655 - 0.0034\,\varphi_k - 0.0750\,\varphi_h}
            - e^{1.3403 - 0.0226\,\varphi_k + 0.0305\,\varphi_h} + 8.072

    with angles in degrees. R. Riener, T. Edrich: Identification of passive elastic joint moments in the lower
    extremities, Journal of Biomechanics 32 (1999) 539-544; mean over ten healthy men.
    """
    fh, fk = _DEGREES * hip, _DEGREES * knee
    extended = exponential(1.4655 - 0.0034 * fk - 0.0750 * fh)
    flexed = exponential(1.3403 - 0.0226 * fk + 0.0305 * fh)
    return extended - flexed + 8.072


def passive_knee_torque(hip: float, knee: float, ankle: float) -> float:
    r"""Compute the passive elastic moment of the knee in [N·m] at angles in [rad].

    .. math::

        M = e^{1.800 + 0.0460\,\varphi_a - 0.0352\,\varphi_k + 0.0217\,\varphi_h}
            - e^{-3.971 + 0.0004\,\varphi_a + 0.0495\,\varphi_k - 0.0128\,\varphi_h} - 4.820
            + e^{2.220 - 0.150\,\varphi_k}

    with angles in degrees (Riener and Edrich, 1999); the paper counts plantarflexion as positive, this
    function dorsiflexion.
    """
    fh, fk, fa = _DEGREES * hip, _DEGREES * knee, _DEGREES * ankle
    two_joint = exponential(1.800 + 0.0460 * fa - 0.0352 * fk + 0.0217 * fh)
    flexed = exponential(-3.971 + 0.0004 * fa + 0.0495 * fk - 0.0128 * fh)
    extended = exponential(2.220 - 0.150 * fk)
    return two_joint - flexed - 4.820 + extended


def spastic_torque(velocity: float, stretch_reflex_threshold: float, gain: float) -> float:
    r"""Compute the torque in [N·m] of a spastic muscle, which resists a stretch that is faster than ω_c.

    :math:`\tau = -g\,(|\omega| - \omega_c)\,\operatorname{sgn}\omega \quad\text{for}\quad |\omega| >
    \omega_c`

    ``stretch_reflex_threshold``: ω_c in [rad/s]. ``gain``: g in [N·m·s/rad].
    """
    excess = abs(velocity) - stretch_reflex_threshold
    if excess <= 0.0:
        return 0.0
    return -gain * excess if velocity > 0.0 else gain * excess


def find_grid_interval(angle: float, lowest: float, step: float, entries: int) -> tuple[int, float]:
    """Find the grid interval of an angle on an even grid, for linear interpolation; constant beyond its ends.

    Returns the index of the entry below, and the share of the next one.
    """
    position = (angle - lowest) / step
    if position <= 0.0:
        return 0, 0.0
    if position >= entries - 1:
        return entries - 2, 1.0
    below = int(position)
    return below, position - below
