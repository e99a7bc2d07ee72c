"""Load, moment and work of arms and crutches, and the support and frontal margin that they give on one foot.

The margin is an estimate in addition to the planar dynamics: :func:`frontal_margins`.
"""

import math
from itertools import accumulate

import numpy as np
import pandas as pd

from twin_gait.measures.foot_contact import find_spells, is_loaded
from twin_gait.vocabulary import Side

TRUNK_PITCH = "trunk_pitch_rad"
# Magnitude of the power of an arm above which its motion is not that of a person, in [W] (an assumption: an
# arm that carries a crutch has a fraction of it, and lifting half of 90 kg by 0.4 m in a second takes 180 W).
ARM_POWER_LIMIT = 300.0
# Distance between the middles of the feet, below the centres of the hips, and breadth of a foot over body
# height: 0.72 of the distance of the iliac spines (Bell et al. 1990) of 0.24 m (both recalled), and Drillis
# and Contini in Winter (2009), figure 4.1 (recalled).
FOOT_SPACING, FOOT_BREADTH = 0.10, 0.055
# Length of the equivalent pendulum over the height of the hips, in the frontal plane: Massen and Kodde 1979,
# in Hof et al. 2005 (recalled).
PENDULUM_RATIO = 1.34


def crutch_use(log: pd.DataFrame, side: Side, tick: float, body_weight: float) -> dict[str, float] | None:
    """Compute the measures of one arm and its crutch over a run, by their names in a summary.

    ``body_weight``: weight of wearer and device in [N]. The mean and the largest vertical load are shares of
    it; the axial force is that along the strut, and tension its negative; the moment is the largest magnitude
    of the shoulder's moment; the work that an arm takes up is zero or negative; ``plantings`` counts how
    often the crutch was put down. Returns None if the log has no crutch on this side or no rows.
    """
    if f"{side}_crutch_normal_force_N" not in log or len(log) == 0:
        return None
    load = log[f"{side}_crutch_normal_force_N"].to_numpy()
    power = log[f"{side}_arm_power_W"].to_numpy()
    loaded, weight = load > 0.0, body_weight or math.nan  # shares are not defined without gravity
    return {
        "mean_share": float(load.mean()) / weight,
        "peak_share": float(load.max()) / weight,
        "impulse_Ns": float(load.sum()) * tick,
        "axial_force_peak_N": float(log[f"{side}_arm_axial_force_N"].max()),
        "tension_peak_N": max(0.0, -float(log[f"{side}_arm_axial_force_N"].min())),
        "moment_peak_Nm": float(log[f"{side}_shoulder_moment_Nm"].abs().max()),
        "power_highest_W": float(power.max()),
        "power_lowest_W": float(power.min()),
        "power_over_limit_s": int(np.count_nonzero(np.abs(power) > ARM_POWER_LIMIT)) * tick,
        "work_done_J": float(np.maximum(power, 0.0).sum()) * tick,
        "work_absorbed_J": float(np.minimum(power, 0.0).sum()) * tick,
        "plantings": int(np.count_nonzero(loaded[1:] & ~loaded[:-1])),
    }


def single_support(
    log: pd.DataFrame, tick: float, *, height: float, tip_aside: float, gravity: float
) -> dict[str, float] | None:
    """Compute how crutches support a person who stands on one foot, by the names in a summary.

    Returns the share of the single support, and its longest part in [s], in which no crutch is loaded, and
    the smallest :func:`frontal_margins` in [m]. Feet and crutches are loaded as in
    :func:`~twin_gait.measures.foot_contact.is_loaded`. NaN without single support; None without crutches.

    Args:
        log: Log of a run with two legs.
        tick: Duration of a tick in [s].
        height: Height of the wearer in [m].
        tip_aside: Lateral distance of a tip from the outer side of the foot in [m].
        gravity: Gravitational acceleration in [m/s²].
    """
    names = [f"{side}_{part}_normal_force_N" for part in ("foot", "crutch") for side in Side]
    if not {*names} <= {*log}:
        return None
    forces = log[names].to_numpy().T
    left, right, *tips = map(is_loaded, forces)
    single = left != right
    if not single.any():
        return dict.fromkeys(
            ("share_without_crutch", "longest_without_crutch_s", "static_margin_m", "dynamic_margin_m"),
            math.nan,
        )
    bare = single & ~(tips[0] | tips[1])
    hips = float(log["pelvis_height_m"].mean())
    foot, breadth = 0.5 * FOOT_SPACING * height, FOOT_BREADTH * height
    places = foot, foot + 0.5 * breadth + tip_aside
    static, dynamic = frontal_margins(
        forces, single, places, 0.5 * breadth, tick, math.sqrt(gravity / (PENDULUM_RATIO * hips))
    )
    return {
        "share_without_crutch": float(bare.sum() / single.sum()),
        "longest_without_crutch_s": max((end - start for start, end in find_spells(bare)), default=0) * tick,
        "static_margin_m": float(static.min()),
        "dynamic_margin_m": float(dynamic.min()),
    }


def frontal_margins(
    forces: np.ndarray,
    single: np.ndarray,
    places: tuple[float, float],
    half_breadth: float,
    tick: float,
    rate: float,
) -> tuple[np.ndarray, np.ndarray]:
    r"""Estimate the margins of stability in the frontal plane for the ticks of single support, in [m].

    The base of support is projected on the frontal plane: the breadth of the loaded foot, extended to the
    loaded tips. A margin is the distance of a point from the nearer edge, negative outside. For the static
    margin this point is the centre of mass in the middle plane, since nothing in the model moves it aside.

    For the dynamic margin it is the extrapolated centre of mass :math:`\xi = y + \dot y / \omega_0` (Hof et
    al. 2005) of a lateral motion that is estimated from the loads: the body as an inverted pendulum over the
    lateral centre of pressure u of feet and tips, :math:`\ddot y = \omega_0^2 (y - u)`. Its only motion that
    stays bounded has :math:`\dot\xi = \omega_0 (\xi - u)` with ξ = u at the end of the run, which is
    integrated backwards. It is the sway of a person who times it so that no further moment is needed.

    Args:
        forces: Normal forces on left and right foot, left and right tip in [N], shape ``(4, n)``.
        single: Whether exactly one foot is loaded, shape ``(n,)``.
        places: Lateral distance of the middle of a foot and of a tip from the middle plane in [m].
        half_breadth: Half of the breadth of a foot in [m].
        tick: Duration of a tick in [s].
        rate: :math:`\omega_0` in [rad/s].

    Returns:
        Static and dynamic margins, each of the shape ``(single.sum(),)``.
    """
    aside = np.array([places[0], -places[0], places[1], -places[1]])  # left positive
    total = forces.sum(axis=0)
    pressure = np.where(total > 0.0, aside @ forces / np.where(total > 0.0, total, 1.0), 0.0)
    decay = math.exp(-rate * tick)
    backwards = accumulate(pressure[::-1].tolist(), lambda point, now: now + decay * (point - now))
    extrapolated = np.array([*backwards])[::-1][single]
    loaded = np.array([*map(is_loaded, forces)])[:, single]
    reach = np.array([half_breadth, half_breadth, 0.0, 0.0])
    edges = np.where(loaded, (aside + reach)[:, None], -np.inf).max(axis=0)
    others = np.where(loaded, (aside - reach)[:, None], np.inf).min(axis=0)
    return np.minimum(edges, -others), np.minimum(edges - extrapolated, extrapolated - others)
