r"""Steps, forces of the ground and slip in each stride of a leg.

The values are those of single strides from heel strike to heel strike; a summary contains their means.
Vertical forces are divided by the carried weight, as in :mod:`twin_gait.measures.walk`.
"""

from dataclasses import dataclass

import numpy as np

from twin_gait.measures import strides
from twin_gait.measures.foot_contact import find_swings, is_loaded, swing_clearances
from twin_gait.measures.leg_record import LegRecord, LogColumns


@dataclass(frozen=True)
class WalkConditions:
    """Parameters of belt and support that the measures of a walk need."""

    # Weight of wearer and device less the supported part, in [N]; NaN if nothing is left.
    carried_weight: float
    friction_coefficient: float  # friction coefficient of the soles on the belt
    transition_velocity: float  # transition velocity of the regularised friction in [m/s]


def ground_strides(
    log: LogColumns, leg: LegRecord, other: LegRecord, walkway: WalkConditions, bounds: np.ndarray
) -> dict[str, np.ndarray]:
    """Compute steps, forces of the ground, slip and clearance of each stride, by their names in the table.

    ``log``: one row for each tick; ``leg``, ``other``: columns of this leg and of the other one; ``bounds``:
    strides of the leg. Returns arrays of shape ``(n_strides,)``; NaN where a value is not defined.
    """
    assert leg.contacts is not None and other.contacts is not None  # there is ground
    assert leg.clearance is not None and leg.normal_force is not None
    force, fore_aft = leg.normal_force, np.asarray(log[f"{leg.side}_foot_friction_force_N"])
    step_time = strides.step_times(bounds, other.contacts.heel_strikes, leg.tick)
    swings = find_swings(leg.contacts)
    stride = bounds[:, 0].searchsorted(swings[:, 0], side="right") - 1
    clearances, counted = np.full(len(bounds), np.nan), strides.is_in_stride(swings[:, 0], bounds)
    clearances[stride[counted]] = swing_clearances(leg.clearance, leg.contacts)[counted]
    return {
        "step_length_m": ground_speeds(log, bounds, leg.tick) * step_time,
        "load_peak": strides.stride_extremes(force, bounds)[:, 1] / walkway.carried_weight,
        "braking_impulse_Ns": leg.tick * strides.stride_sums(np.minimum(fore_aft, 0.0), bounds),
        "propulsion_impulse_Ns": leg.tick * strides.stride_sums(np.maximum(fore_aft, 0.0), bounds),
        "clearance_m": clearances,
        "landing_speed_m_per_s": _landing_speeds(leg.clearance, bounds, leg.tick),
        "slip_m": leg.tick * strides.stride_sums(slip_speed(fore_aft, force, walkway, leg.loaded), bounds),
    }


def _landing_speeds(clearance: np.ndarray, bounds: np.ndarray, tick: float) -> np.ndarray:
    """Compute the speed in [m/s] at which the lowest point of the sole sinks at the start of each stride."""
    strikes = np.maximum(bounds[:, 0], 1)
    return np.asarray((clearance[strikes - 1] - clearance[strikes]) / tick)


def ground_speeds(log: LogColumns, bounds: np.ndarray, tick: float) -> np.ndarray:
    """Compute the mean speed over the ground in each stride, in [m/s], shape ``(n_strides,)``.

    It is the speed of the belt or, if the belt does not move, of the pelvis. ``bounds``: strides, or other
    spans of ticks, shape ``(n_strides, 2)``; ``tick``: length of a tick in [s].
    """
    belt = strides.stride_means(np.asarray(log["belt_speed_m_per_s"]), bounds)
    if belt.any() or "pelvis_forward_m" not in log:
        return belt
    position, (first, last) = np.asarray(log["pelvis_forward_m"]), bounds.clip(max=len(log) - 1).T
    return np.asarray((position[last] - position[first]) / (tick * (last - first)))


def slip_speed(
    fore_aft: np.ndarray, load: np.ndarray, walkway: WalkConditions, loaded: np.ndarray | None = None
) -> np.ndarray:
    r"""Compute the speed of a loaded sole on the belt, from the law of its friction.

    .. math::

        F_x = -\mu F_n \tanh(v / v_t)
        \quad\Rightarrow\quad |v| = v_t \operatorname{artanh}\frac{|F_x|}{\mu F_n}

    Where points of the sole move at different speeds, the result is approximately the speed of the points
    that carry load.

    ``fore_aft``: force of the ground in [N], shape ``(n,)``; ``load``: vertical force in [N], shape ``(n,)``;
    ``loaded``: result of :func:`is_loaded`, computed by default. Returns the speed in [m/s], shape ``(n,)``;
    0 where the foot is not loaded, NaN without friction.
    """
    if loaded is None:
        loaded = is_loaded(load)
    if walkway.friction_coefficient == 0.0:
        return np.where(loaded, np.nan, 0.0)
    ticks = np.flatnonzero(loaded)
    ratio = np.abs(fore_aft[ticks]) / (walkway.friction_coefficient * load[ticks])
    speed = np.zeros(len(load))
    # Rounding keeps the hyperbolic tangent below 1 up to 18 transition velocities.
    speed[ticks] = walkway.transition_velocity * np.arctanh(np.minimum(ratio, 1.0 - 1e-15))
    return speed
