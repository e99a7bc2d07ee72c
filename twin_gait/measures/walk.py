r"""Forces of the ground on a walking leg, and the sources of the work.

Vertical forces are divided by the carried weight: the weight of wearer and device less the body-weight
support. Curves are means over strides from heel strike to heel strike, as in D. A. Winter: The biomechanics
and motor control of human gait, 2nd edition, University of Waterloo Press, 1991. In healthy walking, the
vertical force rises to a loading peak, falls in midstance and rises again at push-off. The ground brakes in
the first half of stance and propels by the same impulse in the second half.

On a belt, over whole strides of a steady walk, the mean force of the ground and the mean force of the guide
of the pelvis are in balance,

.. math::

    \bar F_{guide} + \sum_{feet} \bar F_x = 0, \qquad P_{belt} = -v_{belt} \sum_{feet} \bar F_x,

with forces positive forwards and :math:`v_{belt}` positive backwards. The belt therefore supplies power if
the ground brakes the feet on average.
"""

import math
from collections.abc import Collection, Mapping

import numpy as np

from twin_gait.measures import strides
from twin_gait.measures.foot_contact import CONTACT_FORCE
from twin_gait.measures.ground_strides import WalkConditions, ground_strides
from twin_gait.measures.leg_record import LegRecord, LogColumns, wearer_column
from twin_gait.measures.load_shape import load_shape
from twin_gait.measures.strides import mean
from twin_gait.vocabulary import JointName, Side

MIDSTANCE = slice(18, 46)  # [%] of the cycle, in which one foot of a healthy walk carries the weight
WEIGHT_ACCEPTANCE = slice(6, 21)  # [%] of the cycle, in which the load rises in healthy walking
YIELD_UNTIL = 30  # [%] of the cycle; the knee yields under load before midstance
# Mean pull of the belt on both feet, as a share of the carried weight, below which the belt does not drive
# the walk. In healthy walking at an even speed the mean pull is zero. The share is an assumption: a tenth of
# the peak braking force of a foot.
MIN_DRAG_SHARE = 0.02
# Sources of torque on a driven joint other than the device, as in the names of log columns. The column
# external_torque_Nm is their sum.
EXTERNAL_SOURCES = ("voluntary", "passive", "disturbance")
OWN_GAIT = "own"  # Source of torque on a joint that the wearer's own gait moves.


def walk_measures(
    log: LogColumns,
    leg: LegRecord,
    other: LegRecord,
    walkway: WalkConditions,
    *,
    swing_phase: int | None,
    skip: int = strides.SKIPPED_STRIDES,
) -> dict[str, float]:
    """Compute the measures of one leg of a walk on ground, by their names in a summary.

    The page on the summary explains each measure. ``log``: one row for each tick, with the columns whose
    names end as in ``WALK_COLUMNS``. ``leg``, ``other``: columns of this leg and of the other one.
    ``swing_phase``: index of swing flexion; None for a table without it. ``skip``: number of strides at the
    start that do not count. Measures are means over the counted strides if their name does not state
    otherwise, and NaN if they are not defined. Forces without a unit in the name are divided by the carried
    weight.
    """
    force = leg.normal_force
    assert force is not None  # there is ground
    bounds = leg.strides(skip=skip)
    each = ground_strides(log, leg, other, walkway, bounds)
    clearances = each["clearance_m"]
    entries = np.zeros(0, dtype=int) if swing_phase is None else leg.phase_entries(swing_phase)
    fore_aft = np.asarray(log[f"{leg.side}_foot_friction_force_N"])
    return {
        "cadence_per_min": strides.cadence(strides.stride_times(bounds, leg.tick)),
        "step_length_m": strides.finite_mean(each["step_length_m"]),
        "load_peak": mean(each["load_peak"]),
        **load_measures(mean_stride(force / walkway.carried_weight, bounds)),
        **{name: mean(each[name]) for name in ("braking_impulse_Ns", "propulsion_impulse_Ns")},
        "fore_aft_force_N": mean_over_strides(fore_aft, bounds),
        **fore_aft_peaks(mean_stride(fore_aft, bounds) / walkway.carried_weight),
        "cop_crossing": _midfoot(np.asarray(log[f"{leg.side}_foot_cop_ratio"]), force, bounds),
        **_joints(log, leg.side, bounds),
        "clearance_m": float(min(clearances[np.isfinite(clearances)], default=math.nan)),
        **{name: mean(each[name]) for name in ("landing_speed_m_per_s", "slip_m")},
        **_swing(force, entries[strides.is_in_stride(entries, bounds)], bounds),
        "belt_power_W": -mean_over_strides(fore_aft * np.asarray(log["belt_speed_m_per_s"]), bounds),
        **_powers(log, leg, bounds),
    }


# Ends of the names of the log columns that the measures of a walk read in addition to time and phases.
WALK_COLUMNS = (
    *(f"_{joint}_angle_rad" for joint in JointName), "_wearer_angle_rad", "_velocity_rad_per_s",
    "_motor_torque_Nm", "_own_torque_Nm", "_voluntary_torque_Nm", "_passive_torque_Nm",
    "_disturbance_torque_Nm",
    "_foot_normal_force_N", "_foot_friction_force_N", "_foot_cop_ratio", "_foot_clearance_m",
    "guide_force_N", "pelvis_forward_m", "pelvis_forward_velocity_m_per_s", "belt_speed_m_per_s",
)  # fmt: skip


def mean_stride(signal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Compute the mean of a signal over strides.

    ``signal``: one value a tick, any unit, shape ``(n_ticks,)``; ``bounds``: strides, shape
    ``(n_strides, 2)``. Returns the mean at every percent of the cycle, shape ``(101,)``; NaN without strides.
    """
    if len(bounds) == 0:
        return np.full(101, np.nan)
    return np.asarray(strides.normalise_strides(signal, bounds).mean(axis=0))


def mean_over_strides(signal: np.ndarray, bounds: np.ndarray) -> float:
    """Compute the mean of a signal over the time of all strides.

    ``signal``: one value a tick, shape ``(n_ticks,)``; ``bounds``: strides, shape ``(n_strides, 2)``.
    Returns the mean in the unit of the signal; NaN without strides.
    """
    return mean(strides.values_in_strides(signal, bounds))


def load_measures(cycle: np.ndarray) -> dict[str, float]:
    """Find the peaks, the trough and the smallest loads of a vertical force.

    ``cycle``: force divided by the carried weight at every percent of the cycle, shape ``(101,)``. Returns
    the measures by their names in a summary; peaks and trough are NaN where :func:`load_shape` finds no two
    peaks.
    """
    shape = load_shape(cycle)
    return {
        "loading_peak": shape.loading_peak,
        "trough": shape.trough,
        "push_off_peak": shape.push_off_peak,
        "min_load": float(cycle[WEIGHT_ACCEPTANCE].min()),
        "min_midstance_load": float(cycle[MIDSTANCE].min()),
    }


def fore_aft_peaks(cycle: np.ndarray) -> dict[str, float]:
    """Find the largest backward and forward force of a mean stride.

    ``cycle``: fore-aft force divided by the carried weight, positive forwards, shape ``(101,)``. Returns the
    measures by their names in a summary: the braking peak, 0 or negative, and the propulsion peak, 0 or
    positive.
    """
    low, high = float(cycle.min()), float(cycle.max())
    return {"braking_peak": 0.0 if low > 0.0 else low, "propulsion_peak": 0.0 if high < 0.0 else high}


def knee_shape(cycle: np.ndarray) -> dict[str, float]:
    """Compute the knee angle at contact, and the flexion of the knee after it under load, both in [deg].

    ``cycle``: knee angle in [rad] at every percent of the cycle, shape ``(101,)``. Returns the measures by
    their names in a summary.
    """
    bent = cycle[: YIELD_UNTIL + 1].max() - cycle[0]
    return {"knee_at_contact_deg": math.degrees(cycle[0]), "knee_yield_deg": math.degrees(bent)}


def cop_curve(cop_ratio: np.ndarray, load: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Compute the centre of pressure over the mean stride, each stride weighted with its load.

    ``cop_ratio``: centre of pressure in each tick, 0 at the heel and 1 at the toe, shape ``(n,)``; ``load``:
    vertical force in [N], shape ``(n,)``. Returns the centre of pressure at every percent of the cycle, shape
    ``(101,)``; NaN where the foot carries no load in the mean stride.
    """
    carried = mean_stride(load, bounds)
    loaded = carried > CONTACT_FORCE
    weighted = mean_stride(load * cop_ratio, bounds)
    return np.where(loaded, weighted / np.where(loaded, carried, 1.0), np.nan)


def _midfoot(cop: np.ndarray, load: np.ndarray, bounds: np.ndarray) -> float:
    """Return the share of the cycle at which the centre of pressure passes the middle of the sole."""
    # Only the curve before the smallest load counts, because the next stance begins after it.
    stance = cop_curve(cop, load, bounds)[: int(np.argmin(mean_stride(load, bounds)))]
    known = stance[np.isfinite(stance)]
    behind = np.flatnonzero(stance < 0.5)
    return float(behind[-1] + 1) / 100.0 if len(behind) and known[-1] >= 0.5 else math.nan


def _joints(log: LogColumns, side: Side, bounds: np.ndarray) -> dict[str, float]:
    """Compute measures of the wearer's joints, driven or not."""
    hip, knee, ankle = (wearer_column(log, side, joint, "angle_rad") for joint in JointName)
    ankle_range = math.nan
    if ankle in log:
        ankle_range = mean(np.ptp(strides.stride_extremes(np.asarray(log[ankle]), bounds), axis=1))
    return {
        "ankle_range_deg": math.degrees(ankle_range),
        "hip_lowest_deg": math.degrees(mean(strides.stride_extremes(np.asarray(log[hip]), bounds)[:, 0])),
        **knee_shape(mean_stride(np.asarray(log[knee]), bounds)),
    }


def _swing(load: np.ndarray, entries: np.ndarray, bounds: np.ndarray) -> dict[str, float]:
    """Compute the mean share of the stride and the mean load in [N] at the entry into swing.

    ``entries``: first tick of each swing, shape ``(n,)``.
    """
    stride = np.searchsorted(bounds[:, 0], entries, side="right") - 1
    shares = (entries - bounds[stride, 0]) / (bounds[stride, 1] - bounds[stride, 0])
    return {"swing_entry": mean(shares), "swing_load_N": mean(load[entries])}


def _powers(log: LogColumns, leg: LegRecord, bounds: np.ndarray) -> dict[str, float]:
    """Compute the mean power of each motor, and the mean powers of wearer and pushes over all joints."""
    found = {}
    for joint in leg.driven:
        name = f"{leg.side}_{joint}"
        motor = np.asarray(log[f"{name}_motor_torque_Nm"] * log[f"{name}_velocity_rad_per_s"])
        found[f"{joint}_motor_power_W"] = mean_over_strides(motor, bounds)
    return {**wearer_powers(log, leg, bounds), **found}


def wearer_powers(log: LogColumns, leg: LegRecord, bounds: np.ndarray) -> dict[str, float]:
    """Compute the mean powers of voluntary effort, passive joint moments, pushes and own gait on a leg.

    Each power is the sum over the moved joints of torque times joint velocity. Pushes act on the device and
    take the velocity of its joint; all other torques take that of the wearer's joint. A torque without a
    column is zero, and the power of the own gait is left out if the log has no such torque.

    ``bounds``: strides, shape ``(n_strides, 2)``. Returns means over the strides in [W] by their names in a
    summary, positive if they drive the leg; NaN without strides.
    """
    found = {}
    own = [f"{leg.side}_{joint}_{OWN_GAIT}_torque_Nm" for joint in leg.angles]
    sources = (*EXTERNAL_SOURCES, OWN_GAIT) if any(column in log for column in own) else EXTERNAL_SOURCES
    for source in sources:
        power = 0.0 if len(bounds) else math.nan
        for joint in leg.angles:
            torque = f"{leg.side}_{joint}_{source}_torque_Nm"
            columns = () if source == "disturbance" else log
            velocity = wearer_column(columns, leg.side, joint, "velocity_rad_per_s")
            if torque in log:
                power += mean_over_strides(np.asarray(log[torque] * log[velocity]), bounds)
        found[f"{source}_power_W"] = power
    return found


def walk_power(
    log: LogColumns, legs: Collection[Mapping[str, float]], bounds: np.ndarray, walkway: WalkConditions
) -> dict[str, float]:
    """Add up the mean powers in [W] that drive a walk, by their names in a summary.

    ``guide_W`` is the power that the guide supplies to the pelvis in the forward direction, and
    ``guide_force_N`` its mean forward force; for a pelvis that is free, those of harness, arms and seat.

    ``legs``: measures of each leg from :func:`walk_measures`; ``bounds``: strides of the walk, shape
    ``(n_strides, 2)``.
    """
    belt, *outside = (sum(leg[f"{name}_power_W"] for leg in legs) for name in ("belt", *EXTERNAL_SOURCES))
    motors = sum(leg[name] for leg in legs for name in leg if name.endswith("_motor_power_W"))
    own = [leg[f"{OWN_GAIT}_power_W"] for leg in legs if f"{OWN_GAIT}_power_W" in leg]
    force, power = np.asarray(log["guide_force_N"]), 0.0
    holding, speed = (
        mean_over_strides(force, bounds),
        mean_over_strides(np.asarray(log["belt_speed_m_per_s"]), bounds),
    )
    for forward in ("pelvis_forward_velocity_m_per_s", "wearer_pelvis_forward_velocity_m_per_s"):
        if forward in log:  # with braces the second column exists, because the harness holds the wearer
            power = mean_over_strides(force * np.asarray(log[forward]), bounds)
    inside = motors + sum(outside) + sum(own)
    belt_driven = is_belt_driven(holding, speed, inside, walkway.carried_weight)
    return {
        "belt_W": belt,
        "motors_W": motors,
        **{f"{source}_W": value for source, value in zip(EXTERNAL_SOURCES, outside, strict=True)},
        **({f"{OWN_GAIT}_W": sum(own)} if own else {}),
        "guide_W": power,
        "guide_force_N": holding,
        "belt_driven": belt_driven,
    }


def is_belt_driven(holding: float, speed: float, legs: float, carried_weight: float) -> bool:
    """Check whether the belt drives a walk: F > 0.02 W and F v > P.

    F is the force that holds the pelvis against the belt: on level ground the drag of the belt on the feet,
    on a slope this drag without the downhill force of the weight.

    ``holding``: F, mean forward force of guide or harness on the pelvis in [N]; ``speed``: v, speed of the
    belt in [m/s]; ``legs``: P, net power of motors, wearer and pushes in [W]; ``carried_weight``: W, as in
    :class:`WalkConditions`. Returns false without strides.
    """
    return holding > MIN_DRAG_SHARE * carried_weight and holding * speed > legs
