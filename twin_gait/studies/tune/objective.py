r"""Objective of the tuning: named parts, each with a goal and a weight, computed from the summary of a walk.

A smaller value of a part is better, and the larger value of both legs counts. The cost of a walk is

.. math::

    J = \min\Bigl(J_{worst}, \sum_i w_i (x_i / g_i)^2\Bigr)

with value x, goal g and weight w of each part. A fall after a share s of the time costs
:math:`J_{worst} + (J_{fall} - J_{worst})(1 - s)`, which is more than any walk, and less for a later fall.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twin_gait.files import finite_or_none
from twin_gait.measures.crutches import TRUNK_PITCH
from twin_gait.measures.effort import root_mean_square
from twin_gait.measures.strides import finite_mean, normalise_strides, symmetry_index, values_in_strides
from twin_gait.report.reference import reference_cycle, reference_measures
from twin_gait.runs.leg_summary import MeasuredLeg, saturated_shares
from twin_gait.simulation.run import Run, RunStatus
from twin_gait.vocabulary import JointName, PelvisGuide
from twin_gait.yaml12 import load_data

WORST = 60.0  # cost of the worst walk that does not fall
FALL = 150.0  # cost of a fall at the start
# Weights of the excess over a goal, without which the search trades one goal for another; the goals of the
# errors have the larger weight.
ERROR_EXCESS_WEIGHT, EXCESS = 20.0, 6.0
EXCESS_THRESHOLD = 0.9  # fraction of a goal beyond which the excess counts, slightly better than the goal
NEEDED_CLEARANCE = 15.0  # [mm]; a lower clearance of the toe is a part of the objective


@dataclass(frozen=True)
class ObjectiveTerm:
    """One part of the objective."""

    name: str  # key in files
    title: str  # title for display
    unit: str  # unit for display
    goal: float  # value whose cost equals the weight
    weight: float  # w in the equation of the module
    excess: float = EXCESS  # weight e of the excess over the goal, see nominal_cost


SAMPLE_SPACING = 5  # [%] of a stride; distance between the sampled deviations
_ROWS = load_data(Path(__file__).with_name("objective.yaml"))
ERRORS = {
    JointName(joint): ObjectiveTerm(f"{joint}_error_deg", excess=ERROR_EXCESS_WEIGHT, **row)
    for joint, row in _ROWS["errors"].items()
}
_CARRIED_ANKLE = replace(ERRORS[JointName.ANKLE], weight=0.25, excess=EXCESS)
_OTHERS, _OPTIONAL = (
    [ObjectiveTerm(name, **row) for name, row in _ROWS[kind].items()] for kind in ("walk", "moving_trunk")
)


def objective_terms(joints: Sequence[str], values: Collection[str] = ()) -> tuple[ObjectiveTerm, ...]:
    """Return the parts of the objective: first the errors of the joints that the table drives, in its order.

    An ankle that the table does not drive has a small weight. ``values``: names of the parts that a walk has;
    those of a trunk that moves are left out if they are not among them.
    """
    errors = (ERRORS[JointName(joint)] for joint in joints)
    carried = () if JointName.ANKLE in joints else (_CARRIED_ANKLE,)
    return (*errors, *_OTHERS, *carried, *(part for part in _OPTIONAL if part.name in values))


def term_values(run: Run) -> dict[str, float | None]:
    """Compute the value of each part of a walk, none below zero; None if there are too few strides."""
    legs, walks = [MeasuredLeg(run, record) for record in run.leg_records()], run.walk_measures()
    contacts = [leg.contact_measures() for leg in legs]
    found = [
        _leg_values(leg, contact, walks[leg.record.side]) for leg, contact in zip(legs, contacts, strict=True)
    ]
    # The larger value of the legs counts; a value that is undefined in one leg is undefined.
    values = {name: float(np.max([0.0, *(leg[name] for leg in found)])) for name in found[0]}
    assert run.walkway is not None  # a tuned walk is on the ground
    dragged = sum(walk["fore_aft_force_N"] for walk in walks.values()) / run.walkway.carried_weight
    values |= {
        "fore_aft_pct": 100.0 * abs(dragged),
        "belt_power_W": abs(sum(walk["belt_power_W"] for walk in walks.values())),
        "saturated_pct": 100.0 * saturated_shares(legs)["any_joint_saturated_share"],
        "asymmetry_pct": _asymmetry(legs, contacts),
        **_trunk_values(run, legs[0].strides),
    }
    return {name: finite_or_none(value) for name, value in values.items()}


def _leg_values(leg: MeasuredLeg, contact: Mapping[str, Any], walk: Mapping[str, float]) -> dict[str, float]:
    """Compute the parts of one leg: errors, ground reaction forces, loaded knee, contacts and motors.

    ``contact`` is the result of :meth:`MeasuredLeg.contact_measures`. A value is NaN if it is not defined.
    """
    joints, strides = list(leg.record.angles), contact["strides"] or math.nan
    healthy = defaultdict(lambda: math.nan, reference_measures(leg.run.experiment))
    switches = [leg.torque_at_switches(joint) for joint in leg.record.driven]
    apart = leg.error_parts().get("errors", {})
    errors = {f"{joint}_error_deg": parts["total_deg"] for joint, parts in apart.items()}
    offsets = [abs(parts["offset_deg"]) for joint, parts in apart.items() if joint in joints]
    return {
        **{part.name: errors.get(part.name, math.nan) for part in ERRORS.values()},
        "offset_deg": max(offsets, default=math.nan),
        "knee_at_contact_deg": walk["knee_at_contact_deg"],
        "yield_lack_deg": healthy["knee_yield_deg"] - walk["knee_yield_deg"],
        "stride_time_error_pct": 100.0 * abs(contact["stride_time_mean_s"] / healthy["stride_time_s"] - 1.0),
        "double_support_error_pct": 100.0
        * abs(contact["double_support_share"] - healthy["double_support_share"]),
        "load_peak_pct": 100.0 * (walk["load_peak"] - 1.0),
        "trough_pct": 100.0 * (1.0 - walk["min_midstance_load"]),
        "slow_loading_pct": 100.0 * (1.0 - walk["min_load"]),
        "braking_peak_pct": -100.0 * walk["braking_peak"],
        "propulsion_lack_pct": 100.0 * (1.0 - walk["propulsion_peak"] / healthy["propulsion_peak"]),
        "stride_variation_pct": 100.0 * contact["stride_time_variation"],
        # Repeated contacts of a foot just after landing; further contacts in swing are scuffs.
        "second_contacts_per_stride": (contact["further_contacts"] - contact["scuffs"]) / strides,
        "scuffs_per_stride": contact["scuffs"] / strides,
        # A leg without drives has no torques of a device.
        "torque_change_Nm": float(np.max([0.0, *(item["switch_torque_change_Nm"] for item in switches)])),
        "torque_jump_Nm": float(np.max([0.0, *(item["switch_torque_jump_Nm"] for item in switches)])),
        "slip_mm": 1e3 * walk["slip_m"],
        "landing_speed_m_per_s": walk["landing_speed_m_per_s"],
        "clearance_lack_mm": NEEDED_CLEARANCE - 1e3 * contact["toe_clearance_min_m"],
    }


def _asymmetry(legs: Sequence[MeasuredLeg], contacts: Sequence[Mapping[str, Any]]) -> float:
    """Compute the largest absolute symmetry index in [%] of the swing share and the ranges of the joints."""
    common = [joint for joint in legs[0].record.angles if all(joint in leg.record.angles for leg in legs)]
    left, right = (
        [contact["swing_share"], *(_range_of_motion(leg, joint) for joint in common)]
        for leg, contact in zip(legs, contacts, strict=True)
    )
    return 100.0 * float(np.max([abs(symmetry_index(*pair)) for pair in zip(left, right, strict=True)]))


def _range_of_motion(leg: MeasuredLeg, joint: JointName) -> float:
    return finite_mean(leg.motion(leg.record.angles[joint])["range_of_motion_deg"])


def _trunk_values(run: Run, bounds: np.ndarray) -> dict[str, float]:
    """Compute the parts of a trunk that moves: pitch, or distance and crutches if the pelvis is free.

    ``bounds``: strides in which the pitch counts. Returns no part for a trunk that does not pitch.
    """
    log, walking = run.columns, run.experiment.scenario.walking
    if walking is None or run.experiment.scenario.pelvis is not PelvisGuide.FREE:
        if TRUNK_PITCH not in log:
            return {}
        pitch = values_in_strides(np.asarray(log[TRUNK_PITCH]), bounds)
        return {"trunk_pitch_rms_deg": math.degrees(root_mean_square(pitch))}
    names = [f"{side}_crutch_normal_force_N" for side in run.sides]
    way = np.asarray(log["pelvis_forward_m"])
    speed = float(way[-1] - way[0]) / run.duration
    shares = [float(np.asarray(log[name]).mean()) / run.body_weight for name in names if name in log]
    return {
        "slowness_pct": max(0.0, 100.0 * (1.0 - speed / walking.speed)),
        "crutch_load_pct": 100.0 * max(shares, default=0.0),
    }


class Rating(NamedTuple):
    """Rating of a walk: plain values only, which can be sent between processes."""

    cost: float  # J of the module
    values: dict[str, float | None]  # values of the parts
    fell: bool  # whether it ended by a fall or a trip of the safety monitor, or diverged
    lasted_share: float  # fraction of the time
    # deviations of the mean strides from the reference, over goals; their squares add up to approximately
    # the squared errors, averaged over both legs. Empty if a leg made no stride
    deviations: tuple[float, ...] = ()
    torque: float = math.nan  # root mean square over all motors in [N·m]; its square heats the windings
    joints: tuple[str, ...] = (JointName.HIP, JointName.KNEE)  # joints that the table drives

    @property
    def terms(self) -> tuple[ObjectiveTerm, ...]:
        """Parts of the objective for this walk."""
        return objective_terms(self.joints, self.values)


def rate_walk(run: Run) -> Rating:
    """Rate a walk for the tuning: cost, values of the parts, and further properties."""
    values, joints = term_values(run), tuple(run.table.joints)
    fell = run.trip is not None or run.status in (RunStatus.FELL, RunStatus.DIVERGED)
    end = run.duration if run.trip is None else run.trip.time
    lasted = min(1.0, end / run.experiment.duration)
    names = [f"{side}_{joint}_motor_torque_Nm" for side in run.experiment.sides for joint in joints]
    torques = np.array([run.columns[name] for name in names]).T.ravel()
    cost = walk_cost(values, lasted, fell, joints)
    return Rating(cost, values, fell, lasted, _deviations(run), root_mean_square(torques), joints)


def walk_cost(
    values: Mapping[str, float | None], lasted_share: float, fell: bool, joints: tuple[str, ...]
) -> float:
    """Compute the cost of a walk with these values that lasted for a fraction of the time.

    A walk whose errors are undefined because it has too few strides costs ``WORST``; any other undefined part
    costs its weight.
    """
    if fell:
        return WORST + (FALL - WORST) * (1.0 - lasted_share)
    if any(values[f"{joint}_error_deg"] is None for joint in joints):
        return WORST
    return min(WORST, sum(term_costs(values, joints).values()))


def term_costs(values: Mapping[str, float | None], joints: tuple[str, ...]) -> dict[str, float]:
    """Compute the cost of each part; its weight if it is not defined."""
    costs = {}
    for part in objective_terms(joints, values):
        value = values[part.name]
        ratio = 1.0 if value is None else value / part.goal
        costs[part.name] = part.weight * ratio * ratio
    return costs


def nominal_cost(walk: Rating) -> float:
    r"""Compute the cost of the nominal walk, in which exceeding a goal costs more.

    .. math::

        J + \sum_i e_i \max(0, x_i / g_i - 0.9)^2

    Above half of ``WORST`` the cost is compressed so that it stays below ``WORST``: a fall costs more than
    any walk, and of two bad walks the worse one costs more.
    """
    if walk.fell or not walk.deviations:
        return walk.cost
    total = walk.cost + sum(lack * lack for lack in _excess_residuals(walk))
    half = 0.5 * WORST
    return total if total <= half else WORST - half * half / total


def residuals(walk: Rating, *, nominal: bool = True) -> np.ndarray:
    """Compute numbers whose squares add up to about the cost of a walk; none after a fall.

    ``nominal``: whether the cost is the :func:`nominal_cost`, in which exceeding a goal costs more. The
    errors enter sample by sample, which contains more information than one number for each joint.
    """
    if walk.fell or not walk.deviations:
        return np.zeros(0)
    costs = term_costs(walk.values, walk.joints)
    others = [math.sqrt(costs[part.name]) for part in walk.terms[len(walk.joints) :]]
    return np.array([*walk.deviations, *others, *(_excess_residuals(walk) if nominal else ())])


def _excess_residuals(walk: Rating) -> list[float]:
    """Compute the root of the cost of each term beyond ``EXCESS_THRESHOLD`` of its goal; 0 if undefined."""
    ratios = ((walk.values[part.name] or 0.0) / part.goal for part in walk.terms)
    return [
        math.sqrt(part.excess) * max(0.0, ratio - EXCESS_THRESHOLD)
        for part, ratio in zip(walk.terms, ratios, strict=True)
    ]


def _deviations(run: Run) -> tuple[float, ...]:
    """Compute the mean strides minus the reference, over the goal, at every 5 % of the stride.

    The squares add up to 1 at the goals. Empty if a leg has no stride or there is no reference.
    """
    legs = run.leg_records()
    found: list[float] = []
    for leg in legs:
        for joint, angles in leg.angles.items():
            cycles = normalise_strides(angles, leg.strides())
            reference = reference_cycle(run.experiment, joint)
            if not len(cycles) or reference is None:
                return ()
            apart = np.degrees(cycles.mean(axis=0) - reference)[:-1:SAMPLE_SPACING]
            found += (apart / (ERRORS[joint].goal * math.sqrt(len(legs) * len(apart)))).tolist()
    return tuple(found)
