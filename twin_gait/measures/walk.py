r"""What the ground does under a walking leg, and who does the work.

Vertical forces are over the weight that the legs carry, which is what body-weight support leaves of the
weight of wearer and device. Curves are means over strides from heel strike to heel strike, as in D. A.
Winter: The biomechanics and motor control of human gait, 2nd edition, University of Waterloo Press, 1991.
There the vertical force rises to a loading peak, sinks in midstance, rises again as the foot pushes off; the
ground brakes in the first half of stance and propels in the second, by as much.

On a belt, over whole strides of a steady walk, the ground takes what a guide of the pelvis gives,

.. math::

    \bar F_{guide} + \sum_{feet} \bar F_x = 0, \qquad P_{belt} = -v_{belt} \sum_{feet} \bar F_x,

so that a walk whose feet brake on the mean is driven by the belt.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from twin_gait.measures import strides
from twin_gait.measures.foot_contact import CONTACT_FORCE, is_loaded, swing_clearances, swings
from twin_gait.measures.leg_record import LegRecord, wearer_column
from twin_gait.measures.phases import phase_entries
from twin_gait.vocabulary import JointName, Side

MIDSTANCE = slice(18, 46)  # [%] of the cycle, in which the trough between the peaks is looked for
WEIGHT_ACCEPTANCE = slice(6, 21)  # [%] of the cycle, in which the load rises in healthy walking
YIELD_UNTIL = 30  # [%] of the cycle; the knee yields under load before midstance
# A belt whose mean pull on both feet is less than this share of the carried weight does not carry a walk. In
# healthy walking at an even speed it is nought; the share is an assumption, a tenth of what a foot brakes
# with at its peak.
LEAST_DRAG = 0.02


@dataclass(frozen=True)
class Walkway:
    """What the measures of a walk need to know of belt and support."""

    # weight of wearer and device less what the support carries, in [N]; NaN if that is all
    carried_weight: float
    friction_coefficient: float  # of soles on the belt
    transition_velocity: float  # of the regularised friction in [m] / [s]


@dataclass(frozen=True)
class WalkMeasures:
    """One leg of a walk in numbers, means over its counted strides unless said otherwise.

    Without strides they are NaN.
    """

    strides: int  # how many count
    stride_time: float  # in [s]
    cadence: float  # steps a minute
    # way over the ground from a heel strike of the other foot to the next of this one, in [m]
    step_length: float
    load_peak: float  # largest vertical force of a stride over carried weight
    loading_peak: float  # largest vertical force of the mean stride before the trough, over carried weight
    trough: float  # least vertical force of the mean stride from 18 to 45 % of it, over carried weight
    push_off_peak: float  # largest vertical force of the mean stride after the trough, over carried weight
    least_load: float  # least vertical force of the mean stride from 6 to 20 % of it, over carried weight
    # of the backward force of the ground on the foot over a stride in [N s], zero or negative
    braking_impulse: float
    propulsion_impulse: float  # of the forward force likewise, zero or positive
    # mean force of the ground on the foot over whole strides, forwards positive, in [N]
    fore_aft_force: float
    braking_peak: float  # largest backward force of the mean stride over carried weight, zero or negative
    propulsion_peak: float  # largest forward force of the mean stride over carried weight, zero or positive
    # share of the stride at which the centre of pressure passes the middle of the sole for good, see
    # pressure_curve; NaN if it does not
    pressure_crossing: float
    ankle_range: float  # in [rad]; NaN without an ankle
    hip_lowest: float  # least angle in [rad]
    knee_at_contact: float  # angle of the mean stride at heel strike in [rad]
    knee_yield: float  # flexion after it, up to 30 % of the cycle, in [rad]
    clearance: float  # least of its counted swings in their middle half, in [m]; see swing_clearances
    slip: float  # way that the loaded sole slides on the belt in a stride, in [m]
    # share of the stride at which swing flexion begins; NaN for a table without such a phase
    swing_entry: float
    swing_load: float  # vertical force on the foot at that moment in [N]
    further_contacts: int  # bounces and scuffs in the whole record
    belt_power: float  # that the belt gives to the foot, in [W]
    # mechanical power of each controlled motor at its joint, net, in [W]
    motor_power: Mapping[JointName, float]
    wearer_power: float  # of the wearer's own effort (and of pushes) at hip and knee, net, in [W]


def walk_measures(
    log: pd.DataFrame,
    leg: LegRecord,
    other: LegRecord,
    walkway: Walkway,
    *,
    swing_phase: int | None,
    skip: int = strides.SKIPPED_STRIDES,
) -> WalkMeasures:
    """Measure one leg of a walk on a belt.

    ``log``: one row a tick, with the columns whose names end as in ``WALK_COLUMNS``; ``swing_phase``: index
    of swing flexion; None for a table without it; ``skip``: so many strides at the start do not count.
    """
    contacts, force = leg.contacts, leg.normal_force
    assert contacts is not None  # there is ground
    assert leg.clearance is not None and force is not None
    bounds = leg.strides(skip=skip)
    times = strides.stride_times(bounds, leg.tick)
    entries = np.zeros(0, dtype=int) if swing_phase is None else phase_entries(leg.phases, swing_phase)
    fore_aft = log[f"{leg.side}_foot_friction_force_N"].to_numpy()
    load = force / walkway.carried_weight
    counted = strides.in_strides(swings(contacts)[:, 0], bounds)
    clearances = swing_clearances(leg.clearance, contacts)[counted]
    powers = {joint: _powers(log, leg.side, joint, bounds) for joint in leg.angles}
    return WalkMeasures(
        strides=len(bounds),
        stride_time=_mean(times),
        cadence=strides.cadence(times),
        step_length=ground_speed(log, bounds, leg.tick) * _mean(counted_steps(leg, other, bounds)),
        load_peak=_mean(strides.stride_extremes(load, bounds)[:, 1]),
        **load_shape(mean_stride(load, bounds)),
        **_fore_aft(fore_aft, bounds, leg.tick, walkway),
        belt_power=-mean_over(fore_aft * log["belt_speed_m_per_s"].to_numpy(), bounds),
        pressure_crossing=_midfoot(log[f"{leg.side}_foot_pressure_place"].to_numpy(), force, bounds),
        **_joints(log, leg.side, bounds),
        clearance=float(min(clearances, default=math.nan)),
        slip=mean_over(slip_speed(fore_aft, force, walkway), bounds) * _mean(times),
        **_swing(force, entries[strides.in_strides(entries, bounds)], bounds),
        further_contacts=len(contacts.further_contacts),
        motor_power={joint: motor for joint, (motor, _) in powers.items()},
        wearer_power=sum(wearer for _, wearer in powers.values()),
    )


def counted_steps(leg: LegRecord, other: LegRecord, bounds: np.ndarray) -> np.ndarray:
    """Durations in [s] of the steps that end at a heel strike of some strides and begin in the same walk."""
    contacts, others = leg.contacts, other.contacts
    assert contacts is not None and others is not None  # there is ground
    strikes = contacts.heel_strikes[strides.in_strides(contacts.heel_strikes, bounds, last=True)]
    found = [np.zeros(0)]
    for span in leg.steady_ticks:
        own, before = (
            ticks[(ticks >= span.start) & (ticks <= span.stop)] for ticks in (strikes, others.heel_strikes)
        )
        found.append(strides.step_times(own, before, leg.tick))
    return np.concatenate(found)


# Ends of the names of the columns of a log that the measures of a walk read, beside time and phases.
WALK_COLUMNS = (
    "_angle_rad", "_velocity_rad_per_s", "_motor_torque_Nm", "_patient_torque_Nm", "_foot_normal_force_N",
    "_foot_friction_force_N", "_foot_pressure_place", "_foot_clearance_m", "guide_force_N",
    "pelvis_forward_m", "pelvis_forward_velocity_m_per_s", "belt_speed_m_per_s",
)  # fmt: skip


def ground_speed(log: pd.DataFrame, bounds: np.ndarray, tick: float) -> float:
    """Mean speed over the ground in some strides, in [m] / [s]: of a belt, or of the pelvis without one."""
    belt = mean_over(log["belt_speed_m_per_s"].to_numpy(), bounds)
    if belt != 0.0 or "pelvis_forward_m" not in log or len(bounds) == 0:
        return belt
    place = log["pelvis_forward_m"].to_numpy()
    first, last = strides.walks(bounds).clip(max=len(log) - 1).T
    return float(np.sum(place[last] - place[first]) / (tick * np.sum(last - first)))


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan


def mean_stride(signal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Mean of a signal over strides.

    ``signal``: one value a tick, any unit, shape ``(n_ticks,)``; ``bounds``: strides, shape
    ``(n_strides, 2)``. Returned at every percent of the cycle, shape ``(101,)``; NaN without strides.
    """
    if len(bounds) == 0:
        return np.full(101, np.nan)
    return np.asarray(strides.normalise_strides(signal, bounds).mean(axis=0))


def mean_over(signal: np.ndarray, bounds: np.ndarray) -> float:
    """Mean of a signal over the time of all strides.

    ``signal``: one value a tick, shape ``(n_ticks,)``; ``bounds``: strides, shape ``(n_strides, 2)``.
    Returned in the unit of the signal; NaN without strides.
    """
    return _mean(strides.over_strides(signal, bounds))


def load_shape(cycle: np.ndarray) -> dict[str, float]:
    """Peaks, trough and least load of a vertical force.

    ``cycle``: force over carried weight at every percent of the cycle, shape ``(101,)``. Returns those
    attributes of :class:`WalkMeasures`.
    """
    middle = MIDSTANCE.start + int(np.argmin(cycle[MIDSTANCE]))
    return {
        "loading_peak": float(cycle[: middle + 1].max()),
        "trough": float(cycle[middle]),
        "push_off_peak": float(cycle[middle:-1].max()),
        "least_load": float(cycle[WEIGHT_ACCEPTANCE].min()),
    }


def fore_aft_peaks(cycle: np.ndarray) -> dict[str, float]:
    """Largest backward and forward force over carried weight; as :func:`load_shape`."""
    low, high = float(cycle.min()), float(cycle.max())
    return {"braking_peak": 0.0 if low > 0.0 else low, "propulsion_peak": 0.0 if high < 0.0 else high}


def knee_shape(cycle: np.ndarray) -> dict[str, float]:
    """Knee at contact and its yield after it in [rad]; as :func:`load_shape`."""
    return {
        "knee_at_contact": float(cycle[0]),
        "knee_yield": float(cycle[: YIELD_UNTIL + 1].max() - cycle[0]),
    }


def _fore_aft(force: np.ndarray, bounds: np.ndarray, tick: float, walkway: Walkway) -> dict[str, float]:
    time = _mean(strides.stride_times(bounds, tick))
    return {
        "braking_impulse": time * mean_over(np.minimum(force, 0.0), bounds),
        "propulsion_impulse": time * mean_over(np.maximum(force, 0.0), bounds),
        "fore_aft_force": mean_over(force, bounds),
        **fore_aft_peaks(mean_stride(force, bounds) / walkway.carried_weight),
    }


def pressure_curve(place: np.ndarray, load: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Centre of pressure over the mean stride, each stride weighted with its load.

    ``place``: centre of pressure at each tick, 0 at the first point of the sole and 1 at its last, shape
    ``(n,)``; ``load``: vertical force in [N], shape ``(n,)``. Returns place at every percent of the cycle,
    shape ``(101,)``; NaN where the mean foot carries nothing.
    """
    carried = mean_stride(load, bounds)
    loaded = carried > CONTACT_FORCE
    weighted = mean_stride(load * place, bounds)
    return np.where(loaded, weighted / np.where(loaded, carried, 1.0), np.nan)


def _midfoot(place: np.ndarray, load: np.ndarray, bounds: np.ndarray) -> float:
    # Up to the least load; what comes then is the next stance.
    stance = pressure_curve(place, load, bounds)[: int(np.argmin(mean_stride(load, bounds)))]
    known = stance[np.isfinite(stance)]
    behind = np.flatnonzero(stance < 0.5)
    return float(behind[-1] + 1) / 100.0 if len(behind) and known[-1] >= 0.5 else math.nan


def _joints(log: pd.DataFrame, side: Side, bounds: np.ndarray) -> dict[str, float]:
    """Of the wearer's joints, driven or not."""
    hip, knee, ankle = (wearer_column(log.columns, side, joint, "angle_rad") for joint in JointName)
    ankle_range = math.nan
    if ankle in log:
        ankle_range = _mean(np.ptp(strides.stride_extremes(log[ankle].to_numpy(), bounds), axis=1))
    return {
        "ankle_range": ankle_range,
        "hip_lowest": _mean(strides.stride_extremes(log[hip].to_numpy(), bounds)[:, 0]),
        **knee_shape(mean_stride(log[knee].to_numpy(), bounds)),
    }


def slip_speed(fore_aft: np.ndarray, load: np.ndarray, walkway: Walkway) -> np.ndarray:
    r"""Speed of a loaded sole on the belt, from the law of its friction.

    .. math::

        F_x = -\mu F_n \tanh(v / v_t)
        \quad\Rightarrow\quad |v| = v_t \operatorname{artanh}\frac{|F_x|}{\mu F_n}

    Where points of the sole move at different speeds it is about that of those which carry.

    ``fore_aft``: force of the ground in [N], shape ``(n,)``; ``load``: vertical force in [N], shape ``(n,)``.
    Returned in [m] / [s], shape ``(n,)``; 0 where the foot is not loaded, NaN without friction.
    """
    loaded = is_loaded(load)
    if walkway.friction_coefficient == 0.0:
        return np.where(loaded, np.nan, 0.0)
    ratio = np.abs(fore_aft) / (walkway.friction_coefficient * np.where(loaded, load, 1.0))
    # Rounding keeps the hyperbolic tangent below 1 up to 18 transition velocities.
    speed = walkway.transition_velocity * np.arctanh(np.minimum(ratio, 1.0 - 1e-15))
    return np.where(loaded, speed, 0.0)


def _swing(load: np.ndarray, entries: np.ndarray, bounds: np.ndarray) -> dict[str, float]:
    place = np.searchsorted(bounds[:, 0], entries, side="right") - 1
    shares = (entries - bounds[place, 0]) / (bounds[place, 1] - bounds[place, 0])
    return {"swing_entry": _mean(shares), "swing_load": _mean(load[entries])}


def _powers(log: pd.DataFrame, side: Side, joint: JointName, bounds: np.ndarray) -> tuple[float, float]:
    """Mean powers of motor and wearer at a joint in [W]."""
    motor = log[f"{side}_{joint}_motor_torque_Nm"] * log[f"{side}_{joint}_velocity_rad_per_s"]
    velocity = log[wearer_column(log.columns, side, joint, "velocity_rad_per_s")]
    wearer = log[f"{side}_{joint}_patient_torque_Nm"] * velocity
    return mean_over(motor.to_numpy(), bounds), mean_over(wearer.to_numpy(), bounds)


class WalkPower(NamedTuple):
    """Who drives a walk, means over the counted strides."""

    belt: float  # power that the belt gives to both feet, in [W]
    motors: float  # net mechanical power of all motors at their joints in [W]
    wearer: float  # of the wearer's own effort in [W]
    # power of guide or harness, off the rails of arms and seat too, into the pelvis as it goes forwards, in
    # [W]; none for a guide that does not move
    guide: float
    guide_force: float  # mean forward force of these on the pelvis in [N]
    carried_by_belt: bool  # whether the belt carries the walk, see belt_carries


def walk_power(
    log: pd.DataFrame, legs: Iterable[WalkMeasures], bounds: np.ndarray, walkway: Walkway
) -> WalkPower:
    """Add up who drives a walk."""
    legs = tuple(legs)
    belt, wearer = sum(leg.belt_power for leg in legs), sum(leg.wearer_power for leg in legs)
    motors = sum(sum(leg.motor_power.values()) for leg in legs)
    force, power = log["guide_force_N"].to_numpy(), 0.0
    holding, speed = mean_over(force, bounds), mean_over(log["belt_speed_m_per_s"].to_numpy(), bounds)
    for forward in ("pelvis_forward_velocity_m_per_s", "wearer_pelvis_forward_velocity_m_per_s"):
        if forward in log:  # with braces the harness is the wearer's
            power = mean_over(force * log[forward].to_numpy(), bounds)
    carried_by_belt = belt_carries(holding, speed, motors + wearer, walkway.carried_weight)
    return WalkPower(belt, motors, wearer, power, holding, carried_by_belt)


def belt_carries(holding: float, speed: float, legs: float, carried_weight: float) -> bool:
    """Whether the belt carries a walk: it drags the wearer along, and gives more than the legs do themselves.

    Told by what holds the pelvis against it: on level ground what the feet are dragged with, on a slope
    without what the weight pulls. ``holding``: mean forward force of guide or harness on the pelvis in [N];
    ``speed`` of the belt in [m] / [s]; ``legs``: net power of motors and wearer in [W]; ``carried_weight``:
    as in :class:`Walkway`. Returns false without strides.
    """
    return holding > LEAST_DRAG * carried_weight and holding * speed > legs
